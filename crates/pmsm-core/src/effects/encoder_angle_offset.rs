//! Constant error of the rotor angle: θ_measured = θ + δ. Commanded voltages and logged currents then stand in a frame
//! turned by δ, so that the magnet seems to induce a voltage ω·ψ_m·sin δ in the d axis.
//!
//! Source: Lagerquist, Boldea & Miller's frame rotation, as in Bobtsov et al., Automatica 61 (2015) 47.

use crate::effect::{Context, Effect, Env, Info, Need, Parameter, Role, Sensor, Site};
use crate::numerics::real::Real;

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
        look_alikes: &["voltage_delay", "iron_loss", "cross_saturation", "encoder_delay"],
        contains: &[],
        site: Site::Sensor,
        needs: &[Need::Motion],
        parameters: &[Parameter {
            name: "offset_el_rad",
            unit: "rad",
            meaning: "measured minus true electrical angle",
            role: Role::Amplitude,
            low: &|_| -0.6,
            high: &|_| 0.6,
            typical: &|_| 0.03,
        }],
    };

    #[inline(always)]
    fn sensor<T: Real>(p: &[T], _: &Env<T>, _: &Context, out: &mut Sensor<T>) {
        out.angle += p[0];
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, close, env};
    use crate::model::Model;
    use crate::simulate::environment::true_env;
    use crate::numerics::transforms::rotate;

    #[test]
    fn a_leading_encoder_sees_q_current_in_the_d_axis_and_the_rotor_ahead() {
        let model = Model::new(CX, &[EffectId::EncoderAngleOffset]);
        let p = [&MACHINE[..], &[0.1]].concat();
        let measured = env(2.0, 300.0);
        let sensor = model.sensor(&p, &measured);
        let truth = true_env(&sensor, &measured, CX.n_p);
        close(truth.theta_e, 1.9, 1e-15);
        close(truth.theta_m, (2.0 - 0.1) / CX.n_p, 1e-15);
        close(truth.omega_e, 300.0, 0.0);
        let shown = model.measured_current(&sensor, [0.0, 8.0], measured.theta_e);
        close(shown[0], 8.0 * 0.1f64.sin(), 1e-14);
        close(shown[1], 8.0 * 0.1f64.cos(), 1e-14);
        // The same turn takes the induced voltage 0, ω·ψ_m to ω·ψ_m·sin δ in the logged d axis.
        let (s, c) = sensor.angle.sin_cos();
        close(rotate([0.0, 300.0 * MACHINE[3]], c, -s)[0], 300.0 * MACHINE[3] * 0.1f64.sin(), 1e-12);
    }
}
