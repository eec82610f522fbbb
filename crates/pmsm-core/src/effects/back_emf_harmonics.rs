//! 5th and 7th harmonics of the magnet's flux linkage. In the rotor frame both turn six times per electrical revolution,
//! in opposite senses:
//!
//! > λ_d += ψ_m·(a_7+a_5)·cos 6θ − ψ_m·(b_7+b_5)·sin 6θ,  λ_q += ψ_m·(a_7−a_5)·sin 6θ + ψ_m·(b_7−b_5)·cos 6θ.
//!
//! The nth harmonic induces n times its share of the flux: e_n,rel = n·√(a_n² + b_n²). Source: Park transform of
//! ψ_a = ψ_m Σ_n h_n cos(nθ + φ_n); Krause, Analysis of Electric Machinery, 3rd ed. (2013), chapter 4.

use crate::effect::{Context, Effect, Env, Info, Magnet, Need, Output, Parameter, Role, Site};
use crate::model::Base;
use crate::real::Real;

/// See the module's documentation.
pub struct BackEmfHarmonics;

const fn part(name: &'static str, meaning: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "1",
        meaning,
        role: Role::Amplitude,
        low: |_| -0.1,
        high: |_| 0.1,
        typical: |_| 0.004,
    }
}

impl Effect for BackEmfHarmonics {
    const INFO: Info = Info {
        id: "back_emf_harmonics",
        title: "Back-EMF harmonics",
        sentence: "The back-EMF is not a sine: its 5th and 7th harmonics ripple six times per electrical revolution.",
        equation: "ψ_a = ψ_m·(cos θ + h_5·cos(5θ+φ_5) + h_7·cos(7θ+φ_7))",
        source: "Krause, Analysis of Electric Machinery (2013), chapter 4",
        fingerprint: "6th electrical order in both voltages growing with speed, in the torque growing with current",
        look_alikes: &["inductance_harmonics", "dead_time", "cogging_torque"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Angle, Need::Transients, Need::Motion],
        parameters: &[
            part("a_5", "cosine part of the 5th flux harmonic, share of psi_m"),
            part("b_5", "sine part of the 5th flux harmonic, share of psi_m"),
            part("a_7", "cosine part of the 7th flux harmonic, share of psi_m"),
            part("b_7", "sine part of the 7th flux harmonic, share of psi_m"),
        ],
    };

    #[inline(always)]
    fn magnet<T: Real>(p: &[T], psi_m: T, env: &Env<T>, _: &Context, out: &mut Magnet<T>) {
        let (s, c) = (env.theta_e * 6.0).sin_cos();
        let (sum, difference) = ([p[2] + p[0], p[3] + p[1]], [p[2] - p[0], p[3] - p[1]]);
        out.flux[0] += psi_m * (sum[0] * c - sum[1] * s);
        out.flux[1] += psi_m * (difference[0] * s + difference[1] * c);
        out.slope[0] -= psi_m * (sum[0] * s + sum[1] * c) * 6.0;
        out.slope[1] += psi_m * (difference[0] * c - difference[1] * s) * 6.0;
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![
            ("e5_rel", "1", (p[0].squared() + p[1].squared()).sqrt() * 5.0),
            ("e7_rel", "1", (p[2].squared() + p[3].squared()).sqrt() * 7.0),
        ]
    }
}
