//! Speed in free run within short windows, driven by the torque of the measured currents (or the recorded torque).

use super::electrical::{measured_env, true_env};
use crate::base::Base;
use crate::effect::Env;
use crate::model::Model;
use crate::real::Real;
use crate::rk4;
use crate::signals::Signals;
use std::ops::Range;

/// Length of a window, s.
pub const WINDOW: f64 = 0.25;
/// Largest electrical angle (rad) between samples at which steps over two samples still follow torque that depends on the angle.
const COARSE: f64 = 0.06;
/// Largest angle (rad) by which a ringing shaft may turn its phase within one step; longer steps are divided.
const RINGING: f64 = 0.4;
/// A last window shorter than this share of [`WINDOW`] joins the one before.
const SHORTEST: f64 = 0.2;

/// The windows of a recording: each gap-free segment cut into runs of [`WINDOW`] seconds.
pub fn windows(signals: &Signals) -> Vec<Range<usize>> {
    let mut out: Vec<Range<usize>> = Vec::new();
    for segment in &signals.segments {
        let first = out.len();
        let mut start = segment.start;
        for k in segment.clone() {
            if signals.t[k] - signals.t[start] >= WINDOW - 0.5 * signals.period {
                out.push(start..k);
                start = k;
            }
        }
        let rest = signals.t[segment.end - 1] - signals.t[start];
        if out.len() > first && rest < SHORTEST * WINDOW {
            out.last_mut().expect("a window was pushed").end = segment.end;
        } else {
            out.push(start..segment.end);
        }
    }
    out
}

/// What a run leaves open beside the model's parameters: an unknown load torque, constant between instants that are
/// themselves parameters, and the initial values of the mechanical extra states. Its parameters are the load levels
/// (N·m), the instants at which they change (s from the first sample, ascending), and the deviation of each extra
/// state from its quasi-static start. What the recording tells of the load comes on top.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Nuisance {
    /// Number of unknown levels; zero if the load is known.
    pub levels: usize,
    /// Number of mechanical extra states of the model.
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

/// Motor torque at every sample from the measured currents (or as recorded), N·m.
pub fn torque<T: Real>(model: &Model, signals: &Signals, p: &[T]) -> Vec<T> {
    if let Some(tau) = &signals.tau_e {
        return tau.iter().map(|x| T::constant(*x)).collect();
    }
    let (Some(phases), Some(i)) = (&signals.phases, &signals.i) else {
        return vec![T::zero(); signals.len()];
    };
    let base = Base::new(p);
    let sensed = model.has_sensor();
    (0..signals.len())
        .map(|k| {
            let measured = measured_env(signals, k);
            if !sensed {
                let i = [T::constant(i[0][k]), T::constant(i[1][k])];
                return model.steady_state::<T, 12>(p, &base, i, &measured).1;
            }
            let sensor = model.sensor(p, &measured);
            let env = true_env(&sensor, &measured, signals.n_p);
            let i = model.true_current(&sensor, [phases[0][k], phases[1][k], phases[2][k]], measured.theta_e);
            model.steady_state::<T, 12>(p, &base, i, &env).1
        })
        .collect()
}

/// How the simulation starts each window.
pub trait Restart<T> {
    /// The electrical speed (rad/s) with which window `number`, beginning at sample `k`, starts.
    fn speed(&mut self, number: usize, k: usize) -> T;
    /// Lets the caller forget, in a state carried over, what belongs to the window before.
    fn forget(&self, state: &mut T);
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
        0 => run_sized::<T, 1>(model, signals, p, tau_e, load, windows, restart, sink),
        1..=2 => run_sized::<T, 3>(model, signals, p, tau_e, load, windows, restart, sink),
        _ => run_sized::<T, 9>(model, signals, p, tau_e, load, windows, restart, sink),
    }
}

