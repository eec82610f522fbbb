//! Inverter dead time and device drops: every phase loses v_err against the sign of its current,
//! v_lost,x = v_err·i_x/√(i_x² + i_th²), x = a, b, c. Below i_th the current no longer commutes the leg.
//!
//! v_err = v_dc·t_dead·f_sw plus the devices' threshold; their resistance adds to r_s. Source: Bolognani, Peretti & Zigliotto,
//! IEEE Trans. Industrial Electronics 58 (2011) 5070.

use crate::effect::{Context, Effect, Electrical, Info, Need, Parameter, Role, Site};
use crate::real::Real;
use crate::transforms::{inverse_park, park};

/// See the module's documentation.
pub struct DeadTime;

impl Effect for DeadTime {
    const INFO: Info = Info {
        id: "dead_time",
        title: "Inverter dead time",
        sentence: "The inverter's dead time and device drops take a voltage away against the sign of each phase current.",
        equation: "v_x = v_x* − v_err·i_x/√(i_x² + i_th²)",
        source: "Bolognani, Peretti & Zigliotto, IEEE Trans. Industrial Electronics 58 (2011) 5070",
        fingerprint: "Voltage along the current that does not grow with it, with 6th and 12th electrical orders",
        look_alikes: &["rs_thermal_drift", "back_emf_harmonics", "phase_resistance_imbalance"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Angle],
        parameters: &[
            Parameter {
                name: "v_err",
                unit: "V",
                meaning: "voltage lost per phase against the current's sign",
                role: Role::Amplitude,
                low: |_| 0.0,
                high: |cx| 0.5 * cx.v_max,
                typical: |cx| 0.01 * cx.v_max,
            },
            Parameter {
                name: "i_th",
                unit: "A",
                meaning: "current below which the leg does not commutate fully",
                role: Role::Shape,
                low: |cx| 1e-3 * cx.i_max,
                high: |cx| 0.3 * cx.i_max,
                typical: |cx| 0.02 * cx.i_max,
            },
        ],
    };

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        [0.01, 0.05].map(|x| vec![0.0, x * cx.i_max]).to_vec()
    }

    #[inline(always)]
    fn voltage<T: Real>(p: &[T], _: &[T], at: &Electrical<T>, _: &Context, lost: &mut [T; 2]) {
        let (s, c) = at.sin_cos;
        let phases = inverse_park(at.i, c, s)
            .map(|i| p[0] * i / (i.squared() + p[1].squared()).sqrt());
        let [d, q] = park(phases, c, s);
        lost[0] += d;
        lost[1] += q;
    }
}
