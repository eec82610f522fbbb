//! The kernels against the reference equations: costs, residuals, and derivatives, which the kernels take from perturbed copies.

use crate::sensitivity::Sensitivity;
use crate::{objective, points, signals};
use pmsm_core::kernels::bare::POINT;
use pmsm_core::kernels::bare::copies::{INITIAL, NUDGE};
use pmsm_core::kernels::objective::{Drive, Objective, Starts, speed_weight};
use pmsm_core::model::Model;
use pmsm_core::recording::Load;
use pmsm_core::signals::Signals;
use pmsm_core::simulate::mechanical;
use proptest::prelude::*;

/// The best initial values are those where a Gauss–Newton step is no more than this share of the largest current and speed.
const AT_REST: f64 = 1e-5;

/// How far difference quotients of the kernels may be from the derivatives, in length.
struct Off {
    parameters: [f64; POINT],
    initial: [f64; INITIAL],
}

impl Off {
    /// A forward quotient over h is the mean derivative over h. It is off by half of what the derivative changes by there, and by the
    /// rounding of a run over h. A small friction is moved by a share of the largest torque, here up to four times as far.
    fn new(signals: &Signals, here: &Sensitivity<'_>, p: &[f64], starts: &Starts) -> Self {
        let weights = weights(signals);
        let parameters = std::array::from_fn(|k| {
            let (mut there, h) = (p.to_vec(), NUDGE * p[k]);
            there[k] += h;
            let there = Sensitivity::new(signals, weights, &there, starts);
            let change = (there.parameters.column(k) - here.parameters.column(k)).norm();
            4.0 * 0.5 * change + here.rounding / h
        });
        let initial = std::array::from_fn(|x| {
            let (mut there, h) = (starts.clone(), NUDGE * sizes(signals)[x]);
            there.iter_mut().for_each(|start| start[x] += h);
            let there = Sensitivity::new(signals, weights, p, &there);
            let change = (there.initial.column(x) - here.initial.column(x)).norm();
            0.5 * change + here.rounding / h
        });
        Self { parameters, initial }
    }
}

/// What a square of a current and one of the speed count.
fn weights(signals: &Signals) -> [f64; 2] {
    [1.5, speed_weight(signals).powi(2)]
}

/// The largest i_d, i_q (A) and ω_e (rad/s).
fn sizes(signals: &Signals) -> [f64; INITIAL] {
    let cx = &signals.context;
    [cx.i_max, cx.i_max, cx.omega_e_max]
}

fn compare(factors: [f64; POINT], case: usize) -> Result<(), TestCaseError> {
    let (period, load) = [
        (2e-5, Load::UnknownConstant),
        (1e-3, Load::None),
        (1e-4, Load::Measured),
        (1e-4, Load::KnownConstant(0.7)),
    ][case];
    let (plant, signals) = signals(400, period, Some(150), load);
    let (model, windows) = (Model::new(signals.context, &[]), mechanical::windows(&signals));
    let objective = objective(&model, &signals, &windows);
    let (p, measured) = (points(&plant, &[factors]), objective.measured_starts());
    let reference = objective.clone().reference();
    let here = Sensitivity::new(&signals, weights(&signals), &p, &measured);

    let (mut cost, expected) = ([0.0], reference.fitness(&p, f64::INFINITY));
    prop_assert_eq!(objective.fitnesses(&p, &[f64::INFINITY], &mut cost, &|| false), 1);
    prop_assert!((cost[0] - expected).abs() <= here.rounding_of_cost(expected), "{} {expected}", cost[0]);

    for path in [&objective, &reference] {
        at_rest(&signals, path, &p)?;
    }
    derivatives(&signals, &objective, &reference, &p)
}

/// Initial values are the best ones by derivatives of the equations, and the residual is that around them.
fn at_rest(signals: &Signals, path: &Objective<'_>, p: &[f64]) -> Result<(), TestCaseError> {
    let starts = path.initial_values(p);
    prop_assert_eq!(path.residual(p), path.linearise(p, &[], Some(&starts)).residual);
    let there = Sensitivity::new(signals, weights(signals), p, &starts);
    let off = Off::new(signals, &there, p, &starts).initial;
    for (step, astray) in there.steps(off) {
        for x in 0..INITIAL {
            let allowed = AT_REST * sizes(signals)[x] + astray[x];
            prop_assert!(step[x].abs() <= allowed, "{x}: a step of {:e}, {allowed:e} allowed", step[x]);
        }
    }
    Ok(())
}

