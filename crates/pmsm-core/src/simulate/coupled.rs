//! The coupled model (1)–(3): currents and speed in free run from voltage and load torque alone, as Liu, Liu & Cartes
//! (2008) run it inside the identification.
//!
//! Voltages are held from sample to sample in the rotor's own frame. What an effect does to the sensors is not
//! simulated here: currents, angle and speed are the true ones.

use super::electrical::measured_env;
use crate::base::Base;
use crate::effect::Env;
use crate::model::Model;
use crate::real::Real;
use crate::recording::Load;
use crate::rk4;
use crate::signals::Signals;
use std::ops::Range;

/// Largest product of step and fastest rate; longer sample periods are divided.
pub(crate) const STEP_LIMIT: f64 = 0.15;

/// Simulates samples `range` and hands to `sink` the sample number and i_d, i_q (A), ω_e (rad/s). Each gap-free
/// segment starts from its first measured values; `tau_load` (N·m) is constant and comes on top of a load known from
/// the recording. Stops early when `sink` returns false. Nothing is called if the recording has no voltages or currents.
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
    sink: impl FnMut(usize, [T; 3]) -> bool,
) {
    match (model.electrical_states(), model.mechanical_states()) {
        _ if model.slots().is_empty() => run_bare(model, signals, range, p, tau_load, start, sink),
        (0, 0) => run_sized::<T, 2, 1, 4>(model, signals, range, p, tau_load, start, sink),
        (0..=2, 0..=2) => run_sized::<T, 4, 3, 8>(model, signals, range, p, tau_load, start, sink),
        _ => run_sized::<T, 12, 9, 22>(model, signals, range, p, tau_load, start, sink),
    }
}

/// The bare machine, whose state is λ_d, λ_q, ω_m: the same arithmetic in the same order as [`run_sized`], without the
/// terms that are zero.
fn run_bare<T: Real>(
    model: &Model,
    signals: &Signals,
    range: Range<usize>,
    p: &[T],
    tau_load: T,
    start: impl Fn(usize, [f64; 3]) -> [T; 3],
    mut sink: impl FnMut(usize, [T; 3]) -> bool,
) {
    let (Some(v), Some(i)) = (&signals.v, &signals.i) else { return };
    let base = Base::new(p);
    let (n_p, torque) = (signals.n_p, 1.5 * model.context().n_p);
    let current =
        |s: &[T; 3]| -> [T; 2] { [(s[0] - base.psi_m) * base.inverse_l_d, s[1] * base.inverse_l_q] };
    for segment in &signals.segments {
        let (first, last) = (segment.start.max(range.start), segment.end.min(range.end));
        if first >= last {
            continue;
        }
        let [i_d, i_q, omega_e] = start(first, [i[0][first], i[1][first], signals.omega_e[first]]);
        let mut state = [base.psi_m + base.l_d * i_d, base.l_q * i_q, omega_e * (1.0 / n_p)];
        for k in first..last {
            let now = current(&state);
            if !sink(k, [now[0], now[1], state[2] * n_p]) {
                return;
            }
            if k + 1 == last {
                break;
            }
            let h = signals.t[k + 1] - signals.t[k];
            let command = [T::constant(v[0][k]), T::constant(v[1][k])];
            let load = tau_load + known_load(signals, k, last);
            let rate = signals.omega_e[k].abs() + signals.context.electrical_rate;
            let pieces = ((h * rate / STEP_LIMIT).ceil() as usize).clamp(1, 64);
            for _ in 0..pieces {
                state = rk4::step(h / pieces as f64, &state, |_, s| {
                    let (i, omega_e) = (current(s), s[2] * n_p);
                    let tau_e = (s[0] * i[1] - s[1] * i[0]) * torque;
                    [
                        command[0] - base.r_s * i[0] + omega_e * s[1],
                        command[1] - base.r_s * i[1] - omega_e * s[0],
                        (tau_e - base.b * s[2] - load) / base.j,
                    ]
                });
            }
        }
    }
}

