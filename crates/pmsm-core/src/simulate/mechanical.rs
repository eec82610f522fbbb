//! Speed in free run within short windows, driven by the torque of the measured currents (or the recorded torque).

mod acceleration;
mod torque;
mod windows;

use super::electrical::{measured_env, true_env};
use crate::base::Base;
use crate::effect::Env;
use crate::model::Model;
use crate::real::{Carries, Loop, Real};
use crate::rk4::{self, Slope};
use crate::signals::Signals;
use std::marker::PhantomData;
use std::ops::Range;

pub use acceleration::accelerations;
pub use torque::torque;
pub use windows::{WINDOW, windows};

/// Largest electrical angle (rad) between samples at which steps over two samples still follow torque that depends on the angle.
const COARSE: f64 = 0.06;
/// Largest angle (rad) by which a ringing shaft may turn its phase within one step; longer steps are divided.
const RINGING: f64 = 0.4;
/// Most pieces of a step: beyond them a shaft rings faster than the samples tell, and it is enough that its simulation stays stable.
const PIECES: f64 = 6.0;

/// What a run leaves open beside the model's parameters: an unknown load torque, constant between instants that are
/// themselves parameters, and the initial values of the mechanical extra states. Its parameters are the load levels
/// (N·m), the instants at which they change (s from the first sample, ascending), and the deviation of each extra
/// state from its quasi-static start, where the recording begins and behind each gap. What the recording tells of the load comes on top.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Nuisance {
    /// Number of unknown levels; zero if the load is known.
    pub levels: usize,
    /// Number of initial values of the model's mechanical extra states: theirs where the recording begins, and as many for each later
    /// [beginning](beginnings); where they are fewer the later ones are quasi-static.
    pub initial: usize,
}

impl Nuisance {
    /// A load that is known or absent.
    pub fn known(initial: usize) -> Self {
        Self { levels: 0, initial }
    }

    /// A load of unknown level that changes `steps` times.
    pub fn unknown(steps: usize, initial: usize) -> Self {
        Self { levels: steps + 1, initial }
    }

    /// Number of instants at which the level changes.
    pub fn steps(&self) -> usize {
        self.levels.saturating_sub(1)
    }

    /// Number of parameters: levels, instants, initial values.
    pub fn parameter_count(&self) -> usize {
        self.levels + self.steps() + self.initial
    }
}

/// How the simulation starts each window.
pub trait Restart<T> {
    /// The electrical speed (rad/s) with which window `number`, beginning at sample `k`, starts.
    fn speed(&mut self, number: usize, k: usize) -> T;
    /// Lets the caller forget, in a state carried over, what belongs to the window before.
    fn forget(&self, state: &mut T);
    /// Whether [`Restart::step`] is to be called.
    const WATCHES: bool = false;
    /// Shows the caller the states at the beginning of the step over `samples`, to seed them anew; `begins` where they were set there.
    fn step<const N: usize>(&mut self, _samples: Range<usize>, _begins: bool, _state: &mut [T; N]) {}
}

/// Simulates the speed and hands to `sink` the window number, the sample number and the electrical speed that the log
/// should show, rad/s. `tau_e` is the motor torque per sample, and `load` comes with its parameters.
/// Extra states (a twisting shaft) run on from window to window.
pub fn run<T: Real>(
    model: &Model,
    signals: &Signals,
    p: &[T],
    tau_e: &[T],
    load: (Nuisance, &[T]),
    windows: &[Range<usize>],
    restart: impl Restart<T>,
    sink: impl FnMut(usize, usize, T),
) {
    match model.mechanical_states() {
        0 => T::fastest(Run::<T, _, _, 1> { model, signals, p, tau_e, load, windows, restart, sink }),
        1..=2 => T::fastest(Run::<T, _, _, 3> { model, signals, p, tau_e, load, windows, restart, sink }),
        _ => T::fastest(Run::<T, _, _, 9> { model, signals, p, tau_e, load, windows, restart, sink }),
    }
}

/// A run with `N` states.
struct Run<'a, T, R, S, const N: usize> {
    model: &'a Model,
    signals: &'a Signals,
    p: &'a [T],
    tau_e: &'a [T],
    load: (Nuisance, &'a [T]),
    windows: &'a [Range<usize>],
    restart: R,
    sink: S,
}

impl<T: Real, R: Restart<T>, S: FnMut(usize, usize, T), const N: usize> Loop<T> for Run<'_, T, R, S, N> {
    type Output = ();
    #[inline(always)]
    fn run<W: Carries<T>>(mut self) {
        let carry = |x: &[T]| x.iter().map(|x| W::carry(*x)).collect::<Vec<W>>();
        let (p, own) = (carry(self.p), carry(self.load.1));
        let restart = Carried { inner: self.restart, number: PhantomData };
        let load = (self.load.0, &own[..]);
        let (windows, sink) = (self.windows, &mut self.sink);
        run_sized::<T, W, _, N>(self.model, self.signals, &p, self.tau_e, load, windows, restart, sink);
    }
}

/// A restart spoken to in another number type.
struct Carried<R, T> {
    inner: R,
    number: PhantomData<T>,
}

