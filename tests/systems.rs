//! Own systems: a direct-current motor and an induction machine are found again, whatever the method.

#[allow(dead_code, missing_docs)]
#[path = "../crates/pmsm-core/examples/own_system.rs"]
mod own_system;

use own_system::{DcMotor, InductionMachine, dc_motor, induction_machine, measured};
use pmsm_core::identify::Method;
use pmsm_core::monitor::{Monitor, Silent};
use pmsm_core::numerics::real::Real;
use pmsm_core::system::{Between, Observations, Request, System, SystemFit, identify};
use std::sync::atomic::{AtomicUsize, Ordering};

fn check(fit: &SystemFit, parameters: &[(&str, (f64, f64), f64)]) {
    assert!(fit.converged && !fit.interrupted);
    assert!(fit.cannot_show.is_empty(), "{:?}", fit.cannot_show);
    for (name, _, truth) in parameters {
        let estimate = fit.get(name).unwrap();
        let (value, stderr) = (estimate.value.unwrap(), estimate.stderr.unwrap());
        assert!((value - truth).abs() < 4.0 * stderr, "{name}: {value} ± {stderr}, true {truth}");
        assert!(stderr < 0.1 * truth, "{name}: {value} ± {stderr}");
    }
}

#[test]
fn the_direct_current_motor_is_found_with_honest_errors() {
    check(&dc_motor().unwrap(), &DcMotor::PARAMETERS);
}

#[test]
fn the_induction_machine_is_found_with_honest_errors() {
    check(&induction_machine().unwrap(), &InductionMachine::PARAMETERS);
}

/// x' = −a·x + u, measured with gaps; the initial value is a parameter.
struct Decay;

impl System<1, 1> for Decay {
    fn start<T: Real>(&self, p: &[T]) -> [T; 1] {
        [p[1]]
    }
    fn rhs<T: Real>(&self, p: &[T], _: f64, x: &[T; 1], u: &[f64]) -> [T; 1] {
        [-(p[0] * x[0]) + u[0]]
    }
    fn output<T: Real>(&self, _: &[T], _: f64, x: &[T; 1], _: &[f64]) -> [T; 1] {
        *x
    }
}

const DECAY: [(&str, (f64, f64)); 2] = [("a", (0.1, 10.0)), ("x_0", (-5.0, 5.0))];

fn decay() -> Observations {
    let t: Vec<f64> = (0..100).map(|k| f64::from(k) * 0.02).collect();
    let input: Vec<f64> = t.iter().map(|t| if *t < 1.0 { 0.0 } else { 3.0 }).collect();
    measured(&Decay, &[2.0, 1.5], t, vec![input], [0.01]).unwrap()
}

#[test]
fn every_method_leads_there_and_missing_values_do_not_count() {
    let run = decay();
    let mut holed = run.outputs().to_vec();
    for k in (0..100).filter(|k| k % 3 == 0) {
        holed[0][k] = f64::NAN;
    }
    let holed = Observations::new(run.t().to_vec(), run.inputs().to_vec(), holed).unwrap().with_substeps(2);
    for observations in [&run, &holed] {
        for method in [Method::Swarm, Method::LeastSquares, Method::Both] {
            let request = Request { method, ..Request::default() };
            let fit = identify(&Decay, observations, &DECAY, &request, &Silent).unwrap();
            let value = |name: &str| fit.get(name).unwrap().value.unwrap();
            assert!(
                (value("a") - 2.0).abs() < 0.05 && (value("x_0") - 1.5).abs() < 0.02,
                "{method:?} {fit:?}"
            );
        }
    }
}

#[test]
fn inputs_between_samples_are_held_or_go_in_straight_lines() {
    let t: Vec<f64> = (0..10).map(f64::from).collect();
    let ramp = t.clone();
    let run = Observations::new(t.clone(), vec![ramp], vec![t]).unwrap();
    // x' = u with u = t: t²/2 along straight lines, the sum of the values before when held.
    let held = run.simulate(&Decay, &[0.0, 0.0]);
    let lines = run.with_inputs(Between::Linear).simulate(&Decay, &[0.0, 0.0]);
    assert!((held[0][9] - 36.0).abs() < 1e-12 && (lines[0][9] - 40.5).abs() < 1e-12);
}

#[test]
fn a_stop_keeps_the_best_so_far() {
    struct After(AtomicUsize);
    impl Monitor for After {
        fn cancelled(&self) -> bool {
            self.0.load(Ordering::Relaxed) >= 5
        }
        fn report(&self, _: &str, _: f64) {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
    }
    let fit = identify(&Decay, &decay(), &DECAY, &Request::default(), &After(AtomicUsize::new(0))).unwrap();
    assert!(fit.interrupted && !fit.converged && fit.cost.is_finite());
    assert_eq!(fit.history.len(), 5);
}

#[test]
fn what_makes_no_sense_is_refused() {
    let refused = |parameters: &[(&str, (f64, f64))], request: Request, part: &str| {
        let error =
            identify(&Decay, &decay(), parameters, &request, &Silent).map(drop).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    };
    let least = || Request { method: Method::LeastSquares, ..Request::default() };
    refused(&[], least(), "at least one parameter");
    refused(&[("a", (1.0, 1.0)), ("x_0", (0.0, 1.0))], least(), "bounds of a are 1 and 1");
    refused(&[("a", (-1e9, -1e8)), ("x_0", (0.0, 1.0))], Request::default(), "cannot be simulated");
    refused(&DECAY, Request { start: Some(vec![f64::NAN, 0.0]), ..least() }, "start is");
    let two = Observations::new((0..10).map(f64::from).collect(), vec![], vec![vec![1.0; 10]; 2]).unwrap();
    assert!(identify(&Decay, &two, &DECAY, &least(), &Silent).map(drop).is_err());
}
