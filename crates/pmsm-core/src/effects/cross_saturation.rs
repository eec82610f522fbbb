//! Cross-saturation: the axes share iron, so that the flux of one falls with the current of the other. From one energy
//! W = (k_1·ψ_m·u + k_2·u²/2)·λ_q²/(l_q·λ_0²) + l_d·(k_1·ψ_m·λ_q²/(l_q·λ_0²))²/2 in u = λ_d − ψ_m:
//! Δi_d = (k_1·ψ_m + k_2·u)·λ_q²/(l_q·λ_0²) and Δi_q = (2·k_1·ψ_m·u + k_2·u² + 2·l_d·(k_1·ψ_m·λ_q)²/(l_q·λ_0²))·λ_q/(l_q·λ_0²), so that
//! the cross terms are reciprocal. k_1 is what the iron shows at the magnet's own flux; it is negative where the magnet's leakage
//! saturates bridges that q flux relieves. k_2 is how much more it shows as d current fills the iron further. With λ_0 the largest flux
//! linkage of the recording, both are shares of the linear current there. The last term is what the co-energy −c·i_d·i_q² with
//! c = k_1·ψ_m·l_d·l_q/λ_0² does to the q axis in second order; with k_2 = 4·(k_1·ψ_m/λ_0)² the energy is that of this co-energy to second
//! order.
//!
//! Source: Hinkkanen, Pescetto, Mölsä, Saarakkala, Pellegrino & Bojoi, IEEE Trans. Industry Applications 53 (2017) 2644; the last term by
//! Legendre's transform of the co-energy.

use crate::effect::{Context, Effect, Field, FieldPoint, Info, Need, Parameter, Role, Site};
use crate::base::Base;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct CrossSaturation;

impl Effect for CrossSaturation {
    const GENERAL: bool = true;
    const INFO: Info = Info {
        id: "cross_saturation",
        title: "Cross-saturation",
        sentence: "The two axes share iron: the flux of one falls with the current of the other.",
        equation: "Δi_d = (k_1·ψ_m + k_2·u)·λ_q²/(l_q·λ_0²), \
                   Δi_q = (2·k_1·ψ_m·u + k_2·u² + 2·l_d·(k_1·ψ_m·λ_q)²/(l_q·λ_0²))·λ_q/(l_q·λ_0²), u = λ_d − ψ_m",
        source: "Hinkkanen et al., IEEE Trans. Industry Applications 53 (2017) 2644",
        fingerprint: "q-axis voltage falls with ω·i_q², the same for both signs of i_q",
        look_alikes: &["saturation_q", "saturation_d", "encoder_angle_offset"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Current],
        parameters: &[
            Parameter {
                name: "k_1",
                unit: "1",
                meaning: "extra current at the largest flux linkage, share of the linear one, at the magnet's own flux",
                role: Role::Amplitude,
                low: &|_| -5.0,
                high: &|_| 5.0,
                typical: &|_| 0.1,
            },
            Parameter {
                name: "k_2",
                unit: "1",
                meaning: "how much it grows with the flux of d current",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|_| 10.0,
                typical: &|_| 0.1,
            },
        ],
    };
    const MAGNETIC: bool = true;

    #[inline(always)]
    fn field<T: Real>(p: &[T], at: &FieldPoint<T>, base: &Base<T>, cx: &Context, out: &mut Field<T>) {
        let scale = base.inverse_l_q * (1.0 / (cx.psi_max * cx.psi_max));
        // The magnet alone calls for no current, whatever its harmonics.
        let (u, q) = (at.flux[0] - at.magnet[0], at.flux[1] - at.magnet[1]);
        let (own, grown) = (p[0] * at.psi_m * scale, p[1] * u * scale);
        let stiffer = (own * 2.0 + grown) * u;
        let fourth = own * own * base.l_d * q * q * 2.0;
        out.i[0] += (own + grown) * q * q;
        out.i[1] += (stiffer + fourth) * q;
        out.inverse[0] += p[1] * scale * q * q;
        out.inverse[1] += (own + grown) * q * 2.0;
        out.inverse[2] += stiffer + fourth * 3.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, base, close, env};
    use crate::model::Model;

    /// Flux linkage of the axes at a current.
    fn flux(k: [f64; 2], i: [f64; 2]) -> [f64; 2] {
        let model = Model::new(CX, &[EffectId::CrossSaturation]);
        let p = [&MACHINE[..], &k].concat();
        model.steady_state::<f64, 2>(&p, &base(), i, &env(0.0, 0.0)).0
    }

