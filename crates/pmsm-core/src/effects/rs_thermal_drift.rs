//! Winding resistance that drifts with temperature: r_s(t) = r_s·(1 + y).
//!
//! With a logged winding temperature y = α·(ϑ − 20 °C). Without one the winding heats itself,
//! dy/dt = c·P_cu − y/τ_th with P_cu = 3/2·r_s·|i|² and c = α/C_th. Source: IEC 60034-1 (resistance method), α = 0.00393 1/K
//! for copper at 20 °C; one-node thermal network after Boglietti et al., IEEE Trans. Industrial Electronics 56 (2009) 871.

use crate::effect::{Context, Drift, Effect, Electrical, Env, Info, Need, Output, Parameter, Role, Site};
use crate::base::Base;
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct RsThermalDrift;

impl Effect for RsThermalDrift {
    const INFO: Info = Info {
        id: "rs_thermal_drift",
        title: "Thermal drift of the stator resistance",
        sentence: "The winding warms up and its resistance rises during the recording.",
        equation: "r_s(t) = r_s·(1 + α·Δϑ), dΔϑ/dt = P_cu/C_th − Δϑ/τ_th",
        source: "IEC 60034-1; Boglietti et al., IEEE Trans. Industrial Electronics 56 (2009) 871",
        fingerprint: "Slow drift in proportion to the current, independent of speed",
        look_alikes: &["magnet_thermal_drift", "dead_time", "dc_link_sag"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Time, Need::Current],
        parameters: &[
            Parameter {
                name: "alpha",
                unit: "1/K",
                meaning: "temperature coefficient (copper: 0.0039)",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|_| 0.006,
                typical: &|_| 0.0039,
            },
            Parameter {
                name: "heating",
                unit: "1/J",
                meaning: "relative rise of resistance per joule of copper loss",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|cx| 1000.0 / (cx.v_max * cx.i_max * cx.duration),
                typical: &|cx| 0.5 / (cx.v_max * cx.i_max * cx.duration),
            },
            Parameter {
                name: "tau_th",
                unit: "s",
                meaning: "thermal time constant of the winding",
                role: Role::Shape,
                low: &|cx| 0.02 * cx.duration,
                high: &|cx| 1000.0 * cx.duration,
                typical: &|cx| 2.0 * cx.duration,
            },
        ],
    };
    const ELECTRICAL_STATES: usize = 1;
    const THERMAL: bool = true;
    const TURNS: bool = false;

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        [0.15, 0.6, 3.0].map(|x| vec![0.0, 0.0, x * cx.duration]).to_vec()
    }

    fn fitted(cx: &Context, index: usize) -> bool {
        (index == 0) == cx.has_temperature
    }

    #[inline(always)]
    fn drift<T: Real>(p: &[T], x: &[T], env: &Env<T>, _: &Context, out: &mut Drift<T>) {
        let own = x.first().copied().unwrap_or(T::zero());
        out.r_s = out.r_s * (own + p[0] * env.heating + 1.0);
    }

    #[inline(always)]
    fn electrical_states<T: Real>(p: &[T], x: &[T], at: &Electrical<T>, _: &Context, dx: &mut [T]) {
        let loss = at.r_s * (at.i[0].squared() + at.i[1].squared()) * 1.5;
        dx[0] = p[1] * loss - x[0] / p[2];
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, cx: &Context) -> Vec<Output<T>> {
        if cx.has_temperature {
            vec![("alpha", "1/K", p[0])]
        } else {
            vec![("heating", "1/J", p[1]), ("tau_th", "s", p[2])]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, MACHINE, close, env, winding};

    fn factor(p: &[f64], x: f64, heating: f64) -> f64 {
        let mut out = Drift { r_s: 1.0, psi_m: 1.0 };
        RsThermalDrift::drift(p, &[x], &Env { heating, ..env(0.0, 0.0) }, &CX, &mut out);
        out.r_s
    }

    #[test]
    fn copper_gains_two_fifths_of_a_percent_per_kelvin() {
        close(factor(&[0.00393, 0.0, 1.0], 0.0, 100.0), 1.393, 1e-14);
        close(factor(&[0.00393, 0.0, 1.0], 0.0, -20.0), 1.0 - 0.0786, 1e-14);
    }

    #[test]
    fn self_heating_starts_with_the_copper_loss_and_ends_where_cooling_balances_it() {
        let p = [0.0, 1e-4, 40.0];
        let at = winding([-3.0, 8.0], 0.0, 0.0);
        let power = 1.5 * MACHINE[0] * (9.0 + 64.0);
        let rate = |x: f64| {
            let mut dx = [0.0];
            RsThermalDrift::electrical_states(&p, &[x], &at, &CX, &mut dx);
            dx[0]
        };
        close(rate(0.0), 1e-4 * power, 1e-14);
        close(rate(1e-4 * power * 40.0), 0.0, 1e-14);
        close(factor(&p, 0.2, 0.0), 1.2, 1e-15);
    }
}
