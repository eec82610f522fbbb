//! Inductances that vary with rotor angle beyond the saliency. The fourth harmonic of the phase inductances becomes, in the
//! rotor frame,
//!
//! > ΔL(θ) = l_q·[[c, −s], [−s, −c]],  c = a·cos 6θ − b·sin 6θ,  s = a·sin 6θ + b·cos 6θ,
//!
//! taken to first order in the field energy, ΔW = −½·i_0ᵀ·ΔL·i_0 with i_0 the current of the linear machine. Source: Park
//! transform of L_aa = L_0 + L_2 cos 2θ + L_4 cos 4θ; Krause, Analysis of Electric Machinery (2013), chapter 1.

use crate::effect::{Context, Effect, Field, FieldPoint, Info, Need, Output, Parameter, Role, Site};
use crate::base::Base;
use crate::real::Real;

/// See the module's documentation.
pub struct InductanceHarmonics;

const fn part(name: &'static str, meaning: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "1",
        meaning,
        role: Role::Amplitude,
        low: |_| -0.3,
        high: |_| 0.3,
        typical: |_| 0.02,
    }
}

impl Effect for InductanceHarmonics {
    const INFO: Info = Info {
        id: "inductance_harmonics",
        title: "Inductance harmonics",
        sentence: "The inductances vary with the rotor angle beyond the plain saliency: slots show through.",
        equation: "L_aa = L_0 + L_2·cos 2θ + L_4·cos(4θ + φ)",
        source: "Krause, Analysis of Electric Machinery (2013), chapter 1",
        fingerprint: "6th electrical order in both voltages growing with ω·i, and at standstill with di/dt",
        look_alikes: &["back_emf_harmonics", "dead_time"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Angle, Need::Transients, Need::Current],
        parameters: &[part("a", "cosine part, share of l_q"), part("b", "sine part, share of l_q")],
    };
    const MAGNETIC: bool = true;

    #[inline(always)]
    fn field<T: Real>(p: &[T], at: &FieldPoint<T>, base: &Base<T>, _: &Context, out: &mut Field<T>) {
        let (s6, c6) = six_fold(at.sin_cos);
        let (c, s) = ((p[0] * c6 - p[1] * s6) * base.l_q, (p[0] * s6 + p[1] * c6) * base.l_q);
        let (inverse_d, inverse_q) = (base.inverse_l_d, base.inverse_l_q);
        let d = (at.flux[0] - at.magnet[0]) * inverse_d;
        let q = (at.flux[1] - at.magnet[1]) * inverse_q;
        // ΔL·i_0, and its derivative with respect to θ: c' = −6s, s' = 6c.
        let (x, y) = (c * d - s * q, -(s * d) - c * q);
        out.i[0] -= inverse_d * x;
        out.i[1] -= inverse_q * y;
        out.slope += (s * (d * d - q * q) + c * d * q * 2.0) * 3.0;
        out.inverse[0] -= inverse_d * inverse_d * c;
        out.inverse[1] += inverse_d * inverse_q * s;
        out.inverse[2] += inverse_q * inverse_q * c;
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![("l6_rel", "1", (p[0].squared() + p[1].squared()).sqrt())]
    }
}

/// Sine and cosine of six times an angle.
#[inline(always)]
fn six_fold<T: Real>((s, c): (T, T)) -> (T, T) {
    let (s2, c2) = (s * c * 2.0, c * c - s * s);
    let (s4, c4) = (s2 * c2 * 2.0, c2 * c2 - s2 * s2);
    (s4 * c2 + c4 * s2, c4 * c2 - s4 * s2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, base, close, env};
    use crate::model::Model;
    use crate::transforms::{inverse_park, park};
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    proptest! {
        /// Self and mutual inductances L_xy = L_4·cos(4θ + φ + (x+y)·2π/3) of the phases x, y = 0, 1, 2.
        #[test]
        fn flux_is_that_of_the_phase_inductances(
            phi in 0.0..TAU, theta in 0.0..TAU, i in prop::array::uniform2(-8.0..8.0f64),
        ) {
            let share = 1e-5;
            let l_4 = share * MACHINE[2] / 1.5;
            let (s, c) = theta.sin_cos();
            let currents = inverse_park(i, c, s);
            let phases = [0, 1, 2].map(|x: u32| {
                (0..3).map(|y: u32| {
                    l_4 * (4.0 * theta + phi + f64::from(x + y) * TAU / 3.0).cos() * currents[y as usize]
                }).sum::<f64>()
            });
            let extra = park(phases, c, s);
            let flux = [MACHINE[3] + MACHINE[1] * i[0] + extra[0], MACHINE[2] * i[1] + extra[1]];
            let model = Model::new(CX, &[EffectId::InductanceHarmonics]);
            let p = [&MACHINE[..], &[share * phi.cos(), share * phi.sin()]].concat();
            let got = model.state_current(&p, &base(), &flux, &env(theta, 0.0)).i;
            // First order in the share: what is left is its square.
            prop_assert!((got[0] - i[0]).abs() < 100.0 * share * share * 10.0);
            prop_assert!((got[1] - i[1]).abs() < 100.0 * share * share * 10.0);
        }
    }

    #[test]
    fn the_angle_is_taken_six_times() {
        let (s, c) = six_fold(0.3f64.sin_cos());
        close(s, 1.8f64.sin(), 1e-14);
        close(c, 1.8f64.cos(), 1e-14);
    }
}
