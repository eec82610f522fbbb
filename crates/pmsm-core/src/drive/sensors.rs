//! The sensors of the drive: phase currents with gain, offset, noise and steps; an encoder with counts; a speed.
//!
//! Every noise has a place of its own among the random numbers, so that it stays the same whatever else is switched on.

use super::control::Measured;
use super::settings::{Sensors, SpeedSensor};
use crate::effect::Env;
use crate::model::Model;
use crate::numerics::random::normal_pair;
use crate::numerics::real::Real;
use crate::numerics::transforms::{inverse_park, park};
use std::f64::consts::TAU;

/// Angle error of the sensors at one instant, rad, measured minus true, electrical.
pub(super) type AngleError = f64;

/// The sensors with their memory.
#[derive(Debug, Clone)]
pub(super) struct SensorBox<'a> {
    settings: &'a Sensors,
    model: &'a Model,
    p: &'a [f64],
    n_p: f64,
    seed: u64,
    period: f64,
    /// Angle and speed of the phase-locked loop, electrical.
    tracked: Option<[f64; 2]>,
}

impl<'a> SensorBox<'a> {
    pub fn new(settings: &'a Sensors, model: &'a Model, p: &'a [f64], seed: u64, period: f64) -> Self {
        Self { settings, model, p, n_p: model.context().n_p, seed, period, tracked: None }
    }

    /// What is seen at sample `number` where the true current is `i` (d, q, A) and the machine is at `env`.
    pub fn measure(&mut self, number: usize, i: [f64; 2], env: &Env<f64>) -> (Measured, AngleError) {
        let mut seen = *env;
        let mut sensor = self.model.sensor(self.p, &seen);
        if self.model.has_sensor() {
            // The error is a function of the measured angle: a few fixed-point steps, each of which shrinks what is
            // left by the slope of the error.
            for _ in 0..40 {
                let before = seen.theta_e;
                seen.theta_e = env.theta_e + sensor.angle;
                seen.theta_m = env.theta_m + sensor.angle / self.n_p;
                sensor = self.model.sensor(self.p, &seen);
                if seen.theta_e == before {
                    break;
                }
            }
            seen.omega_e = env.omega_e / (1.0 - sensor.angle_slope);
        }
        let s = self.settings;
        let quiet = s.noise_i == 0.0;
        let (noise_a, noise_b) = if quiet { (0.0, 0.0) } else { self.noise(number, 0) };
        let (noise_c, noise_w) =
            if quiet && s.noise_omega_e == 0.0 { (0.0, 0.0) } else { self.noise(number, 1) };
        let (sin, cos) = Real::sin_cos(env.theta_e);
        let mut abc = inverse_park(i, cos, sin);
        for (x, noise) in [noise_a, noise_b, noise_c].into_iter().enumerate() {
            abc[x] = stepped(abc[x] * sensor.gain[x] + sensor.offset[x] + noise * s.noise_i, s.step_i);
        }
        let step = if s.encoder_counts > 0 { TAU / f64::from(s.encoder_counts) } else { 0.0 };
        let theta_m = stepped(seen.theta_m, step);
        let theta_e = seen.theta_e + (theta_m - seen.theta_m) * self.n_p;
        let omega_e = self.speed(theta_e, seen.omega_e) + noise_w * s.noise_omega_e;
        let (sin, cos) = Real::sin_cos(theta_e);
        (Measured { abc, i: park(abc, cos, sin), theta_e, theta_m, omega_e }, sensor.angle)
    }

    /// A measured load torque, N·m.
    pub fn torque(&self, number: usize, tau_load: f64) -> f64 {
        let size = self.settings.noise_tau;
        if size == 0.0 { tau_load } else { tau_load + self.noise(number, 2).0 * size }
    }

    fn noise(&self, number: usize, stream: u32) -> (f64, f64) {
        normal_pair(self.seed, [number as u32, (number as u64 >> 32) as u32, stream, 1])
    }

    /// The speed that the sensor shows: the tachometer's, or that of a critically damped phase-locked loop on the angle.
    fn speed(&mut self, theta_e: f64, omega_e: f64) -> f64 {
        let SpeedSensor::Encoder { bandwidth } = self.settings.speed else { return omega_e };
        let Some([angle, speed]) = self.tracked else {
            self.tracked = Some([theta_e, omega_e]);
            return omega_e;
        };
        let rate = TAU * bandwidth * self.period;
        let ahead = angle + speed * self.period;
        let error = theta_e - ahead;
        let speed = speed + rate * rate * error / self.period;
        self.tracked = Some([ahead + 2.0 * rate * error, speed]);
        speed
    }
}

