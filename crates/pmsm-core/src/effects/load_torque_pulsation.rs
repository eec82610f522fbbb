//! Load torque periodic in the rotor position, k times per mechanical revolution:
//! τ_pul = a·cos kθ_m + b·sin kθ_m (unbalance under gravity, eccentric load, reciprocating load).
//!
//! Source: Holtz & Springob, IEEE Trans. Industrial Electronics 43 (1996) 330.

use crate::effect::{Context, Derived, Effect, Info, Mechanical, Need, Output, Parameter, Role, Rotor, Site};
use crate::base::Base;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct LoadTorquePulsation;

impl Effect for LoadTorquePulsation {
    const INFO: Info = Info {
        id: "load_torque_pulsation",
        title: "Load torque pulsation",
        sentence: "The load torque comes and goes with every revolution of the shaft.",
        equation: "τ_pul·cos(k θ_m + φ)",
        source: "Holtz & Springob, IEEE Trans. Industrial Electronics 43 (1996) 330",
        fingerprint: "A line at a low order per mechanical revolution in the speed, strongest at low speed",
        look_alikes: &["encoder_eccentricity", "cogging_torque", "gravity_torque", "time_varying_load"],
        contains: &[],
        site: Site::Mechanical,
        needs: &[Need::Angle, Need::Transients, Need::Motion, Need::Turn],
        parameters: &[
            Parameter::torque("a", "cosine part"),
            Parameter::torque("b", "sine part"),
            Parameter {
                name: "order_mech",
                unit: "1",
                meaning: "periods per mechanical revolution",
                role: Role::Fixed,
                low: &|_| 1.0,
                high: &|_| 4.0,
                typical: &|_| 1.0,
            },
        ],
    };
    const DERIVED: &'static [Derived] = &[
        ("tau_pul", "N m", "amplitude of the pulsation"),
    ];

    fn probes(_: &Context) -> Vec<Vec<f64>> {
        [1.0, 2.0, 3.0, 4.0].map(|order| vec![0.0, 0.0, order]).to_vec()
    }

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], _: &[T], at: &Mechanical<T>, _: &Context, out: &mut Rotor<T>) {
        let (s, c) = (at.env.theta_m * p[2]).sin_cos();
        out.loss += p[0] * c + p[1] * s;
    }

    fn turned(p: &mut [f64], shift: f64) -> bool {
        let (s, c) = Real::sin_cos(p[2] * shift);
        (p[0], p[1]) = (p[0] * c - p[1] * s, p[0] * s + p[1] * c);
        true
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![("tau_pul", "N m", (p[0].squared() + p[1].squared()).sqrt()), ("order_mech", "1", p[2])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, base, close, fourier, loss, shaft};

    #[test]
    fn one_line_at_the_given_order_whatever_the_speed() {
        let p = [0.3, 0.4, 2.0];
        for speed in [-10.0, 100.0] {
            let torque = |theta: f64| loss::<LoadTorquePulsation>(&p, &shaft(theta, speed, 0.0));
            close(fourier(2, torque).0, 0.3, 1e-12);
            close(fourier(2, torque).1, 0.4, 1e-12);
            close(fourier(1, torque).0, 0.0, 1e-12);
        }
        close(LoadTorquePulsation::outputs(&p, &base(), &CX)[0].2, 0.5, 1e-15);
    }

    #[test]
    fn the_same_torque_is_found_from_another_zero() {
        let p = [0.3, 0.4, 3.0];
        let mut turned = p;
        assert!(LoadTorquePulsation::turned(&mut turned, 0.7));
        let torque = |p: &[f64], theta: f64| loss::<LoadTorquePulsation>(p, &shaft(theta, 0.0, 0.0));
        close(torque(&turned, 1.1 + 0.7), torque(&p, 1.1), 1e-14);
    }
}
