//! Friction that grows with speed ever less: τ_f = k·|ω_m|^α·sgn ω_m with 0 < α < 1, as of a film of grease or of a full film whose
//! viscosity falls as it warms. Around standstill the power turns over smoothly.
//!
//! The strength is the torque at a reference speed well inside the recording: there strength and exponent are told apart best.
//! Source: Simoni, Beschi, Legnani & Visioli, IFAC-PapersOnLine 50 (2017) 4235; the root of the speed: Hamrock, Schmid & Jacobson,
//! Fundamentals of Fluid Film Lubrication, 2nd ed. (2004).

use crate::base::Base;
use crate::effect::{Context, Derived, Effect, Info, Mechanical, Output, Parameter, Role, Rotor, Site};
use crate::real::Real;
use crate::terms::SMOOTHING;

/// See the module's documentation.
pub struct ConcaveFriction;

/// Least exponent: from a tenth of the speed to all of it friction grows by three quarters. What grows less is dry friction by any name.
const LEAST: f64 = 0.25;
/// Reference speed, share of the top speed.
const REFERENCE: f64 = 0.5;

impl Effect for ConcaveFriction {
    const INFO: Info = Info {
        id: "concave_friction",
        title: "Concave friction",
        sentence: "Friction grows with speed, but ever less: grease or a full film of oil.",
        equation: "τ_f = k·|ω_m|^α·sgn(ω_m), 0 < α < 1",
        source: "Hamrock, Schmid & Jacobson, Fundamentals of Fluid Film Lubrication, 2nd ed. (2004)",
        fingerprint: "Torque odd in speed, steep around standstill and flat at high speed",
        look_alikes: &["coulomb_friction", "stribeck_friction"],
        contains: &[],
        site: Site::Mechanical,
        needs: &[],
        parameters: &[
            Parameter {
                name: "tau_r",
                unit: "N m",
                meaning: "friction torque at the reference speed w_r",
                role: Role::Amplitude,
                low: |_| 0.0,
                high: |cx| cx.tau_max,
                typical: |cx| 0.02 * cx.tau_max,
            },
            Parameter {
                name: "alpha",
                unit: "1",
                meaning: "exponent of the speed: friction is constant at 0 and viscous at 1",
                role: Role::Shape,
                low: |_| LEAST,
                high: |_| 0.9,
                typical: |_| 0.5,
            },
            Parameter {
                name: "w_r",
                unit: "rad/s",
                meaning: "mechanical reference speed",
                role: Role::Fixed,
                low: |_| 0.0,
                high: |cx| cx.omega_m_max(),
                typical: |cx| REFERENCE * cx.omega_m_max(),
            },
        ],
    };
    const JUMPS: bool = true;
    const DERIVED: &'static [Derived] =
        &[("k", "N m (s/rad)^alpha", "friction torque at 1 rad/s, mechanical")];

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        [0.3, 0.5, 0.75].map(|alpha| vec![0.0, alpha, REFERENCE * cx.omega_m_max()]).to_vec()
    }

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], _: &[T], at: &Mechanical<T>, cx: &Context, out: &mut Rotor<T>) {
        let turns_over = (SMOOTHING * cx.omega_m_max()).powi(2);
        let speed = (at.omega_m.squared() + turns_over).sqrt();
        out.loss += p[0] * (at.omega_m / speed) * (speed / p[2]).pow_nonnegative(p[1]);
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        let k = p[0] * (T::one() / p[2]).pow_nonnegative(p[1]);
        vec![("k", "N m (s/rad)^alpha", k), ("alpha", "1", p[1])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, base, close, loss, shaft};

    #[test]
    fn friction_grows_with_a_power_of_the_speed_against_the_motion() {
        let p = [0.2, 0.5, 100.0];
        let friction = |w| loss::<ConcaveFriction>(&p, &shaft(0.0, w, 0.0));
        // The smooth turn-over takes half of the square of its share of the speed away.
        let near = |w: f64| (SMOOTHING * CX.omega_m_max() / w).powi(2);
        for w in [25.0, 100.0, 196.0] {
            close(friction(w) / (0.2 * (w / 100.0).sqrt()), 1.0, near(w));
            close(friction(-w), -friction(w), 1e-15);
        }
        close(friction(0.0), 0.0, 0.0);
        let [k, alpha] = ConcaveFriction::outputs(&p, &base(), &CX)[..] else { panic!() };
        assert_eq!((k.0, alpha.0, alpha.2), ("k", "alpha", 0.5));
        close(k.2 * 64f64.powf(0.5), friction(64.0), 1e-4);
    }
}
