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
    let mut state = [T::zero(); N];
    let mut level = 0;
    for (number, window) in windows.iter().enumerate() {
        for k in window.clone() {
            let measured = measured_env(signals, k);
            let sensor = model.sensor(p, &measured);
            let env = if sensed { true_env(&sensor, &measured, n_p) } else { measured };
            let h = if k + 1 < signals.len() { signals.t[k + 1] - signals.t[k] } else { signals.period };
            let tau_load = load_over(load, own, signals, k, h, &mut level);
            if k == window.start {
                let shown = restart.speed(number, k);
                let omega_m = shown * (T::one() - sensor.angle_slope) * (1.0 / n_p);
                let continues = number > 0 && windows[number - 1].end == k && {
                    let s = signals.segments.iter().find(|s| s.contains(&k));
                    s.is_some_and(|s| s.start < k)
                };
                if continues {
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
            let shown = state[0] * n_p;
            sink(number, k, if sensed { shown / (T::one() - sensor.angle_slope) } else { shown });
            if k + 1 == window.end && k + 1 == signals.len() {
                break;
            }
            let next = measured_env(signals, k + 1);
            let next_env = if sensed { true_env(&model.sensor(p, &next), &next, n_p) } else { next };
            let (torque, torque_next) = (tau_e[k], tau_e[k + 1]);
            state = rk4::step(h, &state, |c, s| {
                let at = Env {
                    t: env.t + c * h,
                    theta_e: env.theta_e * (1.0 - c) + next_env.theta_e * c,
                    theta_m: env.theta_m * (1.0 - c) + next_env.theta_m * c,
                    ..env
                };
                model.mechanical_rhs(p, &base, s, torque * (1.0 - c) + torque_next * c, tau_load, &at)
            });
        }
    }
}

/// Mean load torque over the interval that begins at sample `k`; `level` is a cursor into the profile. It is smooth
/// in the instants, so that they can be fitted like any parameter.
fn load_over<T: Real>(
    load: Nuisance,
    own: &[T],
    signals: &Signals,
    k: usize,
    h: f64,
    level: &mut usize,
) -> T {
    let known = match signals.load {
        crate::recording::Load::KnownConstant(value) => value,
        crate::recording::Load::Measured => signals
            .tau_m
            .as_ref()
            .map_or(0.0, |tau| if k + 1 < tau.len() { 0.5 * (tau[k] + tau[k + 1]) } else { tau[k] }),
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
