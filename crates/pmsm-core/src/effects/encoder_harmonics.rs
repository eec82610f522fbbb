//! Sine and cosine of a sensor that turns with the electrical angle do not match. Offsets make the angle err once per electrical turn.
//! Unequal amplitudes, and a phase between the two that is not 90°, make it err twice:
//! θ_measured = θ + Σ_{k=1,2} a_k·cos kθ_e + b_k·sin kθ_e. The speed that is derived from the sensor errs with it.
//!
//! That is the first order of what the two signals trace, an ellipse off the centre: e^{jθ} + β·e^{−jθ} + γ, β = −b_2 + j·a_2 and
//! γ = −b_1 + j·a_1. Its angle is the measured one exactly where the error ε fulfils
//!
//! > (1 − Re X)·sin ε − Im X·cos ε = Im(γ·e^{−jθ_measured}),  X = β·e^{−2jθ_measured}.
//!
//! A constant error beside it is an `encoder_angle_offset`. Source: Hanselman, IEEE Trans. Industrial Electronics 37 (1990) 556.

use crate::effect::{Context, Derived, Effect, Env, Info, Need, Output, Parameter, Role, Sensor, Site};
use crate::base::Base;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct EncoderHarmonics;

/// Largest part: amplitudes that differ by a third. The error then stays shallower than the angle, so that either gives the other.
const LARGEST: f64 = 0.15;

const fn part(name: &'static str, meaning: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "rad",
        meaning,
        role: Role::Amplitude,
        low: &|_| -LARGEST,
        high: &|_| LARGEST,
        typical: &|_| 0.01,
    }
}

