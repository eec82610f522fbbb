//! Gain errors between the phase-current sensors: i_x,measured = g_x·i_x with Σ(g_x − 1) = 0. A common gain error cannot be told
//! from a scaled machine and is left out.
//!
//! Source: Chung & Sul, IEEE Trans. Industry Applications 34 (1998) 1122.

use crate::effect::{Context, Effect, Env, Info, Need, Output, Parameter, Role, Sensor, Site};
use crate::base::Base;
use crate::real::Real;
use crate::transforms::inverse_clarke;

/// See the module's documentation.
pub struct CurrentGainImbalance;

const fn part(name: &'static str, meaning: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "1",
        meaning,
        role: Role::Amplitude,
        low: |_| -0.3,
        high: |_| 0.3,
        typical: |_| 0.01,
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
            part("g_alpha", "gain error along phase a's axis"),
            part("g_beta", "gain error across phase a's axis"),
        ],
    };

    #[inline(always)]
    fn sensor<T: Real>(p: &[T], _: &Env<T>, _: &Context, out: &mut Sensor<T>) {
        let error = inverse_clarke([p[0], p[1]]);
        for x in 0..3 {
            out.gain[x] += error[x];
        }
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        let [a, b, c] = inverse_clarke([p[0], p[1]]).map(|g| g + 1.0);
        vec![("g_a", "1", a), ("g_b", "1", b), ("g_c", "1", c)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, base, close, fourier};
    use crate::model::Model;

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
    fn gains_have_no_common_part_and_phase_a_reads_the_alpha_part() {
        let out = CurrentGainImbalance::outputs(&[0.02, -0.01], &base(), &CX);
        close(out[0].2, 1.02, 1e-15);
        close(out.iter().map(|x| x.2).sum::<f64>(), 3.0, 1e-15);
    }
}
