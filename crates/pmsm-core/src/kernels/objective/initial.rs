//! The search for the initial values of one gap-free segment that make its sum of squares least.
//!
//! Far from the true parameters much of the error stays whatever the initial values, and Gauss–Newton steps creep. Fletcher and Xu
//! (1987) keep the Gauss–Newton matrix while steps lower the sum much, and gather its curvature by BFGS where they do not.

use crate::kernels::bare::copies::INITIAL;
use nalgebra::{Matrix3, Vector3};

/// A step that lowers the sum of squares by this share or more is a good one (ε of Fletcher and Xu).
const GOOD: f64 = 0.2;
/// Share of a sum of squares that rounding may move: some thousand rows, each by its last bit.
const ROUNDING: f64 = 1e-12;

/// The sum of squares of one segment near some initial values.
#[derive(Debug, Clone)]
pub(super) struct Slope {
    /// The sum of squares.
    pub(super) cost: f64,
    /// Products of the derivatives by the initial values.
    pub(super) gram: Matrix3<f64>,
    /// Half the gradient: products of these derivatives and the error.
    pub(super) gradient: Vector3<f64>,
}

/// Where the search stands.
#[derive(Debug)]
pub(super) struct Search {
    /// The best initial values so far.
    pub(super) at: [f64; INITIAL],
    /// What the sum of squares is like there.
    slope: Slope,
    /// Half the second derivatives of the sum of squares, as far as they are known.
    curvature: Matrix3<f64>,
    /// The step to try next.
    step: Vector3<f64>,
}

impl Search {
    pub(super) fn new(slope: Slope, at: [f64; INITIAL]) -> Self {
        let step = downhill(slope.gram, slope.gradient).unwrap_or_default();
        Self { at, curvature: slope.gram, slope, step }
    }

    /// Where a Gauss–Newton step leads.
    pub(super) fn better(&self) -> [f64; INITIAL] {
        moved(self.at, downhill(self.slope.gram, self.slope.gradient).unwrap_or_default())
    }

    /// Where to look next.
    pub(super) fn next(&self) -> [f64; INITIAL] {
        moved(self.at, self.step)
    }

    /// Takes in what a run from `at` told: goes there, or tries half the step where that led uphill by more than rounding.
    pub(super) fn seen(&mut self, slope: Slope, at: [f64; INITIAL]) {
        let by = Vector3::from_fn(|k, _| at[k] - self.at[k]);
        if by == Vector3::zeros() {
            return;
        }
        // True for NaN, too.
        let uphill = slope.cost.partial_cmp(&(self.slope.cost * (1.0 + ROUNDING))).is_none_or(|o| o.is_gt());
        if uphill {
            self.step *= 0.5;
            return;
        }
        self.curvature = if slope.cost <= (1.0 - GOOD) * self.slope.cost {
            slope.gram
        } else {
            updated(self.curvature, by, slope.gradient - self.slope.gradient)
        };
        (self.at, self.slope) = (at, slope);
        let [known, gauss_newton] =
            [self.curvature, self.slope.gram].map(|m| downhill(m, self.slope.gradient));
        self.step = known.or(gauss_newton).unwrap_or_default();
    }
}

/// The step to where a parabola of that curvature is least; none where it does not tell.
fn downhill(curvature: Matrix3<f64>, gradient: Vector3<f64>) -> Option<Vector3<f64>> {
    let step = -curvature.cholesky()?.solve(&gradient);
    step.iter().all(|x| x.is_finite()).then_some(step)
}

fn moved(at: [f64; INITIAL], step: Vector3<f64>) -> [f64; INITIAL] {
    std::array::from_fn(|k| at[k] + step[k])
}

/// The BFGS update of a curvature by a `step` and the `change` of the gradient along it; the same where that is no valley.
fn updated(curvature: Matrix3<f64>, step: Vector3<f64>, change: Vector3<f64>) -> Matrix3<f64> {
    let (along, before) = (change.dot(&step), curvature * step);
    let was = before.dot(&step);
    if !(along > 0.0 && was > 0.0) {
        return curvature;
    }
    curvature + change * change.transpose() / along - before * before.transpose() / was
}
