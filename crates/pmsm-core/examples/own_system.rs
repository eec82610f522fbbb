//! Two machines that are no PMSM, identified with the package's swarm and least squares: a direct-current motor and an
//! induction machine. What a bench would have measured is simulated here, with noise.
//!
//! ```text
//! cargo run --release -p pmsm-core --example own_system
//! ```

use pmsm_core::error::Result;
use pmsm_core::monitor::Silent;
use pmsm_core::numerics::random::normal_pair;
use pmsm_core::numerics::real::Real;
use pmsm_core::system::{Observations, Request, System, SystemFit, identify};
use std::f64::consts::TAU;

/// Direct-current motor with permanent magnets, l·di/dt = v − r·i − k·ω, j·dω/dt = k·i − b·ω − τ_c·tanh(ω/ω_0), with
/// ω_0 = 1 rad/s; p = [r, l, k, j, b, τ_c], input v, outputs i and ω.
pub struct DcMotor;

impl DcMotor {
    /// Names, bounds and true values.
    pub const PARAMETERS: [(&'static str, (f64, f64), f64); 6] = [
        ("r", (0.1, 5.0), 0.8),
        ("l", (1e-4, 1e-2), 1.5e-3),
        ("k", (0.01, 0.2), 0.05),
        ("j", (1e-6, 1e-3), 4e-5),
        ("b", (0.0, 1e-3), 2e-5),
        ("tau_c", (0.0, 0.05), 0.004),
    ];
}

impl System<2, 2> for DcMotor {
    fn start<T: Real>(&self, _: &[T]) -> [T; 2] {
        [T::zero(); 2]
    }

    fn rhs<T: Real>(&self, p: &[T], _: f64, x: &[T; 2], u: &[f64]) -> [T; 2] {
        let [r, l, k, j, b, tau_c] = [p[0], p[1], p[2], p[3], p[4], p[5]];
        let [i, omega] = *x;
        let friction = b * omega + tau_c * omega.tanh();
        [(-(r * i) - k * omega + u[0]) / l, (k * i - friction) / j]
    }

    fn output<T: Real>(&self, _: &[T], _: f64, x: &[T; 2], _: &[f64]) -> [T; 2] {
        *x
    }
}

/// Induction machine of two pole pairs, inverse-Γ circuit in stator coordinates (Slemon, IEEE Trans. Industry
/// Applications 25 (1989) 1126):
///
/// dψ_s/dt = v_s − r_s·i_s, dψ_r/dt = r_r·i_s − (r_r/l_m)·ψ_r + ω·Jψ_r, i_s = (ψ_s − ψ_r)/l_σ,
/// j·dω_m/dt = 3/2·n_p·(ψ_r × i_s) − b·ω_m, ω = n_p·ω_m
///
/// p = [r_s, r_r, l_σ, l_m, j, b], inputs v_α, v_β, outputs i_α, i_β, ω_m.
pub struct InductionMachine;

impl InductionMachine {
    /// Pole pairs.
    pub const N_P: f64 = 2.0;
    /// Names, bounds and true values: 2.2 kW, 400 V.
    pub const PARAMETERS: [(&'static str, (f64, f64), f64); 6] = [
        ("r_s", (0.5, 10.0), 3.7),
        ("r_r", (0.5, 10.0), 2.1),
        ("l_sigma", (0.005, 0.1), 0.021),
        ("l_m", (0.05, 1.0), 0.224),
        ("j", (0.001, 0.1), 0.0155),
        ("b", (0.0, 0.1), 0.005),
    ];
}

impl System<5, 3> for InductionMachine {
    fn start<T: Real>(&self, _: &[T]) -> [T; 5] {
        [T::zero(); 5]
    }

