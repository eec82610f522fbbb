//! Constant error of the rotor angle: θ_measured = θ + δ. Commanded voltages and logged currents then stand in a frame
//! turned by δ, so that the magnet seems to induce a voltage −ω·ψ_m·sin δ in the d axis.
//!
//! Source: Lagerquist, Boldea & Miller's frame rotation, as in Bobtsov et al., Automatica 61 (2015) 47.

use crate::effect::{Context, Effect, Env, Info, Need, Parameter, Role, Sensor, Site};
use crate::real::Real;

/// See the module's documentation.
pub struct EncoderAngleOffset;

impl Effect for EncoderAngleOffset {
    const INFO: Info = Info {
        id: "encoder_angle_offset",
        title: "Encoder angle offset",
        sentence: "The encoder's zero is not on the magnet axis: the logged d and q are turned against the true ones.",
        equation: "θ_measured = θ + δ",
        source: "Bobtsov et al., Automatica 61 (2015) 47",
        fingerprint: "d-axis voltage in proportion to ω·ψ_m, odd in the offset; torque constant slightly low",
        look_alikes: &["voltage_delay", "iron_loss", "cross_saturation"],
        contains: &[],
        site: Site::Sensor,
        needs: &[Need::Motion],
        parameters: &[Parameter {
            name: "offset_el_rad",
            unit: "rad",
            meaning: "measured minus true electrical angle",
            role: Role::Amplitude,
            low: |_| -0.6,
            high: |_| 0.6,
            typical: |_| 0.03,
        }],
    };

    #[inline(always)]
    fn sensor<T: Real>(p: &[T], _: &Env<T>, _: &Context, out: &mut Sensor<T>) {
        out.angle += p[0];
    }
}
