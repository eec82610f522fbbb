//! Stribeck friction: τ_f = (τ_c + (τ_s − τ_c)·exp(−(ω_m/ω_s)²))·sgn ω_m, higher at standstill than in motion. The sign turns
//! over as in [`super::coulomb_friction`].
//!
//! Source: Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083, with Gaussian Stribeck curve.

use crate::effect::{Context, Derived, Effect, Info, Mechanical, Output, Parameter, Role, Rotor, Site};
use crate::terms::SMOOTHING;
use crate::base::Base;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct StribeckFriction;

impl Effect for StribeckFriction {
    const INFO: Info = Info {
        id: "stribeck_friction",
        title: "Stribeck friction",
        sentence: "Friction is higher around standstill and falls as the bearing picks up speed.",
        equation: "τ_f = (τ_c + (τ_s − τ_c)·exp(−(ω_m/ω_s)²))·sgn(ω_m)",
        source: "Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083",
        fingerprint: "Coulomb friction with an extra torque only below about three ω_s",
        look_alikes: &["coulomb_friction", "time_varying_load"],
        contains: &["coulomb_friction"],
        site: Site::Mechanical,
        needs: &[],
        parameters: &[
            Parameter {
                name: "tau_c",
                unit: "N m",
                meaning: "friction torque in motion",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|cx| cx.tau_max,
                typical: &|cx| 0.02 * cx.tau_max,
            },
            Parameter {
                name: "tau_x",
                unit: "N m",
                meaning: "what friction has more at standstill, τ_s − τ_c",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|cx| cx.tau_max,
                typical: &|cx| 0.01 * cx.tau_max,
            },
            Parameter {
                name: "w_s",
                unit: "rad/s",
                meaning: "mechanical speed at which the extra friction has fallen to 1/e",
                role: Role::Shape,
                low: &|cx| 1e-3 * cx.omega_m_max(),
                high: &|cx| 0.5 * cx.omega_m_max(),
                typical: &|cx| 0.05 * cx.omega_m_max(),
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
    const DERIVED: &'static [Derived] = &[
        ("tau_s", "N m", "friction torque at standstill"),
    ];

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        let top = cx.omega_m_max();
        [0.02, 0.06, 0.2].map(|share| vec![0.0, 0.0, share * top, SMOOTHING * top]).to_vec()
    }

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], _: &[T], at: &Mechanical<T>, _: &Context, out: &mut Rotor<T>) {
        let extra = p[1] * (-(at.omega_m / p[2]).squared()).exp();
        out.loss += (p[0] + extra) * (at.omega_m / p[3]).tanh();
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![
            ("tau_c", "N m", p[0]),
            ("tau_s", "N m", p[0] + p[1]),
            ("w_s", "rad/s", p[2]),
            ("w_0", "rad/s", p[3]),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, base, close, loss, shaft};

    #[test]
    fn friction_falls_from_the_standstill_value_to_the_running_one() {
        let p = [0.2, 0.15, 10.0, 0.01];
        let friction = |w| loss::<StribeckFriction>(&p, &shaft(0.0, w, 0.0));
        close(friction(0.1), 0.35, 1e-3);
        close(friction(10.0), 0.2 + 0.15 * (-1f64).exp(), 1e-12);
        close(friction(60.0), 0.2, 1e-12);
        close(friction(-10.0), -friction(10.0), 1e-15);
        let out = StribeckFriction::outputs(&p, &base(), &CX);
        assert_eq!((out[1].0, out[1].2), ("tau_s", 0.35));
    }
}
