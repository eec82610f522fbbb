//! Encoder disc off centre: the angle error swings once per mechanical revolution, θ_measured = θ + a·cos θ_m + b·sin θ_m, and with
//! it the speed that is derived from the encoder.
//!
//! Source: Lara, Xu & Chandra, IEEE Trans. Industrial Electronics 63 (2016) 6148.

use crate::effect::{Context, Derived, Effect, Env, Info, Need, Output, Parameter, Role, Sensor, Site};
use crate::base::Base;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct EncoderEccentricity;

const fn part(name: &'static str, meaning: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "rad",
        meaning,
        role: Role::Amplitude,
        low: &|_| -0.5,
        high: &|_| 0.5,
        typical: &|_| 0.01,
    }
}

impl Effect for EncoderEccentricity {
    const INFO: Info = Info {
        id: "encoder_eccentricity",
        title: "Encoder eccentricity",
        sentence: "The encoder disc sits off centre: the measured angle errs once per revolution.",
        equation: "θ_measured = θ + δ·cos(θ_m + φ)",
        source: "Lara, Xu & Chandra, IEEE Trans. Industrial Electronics 63 (2016) 6148",
        fingerprint: "Order 1 per mechanical revolution in d, q and the speed at once, growing with speed",
        look_alikes: &["load_torque_pulsation", "encoder_angle_offset"],
        contains: &[],
        site: Site::Sensor,
        needs: &[Need::Angle, Need::Transients, Need::Motion],
        parameters: &[
            part("a", "cosine part, electrical radians"),
            part("b", "sine part, electrical radians"),
        ],
    };
    const DERIVED: &'static [Derived] = &[
        ("amplitude_el_rad", "rad", "amplitude of the angle's error, electrical"),
    ];

    #[inline(always)]
    fn sensor<T: Real>(p: &[T], env: &Env<T>, cx: &Context, out: &mut Sensor<T>) {
        let (s, c) = env.theta_m.sin_cos();
        out.angle += p[0] * c + p[1] * s;
        out.angle_slope += (p[1] * c - p[0] * s) * (1.0 / cx.n_p);
    }

    fn turned(p: &mut [f64], shift: f64) -> bool {
        let (s, c) = Real::sin_cos(shift);
        (p[0], p[1]) = (p[0] * c - p[1] * s, p[0] * s + p[1] * c);
        true
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![("amplitude_el_rad", "rad", (p[0].squared() + p[1].squared()).sqrt())]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, base, close, env};
    use crate::model::Model;
    use crate::simulate::environment::true_env;

    #[test]
    fn true_speed_is_the_derivative_of_the_true_angle() {
        let model = Model::new(CX, &[EffectId::EncoderEccentricity]);
        let p = [&MACHINE[..], &[0.05, -0.08]].concat();
        let truth = |t: f64| {
            let measured = env(1.0 + 300.0 * t, 300.0);
            true_env(&model.sensor(&p, &measured), &measured, CX.n_p)
        };
        let h = 1e-6;
        for t in [0.0, 0.01, 0.037] {
            let slope = (truth(t + h).theta_e - truth(t - h).theta_e) / (2.0 * h);
            close(truth(t).omega_e, slope, 1e-8);
        }
        // Once per mechanical revolution, not per electrical one.
        let turn = std::f64::consts::TAU / 300.0;
        let error = |t: f64| 1.0 + 300.0 * t - truth(t).theta_e;
        close(error(CX.n_p * turn), error(0.0), 1e-12);
        assert!((error(turn) - error(0.0)).abs() > 0.01);
        close(EncoderEccentricity::outputs(&p[6..], &base(), &CX)[0].2, 0.05f64.hypot(0.08), 1e-15);
    }

    #[test]
    fn the_same_error_is_found_from_another_zero() {
        let angle = |p: &[f64], theta_m: f64| {
            let mut out = Sensor { gain: [1.0; 3], offset: [0.0; 3], angle: 0.0, angle_slope: 0.0 };
            EncoderEccentricity::sensor(p, &env(theta_m * CX.n_p, 0.0), &CX, &mut out);
            out.angle
        };
        let mut turned = [0.05, -0.08];
        assert!(EncoderEccentricity::turned(&mut turned, 0.7));
        close(angle(&turned, 1.1 + 0.7), angle(&[0.05, -0.08], 1.1), 1e-14);
    }
}
