//! The machine under the inverter: the model's coupled equations, advanced over pieces of constant voltage.

use super::inverter::Applied;
use crate::base::Base;
use crate::effect::Env;
use crate::model::{Magnetic, Model};
use crate::numerics::real::Real;
use crate::numerics::rk4;
use crate::numerics::transforms::rotate;
use crate::simulate::coupled::{FINER, STEP_LIMIT, at, join, parts};

/// The state λ_d, λ_q, ω_m, θ_e, electrical extras (E − 2), mechanical extras (M − 1): N = E + M + 1.
pub(super) struct Plant<'a, const E: usize, const M: usize, const N: usize> {
    model: &'a Model,
    p: &'a [f64],
    n_p: f64,
    /// Mechanical minus electrical angle over n_p.
    turn: f64,
    locked: bool,
    substeps: usize,
    state: [f64; N],
}

impl<'a, const E: usize, const M: usize, const N: usize> Plant<'a, E, M, N> {
    /// Without current, at the angle and speed of `start`.
    pub fn new(
        model: &'a Model,
        p: &'a [f64],
        start: &Env<f64>,
        tau_load: f64,
        locked: bool,
        substeps: usize,
    ) -> Self {
        let (n_p, base) = (model.context().n_p, Base::new(p));
        let (electrical, tau_e) = model.steady_state::<f64, E>(p, &base, [0.0; 2], start);
        let omega_m = start.omega_e / n_p;
        let mechanical = model.mechanical_start::<f64, M>(p, &base, omega_m, tau_e, tau_load, start);
        let state = join(&electrical, start.theta_e, &mechanical);
        Self { model, p, n_p, turn: start.theta_m - start.theta_e / n_p, locked, substeps, state }
    }

    /// Where the machine is now, at the time and temperatures of `around`.
    pub fn env(&self, around: &Env<f64>) -> Env<f64> {
        at(around, &self.state, self.n_p, self.turn)
    }

    /// Current and torque now.
    pub fn magnetic(&self, base: &Base<f64>, env: &Env<f64>) -> Magnetic<f64> {
        self.model.state_current(self.p, base, &parts::<f64, E, M, N>(&self.state).0, env)
    }

    /// Advances by `h` seconds from the time of `around`.
    pub fn advance(&mut self, base: &Base<f64>, around: &Env<f64>, h: f64, applied: Applied, tau_load: f64) {
        let context = self.model.context();
        let mut rate = (self.state[2] * self.n_p).abs() + context.electrical_rate;
        if E > 2 {
            rate *= FINER;
        }
        let pieces = ((h * rate / STEP_LIMIT).ceil() as usize).clamp(self.substeps, 4096);
        let (model, p, n_p, turn, locked) = (self.model, self.p, self.n_p, self.turn, self.locked);
        for piece in 0..pieces {
            self.state = rk4::step(h / pieces as f64, &self.state, |c, s| {
                let now = Env { t: around.t + (piece as f64 + c) / pieces as f64 * h, ..*around };
                let env = at(&now, s, n_p, turn);
                let v = match applied {
                    Applied::Rotor(v) => v,
                    Applied::Stator(v) => {
                        let (sin, cos) = Real::sin_cos(env.theta_e);
                        rotate(v, cos, -sin)
                    }
                };
                let (electrical, mechanical) = parts::<f64, E, M, N>(s);
                let slope = model.electrical_rhs(p, base, &electrical, v, &env);
                if locked {
                    return join(&slope, 0.0, &[0.0; M]);
                }
                let tau_e = model.state_current(p, base, &electrical, &env).tau_e;
                let motion = model.mechanical_rhs(p, base, &mechanical, tau_e, tau_load, &env);
                join(&slope, env.omega_e, &motion)
            });
        }
    }

    /// Whether every state is still a number.
    pub fn is_finite(&self) -> bool {
        self.state.iter().all(|x| x.is_finite())
    }
}
