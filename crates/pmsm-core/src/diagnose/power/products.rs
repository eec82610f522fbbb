//! Products of long columns, channel by channel. They give the squares of linear combinations without computing these row by row.

use crate::diagnose::score::Sensitivity;
use crate::experiment::Block;
use crate::numerics::tall;
use nalgebra::{DMatrix, DVector};
use std::iter::once;
use std::ops::Range;

/// A sum of columns: the share of each, the known ones first.
pub(super) type Sum = DVector<f64>;

/// Columns with which those of each effect are compared.
pub(super) struct Known {
    columns: DMatrix<f64>,
    /// How many of them come first that are an orthonormal basis of what the fitted parameters can do.
    basis: usize,
    blocks: Vec<Block>,
    /// Their products, block by block.
    gram: Vec<DMatrix<f64>>,
}

/// The known columns and a few others.
pub(super) struct Products<'a> {
    known: &'a Known,
    /// Products of all of them, block by block, and over all blocks.
    gram: Vec<DMatrix<f64>>,
    whole: DMatrix<f64>,
}

impl Known {
    /// An orthonormal `basis` of what the fitted parameters can do, and other columns of the same rows.
    pub(super) fn new(basis: DMatrix<f64>, others: &[DMatrix<f64>], blocks: Vec<Block>) -> Self {
        let count = basis.ncols();
        let more: usize = others.iter().map(DMatrix::ncols).sum();
        let mut columns = basis.resize_horizontally(count + more, 0.0);
        let mut at = count;
        for other in others {
            columns.columns_mut(at, other.ncols()).copy_from(other);
            at += other.ncols();
        }
        let gram = blocks.iter().map(|block| {
            let mut gram = DMatrix::zeros(columns.ncols(), columns.ncols());
            tall::add_gram(&columns, once(block.rows.clone()), &mut gram);
            gram
        });
        Self { gram: gram.collect(), columns, basis: count, blocks }
    }

    /// The channels of each recording.
    pub(super) fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// These columns beside `count` of the others' for each of so many `shapes` in turn; `None` where they are not finite.
    pub(super) fn beside(
        &self,
        others: &Sensitivity,
        shapes: usize,
        count: usize,
    ) -> Vec<Option<Products<'_>>> {
        let (known, own) = (self.columns.ncols(), others.columns.ncols());
        // Products with all columns of the others, and of these among each other.
        let parts: Vec<(DMatrix<f64>, DMatrix<f64>)> = self
            .blocks
            .iter()
            .map(|block| {
                let mut gram = DMatrix::zeros(own, own);
                let Some(first) = others.first_row(block) else {
                    return (DMatrix::zeros(known, own), gram);
                };
                let rows = block.rows.len();
                tall::add_gram(&others.columns, once(first..first + rows), &mut gram);
                let mixed =
                    tall::tr_mul_rows((&self.columns, block.rows.start), (&others.columns, first), rows);
                (mixed, gram)
            })
            .collect();
        let beside = |at: usize| {
            let all = known + count;
            let joined = |(gram, (mixed, own)): (&DMatrix<f64>, &(DMatrix<f64>, DMatrix<f64>))| {
                let mut joined = gram.clone().resize(all, all, 0.0);
                joined.view_mut((0, known), (known, count)).copy_from(&mixed.columns(at, count));
                joined
                    .view_mut((known, known), (count, count))
                    .copy_from(&own.view((at, at), (count, count)));
                joined.fill_lower_triangle_with_upper_triangle();
                joined
            };
            let gram: Vec<DMatrix<f64>> = self.gram.iter().zip(&parts).map(joined).collect();
            let whole = gram.iter().fold(DMatrix::zeros(all, all), |sum, gram| sum + gram);
            whole.iter().all(|x| x.is_finite()).then_some(Products { known: self, gram, whole })
        };
        (0..shapes).map(|shape| beside(shape * count)).collect()
    }
}

