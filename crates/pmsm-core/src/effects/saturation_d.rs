//! Saturation of the d axis. The magnet's flux already fills it, so that demagnetising current frees it:
//! Δi_d = g(λ_d) − g(ψ_m) with g(λ) = (k/l_d)·(|λ|/λ_0)^s·λ, from the energy of [`super::saturation_q`] in λ_d less its
//! tangent at the magnet's own flux.
//!
//! Source: Hinkkanen, Pescetto, Mölsä, Saarakkala, Pellegrino & Bojoi, IEEE Trans. Industry Applications 53 (2017) 2644.

use crate::effect::{Context, Effect, Field, FieldPoint, Info, Site};
use crate::effects::saturation_q::{PARAMETERS, extra_current};
use crate::model::Base;
use crate::real::Real;

/// See the module's documentation.
pub struct SaturationD;

impl Effect for SaturationD {
    const INFO: Info = Info {
        id: "saturation_d",
        title: "Saturation of the d axis",
        sentence: "The iron of the d axis saturates: its inductance falls with the flux of magnet and d current.",
        equation: "i_d = (λ_d − ψ_m)/l_d + g(λ_d) − g(ψ_m), g(λ) = k·λ/l_d·(|λ|/λ_0)^s",
        source: "Hinkkanen et al., IEEE Trans. Industry Applications 53 (2017) 2644",
        fingerprint: "q-axis voltage ω·λ_d bends with i_d; more inductance at negative i_d",
        look_alikes: &["cross_saturation", "saturation_q"],
        contains: &[],
        site: Site::Electrical,
        needs: &[],
        parameters: &PARAMETERS,
    };

    fn probes(_: &Context) -> Vec<Vec<f64>> {
        [1.0, 2.0, 4.0, 7.0].map(|s| vec![0.0, s]).to_vec()
    }

    #[inline(always)]
    fn field<T: Real>(p: &[T], at: &FieldPoint<T>, base: &Base<T>, cx: &Context, out: &mut Field<T>) {
        let (current, slope) = extra_current(p, base.inverse_l_d, at.flux[0], cx);
        out.i[0] += current - extra_current(p, base.inverse_l_d, at.psi_m, cx).0;
        out.inverse[0] += slope;
    }
}
