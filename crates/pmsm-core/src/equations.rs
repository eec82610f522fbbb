//! The equations of a model as lists of elementary operations, from which programs in other languages are made.
//!
//! The state is λ_d, λ_q (V s), ω_m (rad/s), θ_m (rad) and the own states of effects; the electrical angle is n_p·θ_m. Inputs are the voltage
//! d, q (V) in the rotor's frame and the load torque (N·m). The programs run the same code as every simulation of this crate, on
//! [`crate::numerics::symbolic::Symbol`].

use crate::base::Base;
use crate::effect::Env;
use crate::effects::{ELECTRICAL_STATES, MECHANICAL_STATES};
use crate::model::Model;
use crate::numerics::real::Real;
use crate::numerics::symbolic::{Program, Symbol, trace};
use crate::simulate::response::{self, Heating};
use serde::Serialize;

/// All programs of a model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Equations {
    /// Pole pairs.
    pub n_p: f64,
    /// Sample period of the recording that the model was found on, s.
    pub period: f64,
    /// Runge–Kutta steps in such a period, see [`response::steps`].
    pub steps: usize,
    /// Names of the states.
    pub states: Vec<String>,
    /// From i_d, i_q (A), ω_m, θ_m, τ_load and t to the steady state with that current.
    pub start: Program,
    /// From t, the state, v_d, v_q and τ_load to the time derivative of each state.
    pub derivative: Program,
    /// From t and the state to i_d, i_q (A), τ_e (N·m), ω_e, θ_e, and what the sensors show of current and angle.
    pub output: Program,
    /// From the commanded voltages (d, q) of this interval and the two before, each in its own rotor frame, and the electrical angle per
    /// interval to the voltage that acts.
    pub command: Program,
    /// From ω_m, θ_m, τ_e and t to the torque that friction, drag and torques over the angle take away beyond b·ω_m, effect by effect;
    /// effects with states of their own are not in it.
    pub torque: Program,
    /// From λ_d, λ_q and θ_m to i_d, i_q and τ_e: the flux map.
    pub flux: Program,
}

impl Equations {
    /// Those of a model with its parameter vector.
    pub fn of(model: &Model, p: &[f64], heating: Heating) -> Self {
        let shape = Shape { model, p, heating, states: states(model) };
        Self {
            n_p: model.context().n_p,
            period: model.context().period,
            steps: response::steps(model, p, model.context().period),
            start: shape.start(),
            derivative: shape.derivative(),
            output: shape.output(),
            command: shape.command(),
            torque: shape.torque(),
            flux: shape.flux(),
            states: shape.states,
        }
    }
}

/// Names of the states: of the winding, of the rotor, then those of effects.
fn states(model: &Model) -> Vec<String> {
    let mut names: Vec<String> = ["lambda_d", "lambda_q", "omega_m", "theta_m"].map(String::from).into();
    for electrical in [true, false] {
        for slot in model.slots() {
            let own = if electrical { &slot.electrical } else { &slot.mechanical };
            names.extend((1..=own.len()).map(|k| match own.len() {
                1 => format!("{}_state", slot.effect.id()),
                _ => format!("{}_state_{k}", slot.effect.id()),
            }));
        }
    }
    names
}

/// A model that is being written down.
struct Shape<'a> {
    model: &'a Model,
    p: &'a [f64],
    heating: Heating,
    states: Vec<String>,
}

