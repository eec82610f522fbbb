//! Eddy-current loss in the iron: a resistance r_c across the magnetising branch draws i_fe = e/r_c from the terminals, e being
//! the induced voltage; it follows with the small lag τ_c of the eddy currents, τ_c·di_fe/dt = e/r_c − i_fe.
//!
//! Source: Urasaki, Senjyu & Uezato, IEEE Trans. Energy Conversion 18 (2003) 41.

use crate::effect::{Context, Effect, Electrical, Info, Need, Output, Parameter, Role, Site};
use crate::model::Base;
use crate::real::Real;

/// See the module's documentation.
pub struct IronLoss;

impl Effect for IronLoss {
    const INFO: Info = Info {
        id: "iron_loss",
        title: "Iron loss",
        sentence: "Eddy currents in the iron draw a current from the terminals that makes no torque.",
        equation: "i = i_m + i_fe, τ_c·di_fe/dt = e/r_c − i_fe",
        source: "Urasaki, Senjyu & Uezato, IEEE Trans. Energy Conversion 18 (2003) 41",
        fingerprint: "Current along the induced voltage growing with speed: i_q with ω·ψ_m, i_d with −ω·l_q·i_q",
        look_alikes: &["voltage_delay", "encoder_angle_offset", "inter_turn_short"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Motion],
        parameters: &[
            Parameter {
                name: "g_c",
                unit: "S",
                meaning: "conductance of the iron branch, 1/r_c",
                role: Role::Amplitude,
                low: |_| 0.0,
                high: |cx| 0.3 * cx.i_max / cx.v_max,
                typical: |cx| 0.01 * cx.i_max / cx.v_max,
            },
            Parameter {
                name: "tau_c",
                unit: "s",
                meaning: "lag of the eddy currents",
                role: Role::Shape,
                low: |cx| 0.6 * cx.period,
                high: |cx| 20.0 * cx.period,
                typical: |cx| cx.period,
            },
        ],
    };
    const ELECTRICAL_STATES: usize = 2;

    #[inline(always)]
    fn shunt<T: Real>(_: &[T], x: &[T], _: (T, T), _: &Context, i: &mut [T; 2]) {
        i[0] += x[0];
        i[1] += x[1];
    }

    #[inline(always)]
    fn electrical_states<T: Real>(p: &[T], x: &[T], at: &Electrical<T>, _: &Context, dx: &mut [T]) {
        // The eddy currents stand still with the iron: in the rotor frame they turn backwards.
        dx[0] = (p[0] * at.emf[0] - x[0]) / p[1] + at.env.omega_e * x[1];
        dx[1] = (p[0] * at.emf[1] - x[1]) / p[1] - at.env.omega_e * x[0];
    }

    fn electrical_start<T: Real>(p: &[T], emf: [T; 2], _: (T, T), _: &Context, x: &mut [T]) {
        x[0] = p[0] * emf[0];
        x[1] = p[0] * emf[1];
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        let least = (p[0] - 1e-12).if_positive(p[0], T::constant(1e-12));
        vec![("r_c", "ohm", T::one() / least), ("tau_c", "s", p[1])]
    }
}