impl Products<'_> {
    /// The sum of the other columns with these shares.
    pub(super) fn others(&self, shares: &DVector<f64>) -> Sum {
        let mut sum = DVector::zeros(self.whole.nrows());
        sum.rows_mut(self.known.columns.ncols(), shares.len()).copy_from(shares);
        sum
    }

    /// The known column of this number.
    pub(super) fn known(&self, number: usize) -> Sum {
        let mut sum = DVector::zeros(self.whole.nrows());
        sum[number] = 1.0;
        sum
    }

    /// What lies of a sum in the basis of the fitted parameters, along each of its columns.
    pub(super) fn along_basis(&self, sum: &Sum) -> DVector<f64> {
        self.along(sum, &(0..self.known.basis))
    }

    /// The sum freed of what the fitted parameters can do.
    pub(super) fn freed(&self, sum: &Sum) -> Sum {
        let mut free = sum.clone();
        let mut basis = free.rows_mut(0, self.known.basis);
        basis -= self.along_basis(sum);
        free
    }

    /// A sum freed so, and what lies of it in those known columns, which are orthonormal, all the same.
    pub(super) fn freed_but(&self, sum: &Sum, kept: &Range<usize>) -> Sum {
        let mut free = self.freed(sum);
        let mut own = free.rows_mut(kept.start, kept.len());
        own += self.along(sum, kept);
        free
    }

    fn along(&self, sum: &Sum, columns: &Range<usize>) -> DVector<f64> {
        self.whole.rows(columns.start, columns.len()) * sum
    }

    /// The product of two sums.
    pub(super) fn dot(&self, a: &Sum, b: &Sum) -> f64 {
        a.dot(&(&self.whole * b))
    }

    /// Mean square of a sum per channel of each recording, over the samples that count.
    pub(super) fn squares(&self, sum: &Sum) -> Vec<f64> {
        let square = |(gram, block): (&DMatrix<f64>, &Block)| {
            sum.dot(&(gram * sum)).max(0.0) / block.counted.max(1) as f64
        };
        self.gram.iter().zip(&self.known.blocks).map(square).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::Channel;
    use crate::numerics::basis::orthonormal;

    const SAMPLES: usize = 40;

    fn matrix(rows: usize, columns: usize, seed: f64) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |r, c| (seed + (0.3 + 0.1 * c as f64 + 0.07 * seed) * r as f64).sin())
    }

    /// Two recordings with two channels, of which some others reach the second one alone.
    fn setup() -> (DMatrix<f64>, DMatrix<f64>, Known, DMatrix<f64>) {
        let basis = orthonormal(&matrix(2 * SAMPLES, 3, 0.0));
        let alone = orthonormal(&matrix(2 * SAMPLES, 2, 1.0));
        let block = |(run, channel, rows): (usize, Channel, Range<usize>)| {
            let counted = rows.len() - run;
            Block { run, channel, rows, counted }
        };
        let own = [
            (Channel::IQ, 0..15),
            (Channel::IQ, 15..40),
            (Channel::OmegaE, 40..55),
            (Channel::OmegaE, 55..80),
        ];
        let blocks =
            own.into_iter().enumerate().map(|(k, (channel, rows))| block((k % 2, channel, rows))).collect();
        let known = Known::new(basis.clone(), std::slice::from_ref(&alone), blocks);
        (basis, alone, known, matrix(SAMPLES, 4, 2.0))
    }

    #[test]
    fn squares_are_those_of_the_columns_themselves() {
        let (basis, alone, known, columns) = setup();
        let seen = Sensitivity { columns: columns.clone(), samples: SAMPLES, order: &[Channel::OmegaE] };
        let shares = DVector::from_vec(vec![0.7, -1.3]);
        for (shape, products) in known.beside(&seen, 2, 2).into_iter().enumerate() {
            let products = products.unwrap();
            let mut whole = DVector::zeros(2 * SAMPLES);
            whole.rows_mut(SAMPLES, SAMPLES).copy_from(&(columns.columns(2 * shape, 2) * &shares));
            let free = &whole - &basis * basis.tr_mul(&whole);
            let but = &free + &alone * alone.tr_mul(&whole);
            let sum = products.others(&shares);
            assert!((products.along_basis(&sum) - basis.tr_mul(&whole)).amax() < 1e-12);
            let same = |sum: &Sum, column: &DVector<f64>| {
                let square = |block: &Block| {
                    column.rows(block.rows.start, block.rows.len()).norm_squared() / block.counted as f64
                };
                for (seen, block) in products.squares(sum).into_iter().zip(known.blocks()) {
                    assert!((seen - square(block)).abs() < 1e-12, "{block:?}");
                }
                assert!((products.dot(sum, &products.known(3)) - column.dot(&alone.column(0))).abs() < 1e-12);
            };
            same(&sum, &whole);
            same(&products.freed(&sum), &free);
            same(&products.freed_but(&sum, &(3..5)), &but);
        }
    }

    #[test]
    fn a_shape_that_is_not_finite_spoils_no_other() {
        let (.., known, mut columns) = setup();
        columns[(7, 2)] = f64::NAN;
        let seen = Sensitivity { columns, samples: SAMPLES, order: &[Channel::OmegaE] };
        let shapes: Vec<bool> = known.beside(&seen, 4, 1).iter().map(Option::is_some).collect();
        assert_eq!(shapes, [true, true, false, true]);
    }
}
