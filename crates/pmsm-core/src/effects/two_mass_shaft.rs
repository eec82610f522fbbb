//! Elastic shaft between rotor and load. With the load's share κ of the inertia J, the antiresonance ω_ar and its
//! damping ζ, the shaft torque is τ_s = x_1 + 2ζω_ar·J·x_2 where
//!
//! > dx_1/dt = J·ω_ar²·x_2,  dx_2/dt = κ·dω_m/dt − (τ_s − τ_load)/J,  J(1−κ)·dω_m/dt = τ_e − b·ω_m − τ_s,
//!
//! x_1 being the spring torque and x_2 = κ·(ω_m − ω_load). At κ = 0 and a constant load this is the rigid machine.
//! f_ar = √(k/J_L)/2π, f_r = f_ar/√(1−κ). Source: Ellis & Lorenz, IEEE IAS (2000), "Resonant load control methods".

use crate::effect::{Context, Derived, Effect, Info, Mechanical, Need, Output, Parameter, Role, Rotor, Site};
use crate::base::Base;
use crate::numerics::real::Real;
use std::f64::consts::TAU;

/// See the module's documentation.
pub struct TwoMassShaft;

#[inline(always)]
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
                low: &|_| 0.0,
                high: &|_| 0.97,
                typical: &|_| 0.5,
            },
            Parameter {
                name: "f_antires",
                unit: "Hz",
                meaning: "antiresonance: the load swinging on a held rotor",
                role: Role::Shape,
                low: &|cx| 2.0 / cx.duration,
                high: &|cx| (0.1 / cx.period).max(2.0 / cx.duration),
                typical: &|cx| 60f64.min(0.1 / cx.period).max(2.0 / cx.duration),
            },
            Parameter {
                name: "zeta",
                unit: "1",
                meaning: "damping of the antiresonance",
                role: Role::Shape,
                low: &|_| 2e-3,
                high: &|_| 1.0,
                typical: &|_| 0.03,
            },
        ],
    };
    const MECHANICAL_STATES: usize = 2;
    // A light load on a shaft shakes the rotor at another frequency than a heavy one.
    const FIRST_ORDER: bool = false;
    const DERIVED: &'static [Derived] = &[
        ("f_res", "Hz", "resonance: rotor and load swinging against each other"),
        ("k_shaft", "N m/rad", "stiffness of the shaft"),
    ];

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        let high = 600f64.min(0.04 / cx.period);
        let low = 8f64.max(3.0 / cx.duration).min(0.5 * high);
        let steps = ((high / low).ln() / 1.2f64.ln()).ceil().max(1.0) as i32;
        (0..=steps)
            .map(|k| low * (high / low).powf(f64::from(k) / f64::from(steps)))
            .map(|f| vec![0.5, f.clamp(2.0 / cx.duration, (0.1 / cx.period).max(2.0 / cx.duration)), 0.03])
            .collect()
    }

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], x: &[T], at: &Mechanical<T>, _: &Context, out: &mut Rotor<T>) {
        out.inverse_inertia = out.inverse_inertia / (T::one() - p[0]);
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

    fn ringing<T: Real>(p: &[T]) -> T {
        p[0].if_positive(p[1] / (T::one() - p[0]).sqrt(), T::zero())
    }

    fn outputs<T: Real>(p: &[T], base: &Base<T>, _: &Context) -> Vec<Output<T>> {
        let stiffness = p[0] * base.j * (p[1] * TAU).squared();
        vec![
            ("f_antires", "Hz", p[1]),
            ("f_res", "Hz", p[1] / (T::one() - p[0]).sqrt()),
            ("inertia_ratio", "1", p[0]),
            ("zeta", "1", p[2]),
            ("k_shaft", "N m/rad", stiffness),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, MACHINE, close, shaft};
    use nalgebra::{Complex, Matrix3, Vector3};

    const P: [f64; 3] = [0.4, 60.0, 0.003];

    /// d/dt of [ω_m, x_1, x_2] without friction.
    fn slope(p: &[f64], state: [f64; 3], tau_e: f64, tau_load: f64) -> [f64; 3] {
        let at = Mechanical { tau_load, ..shaft(0.0, state[0], tau_e) };
        let mut rotor = Rotor { inverse_inertia: 1.0 / at.j, loss: 0.0, load: tau_load };
        TwoMassShaft::rotor(p, &state[1..], &at, &CX, &mut rotor);
        let acceleration = (tau_e - rotor.load) * rotor.inverse_inertia;
        let mut dx = [0.0; 2];
        TwoMassShaft::mechanical_states(p, &state[1..], &at, acceleration, &CX, &mut dx);
        [acceleration, dx[0], dx[1]]
    }

    /// |ω_m/τ_e| at a frequency in Hz.
    fn response(f: f64) -> f64 {
        let unit = |k: usize| {
            let mut state = [0.0; 3];
            state[k] = 1.0;
            slope(&P, state, 0.0, 0.0)
        };
        let columns = [unit(0), unit(1), unit(2)];
        let system =
            Matrix3::from_fn(|r, c| Complex::new(-columns[c][r], if r == c { TAU * f } else { 0.0 }));
        let input = Vector3::from(slope(&P, [0.0; 3], 1.0, 0.0)).map(|x| Complex::new(x, 0.0));
        system.lu().solve(&input).expect("regular away from f = 0")[0].norm()
    }

    #[test]
    fn the_response_dips_at_the_antiresonance_and_peaks_at_the_resonance() {
        let out = TwoMassShaft::outputs(&P, &crate::effects::testing::base(), &CX);
        let (f_antires, f_res) = (out[0].2, out[1].2);
        close(f_res, 60.0 / 0.6f64.sqrt(), 1e-12);
        let grid: Vec<f64> = (400..1200).map(|k| 0.1 * f64::from(k)).collect();
        let lowest = grid.iter().copied().min_by(|a, b| response(*a).total_cmp(&response(*b))).unwrap();
        let highest = grid.iter().copied().max_by(|a, b| response(*a).total_cmp(&response(*b))).unwrap();
        assert!((lowest - f_antires).abs() < 0.11 && (highest - f_res).abs() < 0.11, "{lowest} {highest}");
        // Far below both, the shaft is rigid; far above, the rotor moves alone.
        close(response(0.5) * TAU * 0.5 * MACHINE[4], 1.0, 1e-3);
        close(response(5000.0) * TAU * 5000.0 * MACHINE[4] * 0.6, 1.0, 1e-3);
    }

    #[test]
    fn energy_of_both_masses_and_the_spring_leaves_only_through_the_damper() {
        let (j, omega) = (MACHINE[4], TAU * P[1]);
        let stiffness = P[0] * j * omega * omega;
        let state = [20.0, 1.5, 0.8];
        let (tau_e, tau_load) = (3.0, 1.2);
        let d = slope(&P, state, tau_e, tau_load);
        // x_2 = κ·(ω_m − ω_load); the spring stores x_1²/2k.
        let (load_speed, d_load) = (state[0] - state[2] / P[0], d[0] - d[2] / P[0]);
        let stored =
            j * (1.0 - P[0]) * state[0] * d[0] + j * P[0] * load_speed * d_load + state[1] * d[1] / stiffness;
        let damping = 2.0 * P[2] * omega * P[0] * j;
        let lost = damping * (state[0] - load_speed).powi(2);
        close(stored, tau_e * state[0] - tau_load * load_speed - lost, 1e-10);
    }

    #[test]
    fn the_start_has_both_masses_at_one_acceleration() {
        let (tau_e, tau_load) = (3.0, 1.2);
        let rigid = (tau_e - tau_load) / MACHINE[4];
        let at = Mechanical { tau_load, ..shaft(0.0, 20.0, tau_e) };
        let mut x = [0.0; 2];
        TwoMassShaft::mechanical_start(&P, &at, rigid, &CX, &mut x);
        let d = slope(&P, [20.0, x[0], x[1]], tau_e, tau_load);
        close(d[0], rigid, 1e-12);
        close(d[2], 0.0, 1e-9);
    }
}
