//! A DC link that is not at its nominal voltage: behind a source resistance R and a capacitance C it gives way under load,
//! R·C·dx/dt = R·P/v_dc² − x, and the inverter turns every command into v·(1 − x), P = 3/2·(v_d·i_d + v_q·i_q).
//!
//! Source: Kolar & Round, IEE Proc. Electric Power Applications 153 (2006) 535.

use crate::effect::{Context, Effect, Electrical, Info, Need, Parameter, Role, Site};
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct DcLinkSag;

impl Effect for DcLinkSag {
    const INFO: Info = Info {
        id: "dc_link_sag",
        title: "DC-link sag",
        sentence: "The DC link gives way under load, and every commanded voltage shrinks with it.",
        equation: "v = v*·(1 − x), R·C·dx/dt = R·P/v_dc² − x",
        source: "Kolar & Round, IEE Proc. Electric Power Applications 153 (2006) 535",
        fingerprint: "Voltage lost in proportion to voltage and power: grows with speed and torque together",
        look_alikes: &["magnet_thermal_drift", "rs_thermal_drift", "iron_loss"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Transients, Need::Current],
        parameters: &[
            Parameter {
                name: "r_source",
                unit: "ohm",
                meaning: "source resistance of the DC link",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|cx| 0.4 * cx.v_dc * cx.v_dc / (cx.v_max * cx.i_max),
                typical: &|cx| 0.02 * cx.v_dc * cx.v_dc / (cx.v_max * cx.i_max),
            },
            Parameter {
                name: "tau_rc",
                unit: "s",
                meaning: "time constant of the DC link, R·C",
                role: Role::Shape,
                low: &|cx| cx.period,
                high: &|_| 1.0,
                typical: &|cx| cx.period.max(0.02),
            },
        ],
    };
    const ELECTRICAL_STATES: usize = 1;
    const TURNS: bool = false;

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        [0.002f64, 0.01, 0.05].map(|tau| vec![0.0, tau.max(2.0 * cx.period)]).to_vec()
    }

    #[inline(always)]
    fn voltage<T: Real>(_: &[T], x: &[T], at: &Electrical<T>, _: &Context, lost: &mut [T; 2]) {
        lost[0] += x[0] * at.v[0];
        lost[1] += x[0] * at.v[1];
    }

    #[inline(always)]
    fn electrical_states<T: Real>(p: &[T], x: &[T], at: &Electrical<T>, cx: &Context, dx: &mut [T]) {
        let power = (at.v[0] * at.i[0] + at.v[1] * at.i[1]) * 1.5;
        dx[0] = (p[0] * power * (1.0 / (cx.v_dc * cx.v_dc)) - x[0]) / p[1];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, close, lost, winding};

    #[test]
    fn steady_sag_is_source_resistance_times_power_over_voltage_squared() {
        let at = Electrical { v: [-30.0, 120.0], ..winding([-2.0, 8.0], 0.0, 500.0) };
        let power = 1.5 * (30.0 * 2.0 + 120.0 * 8.0);
        let sag = 3.0 * power / (540.0 * 540.0);
        let mut dx = [0.0];
        DcLinkSag::electrical_states(&[3.0, 0.02], &[sag], &at, &CX, &mut dx);
        close(dx[0], 0.0, 1e-12);
        // The link itself: v_dc·(1 − x) behind 3 Ω feeds the inverter that turns out v*·(1 − x).
        let current = (540.0 - 540.0 * (1.0 - sag)) / 3.0;
        close(540.0 * (1.0 - sag) * current, power * (1.0 - sag), 1e-12);
        let gone = lost::<DcLinkSag>(&[3.0, 0.02], &[sag], &at);
        close(gone[0], -30.0 * sag, 1e-14);
        close(gone[1], 120.0 * sag, 1e-14);
    }

    #[test]
    fn the_capacitor_sets_the_pace() {
        let at = winding([0.0; 2], 0.0, 0.0);
        let mut dx = [0.0];
        DcLinkSag::electrical_states(&[3.0, 0.02], &[0.1], &at, &CX, &mut dx);
        close(dx[0], -0.1 / 0.02, 1e-12);
    }
}
