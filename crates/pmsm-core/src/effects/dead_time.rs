//! Inverter dead time and device drops: every phase loses v_err against the sign of its current,
//! v_lost,x = v_err·i_x/√(i_x² + i_th²), x = a, b, c. Below i_th the current no longer commutes the leg. Of a steady operating
//! point only the mean over a revolution shows, 4/π·v_err along the current.
//!
//! v_err = v_dc·t_dead·f_sw plus the devices' threshold; their resistance adds to r_s. Source: Bolognani, Peretti & Zigliotto,
//! IEEE Trans. Industrial Electronics 58 (2011) 5070.

use crate::effect::{Context, Effect, Electrical, Info, Need, Parameter, Role, Site};
use crate::numerics::real::Real;
use crate::numerics::transforms::{inverse_park, park};

/// Fundamental of a square wave.
const FRAC_4_PI: f64 = 4.0 / std::f64::consts::PI;

/// See the module's documentation.
pub struct DeadTime;

impl Effect for DeadTime {
    const INFO: Info = Info {
        id: "dead_time",
        title: "Inverter dead time",
        sentence: "The inverter's dead time and device drops take a voltage away against the sign of each phase current.",
        equation: "v_x = v_x* − v_err·i_x/√(i_x² + i_th²)",
        source: "Bolognani, Peretti & Zigliotto, IEEE Trans. Industrial Electronics 58 (2011) 5070",
        fingerprint: "Voltage along the current that does not grow with it, with 6th and 12th electrical orders",
        look_alikes: &["rs_thermal_drift", "back_emf_harmonics", "phase_resistance_imbalance"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::AngleOrSteady, Need::Current],
        parameters: &[
            Parameter {
                name: "v_err",
                unit: "V",
                meaning: "voltage lost per phase against the current's sign",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|cx| 0.5 * cx.v_max,
                typical: &|cx| 0.01 * cx.v_max,
            },
            Parameter {
                name: "i_th",
                unit: "A",
                meaning: "current below which the leg does not commutate fully",
                role: Role::Shape,
                low: &|cx| 1e-3 * cx.i_max,
                high: &|cx| 0.3 * cx.i_max,
                typical: &|cx| 0.02 * cx.i_max,
            },
        ],
    };
    const FORM: f64 = 0.02;
    const TURNS: bool = false;

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        [0.01, 0.05].map(|x| vec![0.0, x * cx.i_max]).to_vec()
    }

    fn steepness<T: Real>(p: &[T], cx: &Context) -> T {
        if cx.steady { T::zero() } else { p[0] / p[1] }
    }

    #[inline(always)]
    fn voltage<T: Real>(p: &[T], _: &[T], at: &Electrical<T>, cx: &Context, lost: &mut [T; 2]) {
        if cx.steady {
            // The mean over a revolution lies along the current: 4/π·v_err far above i_th, v_err/i_th of it far below.
            let size = at.i[0].squared() + at.i[1].squared() + (p[1] * FRAC_4_PI).squared();
            let share = p[0] * FRAC_4_PI / size.sqrt();
            lost[0] += share * at.i[0];
            lost[1] += share * at.i[1];
            return;
        }
        let (s, c) = at.sin_cos;
        let mut phases = inverse_park(at.i, c, s);
        for i in &mut phases {
            *i = p[0] * *i / (i.squared() + p[1].squared()).sqrt();
        }
        let [d, q] = park(phases, c, s);
        lost[0] += d;
        lost[1] += q;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, close, fourier, lost, winding};
    use std::f64::consts::PI;

    /// Lost voltage along and across the current of size `i`, at the angle of the current.
    fn around(i: f64, theta: f64) -> [f64; 2] {
        lost::<DeadTime>(&[2.0, 1e-3], &[], &winding([i, 0.0], theta, 0.0))
    }

    #[test]
    fn an_operating_point_shows_the_mean_over_a_revolution() {
        let cx = Context { steady: true, ..CX };
        for i in [0.02, 8.0] {
            let mut mean = [0.0; 2];
            DeadTime::voltage(&[2.0, 0.5], &[], &winding([0.6 * i, 0.8 * i], 0.0, 0.0), &cx, &mut mean);
            let expected = fourier(0, |x| lost::<DeadTime>(&[2.0, 0.5], &[], &winding([0.6 * i, 0.8 * i], x, 0.0))[1]).0;
            assert!((mean[1] / expected - 1.0).abs() < 0.02 && (mean[0] / mean[1] - 0.75).abs() < 1e-12);
        }
    }

    #[test]
    fn square_waves_leave_a_mean_along_the_current_and_a_sixth_order_across_it() {
        // sgn(cos x) = 4/π·(cos x − cos 3x/3 + cos 5x/5 − cos 7x/7 …): orders 5 and 7 turn six times in the frame of the
        // current, orders 11 and 13 twelve times.
        let per_volt = 2.0 * 4.0 / PI;
        close(fourier(0, |x| around(8.0, x)[0]).0, per_volt, 1e-3);
        close(fourier(0, |x| around(8.0, x)[1]).0, 0.0, 1e-9);
        close(fourier(6, |x| around(8.0, x)[0]).0, per_volt * (1.0 / 5.0 - 1.0 / 7.0), 1e-3);
        close(fourier(6, |x| around(8.0, x)[1]).1.abs(), per_volt * (1.0 / 5.0 + 1.0 / 7.0), 1e-3);
        close(fourier(12, |x| around(8.0, x)[1]).1.abs(), per_volt * (1.0 / 11.0 + 1.0 / 13.0), 1e-3);
    }

    #[test]
    fn the_mean_does_not_grow_with_the_current() {
        close(fourier(0, |x| around(8.0, x)[0]).0, fourier(0, |x| around(2.0, x)[0]).0, 1e-3);
    }

    #[test]
    fn far_below_the_threshold_it_is_a_resistance() {
        let v = lost::<DeadTime>(&[2.0, 0.5], &[], &winding([1e-4, 2e-4], 0.7, 0.0));
        close(v[0] / (1e-4 * 2.0 / 0.5), 1.0, 1e-6);
        close(v[1] / (2e-4 * 2.0 / 0.5), 1.0, 1e-6);
    }
}
