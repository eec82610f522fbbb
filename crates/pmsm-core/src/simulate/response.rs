//! The open-loop response of a motor: currents, torque and motion under given voltages and a given load torque, from a given start.
//!
//! The voltage d, q is held in the rotor's frame and the load torque is held from one instant to the next. In between the coupled equations
//! advance by equal Runge–Kutta steps, whose number is told, so that a program in another language can do the same.

use super::coupled::{FINER, STEP_LIMIT, at, join, parts};
use super::electrical::STABLE;
use crate::base::Base;
use crate::effect::Env;
use crate::effects::{ELECTRICAL_STATES, MECHANICAL_STATES, STATES};
use crate::error::{Error, Result};
use crate::model::Model;
use crate::monitor::Monitor;
use crate::numerics::rk4;
use std::collections::BTreeMap;

/// Most steps per interval.
pub const MOST_STEPS: usize = 4096;
/// Intervals after which a monitor is asked whether to go on.
const ASKED: usize = 4096;

/// What acts on the motor.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    /// Instants, s, increasing.
    pub t: &'a [f64],
    /// Voltage d, q in the rotor's frame from each instant to the next, V.
    pub v: [&'a [f64]; 2],
    /// Load torque from each instant to the next, N·m, against positive rotation.
    pub tau_load: &'a [f64],
}

/// Where it begins.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Begin {
    /// Current d, q, A.
    pub i: [f64; 2],
    /// Mechanical speed, rad/s.
    pub omega_m: f64,
    /// Mechanical angle, rad; the electrical one is n_p times as large.
    pub theta_m: f64,
}

/// Temperatures at which the equations hold where the model depends on measured ones, K above 20 °C.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Heating {
    /// Of the winding.
    pub winding: f64,
    /// Of the magnets.
    pub magnet: f64,
}

/// Number of equal steps into which each interval of `period` seconds is divided up to the largest speed of the model's scales.
pub fn steps(model: &Model, p: &[f64], period: f64) -> usize {
    let context = model.context();
    let mut rate = context.omega_e_max + context.electrical_rate;
    if model.electrical_states() > 0 {
        rate *= FINER;
    }
    let steep = model.steep_rate(p, &Base::new(p)) * (STEP_LIMIT / STABLE);
    let rate = rate.max(model.ringing(p)).max(steep);
    ((period * rate / STEP_LIMIT).ceil() as usize).clamp(1, MOST_STEPS)
}

