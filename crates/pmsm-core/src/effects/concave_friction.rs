//! Concave friction: τ_f = k·|ω_m|^α·sgn ω_m with 0 < α < 1, as of lubricated bearings and seals whose film grows thicker or whose grease
//! thins with the speed. The speed is taken as √(ω_m² + ω_0²) around standstill, so that the slope stays finite where the sign turns over.
//!
//! Sources: Harris & Kotzalas, Essential Concepts of Bearing Technology (2006), ch. 10; Palmgren, Ball and Roller Bearing Engineering (1959).

use crate::base::Base;
use crate::effect::{Context, Derived, Effect, Info, Mechanical, Output, Parameter, Role, Rotor, Site};
use crate::numerics::real::Real;
use crate::terms::{SMOOTHING, direction};

/// See the module's documentation.
pub struct ConcaveFriction;

impl Effect for ConcaveFriction {
    const INFO: Info = Info {
        id: "concave_friction",
        title: "Concave friction",
        sentence: "Friction grows with the speed, but ever less: lubricant film, grease or seal.",
        equation: "τ_f = k·|ω_m|^α·sgn(ω_m)",
        source: "Harris & Kotzalas, Essential Concepts of Bearing Technology (2006), ch. 10",
        fingerprint: "Torque against the speed that is steep around standstill and levels off at high speed",
        look_alikes: &["coulomb_friction", "stribeck_friction", "asymmetric_friction"],
        contains: &["coulomb_friction"],
        site: Site::Mechanical,
        needs: &[],
        parameters: &[
            Parameter {
                name: "tau_top",
                unit: "N m",
                meaning: "friction torque at the highest speed of the recording",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|cx| cx.tau_max,
                typical: &|cx| 0.03 * cx.tau_max,
            },
            Parameter {
                name: "alpha",
                unit: "1",
                meaning: "exponent of the speed: 0 is Coulomb friction, 1 viscous friction",
                role: Role::Shape,
                // Nearer to either end it cannot be told from Coulomb or viscous friction.
                low: &|_| 0.15,
                high: &|_| 0.85,
                typical: &|_| 0.5,
            },
        ],
    };
    const JUMPS: bool = true;
    const SMOOTH: bool = true;
    const DERIVED: &'static [Derived] = &[
        ("k", "N m (s/rad)^alpha", "factor of the speed's power"),
    ];

    fn probes(_: &Context) -> Vec<Vec<f64>> {
        [0.33, 0.5, 0.67].map(|alpha| vec![0.0, alpha]).to_vec()
    }

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], _: &[T], at: &Mechanical<T>, cx: &Context, out: &mut Rotor<T>) {
        let top = cx.omega_m_max();
        let share = ((at.omega_m * (1.0 / top)).squared() + T::constant(SMOOTHING * SMOOTHING)).sqrt();
        out.loss += p[0] * share.pow_nonnegative(p[1]) * direction(at.omega_m, cx);
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, cx: &Context) -> Vec<Output<T>> {
        let top = T::constant(cx.omega_m_max()).pow_nonnegative(p[1]);
        vec![("k", "N m (s/rad)^alpha", p[0] / top), ("alpha", "1", p[1])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, base, close, loss, shaft};

    #[test]
    fn friction_grows_as_a_power_of_the_speed_and_turns_over_at_standstill() {
        let p = [0.2, 0.5];
        let friction = |w| loss::<ConcaveFriction>(&p, &shaft(0.0, w, 0.0));
        let top = CX.omega_m_max();
        close(friction(top), 0.2, 1e-5);
        close(friction(0.25 * top), 0.1, 1e-5);
        close(friction(-0.25 * top), -0.1, 1e-5);
        close(friction(0.0), 0.0, 1e-15);
        let out = ConcaveFriction::outputs(&p, &base(), &CX);
        assert_eq!((out[0].0, out[1].0), ("k", "alpha"));
        close(out[0].2 * (0.25 * top).sqrt(), friction(0.25 * top), 1e-5);
    }
}
