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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_written_where_they_belong() {
        let mut linear = Linearisation::zeros(5, 4);
        let (upper, mut lower) = linear.split_rows(2);
        assert_eq!((upper.residual.len(), lower.residual.len()), (2, 3));
        lower.residual[2] = 1.0;
        let mut groups = of_groups(&mut lower.columns, &[&[3, 1], &[], &[0]]);
        assert_eq!(groups.iter().map(Vec::len).collect::<Vec<_>>(), [2, 0, 1]);
        (groups[0][0][0], groups[0][1][1], groups[2][0][2]) = (2.0, 3.0, 4.0);
        let written = |row: usize, column: usize| linear.jacobian[(row, column)];
        assert_eq!((linear.residual[4], written(2, 3), written(3, 1), written(4, 0)), (1.0, 2.0, 3.0, 4.0));
        assert_eq!(linear.jacobian.sum(), 9.0);
        // Nothing to derive, or nothing to compare.
        assert!(Linearisation::zeros(5, 0).split_rows(5).0.columns.is_empty());
        assert_eq!(Linearisation::zeros(0, 2).split_rows(0).1.residual.len(), 0);
    }

    #[test]
    #[should_panic(expected = "a column of one group")]
    fn no_column_is_handed_out_twice() {
        let mut linear = Linearisation::zeros(2, 2);
        let _ = of_groups(&mut linear.split_rows(0).1.columns, &[&[0], &[1, 0]]);
    }
}
