//! Orthonormal bases of what a few long columns span.

use crate::numerics::tall;
use nalgebra::{DMatrix, DVector};

/// A column keeps no more than this share of its length when freed of the others: it is one of them.
pub const DEPENDENT: f64 = 1e-5;
/// Share of a column's square within a basis from which a second round is needed to free it of that basis to the last digits.
const MOSTLY: f64 = 0.75;

/// Orthonormal basis of what the columns span; those that the others make superfluous are left out.
pub fn orthonormal(columns: &DMatrix<f64>) -> DMatrix<f64> {
    orthonormal_beside(&DMatrix::zeros(columns.nrows(), 0), columns)
}

/// Orthonormal basis of what the columns span outside of what an orthonormal basis spans already.
pub fn orthonormal_beside(known: &DMatrix<f64>, columns: &DMatrix<f64>) -> DMatrix<f64> {
    let mut basis = Vec::with_capacity(columns.len());
    for column in columns.column_iter() {
        let mut free = column.into_owned();
        let length = free.norm();
        // Twice is enough (Kahan, Parlett).
        tall::remove(&[known.as_slice(), &basis, known.as_slice(), &basis], &mut free);
        let rest = free.norm();
        if rest > DEPENDENT * length {
            free /= rest;
            basis.extend_from_slice(free.as_slice());
        }
    }
    DMatrix::from_vec(columns.nrows(), basis.len() / columns.nrows().max(1), basis)
}

/// `columns` freed of what an orthonormal basis spans.
pub fn freed(basis: &DMatrix<f64>, columns: &DMatrix<f64>) -> DMatrix<f64> {
    let mut free = columns.clone();
    // Twice is enough (Kahan, Parlett), and once where not most of a column lies in the basis.
    for _ in 0..2 {
        let along = tall::tr_mul(basis, &free);
        let lies = |(a, c): (nalgebra::DVectorView<f64>, nalgebra::DVectorView<f64>)| {
            a.norm_squared() > MOSTLY * c.norm_squared()
        };
        let again = along.column_iter().zip(free.column_iter()).any(lies);
        tall::subtract(&mut free, basis, &along);
        if !again {
            break;
        }
    }
    free
}

/// By how much each of `columns`, freed of what an orthonormal basis spans, lowers the square of `residual`, freed likewise; zero where
/// next to nothing of a column is left.
pub fn gains(basis: &DMatrix<f64>, columns: &DMatrix<f64>, residual: &DVector<f64>) -> Vec<f64> {
    let (along, product) = (tall::tr_mul(basis, columns), tall::tr_mul_vector(columns, residual));
    let inside = tall::tr_mul_vector(basis, residual);
    let gain = |c: usize| {
        let (along, length) = (along.column(c), columns.column(c).norm_squared());
        let (square, product) = (length - along.norm_squared(), product[c] - along.dot(&inside));
        if square > DEPENDENT.powi(2) * length { product * product / square } else { 0.0 }
    };
    (0..columns.ncols()).map(gain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn columns(seed: u32, count: usize) -> DMatrix<f64> {
        DMatrix::from_fn(60, count, |i, j| {
            (f64::from(seed) + 1.3 * i as f64 * (j + 1) as f64).sin() + j as f64
        })
    }

    proptest! {
        #[test]
        fn a_gain_is_what_one_more_column_takes_from_the_residual(seed in 0u32..1000, known in 1usize..5) {
            let all = columns(seed, known + 2);
            let (known, tried) = (all.columns(0, known).into_owned(), all.columns(known, 2).into_owned());
            let residual = columns(seed + 7, 1).column(0).into_owned();
            let left = |basis: &DMatrix<f64>| (&residual - basis * basis.tr_mul(&residual)).norm_squared();
            let basis = orthonormal(&known);
            let gains = gains(&basis, &tried, &residual);
            for c in 0..2 {
                let own = orthonormal_beside(&basis, &tried.columns(c, 1).into_owned());
                let both = DMatrix::from_columns(&[&basis.column_iter().collect::<Vec<_>>()[..], &[own.column(0)]].concat());
                // Sums over the rows round once a row. What the basis leaves of a column is smaller than the column; its rounding
                // counts as much more, and twice in its square.
                let column = tried.columns(c, 1).into_owned();
                let smaller = column.norm() / freed(&basis, &column).norm();
                let allowed = 60.0 * f64::EPSILON * (1.0 + smaller).powi(2) * residual.norm_squared();
                prop_assert!((gains[c] - (left(&basis) - left(&both))).abs() <= allowed);
            }
        }
    }

    #[test]
    fn a_column_that_is_known_gains_nothing() {
        let known = columns(3, 3);
        let basis = orthonormal(&known);
        let sum = DMatrix::from_columns(&[known.column(0) - known.column(2) * 0.5]);
        assert_eq!(gains(&basis, &sum, &columns(5, 1).column(0).into_owned()), [0.0]);
        assert_eq!(orthonormal_beside(&basis, &sum).ncols(), 0);
        assert!(freed(&basis, &sum).norm() < 1e-12 * sum.norm());
    }
}