impl Effect for EncoderHarmonics {
    const INFO: Info = Info {
        id: "encoder_harmonics",
        title: "Encoder harmonics",
        sentence: "Sine and cosine of the angle sensor do not match: the angle errs once and twice per electrical turn.",
        equation: "θ_measured = θ + δ_1·cos(θ_e + φ_1) + δ_2·cos(2θ_e + φ_2)",
        source: "Hanselman, IEEE Trans. Industrial Electronics 37 (1990) 556",
        fingerprint: "Orders 1 and 2 per electrical turn in d, q and the speed at once, growing with speed",
        look_alikes: &[
            "encoder_eccentricity",
            "current_offset",
            "current_gain_imbalance",
            "phase_resistance_imbalance",
            "inductance_harmonics",
        ],
        contains: &[],
        site: Site::Sensor,
        needs: &[Need::Angle, Need::Transients, Need::Motion],
        parameters: &[
            part("a_1", "cosine part at order 1, electrical radians"),
            part("b_1", "sine part at order 1, electrical radians"),
            part("a_2", "cosine part at order 2, electrical radians"),
            part("b_2", "sine part at order 2, electrical radians"),
        ],
    };
    const DERIVED: &'static [Derived] = &[
        ("amplitude_1_el_rad", "rad", "amplitude of the angle's error once per electrical turn, electrical"),
        ("amplitude_2_el_rad", "rad", "amplitude of the angle's error twice per electrical turn, electrical"),
    ];

    #[inline(always)]
    fn sensor<T: Real>(p: &[T], env: &Env<T>, _: &Context, out: &mut Sensor<T>) {
        let (s, c) = env.theta_e.sin_cos();
        let (s2, c2) = (s * c * 2.0, c.squared() - s.squared());
        let (once, once_slope) = (p[0] * c + p[1] * s, p[1] * c - p[0] * s);
        let (along, across) = (p[2] * s2 - p[3] * c2, p[2] * c2 + p[3] * s2);
        let rest = T::one() - along;
        // One Newton step from the first order is exact to 5e-6 rad within the bounds.
        let near = (once + across) / rest;
        let (sin, cos) = near.sin_cos();
        let error = near - (rest * sin - across * cos - once) / (rest * cos + across * sin);
        let (sin, cos) = error.sin_cos();
        let slope = (across * sin - along * cos) * 2.0 + once_slope;
        out.angle += error;
        out.angle_slope += slope / (rest * cos + across * sin);
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        let amplitude = |a: T, b: T| (a.squared() + b.squared()).sqrt();
        vec![
            ("amplitude_1_el_rad", "rad", amplitude(p[0], p[1])),
            ("amplitude_2_el_rad", "rad", amplitude(p[2], p[3])),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, base, close, env, fourier};
    use crate::model::Model;
    use crate::simulate::environment::true_env;

    /// What the sensor does at a measured angle.
    fn shown(p: &[f64], theta_e: f64) -> Sensor<f64> {
        let mut out = Sensor { gain: [1.0; 3], offset: [0.0; 3], angle: 0.0, angle_slope: 0.0 };
        EncoderHarmonics::sensor(p, &env(theta_e, 0.0), &CX, &mut out);
        out
    }

    #[test]
    fn true_speed_is_the_derivative_of_the_true_angle() {
        let model = Model::new(CX, &[EffectId::EncoderHarmonics]);
        let p = [&MACHINE[..], &[0.03, -0.05, 0.07, 0.02]].concat();
        let truth = |t: f64| {
            let measured = env(1.0 + 300.0 * t, 300.0);
            true_env(&model.sensor(&p, &measured), &measured, CX.n_p)
        };
        let h = 1e-6;
        for t in [0.0, 0.004, 0.011] {
            let slope = (truth(t + h).theta_e - truth(t - h).theta_e) / (2.0 * h);
            // One Newton step leaves less than that in the slope.
            close(truth(t).omega_e, slope, 1e-7);
        }
    }

    #[test]
    fn a_small_error_has_two_lines_per_electrical_turn_and_no_mean() {
        let p = [0.03, -0.05, 0.07, 0.02];
        let small = p.map(|x| 1e-4 * x);
        for (order, a, b) in [(0, 0.0, 0.0), (1, 0.03, -0.05), (2, 0.07, 0.02), (3, 0.0, 0.0)] {
            let line = fourier(order, |theta| 1e4 * shown(&small, theta).angle);
            close(line.0, a, 2e-6);
            close(line.1, b, 2e-6);
        }
        let out = EncoderHarmonics::outputs(&p, &base(), &CX);
        close(out[0].2, 0.03f64.hypot(0.05), 1e-15);
        close(out[1].2, 0.07f64.hypot(0.02), 1e-15);
    }

    #[test]
    fn a_cosine_that_is_off_quadrature_errs_by_half_as_much_and_as_much_again_twice_per_turn() {
        // sin θ and cos(θ + δ) trace e^{jδ/2}·cos(δ/2)·(e^{jθ} + β·e^{−jθ}) with β = −j·tan(δ/2)·e^{−jδ}.
        let skew = 8f64.to_radians();
        let half = (0.5 * skew).tan();
        for theta in [0.3, 1.2, 2.6, -2.0f64] {
            let measured = theta.sin().atan2((theta + skew).cos());
            let (a, b) = (-half * skew.cos(), half * skew.sin());
            let error = 0.5 * skew + shown(&[0.0, 0.0, a, b], measured - 0.5 * skew).angle;
            close(measured - theta, error, 1e-7);
        }
    }

    #[test]
    fn offsets_and_amplitudes_of_both_signals_are_undone_exactly() {
        let p = [0.06, -0.05, 0.07, 0.12];
        for theta in [-2.9, -1.1, 0.2, 1.6, 2.8f64] {
            let (s, c) = theta.sin_cos();
            let cosine = c - p[1] + (p[2] * s - p[3] * c);
            let sine = s + p[0] + (p[2] * c + p[3] * s);
            let measured = sine.atan2(cosine);
            let error = (measured - theta + 3.0).rem_euclid(std::f64::consts::TAU) - 3.0;
            close(shown(&p, measured).angle, error, 5e-6);
        }
    }

    #[test]
    fn at_its_bounds_the_error_is_shallower_than_the_angle() {
        for k in 0..16 {
            let own = EncoderHarmonics::INFO.parameters.iter().enumerate();
            let p: Vec<f64> =
                own.map(|(x, p)| if (k >> x) & 1 == 1 { (p.high)(&CX) } else { (p.low)(&CX) }).collect();
            let steepest = (0..1000).map(|n| shown(&p, f64::from(n) * 6.3e-3).angle_slope.abs()).fold(0.0, f64::max);
            assert!(steepest < 1.0, "{p:?} {steepest}");
        }
    }
}
