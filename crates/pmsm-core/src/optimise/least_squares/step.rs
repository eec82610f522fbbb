//! One damped step within the bounds.

use super::{Fit, MAX_DAMPING, Normal};
use nalgebra::{Cholesky, DMatrix, DVector};

/// Ridge of the step that counts as undamped, relative to the unit diagonal of the scaled JᵀJ: the least that lets a
/// rank-deficient matrix be factorised in double precision.
pub(super) const RIDGE: f64 = 1e-14;

/// The same of a step that no run checks: directions that JᵀJ hardly determines are left alone.
const CAUTION: f64 = 1e-6;

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

    /// The undamped step that no run will check.
    pub fn cautious(normal: &Normal, p: &[f64], bounds: &[(f64, f64)]) -> Self {
        let column = normal.jtj.diagonal().map(|x| x.max(0.0).sqrt());
        Self::solve(normal, p, bounds, &column, CAUTION)
    }

    /// The point this step leads to, exactly on a bound where it reaches one.
    pub fn from(&self, p: &[f64], bounds: &[(f64, f64)]) -> Vec<f64> {
        let ends = p.iter().zip(self.step.iter()).zip(bounds);
        ends.map(|((&x, &move_), &(low, high))| (x + move_).clamp(low, high)).collect()
    }
}

impl Fit {
    /// Takes what is left of the way to the minimum within `bounds`, in one step that the normal equations promise and no evaluation
    /// checks; returns it, in the units of the parameters. The normal equations stay those of where it began.
    pub fn go_on(&mut self, bounds: &[(f64, f64)]) -> Option<DVector<f64>> {
        let step = Step::cautious(&self.normal, &self.parameters, bounds);
        if step.reduction.is_nan() || step.reduction <= 0.0 {
            return None;
        }
        self.parameters = step.from(&self.parameters, bounds);
        self.cost = (self.cost - step.reduction).max(0.0);
        self.at_bound = lie_on(bounds, &self.parameters);
        Some(step.step)
    }
}

/// Which parameters lie on a bound.
pub(super) fn lie_on(bounds: &[(f64, f64)], p: &[f64]) -> Vec<bool> {
    p.iter().zip(bounds).map(|(&x, &(low, high))| x <= low || x >= high).collect()
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

#[cfg(test)]
mod tests {
    use crate::monitor::Silent;
    use crate::optimise::least_squares::{Fit, Normal, Problem, Settings, Status, minimise};
    use nalgebra::{DMatrix, DVector};
    use std::sync::atomic::{AtomicUsize, Ordering};

    const FREE: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

    /// Decays p_0·exp(−p_1·t) under an error that no parameter explains.
    #[derive(Default)]
    struct Decay {
        evaluations: AtomicUsize,
    }

    impl Problem for Decay {
        fn dim(&self) -> usize {
            2
        }
        fn cost(&self, p: &[f64]) -> f64 {
            self.normal(p).cost
        }
        fn normal(&self, p: &[f64]) -> Normal {
            self.evaluations.fetch_add(1, Ordering::Relaxed);
            let t = |k: usize| 0.1 * k as f64;
            let decay = |k: usize, rate: f64| (-rate * t(k)).exp();
            let measured = |k: usize| 2.0 * decay(k, 1.5) + 0.01 * (7.0 * k as f64).sin();
            let residual = DVector::from_fn(40, |k, _| p[0] * decay(k, p[1]) - measured(k));
            let slope = |k, c| if c == 0 { decay(k, p[1]) } else { -t(k) * p[0] * decay(k, p[1]) };
            let jacobian = DMatrix::from_fn(40, 2, slope);
            Normal {
                cost: residual.norm_squared(),
                jtj: jacobian.tr_mul(&jacobian),
                jtr: jacobian.tr_mul(&residual),
            }
        }
    }

    fn fitted(leaves_rest: bool, bounds: &[(f64, f64)]) -> (Fit, usize) {
        let settings =
            Settings { cost_tolerance: 1e-9, step_tolerance: 0.0, leaves_rest, ..Settings::default() };
        let problem = Decay::default();
        let mut fit = minimise(&problem, &[1.7, 1.2], bounds, &settings, &Silent).unwrap();
        assert_eq!(fit.status, Status::Converged);
        if leaves_rest {
            fit.go_on(bounds);
        }
        (fit, problem.evaluations.into_inner())
    }

    #[test]
    fn the_last_step_needs_no_evaluation() {
        let (whole, many) = fitted(false, &[FREE; 2]);
        let (short, fewer) = fitted(true, &[FREE; 2]);
        assert!(fewer < many, "{fewer} {many}");
        // A distance of one standard error costs one part in 38.
        let off = DVector::from_fn(2, |k, _| short.parameters[k] - whole.parameters[k]);
        assert!(off.dot(&(&whole.normal.jtj * &off)) < 1e-8 * whole.cost, "{off}");
        assert!((short.cost / Decay::default().cost(&short.parameters) - 1.0).abs() < 1e-8);
    }

    #[test]
    fn the_last_step_ends_at_a_bound_and_leaves_alone_what_nothing_shows() {
        let bounds = [FREE, (1.0, 1.4)];
        assert_eq!(fitted(true, &bounds).0.at_bound, [false, true]);
        let flat = DMatrix::from_row_slice(2, 2, &[4.0, 0.0, 0.0, 1e-12]);
        let mut fit = Fit {
            parameters: vec![1.0, 1.0],
            cost: 1.0,
            normal: Normal { cost: 1.0, jtj: flat, jtr: DVector::from_vec(vec![0.4, 0.0]) },
            iterations: 1,
            status: Status::Converged,
            at_bound: vec![false; 2],
        };
        let nearer = [(0.95, 2.0), FREE];
        fit.go_on(&nearer).unwrap();
        assert_eq!((&fit.parameters[..], &fit.at_bound[..]), (&[0.95, 1.0][..], &[true, false][..]));
        assert!(fit.cost < 1.0);
    }
}