/// Columns `i_d`, `i_q` (A), `tau_e` (N·m), `omega_m` (rad/s) and `theta_m` (rad), one entry per instant, with `steps` Runge–Kutta steps
/// in each interval.
///
/// # Errors
/// [`Error::Unusable`] where columns have unequal lengths, times do not increase, or the motion does not stay finite. Where `monitor`
/// cancels, the columns end early.
pub fn respond(
    model: &Model,
    p: &[f64],
    inputs: Inputs,
    begin: Begin,
    heating: Heating,
    steps: usize,
    monitor: &dyn Monitor,
) -> Result<BTreeMap<&'static str, Vec<f64>>> {
    let n = inputs.t.len();
    if n == 0 || inputs.v.iter().any(|v| v.len() != n) || inputs.tau_load.len() != n {
        return Err(Error::unusable(
            "the inputs have unequal lengths or none",
            "give each one value per instant",
        ));
    }
    if inputs.t.windows(2).any(|pair| pair[1] <= pair[0]) {
        return Err(Error::unusable("the instants do not increase", "sort the rows by time"));
    }
    let steps = steps.clamp(1, MOST_STEPS);
    let (base, n_p) = (Base::new(p), model.context().n_p);
    let around = |t: f64| Env {
        t,
        omega_e: 0.0,
        theta_e: 0.0,
        theta_m: 0.0,
        heating: heating.winding,
        magnet_heating: heating.magnet,
    };
    let first = Env {
        omega_e: begin.omega_m * n_p,
        theta_e: begin.theta_m * n_p,
        theta_m: begin.theta_m,
        ..around(inputs.t[0])
    };
    let (electrical, tau_e) = model.steady_state::<f64, ELECTRICAL_STATES>(p, &base, begin.i, &first);
    let mechanical = model.mechanical_start::<f64, MECHANICAL_STATES>(
        p,
        &base,
        begin.omega_m,
        tau_e,
        inputs.tau_load[0],
        &first,
    );
    let mut state: [f64; STATES] = join(&electrical, first.theta_e, &mechanical);
    let mut columns: [Vec<f64>; 5] = std::array::from_fn(|_| Vec::with_capacity(n));
    for k in 0..n {
        let env = at(&around(inputs.t[k]), &state, n_p, 0.0);
        let (electrical, _) = parts::<f64, ELECTRICAL_STATES, MECHANICAL_STATES, STATES>(&state);
        let now = model.state_current(p, &base, &electrical, &env);
        let seen = [now.i[0], now.i[1], now.tau_e, state[2], env.theta_m];
        if seen.iter().any(|x| !x.is_finite()) {
            return Err(Error::unusable(
                format!("the response does not stay finite: it is lost at t = {} s", inputs.t[k]),
                "check the voltages and the load, or begin at a speed that fits them",
            ));
        }
        columns.iter_mut().zip(seen).for_each(|(column, x)| column.push(x));
        if k + 1 == n || k % ASKED == 0 && monitor.cancelled() {
            break;
        }
        let h = inputs.t[k + 1] - inputs.t[k];
        let taps = [0, 1, 2].map(|back: usize| inputs.v.map(|v| v[k.saturating_sub(back)]));
        let v = model.command(p, &taps, state[2] * n_p * h);
        let tau_load = inputs.tau_load[k];
        for piece in 0..steps {
            state = rk4::step(h / steps as f64, &state, |c, s| {
                let t = inputs.t[k] + (piece as f64 + c) / steps as f64 * h;
                let env = at(&around(t), s, n_p, 0.0);
                let (electrical, mechanical) = parts::<f64, ELECTRICAL_STATES, MECHANICAL_STATES, STATES>(s);
                let tau_e = model.state_current(p, &base, &electrical, &env).tau_e;
                let winding = model.electrical_rhs(p, &base, &electrical, v, &env);
                let rotor = model.mechanical_rhs(p, &base, &mechanical, tau_e, tau_load, &env);
                join(&winding, env.omega_e, &rotor)
            });
        }
    }
    Ok(["i_d", "i_q", "tau_e", "omega_m", "theta_m"].into_iter().zip(columns).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE};
    use crate::monitor::Silent;

    fn run(
        effects: &[EffectId],
        v: [f64; 2],
        tau_load: f64,
        finer: usize,
    ) -> BTreeMap<&'static str, Vec<f64>> {
        let mut p = MACHINE.to_vec();
        p.extend(effects.iter().flat_map(|e| e.info().parameters).map(|x| (x.typical)(&CX)));
        let model = Model::new(CX, effects);
        let t: Vec<f64> = (0..2000).map(|k| f64::from(k) * 1e-3).collect();
        let fill = |x: f64| vec![x; t.len()];
        let (d, q, load) = (fill(v[0]), fill(v[1]), fill(tau_load));
        let inputs = Inputs { t: &t, v: [&d, &q], tau_load: &load };
        let steps = finer * steps(&model, &p, 1e-3);
        respond(&model, &p, inputs, Begin::default(), Heating::default(), steps, &Silent).unwrap()
    }

    #[test]
    fn it_settles_where_torque_and_voltage_balance() {
        let [r_s, l_d, l_q, psi_m, _, b] = MACHINE;
        let out = run(&[], [0.0, 20.0], 0.3, 1);
        let last = |name: &str| *out[name].last().unwrap();
        let (i_d, i_q, omega) = (last("i_d"), last("i_q"), last("omega_m"));
        assert!((last("tau_e") - 0.3 - b * omega).abs() < 1e-3 * 0.3, "{} {omega}", last("tau_e"));
        let omega_e = omega * CX.n_p;
        assert!((r_s * i_q + omega_e * (l_d * i_d + psi_m) - 20.0).abs() < 1e-2);
        assert!((r_s * i_d - omega_e * l_q * i_q).abs() < 1e-2);
    }

    #[test]
    fn finer_steps_change_next_to_nothing() {
        let effects = [EffectId::CoulombFriction, EffectId::SaturationQ, EffectId::TwoMassShaft];
        let (coarse, fine) = (run(&effects, [-2.0, 25.0], 0.3, 1), run(&effects, [-2.0, 25.0], 0.3, 4));
        for name in ["i_d", "i_q", "omega_m"] {
            let largest = fine[name].iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            let away = coarse[name].iter().zip(&fine[name]).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
            assert!(away < 1e-4 * largest, "{name}: {away} of {largest}");
        }
    }

    #[test]
    fn unusable_inputs_are_refused() {
        let model = Model::new(CX, &[]);
        let ask = |t: &[f64], v: &[f64]| {
            let inputs = Inputs { t, v: [v, v], tau_load: v };
            respond(&model, &MACHINE, inputs, Begin::default(), Heating::default(), 1, &Silent).unwrap_err()
        };
        assert!(ask(&[0.0, 1.0], &[1.0]).to_string().contains("unequal"));
        assert!(ask(&[0.0, 0.0], &[1.0, 1.0]).to_string().contains("increase"));
    }
}
