//! What every effect of the catalogue promises, whichever it is: tests over the whole registry.

#[path = "effects/description.rs"]
mod description;
#[path = "effects/energy.rs"]
mod energy;
#[path = "effects/integration.rs"]
mod integration;
mod support;

use pmsm_core::base::{BASE, Base};
use pmsm_core::effect::{Context, Env, Role, Site};
use pmsm_core::effects::{ALL, EffectId};
use pmsm_core::model::Model;
use pmsm_core::numerics::dual::Dual;
use pmsm_core::numerics::real::Real;
use pmsm_core::numerics::transforms::{inverse_park, park};
use pmsm_core::signals::Signals;
use support::{MACHINE, operating_points, run, simulate, still, typical, with};

/// The parameters with every strength set to zero.
fn without_strength(effect: EffectId, mut own: Vec<f64>) -> Vec<f64> {
    for (x, info) in own.iter_mut().zip(effect.info().parameters) {
        if info.role == Role::Amplitude {
            *x = 0.0;
        }
    }
    own
}

#[test]
fn without_strength_the_equations_are_those_of_the_bare_machine_bit_for_bit() {
    let signals = run(true);
    let (bare, base) = (Model::new(signals.context, &[]), Base::new(&MACHINE));
    for &effect in ALL {
        let model = Model::new(signals.context, &[effect]);
        for own in effect.probes(&signals.context).into_iter().chain([typical(effect, &signals)]) {
            let p = with(&without_strength(effect, own));
            for k in 0..50 {
                let x = f64::from(k);
                let env = Env {
                    omega_e: 300.0 * x.sin(),
                    t: 0.01 * x,
                    heating: x,
                    magnet_heating: x,
                    ..still(0.7 * x)
                };
                let state = [0.19 + 0.05 * x.cos(), 0.15 * (2.3 * x).sin(), 0.0, 0.0];
                let v = [-20.0 + x, 3.0 * x];
                let taps = [v, [1.0, 2.0], [-3.0, x]];
                assert_eq!(model.command(&p, &taps, 0.03), v, "{}", effect.id());
                assert_eq!(
                    model.electrical_rhs(&p, &base, &state, v, &env),
                    bare.electrical_rhs(&MACHINE, &base, &state, v, &env),
                    "{}",
                    effect.id()
                );
                let (got, expected) = (
                    model.state_current(&p, &base, &state, &env),
                    bare.state_current(&MACHINE, &base, &state, &env),
                );
                assert_eq!((got.i, got.tau_e), (expected.i, expected.tau_e), "{}", effect.id());
                let (speed, torque, load) = (80.0 * x.cos(), 6.0 * (1.9 * x).sin(), 0.3);
                let start: [f64; 3] = model.mechanical_start(&p, &base, speed, torque, load, &env);
                assert_eq!(
                    model.mechanical_rhs(&p, &base, &start, torque, load, &env)[0],
                    bare.mechanical_rhs(&MACHINE, &base, &[speed], torque, load, &env)[0],
                    "{}",
                    effect.id()
                );
            }
        }
    }
}

#[test]
fn without_strength_every_simulation_is_that_of_the_bare_machine() {
    for signals in [run(false), run(true), operating_points()] {
        let bare = simulate(&Model::new(signals.context, &[]), &signals, &MACHINE);
        assert!(bare.iter().all(|x| x.is_finite()));
        for &effect in ALL {
            let model = Model::new(signals.context, &[effect]);
            for own in effect.probes(&signals.context).into_iter().chain([typical(effect, &signals)]) {
                let shown = simulate(&model, &signals, &with(&without_strength(effect, own)));
                assert_eq!(shown.len(), bare.len(), "{}", effect.id());
                let worst = shown.iter().zip(&bare).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                // A flux found by Newton's method and currents taken through the phases round in the last digits.
                let allowed = if effect.info().site == Site::Mechanical { 0.0 } else { 1e-11 };
                assert!(worst <= allowed, "{}: {worst:e}", effect.id());
            }
        }
    }
}

/// Largest deviation of exact derivatives from difference quotients, relative to the largest derivative.
fn derivative_error(model: &Model, signals: &Signals, p: &[f64], index: usize, step: f64) -> f64 {
    let seeded: Vec<Dual<1>> = p
        .iter()
        .enumerate()
        .map(|(k, x)| if k == index { Dual::variable(*x, 0) } else { Dual::constant(*x) })
        .collect();
    let at = |offset: f64| {
        let mut moved = p.to_vec();
        moved[index] += offset * step;
        simulate(model, signals, &moved)
    };
    // At the lower bound only larger values are physical.
    let one_sided = index >= BASE && p[index] <= model.bounds(index).0;
    let (x, y, z) = (at(if one_sided { 0.0 } else { -1.0 }), at(1.0), at(2.0));
    let exact = simulate(model, signals, &seeded);
    let scale = exact.iter().map(|d| d.eps[0].abs()).fold(0.0, f64::max);
    let mut worst = 0.0f64;
    for (k, d) in exact.iter().enumerate() {
        let quotient =
            if one_sided { (4.0 * y[k] - 3.0 * x[k] - z[k]) * 0.5 } else { (y[k] - x[k]) * 0.5 } / step;
        worst = worst.max((d.eps[0] - quotient).abs());
    }
    // Where nothing depends on the parameter, rounding is compared with a change of one unit per typical step.
    worst / scale.max(1e-6 / step)
}