/// Rounded to whole steps; a step of zero is none.
fn stepped(x: f64, step: f64) -> f64 {
    if step > 0.0 { step * (x / step).round() } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, env};

    fn sensors(settings: &Sensors, effects: &[EffectId], p: &[f64]) -> (Model, Vec<f64>, Sensors) {
        (Model::new(CX, effects), [&MACHINE[..], p].concat(), settings.clone())
    }

    #[test]
    fn ideal_sensors_show_the_truth() {
        let (model, p, s) = sensors(&Sensors::default(), &[], &[]);
        let (seen, error) = SensorBox::new(&s, &model, &p, 1, 1e-4).measure(7, [-2.0, 7.0], &env(1.3, 250.0));
        assert!((seen.i[0] + 2.0).abs() < 1e-14 && (seen.i[1] - 7.0).abs() < 1e-14);
        assert_eq!((seen.theta_e, seen.omega_e, error), (1.3, 250.0, 0.0));
    }

    #[test]
    fn the_model_of_the_sensors_leads_back_to_the_truth() {
        let effects =
            [EffectId::EncoderEccentricity, EffectId::CurrentOffset, EffectId::CurrentGainImbalance];
        let (model, p, s) = sensors(&Sensors::default(), &effects, &[0.1, -0.2, 0.3, -0.1, 0.02, 0.03]);
        let truth = env(2.0, 300.0);
        let (seen, error) = SensorBox::new(&s, &model, &p, 1, 1e-4).measure(0, [-2.0, 7.0], &truth);
        let at = Env { theta_e: seen.theta_e, theta_m: seen.theta_m, omega_e: seen.omega_e, ..truth };
        let sensor = model.sensor(&p, &at);
        let back = crate::simulate::environment::true_env(&sensor, &at, 3.0);
        assert!((back.theta_e - 2.0).abs() < 1e-14 && (back.omega_e - 300.0).abs() < 1e-10);
        assert!((sensor.angle - error).abs() < 1e-15 && error.abs() > 0.01);
        let i = model.true_current(&sensor, seen.abc, seen.theta_e);
        assert!((i[0] + 2.0).abs() < 1e-13 && (i[1] - 7.0).abs() < 1e-13);
    }

    #[test]
    fn noise_and_steps_have_their_sizes() {
        let settings = Sensors { noise_i: 0.1, step_i: 0.05, encoder_counts: 1000, ..Sensors::default() };
        let (model, p, s) = sensors(&settings, &[], &[]);
        let mut sensors = SensorBox::new(&s, &model, &p, 3, 1e-4);
        let n = 20_000;
        let mut square = 0.0;
        for k in 0..n {
            let (seen, _) = sensors.measure(k, [0.0; 2], &env(1.0 + k as f64, 10.0));
            square += seen.abc[1] * seen.abc[1];
            let counts = seen.theta_m / TAU * 1000.0;
            assert!((counts - counts.round()).abs() < 1e-6);
            assert!((seen.theta_e - 1.0 - k as f64).abs() <= 3.0 * TAU / 2000.0 * (1.0 + 1e-9));
        }
        let expected = 0.1f64.powi(2) + 0.05f64.powi(2) / 12.0;
        assert!((square / n as f64 / expected - 1.0).abs() < 0.03);
    }

    #[test]
    fn a_loop_on_the_encoder_finds_speed_and_ramp() {
        let settings = Sensors { speed: SpeedSensor::Encoder { bandwidth: 100.0 }, ..Sensors::default() };
        let (model, p, s) = sensors(&settings, &[], &[]);
        let mut sensors = SensorBox::new(&s, &model, &p, 3, 1e-4);
        let mut seen = 0.0;
        for k in 0..2000 {
            let t = k as f64 * 1e-4;
            let at = env(200.0 * t + 500.0 * t * t, 200.0 + 1000.0 * t);
            seen = sensors.measure(k, [0.0; 2], &at).0.omega_e;
        }
        // A type-2 loop of critical damping lags behind a ramp by 2/ω_b.
        let expected = 200.0 + 1000.0 * (0.1999 - 2.0 / (TAU * 100.0));
        assert!((seen - expected).abs() < 0.2, "{seen} {expected}");
    }
}
