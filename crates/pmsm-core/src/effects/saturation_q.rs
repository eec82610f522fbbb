//! Saturation of the q axis: beyond the linear part the flux λ_q calls for the current
//! Δi_q = (k/l_q)·(|λ_q|/λ_0)^s·λ_q, from the energy W = (k/l_q)·|λ_q|^(s+2)/((s+2)·λ_0^s), λ_0 being the largest
//! flux linkage of the recording. The inductance falls as the axis fills.
//!
//! Source: Hinkkanen, Pescetto, Mölsä, Saarakkala, Pellegrino & Bojoi, IEEE Trans. Industry Applications 53 (2017) 2644.

use crate::effect::{Context, Effect, Field, FieldPoint, Info, Need, Site};
use crate::base::Base;
use crate::numerics::real::Real;
use crate::terms::{SATURATION, extra_current};

/// See the module's documentation.
pub struct SaturationQ;

impl Effect for SaturationQ {
    const GENERAL: bool = true;
    const INFO: Info = Info {
        id: "saturation_q",
        title: "Saturation of the q axis",
        sentence: "The iron of the q axis saturates: its inductance falls as its own current grows.",
        equation: "i_q = λ_q/l_q·(1 + k·(|λ_q|/λ_0)^s)",
        source: "Hinkkanen et al., IEEE Trans. Industry Applications 53 (2017) 2644",
        fingerprint: "d-axis voltage −ω·λ_q is no straight line over i_q; current ripple grows with i_q",
        look_alikes: &["cross_saturation", "saturation_d", "encoder_angle_offset"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Current],
        parameters: &SATURATION,
    };
    const MAGNETIC: bool = true;

    fn probes(_: &Context) -> Vec<Vec<f64>> {
        [1.0, 2.0, 4.0, 7.0].map(|s| vec![0.0, s]).to_vec()
    }

    #[inline(always)]
    fn field<T: Real>(p: &[T], at: &FieldPoint<T>, base: &Base<T>, cx: &Context, out: &mut Field<T>) {
        // The magnet alone calls for no current, whatever its harmonics.
        let (current, slope) = extra_current(p, base.inverse_l_q, at.flux[1] - at.magnet[1], cx);
        out.i[1] += current;
        out.inverse[2] += slope;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::CX;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn current_grows_with_flux_and_incremental_inductance_is_below_apparent(
            k in 0.01..5.0f64, s in 0.5..8.0f64, flux in 0.01..0.4f64,
        ) {
            let inverse_l = 1.0 / 21.3e-3;
            let current = |flux: f64| flux * inverse_l + extra_current(&[k, s], inverse_l, flux, &CX).0;
            let inverse_incremental = inverse_l + extra_current(&[k, s], inverse_l, flux, &CX).1;
            prop_assert!(inverse_incremental > current(flux) / flux);
            prop_assert!(current(flux * 1.01) > current(flux));
            prop_assert_eq!(current(-flux), -current(flux));
            // The central quotient over ±h·λ of λ^(s+1) is off by s·(s−1)·h²/6 of itself. The power is the exponential of a
            // logarithm of up to 30, whose rounding is that of the current; both currents carry it over 2h.
            let h = 1e-5;
            let quotient = (current(flux * (1.0 + h)) - current(flux * (1.0 - h))) / (2.0 * h * flux);
            let allowed = s * (s - 1.0).abs() * h * h / 6.0 + 30.0 * f64::EPSILON / h;
            prop_assert!((quotient / inverse_incremental - 1.0).abs() <= allowed);
        }
    }

    #[test]
    fn strength_is_the_share_of_the_linear_current_at_the_largest_flux() {
        let (extra, _) = extra_current(&[0.3, 3.7], 50.0, CX.psi_max, &CX);
        assert!((extra / (50.0 * CX.psi_max) - 0.3).abs() < 1e-12);
    }
}
