//! What every effect of the catalogue promises, whichever it is: tests over the whole registry.

mod support;

use pmsm_core::effect::{Context, Electrical, Env, Field, FieldPoint, Need, Role, Site};
use pmsm_core::effects::{ALL, EffectId};
use pmsm_core::model::{BASE, Base, Model};
use pmsm_core::real::{Dual, Real};
use pmsm_core::rk4;
use pmsm_core::signals::Signals;
use pmsm_core::transforms::{inverse_park, park};
use std::f64::consts::TAU;
use support::{MACHINE, N_P, operating_points, run, simulate, typical, with};

/// Effects whose equations have a kink in their states, at reversal of speed or torque: |ω_m| and |τ_e| have no second
/// derivative there, so that no method can keep its order across it. The signs of the other frictions are
/// smooth, as are saturation with an even exponent and all others.
const KINKED: [EffectId; 2] = [EffectId::QuadraticDrag, EffectId::LoadDependentFriction];

// Limit case -----------------------------------------------------------------------------------------------------------

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

// Derivatives ----------------------------------------------------------------------------------------------------------

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
            for (k, info) in effect.info().parameters.iter().enumerate() {
                if !effect.fitted(&signals.context, k) {
                    continue;
                }
                let step = 1e-4 * usual[k].abs();
                let error = derivative_error(&model, &signals, &with(&usual), BASE + k, step);
                assert!(error < 1e-4, "{}.{} at its typical value: {error:e}", effect.id(), info.name);
                if info.role == Role::Amplitude {
                    let none = without_strength(effect, usual.clone());
                    let error = derivative_error(&model, &signals, &with(&none), BASE + k, step);
                    assert!(error < 1e-4, "{}.{} at zero strength: {error:e}", effect.id(), info.name);
                }
            }
        }
    }
}

// Integration ----------------------------------------------------------------------------------------------------------

/// Order of the integrator from three runs, each with half the step of the one before, at steps small enough for the
/// leading term of the error and large enough for it to stand out of rounding.
fn order<const N: usize>(start: [f64; N], span: f64, rhs: impl Fn(f64, &[f64; N]) -> [f64; N]) -> f64 {
    // The state at 25 instants.
    let course = |steps: u32| {
        let (h, mut state) = (span / f64::from(steps), start);
        let mut seen = Vec::new();
        for k in 0..steps {
            state = rk4::step(h, &state, |c, s| rhs((f64::from(k) + c) * h, s));
            if (k + 1) % (steps / 25) == 0 {
                seen.push(state);
            }
        }
        seen
    };
    // Relative to the largest value of each state on the way.
    let distance = |a: &[[f64; N]], b: &[[f64; N]]| {
        let square = |n: usize| {
            let largest = a.iter().fold(f64::MIN_POSITIVE, |m, x| m.max(x[n].abs()));
            a.iter().zip(b).map(|(a, b)| ((a[n] - b[n]) / largest).powi(2)).sum::<f64>()
        };
        (0..N).map(square).sum::<f64>().sqrt()
    };
    let mut steps = 25;
    let (mut coarse, mut middle, mut fine) = (course(steps), course(2 * steps), course(4 * steps));
    while distance(&coarse, &middle) > LEADING {
        steps *= 2;
        assert!(steps < 1_000_000, "no convergence");
        (coarse, middle, fine) = (middle, fine, course(4 * steps));
    }
    (distance(&coarse, &middle) / distance(&middle, &fine)).log2()
}

/// Relative error at which the leading term of the integrator's error is taken.
const LEADING: f64 = 1e-9;

#[test]
fn the_electrical_equations_are_integrated_to_fourth_order() {
    let signals = run(true);
    for &effect in ALL.iter().filter(|e| e.info().site == Site::Electrical) {
        let model = Model::new(signals.context, &[effect]);
        let mut own = typical(effect, &signals);
        if effect == EffectId::DeadTime {
            own[1] = 0.3 * signals.context.i_max;
        }
        let (p, base) = (with(&own), Base::new(&with(&own)));
        let env = |t: f64| Env {
            t,
            omega_e: 180.0 + 40.0 * (60.0 * t).sin(),
            theta_e: 0.3 + 180.0 * t - 40.0 / 60.0 * (60.0 * t).cos(),
            theta_m: 0.1 + 60.0 * t - 40.0 / 180.0 * (60.0 * t).cos(),
            heating: 1000.0 * t,
            magnet_heating: 500.0 * t,
        };
        let start = model.steady_state::<f64, 4>(&p, &base, [-1.0, 4.0], &env(0.0)).0;
        let got = order(start, 0.02, |t, s| {
            model.electrical_rhs(&p, &base, s, [-15.0 + 5.0 * (90.0 * t).sin(), 42.0], &env(t))
        });
        assert!((got - 4.0).abs() < 0.05, "{}: {got}", effect.id());
    }
}

