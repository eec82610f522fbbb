//! Cross-saturation: the axes share iron, so that the flux of one falls with the current of the other. From one energy
//! W = (k/l_q)·x²·λ_q²/(2λ_0²), x = λ_d − (1−β)·ψ_m: Δi_d = (k/l_q)·x·λ_q²/λ_0² and Δi_q = (k/l_q)·x²·λ_q/λ_0², so that the cross
//! terms are reciprocal. β is the share of the magnet's flux that fills the common iron beforehand; it is
//! negative where the magnet's leakage saturates bridges that q flux relieves.
//!
//! Source: Hinkkanen, Pescetto, Mölsä, Saarakkala, Pellegrino & Bojoi, IEEE Trans. Industry Applications 53 (2017) 2644.

use crate::effect::{Context, Effect, Field, FieldPoint, Info, Need, Parameter, Role, Site};
use crate::terms::PRELOAD;
use crate::base::Base;
use crate::real::Real;

/// See the module's documentation.
pub struct CrossSaturation;

impl Effect for CrossSaturation {
    const INFO: Info = Info {
        id: "cross_saturation",
        title: "Cross-saturation",
        sentence: "The two axes share iron: the flux of one falls with the current of the other.",
        equation: "Δi_d = k·x·λ_q²/(l_q·λ_0²), Δi_q = k·x²·λ_q/(l_q·λ_0²), x = λ_d − (1−β)·ψ_m",
        source: "Hinkkanen et al., IEEE Trans. Industry Applications 53 (2017) 2644",
        fingerprint: "q-axis voltage falls with ω·i_q², the same for both signs of i_q",
        look_alikes: &["saturation_q", "saturation_d", "encoder_angle_offset"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Current],
        parameters: &[
            Parameter {
                name: "k",
                unit: "1",
                meaning: "extra current at the largest flux linkage, share of the linear one",
                role: Role::Amplitude,
                low: |_| 0.0,
                // Beyond, the energy is no longer convex: one current would belong to several flux linkages.
                high: |_| 2.0,
                typical: |_| 0.1,
            },
            Parameter { low: |_| -1.0, ..PRELOAD },
        ],
    };
    const MAGNETIC: bool = true;

    fn probes(_: &Context) -> Vec<Vec<f64>> {
        [-0.6, 0.1, 0.9].map(|beta| vec![0.0, beta]).to_vec()
    }

    #[inline(always)]
    fn field<T: Real>(p: &[T], at: &FieldPoint<T>, base: &Base<T>, cx: &Context, out: &mut Field<T>) {
        let strength = p[0] * base.inverse_l_q * (1.0 / (cx.psi_max * cx.psi_max));
        // The magnet alone calls for no current, whatever its harmonics.
        let (d, q) = (at.flux[0] - at.magnet[0] + p[1] * at.psi_m, at.flux[1] - at.magnet[1]);
        out.i[0] += strength * d * q * q;
        out.i[1] += strength * d * d * q;
        out.inverse[0] += strength * q * q;
        out.inverse[1] += strength * d * q * 2.0;
        out.inverse[2] += strength * d * d;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, base, close, env};
    use crate::model::Model;

    /// Flux linkage of the axes at a current.
    fn flux(k: f64, i: [f64; 2]) -> [f64; 2] {
        let model = Model::new(CX, &[EffectId::CrossSaturation]);
        let p = [&MACHINE[..], &[k, 1.0]].concat();
        model.steady_state::<f64, 2>(&p, &base(), i, &env(0.0, 0.0)).0
    }

    #[test]
    fn d_flux_falls_with_the_square_of_the_q_current() {
        let drop = |i_q: f64| MACHINE[3] - flux(0.02, [0.0, i_q])[0];
        assert!(drop(1.0) > 0.0);
        close(drop(-1.0), drop(1.0), 1e-12);
        close(drop(1.0) / drop(0.5), 4.0, 0.01);
        // Δλ_d = −l_d·(k/l_q)·ψ_m·λ_q²/λ_0² to first order in k.
        let expected = MACHINE[1] * 0.02 / MACHINE[2] * MACHINE[3] * (MACHINE[2] / CX.psi_max).powi(2);
        close(drop(1.0) / expected, 1.0, 0.03);
    }

    #[test]
    fn up_to_its_bound_the_energy_is_convex_within_the_recorded_flux() {
        let p = [(CrossSaturation::INFO.parameters[0].high)(&CX), 1.0];
        let equal = Base { l_d: MACHINE[2], inverse_l_d: 1.0 / MACHINE[2], ..base() };
        for base in [base(), equal] {
            for k in 0..100 {
                let (s, c) = (0.0628 * f64::from(k)).sin_cos();
                let flux = [CX.psi_max * c, CX.psi_max * s];
                let at =
                    FieldPoint { flux, magnet: [MACHINE[3], 0.0], psi_m: MACHINE[3], sin_cos: (0.0, 1.0) };
                let inverse = [base.inverse_l_d, 0.0, base.inverse_l_q];
                let mut field = Field { i: [0.0; 2], slope: 0.0, inverse };
                CrossSaturation::field(&p, &at, &base, &CX, &mut field);
                let [a, b, c] = field.inverse;
                assert!(a * c - b * b > -1e-9 * a * c, "{flux:?}");
            }
        }
    }

    #[test]
    fn q_flux_falls_where_the_magnet_fills_the_iron() {
        let linear = MACHINE[2] * 4.0;
        assert!(flux(0.5, [0.0, 4.0])[1] < flux(0.5, [-8.0, 4.0])[1]);
        assert!(flux(0.5, [-8.0, 4.0])[1] < linear);
    }
}
