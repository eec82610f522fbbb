//! The winding: current and torque of a flux linkage, and the voltage equation (1) with the effects.

use super::Model;
use crate::base::Base;
use crate::effect::{Drift, Electrical, Env, Field, FieldPoint, Magnet};
use crate::map::Point;
use crate::numerics::real::Real;

/// Magnetic state that belongs to a flux linkage.
#[derive(Debug, Clone, Copy)]
pub struct Magnetic<T> {
    /// Stator current d, q, A.
    pub i: [T; 2],
    /// Motor torque, N·m.
    pub tau_e: T,
    /// ∂i_d/∂λ_d, ∂i_d/∂λ_q, ∂i_q/∂λ_q of the magnetising current, 1/H.
    pub inverse: [T; 3],
}

/// What an electrical state tells by itself, whatever voltage acts.
#[derive(Debug, Clone, Copy)]
pub struct Standing<T> {
    /// Terminal current d, q, A.
    pub i: [T; 2],
    /// Resistance, Ω.
    r_s: T,
    /// Sine and cosine of the electrical angle, if an effect asks for them.
    sin_cos: (T, T),
}

impl Model {
    /// Magnet flux and drift factors now.
    #[inline(always)]
    pub(super) fn sources<T: Real>(
        &self,
        p: &[T],
        base: &Base<T>,
        x: &[T],
        env: &Env<T>,
    ) -> (T, T, Magnet<T>) {
        let mut drift = Drift { r_s: T::one(), psi_m: T::one() };
        for s in &self.slots {
            let x = &x[s.electrical.clone()];
            s.effect.drift(&p[s.parameters.clone()], x, env, &self.context, &mut drift);
        }
        let psi_m = base.psi_m * drift.psi_m;
        let mut magnet = Magnet { flux: [psi_m, T::zero()], slope: [T::zero(); 2] };
        for s in &self.slots {
            s.effect.magnet(&p[s.parameters.clone()], psi_m, env, &self.context, &mut magnet);
        }
        (base.r_s * drift.r_s, psi_m, magnet)
    }

    /// Sine and cosine of the electrical angle if an effect asks for it, else those of zero.
    #[inline(always)]
    pub(super) fn sin_cos<T: Real>(&self, env: &Env<T>) -> (T, T) {
        if self.uses_angle { env.theta_e.sin_cos() } else { (T::zero(), T::one()) }
    }

    /// Magnetising current and torque that belong to the flux linkage `flux`.
    #[inline(always)]
    pub(super) fn magnetic<T: Real>(
        &self,
        p: &[T],
        base: &Base<T>,
        psi_m: T,
        magnet: &Magnet<T>,
        sin_cos: (T, T),
        flux: [T; 2],
    ) -> Magnetic<T> {
        let mut field = Field {
            i: [(flux[0] - magnet.flux[0]) * base.inverse_l_d, (flux[1] - magnet.flux[1]) * base.inverse_l_q],
            slope: T::zero(),
            inverse: [base.inverse_l_d, T::zero(), base.inverse_l_q],
        };
        if !self.slots.is_empty() {
            let at = FieldPoint { flux, magnet: magnet.flux, psi_m, sin_cos };
            for s in &self.slots {
                s.effect.field(&p[s.parameters.clone()], &at, base, &self.context, &mut field);
            }
        }
        let i = field.i;
        let turning = flux[0] * i[1] - flux[1] * i[0];
        let pulling = i[0] * magnet.slope[0] + i[1] * magnet.slope[1] - field.slope;
        Magnetic { i, tau_e: (turning + pulling) * (1.5 * self.context.n_p), inverse: field.inverse }
    }

    /// What bypasses the magnetising branch.
    #[inline(always)]
    pub(super) fn shunt<T: Real>(&self, p: &[T], x: &[T], sin_cos: (T, T)) -> [T; 2] {
        let mut i = [T::zero(); 2];
        for s in &self.slots {
            s.effect.shunt(
                &p[s.parameters.clone()],
                &x[s.electrical.clone()],
                sin_cos,
                &self.context,
                &mut i,
            );
        }
        i
    }

