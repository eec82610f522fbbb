//! The coupled model (1)–(3): currents and speed in free run from voltage and load torque alone, as Liu, Liu & Cartes
//! (2008) run it inside the identification.
//!
//! Voltages are held from sample to sample in the rotor's own frame. What an effect does to the sensors is not
//! simulated here: currents, angle and speed are the true ones.

use super::electrical::{STABLE, taps};
use super::environment::measured_env;
use crate::base::Base;
use crate::effect::Env;
use crate::effects::{ELECTRICAL_STATES, MECHANICAL_STATES, STATES};
use crate::model::Model;
use crate::numerics::extent::peak;
use crate::numerics::real::{Carries, Loop, Real};
use crate::numerics::rk4::{self, Slope};
use crate::recording::Load;
use crate::signals::Signals;
use std::ops::Range;

/// Largest product of step and fastest rate; longer sample periods are divided.
pub(crate) const STEP_LIMIT: f64 = 0.15;
/// Steps per time constant are multiplied by this where effects have electrical states of their own, whose rates the base parameters do not
/// tell.
pub(crate) const FINER: f64 = 4.0;

/// Simulates samples `range` and hands to `sink` the sample number and i_d, i_q (A), ω_e (rad/s). Each gap-free
/// segment starts from its first measured values; `tau_load` (N·m) is constant and comes on top of a load known from
/// the recording. Stops early when `sink` says so. Nothing is called if the recording has no voltages or currents.
pub fn run<T: Real>(
    model: &Model,
    signals: &Signals,
    range: Range<usize>,
    p: &[T],
    tau_load: T,
    sink: impl FnMut(usize, [T; 3]) -> bool,
) {
    run_from(model, signals, range, p, tau_load, |_, measured| measured.map(T::constant), sink);
}

/// As [`run`], but each segment starts from what `start` makes of the number of its first sample and the i_d, i_q (A),
/// ω_e (rad/s) measured there.
pub fn run_from<T: Real>(
    model: &Model,
    signals: &Signals,
    range: Range<usize>,
    p: &[T],
    tau_load: T,
    start: impl Fn(usize, [f64; 3]) -> [T; 3],
    mut sink: impl FnMut(usize, [T; 3]) -> bool,
) {
    T::compact(Run { model, signals, range, p, tau_load, start: &start, sink: &mut sink });
}

/// A run. Whoever looks on does so through pointers, so that it is compiled once for a type.
struct Run<'a, T> {
    model: &'a Model,
    signals: &'a Signals,
    range: Range<usize>,
    p: &'a [T],
    tau_load: T,
    start: &'a dyn Fn(usize, [f64; 3]) -> [T; 3],
    sink: &'a mut dyn FnMut(usize, [T; 3]) -> bool,
}

impl<T: Real> Loop<T> for Run<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Carries<T>>(self) {
        let Self { model, signals, range, tau_load, start, sink, .. } = self;
        let p: Vec<W> = self.p.iter().map(|x| W::carry(*x)).collect();
        let start = |k: usize, measured: [f64; 3]| start(k, measured).map(W::carry);
        watch(model, signals, range, &p, W::carry(tau_load), start, &mut Handed(sink));
    }
}

/// As [`run_from`], followed by a type of its own: unlike a closure it can insist on being inlined.
#[inline(always)]
pub fn watch<T: Real>(
    model: &Model,
    signals: &Signals,
    range: Range<usize>,
    p: &[T],
    tau_load: T,
    start: impl Fn(usize, [f64; 3]) -> [T; 3],
    sink: &mut impl Watch<T>,
) {
    match (model.electrical_states(), model.mechanical_states()) {
        (0, 0) => run_sized::<T, 2, 1, 4>(model, signals, range, p, tau_load, start, sink),
        (0..=2, 0..=2) => run_sized::<T, 4, 3, 8>(model, signals, range, p, tau_load, start, sink),
        _ => run_sized::<T, ELECTRICAL_STATES, MECHANICAL_STATES, STATES>(
            model, signals, range, p, tau_load, start, sink,
        ),
    }
}

/// Whoever follows a simulation.
pub trait Watch<T> {
    /// Sees i_d, i_q (A), ω_e (rad/s) at sample `k`; false ends the simulation.
    fn see(&mut self, k: usize, now: [T; 3]) -> bool;
}

/// Passes the numbers of a run on in their own type.
struct Handed<'a, T>(&'a mut dyn FnMut(usize, [T; 3]) -> bool);

impl<T, W: Carries<T>> Watch<W> for Handed<'_, T> {
    #[inline(always)]
    fn see(&mut self, k: usize, [i_d, i_q, omega_e]: [W; 3]) -> bool {
        (self.0)(k, [i_d.give(), i_q.give(), omega_e.give()])
    }
}

