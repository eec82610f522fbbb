//! Offset of the phase-current sensors: i_x,measured = i_x + o_x. In the rotor frame the offset turns backwards once per
//! electrical revolution. What the three have in common never reaches the rotor frame; it is read from i_a + i_b + i_c.
//!
//! Source: Chung & Sul, IEEE Trans. Industry Applications 34 (1998) 1122.

use crate::effect::{Context, Derived, Effect, Env, Info, Need, Output, Parameter, Role, Sensor, Site};
use crate::base::Base;
use crate::numerics::real::Real;
use crate::numerics::transforms::inverse_clarke;

/// See the module's documentation.
pub struct CurrentOffset;

const fn part(name: &'static str, meaning: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "A",
        meaning,
        role: Role::Amplitude,
        low: &|cx| -0.3 * cx.i_max,
        high: &|cx| 0.3 * cx.i_max,
        typical: &|cx| 0.005 * cx.i_max,
    }
}

impl Effect for CurrentOffset {
    const INFO: Info = Info {
        id: "current_offset",
        title: "Current-sensor offset",
        sentence: "A phase-current sensor shows a constant offset: the measurement is wrong, not the motor.",
        equation: "i_x,measured = i_x + o_x",
        source: "Chung & Sul, IEEE Trans. Industry Applications 34 (1998) 1122",
        fingerprint: "1st electrical order in both measured currents, the same at any current and speed",
        look_alikes: &["current_gain_imbalance", "encoder_eccentricity"],
        contains: &[],
        site: Site::Sensor,
        needs: &[Need::Angle, Need::Transients, Need::Current],
        parameters: &[
            part("o_alpha", "offset along phase a's axis"),
            part("o_beta", "offset across phase a's axis"),
        ],
    };
    const DERIVED: &'static [Derived] = &[
        ("o_a", "A", "offset of the sensor of phase a, measured minus true"),
        ("o_b", "A", "offset of the sensor of phase b, measured minus true"),
        ("o_c", "A", "offset of the sensor of phase c, measured minus true"),
    ];

    #[inline(always)]
    fn sensor<T: Real>(p: &[T], _: &Env<T>, _: &Context, out: &mut Sensor<T>) {
        let offset = inverse_clarke([p[0], p[1]]);
        for x in 0..3 {
            out.offset[x] += offset[x];
        }
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, cx: &Context) -> Vec<Output<T>> {
        let [a, b, c] = inverse_clarke([p[0], p[1]]).map(|o| o + cx.zero_sequence);
        vec![("o_a", "A", a), ("o_b", "A", b), ("o_c", "A", c)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, base, close, env};
    use crate::model::Model;
    use crate::numerics::transforms::{inverse_park, park};

    #[test]
    fn the_log_shows_the_phase_currents_shifted() {
        let model = Model::new(CX, &[EffectId::CurrentOffset]);
        let p = [&MACHINE[..], &[0.1, -0.2]].concat();
        let common = 0.05;
        let o = CurrentOffset::outputs(&p[6..], &base(), &Context { zero_sequence: common, ..CX });
        for theta in [0.0, 0.9, 4.0] {
            let (s, c): (f64, f64) = f64::sin_cos(theta);
            let true_phases = inverse_park([-2.0, 7.0], c, s);
            let shown = park([0, 1, 2].map(|x| true_phases[x] + o[x].2), c, s);
            let sensor = model.sensor(&p, &env(theta, 0.0));
            let got = model.measured_current(&sensor, [-2.0, 7.0], theta);
            close(got[0], shown[0], 1e-14);
            close(got[1], shown[1], 1e-14);
        }
        close(o.iter().map(|x| x.2).sum::<f64>(), 3.0 * common, 1e-14);
    }
}
