//! Motor torque from measured currents.

use super::between::measured;
use crate::base::Base;
use crate::effect::Env;
use crate::effects::ELECTRICAL_STATES;
use crate::model::{Known, Model};
use crate::numerics::real::{Abreast, Carries, Loop, Real, Several};
use crate::numerics::transforms::rotate;
use crate::signals::Signals;
use crate::simulate::environment::{measured_env, true_env};
use std::ops::Range;

/// Samples taken together at most.
const LANES: usize = 8;

/// Motor torque at every sample from the measured currents (or as recorded), N·m.
pub fn torque<T: Real>(model: &Model, signals: &Signals, p: &[T]) -> Vec<T> {
    torque_with(model, signals, p, None)
}

/// The same; what the `flux` of these currents is may be known.
pub fn torque_with<T: Real>(
    model: &Model,
    signals: &Signals,
    p: &[T],
    flux: Option<&[Vec<f64>; 2]>,
) -> Vec<T> {
    if let Some(tau) = &signals.tau_e {
        return tau.iter().map(|x| T::constant(*x)).collect();
    }
    match Motor::new(model, signals, p, flux) {
        Some(motor) => {
            let [torque] = motor.follow();
            torque
        }
        None => vec![T::zero(); signals.len()],
    }
}

/// Flux linkage (d, q) of the measured currents at every sample, V s: where it must be iterated for and follows from the currents alone,
/// so that it is worth knowing.
pub fn flux(model: &Model, signals: &Signals, p: &[f64]) -> Option<[Vec<f64>; 2]> {
    if signals.tau_e.is_some() || !model.is_magnetic() || model.is_bypassed() {
        return None;
    }
    let [_, d, q] = Motor::new(model, signals, p, None)?.follow();
    Some([d, q])
}

#[derive(Clone, Copy)]
struct Motor<'a, T> {
    model: &'a Model,
    signals: &'a Signals,
    phases: &'a [Vec<f64>; 3],
    i: &'a [Vec<f64>; 2],
    p: &'a [T],
    flux: Option<&'a [Vec<f64>; 2]>,
}

impl<'a, T: Real> Motor<'a, T> {
    fn new(
        model: &'a Model,
        signals: &'a Signals,
        p: &'a [T],
        flux: Option<&'a [Vec<f64>; 2]>,
    ) -> Option<Self> {
        let (phases, i) = match &signals.within {
            Some(within) => (&within.phases, &within.i),
            None => (signals.phases.as_ref()?, signals.i.as_ref()?),
        };
        Some(Self { model, signals, phases, i, p, flux })
    }

    /// Its torque, and the flux linkage of d and q after it where more is asked for.
    fn follow<const K: usize>(self) -> [Vec<T>; K] {
        // Temperatures run on from sample to sample.
        let apart = !self.model.warms() && self.signals.len() >= LANES;
        let together = apart.then(|| T::abreast(Torque::<T, K>(self))).flatten();
        together.unwrap_or_else(|| T::fastest(Torque::<T, K>(self)))
    }

    /// Voltage (d, q) around sample `k` of a segment, V, where the torque depends on it: what bypasses the winding follows the voltage, also
    /// while the current changes.
    #[inline(always)]
    fn voltage(&self, segment: &Range<usize>, k: usize) -> Option<[f64; 2]> {
        if self.model.is_bypassed() || self.signals.stator_held.is_some() {
            mean_voltage(self.signals, segment, k)
        } else {
            None
        }
    }

    /// What a sample says under the `measured` environment, with the temperatures of `state`, which becomes that of the sample.
    #[inline(always)]
    fn at<W: Real>(
        &self,
        (p, base): (&[W], &Base<W>),
        Logged { phases, mut i, mut v, flux, measured }: Logged<W>,
        state: &mut [W],
    ) -> Point<W> {
        let (model, signals) = (self.model, self.signals);
        let mut env = measured;
        if model.has_sensor() {
            let sensor = model.sensor(p, &measured);
            env = true_env(&sensor, &measured, signals.n_p);
            i = model.true_current(&sensor, phases, measured.theta_e);
            let (s, c) = sensor.angle.sin_cos();
            if let Some(command) = v {
                v = Some(rotate(command, c, s));
            }
        }
        if let (true, Some(v)) = (signals.stator_held.is_some(), v) {
            let ripple = ripple(v, env.omega_e, signals.held_period(), base);
            i = [i[0] + ripple[0], i[1] + ripple[1]];
        }
        let mut emf = None;
        if let (true, Some(v)) = (model.is_bypassed(), v) {
            emf = Some([v[0] - base.r_s * i[0], v[1] - base.r_s * i[1]]);
        }
        let tau_e = model.state_under(p, base, i, Known { emf, flux }, state, &env);
        Point { shown: [tau_e, state[0], state[1]], i, env }
    }
}

