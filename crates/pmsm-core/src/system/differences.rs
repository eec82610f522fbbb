//! Residuals of a model that is only known by its values: derivatives by central differences.

use super::Residuals;
use crate::experiment::Linearisation;
use nalgebra::{DMatrix, DVector};

/// Step of a central difference as a share of the parameter: the cube root of the rounding error.
const STEP: f64 = 6e-6;
/// Share of its range that a parameter near zero counts as.
const SIZE: f64 = 1e-3;

/// A model that shows its weighted errors and nothing else.
pub trait Errors: Sync {
    /// Number of outputs.
    fn outputs(&self) -> usize;
    /// Number of samples per output.
    fn samples(&self) -> usize;
    /// Weighted errors, model minus measurement, at each of several points (row-major): output by output within a point,
    /// zero where nothing was measured. Values that are missing at the end count as not finite.
    fn errors(&self, points: &[f64]) -> Vec<f64>;
}

/// [`Errors`] as [`Residuals`], several points at once.
#[derive(Debug, Clone)]
pub struct Differences<'a, E> {
    /// The model.
    pub model: &'a E,
    /// Bounds of its parameters; no difference reaches beyond them.
    pub bounds: &'a [(f64, f64)],
}

impl<E: Errors> Differences<'_, E> {
    fn evaluate(&self, points: &[f64]) -> (Vec<f64>, usize) {
        let rows = self.model.outputs() * self.model.samples();
        let mut errors = self.model.errors(points);
        errors.resize(rows * points.len() / self.bounds.len(), f64::NAN);
        (errors, rows)
    }
}

impl<E: Errors> Residuals for Differences<'_, E> {
    fn parameters(&self) -> usize {
        self.bounds.len()
    }

    fn samples(&self) -> usize {
        self.model.samples()
    }

    fn costs(&self, points: &[f64], _: &[f64]) -> Vec<f64> {
        let (errors, rows) = self.evaluate(points);
        let sums = errors.chunks(rows).map(|x| x.iter().map(|e| e * e).sum::<f64>());
        sums.map(|sum| if sum.is_finite() { sum } else { f64::INFINITY }).collect()
    }

    fn linearise(&self, p: &[f64]) -> Linearisation {
        let dim = p.len();
        let mut points = p.to_vec();
        let mut widths = Vec::with_capacity(dim);
        for (k, (low, high)) in self.bounds.iter().enumerate() {
            let step = STEP * p[k].abs().max(SIZE * (high - low));
            let sides = [(p[k] - step).max(*low), (p[k] + step).min(*high)];
            for side in sides {
                let first = points.len();
                points.extend_from_slice(p);
                points[first + k] = side;
            }
            widths.push(sides[1] - sides[0]);
        }
        let (errors, rows) = self.evaluate(&points);
        let at = |point: usize, row: usize| errors[point * rows + row];
        Linearisation {
            residual: DVector::from_fn(rows, |row, _| at(0, row)),
            jacobian: DMatrix::from_fn(rows, dim, |row, k| {
                (at(2 + 2 * k, row) - at(1 + 2 * k, row)) / widths[k]
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors a²·k − b over samples k, one output; fails behind a = 5.
    struct Parabola;

    impl Errors for Parabola {
        fn outputs(&self) -> usize {
            1
        }
        fn samples(&self) -> usize {
            3
        }
        fn errors(&self, points: &[f64]) -> Vec<f64> {
            let points = points.chunks(2).take_while(|p| p[0] <= 5.0);
            points.flat_map(|p| (0..3).map(|k| p[0] * p[0] * f64::from(k) - p[1])).collect()
        }
    }

    #[test]
    fn differences_are_the_derivatives_also_at_a_bound() {
        let differences = Differences { model: &Parabola, bounds: &[(0.0, 2.0), (-1.0, 1.0)] };
        for p in [[1.3, 0.2], [2.0, -1.0]] {
            let linear = differences.linearise(&p);
            for k in 0..3 {
                assert!((linear.residual[k] - (p[0] * p[0] * k as f64 - p[1])).abs() < 1e-15);
                let tolerance = if p[0] == 2.0 { 1e-4 } else { 1e-9 };
                assert!((linear.jacobian[(k, 0)] - 2.0 * p[0] * k as f64).abs() < tolerance);
                assert!((linear.jacobian[(k, 1)] + 1.0).abs() < 1e-9);
            }
        }
        assert_eq!(differences.costs(&[1.0, 0.0, 6.0, 0.0], &[f64::INFINITY; 2]), [5.0, f64::INFINITY]);
    }
}