#[test]
fn the_equation_of_motion_is_integrated_to_fourth_order() {
    let usual = run(false);
    // The sign of a friction turns over within a share of the top speed: a high one for steps that resolve it.
    let signals = Signals {
        context: Context { omega_e_max: 10.0 * usual.context.omega_e_max, ..usual.context },
        ..usual
    };
    for &effect in ALL.iter().filter(|e| e.info().site == Site::Mechanical) {
        let model = Model::new(signals.context, &[effect]);
        let own = typical(effect, &signals);
        let (p, base) = (with(&own), Base::new(&with(&own)));
        let env = |t: f64| Env {
            t,
            omega_e: 0.0,
            theta_e: N_P * 25.0 * t,
            theta_m: 25.0 * t,
            heating: 0.0,
            magnet_heating: 0.0,
        };
        // Through a reversal, or short of one where the effect has a kink there.
        let (speed, mean) = if KINKED.contains(&effect) { (30.0, 2.0) } else { (6.0, -2.0) };
        let start = model.mechanical_start::<f64, 3>(&p, &base, speed, mean, 0.5, &env(0.0));
        let got = order(start, 0.1, |t, s| {
            model.mechanical_rhs(&p, &base, s, mean + 0.8 * (80.0 * t).sin(), 0.5, &env(t))
        });
        assert!((got - 4.0).abs() < 0.05, "{}: {got}", effect.id());
    }
}

// Energy ---------------------------------------------------------------------------------------------------------------

const FLUXES: [[f64; 2]; 4] = [[0.12, 0.1], [0.25, -0.15], [0.19, 0.02], [0.08, -0.2]];

#[test]
fn fields_are_gradients_of_one_energy() {
    let signals = run(false);
    let base = Base::new(&MACHINE);
    let mut seen = 0;
    for &effect in ALL {
        let own: Vec<f64> = typical(effect, &signals);
        let field = |flux: [f64; 2], theta: f64| {
            let mut out = Field { i: [0.0; 2], slope: 0.0, inverse: [0.0; 3] };
            let at =
                FieldPoint { flux, magnet: [MACHINE[3], 0.0], psi_m: MACHINE[3], sin_cos: theta.sin_cos() };
            effect.field(&own, &at, &base, &signals.context, &mut out);
            out
        };
        if FLUXES.iter().all(|f| field(*f, 0.4).i == [0.0; 2]) {
            continue;
        }
        seen += 1;
        let rest = field([MACHINE[3], 0.0], 0.4).i;
        assert!(
            rest[0].abs() < 1e-12 && rest[1].abs() < 1e-12,
            "{}: current of the magnet alone",
            effect.id()
        );
        for flux in FLUXES {
            let h = 1e-6;
            let slope = |axis: usize, along: usize| {
                let (mut a, mut b) = (flux, flux);
                (a[along], b[along]) = (a[along] - h, b[along] + h);
                (field(b, 0.4).i[axis] - field(a, 0.4).i[axis]) / (2.0 * h)
            };
            let inverse = field(flux, 0.4).inverse;
            let size = inverse.iter().fold(1e-3f64, |m, x| m.max(x.abs()));
            for (got, expected) in [
                (slope(0, 1), slope(1, 0)),
                (inverse[0], slope(0, 0)),
                (inverse[1], slope(0, 1)),
                (inverse[2], slope(1, 1)),
            ] {
                assert!(
                    (got - expected).abs() < 1e-6 * size,
                    "{} at {flux:?}: {got} {expected}",
                    effect.id()
                );
            }
        }
    }
    assert_eq!(seen, 4, "saturation of both axes, cross-saturation, inductance harmonics");
}

