//! One field energy behind current and torque, and losses of the right sign.

use crate::support::{MACHINE, N_P, run, still, typical, with};
use pmsm_core::base::Base;
use pmsm_core::effect::{Context, Electrical, Env, Field, FieldPoint, Site};
use pmsm_core::effects::{ALL, EffectId};
use pmsm_core::model::Model;
use pmsm_core::numerics::rk4;
use pmsm_core::simulate::mechanical;
use std::f64::consts::TAU;

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
        let mut own = typical(effect, &signals);
        // A magnet exchanges energy while it weakens: it is to have settled by the last turn.
        if let Some(tau) = effect.info().parameters.iter().position(|p| p.name == "tau_th") {
            own[tau] = 1e-3;
        }
        let loss = steady_loss(effect, &own, signals.context);
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

#[test]
fn what_bypasses_the_winding_follows_the_voltage_while_the_current_changes() {
    let signals = run(false);
    let model = Model::new(signals.context, &[EffectId::IronLoss]);
    let r_c = 400.0;
    let p = [&MACHINE[..], &[1.0 / r_c, 1e-4, 0.0]].concat();
    let torque = mechanical::torque(&model, &signals, &p);
    let (v, i) = (signals.v.as_ref().unwrap(), signals.i.as_ref().unwrap());
    let [r_s, l_d, l_q, psi_m, ..] = MACHINE;
    let tau = |i: [f64; 2]| 1.5 * N_P * (psi_m + (l_d - l_q) * i[0]) * i[1];
    let mut moved = 0.0f64;
    for k in 1..signals.len() - 1 {
        let here = [i[0][k], i[1][k]];
        let left = |e: [f64; 2]| [here[0] - e[0] / r_c, here[1] - e[1] / r_c];
        let e = [0, 1].map(|axis| 0.5 * (v[axis][k - 1] + v[axis][k]) - r_s * here[axis]);
        let expected = tau(left(e));
        assert!((torque[k] - expected).abs() < 1e-9, "sample {k}: {} {expected}", torque[k]);
        let omega = signals.omega_e[k];
        let at_rest = [-omega * l_q * here[1], omega * (psi_m + l_d * here[0])];
        moved = moved.max((tau(left(at_rest)) - expected).abs());
    }
    assert!(moved > 0.05, "the currents change too slowly to tell: {moved} N m");
}
