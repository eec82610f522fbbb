//! Cogging: τ_cog(θ_m) = Σ_{k=1,2} a_k·cos(k N θ_m) + b_k·sin(k N θ_m), with or without current.
//!
//! N is the number of cogging periods per revolution, the least common multiple of slots and poles, hence a multiple
//! of the poles. Source: Zhu & Howe, IEEE Trans. Energy Conversion 15 (2000) 407.

use crate::effect::{Context, Derived, Effect, Info, Mechanical, Need, Output, Parameter, Role, Rotor, Site};
use crate::base::Base;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct CoggingTorque;

/// Most cogging periods per revolution, in multiples of the poles, that are tried.
const MOST_PERIODS: u32 = 24;

impl Effect for CoggingTorque {
    const INFO: Info = Info {
        id: "cogging_torque",
        title: "Cogging torque",
        sentence: "The teeth attract the magnets: a torque periodic in the rotor position, with or without current.",
        equation: "τ_cog = τ_1·cos(N θ_m + φ_1) + τ_2·cos(2N θ_m + φ_2)",
        source: "Zhu & Howe, IEEE Trans. Energy Conversion 15 (2000) 407",
        fingerprint: "Lines at N and 2N per mechanical revolution in the speed, independent of current and speed",
        look_alikes: &["cogging_asymmetry", "back_emf_harmonics", "load_torque_pulsation", "inductance_harmonics"],
        contains: &[],
        site: Site::Mechanical,
        needs: &[Need::Angle, Need::Transients],
        parameters: &[
            Parameter::torque("a_1", "cosine part of the fundamental"),
            Parameter::torque("b_1", "sine part of the fundamental"),
            Parameter::torque("a_2", "cosine part of the second harmonic"),
            Parameter::torque("b_2", "sine part of the second harmonic"),
            Parameter {
                name: "order_mech",
                unit: "1",
                meaning: "cogging periods per mechanical revolution",
                role: Role::Fixed,
                low: &|cx| 2.0 * cx.n_p,
                high: &|cx| 2.0 * cx.n_p * f64::from(MOST_PERIODS),
                typical: &|cx| 6.0 * cx.n_p,
            },
        ],
    };
    const DERIVED: &'static [Derived] = &[
        ("tau_cog", "N m", "amplitude at order_mech"),
        ("tau_cog_2", "N m", "amplitude at twice that order"),
    ];

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        // The second harmonic must stay below half the sampling frequency at a good part of the speeds.
        let highest = 0.5 / cx.period / (0.25 * cx.omega_m_max() / std::f64::consts::TAU);
        (1..=MOST_PERIODS)
            .map(|k| 2.0 * cx.n_p * f64::from(k))
            .filter(|order| *order <= 2.0 * cx.n_p || *order < highest)
            .map(|order| vec![0.0, 0.0, 0.0, 0.0, order])
            .collect()
    }

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], _: &[T], at: &Mechanical<T>, _: &Context, out: &mut Rotor<T>) {
        let (s, c) = (at.env.theta_m * p[4]).sin_cos();
        let (s2, c2) = (s * c * 2.0, c.squared() - s.squared());
        out.loss += p[0] * c + p[1] * s + p[2] * c2 + p[3] * s2;
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![
            ("tau_cog", "N m", (p[0].squared() + p[1].squared()).sqrt()),
            ("tau_cog_2", "N m", (p[2].squared() + p[3].squared()).sqrt()),
            ("order_mech", "1", p[4]),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, close, fourier, loss, shaft};

    #[test]
    fn lines_stand_at_n_and_twice_n_per_revolution_and_do_no_work() {
        let p = [0.1, -0.2, 0.03, 0.04, 18.0];
        let torque = |theta: f64| loss::<CoggingTorque>(&p, &shaft(theta, 5.0, 3.0));
        for (order, a, b) in [(0, 0.0, 0.0), (6, 0.0, 0.0), (18, 0.1, -0.2), (36, 0.03, 0.04)] {
            let line = fourier(order, torque);
            close(line.0, a, 1e-12);
            close(line.1, b, 1e-12);
        }
    }

    #[test]
    fn every_tried_order_is_a_multiple_of_the_poles() {
        let slow = Context { period: 1e-3, ..CX };
        for cx in [CX, slow] {
            let probes = CoggingTorque::probes(&cx);
            assert!(!probes.is_empty() && probes.iter().all(|p| p[4] % (2.0 * cx.n_p) == 0.0));
        }
        assert!(CoggingTorque::probes(&slow).len() < CoggingTorque::probes(&CX).len());
    }
}