/// Field energy of a model per 3/2 of the machine, integrated from the magnet's own flux where there is no current.
fn energy(model: &Model, p: &[f64], flux: [f64; 2], theta: f64) -> f64 {
    let (base, env) = (Base::new(p), still(theta));
    let magnet = model.steady_state::<f64, 4>(p, &base, [0.0; 2], &env).0;
    let way = [flux[0] - magnet[0], flux[1] - magnet[1]];
    // Simpson's rule.
    let n = 400;
    (0..=n)
        .map(|k| {
            let x = f64::from(k) / f64::from(n);
            let weight = if k == 0 || k == n { 1.0 } else { f64::from(2 + 2 * (k % 2)) };
            let state = [magnet[0] + x * way[0], magnet[1] + x * way[1], 0.0, 0.0];
            let i = model.state_current(p, &base, &state, &env).i;
            weight * (i[0] * way[0] + i[1] * way[1]) / (3.0 * f64::from(n))
        })
        .sum()
}

fn still(theta_e: f64) -> Env<f64> {
    Env { t: 0.0, omega_e: 0.0, theta_e, theta_m: theta_e / N_P, heating: 0.0, magnet_heating: 0.0 }
}

#[test]
fn torque_and_current_follow_from_the_energy_by_virtual_work() {
    let signals = run(false);
    for &effect in ALL.iter().filter(|e| e.info().site == Site::Electrical) {
        for companions in [&[][..], &[EffectId::BackEmfHarmonics], &[EffectId::InductanceHarmonics]] {
            if companions.contains(&effect) {
                continue;
            }
            let effects = [&[effect], companions].concat();
            let model = Model::new(signals.context, &effects);
            // Strengths that differ, so that nothing cancels by symmetry.
            let own: Vec<f64> = (effects.iter().flat_map(|e| typical(*e, &signals)).enumerate())
                .map(|(k, x)| if k < effect.info().parameters.len() { x } else { x * (2.0 - 0.7 * k as f64) })
                .collect();
            let (p, theta, h) = (with(&own), 0.37, 1e-5);
            for flux in FLUXES {
                let at =
                    model.state_current(&p, &Base::new(&p), &[flux[0], flux[1], 0.0, 0.0], &still(theta));
                let w = |d: f64, q: f64, angle: f64| {
                    energy(&model, &p, [flux[0] + d, flux[1] + q], theta + angle)
                };
                let i_d = (w(h, 0.0, 0.0) - w(-h, 0.0, 0.0)) / (2.0 * h);
                let i_q = (w(0.0, h, 0.0) - w(0.0, -h, 0.0)) / (2.0 * h);
                let slope = (w(0.0, 0.0, h) - w(0.0, 0.0, -h)) / (2.0 * h);
                let torque = 1.5 * N_P * (flux[0] * i_q - flux[1] * i_d - slope);
                for (got, expected) in [(at.i[0], i_d), (at.i[1], i_q), (at.tau_e, torque)] {
                    let near = 1e-6 * expected.abs().max(1.0);
                    assert!((got - expected).abs() < near, "{effects:?} at {flux:?}: {got} {expected}");
                }
            }
        }
    }
}

/// What a machine at constant speed and rotor-frame voltage takes in beyond copper loss and shaft power, W, as a mean over
/// one electrical revolution in the steady state.
fn steady_loss(effect: EffectId, own: &[f64], cx: Context) -> f64 {
    let model = Model::new(cx, &[effect]);
    let (p, base) = (with(own), Base::new(&with(own)));
    let omega = 400.0;
    let steps = 720;
    let h = TAU / omega / f64::from(steps);
    let v = [-35.0, 84.0];
    let env = |k: f64| Env { omega_e: omega, ..still(omega * k * h) };
    let mut state = model.steady_state::<f64, 4>(&p, &base, [-1.0, 3.0], &env(0.0)).0;
    let turns = 40;
    let mut mean = 0.0;
    for k in 0..turns * steps {
        if k >= (turns - 1) * steps {
            let at = model.state_current(&p, &base, &state, &env(f64::from(k)));
            let copper = 1.5 * MACHINE[0] * (at.i[0].powi(2) + at.i[1].powi(2));
            let input = 1.5 * (v[0] * at.i[0] + v[1] * at.i[1]);
            mean += (input - copper - at.tau_e * omega / N_P) / f64::from(steps);
        }
        state = rk4::step(h, &state, |c, s| model.electrical_rhs(&p, &base, s, v, &env(f64::from(k) + c)));
    }
    mean
}