/// The state is λ_d, λ_q, ω_m, θ_e, electrical extras (E − 2), mechanical extras (M − 1): N = E + M + 1.
#[inline(always)]
fn run_sized<T: Real, const E: usize, const M: usize, const N: usize>(
    model: &Model,
    signals: &Signals,
    range: Range<usize>,
    p: &[T],
    tau_load: T,
    start: impl Fn(usize, [f64; 3]) -> [T; 3],
    sink: &mut impl Watch<T>,
) {
    let (Some(v), Some(i)) = (&signals.v, &signals.i) else { return };
    let base = Base::new(p);
    let steep = model.steep_rate(p, &base) * (STEP_LIMIT / STABLE);
    let n_p = signals.n_p;
    for segment in &signals.segments {
        let (first, last) = (segment.start.max(range.start), segment.end.min(range.end));
        if first >= last {
            continue;
        }
        let rate = fastest_rate(signals, segment);
        let begin = measured_env::<T>(signals, first);
        let [i_d, i_q, omega_e] = start(first, [i[0][first], i[1][first], signals.omega_e[first]]);
        let begin = Env { omega_e, ..begin };
        let (electrical, tau_e) = model.steady_state::<T, E>(p, &base, [i_d, i_q], &begin);
        let load = tau_load + known_load(signals, first, last);
        let omega_m = omega_e * (1.0 / n_p);
        let mechanical = model.mechanical_start::<T, M>(p, &base, omega_m, tau_e, load, &begin);
        let mut state: [T; N] = join(&electrical, begin.theta_e, &mechanical);
        // Whole electrical turns between the two angles stay as they are in the recording.
        let turn = begin.theta_m - begin.theta_e * (1.0 / n_p);
        for k in first..last {
            let here = measured_env::<T>(signals, k);
            let now =
                model.state_current(p, &base, &parts::<T, E, M, N>(&state).0, &at(&here, &state, n_p, turn));
            if !sink.see(k, [now.i[0], now.i[1], state[2] * n_p]) {
                return;
            }
            if k + 1 == last {
                break;
            }
            let h = signals.t[k + 1] - signals.t[k];
            let next = measured_env::<T>(signals, k + 1);
            let command = model.command(
                p,
                &taps(signals, v, segment.start, k),
                state[2] * (n_p * h / signals.decimation() as f64),
            );
            let load = tau_load + known_load(signals, k, last);
            let pieces = pieces(rate.max(steep), h);
            for piece in 0..pieces {
                let rhs = Rhs::<T, E, M> {
                    model,
                    p,
                    base: &base,
                    v: command,
                    load,
                    here: &here,
                    next: &next,
                    h,
                    piece: (piece as f64, pieces as f64),
                    turn,
                    n_p,
                };
                state = rk4::advance(h / pieces as f64, &state, &rhs);
            }
        }
    }
}

/// The right-hand side within one piece of a step: `E` electrical and `M` mechanical states.
struct Rhs<'a, T, const E: usize, const M: usize> {
    model: &'a Model,
    p: &'a [T],
    base: &'a Base<T>,
    v: [T; 2],
    load: T,
    here: &'a Env<T>,
    next: &'a Env<T>,
    h: f64,
    piece: (f64, f64),
    turn: T,
    n_p: f64,
}

impl<T: Real, const E: usize, const M: usize, const N: usize> Slope<T, N> for Rhs<'_, T, E, M> {
    #[inline(always)]
    fn at(&self, c: f64, state: &[T; N]) -> [T; N] {
        let (here, next) = (self.here, self.next);
        let c = (self.piece.0 + c) / self.piece.1;
        let between = Env {
            t: here.t + c * self.h,
            heating: here.heating + c * (next.heating - here.heating),
            magnet_heating: here.magnet_heating + c * (next.magnet_heating - here.magnet_heating),
            ..*here
        };
        let env = at(&between, state, self.n_p, self.turn);
        let (electrical, mechanical) = parts::<T, E, M, N>(state);
        let tau_e = self.model.state_current(self.p, self.base, &electrical, &env).tau_e;
        let electrical = self.model.electrical_rhs(self.p, self.base, &electrical, self.v, &env);
        let mechanical = self.model.mechanical_rhs(self.p, self.base, &mechanical, tau_e, self.load, &env);
        join(&electrical, env.omega_e, &mechanical)
    }
}

/// Fastest rate of the electrical equations in a gap-free segment, rad/s.
pub fn fastest_rate(signals: &Signals, segment: &Range<usize>) -> f64 {
    peak(&signals.omega_e[segment.clone()]) + signals.context.electrical_rate
}

/// Steps into which a sample interval of `h` seconds is divided where the fastest rate is `rate`.
pub fn pieces(rate: f64, h: f64) -> usize {
    ((h * rate / STEP_LIMIT).ceil() as usize).clamp(1, 64)
}

/// Mean known load torque over the interval that begins at sample `k`, N·m.
pub fn known_load(signals: &Signals, k: usize, end: usize) -> f64 {
    match (signals.load, &signals.tau_m) {
        (Load::KnownConstant(value), _) => value,
        (Load::Measured, Some(tau)) if k + 1 < end => 0.5 * (tau[k] + tau[k + 1]),
        (Load::Measured, Some(tau)) => tau[k],
        _ => 0.0,
    }
}

/// The surroundings of `env` at the speed and angle of the state.
#[inline(always)]
pub(crate) fn at<T: Real, const N: usize>(env: &Env<T>, state: &[T; N], n_p: f64, turn: T) -> Env<T> {
    let theta_e = state[3];
    Env { omega_e: state[2] * n_p, theta_e, theta_m: theta_e * (1.0 / n_p) + turn, ..*env }
}

#[inline(always)]
pub(crate) fn parts<T: Real, const E: usize, const M: usize, const N: usize>(
    state: &[T; N],
) -> ([T; E], [T; M]) {
    let (mut electrical, mut mechanical) = ([T::zero(); E], [T::zero(); M]);
    electrical[..2].copy_from_slice(&state[..2]);
    electrical[2..].copy_from_slice(&state[4..E + 2]);
    mechanical[0] = state[2];
    mechanical[1..].copy_from_slice(&state[E + 2..]);
    (electrical, mechanical)
}

#[inline(always)]
pub(crate) fn join<T: Real, const E: usize, const M: usize, const N: usize>(
    electrical: &[T; E],
    angle: T,
    mechanical: &[T; M],
) -> [T; N] {
    let mut state = [T::zero(); N];
    state[..2].copy_from_slice(&electrical[..2]);
    (state[2], state[3]) = (mechanical[0], angle);
    state[4..E + 2].copy_from_slice(&electrical[2..]);
    state[E + 2..].copy_from_slice(&mechanical[1..]);
    state
}