#[test]
fn no_initial_currents_are_sought_where_the_speed_alone_is_simulated() {
    let (plant, signals) = signals(400, 1e-4, None, Load::None);
    let (model, windows) = (Model::new(signals.context, &[]), Drive::MeasuredTorque.windows(&signals));
    let objective = Objective::new(Drive::MeasuredTorque, &model, &signals, &windows);
    assert!(objective.initial_values(&points(&plant, &[[1.0; POINT]])).is_empty());
}

/// Residual and derivatives around the same initial values.
fn derivatives(
    signals: &Signals,
    objective: &Objective<'_>,
    reference: &Objective<'_>,
    p: &[f64],
) -> Result<(), TestCaseError> {
    let free = [0, 1, 2, 3, 4, 5, 6];
    let near = objective.normal(p, &free, &objective.measured_starts(), false, &|| false).expect("kernels");
    let starts = near.course.best();
    let (fast, slow) =
        (objective.linearise(p, &free, Some(starts)), reference.linearise(p, &free, Some(starts)));
    let here = Sensitivity::new(signals, weights(signals), p, starts);
    let off = Off::new(signals, &here, p, starts);

    let (found, rest) = ((&fast.residual - &slow.residual).norm(), slow.residual.norm());
    let allowed = here.rounding + here.carried(here.errors.as_slice(), rest, off.initial);
    prop_assert!(found <= allowed, "residual: off by {found:e} of {rest:e}, {allowed:e} allowed");
    for k in free {
        let rest = slow.jacobian.column(k).norm();
        let found = (fast.jacobian.column(k) - slow.jacobian.column(k)).norm();
        let column = here.parameters.column(k);
        let allowed = off.parameters[k] + here.carried(column.as_slice(), rest, off.initial);
        prop_assert!(found <= allowed, "{k}: off by {found:e} of {rest:e}, {allowed:e} allowed");
    }

    // Sums of products against the columns: a rounding a row, of whole columns, and the square of the condition times that, as the
    // initial values are solved for by such sums.
    let second = objective.normal(p, &free, starts, true, &|| false).expect("kernels");
    prop_assert_eq!(&second.linear.expect("recorded").jacobian, &fast.jacobian);
    let rounding = fast.residual.len() as f64 * f64::EPSILON * (1.0 + here.condition().powi(2));
    let cost = fast.residual.norm_squared();
    prop_assert!((second.normal.cost - cost).abs() <= rounding * here.errors.norm_squared());
    let jtj = fast.jacobian.tr_mul(&fast.jacobian);
    prop_assert!((second.normal.jtj - jtj).norm() <= rounding * here.parameters.norm_squared());
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn kernels_give_the_numbers_of_the_reference_equations(
        factors in prop::array::uniform7(0.6..1.6f64), case in 0usize..4,
    ) {
        compare(factors, case)?;
    }
}

/// A short run hardly shows friction: the rounding of the flux, which shows as currents of the magnet's size, is much of its column.
#[test]
fn a_column_that_hardly_shows_is_off_by_no_more_than_rounding() {
    compare([0.758, 0.669, 1.551, 1.544, 1.349, 0.665, 1.254], 0).expect("within the bounds");
}

/// Currents and speed of a light rotor swing for long, and derivatives change much faster than the parameters.
#[test]
fn a_column_that_changes_fast_is_off_by_no_more_than_truncation() {
    compare([0.6, 0.6, 1.5590343914751, 0.6, 0.6, 0.6, 0.6], 1).expect("within the bounds");
}

/// Far from the true parameters half the error stays whatever the initial values are, and Gauss–Newton steps creep.
#[test]
fn initial_values_are_the_best_ones_far_from_the_true_parameters() {
    let factors = [0.6, 1.4734738913262608, 1.0346648957747946, 0.6, 0.6, 0.6, 1.5828700387265435];
    compare(factors, 1).expect("within the bounds");
}
