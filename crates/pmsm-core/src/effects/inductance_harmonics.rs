//! Inductances that vary with rotor angle beyond the saliency. Slots, as many per pole pair as there are phases, repeat six times in
//! an electrical turn; what they do to the phase inductances (harmonics 4, 6 and 8 of self and mutual ones) becomes in the
//! rotor frame a symmetric matrix that turns six times,
//!
//! > ΔL(θ) = [[ℓ_dd, ℓ_dq], [ℓ_dq, ℓ_qq]],  ℓ_x(θ) = l_q·(a_x·cos 6θ + b_x·sin 6θ),
//!
//! and adds to the field energy ½·(ψ − ψ_m)ᵀ·((L + ΔL)⁻¹ − L⁻¹)·(ψ − ψ_m). Source: Park transform of
//! L_aa = L_0 + L_2 cos 2θ + Σ L_k cos(kθ + φ_k); Krause, Analysis of Electric Machinery (2013), chapter 1.

use crate::effect::{Context, Derived, Effect, Field, FieldPoint, Info, Need, Output, Parameter, Role, Site};
use crate::base::Base;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct InductanceHarmonics;

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

impl Effect for InductanceHarmonics {
    const GENERAL: bool = true;
    const INFO: Info = Info {
        id: "inductance_harmonics",
        title: "Inductance harmonics",
        sentence: "The inductances vary with the rotor angle beyond the plain saliency: slots show through.",
        equation: "L(θ) = L + l_q·(A·cos 6θ + B·sin 6θ) in the rotor frame, A and B symmetric",
        source: "Krause, Analysis of Electric Machinery (2013), chapter 1",
        fingerprint: "6th electrical order in both voltages growing with ω·i, and at standstill with di/dt",
        look_alikes: &["back_emf_harmonics", "dead_time"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Angle, Need::Transients, Need::Current],
        parameters: &[
            part("a_dd", "cosine part of the d inductance, share of l_q"),
            part("b_dd", "sine part of the d inductance, share of l_q"),
            part("a_dq", "cosine part of the mutual inductance, share of l_q"),
            part("b_dq", "sine part of the mutual inductance, share of l_q"),
            part("a_qq", "cosine part of the q inductance, share of l_q"),
            part("b_qq", "sine part of the q inductance, share of l_q"),
        ],
    };
    const MAGNETIC: bool = true;
    const DERIVED: &'static [Derived] = &[
        ("l6_rel", "1", "amplitude of the ripple at six times the electrical angle, share of the mean inductance, root mean square over both axes"),
    ];

    #[inline(always)]
    fn field<T: Real>(p: &[T], at: &FieldPoint<T>, base: &Base<T>, _: &Context, out: &mut Field<T>) {
        let (s6, c6) = six_fold(at.sin_cos);
        let (dd, slope_dd) = turned((p[0] * base.l_q, p[1] * base.l_q), (s6, c6));
        let (dq, slope_dq) = turned((p[2] * base.l_q, p[3] * base.l_q), (s6, c6));
        let (qq, slope_qq) = turned((p[4] * base.l_q, p[5] * base.l_q), (s6, c6));
        // The inverse of L + ΔL, and the current that it gives.
        let (l_d, l_q) = (base.l_d + dd, base.l_q + qq);
        let scale = T::one() / (l_d * l_q - dq * dq);
        let (y_d, y_m, y_q) = (l_q * scale, -(dq * scale), l_d * scale);
        let (x, y) = (at.flux[0] - at.magnet[0], at.flux[1] - at.magnet[1]);
        let (d, q) = (y_d * x + y_m * y, y_m * x + y_q * y);
        // (L + ΔL)⁻¹ − L⁻¹ = −L⁻¹·ΔL·(L + ΔL)⁻¹ is exactly zero with ΔL.
        out.i[0] -= base.inverse_l_d * (dd * d + dq * q);
        out.i[1] -= base.inverse_l_q * (dq * d + qq * q);
        out.slope -= (slope_dd * d * d + slope_dq * d * q * 2.0 + slope_qq * q * q) * 3.0;
        out.inverse[0] -= base.inverse_l_d * (dd * y_d + dq * y_m);
        out.inverse[1] -= base.inverse_l_d * (dd * y_m + dq * y_q);
        out.inverse[2] -= base.inverse_l_q * (dq * y_m + qq * y_q);
    }

    /// The swing of an axis' inductance, share of l_q: root mean square of the two axes.
    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        let own = [p[0], p[1], p[4], p[5]];
        let size = own.iter().fold(T::zero(), |sum, x| sum + x.squared());
        vec![("l6_rel", "1", (size * 0.5).sqrt())]
    }
}

/// a·cos 6θ + b·sin 6θ, and a sixth of its derivative with respect to θ.
#[inline(always)]
fn turned<T: Real>((a, b): (T, T), (s6, c6): (T, T)) -> (T, T) {
    (a * c6 + b * s6, b * c6 - a * s6)
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
    use crate::numerics::transforms::{inverse_park, park};
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    proptest! {
        /// Inductances L_xy of the phases x, y = 0, 1, 2 in harmonics 4, 6 and 8 of the rotor angle.
        #[test]
        fn flux_is_that_of_the_phase_inductances(
            harmonic in prop::sample::select(vec![4, 6, 8]),
            phi in 0.0..TAU,
            theta in 0.0..TAU,
            i in prop::array::uniform2(-8.0..8.0f64),
        ) {
            let share = 0.03;
            let k = f64::from(harmonic);
            let mutual = |x: f64, y: f64| match harmonic {
                6 => (6.0 * theta + phi).cos() * ((x - y) * TAU / 3.0).cos(),
                _ => (k * theta + phi - 0.5 * k * (x + y) * TAU / 3.0).cos(),
            };
            let (s, c) = theta.sin_cos();
            let currents = inverse_park(i, c, s);
            let phases = [0.0, 1.0, 2.0].map(|x| {
                let linked: f64 = [0.0, 1.0, 2.0].iter().zip(currents).map(|(y, i)| mutual(x, *y) * i).sum();
                share * MACHINE[2] / 1.5 * linked
            });
            let extra = park(phases, c, s);
            let flux = [MACHINE[3] + MACHINE[1] * i[0] + extra[0], MACHINE[2] * i[1] + extra[1]];
            let model = Model::new(CX, &[EffectId::InductanceHarmonics]);
            let (a, b) = (share * phi.cos(), -share * phi.sin());
            let own = match harmonic {
                4 => [a, b, b, -a, -a, -b],
                6 => [a, b, 0.0, 0.0, a, b],
                _ => [a, b, -b, a, -a, -b],
            };
            let p = [&MACHINE[..], &own].concat();
            let got = model.state_current(&p, &base(), &flux, &env(theta, 0.0)).i;
            // A flux is the sum of the magnet's and the current's and off by some roundings of both. The angles, up to 100 rad, are off
            // by half a rounding of that, which 3 % of the inductance take over. Currents are that over the smaller inductance.
            let flux = MACHINE[3] + MACHINE[2] * (i[0].abs() + i[1].abs());
            let allowed = 32.0 * f64::EPSILON * flux / MACHINE[1];
            prop_assert!((got[0] - i[0]).abs() <= allowed && (got[1] - i[1]).abs() <= allowed, "{got:?} {i:?}");
        }
    }

    #[test]
    fn the_angle_is_taken_six_times() {
        let (s, c) = six_fold(0.3f64.sin_cos());
        close(s, 1.8f64.sin(), 1e-14);
        close(c, 1.8f64.cos(), 1e-14);
    }
}