impl<T: Real, W: Carries<T>, R: Restart<T>> Restart<W> for Carried<R, T> {
    fn speed(&mut self, number: usize, k: usize) -> W {
        W::carry(self.inner.speed(number, k))
    }
    fn forget(&self, state: &mut W) {
        let mut own = state.give();
        self.inner.forget(&mut own);
        *state = W::carry(own);
    }
    const WATCHES: bool = R::WATCHES;
    fn step<const N: usize>(&mut self, samples: Range<usize>, begins: bool, state: &mut [W; N]) {
        let mut own = state.map(W::give);
        self.inner.step(samples, begins, &mut own);
        *state = own.map(W::carry);
    }
}

#[inline(always)]
fn run_sized<T: Real, W: Carries<T>, R: Restart<W>, const N: usize>(
    model: &Model,
    signals: &Signals,
    p: &[W],
    tau_e: &[T],
    (load, own): (Nuisance, &[W]),
    windows: &[Range<usize>],
    mut restart: R,
    sink: &mut impl FnMut(usize, usize, T),
) {
    let base = Base::new(p);
    let (n_p, sensed) = (signals.n_p, model.has_sensor());
    // The rotor is slow compared to the samples: one step spans two of them, the sample between being its middle.
    let coarse = steps_are_coarse(signals);
    let ringing = model.ringing(p);
    let mut state = [W::zero(); N];
    let (mut level, mut begun) = (0, 0);
    for (number, window) in windows.iter().enumerate() {
        let mut k = window.start;
        while k < window.end {
            let (env, scale) = environment(model, signals, p, k);
            let span = span(signals, k, window, coarse);
            let h =
                if k + span < signals.len() { signals.t[k + span] - signals.t[k] } else { signals.period };
            let tau_load = load_over(load, own, signals, k, k + span, h, &mut level);
            let mut begins = false;
            if k == window.start {
                let omega_m = restart.speed(number, k) * scale * (1.0 / n_p);
                begins = number == 0 || !continues(signals, &windows[number - 1], k);
                if begins {
                    state = model.mechanical_start(p, &base, omega_m, W::carry(tau_e[k]), tau_load, &env);
                    let deviations = &own[load.parameter_count() - load.initial..];
                    for (x, d) in state[1..].iter_mut().zip(deviations.iter().skip(begun)) {
                        *x += *d;
                    }
                    begun += model.mechanical_states();
                } else {
                    for x in &mut state[1..] {
                        restart.forget(x);
                    }
                    state[0] = omega_m;
                }
            }
            if R::WATCHES {
                restart.step(k..k + span, begins, &mut state);
            }
            let shown = state[0] * n_p;
            sink(number, k, (if sensed { shown / scale } else { shown }).give());
            if k + 1 == signals.len() {
                break;
            }
            let end = environment(model, signals, p, k + span).0;
            let (half, half_scale) = if span == 2 {
                environment(model, signals, p, k + 1)
            } else {
                (mix(0.5, (scale, env), (scale, end)).1, scale)
            };
            let torque = if span == 2 { W::carry(tau_e[k + 1]) } else { halfway(tau_e, k, window) };
            let way = Way {
                torque: [W::carry(tau_e[k]), torque, W::carry(tau_e[k + span])],
                env: [env, half, end],
            };
            let mut pieces = (h * ringing / RINGING).ceil().clamp(1.0, PIECES) as usize;
            if pieces > 1 {
                pieces = pieces.next_multiple_of(span);
            }
            let mut middle = state;
            for piece in 0..pieces {
                if 2 * piece == pieces {
                    middle = state;
                }
                let (from, whole) = (piece as f64, pieces as f64);
                let at = [way.at(from / whole), way.at((from + 0.5) / whole), way.at((from + 1.0) / whole)];
                let rhs = Rhs { model, p, base: &base, at, tau_load };
                if pieces == 1 {
                    (middle, state) = rk4::advance_with_middle(h, &state, &rhs);
                } else {
                    state = rk4::advance(h / whole, &state, &rhs);
                }
            }
            if span == 2 {
                let shown = middle[0] * n_p;
                sink(number, k + 1, (if sensed { shown / half_scale } else { shown }).give());
            }
            k += span;
        }
    }
}

/// The true environment at sample `k`, and the measured over the true speed's share that the sensor leaves.
#[inline(always)]
fn environment<T: Real>(model: &Model, signals: &Signals, p: &[T], k: usize) -> (Env<T>, T) {
    let measured = measured_env(signals, k);
    if model.has_sensor() {
        let sensor = model.sensor(p, &measured);
        (true_env(&sensor, &measured, signals.n_p), T::one() - sensor.angle_slope)
    } else {
        (measured, T::one())
    }
}

/// Signals at the beginning, in the middle and at the end of a step.
struct Way<T> {
    torque: [T; 3],
    env: [Env<T>; 3],
}

impl<T: Real> Way<T> {
    /// Torque and environment at fraction `c` of the step, straight from one to the next.
    #[inline(always)]
    fn at(&self, c: f64) -> (T, Env<T>) {
        let (from, c) = if c < 0.5 { (0, 2.0 * c) } else { (1, 2.0 * c - 1.0) };
        mix(c, (self.torque[from], self.env[from]), (self.torque[from + 1], self.env[from + 1]))
    }
}

