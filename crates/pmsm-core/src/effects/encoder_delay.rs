//! The rotor angle is logged late by a constant time, which its sensor takes to convert and to send: θ_measured(t) = θ(t − t_0), to first order
//! θ − ω·t_0. Commanded voltages and logged currents then stand in a frame that lags behind the rotor, in either direction.
//!
//! A constant error beside it is an `encoder_angle_offset`. Source: Microchip, sensorless field-oriented control, phase angle correction,
//! equation 1-12, ΔΦ = k·ω·T_c.

use crate::effect::{Context, Effect, Env, Info, Need, Parameter, Role, Sensor, Site};
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct EncoderDelay;

/// Largest lag at the largest speed, electrical radians: that of the largest `encoder_angle_offset`.
const LARGEST: f64 = 0.6;
/// Lag at the largest speed where one is there, electrical radians.
const TYPICAL: f64 = 0.03;

impl Effect for EncoderDelay {
    const INFO: Info = Info {
        id: "encoder_delay",
        title: "Encoder delay",
        sentence: "The rotor angle is logged late: the faster it turns, the further the logged d and q lag behind the true ones.",
        equation: "θ_measured = θ − ω_e·t_0",
        source: "Microchip, sensorless field-oriented control, phase angle correction, equation 1-12",
        fingerprint: "Voltage and current turned against the rotation, growing with speed; d-axis voltage even in the speed",
        look_alikes: &["voltage_delay", "encoder_angle_offset", "iron_loss"],
        contains: &[],
        site: Site::Sensor,
        needs: &[Need::Motion],
        parameters: &[Parameter {
            name: "t_delay",
            unit: "s",
            meaning: "delay: the logged angle is behind the rotor, and never ahead of it",
            role: Role::Amplitude,
            low: &|_| 0.0,
            high: &|cx| LARGEST / cx.omega_e_max,
            typical: &|cx| TYPICAL / cx.omega_e_max,
        }],
    };

    #[inline(always)]
    fn sensor<T: Real>(p: &[T], env: &Env<T>, _: &Context, out: &mut Sensor<T>) {
        out.angle -= env.omega_e * p[0];
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, close, env};
    use crate::model::Model;
    use crate::simulate::environment::true_env;

    #[test]
    fn a_late_angle_lags_behind_the_rotor_in_either_direction() {
        let model = Model::new(CX, &[EffectId::EncoderDelay]);
        let p = [&MACHINE[..], &[1e-4]].concat();
        for omega_e in [300.0, -300.0] {
            let measured = env(2.0, omega_e);
            let sensor = model.sensor(&p, &measured);
            let truth = true_env(&sensor, &measured, CX.n_p);
            close(truth.theta_e, 2.0 + omega_e * 1e-4, 1e-15);
            close(truth.omega_e, omega_e, 0.0);
        }
    }

    #[test]
    fn a_late_angle_shows_current_of_the_q_axis_in_the_d_axis() {
        let model = Model::new(CX, &[EffectId::EncoderDelay]);
        let p = [&MACHINE[..], &[1e-4]].concat();
        let measured = env(2.0, 300.0);
        let shown = model.measured_current(&model.sensor(&p, &measured), [0.0, 8.0], measured.theta_e);
        // The rotor is ahead of the logged frame, by 0.03 rad.
        close(shown[0], -8.0 * 0.03f64.sin(), 1e-13);
        close(shown[1], 8.0 * 0.03f64.cos(), 1e-13);
    }
}
