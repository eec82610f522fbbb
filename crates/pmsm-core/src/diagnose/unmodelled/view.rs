//! Normal equations of one side of a recording, fold by fold: fitted parameters, residual and the columns of a map.

use super::Side;
use super::linear::Linear;
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::map::Part;
use crate::numerics::basis::orthonormal;
use crate::numerics::tall;
use crate::optimise::least_squares::Normal;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// One side of a recording: a basis of the fitted parameters, and the residual.
pub(super) struct View<'a> {
    linear: Linear<'a>,
    /// Orthonormal basis of the derivatives by the fitted parameters, and behind it the residual.
    pub(super) known: DMatrix<f64>,
    /// The rows of each fold, and the products of what is known over them.
    folds: Vec<Vec<Range<usize>>>,
    of_folds: Vec<DMatrix<f64>>,
}

impl<'a> View<'a> {
    /// With the blocks of the recording that each fold holds.
    pub(super) fn new(
        data: &'a Data,
        best: &'a Hypothesis,
        side: Side,
        torque: &'a [f64],
        blocks: &[Vec<Range<usize>>],
    ) -> Self {
        let linear = Linear::new(data, best, side, torque);
        let (residual, jacobian) = linear.at(&side.parameters(data, best));
        let basis = orthonormal(&jacobian);
        let parameters = basis.ncols();
        let mut known = basis.insert_column(parameters, 0.0);
        known.set_column(parameters, &residual);
        let n = data.signals.len();
        let rows = |channel: usize, block: &Range<usize>| channel * n + block.start..channel * n + block.end;
        let all = |fold: &Vec<Range<usize>>| -> Vec<Range<usize>> {
            (0..known.nrows() / n).flat_map(|c| fold.iter().map(move |block| rows(c, block))).collect()
        };
        let folds: Vec<Vec<Range<usize>>> = blocks.iter().map(all).collect();
        let products = |fold: &Vec<Range<usize>>| {
            let mut sums = DMatrix::zeros(known.ncols(), known.ncols());
            tall::add_gram(&known, fold.iter().cloned(), &mut sums);
            sums
        };
        let of_folds = folds.iter().map(products).collect();
        Self { linear, known, folds, of_folds }
    }

    /// Derivatives of the residual with respect to the coefficients of a part, at zero.
    pub(super) fn columns(&self, part: &Part) -> DMatrix<f64> {
        self.linear.columns(part)
    }

    /// Normal equations of each fold: what the fitted parameters can do first, then the columns.
    pub(super) fn normals(&self, columns: &DMatrix<f64>) -> Vec<Normal> {
        let (b, k) = (self.parameters(), columns.ncols());
        let fold = |(ranges, known): (&Vec<Range<usize>>, &DMatrix<f64>)| {
            let (mut along, mut own) = (DMatrix::zeros(b + 1, k), DMatrix::zeros(k, k));
            for range in ranges {
                let first = range.start;
                along += tall::tr_mul_rows((&self.known, first), (columns, first), range.len());
            }
            tall::add_gram(columns, ranges.iter().cloned(), &mut own);
            let mut jtj = DMatrix::zeros(b + k, b + k);
            jtj.view_mut((0, 0), (b, b)).copy_from(&known.view((0, 0), (b, b)));
            jtj.view_mut((0, b), (b, k)).copy_from(&along.rows(0, b));
            jtj.view_mut((b, 0), (k, b)).copy_from(&along.rows(0, b).transpose());
            jtj.view_mut((b, b), (k, k)).copy_from(&own);
            let jtr = DVector::from_fn(b + k, |n, _| if n < b { known[(n, b)] } else { along[(b, n - b)] });
            Normal { cost: known[(b, b)], jtj, jtr }
        };
        self.folds.iter().zip(&self.of_folds).map(fold).collect()
    }

    /// Number of what the fitted parameters can do.
    pub(super) fn parameters(&self) -> usize {
        self.known.ncols() - 1
    }
}
