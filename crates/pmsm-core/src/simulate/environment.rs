//! Where the machine is at a sample: time, speed, angles and temperatures, as they were measured and as they are behind the sensors.

use crate::effect::{Env, Sensor};
use crate::numerics::real::Real;
use crate::signals::Signals;

/// The environment at sample `k`, in the measured frame.
#[inline(always)]
pub fn measured_env<T: Real>(signals: &Signals, k: usize) -> Env<T> {
    Env {
        t: T::constant(signals.t[k]),
        omega_e: T::constant(signals.omega_e[k]),
        theta_e: T::constant(signals.theta_e[k]),
        theta_m: T::constant(signals.theta_m[k]),
        heating: signals.heating.as_ref().map_or(0.0, |x| x[k]),
        magnet_heating: signals.magnet_heating.as_ref().map_or(0.0, |x| x[k]),
    }
}

/// The environment behind the measured one, once the sensor's angle error is taken away.
#[inline(always)]
pub fn true_env<T: Real>(sensor: &Sensor<T>, measured: &Env<T>, n_p: f64) -> Env<T> {
    Env {
        theta_e: measured.theta_e - sensor.angle,
        theta_m: measured.theta_m - sensor.angle * (1.0 / n_p),
        omega_e: measured.omega_e * (T::one() - sensor.angle_slope),
        ..*measured
    }
}

#[inline(always)]
fn mix<T: Real>(x: T, y: T, c: f64) -> T {
    x * (1.0 - c) + y * c
}

/// Linear interpolation between two environments.
#[inline(always)]
pub fn between<T: Real>(a: &Env<T>, b: &Env<T>, c: f64) -> Env<T> {
    Env {
        t: a.t + (b.t - a.t) * c,
        omega_e: mix(a.omega_e, b.omega_e, c),
        theta_e: mix(a.theta_e, b.theta_e, c),
        theta_m: mix(a.theta_m, b.theta_m, c),
        heating: a.heating + c * (b.heating - a.heating),
        magnet_heating: a.magnet_heating + c * (b.magnet_heating - a.magnet_heating),
    }
}
