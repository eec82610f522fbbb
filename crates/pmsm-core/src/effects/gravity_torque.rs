//! A load that hangs off an axis which turns to and fro: τ_grav = a·cos θ_m + b·sin θ_m over a part of a turn.
//!
//! Where the shaft turns round, the same load is a `load_torque_pulsation` of order 1.
//! Source: Armstrong, Khatib & Burdick, IEEE Int. Conf. Robotics and Automation (1986) 510.

use crate::effect::{
    Context, Derived, Effect, Info, LEAST_SWING, Mechanical, Need, Output, Parameter, Role, Rotor, Site,
};
use crate::base::Base;
use crate::numerics::real::Real;
use std::f64::consts::PI;

/// See the module's documentation.
pub struct GravityTorque;

/// Largest amplitude, N·m: over a swing of s a cosine reaches at least sin(s/2) of it, wherever its zero is, and the motor holds that.
fn largest(cx: &Context) -> f64 {
    cx.tau_max / (0.5 * cx.swing.clamp(LEAST_SWING, PI)).sin()
}

const fn part(name: &'static str, meaning: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "N m",
        meaning,
        role: Role::Amplitude,
        low: &|cx| -largest(cx),
        high: &largest,
        typical: &|cx| 0.1 * cx.tau_max,
    }
}

impl Effect for GravityTorque {
    const INFO: Info = Info {
        id: "gravity_torque",
        title: "Gravity torque",
        sentence: "A weight hangs off the axis: its torque follows the angle of the joint over a part of a turn.",
        equation: "τ_grav = τ_g·cos(θ_m + φ)",
        source: "Armstrong, Khatib & Burdick, IEEE Int. Conf. Robotics and Automation (1986) 510",
        fingerprint: "Torque that depends on the angle alone, the same at standstill and in both directions",
        look_alikes: &["load_torque_pulsation", "time_varying_load", "cogging_torque"],
        contains: &[],
        site: Site::Mechanical,
        needs: &[Need::Angle, Need::Transients, Need::Swing],
        parameters: &[part("a", "cosine part"), part("b", "sine part")],
    };
    const DERIVED: &'static [Derived] = &[
        ("tau_g", "N m", "torque of the weight where its arm is level"),
    ];

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], _: &[T], at: &Mechanical<T>, _: &Context, out: &mut Rotor<T>) {
        let (s, c) = at.env.theta_m.sin_cos();
        out.loss += p[0] * c + p[1] * s;
    }

    fn turned(p: &mut [f64], shift: f64) -> bool {
        let (s, c) = Real::sin_cos(shift);
        (p[0], p[1]) = (p[0] * c - p[1] * s, p[0] * s + p[1] * c);
        true
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![("tau_g", "N m", (p[0].squared() + p[1].squared()).sqrt())]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, base, close, fourier, loss, shaft};
    use std::f64::consts::TAU;

    #[test]
    fn the_torque_follows_the_angle_whatever_speed_and_current() {
        for (speed, current) in [(0.0, 0.0), (-4.0, 2.0), (60.0, -3.0)] {
            let torque = |theta: f64| loss::<GravityTorque>(&[3.0, -4.0], &shaft(theta, speed, current));
            let (a, b) = fourier(1, torque);
            close(a, 3.0, 1e-12);
            close(b, -4.0, 1e-12);
            close(fourier(0, torque).0, 0.0, 1e-12);
        }
        close(GravityTorque::outputs(&[3.0, -4.0], &base(), &CX)[0].2, 5.0, 1e-15);
    }

    #[test]
    fn the_same_weight_is_found_from_another_zero() {
        let p = [0.3, 0.4];
        let mut turned = p;
        assert!(GravityTorque::turned(&mut turned, 0.7));
        let torque = |p: &[f64], theta: f64| loss::<GravityTorque>(p, &shaft(theta, 0.0, 0.0));
        close(torque(&turned, 1.1 + 0.7), torque(&p, 1.1), 1e-14);
    }

    #[test]
    fn a_swing_bounds_the_amplitude_by_the_torque_that_it_must_show() {
        for swing in [0.6, 1.5, PI] {
            let bound = largest(&Context { swing, ..CX });
            // Wherever the swing begins, a load at its bound takes the largest motor torque somewhere.
            let least = (0..360)
                .map(|start| {
                    let begin = 0.5 * (PI - swing) + f64::from(start) / 360.0 * TAU;
                    (0..=200)
                        .map(|k| (bound * (begin + swing * f64::from(k) / 200.0).cos()).abs())
                        .fold(0.0, f64::max)
                })
                .fold(f64::INFINITY, f64::min);
            // The grid misses the largest value by half a step, and a cosine falls by less than half of its square.
            close(least / CX.tau_max, 1.0, 0.5 * (0.5 * TAU / 360.0f64).powi(2));
        }
        close(largest(&Context { swing: 40.0, ..CX }), CX.tau_max, 1e-15);
        // Hardly any swing leaves no room for a sine and a cosine that cancel each other.
        let still = largest(&Context { swing: 0.0, ..CX });
        assert!(still.is_finite() && still < 4.0 * CX.tau_max);
    }
}
