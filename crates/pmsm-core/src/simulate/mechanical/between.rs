//! What drives the rotor at a sample and between two of them.

use crate::effect::Env;
use crate::model::Model;
use crate::numerics::real::{Carries, Real, Several};
use crate::signals::Signals;
use crate::simulate::environment::{measured_env, true_env};
use std::ops::Range;

/// Largest electrical angle (rad) between samples at which steps over two samples still follow torque that depends on the angle.
const COARSE: f64 = 0.06;

/// The true environment at sample `k`, and the measured over the true speed's share that the sensor leaves.
#[inline(always)]
pub(super) fn environment<T: Real>(model: &Model, signals: &Signals, p: &[T], k: usize) -> (Env<T>, T) {
    behind_sensors(model, signals, p, measured_env(signals, k))
}

/// The measured environment at the samples from `k` on without the log's temperatures: sensors and rotors do not know them, and a
/// motor that does is not asked for several samples at a time.
#[inline(always)]
pub(super) fn measured<T, W: Several<T>>(signals: &Signals, k: usize) -> Env<W> {
    Env {
        t: W::plain(&signals.t[k..]),
        omega_e: W::plain(&signals.omega_e[k..]),
        theta_e: W::plain(&signals.theta_e[k..]),
        theta_m: W::plain(&signals.theta_m[k..]),
        heating: 0.0,
        magnet_heating: 0.0,
    }
}

/// The true environment behind the measured one, and the measured over the true speed's share that the sensor leaves.
#[inline(always)]
pub(super) fn behind_sensors<T: Real>(
    model: &Model,
    signals: &Signals,
    p: &[T],
    measured: Env<T>,
) -> (Env<T>, T) {
    if model.has_sensor() {
        let sensor = model.sensor(p, &measured);
        (true_env(&sensor, &measured, signals.n_p), T::one() - sensor.angle_slope)
    } else {
        (measured, T::one())
    }
}

/// Signals at the beginning, in the middle and at the end of a step.
pub(super) struct Way<T> {
    pub(super) torque: [T; 3],
    pub(super) env: [Env<T>; 3],
}

impl<T: Real> Way<T> {
    /// Torque and environment at fraction `c` of the step, straight from one to the next.
    #[inline(always)]
    pub(super) fn at(&self, c: f64) -> (T, Env<T>) {
        let (from, c) = if c < 0.5 { (0, 2.0 * c) } else { (1, 2.0 * c - 1.0) };
        mix(c, (self.torque[from], self.env[from]), (self.torque[from + 1], self.env[from + 1]))
    }
}

/// Motor torque per sample as numbers of type `W`, N·m.
pub(super) trait Driven<W> {
    fn at(&self, k: usize) -> W;
}

/// Numbers with derivatives.
pub(super) struct Lifted<'a, T>(pub(super) &'a [T]);

impl<T: Real, W: Carries<T>> Driven<W> for Lifted<'_, T> {
    #[inline(always)]
    fn at(&self, k: usize) -> W {
        W::carry(self.0[k])
    }
}

/// Numbers without derivatives.
pub(super) struct Fixed<'a>(pub(super) &'a [f64]);

impl<W: Real> Driven<W> for Fixed<'_> {
    #[inline(always)]
    fn at(&self, k: usize) -> W {
        W::constant(self.0[k])
    }
}

/// Torque halfway from sample `k` to the next, by the cubic through its neighbours within the window.
#[inline(always)]
pub(super) fn halfway<W: Real>(tau: &impl Driven<W>, k: usize, window: &Range<usize>) -> W {
    let straight = (tau.at(k) + tau.at(k + 1)) * 0.5;
    if k == window.start || k + 2 >= window.end {
        return straight;
    }
    straight * 1.125 - (tau.at(k - 1) + tau.at(k + 2)) * 0.0625
}

/// Motor torque halfway from sample `k` of a window to the next, N·m, as [`super::run`] takes it.
pub fn torque_halfway<T: Real>(torque: &[T], k: usize, window: &Range<usize>) -> T {
    halfway::<T>(&Lifted(torque), k, window)
}

/// Torque and environment at fraction `c` between two samples.
#[inline(always)]
pub(super) fn mix<T: Real>(c: f64, a: (T, Env<T>), b: (T, Env<T>)) -> (T, Env<T>) {
    if c == 0.0 {
        return a;
    }
    if c == 1.0 {
        return b;
    }
    let env = Env {
        t: a.1.t + (b.1.t - a.1.t) * c,
        theta_e: between(a.1.theta_e, b.1.theta_e, c),
        theta_m: between(a.1.theta_m, b.1.theta_m, c),
        ..a.1
    };
    (between(a.0, b.0, c), env)
}

#[inline(always)]
fn between<T: Real>(x: T, y: T, c: f64) -> T {
    x * (1.0 - c) + y * c
}

/// Whether the rotor hardly turns from sample to sample of the log, so that one step may span two, also where each stands for several: a
/// speed so fine that it would show, one that noise of the torque lets wander, is not looked at in that way.
pub(super) fn steps_are_coarse(signals: &Signals) -> bool {
    signals.context.omega_e_max * signals.context.period <= COARSE
}

/// Samples that the step from sample `k` spans: two if it may be coarse and the sample between lies in the middle.
pub(super) fn span(signals: &Signals, k: usize, window: &Range<usize>, coarse: bool) -> usize {
    let t = &signals.t;
    let even = || {
        let (whole, half) = (t[k + 2] - t[k], t[k + 1] - t[k]);
        (half - 0.5 * whole).abs() < 1e-3 * whole
    };
    if coarse && k + 2 < window.end && even() { 2 } else { 1 }
}
