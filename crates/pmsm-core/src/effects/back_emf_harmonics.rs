//! 5th and 7th harmonics of the magnet's flux linkage. In the rotor frame both turn six times per electrical revolution,
//! in opposite senses:
//!
//! > λ_d += ψ_m·(a_7+a_5)·cos 6θ − ψ_m·(b_7+b_5)·sin 6θ,  λ_q += ψ_m·(a_7−a_5)·sin 6θ + ψ_m·(b_7−b_5)·cos 6θ.
//!
//! The nth harmonic induces n times its share of the flux: e_n,rel = n·√(a_n² + b_n²). Source: Park transform of
//! ψ_a = ψ_m Σ_n h_n cos(nθ + φ_n); Krause, Analysis of Electric Machinery, 3rd ed. (2013), chapter 4.

use crate::effect::{Context, Derived, Effect, Env, Info, Magnet, Need, Output, Parameter, Role, Site};
use crate::base::Base;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct BackEmfHarmonics;

const fn part(name: &'static str, meaning: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "1",
        meaning,
        role: Role::Amplitude,
        low: &|_| -0.1,
        high: &|_| 0.1,
        typical: &|_| 0.004,
    }
}

impl Effect for BackEmfHarmonics {
    const GENERAL: bool = true;
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
    const DERIVED: &'static [Derived] = &[
        ("e5_rel", "1", "5th harmonic of the back-EMF over its fundamental, five times that of the flux"),
        ("e7_rel", "1", "7th harmonic of the back-EMF over its fundamental, seven times that of the flux"),
    ];

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, close, env};
    use crate::numerics::transforms::{inverse_park, park};
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    const PSI: f64 = 0.193;

    fn magnet(p: &[f64], theta: f64) -> Magnet<f64> {
        let mut out = Magnet { flux: [PSI, 0.0], slope: [0.0; 2] };
        BackEmfHarmonics::magnet(p, PSI, &env(theta, 300.0), &CX, &mut out);
        out
    }

    /// ψ_m·Σ h_n·cos(n·θ + φ_n) of one phase, and its derivative with respect to θ.
    fn phase(h: [f64; 2], phi: [f64; 2], theta: f64) -> (f64, f64) {
        let (five, seven) = (5.0 * theta + phi[0], 7.0 * theta + phi[1]);
        let flux = theta.cos() + h[0] * five.cos() + h[1] * seven.cos();
        let slope = -theta.sin() - 5.0 * h[0] * five.sin() - 7.0 * h[1] * seven.sin();
        (PSI * flux, PSI * slope)
    }

    proptest! {
        #[test]
        fn flux_and_torque_are_those_of_the_phases(
            h in prop::array::uniform2(0.0..0.05f64), phi in prop::array::uniform2(0.0..TAU), theta in 0.0..TAU,
            i in prop::array::uniform2(-10.0..10.0f64),
        ) {
            let p = [h[0] * phi[0].cos(), h[0] * phi[0].sin(), h[1] * phi[1].cos(), h[1] * phi[1].sin()];
            let phases = [0.0, 1.0, 2.0].map(|x| phase(h, phi, theta - x * TAU / 3.0));
            let (s, c) = theta.sin_cos();
            let got = magnet(&p, theta);
            let flux = park(phases.map(|x| x.0), c, s);
            // Arguments reach 11 rad, of the harmonics 80 rad, and are off by half a rounding of that: 11 and 2·0.05·80 halves,
            // and as many again for sines, products and sums.
            let allowed = 32.0 * f64::EPSILON * PSI;
            prop_assert!((got.flux[0] - flux[0]).abs() <= allowed && (got.flux[1] - flux[1]).abs() <= allowed);
            // Without saliency τ_e/n_p = Σ i_x·dψ_x/dθ.
            let currents = inverse_park(i, c, s);
            let torque: f64 = (0..3).map(|x| currents[x] * phases[x].1).sum();
            let vector = got.flux[0] * i[1] - got.flux[1] * i[0] + got.slope[0] * i[0] + got.slope[1] * i[1];
            // The slopes are up to seven times as large and as far off; three phases carry them.
            prop_assert!((1.5 * vector - torque).abs() <= 3.0 * 7.0 * allowed * (i[0].abs() + i[1].abs()));
        }
    }

    #[test]
    fn results_are_shares_of_the_induced_voltage() {
        let p = [0.003, 0.004, 0.0, -0.002];
        let out = BackEmfHarmonics::outputs(&p, &crate::effects::testing::base(), &CX);
        close(out[0].2, 5.0 * 0.005, 1e-14);
        close(out[1].2, 7.0 * 0.002, 1e-14);
    }
}
