//! Friction that differs by direction: τ_f = τ_a·|sgn ω_m| + b_a·|ω_m|, the even part that a symmetric friction law
//! cannot have. With Coulomb and viscous friction beside it, b± = b ± b_a and τ_c± = τ_c ± τ_a.
//!
//! Source: Janot, Gautier & Brunot, "Data set and reference models of EMPS" (2019).

use crate::effect::{Context, Effect, Info, Mechanical, Parameter, Role, Rotor, Site};
use crate::terms::direction;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct AsymmetricFriction;

impl Effect for AsymmetricFriction {
    const INFO: Info = Info {
        id: "asymmetric_friction",
        title: "Asymmetric friction",
        sentence: "Friction is stronger in one direction of rotation than in the other.",
        equation: "τ_f = τ_a·|sgn ω_m| + b_a·|ω_m|",
        source: "Janot, Gautier & Brunot, EMPS benchmark (2019)",
        fingerprint: "Torque even in speed; vanishes at standstill, unlike a constant load",
        look_alikes: &["time_varying_load", "quadratic_drag"],
        contains: &[],
        site: Site::Mechanical,
        needs: &[],
        parameters: &[
            Parameter {
                name: "b_a",
                unit: "N m s",
                meaning: "half the difference of viscous friction between forward and backward",
                role: Role::Amplitude,
                low: &|cx| -cx.tau_max / cx.omega_m_max(),
                high: &|cx| cx.tau_max / cx.omega_m_max(),
                typical: &|cx| 0.01 * cx.tau_max / cx.omega_m_max(),
            },
            Parameter {
                name: "tau_a",
                unit: "N m",
                meaning: "half the difference of Coulomb friction between forward and backward",
                role: Role::Amplitude,
                low: &|cx| -cx.tau_max,
                high: &|cx| cx.tau_max,
                typical: &|cx| 0.005 * cx.tau_max,
            },
        ],
    };
    const JUMPS: bool = true;
    const REFINES: Option<&'static str> = Some("coulomb_friction");

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], _: &[T], at: &Mechanical<T>, cx: &Context, out: &mut Rotor<T>) {
        let sign = direction(at.omega_m, cx);
        out.loss += p[0] * (at.omega_m * sign) + p[1] * sign.squared();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{close, loss, shaft};

    #[test]
    fn forward_friction_grows_by_what_backward_friction_loses() {
        let friction = |w: f64| loss::<AsymmetricFriction>(&[0.01, 0.2], &shaft(0.0, w, 0.0));
        close(friction(50.0), 0.2 + 0.5, 1e-12);
        // Turning backwards the same torque helps the motion along.
        close(friction(-50.0), 0.2 + 0.5, 1e-12);
        close(friction(0.0), 0.0, 0.0);
    }
}
