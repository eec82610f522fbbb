//! What the tests of the effects share: a servo motor, the scales of a run, and points at which hooks are evaluated.

use crate::base::Base;
use crate::effect::{Context, Effect, Electrical, Env, Mechanical, Rotor};
use std::f64::consts::TAU;

/// r_s, l_d, l_q, psi_m, j, b of the motor.
pub const MACHINE: [f64; 6] = [0.9, 9.6e-3, 21.3e-3, 0.193, 0.0126, 0.0017];

/// The scales of a run with it.
pub const CX: Context = Context {
    n_p: 3.0,
    i_max: 10.0,
    v_max: 200.0,
    omega_e_max: 600.0,
    tau_max: 10.0,
    psi_max: 0.3,
    swing: 100.0,
    duration: 6.0,
    period: 8e-5,
    v_dc: 540.0,
    electrical_rate: 94.0,
    zero_sequence: 0.0,
    completed_phase: None,
    load_known: false,
    steady: false,
    has_temperature: false,
    has_magnet_temperature: false,
};

/// The motor's base parameters.
pub fn base() -> Base<f64> {
    Base::new(&MACHINE)
}

/// The machine at an electrical angle and speed.
pub fn env(theta_e: f64, omega_e: f64) -> Env<f64> {
    Env { t: 0.0, omega_e, theta_e, theta_m: theta_e / CX.n_p, heating: 0.0, magnet_heating: 0.0 }
}

/// The winding at a current, an electrical angle and speed.
pub fn winding(i: [f64; 2], theta_e: f64, omega_e: f64) -> Electrical<f64> {
    let env = env(theta_e, omega_e);
    Electrical { env, sin_cos: theta_e.sin_cos(), i, r_s: MACHINE[0], v: [0.0; 2], emf: [0.0; 2] }
}

/// The shaft at a mechanical angle and speed and a motor torque.
pub fn shaft(theta_m: f64, omega_m: f64, tau_e: f64) -> Mechanical<f64> {
    let env = env(theta_m * CX.n_p, omega_m * CX.n_p);
    Mechanical { env, omega_m, tau_e, tau_load: 0.0, j: MACHINE[4] }
}

/// Torque that an effect without states takes from the rotor.
pub fn loss<E: Effect>(p: &[f64], at: &Mechanical<f64>) -> f64 {
    let mut rotor = Rotor { inverse_inertia: 1.0 / MACHINE[4], loss: 0.0, load: 0.0 };
    E::rotor(p, &[], at, &CX, &mut rotor);
    rotor.loss
}

/// Voltage that an effect takes from the winding.
pub fn lost<E: Effect>(p: &[f64], x: &[f64], at: &Electrical<f64>) -> [f64; 2] {
    let mut lost = [0.0; 2];
    E::voltage(p, x, at, &CX, &mut lost);
    lost
}

/// Fourier coefficient (cosine, sine) of a function of an angle at a whole order; the mean at order zero.
pub fn fourier(order: u32, f: impl Fn(f64) -> f64) -> (f64, f64) {
    let n = 20_000;
    let (mut cosine, mut sine) = (0.0, 0.0);
    for k in 0..n {
        let angle = (f64::from(k) + 0.5) / f64::from(n) * TAU;
        let (s, c) = (f64::from(order) * angle).sin_cos();
        cosine += f(angle) * c;
        sine += f(angle) * s;
    }
    let weight = if order == 0 { 1.0 } else { 2.0 } / f64::from(n);
    (cosine * weight, sine * weight)
}

/// Asserts that two numbers agree within a relative (below one: absolute) tolerance.
#[track_caller]
pub fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance * b.abs().max(1.0), "{a} is not {b}");
}