fn run_sized<T: Real, const N: usize>(
    model: &Model,
    signals: &Signals,
    p: &[T],
    tau_e: &[T],
    (load, own): (Nuisance, &[T]),
    windows: &[Range<usize>],
    mut restart: impl Restart<T>,
    mut sink: impl FnMut(usize, usize, T),
) {
    let base = Base::new(p);
    let n_p = signals.n_p;
    let sensed = model.has_sensor();
    let environment = |k: usize| -> (Env<T>, T) {
        let measured = measured_env(signals, k);
        if sensed {
            let sensor = model.sensor(p, &measured);
            (true_env(&sensor, &measured, n_p), T::one() - sensor.angle_slope)
        } else {
            (measured, T::one())
        }
    };
    // The rotor is slow compared to the samples: one step spans two of them, the sample between being its middle.
    let coarse = signals.context.omega_e_max * signals.period <= COARSE;
    let ringing = model.ringing(p);
    let mut state = [T::zero(); N];
    let mut level = 0;
    for (number, window) in windows.iter().enumerate() {
        let mut k = window.start;
        while k < window.end {
            let (env, scale) = environment(k);
            let show = |omega_m: T, scale: T| if sensed { omega_m * n_p / scale } else { omega_m * n_p };
            let span = span(signals, k, window, coarse);
            let h =
                if k + span < signals.len() { signals.t[k + span] - signals.t[k] } else { signals.period };
            let tau_load = load_over(load, own, signals, k, k + span, h, &mut level);
            if k == window.start {
                let omega_m = restart.speed(number, k) * scale * (1.0 / n_p);
                if number > 0 && continues(signals, &windows[number - 1], k) {
                    for x in &mut state[1..] {
                        restart.forget(x);
                    }
                    state[0] = omega_m;
                } else {
                    state = model.mechanical_start(p, &base, omega_m, tau_e[k], tau_load, &env);
                    if number == 0 {
                        let deviation = &own[load.parameter_count() - load.initial..];
                        for (x, d) in state[1..].iter_mut().zip(deviation) {
                            *x += *d;
                        }
                    }
                }
            }
            sink(number, k, show(state[0], scale));
            if k + 1 == signals.len() {
                break;
            }
            let end = environment(k + span).0;
            let (half, half_scale) =
                if span == 2 { environment(k + 1) } else { (mix(0.5, (scale, env), (scale, end)).1, scale) };
            let torque =
                [tau_e[k], if span == 2 { tau_e[k + 1] } else { halfway(tau_e, k, window) }, tau_e[k + span]];
            // Signals at fraction `c` of the step, straight from sample to sample.
            let at = |c: f64| -> (T, Env<T>) {
                if c < 0.5 {
                    mix(2.0 * c, (torque[0], env), (torque[1], half))
                } else {
                    mix(2.0 * c - 1.0, (torque[1], half), (torque[2], end))
                }
            };
            let rhs = |at: &[(T, Env<T>); 3], c: f64, s: &[T; N]| {
                let (tau, env) = &at[(2.0 * c) as usize];
                model.mechanical_rhs(p, &base, s, *tau, tau_load, env)
            };
            let pieces = (h * ringing / RINGING).ceil().clamp(1.0, 64.0) as usize;
            if pieces == 1 {
                let at = [at(0.0), at(0.5), at(1.0)];
                let (middle, next) = rk4::step_with_middle(h, &state, |c, s| rhs(&at, c, s));
                if span == 2 {
                    sink(number, k + 1, show(middle[0], half_scale));
                }
                state = next;
            } else {
                let pieces = pieces.next_multiple_of(span);
                for piece in 0..pieces {
                    if span == 2 && 2 * piece == pieces {
                        sink(number, k + 1, show(state[0], half_scale));
                    }
                    let from = |c: f64| at((piece as f64 + c) / pieces as f64);
                    let at = [from(0.0), from(0.5), from(1.0)];
                    state = rk4::step(h / pieces as f64, &state, |c, s| rhs(&at, c, s));
                }
            }
            k += span;
        }
    }
}

/// Torque halfway from sample `k` to the next, by the cubic through its neighbours within the window.
fn halfway<T: Real>(tau: &[T], k: usize, window: &Range<usize>) -> T {
    let straight = (tau[k] + tau[k + 1]) * 0.5;
    if k == window.start || k + 2 >= window.end {
        return straight;
    }
    straight * 1.125 - (tau[k - 1] + tau[k + 2]) * 0.0625
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
    let between = |x: T, y: T| x * (1.0 - c) + y * c;
    let env = Env {
        t: a.1.t + c * (b.1.t - a.1.t),
        theta_e: between(a.1.theta_e, b.1.theta_e),
        theta_m: between(a.1.theta_m, b.1.theta_m),
        ..a.1
    };
    (between(a.0, b.0), env)
}

/// Whether a window that begins at sample `k` goes on where the one `before` it ended, without a gap.
fn continues(signals: &Signals, before: &Range<usize>, k: usize) -> bool {
    let segment = signals.segments.iter().find(|s| s.contains(&k));
    before.end == k && segment.is_some_and(|s| s.start < k)
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
    let behind = |step: T| (end - step) * (1.0 / h);
    while *level < steps.len() && (behind(steps[*level]) - 1.0).positive() {
        *level += 1;
    }
    let mean = levels[*level] + known;
    match steps.get(*level) {
        Some(step) if behind(*step).positive() => {
            mean + (levels[*level + 1] - levels[*level]) * behind(*step)
        }
        _ => mean,
    }
}

/// Mean of a piecewise linear signal given at equal distances.
fn mean(x: &[f64]) -> f64 {
    let inner: f64 = x[1..x.len() - 1].iter().sum();
    (inner + 0.5 * (x[0] + x[x.len() - 1])) / (x.len() - 1) as f64
}