    /// Time derivative of the electrical state `[λ_d, λ_q, extra …]` under the winding voltage command `v`
    /// (d, q, rotor frame), equation (1) with the effects.
    #[inline(always)]
    pub fn electrical_rhs<T: Real, const N: usize>(
        &self,
        p: &[T],
        base: &Base<T>,
        state: &[T; N],
        v: [T; 2],
        env: &Env<T>,
    ) -> [T; N] {
        self.electrical_slope(p, state, &self.standing(p, base, state, env), v, env)
    }

    /// The same where it is known what the state tells.
    #[inline(always)]
    pub fn electrical_slope<T: Real, const N: usize>(
        &self,
        p: &[T],
        state: &[T; N],
        standing: &Standing<T>,
        v: [T; 2],
        env: &Env<T>,
    ) -> [T; N] {
        let (flux, x) = ([state[0], state[1]], &state[2..]);
        let Standing { i, r_s, sin_cos } = *standing;
        let mut derivative = [T::zero(); N];
        let mut lost = [T::zero(); 2];
        let mut at = Electrical { env: *env, sin_cos, i, r_s, v, emf: [T::zero(); 2] };
        for s in &self.slots {
            let own = &p[s.parameters.clone()];
            s.effect.voltage(own, &x[s.electrical.clone()], &at, &self.context, &mut lost);
        }
        if let Some(map) = &self.map {
            let point = Point { env: *env, i, v, tau_e: T::zero() };
            map.voltage(&p[self.mapped.clone()], &point, &mut lost);
        }
        let emf = [v[0] - lost[0] - r_s * i[0], v[1] - lost[1] - r_s * i[1]];
        derivative[0] = emf[0] + env.omega_e * flux[1];
        derivative[1] = emf[1] - env.omega_e * flux[0];
        if self.electrical_count > 0 {
            at.emf = emf;
            for s in &self.slots {
                let range = s.electrical.clone();
                let dx = &mut derivative[2 + range.start..2 + range.end];
                let own = &p[s.parameters.clone()];
                s.effect.electrical_states(own, &x[range], &at, &self.context, dx);
            }
        }
        derivative
    }

    /// Derivative of the magnet's flux linkage (d, q) with respect to the electrical angle in an electrical state
    /// `[λ_d, λ_q, extra …]`, V·s/rad.
    pub fn magnet_slope<T: Real>(&self, p: &[T], base: &Base<T>, state: &[T], env: &Env<T>) -> [T; 2] {
        self.sources(p, base, &state[2..], env).2.slope
    }

    /// Terminal current and torque of an electrical state `[λ_d, λ_q, extra …]`.
    #[inline(always)]
    pub fn state_current<T: Real>(&self, p: &[T], base: &Base<T>, state: &[T], env: &Env<T>) -> Magnetic<T> {
        self.stands(p, base, state, env).0
    }

    /// What an electrical state `[λ_d, λ_q, extra …]` tells by itself.
    #[inline(always)]
    pub fn standing<T: Real>(&self, p: &[T], base: &Base<T>, state: &[T], env: &Env<T>) -> Standing<T> {
        let (Magnetic { i, .. }, r_s, sin_cos) = self.stands(p, base, state, env);
        Standing { i, r_s, sin_cos }
    }

    #[inline(always)]
    fn stands<T: Real>(
        &self,
        p: &[T],
        base: &Base<T>,
        state: &[T],
        env: &Env<T>,
    ) -> (Magnetic<T>, T, (T, T)) {
        let (r_s, psi_m, magnet) = self.sources(p, base, &state[2..], env);
        let sin_cos = self.sin_cos(env);
        let mut out = self.magnetic(p, base, psi_m, &magnet, sin_cos, [state[0], state[1]]);
        if self.electrical_count > 0 {
            let bypass = self.shunt(p, &state[2..], sin_cos);
            out.i = [out.i[0] + bypass[0], out.i[1] + bypass[1]];
        }
        (out, r_s, sin_cos)
    }
}