#[test]
fn lossy_windings_lose_energy_and_magnetic_effects_keep_it() {
    use EffectId::*;
    let signals = run(false);
    for effect in [DeadTime, PhaseResistanceImbalance, InterTurnShort, IronLoss] {
        let loss = steady_loss(effect, &typical(effect, &signals), signals.context);
        assert!(loss > 0.05, "{}: {loss} W", effect.id());
    }
    for effect in
        [BackEmfHarmonics, SaturationD, SaturationQ, CrossSaturation, InductanceHarmonics, MagnetThermalDrift]
    {
        let loss = steady_loss(effect, &typical(effect, &signals), signals.context);
        assert!(loss.abs() < 1e-4, "{}: {loss} W", effect.id());
    }
}

#[test]
fn voltage_lost_in_the_winding_is_power_lost() {
    use EffectId::*;
    let signals = run(false);
    for effect in [DeadTime, PhaseResistanceImbalance] {
        let own = typical(effect, &signals);
        for k in 0..200 {
            let (i_angle, theta) = (0.37 * f64::from(k), 0.11 * f64::from(k));
            let i = [5.0 * i_angle.cos(), 5.0 * i_angle.sin()];
            let at = Electrical {
                env: still(theta),
                sin_cos: theta.sin_cos(),
                i,
                r_s: MACHINE[0],
                v: [0.0; 2],
                emf: [0.0; 2],
            };
            let mut lost = [0.0; 2];
            effect.voltage(&own, &[], &at, &signals.context, &mut lost);
            assert!(lost[0] * i[0] + lost[1] * i[1] >= 0.0, "{}", effect.id());
        }
    }
}

#[test]
fn friction_never_drives() {
    use EffectId::*;
    let signals = run(false);
    let base = Base::new(&MACHINE);
    for effect in [CoulombFriction, StribeckFriction, LoadDependentFriction, QuadraticDrag] {
        let model = Model::new(signals.context, &[effect]);
        let p = with(&typical(effect, &signals));
        let bare = Model::new(signals.context, &[]);
        for k in -50..=50 {
            let omega_m = 0.02 * f64::from(k).powi(3).signum() * f64::from(k).powi(2);
            for tau_e in [-5.0, 0.0, 3.0] {
                let slower = bare.mechanical_rhs(&MACHINE, &base, &[omega_m], tau_e, 0.2, &still(0.3))[0]
                    - model.mechanical_rhs(&p, &base, &[omega_m], tau_e, 0.2, &still(0.3))[0];
                assert!(slower * omega_m >= 0.0, "{} at {omega_m} rad/s, {tau_e} N m", effect.id());
                if omega_m.abs() > 1.0 && tau_e != 0.0 {
                    assert!(slower * omega_m > 0.0, "{} does nothing", effect.id());
                }
            }
        }
    }
}