impl Shape<'_> {
    fn parameters(&self) -> (Vec<Symbol>, Base<Symbol>) {
        let p: Vec<Symbol> = self.p.iter().map(|x| Symbol::constant(*x)).collect();
        // Reciprocals are those of the numbers, as simulations have them.
        let base = Base::new(&p);
        (p, base)
    }

    fn env(&self, t: Symbol, omega_m: Symbol, theta_m: Symbol) -> Env<Symbol> {
        let n_p = self.model.context().n_p;
        Env {
            t,
            omega_e: omega_m * n_p,
            theta_e: theta_m * n_p,
            theta_m,
            heating: self.heating.winding,
            magnet_heating: self.heating.magnet,
        }
    }

    /// The electrical and the mechanical part of a state.
    fn parts(&self, x: &[Symbol]) -> ([Symbol; ELECTRICAL_STATES], [Symbol; MECHANICAL_STATES]) {
        let own = self.model.electrical_states();
        let mut electrical = [Symbol::zero(); ELECTRICAL_STATES];
        let mut mechanical = [Symbol::zero(); MECHANICAL_STATES];
        electrical[..2].copy_from_slice(&x[..2]);
        electrical[2..2 + own].copy_from_slice(&x[4..4 + own]);
        mechanical[0] = x[2];
        let rest = &x[4 + own..];
        mechanical[1..=rest.len()].copy_from_slice(rest);
        (electrical, mechanical)
    }

    fn joined(&self, electrical: &[Symbol], angle: Symbol, mechanical: &[Symbol]) -> Vec<Symbol> {
        let mut all = vec![electrical[0], electrical[1], mechanical[0], angle];
        all.extend(&electrical[2..2 + self.model.electrical_states()]);
        all.extend(&mechanical[1..=self.model.mechanical_states()]);
        all
    }

    /// The names of the states with these numbers.
    fn named(&self, x: Vec<Symbol>) -> Vec<(String, Symbol)> {
        self.states.iter().cloned().zip(x).collect()
    }

    fn inputs(&self, behind: &[&str]) -> Vec<String> {
        let states = self.states.iter().map(String::as_str);
        std::iter::once("t").chain(states).chain(behind.iter().copied()).map(String::from).collect()
    }

    fn start(&self) -> Program {
        trace(list(&["i_d", "i_q", "omega_m", "theta_m", "tau_load", "t"]), |x| {
            let (p, base) = self.parameters();
            let [i_d, i_q, omega_m, theta_m, tau_load, t] = [x[0], x[1], x[2], x[3], x[4], x[5]];
            let env = self.env(t, omega_m, theta_m);
            let (electrical, tau_e) =
                self.model.steady_state::<Symbol, ELECTRICAL_STATES>(&p, &base, [i_d, i_q], &env);
            let mechanical = self
                .model
                .mechanical_start::<Symbol, MECHANICAL_STATES>(&p, &base, omega_m, tau_e, tau_load, &env);
            self.named(self.joined(&electrical, theta_m, &mechanical))
        })
    }

    fn derivative(&self) -> Program {
        trace(self.inputs(&["v_d", "v_q", "tau_load"]), |x| {
            let (p, base) = self.parameters();
            let last = x.len() - 3;
            let (v, tau_load) = ([x[last], x[last + 1]], x[last + 2]);
            let (electrical, mechanical) = self.parts(&x[1..last]);
            let env = self.env(x[0], x[3], x[4]);
            let tau_e = self.model.state_current(&p, &base, &electrical, &env).tau_e;
            let winding = self.model.electrical_rhs(&p, &base, &electrical, v, &env);
            let rotor = self.model.mechanical_rhs(&p, &base, &mechanical, tau_e, tau_load, &env);
            self.named(self.joined(&winding, x[3], &rotor))
        })
    }

    fn output(&self) -> Program {
        trace(self.inputs(&[]), |x| {
            let (p, base) = self.parameters();
            let (electrical, _) = self.parts(&x[1..]);
            let env = self.env(x[0], x[3], x[4]);
            let now = self.model.state_current(&p, &base, &electrical, &env);
            // The sensor's errors belong to the measured angle, which differs from the true one by a small error of its own.
            let first = self.model.sensor(&p, &env);
            let near = self.seen(&env, first.angle);
            let sensor = self.model.sensor(&p, &near);
            let seen = self.seen(&env, sensor.angle);
            let shown = self.model.measured_current(&sensor, now.i, seen.theta_e);
            let all = [
                ("i_d", now.i[0]),
                ("i_q", now.i[1]),
                ("tau_e", now.tau_e),
                ("omega_e", env.omega_e),
                ("theta_e", env.theta_e),
                ("i_d_shown", if self.model.has_sensor() { shown[0] } else { now.i[0] }),
                ("i_q_shown", if self.model.has_sensor() { shown[1] } else { now.i[1] }),
                ("theta_e_shown", seen.theta_e),
            ];
            all.map(|(name, value)| (name.to_string(), value)).into()
        })
    }

    /// What an angle sensor with this error shows.
    fn seen(&self, env: &Env<Symbol>, error: Symbol) -> Env<Symbol> {
        let n_p = self.model.context().n_p;
        Env { theta_e: env.theta_e + error, theta_m: env.theta_m + error * (1.0 / n_p), ..*env }
    }

    fn command(&self) -> Program {
        let taps = ["v_d", "v_q", "v_d_1", "v_q_1", "v_d_2", "v_q_2", "turn"];
        trace(list(&taps), |x| {
            let (p, _) = self.parameters();
            let v = self.model.command(&p, &[[x[0], x[1]], [x[2], x[3]], [x[4], x[5]]], x[6]);
            vec![("v_d".into(), v[0]), ("v_q".into(), v[1])]
        })
    }

    fn torque(&self) -> Program {
        trace(list(&["omega_m", "theta_m", "tau_e", "t"]), |x| {
            let (p, base) = self.parameters();
            let env = self.env(x[3], x[0], x[1]);
            let at = crate::effect::Mechanical {
                env: Env { heating: 0.0, magnet_heating: 0.0, ..env },
                omega_m: x[0],
                tau_e: x[2],
                tau_load: Symbol::zero(),
                j: base.j,
            };
            let mut all = Vec::new();
            for slot in self.model.slots().iter().filter(|s| s.mechanical.is_empty()) {
                let lost = self.model.torque_of(slot, &p, &at);
                all.push((slot.effect.id().to_string(), lost));
            }
            if self.model.map().is_some() {
                all.push(("unmodelled".into(), self.model.mapped_torque(&p, &at)));
            }
            all
        })
    }

    fn flux(&self) -> Program {
        trace(list(&["lambda_d", "lambda_q", "theta_m"]), |x| {
            let (p, base) = self.parameters();
            let env = self.env(Symbol::zero(), Symbol::zero(), x[2]);
            let mut state = [Symbol::zero(); ELECTRICAL_STATES];
            (state[0], state[1]) = (x[0], x[1]);
            let now = self.model.state_current(&p, &base, &state, &env);
            let all = [("i_d", now.i[0]), ("i_q", now.i[1]), ("tau_e", now.tau_e)];
            all.map(|(name, value)| (name.to_string(), value)).into()
        })
    }
}