/// What the log shows of a sample.
struct Logged<T> {
    /// Phase currents, A.
    phases: [T; 3],
    /// Current (d, q), A.
    i: [T; 2],
    /// Voltage around it (d, q), V, where it matters.
    v: Option<[T; 2]>,
    /// Flux linkage (d, q), V s, if it is known.
    flux: Option<[T; 2]>,
    measured: Env<T>,
}

/// A sample behind the sensors.
struct Point<T> {
    /// Motor torque, N·m, and flux linkage (d, q), V s.
    shown: [T; 3],
    i: [T; 2],
    env: Env<T>,
}

/// The first `K` of what is shown under the measured currents.
struct Torque<'a, T, const K: usize>(Motor<'a, T>);

impl<T: Real, const K: usize> Loop<T> for Torque<'_, T, K> {
    type Output = [Vec<T>; K];
    #[inline(always)]
    fn run<W: Carries<T>>(self) -> [Vec<T>; K] {
        let Motor { model, signals, phases, i, p, flux } = self.0;
        let p: Vec<W> = p.iter().map(|x| W::carry(*x)).collect();
        let base = Base::new(&p);
        let warms = model.warms();
        let mut out = [(); K].map(|()| vec![T::zero(); signals.len()]);
        let mut state = [W::zero(); ELECTRICAL_STATES];
        for segment in &signals.segments {
            for k in segment.clone() {
                let logged = Logged {
                    phases: [0, 1, 2].map(|x: usize| W::constant(phases[x][k])),
                    i: [0, 1].map(|axis: usize| W::constant(i[axis][k])),
                    v: self.0.voltage(segment, k).map(|v| v.map(W::constant)),
                    flux: flux.map(|flux| [0, 1].map(|axis: usize| W::constant(flux[axis][k]))),
                    measured: measured_env(signals, k),
                };
                let Point { shown, i, env } = self.0.at((&p, &base), logged, &mut state);
                for (out, shown) in out.iter_mut().zip(shown) {
                    out[k] = shown.give();
                }
                if warms && k + 1 < segment.end {
                    model.warm(&p, &base, &mut state, i, signals.t[k + 1] - signals.t[k], &env);
                }
            }
        }
        out
    }
}

impl<T: Real, const K: usize> Abreast<T> for Torque<'_, T, K> {
    type Output = [Vec<T>; K];
    const FEWEST: usize = 0;
    #[inline(always)]
    fn run<W: Several<T>>(self) -> [Vec<T>; K] {
        let Motor { signals, phases, i, p, flux, .. } = self.0;
        let p: Vec<W> = p.iter().map(|x| W::all(*x)).collect();
        let base = Base::new(&p);
        let n = signals.len();
        let mut out = [(); K].map(|()| vec![T::zero(); n]);
        let (mut state, mut lanes) = ([W::zero(); ELECTRICAL_STATES], [T::zero(); LANES]);
        for segment in &signals.segments {
            let mut k = segment.start;
            while k < segment.end {
                // The last ones reach back, and those of a short segment beyond it.
                let from = k.min(n - W::COUNT);
                let mut command = [[0.0; LANES]; 2];
                let mut v = None;
                for lane in 0..W::COUNT {
                    if let Some([d, q]) = self.0.voltage(segment, from + lane) {
                        (command[0][lane], command[1][lane]) = (d, q);
                        v = Some([W::zero(); 2]);
                    }
                }
                if let Some(v) = &mut v {
                    *v = [W::plain(&command[0]), W::plain(&command[1])];
                }
                let logged = Logged {
                    phases: [
                        W::plain(&phases[0][from..]),
                        W::plain(&phases[1][from..]),
                        W::plain(&phases[2][from..]),
                    ],
                    i: [W::plain(&i[0][from..]), W::plain(&i[1][from..])],
                    v,
                    flux: flux.map(|[d, q]| [W::plain(&d[from..]), W::plain(&q[from..])]),
                    measured: measured(signals, from),
                };
                let end = segment.end.min(from + W::COUNT);
                let shown = self.0.at((&p, &base), logged, &mut state).shown;
                for (out, shown) in out.iter_mut().zip(shown) {
                    shown.put(&mut lanes);
                    out[k..end].copy_from_slice(&lanes[k - from..end - from]);
                }
                k = end;
            }
        }
        out
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
