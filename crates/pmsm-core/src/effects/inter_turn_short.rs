//! Shorted turns in one phase x. A share μ of the turns with its resistance μ·r_s, closed over the fault resistance R_f, carries
//! i_f; the phase's magnetising current is its terminal current less y = μ·i_f, and so is the current in its resistance:
//!
//! > v_x = r_s·(i_x − y) + e_x,  τ_f·dy/dt = g_f·(e_x + r_s·i_x) − y,  g_f = μ²/(R_f + μ·r_s).
//!
//! What terminals show is g_f, not μ by itself.
//!
//! Source: Romeral, Urresty, Riba Ruiz & Garcia Espinosa, IEEE Trans. Industrial Electronics 58 (2011) 1996.

use crate::effect::{Context, Effect, Electrical, Info, Need, Output, Parameter, Role, Site};
use crate::terms::{PHASE, chosen};
use crate::base::Base;
use crate::numerics::real::Real;
use crate::numerics::transforms::{inverse_park, park};

/// See the module's documentation.
pub struct InterTurnShort;

impl Effect for InterTurnShort {
    const INFO: Info = Info {
        id: "inter_turn_short",
        title: "Inter-turn short circuit",
        sentence: "Some turns of one phase are shorted: a current circulates in them and loads the phase.",
        equation: "v_x = r_s·(i_x − μ·i_f) + e_x, (R_f + μ·r_s)·i_f = μ·(e_x + r_s·i_x)",
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
                meaning: "fault conductance seen from the phase, μ²/(R_f + μ·r_s)",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|cx| cx.i_max / cx.v_max,
                typical: &|cx| 0.01 * cx.i_max / cx.v_max,
            },
            Parameter {
                name: "tau_f",
                unit: "s",
                meaning: "time constant of the shorted turns",
                role: Role::Shape,
                low: &|cx| 0.6 * cx.period,
                high: &|cx| 50.0 * cx.period,
                typical: &|cx| 1.5 * cx.period,
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
    fn voltage<T: Real>(p: &[T], x: &[T], at: &Electrical<T>, _: &Context, lost: &mut [T; 2]) {
        let mut phases = [at.r_s * x[0]; 3];
        for (phase, v) in phases.iter_mut().enumerate() {
            *v = chosen(p[2], phase) * *v;
        }
        let [d, q] = park(phases, at.sin_cos.1, at.sin_cos.0);
        lost[0] -= d;
        lost[1] -= q;
    }

    #[inline(always)]
    fn electrical_states<T: Real>(p: &[T], x: &[T], at: &Electrical<T>, _: &Context, dx: &mut [T]) {
        dx[0] = (p[0] * driving(p, at) - x[0]) / p[1];
    }

    #[inline(always)]
    fn electrical_start<T: Real>(p: &[T], at: &Electrical<T>, _: &Context, x: &mut [T]) {
        x[0] = p[0] * driving(p, at);
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![("g_f", "S", p[0]), ("tau_f", "s", p[1]), ("phase", "1", p[2])]
    }
}

/// What drives the current in the shorted turns, e_x + r_s·i_x, V.
#[inline(always)]
fn driving<T: Real>(p: &[T], at: &Electrical<T>) -> T {
    let v = [at.emf[0] + at.r_s * at.i[0], at.emf[1] + at.r_s * at.i[1]];
    let phases = inverse_park(v, at.sin_cos.1, at.sin_cos.0);
    chosen(p[2], 0) * phases[0] + chosen(p[2], 1) * phases[1] + chosen(p[2], 2) * phases[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, close, fourier, winding};

    #[test]
    fn one_phase_in_three_draws_a_mean_and_a_negative_sequence() {
        let p = [0.02, 1.2e-4, 1.0];
        let emf = [-20.0, 90.0];
        let bypass = |theta: f64| {
            let at = Electrical { emf, ..winding([0.0; 2], theta, 0.0) };
            let (mut x, mut i) = ([0.0], [0.0; 2]);
            InterTurnShort::electrical_start(&p, &at, &CX, &mut x);
            InterTurnShort::shunt(&p, &x, at.sin_cos, &CX, &mut i);
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
        let at = Electrical { emf: [-20.0, 90.0], ..winding([7.0, -3.0], 0.4, 0.0) };
        let (mut x, mut dx) = ([0.0], [1.0]);
        let p = [0.02, 1.2e-4, 2.0];
        InterTurnShort::electrical_start(&p, &at, &CX, &mut x);
        InterTurnShort::electrical_states(&p, &x, &at, &CX, &mut dx);
        close(dx[0], 0.0, 1e-9);
    }

    #[test]
    fn without_fault_resistance_the_shorted_share_takes_its_resistance_along() {
        // All turns of the phase shorted through nothing (μ = 1): the loop's current is that of the whole e_x over r_s, and the
        // terminal sees no voltage in that phase.
        let (r_s, theta) = (0.5, 0.3f64);
        let at = Electrical { emf: [-20.0, 90.0], r_s, ..winding([7.0, -3.0], theta, 0.0) };
        let p = [1.0 / r_s, 1e-4, 0.0];
        let of_a = |x: [f64; 2]| inverse_park(x, at.sin_cos.1, at.sin_cos.0)[0];
        let x = [of_a(at.emf) / r_s + of_a(at.i)];
        let (mut dx, mut lost) = ([1.0], [0.0; 2]);
        InterTurnShort::electrical_states(&p, &x, &at, &CX, &mut dx);
        close(dx[0], 0.0, 1e-6);
        InterTurnShort::voltage(&p, &x, &at, &CX, &mut lost);
        let mut phases = [0.0; 3];
        phases[0] = -r_s * x[0];
        let expected = park(phases, at.sin_cos.1, at.sin_cos.0);
        close(lost[0], expected[0], 1e-12);
        close(lost[1], expected[1], 1e-12);
        // Terminal voltage of the phase alone: r_s·i_a + e_a − r_s·y = 0.
        close(r_s * of_a(at.i) + of_a(at.emf) + phases[0], 0.0, 1e-12);
    }
}