    fn rhs<T: Real>(&self, p: &[T], _: f64, x: &[T; 5], u: &[f64]) -> [T; 5] {
        let [r_s, r_r, l_sigma, l_m, j, b] = [p[0], p[1], p[2], p[3], p[4], p[5]];
        let [s_a, s_b, r_a, r_b, omega_m] = *x;
        let [i_a, i_b] = [(s_a - r_a) / l_sigma, (s_b - r_b) / l_sigma];
        let omega = omega_m * Self::N_P;
        let tau_e = (r_a * i_b - r_b * i_a) * (1.5 * Self::N_P);
        [
            -(r_s * i_a) + u[0],
            -(r_s * i_b) + u[1],
            r_r * (i_a - r_a / l_m) - omega * r_b,
            r_r * (i_b - r_b / l_m) + omega * r_a,
            (tau_e - b * omega_m) / j,
        ]
    }

    fn output<T: Real>(&self, p: &[T], _: f64, x: &[T; 5], _: &[f64]) -> [T; 3] {
        [(x[0] - x[2]) / p[2], (x[1] - x[3]) / p[2], x[4]]
    }
}

/// Simulates `system` at `truth` and adds noise of the given sizes to its outputs.
pub fn measured<const N: usize, const M: usize>(
    system: &impl System<N, M>,
    truth: &[f64],
    t: Vec<f64>,
    inputs: Vec<Vec<f64>>,
    noise: [f64; M],
) -> Result<Observations> {
    let run = Observations::new(t.clone(), inputs.clone(), vec![vec![0.0; t.len()]; M])?.with_substeps(2);
    let mut outputs = run.simulate(system, truth);
    for (c, (column, size)) in outputs.iter_mut().zip(noise).enumerate() {
        for (k, x) in column.iter_mut().enumerate() {
            *x += size * normal_pair(1, [k as u32, c as u32, 0, 0]).0;
        }
    }
    Ok(Observations::new(t, inputs, outputs)?.with_substeps(2))
}

/// The motor started on 12 V, reversed, and let run down.
pub fn dc_motor() -> Result<SystemFit> {
    let t: Vec<f64> = (0..1500).map(|k| f64::from(k) * 4e-4).collect();
    let voltage = t
        .iter()
        .map(|t| {
            if *t < 0.25 {
                12.0
            } else if *t < 0.45 {
                -8.0
            } else {
                0.0
            }
        })
        .collect();
    let truth = DcMotor::PARAMETERS.map(|p| p.2);
    let run = measured(&DcMotor, &truth, t, vec![voltage], [0.05, 0.5])?;
    identify(&DcMotor, &run, &DcMotor::PARAMETERS.map(|p| (p.0, p.1)), &Request::default(), &Silent)
}

/// The machine switched onto the 50 Hz mains, which after half a second give way to half the voltage at 25 Hz.
pub fn induction_machine() -> Result<SystemFit> {
    let t: Vec<f64> = (0..2000).map(|k| f64::from(k) * 4e-4).collect();
    let vector = |part: fn(f64) -> f64| -> Vec<f64> {
        let at = |t: f64| if t < 0.5 { (326.6, TAU * 50.0 * t) } else { (163.3, TAU * 25.0 * t) };
        t.iter().map(|t| at(*t)).map(|(size, angle)| size * part(angle)).collect()
    };
    let inputs = vec![vector(f64::cos), vector(f64::sin)];
    let truth = InductionMachine::PARAMETERS.map(|p| p.2);
    let run = measured(&InductionMachine, &truth, t, inputs, [0.1, 0.1, 0.3])?;
    let parameters = InductionMachine::PARAMETERS.map(|p| (p.0, p.1));
    identify(&InductionMachine, &run, &parameters, &Request::default(), &Silent)
}

fn main() -> Result<()> {
    let machines = [
        ("Direct-current motor", dc_motor()?, DcMotor::PARAMETERS),
        ("Induction machine", induction_machine()?, InductionMachine::PARAMETERS),
    ];
    for (title, fit, parameters) in machines {
        println!("{title}, {} evaluations", fit.evaluations);
        for (name, _, truth) in parameters {
            let estimate = fit.get(name).expect("it was asked for");
            let value = estimate.value.unwrap_or(f64::NAN);
            let spread = estimate.stderr.map_or("?".into(), |e| format!("{e:.1e}"));
            println!("  {name:8} {value:.4e} ± {spread}   true {truth:.4e}");
        }
    }
    Ok(())
}
