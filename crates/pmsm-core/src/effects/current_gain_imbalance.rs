//! Gain errors between the phase-current sensors: i_x,measured = g_x·i_x with Σ(g_x − 1) = 0. A common gain error cannot be told
//! from a scaled machine and is left out.
//!
//! Source: Chung & Sul, IEEE Trans. Industry Applications 34 (1998) 1122.

use crate::effect::{Context, Effect, Env, Info, Need, Output, Parameter, Role, Sensor, Site};
use crate::model::Base;
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
        needs: &[Need::Angle, Need::Transients],
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
