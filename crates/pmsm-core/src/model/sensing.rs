//! What a log shows of the true currents, and back.

use super::Model;
use crate::effect::{Env, Sensor};
use crate::numerics::real::Real;
use crate::numerics::transforms::{inverse_park, park};

impl Model {
    /// What the sensors do at the measured angle of `env`.
    #[inline(always)]
    pub fn sensor<T: Real>(&self, p: &[T], env: &Env<T>) -> Sensor<T> {
        let mut sensor =
            Sensor { gain: [T::one(); 3], offset: [T::zero(); 3], angle: T::zero(), angle_slope: T::zero() };
        for s in &self.slots {
            s.effect.sensor(&p[s.parameters.clone()], env, &self.context, &mut sensor);
        }
        if let Some(map) = self.map.as_ref().filter(|_| self.has_sensor) {
            let [angle, slope] = map.angle(&p[self.mapped.clone()], env, self.context.n_p);
            sensor.angle += angle;
            sensor.angle_slope += slope;
        }
        sensor
    }

    /// What the log shows for the true rotor-frame current `i`: `env` and the result are in the measured frame.
    #[inline(always)]
    pub fn measured_current<T: Real>(&self, sensor: &Sensor<T>, i: [T; 2], theta_measured: T) -> [T; 2] {
        let (s, c) = (theta_measured - sensor.angle).sin_cos();
        let mut abc = inverse_park(i, c, s);
        for x in 0..3 {
            abc[x] = abc[x] * sensor.gain[x] + sensor.offset[x];
        }
        self.complete(&mut abc);
        let (s, c) = theta_measured.sin_cos();
        park(abc, c, s)
    }

    /// The true rotor-frame current behind logged phase currents: the inverse of [`Model::measured_current`].
    #[inline(always)]
    pub fn true_current<T: Real>(&self, sensor: &Sensor<T>, abc: [T; 3], theta_measured: T) -> [T; 2] {
        let mut truth = [T::zero(); 3];
        for x in 0..3 {
            truth[x] = (abc[x] - sensor.offset[x]) / sensor.gain[x];
        }
        self.complete(&mut truth);
        let (s, c) = (theta_measured - sensor.angle).sin_cos();
        park(truth, c, s)
    }

    /// The current of a phase that has no sensor is what the others leave.
    #[inline(always)]
    fn complete<T: Real>(&self, abc: &mut [T; 3]) {
        if let Some(x) = self.context.completed_phase {
            abc[x] = -(abc[(x + 1) % 3] + abc[(x + 2) % 3]);
        }
    }
}
