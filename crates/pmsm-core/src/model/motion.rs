//! Equation of motion of the rotor with the effects.

use super::{Model, Slot};
use crate::base::Base;
use crate::effect::{Env, Mechanical, Rotor};
use crate::map::Point;
use crate::numerics::real::Real;

impl Model {
    /// Time derivative of the mechanical state `[ω_m, extra …]` under the motor torque `tau_e` and the load
    /// torque `tau_load`, equation (2) with the effects. `env.omega_e` is ignored in favour of the state.
    #[inline(always)]
    pub fn mechanical_rhs<T: Real, const N: usize>(
        &self,
        p: &[T],
        base: &Base<T>,
        state: &[T; N],
        tau_e: T,
        tau_load: T,
        env: &Env<T>,
    ) -> [T; N] {
        let at = self.mechanical_point(base, state[0], tau_e, tau_load, env);
        let x = &state[1..];
        let acceleration = self.acceleration(p, base, x, &at);
        let mut derivative = [T::zero(); N];
        derivative[0] = acceleration;
        for s in &self.slots {
            let range = s.mechanical.clone();
            let dx = &mut derivative[1 + range.start..1 + range.end];
            let own = &p[s.parameters.clone()];
            s.effect.mechanical_states(own, &x[range], &at, acceleration, &self.context, dx);
        }
        derivative
    }

    #[inline(always)]
    fn mechanical_point<T: Real>(
        &self,
        base: &Base<T>,
        omega_m: T,
        tau_e: T,
        tau_load: T,
        env: &Env<T>,
    ) -> Mechanical<T> {
        // Temperatures change the windings and the magnets.
        let omega_e = omega_m * self.context.n_p;
        let env = Env { omega_e, heating: 0.0, magnet_heating: 0.0, ..*env };
        Mechanical { env, omega_m, tau_e, tau_load, j: base.j }
    }

    #[inline(always)]
    fn acceleration<T: Real>(&self, p: &[T], base: &Base<T>, x: &[T], at: &Mechanical<T>) -> T {
        let mut rotor =
            Rotor { inverse_inertia: base.inverse_j, loss: base.b * at.omega_m, load: at.tau_load };
        for s in &self.slots {
            let x = &x[s.mechanical.clone()];
            s.effect.rotor(&p[s.parameters.clone()], x, at, &self.context, &mut rotor);
        }
        rotor.loss += self.mapped_torque(p, at);
        (at.tau_e - rotor.load - rotor.loss) * rotor.inverse_inertia
    }

    /// Torque of the map against positive rotation, N·m; zero without one.
    #[inline(always)]
    pub fn mapped_torque<T: Real>(&self, p: &[T], at: &Mechanical<T>) -> T {
        let Some(map) = &self.map else { return T::zero() };
        let point = Point { env: at.env, i: [T::zero(); 2], v: [T::zero(); 2], tau_e: at.tau_e };
        map.torque(&p[self.mapped.clone()], &point)
    }

    /// Torque of some effects of a model without mechanical states, and of its map if that is asked, too, against positive rotation, N·m.
    #[inline(always)]
    pub fn torque_lost<T: Real>(&self, (effects, map): (&[&Slot], bool), p: &[T], at: &Mechanical<T>) -> T {
        debug_assert_eq!(self.mechanical_states(), 0);
        let mut rotor = Rotor { inverse_inertia: T::one(), loss: T::zero(), load: at.tau_load };
        for s in effects {
            s.effect.rotor(&p[s.parameters.clone()], &[], at, &self.context, &mut rotor);
        }
        if map { rotor.loss + self.mapped_torque(p, at) } else { rotor.loss }
    }

    /// Torque of one effect without mechanical states of its own against positive rotation, N·m.
    pub fn torque_of<T: Real>(&self, slot: &Slot, p: &[T], at: &Mechanical<T>) -> T {
        let mut rotor = Rotor { inverse_inertia: T::one(), loss: T::zero(), load: at.tau_load };
        slot.effect.rotor(&p[slot.parameters.clone()], &[], at, &self.context, &mut rotor);
        rotor.loss
    }

    /// Quasi-static start of the mechanical extra states at mechanical speed `omega_m`.
    #[inline(always)]
    pub fn mechanical_start<T: Real, const N: usize>(
        &self,
        p: &[T],
        base: &Base<T>,
        omega_m: T,
        tau_e: T,
        tau_load: T,
        env: &Env<T>,
    ) -> [T; N] {
        let mut state = [T::zero(); N];
        state[0] = omega_m;
        let at = self.mechanical_point(base, omega_m, tau_e, tau_load, env);
        let rigid = (tau_e - base.b * omega_m - tau_load) * base.inverse_j;
        for s in &self.slots {
            let x = &mut state[1 + s.mechanical.start..1 + s.mechanical.end];
            s.effect.mechanical_start(&p[s.parameters.clone()], &at, rigid, &self.context, x);
        }
        state
    }
}
