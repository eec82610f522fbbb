//! Eddy-current loss in the iron: a resistance r_c across the magnetising branch draws i_fe = e/r_c from the terminals, e being
//! the induced voltage; it follows with the small lag τ_c of the eddy currents, τ_c·di_fe/dt = e/r_c − i_fe.
//!
//! Source: Urasaki, Senjyu & Uezato, IEEE Trans. Energy Conversion 18 (2003) 41.

use crate::effect::{Context, Effect, Electrical, Info, Need, Output, Parameter, Role, Site};
use crate::base::Base;
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
        needs: &[Need::Motion, Need::Current],
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
    const MAGNETIC: bool = true;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, base, close, env};
    use crate::model::Model;
    use crate::rk4;

    #[test]
    fn steady_loss_is_that_of_r_c_across_the_induced_voltage() {
        let (r_c, tau_c, omega) = (150.0, 5e-5, 400.0);
        let model = Model::new(CX, &[EffectId::IronLoss]);
        let p = [&MACHINE[..], &[1.0 / r_c, tau_c]].concat();
        let (v, at) = ([-20.0, 85.0], env(0.0, omega));
        let mut state = model.steady_state::<f64, 4>(&p, &base(), [0.0, 2.0], &at).0;
        for _ in 0..50_000 {
            state = rk4::step(1e-5, &state, |_, s| model.electrical_rhs(&p, &base(), s, v, &at));
        }
        let end = model.state_current(&p, &base(), &state, &at);
        let input = 1.5 * (v[0] * end.i[0] + v[1] * end.i[1]);
        let copper = 1.5 * MACHINE[0] * (end.i[0].powi(2) + end.i[1].powi(2));
        let shaft = end.tau_e * omega / CX.n_p;
        let e_squared = omega * omega * (state[0].powi(2) + state[1].powi(2));
        // The lag leaves the part along the voltage: 1/(1 + (ω·τ_c)²).
        let expected = 1.5 * e_squared / r_c / (1.0 + (omega * tau_c).powi(2));
        close((input - copper - shaft) / expected, 1.0, 1e-6);
    }

    #[test]
    fn eddy_currents_of_the_iron_stand_still_in_the_stator() {
        // Left alone, they decay without turning in the stator: in the rotor frame they turn backwards.
        let at = crate::effects::testing::winding([0.0; 2], 0.0, 400.0);
        let mut dx = [0.0; 2];
        IronLoss::electrical_states(&[0.0, 1e9], &[1.0, 0.0], &at, &CX, &mut dx);
        close(dx[0], 0.0, 1e-8);
        close(dx[1], -400.0, 1e-8);
    }

    #[test]
    fn no_conductance_is_a_finite_resistance_in_the_results() {
        assert!(IronLoss::outputs(&[0.0, 1e-4], &base(), &CX)[0].2.is_finite());
    }
}
