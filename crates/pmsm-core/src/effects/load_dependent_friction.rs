//! Friction that grows with the transmitted torque, as in gears and loaded bearings: τ_f = μ·|τ_e|·sgn ω_m.
//!
//! Source: Dohring, Lee & Newman, "A load-dependent transmission friction model", IEEE ICRA (1993) 430.

use crate::effect::{Context, Effect, Info, Mechanical, Parameter, Role, Rotor, Site};
use crate::terms::direction;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct LoadDependentFriction;

impl Effect for LoadDependentFriction {
    const INFO: Info = Info {
        id: "load_dependent_friction",
        title: "Load-dependent friction",
        sentence: "Friction grows with the torque that the drive train transmits.",
        equation: "τ_f = μ·|τ_e|·sgn(ω_m)",
        source: "Dohring, Lee & Newman, IEEE ICRA (1993) 430",
        fingerprint: "Torque against the motion in proportion to the motor's torque",
        look_alikes: &["coulomb_friction", "quadratic_drag"],
        contains: &[],
        site: Site::Mechanical,
        needs: &[],
        parameters: &[Parameter {
            name: "mu",
            unit: "1",
            meaning: "share of the motor torque lost",
            role: Role::Amplitude,
            low: &|_| 0.0,
            high: &|_| 0.6,
            typical: &|_| 0.04,
        }],
    };
    const JUMPS: bool = true;

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], _: &[T], at: &Mechanical<T>, cx: &Context, out: &mut Rotor<T>) {
        out.loss += p[0] * at.tau_e.abs() * direction(at.omega_m, cx);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{close, loss, shaft};

    #[test]
    fn friction_follows_the_size_of_the_torque_against_the_motion() {
        let friction = |w, tau| loss::<LoadDependentFriction>(&[0.05], &shaft(0.0, w, tau));
        for (w, tau, expected) in [(50.0, 4.0, 0.2), (50.0, -4.0, 0.2), (-50.0, 4.0, -0.2), (50.0, 0.0, 0.0)]
        {
            close(friction(w, tau), expected, 1e-12);
        }
    }
}