    #[test]
    fn d_flux_falls_with_the_square_of_the_q_current() {
        let drop = |i_q: f64| MACHINE[3] - flux([0.02, 0.0], [0.0, i_q])[0];
        assert!(drop(1.0) > 0.0);
        close(drop(-1.0), drop(1.0), 1e-12);
        close(drop(1.0) / drop(0.5), 4.0, 0.01);
        // Δλ_d = −l_d·(k_1/l_q)·ψ_m·λ_q²/λ_0² to first order in k_1.
        let expected = MACHINE[1] * 0.02 / MACHINE[2] * MACHINE[3] * (MACHINE[2] / CX.psi_max).powi(2);
        close(drop(1.0) / expected, 1.0, 0.03);
    }

    #[test]
    fn both_strengths_make_the_coenergy_that_is_linear_in_the_d_current() {
        // λ_d = l_d·i_d + ψ_m − c·i_q², λ_q = l_q·i_q − 2·c·i_d·i_q; what is off is of the second order of what they add.
        let off = |k: f64| {
            let i = [-3.0, 4.0];
            let c = k * MACHINE[3] * MACHINE[1] * MACHINE[2] / CX.psi_max.powi(2);
            let [d, q] = flux([k, 4.0 * (k * MACHINE[3] / CX.psi_max).powi(2)], i);
            let falls = [c * i[1] * i[1], 2.0 * c * i[0] * i[1]];
            let linear = [MACHINE[1] * i[0] + MACHINE[3], MACHINE[2] * i[1]];
            [((linear[0] - d) / falls[0] - 1.0).abs(), ((linear[1] - q) / falls[1] - 1.0).abs()]
        };
        let (once, half) = (off(0.02), off(0.01));
        for axis in 0..2 {
            assert!(once[axis] < 0.01 && half[axis] < 0.3 * once[axis], "{once:?} {half:?}");
        }
    }

    /// Whether the energy is convex everywhere within the largest flux, for d flux from `lowest` upwards; saliency l_q/l_d, the
    /// magnet's flux and `lowest` as shares of the largest.
    fn convex(k: [f64; 2], saliency: f64, magnet: f64, lowest: f64) -> bool {
        let base = Base { l_q: saliency * MACHINE[1], inverse_l_q: 1.0 / (saliency * MACHINE[1]), ..base() };
        let psi_m = magnet * CX.psi_max;
        (0..40).all(|turn| {
            (0..20).all(|ring| {
                let (s, c) = (std::f64::consts::PI * f64::from(turn) / 20.0).sin_cos();
                let r = CX.psi_max * f64::from(ring + 1) / 20.0;
                let at = FieldPoint { flux: [r * c, r * s], magnet: [psi_m, 0.0], psi_m, sin_cos: (0.0, 1.0) };
                let inverse = [base.inverse_l_d, 0.0, base.inverse_l_q];
                let mut field = Field { i: [0.0; 2], slope: 0.0, inverse };
                CrossSaturation::field(&k, &at, &base, &CX, &mut field);
                let [a, b, c] = field.inverse;
                at.flux[0] < lowest * CX.psi_max || (a * c - b * b > 0.0 && c > 0.0)
            })
        })
    }

    #[test]
    fn the_energy_is_convex_for_the_strengths_that_iron_has() {
        // Four times the typical strength, without the help of saliency. Beyond a magnet that is driven out nothing is recorded.
        let typical = std::array::from_fn(|n| 4.0 * (CrossSaturation::INFO.parameters[n].typical)(&CX));
        let servo = MACHINE[3] / CX.psi_max;
        assert!(convex(typical, 1.0, servo, 0.0));
        // Without a magnet (1 + k_2/2)² > k_2² where both axes hold as much, so that k_2 is at most 2.
        assert!(convex([0.0, 1.9], 1.0, 0.0, -1.0));
        assert!(!convex([0.0, 2.1], 1.0, 0.0, -1.0));
        // The measured map of a reluctance machine with a weak magnet, docs/real_recordings.md.
        assert!(convex([1.45, 3.7], 5.1, 0.36, 0.06));
    }

    #[test]
    fn q_flux_falls_where_the_magnet_fills_the_iron() {
        let linear = MACHINE[2] * 4.0;
        close(flux([0.3, 0.2], [0.0, 1e-3])[1] / (MACHINE[2] * 1e-3), 1.0, 1e-4);
        assert!(flux([0.3, 0.2], [-8.0, 4.0])[1] > linear);
        assert!(flux([0.3, 0.2], [8.0, 4.0])[1] < linear);
    }
}
