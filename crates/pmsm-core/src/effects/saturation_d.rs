//! Saturation of the d axis: Δi_d = g(x) − g(β·ψ_m) with x = λ_d − (1−β)·ψ_m and g(x) = (k/l_d)·(|x|/λ_0)^s·x, from the energy of
//! [`super::saturation_q`] in x less its tangent at the magnet's own flux. β says how much of the magnet's flux fills the
//! iron of the axis beforehand: at β = 1 demagnetising current frees it, at β = 0 the axis saturates with its own
//! current in both directions.
//!
//! Source: Hinkkanen, Pescetto, Mölsä, Saarakkala, Pellegrino & Bojoi, IEEE Trans. Industry Applications 53 (2017) 2644.

use crate::effect::{Context, Effect, Field, FieldPoint, Info, Need, Parameter, Role, Site};
use crate::terms::{SATURATION, extra_current};
use crate::base::Base;
use crate::numerics::real::Real;

/// Share of the magnet's flux that fills the iron beforehand.
const PRELOAD: Parameter = Parameter {
    name: "beta",
    unit: "1",
    meaning: "share of the magnet's flux that fills the iron of the axis beforehand",
    role: Role::Shape,
    low: &|_| 0.0,
    high: &|_| 1.0,
    typical: &|_| 1.0,
};

/// See the module's documentation.
pub struct SaturationD;

impl Effect for SaturationD {
    const GENERAL: bool = true;
    const INFO: Info = Info {
        id: "saturation_d",
        title: "Saturation of the d axis",
        sentence: "The iron of the d axis saturates: its inductance falls with the flux of magnet and d current.",
        equation: "i_d = (λ_d − ψ_m)/l_d + g(λ_d − (1−β)·ψ_m) − g(β·ψ_m), g(x) = k·x/l_d·(|x|/λ_0)^s",
        source: "Hinkkanen et al., IEEE Trans. Industry Applications 53 (2017) 2644",
        fingerprint: "q-axis voltage ω·λ_d is no straight line over i_d; more inductance at negative i_d",
        look_alikes: &["cross_saturation", "saturation_q"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Current],
        parameters: &[SATURATION[0], SATURATION[1], PRELOAD],
    };
    const MAGNETIC: bool = true;

    fn probes(_: &Context) -> Vec<Vec<f64>> {
        [1.0, 2.0, 4.0, 7.0].iter().flat_map(|s| [0.0, 0.9].map(|beta| vec![0.0, *s, beta])).collect()
    }

    #[inline(always)]
    fn field<T: Real>(p: &[T], at: &FieldPoint<T>, base: &Base<T>, cx: &Context, out: &mut Field<T>) {
        let filling = p[2] * at.psi_m;
        // The magnet alone calls for no current, whatever its harmonics.
        let x = at.flux[0] - at.magnet[0] + filling;
        let (current, slope) = extra_current(p, base.inverse_l_d, x, cx);
        out.i[0] += current - extra_current(p, base.inverse_l_d, filling, cx).0;
        out.inverse[0] += slope;
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, base, close, env};
    use crate::model::Model;

    /// Flux linkage at a d current, the magnet filling the share `beta` of the iron.
    fn flux(i_d: f64, beta: f64) -> f64 {
        let model = Model::new(CX, &[EffectId::SaturationD]);
        let p = [&MACHINE[..], &[0.5, 2.0, beta]].concat();
        model.steady_state::<f64, 2>(&p, &base(), [i_d, 0.0], &env(0.0, 0.0)).0[0]
    }

    #[test]
    fn the_magnet_alone_calls_for_no_current() {
        for beta in [0.0, 0.4, 1.0] {
            close(flux(0.0, beta), MACHINE[3], 1e-14);
        }
    }

    #[test]
    fn demagnetising_current_finds_more_inductance() {
        let inductance = |i_d: f64| (flux(i_d + 0.01, 1.0) - flux(i_d - 0.01, 1.0)) / 0.02;
        assert!(inductance(-8.0) > inductance(0.0) && inductance(0.0) > inductance(8.0));
        // 1/l = (1 + (s+1)·k·(λ/λ_0)^s)/l_d at the magnet's flux.
        let expected = MACHINE[1] / (1.0 + 3.0 * 0.5 * (MACHINE[3] / CX.psi_max).powi(2));
        close(inductance(0.0) / expected, 1.0, 1e-5);
    }

    #[test]
    fn iron_that_the_magnet_leaves_empty_saturates_alike_in_both_directions() {
        let own = |i_d: f64| flux(i_d, 0.0) - MACHINE[3];
        close(own(-8.0), -own(8.0), 1e-14);
        assert!(own(8.0) < MACHINE[1] * 8.0);
    }
}