/// The right-hand side within one step; torque and environment at its beginning, middle and end.
struct Rhs<'a, T> {
    model: &'a Model,
    p: &'a [T],
    base: &'a Base<T>,
    at: [(T, Env<T>); 3],
    tau_load: T,
}

impl<T: Real, const N: usize> Slope<T, N> for Rhs<'_, T> {
    #[inline(always)]
    fn at(&self, c: f64, state: &[T; N]) -> [T; N] {
        let (tau_e, env) = &self.at[(2.0 * c) as usize];
        self.model.mechanical_rhs(self.p, self.base, state, *tau_e, self.tau_load, env)
    }
}

/// Torque halfway from sample `k` to the next, by the cubic through its neighbours within the window.
#[inline(always)]
fn halfway<T: Real, W: Carries<T>>(tau: &[T], k: usize, window: &Range<usize>) -> W {
    let at = |k: usize| W::carry(tau[k]);
    let straight = (at(k) + at(k + 1)) * 0.5;
    if k == window.start || k + 2 >= window.end {
        return straight;
    }
    straight * 1.125 - (at(k - 1) + at(k + 2)) * 0.0625
}

/// Torque and environment at fraction `c` between two samples.
#[inline(always)]
fn mix<T: Real>(c: f64, a: (T, Env<T>), b: (T, Env<T>)) -> (T, Env<T>) {
    if c == 0.0 {
        return a;
    }
    if c == 1.0 {
        return b;
    }
    let env = Env {
        t: a.1.t + c * (b.1.t - a.1.t),
        theta_e: between(a.1.theta_e, b.1.theta_e, c),
        theta_m: between(a.1.theta_m, b.1.theta_m, c),
        ..a.1
    };
    (between(a.0, b.0, c), env)
}

#[inline(always)]
fn between<T: Real>(x: T, y: T, c: f64) -> T {
    x * (1.0 - c) + y * c
}

/// Number of times the rotor's states begin anew: with the recording and behind each gap.
pub fn beginnings(signals: &Signals, windows: &[Range<usize>]) -> usize {
    let anew =
        |number: &usize| *number == 0 || !continues(signals, &windows[number - 1], windows[*number].start);
    (0..windows.len()).filter(anew).count()
}

/// Whether a window that begins at sample `k` goes on where the one `before` it ended, without a gap.
fn continues(signals: &Signals, before: &Range<usize>, k: usize) -> bool {
    let segment = signals.segments.iter().find(|s| s.contains(&k));
    before.end == k && segment.is_some_and(|s| s.start < k)
}

/// Whether the rotor hardly turns from sample to sample, so that one step may span two of them.
fn steps_are_coarse(signals: &Signals) -> bool {
    signals.context.omega_e_max * signals.period <= COARSE
}

/// Samples that the step from sample `k` spans: two if it may be coarse and the sample between lies in the middle.
fn span(signals: &Signals, k: usize, window: &Range<usize>, coarse: bool) -> usize {
    let t = &signals.t;
    let even = || {
        let (whole, half) = (t[k + 2] - t[k], t[k + 1] - t[k]);
        (half - 0.5 * whole).abs() < 1e-3 * whole
    };
    if coarse && k + 2 < window.end && even() { 2 } else { 1 }
}

/// Mean load torque over the interval of length `h` (s) from sample `k` to `next`; `level` is a cursor into the profile. It is
/// smooth in the instants, so that they can be fitted like any parameter.
#[inline(always)]
fn load_over<T: Real>(
    load: Nuisance,
    own: &[T],
    signals: &Signals,
    k: usize,
    next: usize,
    h: f64,
    level: &mut usize,
) -> T {
    let known = match signals.load {
        crate::recording::Load::KnownConstant(value) => value,
        crate::recording::Load::Measured => signals
            .tau_m
            .as_ref()
            .map_or(0.0, |tau| if next < tau.len() { mean(&tau[k..=next]) } else { tau[k] }),
        _ => 0.0,
    };
    if load.levels == 0 {
        return T::constant(known);
    }
    let (levels, rest) = own.split_at(load.levels);
    let steps = &rest[..load.steps()];
    let end = T::constant(signals.t[k] + h);
    // Share of the interval behind the next instant: negative before it, above one once it lies in the past.
    while *level < steps.len() && ((end - steps[*level]) * (1.0 / h) - 1.0).positive() {
        *level += 1;
    }
    let mean = levels[*level] + known;
    match steps.get(*level) {
        Some(step) if (end - *step).positive() => {
            mean + (levels[*level + 1] - levels[*level]) * ((end - *step) * (1.0 / h))
        }
        _ => mean,
    }
}

/// Mean of a piecewise linear signal given at equal distances.
fn mean(x: &[f64]) -> f64 {
    let inner: f64 = x[1..x.len() - 1].iter().sum();
    (inner + 0.5 * (x[0] + x[x.len() - 1])) / (x.len() - 1) as f64
}
