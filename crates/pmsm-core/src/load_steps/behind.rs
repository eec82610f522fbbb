//! Products of columns with hinges from sums over the points behind each: what a product costs does not depend on the number of points.

use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Columns over the points of a grid, and what they add up to from each point on.
#[derive(Clone)]
pub struct Behind {
    /// One row per column.
    columns: DMatrix<f64>,
    /// Σx and, below, Σt·x over this point and all behind it, one row per column.
    sums: DMatrix<f64>,
}

impl Behind {
    /// Of `columns` over points at the times `t`.
    pub fn new(t: &[f64], columns: &DMatrix<f64>) -> Self {
        let (columns, count) = (columns.transpose(), columns.ncols());
        let mut sums = DMatrix::zeros(2 * count, t.len() + 1);
        for row in (0..t.len()).rev() {
            for c in 0..count {
                let x = columns[(c, row)];
                sums[(c, row)] = sums[(c, row + 1)] + x;
                sums[(count + c, row)] = sums[(count + c, row + 1)] + t[row] * x;
            }
        }
        Self { columns, sums }
    }

    /// The product of each column with the hinge of a step at the time `step`, whose points `corner` are no part of a straight line but
    /// what `hinge` says.
    pub fn along(&self, corner: Range<usize>, step: f64, hinge: impl Fn(usize) -> f64) -> DVector<f64> {
        let (sums, count) = (self.sums.column(corner.end), self.columns.nrows());
        let mut along = DVector::from_fn(count, |c, _| sums[count + c] - step * sums[c]);
        for row in corner {
            along.axpy(hinge(row), &self.columns.column(row), 1.0);
        }
        along
    }
}