/// The state is λ_d, λ_q, ω_m, θ_e, electrical extras (E − 2), mechanical extras (M − 1): N = E + M + 1.
fn run_sized<T: Real, const E: usize, const M: usize, const N: usize>(
    model: &Model,
    signals: &Signals,
    range: Range<usize>,
    p: &[T],
    tau_load: T,
    start: impl Fn(usize, [f64; 3]) -> [T; 3],
    mut sink: impl FnMut(usize, [T; 3]) -> bool,
) {
    let (Some(v), Some(i)) = (&signals.v, &signals.i) else { return };
    let base = Base::new(p);
    let n_p = signals.n_p;
    for segment in &signals.segments {
        let (first, last) = (segment.start.max(range.start), segment.end.min(range.end));
        if first >= last {
            continue;
        }
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
            if !sink(k, [now.i[0], now.i[1], state[2] * n_p]) {
                return;
            }
            if k + 1 == last {
                break;
            }
            let h = signals.t[k + 1] - signals.t[k];
            let next = measured_env::<T>(signals, k + 1);
            let tap = |back: usize| {
                let k = k.saturating_sub(back).max(segment.start);
                [T::constant(v[0][k]), T::constant(v[1][k])]
            };
            let command = model.command(p, &[tap(0), tap(1), tap(2)], state[2] * (n_p * h));
            let load = tau_load + known_load(signals, k, last);
            let rate = signals.omega_e[k].abs() + signals.context.electrical_rate;
            let pieces = ((h * rate / STEP_LIMIT).ceil() as usize).clamp(1, 64);
            for piece in 0..pieces {
                state = rk4::step(h / pieces as f64, &state, |c, s| {
                    let c = (piece as f64 + c) / pieces as f64;
                    let between = Env {
                        t: here.t + c * h,
                        heating: here.heating + c * (next.heating - here.heating),
                        magnet_heating: here.magnet_heating + c * (next.magnet_heating - here.magnet_heating),
                        ..here
                    };
                    let env = at(&between, s, n_p, turn);
                    let (electrical, mechanical) = parts::<T, E, M, N>(s);
                    let tau_e = model.state_current(p, &base, &electrical, &env).tau_e;
                    let electrical = model.electrical_rhs(p, &base, &electrical, command, &env);
                    let mechanical = model.mechanical_rhs(p, &base, &mechanical, tau_e, load, &env);
                    join(&electrical, env.omega_e, &mechanical)
                });
            }
        }
    }
}

/// Mean known load torque over the interval that begins at sample `k`, N·m.
fn known_load(signals: &Signals, k: usize, end: usize) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::ALL;
    use crate::machine::Machine;
    use crate::recording::Recording;

    #[test]
    fn the_bare_machine_is_the_general_one_bit_for_bit() {
        let mut given: Vec<(String, Vec<f64>)> =
            ["t", "v_d", "v_q", "i_d", "i_q", "omega_e"].map(|name| (name.to_owned(), Vec::new())).into();
        for t in (0..400).map(|k| f64::from(k) * 1e-4) {
            let (v_d, v_q) = (-5.0 + 30.0 * (200.0 * t).sin(), 60.0 + 20.0 * (90.0 * t).cos());
            for ((_, column), x) in given.iter_mut().zip([t, v_d, v_q, -1.0, 4.0, 310.0 + 40.0 * t]) {
                column.push(x);
            }
        }
        let machine = Machine::liu_2008();
        let signals = Signals::new(&Recording::new(given, None).unwrap(), &machine).unwrap();
        let effect = *ALL.iter().find(|e| e.info().id == "coulomb_friction").unwrap();
        let (bare, general) = (Model::new(signals.context, &[]), Model::new(signals.context, &[effect]));
        let base = machine.base.map(|x| x.unwrap());
        let mut off = vec![0.0; general.parameter_count()];
        off[..6].copy_from_slice(&base);
        let (mut one, mut other) = (Vec::new(), Vec::new());
        run(&bare, &signals, 0..signals.len(), &base, 3.0, |_, x| {
            one.push(x.map(f64::to_bits));
            true
        });
        run(&general, &signals, 0..signals.len(), &off, 3.0, |_, x| {
            other.push(x.map(f64::to_bits));
            true
        });
        assert_eq!(one.len(), 400);
        assert_eq!(one, other);
    }
}
