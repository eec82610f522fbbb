//! Covariance of the fitted parameters of a hypothesis.

use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::torque_noise;
use crate::optimise::{least_squares, uncertainty};
use nalgebra::{DMatrix, DVector};

/// The fitted parameters, the electrical ones first, and their covariance, corrected for coloured residuals.
///
/// The electrical parameters come from the electrical channels alone, and the mechanical ones from the speed at
/// those values. Their covariance follows the same way down: C_m = C_m|e + G·C_e·Gᵀ with
/// G = −(J_mᵀJ_m)⁻¹·J_mᵀJ_e on the rows of the speed, and noise of the torque adds to it. Where a sensor
/// is in the set, all were fitted together.
pub(super) fn of_parameters(data: &Data, hypothesis: &Hypothesis) -> (Vec<usize>, DMatrix<f64>) {
    let experiment = data.whole(hypothesis);
    let linear = experiment.linearise(&hypothesis.parameters, &hypothesis.free);
    let n = data.signals.len();
    let speed = experiment.channels().iter().position(|c| !c.is_electrical());
    let (first, second): (Vec<usize>, Vec<usize>) =
        (0..hypothesis.free.len()).partition(|k| experiment.is_electrical(hypothesis.free[*k]));
    let alone = first.is_empty() || second.is_empty() || !data.has_electrical();
    let together = hypothesis.model.has_sensor() || alone;
    let free: Vec<usize> = first.iter().chain(&second).map(|k| hypothesis.free[*k]).collect();
    let covariance = match speed {
        _ if free.is_empty() => DMatrix::zeros(0, 0),
        Some(speed) if !together => {
            let (before, at) = (speed * n, speed * n..(speed + 1) * n);
            let electrical = linear.jacobian.select_columns(&first).rows(0, before).into_owned();
            let c_e = of_held(data, true, (&electrical, &linear.residual.rows(0, before).into_owned()), n);
            let rows = linear.jacobian.rows(at.start, n);
            let (j_e, j_m) = (rows.select_columns(&first), rows.select_columns(&second));
            let c_m = of_held(data, false, (&j_m, &linear.residual.rows(at.start, n).into_owned()), n);
            let all = vec![true; second.len()];
            let inverse = least_squares::covariance(&j_m.tr_mul(&j_m), None, &all).map(finite);
            let shaken = torque_noise::scores(data, hypothesis, &j_m);
            let c_m = c_m + &inverse * shaken * &inverse;
            let g = -(inverse * j_m.tr_mul(&j_e));
            let (a, b) = (first.len(), second.len());
            let mut whole = DMatrix::zeros(a + b, a + b);
            whole.view_mut((a, a), (b, b)).copy_from(&(c_m + &g * c_e.map(finite) * g.transpose()));
            let cross = &g * c_e.map(finite);
            whole.view_mut((a, 0), (b, a)).copy_from(&cross);
            whole.view_mut((0, a), (a, b)).copy_from(&cross.transpose());
            whole.view_mut((0, 0), (a, a)).copy_from(&c_e);
            whole
        }
        _ => {
            let jacobian = linear.jacobian.select_columns(&[first, second].concat());
            uncertainty::covariance(&jacobian, &linear.residual, n)
        }
    };
    (free, covariance)
}

/// What is not determined carries nothing over to other parameters.
pub(super) fn finite(x: f64) -> f64 {
    if x.is_finite() { x } else { 0.0 }
}

/// Covariance from the rows of the recordings that hold electrical (or mechanical) channels: those of the others are zero and
/// would fill blocks of the sandwich estimate.
fn of_held(
    data: &Data,
    electrical: bool,
    (jacobian, residual): (&DMatrix<f64>, &DVector<f64>),
    n: usize,
) -> DMatrix<f64> {
    let holds = |run: &Data| if electrical { run.has_electrical() } else { run.has_mechanical() };
    let runs = data.runs().iter().enumerate().filter(|(_, run)| holds(run));
    let held: Vec<usize> = runs.flat_map(|(run, _)| data.samples_of(run)).collect();
    if held.len() == n {
        return uncertainty::covariance(jacobian, residual, n);
    }
    let rows: Vec<usize> =
        (0..residual.len() / n).flat_map(|c| held.iter().map(move |k| c * n + k)).collect();
    uncertainty::covariance(&jacobian.select_rows(&rows), &residual.select_rows(&rows), held.len())
}