fn list(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_string()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, MACHINE};
    use crate::effects::{ALL, EffectId};

    fn typical(effects: &[EffectId]) -> (Model, Vec<f64>) {
        let mut p = MACHINE.to_vec();
        p.extend(effects.iter().flat_map(|e| e.info().parameters).map(|x| (x.typical)(&CX)));
        (Model::new(CX, effects), p)
    }

    /// The derivative by the model itself, in the order of the program.
    fn direct(model: &Model, p: &[f64], x: &[f64], v: [f64; 2], tau_load: f64) -> Vec<f64> {
        let n_p = model.context().n_p;
        let env = Env {
            t: 0.3,
            omega_e: x[2] * n_p,
            theta_e: x[3] * n_p,
            theta_m: x[3],
            heating: 0.0,
            magnet_heating: 0.0,
        };
        let own = model.electrical_states();
        let (mut electrical, mut mechanical) = ([0.0; ELECTRICAL_STATES], [0.0; MECHANICAL_STATES]);
        electrical[..2].copy_from_slice(&x[..2]);
        electrical[2..2 + own].copy_from_slice(&x[4..4 + own]);
        mechanical[0] = x[2];
        mechanical[1..=model.mechanical_states()].copy_from_slice(&x[4 + own..]);
        let base = Base::new(p);
        let tau_e = model.state_current(p, &base, &electrical, &env).tau_e;
        let winding = model.electrical_rhs(p, &base, &electrical, v, &env);
        let rotor = model.mechanical_rhs(p, &base, &mechanical, tau_e, tau_load, &env);
        let mut all = vec![winding[0], winding[1], rotor[0], x[2]];
        all.extend(&winding[2..2 + own]);
        all.extend(&rotor[1..=model.mechanical_states()]);
        all
    }

    #[test]
    fn programs_have_the_numbers_of_the_model_for_every_effect() {
        let sets = ALL.iter().map(|e| vec![*e]).chain([
            vec![EffectId::DeadTime, EffectId::SaturationQ, EffectId::CoulombFriction],
            vec![EffectId::TwoMassShaft, EffectId::IronLoss, EffectId::RsThermalDrift],
        ]);
        for effects in sets {
            let (model, p) = typical(&effects);
            let equations = Equations::of(&model, &p, Heating::default());
            let begin = equations.start.run(&[1.5, 3.0, 40.0, 0.7, 0.4, 0.3]);
            assert_eq!(begin.len(), equations.states.len());
            let mut inputs = vec![0.3];
            inputs.extend(&begin);
            inputs.extend([9.0, 31.0, 0.4]);
            let got = equations.derivative.run(&inputs);
            let expected = direct(&model, &p, &begin, [9.0, 31.0], 0.4);
            for ((name, a), b) in equations.states.iter().zip(&got).zip(&expected) {
                assert!((a - b).abs() <= 1e-12 * b.abs().max(1e-9), "{effects:?} {name}: {a} {b}");
            }
            // The start has the current that was asked for.
            inputs.truncate(begin.len() + 1);
            let shown = equations.output.run(&inputs);
            assert!((shown[0] - 1.5).abs() < 1e-6 && (shown[1] - 3.0).abs() < 1e-6, "{effects:?} {shown:?}");
            // Without a delay the voltage that acts is that which was commanded.
            if effects.iter().all(|e| e.info().site == crate::effect::Site::Mechanical) {
                assert_eq!(equations.command.run(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.1]), [1.0, 2.0]);
            }
        }
    }

    #[test]
    fn a_program_is_short_and_holds_no_effect_that_is_not_in_the_model() {
        let (model, p) = typical(&[]);
        let bare = Equations::of(&model, &p, Heating::default());
        assert_eq!(bare.states, ["lambda_d", "lambda_q", "omega_m", "theta_m"]);
        assert!(bare.derivative.operations.len() < 45, "{}", bare.derivative.operations.len());
        assert!(bare.torque.outputs.is_empty());
        let (model, p) = typical(&[EffectId::CoulombFriction, EffectId::TwoMassShaft]);
        let with = Equations::of(&model, &p, Heating::default());
        assert_eq!(with.torque.outputs.len(), 1);
        assert!(with.states.len() > 4 && with.states[4].starts_with("two_mass_shaft"), "{:?}", with.states);
    }
}
