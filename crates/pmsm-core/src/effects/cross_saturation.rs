//! Cross-saturation: the axes share iron, so that the flux of one falls with the current of the other. From one energy
//! W = (k/l_q)·λ_d²·λ_q²/(2λ_0²), Δi_d = (k/l_q)·λ_d·λ_q²/λ_0² and Δi_q = (k/l_q)·λ_d²·λ_q/λ_0²: the cross terms are reciprocal.
//!
//! Source: Hinkkanen, Pescetto, Mölsä, Saarakkala, Pellegrino & Bojoi, IEEE Trans. Industry Applications 53 (2017) 2644.

use crate::effect::{Context, Effect, Field, FieldPoint, Info, Parameter, Role, Site};
use crate::model::Base;
use crate::real::Real;

/// See the module's documentation.
pub struct CrossSaturation;

impl Effect for CrossSaturation {
    const INFO: Info = Info {
        id: "cross_saturation",
        title: "Cross-saturation",
        sentence: "The two axes share iron: the flux of one falls with the current of the other.",
        equation: "Δi_d = k·λ_d·λ_q²/(l_q·λ_0²), Δi_q = k·λ_d²·λ_q/(l_q·λ_0²)",
        source: "Hinkkanen et al., IEEE Trans. Industry Applications 53 (2017) 2644",
        fingerprint: "q-axis voltage falls with ω·i_q², the same for both signs of i_q",
        look_alikes: &["saturation_q", "saturation_d", "encoder_angle_offset"],
        contains: &[],
        site: Site::Electrical,
        needs: &[],
        parameters: &[Parameter {
            name: "k",
            unit: "1",
            meaning: "extra current at the largest flux linkage, share of the linear one",
            role: Role::Amplitude,
            low: |_| 0.0,
            high: |_| 30.0,
            typical: |_| 0.1,
        }],
    };

    #[inline(always)]
    fn field<T: Real>(p: &[T], at: &FieldPoint<T>, base: &Base<T>, cx: &Context, out: &mut Field<T>) {
        let strength = p[0] * base.inverse_l_q * (1.0 / (cx.psi_max * cx.psi_max));
        let [d, q] = at.flux;
        out.i[0] += strength * d * q * q;
        out.i[1] += strength * d * d * q;
        out.inverse[0] += strength * q * q;
        out.inverse[1] += strength * d * q * 2.0;
        out.inverse[2] += strength * d * d;
    }
}
