//! Encoder disc off centre: the angle error swings once per mechanical revolution, θ_measured = θ + a·cos θ_m + b·sin θ_m, and with
//! it the speed that is derived from the encoder.
//!
//! Source: Lara, Xu & Chandra, IEEE Trans. Industrial Electronics 63 (2016) 6148.

use crate::effect::{Context, Effect, Env, Info, Need, Output, Parameter, Role, Sensor, Site};
use crate::model::Base;
use crate::real::Real;

/// See the module's documentation.
pub struct EncoderEccentricity;

const fn part(name: &'static str, meaning: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "rad",
        meaning,
        role: Role::Amplitude,
        low: |_| -0.5,
        high: |_| 0.5,
        typical: |_| 0.01,
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

    #[inline(always)]
    fn sensor<T: Real>(p: &[T], env: &Env<T>, cx: &Context, out: &mut Sensor<T>) {
        let (s, c) = env.theta_m.sin_cos();
        out.angle += p[0] * c + p[1] * s;
        out.angle_slope += (p[1] * c - p[0] * s) * (1.0 / cx.n_p);
    }

    fn turned(p: &mut [f64], shift: f64) -> bool {
        let (s, c) = shift.sin_cos();
        (p[0], p[1]) = (p[0] * c - p[1] * s, p[0] * s + p[1] * c);
        true
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![("amplitude_el_rad", "rad", (p[0].squared() + p[1].squared()).sqrt())]
    }
}
