//! Currents in free run, driven by the logged voltage (held from sample to sample) and the measured speed and angle.

use crate::base::Base;
use crate::effect::{Env, Sensor};
use crate::model::Model;
use crate::real::Real;
use crate::rk4;
use crate::signals::Signals;
use crate::transforms::rotate;

/// Largest product of step and fastest rate; longer sample periods are divided.
const STEP_LIMIT: f64 = 0.15;

/// Simulates the currents and hands to `sink` the sample number and the d, q current that the log should show, A.
/// `p` is the parameter vector of `model`. Each gap-free segment starts from its first measured current.
/// Nothing is called if the recording has no voltages or currents.
pub fn run<T: Real>(model: &Model, signals: &Signals, p: &[T], sink: impl FnMut(usize, [T; 2])) {
    match model.electrical_states() {
        0 => run_sized::<T, 2>(model, signals, p, sink),
        1..=2 => run_sized::<T, 4>(model, signals, p, sink),
        _ => run_sized::<T, 12>(model, signals, p, sink),
    }
}

/// The environment at sample `k`, in the measured frame.
pub fn measured_env<T: Real>(signals: &Signals, k: usize) -> Env<T> {
    Env {
        t: signals.t[k],
        omega_e: T::constant(signals.omega_e[k]),
        theta_e: T::constant(signals.theta_e[k]),
        theta_m: T::constant(signals.theta_m[k]),
        heating: signals.heating.as_ref().map_or(0.0, |x| x[k]),
        magnet_heating: signals.magnet_heating.as_ref().map_or(0.0, |x| x[k]),
    }
}

/// The environment behind the measured one, once the sensor's angle error is taken away.
pub fn true_env<T: Real>(sensor: &Sensor<T>, measured: &Env<T>, n_p: f64) -> Env<T> {
    Env {
        theta_e: measured.theta_e - sensor.angle,
        theta_m: measured.theta_m - sensor.angle * (1.0 / n_p),
        omega_e: measured.omega_e * (T::one() - sensor.angle_slope),
        ..*measured
    }
}

fn run_sized<T: Real, const N: usize>(
    model: &Model,
    signals: &Signals,
    p: &[T],
    mut sink: impl FnMut(usize, [T; 2]),
) {
    let (Some(v), Some(_), Some(phases)) = (&signals.v, &signals.i, &signals.phases) else { return };
    let base = Base::new(p);
    let (n_p, sensed) = (signals.n_p, model.has_sensor());
    for segment in &signals.segments {
        let mut measured = measured_env(signals, segment.start);
        let mut sensor = model.sensor(p, &measured);
        let mut env = true_env(&sensor, &measured, n_p);
        let mut state = [T::zero(); N];
        for k in segment.clone() {
            if k == segment.start {
                let abc = [phases[0][k], phases[1][k], phases[2][k]];
                let i = model.true_current(&sensor, abc, measured.theta_e);
                state = model.steady_state(p, &base, i, &env).0;
            }
            let i = model.state_current(p, &base, &state, &env).i;
            sink(k, if sensed { model.measured_current(&sensor, i, measured.theta_e) } else { i });
            if k + 1 == segment.end {
                break;
            }
            let tap = |back: usize| {
                let k = k.saturating_sub(back).max(segment.start);
                [T::constant(v[0][k]), T::constant(v[1][k])]
            };
            let h = signals.t[k + 1] - signals.t[k];
            let mut command = model.command(p, &[tap(0), tap(1), tap(2)], env.omega_e * h);
            let next_measured = measured_env(signals, k + 1);
            let (next_sensor, next_env) = if sensed {
                let (s, c) = sensor.angle.sin_cos();
                command = rotate(command, c, s);
                let next_sensor = model.sensor(p, &next_measured);
                (next_sensor, true_env(&next_sensor, &next_measured, n_p))
            } else {
                (sensor, next_measured)
            };
            let rate = signals.omega_e[k].abs() + signals.context.electrical_rate;
            let pieces = ((h * rate / STEP_LIMIT).ceil() as usize).clamp(1, 64);
            for piece in 0..pieces {
                let at = |c: f64| between(&env, &next_env, (piece as f64 + c) / pieces as f64);
                let envs = [at(0.0), at(0.5), at(1.0)];
                state = rk4::step(h / pieces as f64, &state, |c, s| {
                    model.electrical_rhs(p, &base, s, command, &envs[(2.0 * c) as usize])
                });
            }
            (measured, sensor, env) = (next_measured, next_sensor, next_env);
        }
    }
}

/// Linear interpolation between two environments.
#[inline(always)]
fn between<T: Real>(a: &Env<T>, b: &Env<T>, c: f64) -> Env<T> {
    let mix = |x: T, y: T| x * (1.0 - c) + y * c;
    Env {
        t: a.t + c * (b.t - a.t),
        omega_e: mix(a.omega_e, b.omega_e),
        theta_e: mix(a.theta_e, b.theta_e),
        theta_m: mix(a.theta_m, b.theta_m),
        heating: a.heating + c * (b.heating - a.heating),
        magnet_heating: a.magnet_heating + c * (b.magnet_heating - a.magnet_heating),
    }
}
