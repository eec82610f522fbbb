//! A synthetic run that excites everything a model can show: speed reversals, steps and dither in both axes, heating.

use pmsm_core::base::BASE;
use pmsm_core::effect::Env;
use pmsm_core::effects::EffectId;
use pmsm_core::machine::{BaseParameter, Machine};
use pmsm_core::model::Model;
use pmsm_core::numerics::real::Real;
use pmsm_core::numerics::transforms::inverse_park;
use pmsm_core::recording::{Load, Recording};
use pmsm_core::signals::Signals;
use pmsm_core::simulate::mechanical::{self, Nuisance, Restart};
use pmsm_core::simulate::{electrical, quasi_static};
use std::f64::consts::TAU;

/// r_s, l_d, l_q, psi_m, j, b of the motor.
pub const MACHINE: [f64; BASE] = [0.895, 9.57e-3, 21.27e-3, 0.1928, 0.0126, 0.0017];
/// Its pole pairs.
pub const N_P: f64 = 3.0;

/// The motor's nameplate.
pub fn machine() -> Machine {
    let bare = Machine::new(3).unwrap().with_drive(Some(540.0), Some(11.0), None).unwrap();
    BaseParameter::ALL.iter().fold(bare, |m, p| m.with(*p, MACHINE[p.index()]).unwrap())
}

/// A run of 0.48 s without noise, through standstill in both directions, from a bare machine without load.
/// `heated` adds logged temperatures.
pub fn run(heated: bool) -> Signals {
    let [r_s, l_d, l_q, psi_m, j, b] = MACHINE;
    let (n, h) = (4_000_usize, 1.2e-4);
    let square = |x: f64| if x.sin() >= 0.0 { 1.0 } else { -1.0 };
    let smooth = |x: f64| (x.sin() * 6.0).tanh();
    let current = |t: f64| {
        let dither = 0.3 * square(TAU * 130.0 * t);
        [
            -2.5 + 2.5 * smooth(TAU * 9.0 * t) + dither,
            7.0 * (TAU * 4.0 * t + 0.5).cos() + smooth(TAU * 23.0 * t),
        ]
    };
    let mut columns: Vec<(&str, Vec<f64>)> = ["t", "v_d", "v_q", "i_a", "i_b", "i_c", "theta_m", "omega_m"]
        .map(|name| (name, Vec::new()))
        .to_vec();
    let (mut omega_m, mut theta_m) = (2.0, 0.4);
    for k in 0..n {
        let t = k as f64 * h;
        let (now, next) = (current(t), current(t + h));
        let mean = [0.5 * (now[0] + next[0]), 0.5 * (now[1] + next[1])];
        let omega = N_P * omega_m;
        let v_d = r_s * mean[0] + l_d * (next[0] - now[0]) / h - omega * l_q * mean[1];
        let v_q = r_s * mean[1] + l_q * (next[1] - now[1]) / h + omega * (psi_m + l_d * mean[0]);
        let (s, c) = (N_P * theta_m).sin_cos();
        let [a, b_, c_] = inverse_park(now, c, s);
        for ((_, column), x) in columns.iter_mut().zip([t, v_d, v_q, a, b_, c_, theta_m, omega_m]) {
            column.push(x);
        }
        let tau = 1.5 * N_P * (psi_m + (l_d - l_q) * mean[0]) * mean[1];
        let faster = omega_m + h * (tau - b * omega_m) / j;
        theta_m += 0.5 * h * (omega_m + faster);
        omega_m = faster;
    }
    if heated {
        let ramp = |rise: f64| (0..n).map(|k| 20.0 + rise * k as f64 / n as f64).collect();
        columns.extend([("temperature", ramp(40.0)), ("temperature_magnet", ramp(25.0))]);
    }
    signals(columns, Load::None)
}

/// Steady operating points of the bare machine in all four quadrants.
pub fn operating_points() -> Signals {
    let [r_s, l_d, l_q, psi_m, ..] = MACHINE;
    let mut columns: Vec<(&str, Vec<f64>)> =
        ["t", "v_d", "v_q", "i_d", "i_q", "theta_e", "omega_e", "temperature", "temperature_magnet"]
            .map(|name| (name, Vec::new()))
            .to_vec();
    for k in 0..60_u32 {
        let x = f64::from(k);
        let (i_d, i_q, omega) = (-2.0 + 2.0 * x.cos(), 8.0 * (2.1 * x).sin(), 500.0 * (0.7 * x).cos());
        let v_d = r_s * i_d - omega * l_q * i_q;
        let v_q = r_s * i_q + omega * (psi_m + l_d * i_d);
        let row =
            [2.5 * x, v_d, v_q, i_d, i_q, (1.7 * x).rem_euclid(TAU), omega, 20.0 + 0.5 * x, 20.0 + 0.3 * x];
        for ((_, column), x) in columns.iter_mut().zip(row) {
            column.push(x);
        }
    }
    signals(columns, Load::UnknownConstant)
}

fn signals(columns: Vec<(&str, Vec<f64>)>, load: Load) -> Signals {
    let columns = columns.into_iter().map(|(name, x)| (name.to_string(), x)).collect();
    Signals::new(&Recording::new(columns, Some(load)).unwrap(), &machine()).unwrap()
}

struct Measured<'a>(&'a Signals);

impl<T: Real> Restart<T> for Measured<'_> {
    fn speed(&mut self, _: usize, k: usize) -> T {
        T::constant(self.0.omega_e[k])
    }
    fn forget(&self, _: &mut T) {}
}

/// What a model shows in every simulation that the recording allows, one sample after the other.
pub fn simulate<T: Real>(model: &Model, signals: &Signals, p: &[T]) -> Vec<T> {
    let mut out = Vec::new();
    if signals.period > 0.05 {
        quasi_static::run(model, signals, p, |_, v| out.extend(v));
        return out;
    }
    electrical::run(model, signals, p, |_, i| out.extend(i));
    let torque = mechanical::torque(model, signals, p);
    let initial = vec![T::zero(); model.mechanical_states()];
    let load = (Nuisance::known(model.mechanical_states()), &initial[..]);
    let windows = mechanical::windows(signals);
    mechanical::run(model, signals, p, &torque, load, &windows, Measured(signals), |_, _, w| out.push(w));
    out
}

/// The motor's parameters followed by those of one effect.
pub fn with(own: &[f64]) -> Vec<f64> {
    [&MACHINE[..], own].concat()
}

/// Typical parameters of an effect.
pub fn typical(effect: EffectId, signals: &Signals) -> Vec<f64> {
    effect.info().parameters.iter().map(|p| (p.typical)(&signals.context)).collect()
}

/// The machine at standstill at an electrical angle.
pub fn still(theta_e: f64) -> Env<f64> {
    Env { t: 0.0, omega_e: 0.0, theta_e, theta_m: theta_e / N_P, heating: 0.0, magnet_heating: 0.0 }
}
