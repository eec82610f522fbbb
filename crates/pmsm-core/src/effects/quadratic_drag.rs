//! Fan or windage torque: τ_f = k·ω_m·|ω_m|.
//!
//! Source: turbulent drag of a disc and of a fan at fixed geometry; Saari, "Thermal analysis of high-speed induction
//! machines" (1998), section 3.

use crate::effect::{Context, Effect, Info, Mechanical, Parameter, Role, Rotor, Site};
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct QuadraticDrag;

impl Effect for QuadraticDrag {
    const INFO: Info = Info {
        id: "quadratic_drag",
        title: "Quadratic drag",
        sentence: "A fan or windage torque grows with the square of speed.",
        equation: "τ_f = k·ω_m·|ω_m|",
        source: "Saari, Thermal analysis of high-speed induction machines (1998)",
        fingerprint: "Torque odd in speed, growing with its square",
        look_alikes: &["time_varying_load", "iron_loss", "asymmetric_friction"],
        contains: &[],
        site: Site::Mechanical,
        needs: &[],
        parameters: &[Parameter {
            name: "k",
            unit: "N m s^2",
            meaning: "drag torque per squared mechanical speed",
            role: Role::Amplitude,
            low: &|_| 0.0,
            high: &|cx| 4.0 * cx.tau_max / cx.omega_m_max().powi(2),
            typical: &|cx| 0.05 * cx.tau_max / cx.omega_m_max().powi(2),
        }],
    };
    const FORM: f64 = 0.02;

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], _: &[T], at: &Mechanical<T>, _: &Context, out: &mut Rotor<T>) {
        out.loss += p[0] * (at.omega_m * at.omega_m.abs());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{close, loss, shaft};

    #[test]
    fn drag_is_odd_and_four_times_at_twice_the_speed() {
        let drag = |w| loss::<QuadraticDrag>(&[2e-4], &shaft(0.0, w, 0.0));
        close(drag(100.0), 2.0, 1e-14);
        close(drag(-100.0), -2.0, 1e-14);
        close(drag(200.0), 8.0, 1e-14);
    }
}