/// Error of derivatives through impacts that a fit can bear, relative to the largest.
const IMPACTS: f64 = 0.05;

#[test]
fn exact_derivatives_are_difference_quotients() {
    for signals in [run(false), run(true), operating_points()] {
        let bare = Model::new(signals.context, &[]);
        for index in 0..BASE {
            let error = derivative_error(&bare, &signals, &MACHINE, index, 1e-5 * MACHINE[index]);
            assert!(error < 1e-5, "base parameter {index}: {error:e}");
        }
        for &effect in ALL {
            let model = Model::new(signals.context, &[effect]);
            let usual = typical(effect, &signals);
            // Where a contact closes, its damper's torque jumps. A derivative does not see how that instant moves.
            let allowed = if effect.is_multimodal() { IMPACTS } else { 1e-4 };
            for (k, info) in effect.info().parameters.iter().enumerate() {
                if !effect.fitted(&signals.context, k) {
                    continue;
                }
                let step = 1e-4 * usual[k].abs();
                let error = derivative_error(&model, &signals, &with(&usual), BASE + k, step);
                assert!(error < allowed, "{}.{} at its typical value: {error:e}", effect.id(), info.name);
                // A load behind a play leaves the rotor alone at times, however light it is: that has no derivative at no load.
                if info.role == Role::Amplitude && !effect.is_multimodal() {
                    let none = without_strength(effect, usual.clone());
                    let error = derivative_error(&model, &signals, &with(&none), BASE + k, step);
                    assert!(error < 1e-4, "{}.{} at zero strength: {error:e}", effect.id(), info.name);
                }
            }
        }
    }
}

#[test]
fn a_steady_state_carries_the_current_it_was_asked_for() {
    for signals in [run(true), operating_points()] {
        for &effect in ALL {
            let model = Model::new(signals.context, &[effect]);
            let usual = typical(effect, &signals);
            let strong: Vec<f64> = (usual.iter().zip(effect.info().parameters))
                .map(|(x, info)| if info.role == Role::Amplitude { 5.0 * x } else { *x })
                .collect();
            for p in [with(&usual), with(&strong)] {
                let base = Base::new(&p);
                for k in 0..40 {
                    let x = f64::from(k);
                    let i = [-4.0 + 4.0 * x.cos(), 7.0 * (1.3 * x).sin()];
                    let env =
                        Env { omega_e: 400.0 * (0.7 * x).cos(), t: 0.01 * x, heating: x, ..still(0.9 * x) };
                    let (state, tau_e): ([f64; 12], f64) = model.steady_state(&p, &base, i, &env);
                    let back = model.state_current(&p, &base, &state, &env);
                    let off = (back.i[0] - i[0]).hypot(back.i[1] - i[1]);
                    assert!(off < 1e-6, "{} at {i:?}: {off:e} A off", effect.id());
                    assert!((back.tau_e - tau_e).abs() < 1e-12, "{}", effect.id());
                }
            }
        }
    }
}

#[test]
fn the_true_current_is_found_behind_the_measured_one() {
    let signals = run(false);
    // Three sensors without noise add up to nothing, as if one of them were none.
    let cx = Context { completed_phase: None, ..signals.context };
    for &effect in ALL.iter().filter(|e| e.info().site == Site::Sensor) {
        let model = Model::new(cx, &[effect]);
        let own: Vec<f64> = typical(effect, &signals).iter().map(|x| 5.0 * x).collect();
        let p = with(&own);
        for k in 0..50 {
            let theta = 0.31 * f64::from(k);
            let turning = Env { omega_e: 400.0, ..still(theta) };
            let sensor = model.sensor(&p, &turning);
            let truth = [-3.0, 7.0];
            // What the three sensors log, zero sequence included.
            let (s, c) = (theta - sensor.angle).sin_cos();
            let mut logged = inverse_park(truth, c, s);
            for x in 0..3 {
                logged[x] = logged[x] * sensor.gain[x] + sensor.offset[x];
            }
            let back = model.true_current(&sensor, logged, theta);
            let (s, c) = theta.sin_cos();
            let (seen, expected) = (model.measured_current(&sensor, truth, theta), park(logged, c, s));
            for axis in 0..2 {
                assert!((back[axis] - truth[axis]).abs() < 1e-13, "{}", effect.id());
                assert!((seen[axis] - expected[axis]).abs() < 1e-13, "{}", effect.id());
            }
            assert!((seen[0] - truth[0]).hypot(seen[1] - truth[1]) > 1e-3, "{} shows nothing", effect.id());
        }
    }
}
