//! One damped step within the bounds.

use super::{MAX_DAMPING, Normal};
use nalgebra::{Cholesky, DMatrix, DVector};

/// Ridge of the step that counts as undamped, relative to the unit diagonal of the scaled JᵀJ: the least that lets a
/// rank-deficient matrix be factorised in double precision.
pub(super) const RIDGE: f64 = 1e-14;

/// A step within the bounds, and what the normal equations say of it.
pub(super) struct Step {
    /// The step, in the units of the parameters.
    pub step: DVector<f64>,
    /// Predicted reduction of the cost, −2 gᵀs − sᵀJᵀJ s.
    pub reduction: f64,
    /// The larger of |gᵀs| and sᵀJᵀJ s: zero at a constrained minimum only, even where bounds cut the step so that
    /// the prediction is not positive.
    pub promise: f64,
}

impl Step {
    /// Solves (JᵀJ + damping·D²) s = −Jᵀr, D = diag(`scale`), for the parameters that are neither frozen nor carried
    /// to a bound.
    pub fn solve(
        normal: &Normal,
        p: &[f64],
        bounds: &[(f64, f64)],
        scale: &DVector<f64>,
        damping: f64,
    ) -> Self {
        let (jtj, jtr, dim) = (&normal.jtj, &normal.jtr, p.len());
        let mut step = DVector::zeros(dim);
        let mut free: Vec<usize> = (0..dim)
            .filter(|&k| {
                let (low, high) = bounds[k];
                let outward = (p[k] <= low && jtr[k] >= 0.0) || (p[k] >= high && jtr[k] <= 0.0);
                scale[k] > 0.0 && low < high && !outward
            })
            .collect();
        while !free.is_empty() {
            // Right-hand side −g − JᵀJ·s with s the moves of those already carried to a bound.
            let rhs = -(jtr + jtj * &step);
            let matrix = DMatrix::from_fn(free.len(), free.len(), |i, j| {
                jtj[(free[i], free[j])] / (scale[free[i]] * scale[free[j]])
            });
            let rhs = DVector::from_fn(free.len(), |i, _| rhs[free[i]] / scale[free[i]]);
            let solution = solve_damped(&matrix, &rhs, damping);
            let mut kept = Vec::with_capacity(free.len());
            for (i, &k) in free.iter().enumerate() {
                let move_ = solution[i] / scale[k];
                let (low, high) = bounds[k];
                if p[k] + move_ < low {
                    step[k] = low - p[k];
                } else if p[k] + move_ > high {
                    step[k] = high - p[k];
                } else {
                    kept.push((k, move_));
                }
            }
            if kept.len() == free.len() {
                for &(k, move_) in &kept {
                    step[k] = move_;
                }
                break;
            }
            free = kept.into_iter().map(|(k, _)| k).collect();
        }
        let slope = jtr.dot(&step);
        let curvature = step.dot(&(jtj * &step));
        Self { reduction: -2.0 * slope - curvature, promise: slope.abs().max(curvature), step }
    }

    /// The point this step leads to, exactly on a bound where it reaches one.
    pub fn from(&self, p: &[f64], bounds: &[(f64, f64)]) -> Vec<f64> {
        let ends = p.iter().zip(self.step.iter()).zip(bounds);
        ends.map(|((&x, &move_), &(low, high))| (x + move_).clamp(low, high)).collect()
    }
}

/// Solves (`matrix` + damping·I) x = `rhs`; rounding that leaves the matrix indefinite is met with more damping.
fn solve_damped(matrix: &DMatrix<f64>, rhs: &DVector<f64>, mut damping: f64) -> DVector<f64> {
    loop {
        let mut damped = matrix.clone();
        for k in 0..rhs.len() {
            damped[(k, k)] += damping;
        }
        if let Some(factor) = Cholesky::new(damped) {
            return factor.solve(rhs);
        }
        if damping > MAX_DAMPING {
            return DVector::zeros(rhs.len());
        }
        damping *= 10.0;
    }
}
