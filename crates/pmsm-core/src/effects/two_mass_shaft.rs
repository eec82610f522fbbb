//! Elastic shaft between rotor and load. With the load's share κ of the inertia J, the antiresonance ω_ar and its
//! damping ζ, the shaft torque is τ_s = x_1 + 2ζω_ar·J·x_2 where
//!
//! > dx_1/dt = J·ω_ar²·x_2,  dx_2/dt = κ·dω_m/dt − (τ_s − τ_load)/J,  J(1−κ)·dω_m/dt = τ_e − b·ω_m − τ_s,
//!
//! x_1 being the spring torque and x_2 = κ·(ω_m − ω_load). At κ = 0 and a constant load this is the rigid machine.
//! f_ar = √(k/J_L)/2π, f_r = f_ar/√(1−κ). Source: Ellis & Lorenz, IEEE IAS (2000), "Resonant load control methods".

use crate::effect::{Context, Effect, Info, Mechanical, Need, Output, Parameter, Role, Rotor, Site};
use crate::model::Base;
use crate::real::Real;
use std::f64::consts::TAU;

/// See the module's documentation.
pub struct TwoMassShaft;

fn shaft_torque<T: Real>(p: &[T], x: &[T], j: T) -> T {
    x[0] + p[2] * p[1] * j * x[1] * (2.0 * TAU)
}

impl Effect for TwoMassShaft {
    const INFO: Info = Info {
        id: "two_mass_shaft",
        title: "Elastic shaft",
        sentence: "Rotor and load are joined by a shaft that twists: two masses swing against each other.",
        equation: "J_L·dω_L/dt = k·φ + d·(ω_m − ω_L) − τ_load, dφ/dt = ω_m − ω_L",
        source: "Ellis & Lorenz, Resonant load control methods, IEEE IAS (2000)",
        fingerprint: "Ringing at a fixed frequency in the speed after torque steps; antiresonance below resonance",
        look_alikes: &["time_varying_load", "cogging_torque"],
        contains: &[],
        site: Site::Mechanical,
        needs: &[Need::Transients],
        parameters: &[
            Parameter {
                name: "inertia_ratio",
                unit: "1",
                meaning: "the load's share of the whole inertia",
                role: Role::Amplitude,
                low: |_| 0.0,
                high: |_| 0.97,
                typical: |_| 0.5,
            },
            Parameter {
                name: "f_antires",
                unit: "Hz",
                meaning: "antiresonance: the load swinging on a held rotor",
                role: Role::Shape,
                low: |cx| 2.0 / cx.duration,
                high: |cx| 0.1 / cx.period,
                typical: |_| 60.0,
            },
            Parameter {
                name: "zeta",
                unit: "1",
                meaning: "damping of the antiresonance",
                role: Role::Shape,
                low: |_| 1e-4,
                high: |_| 1.0,
                typical: |_| 0.03,
            },
        ],
    };
    const MECHANICAL_STATES: usize = 2;

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        let (low, high) = (8f64.max(3.0 / cx.duration), 600f64.min(0.04 / cx.period));
        let steps = ((high / low).ln() / 1.2f64.ln()).ceil().max(1.0) as i32;
        (0..=steps).map(|k| vec![0.5, low * (high / low).powf(f64::from(k) / f64::from(steps)), 0.03]).collect()
    }

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], x: &[T], at: &Mechanical<T>, _: &Context, out: &mut Rotor<T>) {
        out.inertia = at.j * (T::one() - p[0]);
        out.load = shaft_torque(p, x, at.j);
    }

    #[inline(always)]
    fn mechanical_states<T: Real>(
        p: &[T],
        x: &[T],
        at: &Mechanical<T>,
        acceleration: T,
        _: &Context,
        dx: &mut [T],
    ) {
        let omega = p[1] * TAU;
        dx[0] = at.j * omega.squared() * x[1];
        dx[1] = p[0] * acceleration - (shaft_torque(p, x, at.j) - at.tau_load) / at.j;
    }

    fn mechanical_start<T: Real>(p: &[T], at: &Mechanical<T>, acceleration: T, _: &Context, x: &mut [T]) {
        x[0] = at.tau_load + p[0] * at.j * acceleration;
        x[1] = T::zero();
    }

    fn outputs<T: Real>(p: &[T], base: &Base<T>, _: &Context) -> Vec<Output<T>> {
        let stiffness = p[0] * base.j * (p[1] * TAU).squared();
        vec![
            ("f_antires", "Hz", p[1]),
            ("f_res", "Hz", p[1] / (T::one() - p[0]).sqrt()),
            ("inertia_ratio", "1", p[0]),
            ("zeta", "1", p[2]),
            ("k_shaft", "N m", stiffness),
        ]
    }
}
