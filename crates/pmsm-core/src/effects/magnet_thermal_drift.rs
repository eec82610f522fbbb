//! Magnet flux that drifts with rotor temperature: ψ_m(t) = ψ_m·(1 − y).
//!
//! With a logged magnet temperature y = α·(ϑ − 20 °C). Without one the rotor warms towards a final state,
//! y = δ·(1 − exp(−t/τ_th)), from the start of the recording. Source: reversible coefficient of remanence, IEC 60404-8-1
//! (NdFeB −0.0011 1/K, ferrite −0.002 1/K).

use crate::effect::{Context, Drift, Effect, Env, Info, Need, Output, Parameter, Role, Site};
use crate::base::Base;
use crate::real::Real;

/// See the module's documentation.
pub struct MagnetThermalDrift;

impl Effect for MagnetThermalDrift {
    const INFO: Info = Info {
        id: "magnet_thermal_drift",
        title: "Thermal drift of the magnet flux",
        sentence: "The magnets warm up and their flux falls during the recording.",
        equation: "ψ_m(t) = ψ_m·(1 − α·Δϑ), or ψ_m·(1 − δ·(1 − exp(−t/τ_th)))",
        source: "IEC 60404-8-1, reversible temperature coefficient of remanence",
        fingerprint: "Slow drift in proportion to speed in the q axis, and to current in the torque",
        look_alikes: &["rs_thermal_drift", "dc_link_sag"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Time, Need::Motion],
        parameters: &[
            Parameter {
                name: "alpha",
                unit: "1/K",
                meaning: "loss of flux per kelvin (NdFeB: 0.0011)",
                role: Role::Amplitude,
                low: |_| 0.0,
                high: |_| 0.01,
                typical: |_| 0.0011,
            },
            Parameter {
                name: "drop",
                unit: "1",
                meaning: "share of the flux that is lost in the end",
                role: Role::Amplitude,
                low: |_| 0.0,
                high: |_| 0.5,
                typical: |_| 0.03,
            },
            Parameter {
                name: "tau_th",
                unit: "s",
                meaning: "thermal time constant of the rotor",
                role: Role::Shape,
                low: |cx| 0.02 * cx.duration,
                high: |cx| 30.0 * cx.duration,
                typical: |cx| cx.duration,
            },
        ],
    };

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        [0.15, 0.6, 3.0].map(|x| vec![0.0, 0.0, x * cx.duration]).to_vec()
    }

    fn fitted(cx: &Context, index: usize) -> bool {
        (index == 0) == cx.has_magnet_temperature
    }

    #[inline(always)]
    fn drift<T: Real>(p: &[T], _: &[T], env: &Env<T>, _: &Context, out: &mut Drift<T>) {
        let warmth = T::one() - (T::constant(-env.t) / p[2]).exp();
        out.psi_m = out.psi_m * (T::one() - p[0] * env.magnet_heating - p[1] * warmth);
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, cx: &Context) -> Vec<Output<T>> {
        if cx.has_magnet_temperature {
            vec![("alpha", "1/K", p[0])]
        } else {
            vec![("drop", "1", p[1]), ("tau_th", "s", p[2])]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, close, env};

    fn factor(p: &[f64], t: f64, magnet_heating: f64) -> f64 {
        let mut out = Drift { r_s: 1.0, psi_m: 1.0 };
        MagnetThermalDrift::drift(p, &[], &Env { t, magnet_heating, ..env(0.0, 0.0) }, &CX, &mut out);
        assert_eq!(out.r_s, 1.0);
        out.psi_m
    }

    #[test]
    fn neodymium_loses_a_tenth_of_a_percent_per_kelvin() {
        close(factor(&[0.0011, 0.0, 1.0], 5.0, 50.0), 0.945, 1e-14);
    }

    #[test]
    fn without_a_sensor_the_flux_falls_exponentially_from_the_start() {
        let p = [0.0, 0.05, 3.0];
        close(factor(&p, 0.0, 0.0), 1.0, 0.0);
        close(factor(&p, 3.0, 0.0), 1.0 - 0.05 * (1.0 - (-1f64).exp()), 1e-14);
        close(factor(&p, 300.0, 0.0), 0.95, 1e-14);
    }
}
