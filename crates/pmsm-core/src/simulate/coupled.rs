//! The coupled model (1)–(3): currents and speed in free run from voltage and load torque alone, as Liu, Liu & Cartes
//! (2008) run it inside the identification.

use super::electrical::measured_env;
use crate::effect::Env;
use crate::model::{Base, Model};
use crate::real::Real;
use crate::rk4;
use crate::signals::Signals;
use std::ops::Range;

/// Simulates samples `range` and hands to `sink` the sample number and i_d, i_q (A), ω_e (rad/s). Starts from the
/// measured values; `tau_load` (N·m) is constant and comes on top of a load known from the recording. Stops early
/// when `sink` returns false.
pub fn run<T: Real>(
    model: &Model,
    signals: &Signals,
    range: Range<usize>,
    p: &[T],
    tau_load: T,
    mut sink: impl FnMut(usize, [T; 3]) -> bool,
) {
    let (Some(v), Some(i)) = (&signals.v, &signals.i) else { return };
    let base = Base::new(p);
    let n_p = signals.n_p;
    let known = |k: usize| match signals.load {
        crate::recording::Load::KnownConstant(value) => value,
        crate::recording::Load::Measured => signals.tau_m.as_ref().map_or(0.0, |tau| tau[k]),
        _ => 0.0,
    };
    let mut state = [T::zero(); 4];
    for k in range.clone() {
        let env = measured_env::<T>(signals, k);
        let fresh = k == range.start || signals.segments.iter().any(|s| s.start == k);
        if fresh {
            let measured = [T::constant(i[0][k]), T::constant(i[1][k])];
            let (flux, _) = model.steady_state::<T, 2>(p, &base, measured, &env);
            state = [flux[0], flux[1], env.omega_e * (1.0 / n_p), env.theta_e];
        }
        let here = Env { omega_e: state[2] * n_p, theta_e: state[3], ..env };
        let now = model.state_current(p, &base, &state[..2], &here).i;
        if !sink(k, [now[0], now[1], state[2] * n_p]) || k + 1 == range.end {
            break;
        }
        let command = [T::constant(v[0][k]), T::constant(v[1][k])];
        let load = tau_load + known(k);
        state = rk4::step(signals.t[k + 1] - signals.t[k], &state, |_, s| {
            let at = Env { omega_e: s[2] * n_p, theta_e: s[3], theta_m: s[3] * (1.0 / n_p), ..env };
            let electrical = model.electrical_rhs(p, &base, &[s[0], s[1]], command, &at);
            let tau_e = model.state_current(p, &base, &s[..2], &at).tau_e;
            let mechanical = model.mechanical_rhs(p, &base, &[s[2]], tau_e, load, &at);
            [electrical[0], electrical[1], mechanical[0], at.omega_e]
        });
    }
}
