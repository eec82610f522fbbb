//! Speed in free run within short windows, driven by the torque of the measured currents (or the recorded torque).

mod acceleration;
mod beside;
mod between;
mod forms;
mod load;
mod losses;
mod torque;
mod windows;

use crate::base::Base;
use crate::effect::Env;
use crate::effects::MECHANICAL_STATES;
use crate::model::Model;
use crate::numerics::real::{Carries, Loop, Real};
use crate::numerics::rk4::{self, Slope};
use crate::signals::Signals;
use crate::simulate::forms::{One, Sink};
use std::marker::PhantomData;
use std::ops::Range;

use between::{Driven, Lifted, Way, environment, halfway, mix, span, steps_are_coarse};
use load::load_over;

pub use acceleration::{Rotor, Torque};
pub use beside::Windows;
pub use between::torque_halfway;
pub use forms::{By, Forms};
pub use load::Nuisance;
pub use losses::{Losses, Stations};
pub use torque::{flux, torque, torque_with};
pub use windows::{WINDOW, windows};

/// Largest angle (rad) by which a ringing shaft may turn its phase within one step; longer steps are divided.
const RINGING: f64 = 0.4;
/// Most pieces of a step: beyond them a shaft rings faster than the samples tell, and it is enough that its simulation stays stable.
const PIECES: f64 = 6.0;

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
        _ => T::fastest(Run::<T, _, _, MECHANICAL_STATES> {
            model,
            signals,
            p,
            tau_e,
            load,
            windows,
            restart,
            sink,
        }),
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
    fn run<W: Carries<T>>(self) {
        let carry = |x: &[T]| x.iter().map(|x| W::carry(*x)).collect::<Vec<W>>();
        let (p, own) = (carry(self.p), carry(self.load.1));
        let restart = Carried { inner: self.restart, number: PhantomData };
        let load = (self.load.0, &own[..]);
        let (tau_e, mut sink) = (Lifted(self.tau_e), self.sink);
        let mut sink = One::new(|number, k, [shown]: [T; 1]| sink(number, k, shown));
        run_sized::<W, _, N>(self.model, self.signals, &p, &tau_e, load, self.windows, restart, &mut sink);
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
fn run_sized<W: Real, R: Restart<W>, const N: usize>(
    model: &Model,
    signals: &Signals,
    p: &[W],
    tau_e: &impl Driven<W>,
    (load, own): (Nuisance, &[W]),
    windows: &[Range<usize>],
    mut restart: R,
    sink: &mut impl Sink<W, 1>,
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
                    state = model.mechanical_start(p, &base, omega_m, tau_e.at(k), tau_load, &env);
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
            sink.take(number, k, [if sensed { shown / scale } else { shown }]);
            if k + 1 == signals.len() {
                break;
            }
            let end = environment(model, signals, p, k + span).0;
            let (half, half_scale) = if span == 2 {
                environment(model, signals, p, k + 1)
            } else {
                (mix(0.5, (scale, env), (scale, end)).1, scale)
            };
            let torque = if span == 2 { tau_e.at(k + 1) } else { halfway(tau_e, k, window) };
            let way = Way { torque: [tau_e.at(k), torque, tau_e.at(k + span)], env: [env, half, end] };
            let mut pieces = 1;
            if h * ringing > RINGING {
                pieces = ((h * ringing / RINGING).ceil().min(PIECES) as usize).next_multiple_of(span);
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
                sink.take(number, k + 1, [if sensed { shown / half_scale } else { shown }]);
            }
            k += span;
        }
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
