//! Motor torque from measured currents.

use crate::base::Base;
use crate::model::Model;
use crate::real::{Carries, Loop, Real};
use crate::signals::Signals;
use crate::simulate::electrical::{measured_env, true_env};
use crate::transforms::rotate;
use std::ops::Range;

/// Motor torque at every sample from the measured currents (or as recorded), N·m.
pub fn torque<T: Real>(model: &Model, signals: &Signals, p: &[T]) -> Vec<T> {
    if let Some(tau) = &signals.tau_e {
        return tau.iter().map(|x| T::constant(*x)).collect();
    }
    match model.electrical_states() {
        0 => T::fastest(Torque::<T, 2> { model, signals, p }),
        1..=2 => T::fastest(Torque::<T, 4> { model, signals, p }),
        _ => T::fastest(Torque::<T, 12> { model, signals, p }),
    }
}

/// Motor torque from the measured currents, with `N` electrical states.
struct Torque<'a, T, const N: usize> {
    model: &'a Model,
    signals: &'a Signals,
    p: &'a [T],
}

impl<T: Real, const N: usize> Loop<T> for Torque<'_, T, N> {
    type Output = Vec<T>;
    #[inline(always)]
    fn run<W: Carries<T>>(self) -> Vec<T> {
        let (model, signals) = (self.model, self.signals);
        let mut torque = vec![T::zero(); signals.len()];
        let (Some(phases), Some(i)) = (&signals.phases, &signals.i) else { return torque };
        let p: Vec<W> = self.p.iter().map(|x| W::carry(*x)).collect();
        let base = Base::new(&p);
        let (sensed, thermal) = (model.has_sensor(), model.is_thermal());
        let held = signals.held_period();
        let mut warm = [W::zero(); N];
        for segment in &signals.segments {
            for k in segment.clone() {
                let mut env = measured_env(signals, k);
                let mut i = [W::constant(i[0][k]), W::constant(i[1][k])];
                // What bypasses the winding follows the voltage, also while the current changes.
                let mut v = mean_voltage(signals, segment, k).map(|v| v.map(W::constant));
                v = v.filter(|_| N > 2 || signals.stator_held);
                if sensed {
                    let (sensor, theta) = (model.sensor(&p, &env), env.theta_e);
                    env = true_env(&sensor, &env, signals.n_p);
                    i = model.true_current(&sensor, [phases[0][k], phases[1][k], phases[2][k]], theta);
                    let (s, c) = sensor.angle.sin_cos();
                    v = v.map(|v| rotate(v, c, s));
                }
                if let (true, Some(v)) = (signals.stator_held, v) {
                    let ripple = ripple(v, env.omega_e, held, &base);
                    i = [i[0] + ripple[0], i[1] + ripple[1]];
                }
                let emf = v.filter(|_| N > 2).map(|v| [v[0] - base.r_s * i[0], v[1] - base.r_s * i[1]]);
                torque[k] = model.state_under(&p, &base, i, emf, &warm, &env).1.give();
                if thermal && k + 1 < segment.end {
                    model.warm(&p, &base, &mut warm, i, signals.t[k + 1] - signals.t[k], &env);
                }
            }
        }
        torque
    }
}

/// By how much the mean current (d, q) of an interval `held` (s) lies above what the samples at its ends say, A, if the mean voltage `v`
/// (d, q), V, is held in the stator's frame meanwhile: seen from the rotor it turns back by ω_e·t about its middle, and the inductances
/// integrate that, Δi = ω_e·h²/12·(−v_q/l_d, v_d/l_q) to first order in ω_e·h.
#[inline(always)]
fn ripple<T: Real>(v: [T; 2], omega_e: T, held: f64, base: &Base<T>) -> [T; 2] {
    let moment = omega_e * (held * held / 12.0);
    [-(moment * v[1] * base.inverse_l_d), moment * v[0] * base.inverse_l_q]
}

/// Voltage command (d, q) around sample `k` of a segment, V: the mean of the intervals before and after it.
fn mean_voltage(signals: &Signals, segment: &Range<usize>, k: usize) -> Option<[f64; 2]> {
    let v = signals.v.as_ref()?;
    let before = k.saturating_sub(1).max(segment.start);
    let here = k.min(segment.end.saturating_sub(2)).max(segment.start);
    Some([0, 1].map(|axis| 0.5 * (v[axis][before] + v[axis][here])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voltage_held_in_the_stator_moves_the_mean_current() {
        let (h, omega, v) = (1e-4, 1300.0, [-40.0, 190.0]);
        let base = Base::new(&[0.0, 2e-4, 5e-4, 0.07, 0.06, 0.01]);
        // l di/dt is what the turning voltage has beyond its mean.
        const STEPS: usize = 1000;
        let step = h / STEPS as f64;
        let (mut i, mut mean) = ([0.0; 2], [0.0; 2]);
        for k in 0..STEPS {
            let (s, c) = Real::sin_cos(omega * ((k as f64 + 0.5) * step - 0.5 * h));
            let turned = [v[0] * c + v[1] * s, v[1] * c - v[0] * s];
            for (x, inverse) in [base.inverse_l_d, base.inverse_l_q].into_iter().enumerate() {
                let slope = (turned[x] - v[x]) * inverse;
                mean[x] += (i[x] + 0.5 * slope * step) / STEPS as f64;
                i[x] += slope * step;
            }
        }
        let found = ripple(v, omega, h, &base);
        for x in 0..2 {
            // What is left is of second order: the ends of the interval, too, lie higher or lower by now.
            let expected = mean[x] - 0.5 * i[x];
            assert!((found[x] / expected - 1.0).abs() < 0.01, "{x}: {found:?} {expected}");
        }
    }
}
