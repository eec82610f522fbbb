//! The electrical state in which nothing changes but what is slow: where simulations begin, and between samples that are far
//! apart.

use super::Model;
use crate::base::Base;
use crate::effect::{Electrical, Env};
use crate::effects::ELECTRICAL_STATES;
use crate::numerics::real::Real;

/// Newton's steps at most.
const STEPS: usize = 6;
/// Error (share of the largest current) from which Newton's method needs one more step.
const NEAR: f64 = 1e-9;

/// What is known of a state beforehand.
#[derive(Debug, Clone, Copy)]
pub struct Known<T> {
    /// Induced voltage (d, q), V, which puts the extra states where they are; else it is that of a flux that stands still in the rotor.
    pub emf: Option<[T; 2]>,
    /// Flux linkage (d, q), V s, from which Newton's method begins where it is needed; else it is the bare machine's.
    pub flux: Option<[T; 2]>,
}

impl<T> Default for Known<T> {
    fn default() -> Self {
        Self { emf: None, flux: None }
    }
}

impl Model {
    /// The steady electrical state that belongs to a terminal current, and its torque: flux linkage by Newton's method on the
    /// energy's gradient, extra states at their quasi-static start.
    #[inline(always)]
    pub fn steady_state<T: Real, const N: usize>(
        &self,
        p: &[T],
        base: &Base<T>,
        i: [T; 2],
        env: &Env<T>,
    ) -> ([T; N], T) {
        let mut state = [T::zero(); N];
        let tau_e = self.state_under(p, base, i, Known::default(), &mut state, env);
        (state, tau_e)
    }

    /// What of a state belongs to temperatures; the rest is zero.
    pub fn temperatures<T: Real, const N: usize>(&self, state: &[T; N]) -> [T; N] {
        let mut out = [T::zero(); N];
        for s in self.slots.iter().filter(|s| s.effect.is_thermal()) {
            let range = 2 + s.electrical.start..2 + s.electrical.end;
            out[range.clone()].copy_from_slice(&state[range]);
        }
        out
    }

    /// Whether the torque of given currents depends on temperatures that an effect follows.
    pub fn warms(&self) -> bool {
        self.slots.iter().any(|s| s.effect.is_thermal() && (s.effect.turns() || self.bypassed))
    }

    /// Lets the temperatures among `state` go on for `h` seconds at the terminal current `i` (d, q).
    #[inline(always)]
    pub fn warm<T: Real>(&self, p: &[T], base: &Base<T>, state: &mut [T], i: [T; 2], h: f64, env: &Env<T>) {
        let (r_s, _, _) = self.sources(p, base, &state[2..], env);
        let zero = [T::zero(); 2];
        let at = Electrical { env: *env, sin_cos: (T::zero(), T::one()), i, r_s, v: zero, emf: zero };
        for s in self.slots.iter().filter(|s| s.effect.is_thermal()) {
            let range = 2 + s.electrical.start..2 + s.electrical.end;
            let mut rate = [T::zero(); ELECTRICAL_STATES];
            let own = &p[s.parameters.clone()];
            let rate = &mut rate[..range.len()];
            s.effect.electrical_states(own, &state[range.clone()], &at, &self.context, rate);
            for (x, dx) in state[range].iter_mut().zip(rate.iter()) {
                *x += *dx * h;
            }
        }
    }

    /// As [`Model::steady_state`], but with what is `known`, and with the temperatures of `state`, which becomes the one looked for;
    /// returns its torque.
    #[inline(always)]
    pub fn state_under<T: Real>(
        &self,
        p: &[T],
        base: &Base<T>,
        i: [T; 2],
        known: Known<T>,
        state: &mut [T],
        env: &Env<T>,
    ) -> T {
        let (r_s, psi_m, magnet) = self.sources(p, base, &state[2..], env);
        let sin_cos = self.sin_cos(env);
        let unsaturated = [magnet.flux[0] + base.l_d * i[0], magnet.flux[1] + base.l_q * i[1]];
        let mut flux = known.flux.filter(|_| self.is_magnetic).unwrap_or(unsaturated);
        // Each of several machines side by side stops by itself.
        let (mut open, mut step) = (T::one(), 0);
        // In one loop with the last look, so that the long equations of the field are compiled once.
        let tau_e = loop {
            let at = self.magnetic(p, base, psi_m, &magnet, sin_cos, flux);
            if !self.is_magnetic || step == STEPS || open.size() == 0.0 {
                break at.tau_e;
            }
            let emf = known.emf.unwrap_or([-env.omega_e * flux[1], env.omega_e * flux[0]]);
            let winding = Electrical { env: *env, sin_cos, i, r_s, v: [T::zero(); 2], emf };
            for s in &self.slots {
                let x = &mut state[2 + s.electrical.start..2 + s.electrical.end];
                s.effect.electrical_start(&p[s.parameters.clone()], &winding, &self.context, x);
            }
            let bypass = self.shunt(p, &state[2..], sin_cos);
            let (e_d, e_q) = (i[0] - bypass[0] - at.i[0], i[1] - bypass[1] - at.i[1]);
            let [a, b, c] = at.inverse;
            let determinant = a * c - b * b;
            flux[0] += open * ((c * e_d - b * e_q) / determinant);
            flux[1] += open * ((a * e_q - b * e_d) / determinant);
            step += 1;
            // From so near, a step is exact, in the derivatives as well, unless states follow the flux.
            if !self.bypassed {
                let near = T::constant(NEAR * self.context.i_max) - (e_d.abs() + e_q.abs());
                open = near.if_positive(T::zero(), open);
            }
        };
        (state[0], state[1]) = (flux[0], flux[1]);
        tau_e
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, env};
    use crate::numerics::dual::Dual;

    #[test]
    fn the_state_of_a_current_has_that_current_and_so_have_its_derivatives() {
        for (effect, own) in [
            (EffectId::SaturationD, vec![0.0, 2.0, 0.9]),
            (EffectId::SaturationD, vec![0.4, 2.0, 0.9]),
            (EffectId::SaturationQ, vec![0.5, 4.0]),
            (EffectId::CrossSaturation, vec![-0.1, 0.2]),
        ] {
            let model = Model::new(CX, &[effect]);
            let all: Vec<f64> = MACHINE.iter().chain(&own).copied().collect();
            for by in 0..all.len() {
                // The derivative with respect to the relative change of this parameter.
                let mut p: Vec<Dual<1>> = all.iter().map(|x| Dual::constant(*x)).collect();
                p[by].eps[0] = if all[by] == 0.0 { 1.0 } else { all[by] };
                let (base, env) = (Base::new(&p), env(0.7, 300.0));
                let env = Env {
                    t: Dual::constant(env.t),
                    omega_e: Dual::constant(env.omega_e),
                    theta_e: Dual::constant(env.theta_e),
                    theta_m: Dual::constant(env.theta_m),
                    heating: env.heating,
                    magnet_heating: env.magnet_heating,
                };
                let wanted = [-3.0, 5.0];
                let (state, _): ([Dual<1>; 2], _) =
                    model.steady_state(&p, &base, wanted.map(Dual::constant), &env);
                let shown = model.state_current(&p, &base, &state, &env).i;
                for axis in 0..2 {
                    assert!((shown[axis].re - wanted[axis]).abs() < 1e-12, "{effect:?} {:?}", shown[axis]);
                    assert!(shown[axis].eps[0].abs() < 1e-9, "{effect:?}, {by}: {:?}", shown[axis]);
                }
            }
        }
    }
}
