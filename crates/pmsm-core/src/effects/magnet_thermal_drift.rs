//! Magnet flux that drifts with rotor temperature: ψ_m(t) = ψ_m·(1 − y).
//!
//! With a logged magnet temperature y = α·(ϑ − 20 °C). Without one the rotor is warmed by its surroundings, by the current and by
//! the eddy currents that turning induces,
//!
//! > τ_th·dy/dt = δ + δ_i·(|i|/i_max)² + δ_ω·(ω_e/ω_max)² − y,
//!
//! from y = 0 at the start of the recording, i_max and ω_max being the greatest in it. Source: reversible coefficient of remanence,
//! IEC 60404-8-1 (NdFeB −0.0011 1/K, ferrite −0.002 1/K); one-node thermal network with copper loss and loss in proportion to the
//! square of the frequency after Boglietti et al., IEEE Trans. Industrial Electronics 56 (2009) 871.

use crate::effect::{Context, Drift, Effect, Electrical, Env, Info, Need, Output, Parameter, Role, Site};
use crate::base::Base;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct MagnetThermalDrift;

impl Effect for MagnetThermalDrift {
    const INFO: Info = Info {
        id: "magnet_thermal_drift",
        title: "Thermal drift of the magnet flux",
        sentence: "The magnets warm up and their flux falls during the recording.",
        equation: "ψ_m(t) = ψ_m·(1 − α·Δϑ), or ψ_m·(1 − y), τ_th·dy/dt = δ + δ_i·|i|² + δ_ω·ω² − y",
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
                low: &|_| 0.0,
                high: &|_| 0.01,
                typical: &|_| 0.0011,
            },
            Parameter {
                name: "drop",
                unit: "1",
                meaning: "share of the flux that is lost in the end to warmth from outside",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|_| 0.5,
                typical: &|_| 0.03,
            },
            Parameter {
                name: "tau_th",
                unit: "s",
                meaning: "thermal time constant of the rotor",
                role: Role::Shape,
                low: &|cx| 0.02 * cx.duration,
                high: &|cx| 30.0 * cx.duration,
                typical: &|cx| cx.duration,
            },
            Parameter {
                name: "drop_i",
                unit: "1",
                meaning: "share that the greatest current would cost in the end",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|_| 2.0,
                typical: &|_| 0.03,
            },
            Parameter {
                name: "drop_w",
                unit: "1",
                meaning: "share that the greatest speed would cost in the end",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|_| 2.0,
                typical: &|_| 0.03,
            },
        ],
    };
    const ELECTRICAL_STATES: usize = 1;
    const THERMAL: bool = true;

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        [0.15, 0.6, 3.0].map(|x| vec![0.0, 0.0, x * cx.duration, 0.0, 0.0]).to_vec()
    }

    fn fitted(cx: &Context, index: usize) -> bool {
        (index == 0) == cx.has_magnet_temperature
    }

    #[inline(always)]
    fn drift<T: Real>(p: &[T], x: &[T], env: &Env<T>, _: &Context, out: &mut Drift<T>) {
        let own = x.first().copied().unwrap_or(T::zero());
        out.psi_m = out.psi_m * (T::one() - p[0] * env.magnet_heating - own);
    }

    #[inline(always)]
    fn electrical_states<T: Real>(p: &[T], x: &[T], at: &Electrical<T>, cx: &Context, dx: &mut [T]) {
        let current = (at.i[0].squared() + at.i[1].squared()) * (1.0 / (cx.i_max * cx.i_max));
        let speed = at.env.omega_e.squared() * (1.0 / (cx.omega_e_max * cx.omega_e_max));
        dx[0] = (p[1] + p[3] * current + p[4] * speed - x[0]) / p[2];
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, cx: &Context) -> Vec<Output<T>> {
        if cx.has_magnet_temperature {
            vec![("alpha", "1/K", p[0])]
        } else {
            vec![("drop", "1", p[1]), ("drop_i", "1", p[3]), ("drop_w", "1", p[4]), ("tau_th", "s", p[2])]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, close, env, winding};

    fn factor(p: &[f64], x: f64, magnet_heating: f64) -> f64 {
        let mut out = Drift { r_s: 1.0, psi_m: 1.0 };
        MagnetThermalDrift::drift(p, &[x], &Env { magnet_heating, ..env(0.0, 0.0) }, &CX, &mut out);
        assert_eq!(out.r_s, 1.0);
        out.psi_m
    }

    #[test]
    fn neodymium_loses_a_tenth_of_a_percent_per_kelvin() {
        close(factor(&[0.0011, 0.0, 1.0, 0.0, 0.0], 0.0, 50.0), 0.945, 1e-14);
    }

    #[test]
    fn without_a_sensor_each_loss_drives_the_flux_to_its_own_end() {
        let p = [0.0, 0.05, 3.0, 0.02, 0.01];
        let rate = |i: [f64; 2], omega: f64, x: f64| {
            let mut dx = [0.0];
            MagnetThermalDrift::electrical_states(&p, &[x], &winding(i, 0.0, omega), &CX, &mut dx);
            dx[0]
        };
        close(rate([0.0; 2], 0.0, 0.0), 0.05 / 3.0, 1e-14);
        close(rate([0.0; 2], 0.0, 0.05), 0.0, 1e-14);
        close(rate([0.6 * CX.i_max, -0.8 * CX.i_max], 0.0, 0.07), 0.0, 1e-14);
        close(rate([0.0; 2], -CX.omega_e_max, 0.06), 0.0, 1e-14);
        close(factor(&p, 0.08, 0.0), 0.92, 1e-14);
    }
}
