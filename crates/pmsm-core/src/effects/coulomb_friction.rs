//! Coulomb friction: τ_f = τ_c·sgn ω_m, a constant torque against the motion.
//!
//! The sign turns over smoothly around standstill, τ_c·tanh(ω_m/ω_0): presliding, and stiction itself, are below what a
//! speed signal resolves. Source: Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083.

use crate::effect::{Context, Effect, Info, Mechanical, Parameter, Role, Rotor, Site};
use crate::numerics::real::Real;
use crate::terms::{SMOOTHING};

/// See the module's documentation.
pub struct CoulombFriction;

impl Effect for CoulombFriction {
    const INFO: Info = Info {
        id: "coulomb_friction",
        title: "Coulomb friction",
        sentence: "A constant friction torque acts against the motion and turns over with its direction.",
        equation: "τ_f = τ_c·sgn(ω_m)",
        source: "Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083",
        fingerprint: "Torque odd in speed, a step at every reversal, independent of speed otherwise",
        look_alikes: &["stribeck_friction", "load_dependent_friction", "asymmetric_friction"],
        contains: &[],
        site: Site::Mechanical,
        needs: &[],
        parameters: &[
            Parameter {
                name: "tau_c",
                unit: "N m",
                meaning: "friction torque at any speed",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|cx| cx.tau_max,
                typical: &|cx| 0.02 * cx.tau_max,
            },
            Parameter {
                name: "w_0",
                unit: "rad/s",
                meaning: "mechanical speed over which the friction turns over",
                role: Role::Shape,
                low: &|cx| 2e-4 * cx.omega_m_max(),
                high: &|cx| 0.02 * cx.omega_m_max(),
                typical: &|cx| SMOOTHING * cx.omega_m_max(),
            },
        ],
    };
    const JUMPS: bool = true;

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], _: &[T], at: &Mechanical<T>, _: &Context, out: &mut Rotor<T>) {
        out.loss += p[0] * (at.omega_m / p[1]).tanh();
    }
}

#[cfg(test)]
mod tests {
    use crate::terms::direction;
    use super::*;
    use crate::effects::testing::{CX, close, loss, shaft};

    #[test]
    fn torque_is_constant_against_the_motion_and_turns_over_at_standstill() {
        let friction = |w: f64| loss::<CoulombFriction>(&[0.3, 0.4], &shaft(0.0, w, 0.0));
        for (w, expected) in [(100.0, 0.3), (5.0, 0.3), (-5.0, -0.3), (0.0, 0.0), (0.4, 0.3 * 1f64.tanh())] {
            close(friction(w), expected, 1e-9);
        }
    }

    #[test]
    fn direction_is_a_sign_beyond_a_hundredth_of_the_top_speed() {
        close(direction(0.01 * CX.omega_m_max(), &CX), 1.0, 1e-4);
        close(direction(-CX.omega_m_max(), &CX), -1.0, 0.0);
    }
}
