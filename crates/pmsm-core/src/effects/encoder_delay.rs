//! The rotor angle is logged late. At the electrical speed ω it lags by ω·t: θ_measured = θ − ω·(t_0 + k·|ω|). Commanded voltages and logged
//! currents then stand in a frame that lags behind the rotor, in either direction.
//!
//! The constant part t_0 is the time that the sensor takes to convert and to send. The part that grows with the speed is what the first
//! order leaves of its filters and of a converter that tracks. A constant error beside it is an `encoder_angle_offset`.
//!
//! Source: Hanselman, IEEE Trans. Industrial Electronics 37 (1990) 556, on the lag of converters.

use crate::effect::{Context, Effect, Env, Info, Need, Parameter, Role, Sensor, Site};
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct EncoderDelay;

/// Largest lag of each part at the largest speed, electrical radians: that of the largest `encoder_angle_offset`.
const LARGEST: f64 = 0.6;
/// Lag of each part at the largest speed where one is there, electrical radians.
const TYPICAL: f64 = 0.03;

impl Effect for EncoderDelay {
    const INFO: Info = Info {
        id: "encoder_delay",
        title: "Encoder delay",
        sentence: "The rotor angle is logged late: the faster it turns, the further the logged d and q lag behind the true ones.",
        equation: "θ_measured = θ − ω_e·(t_0 + k·|ω_e|)",
        source: "Hanselman, IEEE Trans. Industrial Electronics 37 (1990) 556",
        fingerprint: "Voltage and current turned against the rotation, growing with speed; d-axis voltage even in the speed",
        look_alikes: &["voltage_delay", "encoder_angle_offset", "iron_loss"],
        contains: &[],
        site: Site::Sensor,
        needs: &[Need::Motion],
        parameters: &[
            Parameter {
                name: "t_delay",
                unit: "s",
                meaning: "delay at low speed, positive where the logged angle is behind the rotor",
                role: Role::Amplitude,
                low: &|cx| -LARGEST / cx.omega_e_max,
                high: &|cx| LARGEST / cx.omega_e_max,
                typical: &|cx| TYPICAL / cx.omega_e_max,
            },
            Parameter {
                name: "k_delay",
                unit: "s^2",
                meaning: "growth of the delay per electrical rad/s",
                role: Role::Amplitude,
                low: &|cx| -LARGEST / cx.omega_e_max.powi(2),
                high: &|cx| LARGEST / cx.omega_e_max.powi(2),
                typical: &|cx| TYPICAL / cx.omega_e_max.powi(2),
            },
        ],
    };

    #[inline(always)]
    fn sensor<T: Real>(p: &[T], env: &Env<T>, _: &Context, out: &mut Sensor<T>) {
        out.angle -= env.omega_e * (p[0] + p[1] * env.omega_e.abs());
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::EffectId;
    use crate::effects::testing::{CX, MACHINE, close, env};
    use crate::model::Model;
    use crate::simulate::electrical::true_env;

    #[test]
    fn a_late_angle_lags_behind_the_rotor_in_either_direction() {
        let model = Model::new(CX, &[EffectId::EncoderDelay]);
        let p = [&MACHINE[..], &[1e-4, 1e-7]].concat();
        for omega_e in [300.0, -300.0] {
            let measured = env(2.0, omega_e);
            let sensor = model.sensor(&p, &measured);
            let truth = true_env(&sensor, &measured, CX.n_p);
            close(truth.theta_e, 2.0 + omega_e * (1e-4 + 1e-7 * 300.0), 1e-15);
            close(truth.omega_e, omega_e, 0.0);
        }
    }

    #[test]
    fn a_late_angle_shows_current_of_the_q_axis_in_the_d_axis() {
        let model = Model::new(CX, &[EffectId::EncoderDelay]);
        let p = [&MACHINE[..], &[1e-4, 0.0]].concat();
        let measured = env(2.0, 300.0);
        let shown = model.measured_current(&model.sensor(&p, &measured), [0.0, 8.0], measured.theta_e);
        // The rotor is ahead of the logged frame, by 0.03 rad.
        close(shown[0], -8.0 * 0.03f64.sin(), 1e-13);
        close(shown[1], 8.0 * 0.03f64.cos(), 1e-13);
    }
}
