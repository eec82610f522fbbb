//! The equations of every smooth effect are integrated to fourth order.

use crate::support::{N_P, run, typical, with};
use pmsm_core::base::Base;
use pmsm_core::effect::{Context, Env, Site};
use pmsm_core::effects::{ALL, EffectId};
use pmsm_core::model::Model;
use pmsm_core::numerics::rk4;
use pmsm_core::signals::Signals;

/// Effects whose equations have a kink in their states, at reversal of speed or torque: |ω_m|, |τ_e| and a contact have no second
/// derivative there, so that no method can keep its order across it. The signs of the other frictions are
/// smooth, as are saturation with an even exponent and all others.
const KINKED: [EffectId; 4] = [
    EffectId::QuadraticDrag,
    EffectId::LoadDependentFriction,
    EffectId::PreslidingFriction,
    EffectId::Backlash,
];

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
