//! Eddy-current loss in the iron: a resistance r_c across the magnetising branch draws i_fe = e/r_c from the terminals, e being
//! the voltage that the flux in the iron induces; in the rotor frame it follows with a small lag, τ_c·di_fe/dt = e/r_c − i_fe, so
//! that at constant speed it is e/r_c. Part of the flux does not pass through the iron: the leakage inductance l_σ lies before the branch,
//! carries the terminal current and, in the steady state to which its small voltage is taken, lowers e by jω·l_σ·i_m.
//!
//! Source: Urasaki, Senjyu & Uezato, IEEE Trans. Energy Conversion 18 (2003) 41.

use crate::effect::{Context, Derived, Effect, Electrical, Info, Need, Output, Parameter, Role, Site};
use crate::base::Base;
use crate::numerics::real::Real;

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
        look_alikes: &["voltage_delay", "encoder_angle_offset", "inter_turn_short", "encoder_delay"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Motion, Need::Current],
        parameters: &[
            Parameter {
                name: "g_c",
                unit: "S",
                meaning: "conductance of the iron branch, 1/r_c",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|cx| 0.3 * cx.i_max / cx.v_max,
                typical: &|cx| 0.01 * cx.i_max / cx.v_max,
            },
            Parameter {
                name: "tau_c",
                unit: "s",
                meaning: "lag of the eddy currents",
                role: Role::Shape,
                low: &|cx| 0.6 * cx.period,
                high: &|cx| 20.0 * cx.period,
                typical: &|cx| cx.period,
            },
            Parameter {
                name: "l_sigma",
                unit: "H",
                meaning: "leakage inductance before the iron branch",
                role: Role::Shape,
                low: &|_| 0.0,
                high: &|cx| 0.5 * cx.psi_max / cx.i_max,
                typical: &|cx| 0.05 * cx.psi_max / cx.i_max,
            },
        ],
    };
    const FORM: f64 = 0.02;
    const MAGNETIC: bool = true;
    const ELECTRICAL_STATES: usize = 2;
    const DERIVED: &'static [Derived] = &[
        ("r_c", "ohm", "resistance of the iron branch"),
    ];

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        vec![vec![0.0, cx.period, 0.0]]
    }

    #[inline(always)]
    fn shunt<T: Real>(_: &[T], x: &[T], _: (T, T), _: &Context, i: &mut [T; 2]) {
        i[0] += x[0];
        i[1] += x[1];
    }

    #[inline(always)]
    fn voltage<T: Real>(p: &[T], x: &[T], at: &Electrical<T>, _: &Context, lost: &mut [T; 2]) {
        let reactance = p[2] * at.env.omega_e;
        lost[0] -= reactance * x[1];
        lost[1] += reactance * x[0];
    }

    #[inline(always)]
    fn electrical_states<T: Real>(p: &[T], x: &[T], at: &Electrical<T>, _: &Context, dx: &mut [T]) {
        let e = behind_the_leakage(p, x, at);
        dx[0] = (p[0] * e[0] - x[0]) / p[1];
        dx[1] = (p[0] * e[1] - x[1]) / p[1];
    }

    #[inline(always)]
    fn electrical_start<T: Real>(p: &[T], at: &Electrical<T>, _: &Context, x: &mut [T]) {
        let e = behind_the_leakage(p, &[T::zero(); 2], at);
        x[0] = p[0] * e[0];
        x[1] = p[0] * e[1];
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        let least = (p[0] - 1e-12).if_positive(p[0], T::constant(1e-12));
        vec![("r_c", "ohm", T::one() / least), ("tau_c", "s", p[1]), ("l_sigma", "H", p[2])]
    }
}

/// The voltage across the iron branch, V.
#[inline(always)]
fn behind_the_leakage<T: Real>(p: &[T], x: &[T], at: &Electrical<T>) -> [T; 2] {
    let reactance = p[2] * at.env.omega_e;
    let i_m = [at.i[0] - x[0], at.i[1] - x[1]];
    [at.emf[0] + reactance * i_m[1], at.emf[1] - reactance * i_m[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, base, close, env, winding};
    use crate::model::Model;
    use crate::numerics::rk4;

    #[test]
    fn steady_loss_is_that_of_r_c_across_the_induced_voltage() {
        let (r_c, tau_c, omega) = (150.0, 5e-5, 400.0);
        let model = Model::new(CX, &[EffectId::IronLoss]);
        let p = [&MACHINE[..], &[1.0 / r_c, tau_c, 0.0]].concat();
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
        let expected = 1.5 * e_squared / r_c;
        close((input - copper - shaft) / expected, 1.0, 1e-6);
    }

    #[test]
    fn behind_the_leakage_the_steady_state_is_that_of_the_two_loops() {
        // v = r_s·i + jω·l_σ·i + e, e = jω·(ψ_m + (L − l_σ)·i_m), i = i_m + e/r_c, with axes of one inductance.
        let (r_c, omega, l_sigma, l) = (150.0, 400.0, 0.5e-3, MACHINE[1]);
        let mut p = [&MACHINE[..], &[1.0 / r_c, 1e-6, l_sigma]].concat();
        p[2] = l;
        let base = Base::new(&p);
        let model = Model::new(CX, &[EffectId::IronLoss]);
        let i_m = [-1.0, 3.0];
        let e = [-omega * (l - l_sigma) * i_m[1], omega * (MACHINE[3] + (l - l_sigma) * i_m[0])];
        let i = [i_m[0] + e[0] / r_c, i_m[1] + e[1] / r_c];
        let v = [
            MACHINE[0] * i[0] - omega * l_sigma * i[1] + e[0],
            MACHINE[0] * i[1] + omega * l_sigma * i[0] + e[1],
        ];
        let state = [MACHINE[3] + l * i_m[0], l * i_m[1], e[0] / r_c, e[1] / r_c];
        let rate = model.electrical_rhs(&p, &base, &state, v, &env(0.0, omega));
        close(rate[0], 0.0, 1e-9);
        close(rate[1], 0.0, 1e-9);
        let shown = model.state_current(&p, &base, &state, &env(0.0, omega)).i;
        close(shown[0], i[0], 1e-12);
        close(shown[1], i[1], 1e-12);
        let at = Electrical { emf: [-omega * state[1], omega * state[0]], ..winding(i, 0.0, omega) };
        let mut x = [0.0; 2];
        IronLoss::electrical_start(&p[6..], &at, &CX, &mut x);
        // The start takes the whole current for the magnetising one.
        close(x[0], state[2], 1e-3);
        close(x[1], state[3], 1e-3);
    }

    #[test]
    fn no_conductance_is_a_finite_resistance_in_the_results() {
        assert!(IronLoss::outputs(&[0.0, 1e-4, 0.0], &base(), &CX)[0].2.is_finite());
    }
}
