//! Load torque that changes in time by itself: τ(t) = a·cos 2πft + b·sin 2πft + c·t.
//!
//! Source: first terms of any slowly varying load; Ljung, System Identification, 2nd ed. (1999), section 14.4 (trends and
//! periodic disturbances).

use crate::effect::{Context, Derived, Effect, Info, Mechanical, Need, Output, Parameter, Role, Rotor, Site};
use crate::base::Base;
use crate::numerics::real::Real;
use std::f64::consts::TAU;

/// See the module's documentation.
pub struct TimeVaryingLoad;

/// Share of the mean in a load's mean square beyond which the mean is what there is of it: a slope with most of a swing on it can be nearly
/// the same all along, as a load is that is another one than stated. A ramp from nothing has three quarters.
const CONSTANT: f64 = 0.9;
/// Instants at which that is looked at.
const INSTANTS: usize = 64;

/// The load, N·m, at `t`, s.
#[inline(always)]
fn torque<T: Real>(p: &[T], t: T) -> T {
    let (s, c) = (p[3] * (t * TAU)).sin_cos();
    p[0] * c + p[1] * s + p[2] * t
}

impl Effect for TimeVaryingLoad {
    const INFO: Info = Info {
        id: "time_varying_load",
        title: "Load torque that varies in time",
        sentence: "The load torque rises, falls or swings in time, whatever the rotor does.",
        equation: "τ(t) = τ_1·cos(2πf t + φ) + c·t",
        source: "Ljung, System Identification (1999), section 14.4",
        fingerprint: "A torque that follows the clock, not speed, angle or current",
        look_alikes: &["quadratic_drag", "stribeck_friction", "load_torque_pulsation"],
        contains: &[],
        site: Site::Mechanical,
        needs: &[Need::Transients],
        parameters: &[
            Parameter::torque("a", "cosine part of the swing"),
            Parameter::torque("b", "sine part of the swing"),
            Parameter {
                name: "slope",
                unit: "N m/s",
                meaning: "steady rise",
                role: Role::Amplitude,
                low: &|cx| -cx.tau_max / cx.duration,
                high: &|cx| cx.tau_max / cx.duration,
                typical: &|cx| 0.005 * cx.tau_max / cx.duration,
            },
            Parameter {
                name: "f",
                unit: "Hz",
                meaning: "frequency of the swing",
                role: Role::Shape,
                // Less than most of a swing is a slope.
                low: &|cx| 0.8 / cx.duration,
                high: &|cx| (0.1 / cx.period).max(1.5 / cx.duration),
                typical: &|cx| 5f64.min(0.1 / cx.period).max(1.0 / cx.duration),
            },
        ],
    };
    const DERIVED: &'static [Derived] = &[
        ("amplitude", "N m", "amplitude of the swing"),
    ];

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        let step = 0.5 / cx.duration;
        // At least one full swing, however short the recording.
        let highest = 15f64.min(0.1 / cx.period).max(1.2 / cx.duration);
        (2..)
            .map(|k| f64::from(k) * step)
            .take_while(|f| *f < highest)
            .take(80)
            .map(|f| vec![0.0, 0.0, 0.0, f])
            .collect()
    }

    fn idles(p: &[f64], cx: &Context) -> bool {
        let load = |k: usize| torque(p, (k as f64 + 0.5) / INSTANTS as f64 * cx.duration);
        let (sum, squares) = (0..INSTANTS).map(load).fold((0.0, 0.0), |(sum, squares), x| (sum + x, squares + x * x));
        sum * sum > CONSTANT * squares * INSTANTS as f64
    }

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], _: &[T], at: &Mechanical<T>, _: &Context, out: &mut Rotor<T>) {
        out.loss += torque(p, at.env.t);
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![
            ("amplitude", "N m", (p[0].squared() + p[1].squared()).sqrt()),
            ("f", "Hz", p[3]),
            ("slope", "N m/s", p[2]),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, base, close, loss, shaft};

    #[test]
    fn the_torque_follows_the_clock_alone() {
        let p = [0.3, -0.4, 0.05, 4.0];
        let load = |t: f64, theta_m: f64, omega_m: f64| {
            let mut at = shaft(theta_m, omega_m, 2.0);
            at.env.t = t;
            loss::<TimeVaryingLoad>(&p, &at)
        };
        close(load(0.0, 0.0, 0.0), 0.3, 1e-14);
        close(load(1.0 / 16.0, 0.0, 0.0), -0.4 + 0.05 / 16.0, 1e-14);
        close(load(2.25, 1.0, -50.0) - load(2.0, 0.0, 50.0), 0.05 * 0.25, 1e-12);
        close(TimeVaryingLoad::outputs(&p, &base(), &CX)[0].2, 0.5, 1e-15);
    }

    #[test]
    fn a_load_that_is_the_same_all_along_does_not_vary() {
        let idles = |p: [f64; 4]| TimeVaryingLoad::idles(&p, &Context { duration: 2.0, ..CX });
        // Nearest to a constant, with four fifths of a swing in the recording.
        assert!(idles([0.368, 0.554, 0.952, 0.4]) && idles([-0.368, -0.554, -0.952, 0.4]));
        // A ramp from nothing, a swing, a swing on a ramp, and nothing.
        for p in [[0.0, 0.0, 0.5, 3.0], [0.0, 0.3, 0.0, 0.4], [0.2, 0.0, 0.3, 5.0], [0.0; 4]] {
            assert!(!idles(p), "{p:?}");
        }
    }

    #[test]
    fn tried_frequencies_fit_the_recording() {
        let f = &TimeVaryingLoad::INFO.parameters[3];
        for cx in [CX, Context { period: 0.02, duration: 40.0, ..CX }, Context { duration: 0.5, ..CX }] {
            let (low, high) = ((f.low)(&cx), (f.high)(&cx));
            let probes = TimeVaryingLoad::probes(&cx);
            assert!(!probes.is_empty() && probes.iter().all(|p| low <= p[3] && p[3] <= high));
        }
    }
}
