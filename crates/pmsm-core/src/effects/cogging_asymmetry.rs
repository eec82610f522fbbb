//! Cogging of magnets and teeth that are not all alike. Each magnet then meets the slots with a torque of its own, and each tooth the poles:
//! τ = a_s·cos(Q θ_m) + b_s·sin(Q θ_m) + a_p·cos(2 n_p θ_m) + b_p·sin(2 n_p θ_m), with Q slots and 2 n_p poles.
//!
//! Where all are alike these orders cancel, and the least common multiple of both is left, which is `cogging_torque`. Three phases have a
//! multiple of three slots. Source: Gašparin, Černigoj, Markič & Fišer, IEEE Trans. Magnetics 45 (2009) 1210.

use crate::effect::{Context, Derived, Effect, Info, Mechanical, Need, Output, Parameter, Role, Rotor, Site};
use crate::base::Base;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct CoggingAsymmetry;

/// Fewest and most slots that are tried.
const SLOTS: (u32, u32) = (6, 96);

impl Effect for CoggingAsymmetry {
    const INFO: Info = Info {
        id: "cogging_asymmetry",
        title: "Cogging of unequal magnets or teeth",
        sentence: "Magnets or teeth differ: the rotor cogs once per slot and once per pole, beside the order of a perfect machine.",
        equation: "τ = τ_s·cos(Q θ_m + φ_s) + τ_p·cos(2n_p θ_m + φ_p)",
        source: "Gašparin et al., IEEE Trans. Magnetics 45 (2009) 1210",
        fingerprint: "Lines at the number of slots and at that of the poles per mechanical revolution, independent of current and speed",
        look_alikes: &["cogging_torque", "load_torque_pulsation", "back_emf_harmonics"],
        contains: &[],
        site: Site::Mechanical,
        needs: &[Need::Angle, Need::Transients],
        parameters: &[
            Parameter::torque("a_s", "cosine part at the number of slots"),
            Parameter::torque("b_s", "sine part at the number of slots"),
            Parameter::torque("a_p", "cosine part at the number of poles"),
            Parameter::torque("b_p", "sine part at the number of poles"),
            Parameter {
                name: "order_slots",
                unit: "1",
                meaning: "slots per mechanical revolution",
                role: Role::Fixed,
                low: &|_| SLOTS.0 as f64,
                high: &|_| SLOTS.1 as f64,
                typical: &|_| 12.0,
            },
        ],
    };
    const DERIVED: &'static [Derived] = &[
        ("tau_slots", "N m", "amplitude at the number of slots"),
        ("tau_poles", "N m", "amplitude at the number of poles"),
    ];

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        // It must stay below half the sampling frequency at a good part of the speeds.
        let highest = 0.5 / cx.period / (0.25 * cx.omega_m_max() / std::f64::consts::TAU);
        (SLOTS.0..=SLOTS.1)
            .step_by(3)
            .map(f64::from)
            // Slots that are a multiple of the poles are the order of a perfect machine.
            .filter(|slots| slots % (2.0 * cx.n_p) != 0.0)
            .filter(|slots| *slots <= f64::from(SLOTS.0) || *slots < highest)
            .map(|slots| vec![0.0, 0.0, 0.0, 0.0, slots])
            .collect()
    }

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], _: &[T], at: &Mechanical<T>, cx: &Context, out: &mut Rotor<T>) {
        let (s, c) = (at.env.theta_m * p[4]).sin_cos();
        let (s_p, c_p) = (at.env.theta_m * (2.0 * cx.n_p)).sin_cos();
        out.loss += p[0] * c + p[1] * s + p[2] * c_p + p[3] * s_p;
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![
            ("tau_slots", "N m", (p[0].squared() + p[1].squared()).sqrt()),
            ("tau_poles", "N m", (p[2].squared() + p[3].squared()).sqrt()),
            ("order_slots", "1", p[4]),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, close, fourier, loss, shaft};

    #[test]
    fn lines_stand_at_the_slots_and_at_the_poles_and_do_no_work() {
        let p = [0.1, -0.2, 0.03, 0.04, 27.0];
        let poles = (2.0 * CX.n_p) as u32;
        let torque = |theta: f64| loss::<CoggingAsymmetry>(&p, &shaft(theta, 5.0, 3.0));
        for (order, a, b) in [(0, 0.0, 0.0), (27, 0.1, -0.2), (poles, 0.03, 0.04), (54, 0.0, 0.0)] {
            let line = fourier(order, torque);
            close(line.0, a, 1e-12);
            close(line.1, b, 1e-12);
        }
    }

    #[test]
    fn every_tried_number_of_slots_suits_three_phases_and_is_no_multiple_of_the_poles() {
        let probes = CoggingAsymmetry::probes(&CX);
        assert!(!probes.is_empty());
        assert!(probes.iter().all(|p| p[4] % 3.0 == 0.0 && p[4] % (2.0 * CX.n_p) != 0.0));
    }
}
