//! Gain errors between the phase-current sensors: i_x,measured = g_x·i_x with Σ(g_x − 1) = 0. A common gain error of three
//! cannot be told from a scaled machine and is left out. Of two sensors the third current is what they leave, so that their
//! difference turns the measured vector, too, and what they have in common is fitted where a known load tells it.
//!
//! Source: Chung & Sul, IEEE Trans. Industry Applications 34 (1998) 1122.

use crate::effect::{Context, Derived, Effect, Env, Info, Need, Output, Parameter, Role, Sensor, Site};
use crate::base::Base;
use crate::numerics::real::Real;
use crate::numerics::transforms::{SQRT3, inverse_clarke};

/// See the module's documentation.
pub struct CurrentGainImbalance;

const fn part(name: &'static str, meaning: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "1",
        meaning,
        role: Role::Amplitude,
        low: &|_| -0.3,
        high: &|_| 0.3,
        typical: &|_| 0.01,
    }
}

impl Effect for CurrentGainImbalance {
    const INFO: Info = Info {
        id: "current_gain_imbalance",
        title: "Current-sensor gain imbalance",
        sentence: "The phase-current sensors disagree in gain: the measurement is wrong, not the motor.",
        equation: "i_x,measured = g_x·i_x",
        source: "Chung & Sul, IEEE Trans. Industry Applications 34 (1998) 1122",
        fingerprint: "2nd electrical order in both measured currents in proportion to the current",
        look_alikes: &["phase_resistance_imbalance", "inter_turn_short", "current_offset"],
        contains: &[],
        site: Site::Sensor,
        needs: &[Need::Angle, Need::Transients, Need::Current],
        parameters: &[
            part("g_alpha", "gain error along phase a's axis; of two sensors what they have in common"),
            part("g_beta", "gain error across phase a's axis; of two sensors their difference over √3"),
        ],
    };
    const DERIVED: &'static [Derived] = &[
        ("g_a", "1", "gain of the sensor of phase a, measured over true current"),
        ("g_b", "1", "gain of the sensor of phase b, measured over true current"),
        ("g_c", "1", "gain of the sensor of phase c, measured over true current"),
    ];

    fn fitted(cx: &Context, index: usize) -> bool {
        // What two sensors have in common shows only in a torque that is known otherwise.
        index == 1 || cx.completed_phase.is_none() || cx.load_known
    }

    #[inline(always)]
    fn sensor<T: Real>(p: &[T], _: &Env<T>, cx: &Context, out: &mut Sensor<T>) {
        let error = errors(p, cx);
        for x in 0..3 {
            out.gain[x] += error[x];
        }
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, cx: &Context) -> Vec<Output<T>> {
        let [a, b, c] = errors(p, cx).map(|g| g + 1.0);
        vec![("g_a", "1", a), ("g_b", "1", b), ("g_c", "1", c)]
    }
}

/// Gain errors of the three phases; none of a phase that has no sensor.
#[inline(always)]
fn errors<T: Real>(p: &[T], cx: &Context) -> [T; 3] {
    match cx.completed_phase {
        None => inverse_clarke([p[0], p[1]]),
        Some(missing) => {
            let difference = p[1] * (0.5 * SQRT3);
            let common = if cx.load_known { p[0] } else { T::zero() };
            let mut error = [T::zero(), common + difference, common - difference];
            error.rotate_right(missing);
            error
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, base, close, fourier};
    use crate::model::Model;
    use crate::numerics::transforms::inverse_park;

    #[test]
    fn a_current_is_seen_with_a_second_order_of_half_the_gain_error_and_no_mean() {
        let model = Model::new(CX, &[EffectId::CurrentGainImbalance]);
        let p = [&crate::effects::testing::MACHINE[..], &[0.03, 0.04]].concat();
        let error = |theta: f64, axis: usize| {
            let sensor = model.sensor(&p, &crate::effects::testing::env(theta, 0.0));
            model.measured_current(&sensor, [0.0, 8.0], theta)[axis] - [0.0, 8.0][axis]
        };
        for axis in 0..2 {
            close(fourier(0, |theta| error(theta, axis)).0, 0.0, 1e-12);
            let (a, b) = fourier(2, |theta| error(theta, axis));
            close(a.hypot(b), 0.5 * 0.05 * 8.0, 1e-12);
        }
    }

    #[test]
    fn two_sensors_that_disagree_turn_the_measured_vector() {
        for missing in 0..3 {
            let cx = Context { completed_phase: Some(missing), ..CX };
            let model = Model::new(cx, &[EffectId::CurrentGainImbalance]);
            let p = [&crate::effects::testing::MACHINE[..], &[0.0, 0.04]].concat();
            let gains: Vec<f64> =
                CurrentGainImbalance::outputs(&p[6..], &base(), &cx).iter().map(|x| x.2).collect();
            close(gains[missing], 1.0, 1e-15);
            let (next, last) = (gains[(missing + 1) % 3], gains[(missing + 2) % 3]);
            close(next - last, 0.04 * 3f64.sqrt(), 1e-15);
            let sensor = model.sensor(&p, &crate::effects::testing::env(0.7, 0.0));
            let seen = |theta: f64, axis: usize| model.measured_current(&sensor, [0.0, 8.0], theta)[axis];
            // Forward by half the difference over √3 where the phase that follows has the larger gain.
            close(fourier(0, |theta| seen(theta, 0)).0, -8.0 * 0.5 * (next - last) / 3f64.sqrt(), 1e-12);
            close(fourier(0, |theta| seen(theta, 1)).0, 8.0, 1e-12);
            // What was logged leads back to the truth.
            let abc = inverse_park([seen(0.7, 0), seen(0.7, 1)], 0.7f64.cos(), 0.7f64.sin());
            let back = model.true_current(&sensor, abc, 0.7);
            close(back[0], 0.0, 1e-12);
            close(back[1], 8.0, 1e-12);
        }
    }

    #[test]
    fn gains_have_no_common_part_and_phase_a_reads_the_alpha_part() {
        let out = CurrentGainImbalance::outputs(&[0.02, -0.01], &base(), &CX);
        close(out[0].2, 1.02, 1e-15);
        close(out.iter().map(|x| x.2).sum::<f64>(), 3.0, 1e-15);
    }
}
