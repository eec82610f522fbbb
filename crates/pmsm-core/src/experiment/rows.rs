//! Rows of a residual and of its derivatives, handed out to what computes them side by side.

use super::Linearisation;
use nalgebra::{DMatrix, DVector};

/// The rows of some channels.
pub(super) struct Rows<'r> {
    /// Of the residual.
    pub(super) residual: &'r mut [f64],
    /// Of each column of the derivatives.
    pub(super) columns: Vec<&'r mut [f64]>,
}

impl Linearisation {
    /// As many zeros.
    pub(super) fn zeros(rows: usize, columns: usize) -> Self {
        Self { residual: DVector::zeros(rows), jacobian: DMatrix::zeros(rows, columns) }
    }

    /// The first `count` rows, and the others.
    pub(super) fn split_rows(&mut self, count: usize) -> (Rows<'_>, Rows<'_>) {
        let (first, second) = self.residual.as_mut_slice().split_at_mut(count);
        let rows = self.jacobian.nrows().max(1);
        let columns = self.jacobian.as_mut_slice().chunks_exact_mut(rows);
        let (upper, lower) = columns.map(|column| column.split_at_mut(count)).unzip();
        (Rows { residual: first, columns: upper }, Rows { residual: second, columns: lower })
    }
}

/// The rows of each of these groups of `columns`.
///
/// # Panics
/// If a column is in two of them.
pub(super) fn of_groups<'s>(columns: &'s mut [&mut [f64]], groups: &[&[usize]]) -> Vec<Vec<&'s mut [f64]>> {
    let mut all: Vec<Option<&mut [f64]>> = columns.iter_mut().map(|rows| Some(&mut **rows)).collect();
    let mut of = |column: &usize| all[*column].take().expect("a column of one group");
    groups.iter().map(|group| group.iter().map(&mut of).collect()).collect()
}