// Inverses -------------------------------------------------------------------------------------------------------------

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
    for &effect in ALL.iter().filter(|e| e.info().site == Site::Sensor) {
        let model = Model::new(signals.context, &[effect]);
        let own: Vec<f64> = typical(effect, &signals).iter().map(|x| 5.0 * x).collect();
        let p = with(&own);
        for k in 0..50 {
            let theta = 0.31 * f64::from(k);
            let sensor = model.sensor(&p, &still(theta));
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

// Description ----------------------------------------------------------------------------------------------------------

/// Every identifier of the file contract with the results whose names are binding.
const CONTRACT: [(&str, &[&str]); 26] = [
    ("coulomb_friction", &["tau_c"]),
    ("stribeck_friction", &["tau_c", "tau_s", "w_s"]),
    ("asymmetric_friction", &[]),
    ("load_dependent_friction", &[]),
    ("quadratic_drag", &["k"]),
    ("cogging_torque", &["tau_cog", "order_mech"]),
    ("load_torque_pulsation", &["tau_pul"]),
    ("time_varying_load", &["amplitude", "f"]),
    ("two_mass_shaft", &["f_antires", "f_res"]),
    ("back_emf_harmonics", &["e5_rel", "e7_rel"]),
    ("saturation_d", &[]),
    ("saturation_q", &[]),
    ("cross_saturation", &[]),
    ("inductance_harmonics", &[]),
    ("rs_thermal_drift", &[]),
    ("magnet_thermal_drift", &[]),
    ("iron_loss", &["r_c"]),
    ("dead_time", &["v_err"]),
    ("voltage_delay", &["extra_samples"]),
    ("dc_link_sag", &["r_source"]),
    ("phase_resistance_imbalance", &["r_excess_rel"]),
    ("inter_turn_short", &[]),
    ("current_offset", &["o_a", "o_b", "o_c"]),
    ("current_gain_imbalance", &[]),
    ("encoder_angle_offset", &["offset_el_rad"]),
    ("encoder_eccentricity", &["amplitude_el_rad"]),
];

/// Scales of recordings from a fast scope to a slow logger.
fn contexts() -> Vec<Context> {
    let usual = run(false).context;
    vec![
        usual,
        run(true).context,
        operating_points().context,
        Context { period: 2e-2, duration: 60.0, ..usual },
        Context { period: 1e-3, duration: 24.0, i_max: 0.5, v_max: 10.0, tau_max: 0.02, v_dc: 12.0, ..usual },
        Context {
            period: 1e-5,
            duration: 0.1,
            n_p: 50.0,
            i_max: 400.0,
            omega_e_max: 6000.0,
            v_max: 350.0,
            ..usual
        },
    ]
}

#[test]
fn identifiers_and_result_names_are_those_of_the_contract() {
    let cx = run(false).context;
    for (id, names) in CONTRACT {
        let effect = EffectId::parse(id).unwrap();
        let own: Vec<f64> = effect.info().parameters.iter().map(|p| (p.typical)(&cx)).collect();
        let out = effect.outputs(&own, &Base::new(&MACHINE), &cx);
        for name in names {
            assert!(out.iter().any(|(n, _, _)| n == name), "{id} does not give {name}");
        }
        assert!(!out.is_empty() && out.iter().all(|(_, unit, x)| !unit.is_empty() && x.is_finite()), "{id}");
    }
    let refusal = EffectId::parse("ghost").unwrap_err().to_string();
    assert!(ALL.iter().all(|e| refusal.contains(e.id())), "{refusal}");
}

#[test]
fn descriptions_are_complete_and_point_to_effects_that_exist() {
    let mut ids: Vec<&str> = ALL.iter().map(|e| e.id()).collect();
    ids.sort_unstable();
    assert!(ids.windows(2).all(|w| w[0] != w[1]), "an identifier is used twice");
    for &effect in ALL {
        let info = effect.info();
        let texts = [info.title, info.sentence, info.equation, info.source, info.fingerprint];
        assert!(texts.iter().all(|t| !t.trim().is_empty()), "{}", info.id);
        assert!(!info.look_alikes.is_empty(), "{} resembles nothing", info.id);
        for other in info.look_alikes.iter().chain(info.contains) {
            assert!(ids.contains(other) && *other != info.id, "{} names {other}", info.id);
        }
        let amplitudes = info.parameters.iter().filter(|p| p.role == Role::Amplitude).count();
        assert!(amplitudes > 0, "{} has no strength", info.id);
        for (k, parameter) in info.parameters.iter().enumerate() {
            let clash = info.parameters[..k].iter().any(|p| p.name == parameter.name);
            assert!(!clash && !parameter.unit.is_empty() && !parameter.meaning.is_empty(), "{}", info.id);
        }
    }
}

#[test]
fn typical_values_and_probes_lie_within_bounds() {
    for cx in contexts() {
        for &effect in ALL {
            // Operating points are not asked for what needs transients.
            if cx.period > 0.05 && effect.info().needs.contains(&Need::Transients) {
                continue;
            }
            let parameters = effect.info().parameters;
            for p in parameters {
                let (low, typical, high) = ((p.low)(&cx), (p.typical)(&cx), (p.high)(&cx));
                assert!(
                    low <= typical && typical <= high,
                    "{}.{}: {low} {typical} {high}",
                    effect.id(),
                    p.name
                );
                if p.role == Role::Amplitude {
                    assert!(low <= 0.0 && high > 0.0 && typical != 0.0, "{}.{}", effect.id(), p.name);
                }
            }
            let probes = effect.probes(&cx);
            assert!(!probes.is_empty(), "{}", effect.id());
            for probe in probes {
                assert_eq!(probe.len(), parameters.len(), "{}", effect.id());
                for (x, p) in probe.iter().zip(parameters).filter(|(_, p)| p.role != Role::Amplitude) {
                    let (low, high) = ((p.low)(&cx), (p.high)(&cx));
                    assert!(low <= *x && *x <= high, "{}.{}: {low} {x} {high}", effect.id(), p.name);
                }
            }
            let fitted = (0..parameters.len()).filter(|k| effect.fitted(&cx, *k)).collect::<Vec<_>>();
            assert!(fitted.iter().any(|k| parameters[*k].role == Role::Amplitude), "{}", effect.id());
        }
    }
}
