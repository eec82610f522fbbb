//! One phase has more resistance than the others (a bad joint, a corroded terminal): that phase loses ρ·r_s·i_x more.
//!
//! Source: Hang, Zhang, Cheng & Huang, IEEE Trans. Energy Conversion 30 (2015) 1366 (high-resistance connection).

use crate::effect::{Context, Effect, Electrical, Info, Need, Output, Parameter, Role, Site};
use crate::base::Base;
use crate::numerics::real::Real;
use crate::terms::{PHASE, chosen};
use crate::numerics::transforms::{inverse_park, park};

/// See the module's documentation.
pub struct PhaseResistanceImbalance;

impl Effect for PhaseResistanceImbalance {
    const INFO: Info = Info {
        id: "phase_resistance_imbalance",
        title: "Unequal phase resistance",
        sentence: "One phase has more resistance than the others: a bad joint or terminal.",
        equation: "r_x = r_s·(1 + ρ) in one phase",
        source: "Hang, Zhang, Cheng & Huang, IEEE Trans. Energy Conversion 30 (2015) 1366",
        fingerprint: "2nd electrical order in both voltages in proportion to the current, at any speed",
        look_alikes: &["inter_turn_short", "current_gain_imbalance", "dead_time"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Angle, Need::Transients, Need::Current],
        parameters: &[
            Parameter {
                name: "r_excess_rel",
                unit: "1",
                meaning: "extra resistance of the phase, share of r_s",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|_| 5.0,
                typical: &|_| 0.05,
            },
            PHASE,
        ],
    };
    const TURNS: bool = false;

    fn probes(_: &Context) -> Vec<Vec<f64>> {
        [0.0, 1.0, 2.0].map(|phase| vec![0.0, phase]).to_vec()
    }

    #[inline(always)]
    fn voltage<T: Real>(p: &[T], _: &[T], at: &Electrical<T>, _: &Context, lost: &mut [T; 2]) {
        let (s, c) = at.sin_cos;
        let mut phases = inverse_park(at.i, c, s);
        for (x, i) in phases.iter_mut().enumerate() {
            *i = *i * chosen(p[1], x) * p[0] * at.r_s;
        }
        let [d, q] = park(phases, c, s);
        lost[0] += d;
        lost[1] += q;
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![("r_excess_rel", "1", p[0]), ("phase", "1", p[1])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{MACHINE, close, fourier, lost, winding};

    #[test]
    fn a_third_of_the_excess_is_mean_and_a_third_turns_twice() {
        let i = [-3.0, 6.0];
        for phase in [0.0, 1.0, 2.0] {
            for axis in 0..2 {
                let voltage = |theta: f64| {
                    lost::<PhaseResistanceImbalance>(&[0.2, phase], &[], &winding(i, theta, 100.0))[axis]
                };
                close(fourier(0, voltage).0, 0.2 * MACHINE[0] * i[axis] / 3.0, 1e-12);
                let (a, b) = fourier(2, voltage);
                close(a.hypot(b), 0.2 * MACHINE[0] * i[0].hypot(i[1]) / 3.0, 1e-12);
            }
        }
    }

    #[test]
    fn the_loss_is_in_the_phase_concerned() {
        // Phase b's axis lies 2π/3 ahead of a's; a current along it flows in b in full.
        let theta = std::f64::consts::TAU / 3.0;
        let at = winding([5.0, 0.0], theta, 0.0);
        let v = lost::<PhaseResistanceImbalance>(&[0.2, 1.0], &[], &at);
        close(1.5 * (v[0] * 5.0), 0.2 * MACHINE[0] * 25.0, 1e-12);
        let across = winding([0.0, 5.0], theta, 0.0);
        close(lost::<PhaseResistanceImbalance>(&[0.2, 1.0], &[], &across)[1], 0.0, 1e-12);
    }
}
