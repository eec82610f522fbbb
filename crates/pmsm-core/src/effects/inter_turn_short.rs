//! Shorted turns in one phase. A share μ of the turns, closed over the fault resistance R_f, carries i_f with
//! τ_f·di_f/dt = μ·e_x/R_f − i_f; the phase's magnetising current is its terminal current less μ·i_f. What terminals show is
//! the fault conductance g_f = μ²/R_f, not μ by itself.
//!
//! Source: Romeral, Urresty, Riba Ruiz & Garcia Espinosa, IEEE Trans. Industrial Electronics 58 (2011) 1996.

use crate::effect::{Context, Effect, Electrical, Info, Need, Output, Parameter, Role, Site};
use crate::terms::{PHASE, chosen};
use crate::base::Base;
use crate::real::Real;
use crate::transforms::{inverse_park, park};

/// See the module's documentation.
pub struct InterTurnShort;

impl Effect for InterTurnShort {
    const INFO: Info = Info {
        id: "inter_turn_short",
        title: "Inter-turn short circuit",
        sentence: "Some turns of one phase are shorted: a current circulates in them and loads the phase.",
        equation: "i_x = i_x,m + μ·i_f, i_f = μ·e_x/R_f",
        source: "Romeral et al., IEEE Trans. Industrial Electronics 58 (2011) 1996",
        fingerprint: "2nd electrical order growing with speed, negative sequence",
        look_alikes: &["phase_resistance_imbalance", "iron_loss", "current_gain_imbalance"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Angle, Need::Transients, Need::Motion, Need::Current],
        parameters: &[
            Parameter {
                name: "g_f",
                unit: "S",
                meaning: "fault conductance seen from the phase, μ²/R_f",
                role: Role::Amplitude,
                low: |_| 0.0,
                high: |cx| cx.i_max / cx.v_max,
                typical: |cx| 0.01 * cx.i_max / cx.v_max,
            },
            Parameter {
                name: "tau_f",
                unit: "s",
                meaning: "time constant of the shorted turns",
                role: Role::Shape,
                low: |cx| 0.6 * cx.period,
                high: |cx| 50.0 * cx.period,
                typical: |cx| 1.5 * cx.period,
            },
            PHASE,
        ],
    };
    const MAGNETIC: bool = true;
    const ELECTRICAL_STATES: usize = 1;

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        [0.0, 1.0, 2.0].map(|phase| vec![0.0, 1.5 * cx.period, phase]).to_vec()
    }

    #[inline(always)]
    fn shunt<T: Real>(p: &[T], x: &[T], (s, c): (T, T), _: &Context, i: &mut [T; 2]) {
        let mut phases = [x[0]; 3];
        for (phase, i) in phases.iter_mut().enumerate() {
            *i = chosen(p[2], phase) * *i;
        }
        let [d, q] = park(phases, c, s);
        i[0] += d;
        i[1] += q;
    }

    #[inline(always)]
    fn electrical_states<T: Real>(p: &[T], x: &[T], at: &Electrical<T>, _: &Context, dx: &mut [T]) {
        dx[0] = (p[0] * phase_emf(p, at.emf, at.sin_cos) - x[0]) / p[1];
    }

    fn electrical_start<T: Real>(p: &[T], emf: [T; 2], sin_cos: (T, T), _: &Context, x: &mut [T]) {
        x[0] = p[0] * phase_emf(p, emf, sin_cos);
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![("g_f", "S", p[0]), ("tau_f", "s", p[1]), ("phase", "1", p[2])]
    }
}

#[inline(always)]
fn phase_emf<T: Real>(p: &[T], emf: [T; 2], (s, c): (T, T)) -> T {
    let phases = inverse_park(emf, c, s);
    chosen(p[2], 0) * phases[0] + chosen(p[2], 1) * phases[1] + chosen(p[2], 2) * phases[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, close, fourier};

    #[test]
    fn one_phase_in_three_draws_a_mean_and_a_negative_sequence() {
        let p = [0.02, 1.2e-4, 1.0];
        let emf = [-20.0, 90.0];
        let bypass = |theta: f64| {
            let sin_cos = theta.sin_cos();
            let (mut x, mut i) = ([0.0], [0.0; 2]);
            InterTurnShort::electrical_start(&p, emf, sin_cos, &CX, &mut x);
            InterTurnShort::shunt(&p, &x, sin_cos, &CX, &mut i);
            i
        };
        for axis in 0..2 {
            close(fourier(0, |theta| bypass(theta)[axis]).0, p[0] * emf[axis] / 3.0, 1e-12);
            let (a, b) = fourier(2, |theta| bypass(theta)[axis]);
            close(a.hypot(b), p[0] * emf[0].hypot(emf[1]) / 3.0, 1e-12);
        }
        // Its power is that of the conductance on the phase's voltage.
        let power = fourier(0, |theta| {
            let i = bypass(theta);
            1.5 * (emf[0] * i[0] + emf[1] * i[1])
        });
        close(power.0, 0.5 * p[0] * (emf[0] * emf[0] + emf[1] * emf[1]), 1e-12);
    }

    #[test]
    fn the_start_is_steady_in_the_phase() {
        let at = Electrical { emf: [-20.0, 90.0], ..crate::effects::testing::winding([0.0; 2], 0.4, 0.0) };
        let (mut x, mut dx) = ([0.0], [1.0]);
        let p = [0.02, 1.2e-4, 2.0];
        InterTurnShort::electrical_start(&p, at.emf, at.sin_cos, &CX, &mut x);
        InterTurnShort::electrical_states(&p, &x, &at, &CX, &mut dx);
        close(dx[0], 0.0, 1e-9);
    }
}
