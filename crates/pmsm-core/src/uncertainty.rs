//! Uncertainty of fitted parameters from the information matrix, corrected for coloured residuals.

use crate::least_squares;
use nalgebra::{DMatrix, DVector};

/// Blocks over which scores are summed.
const BLOCKS: usize = 40;

/// Covariance of least-squares parameters from stacked weighted residuals (channel by channel, `rows_per_channel` samples
/// each) and their Jacobian: the sandwich H⁻¹ M H⁻¹ with the scores summed over blocks of samples, all channels together.
pub fn covariance(jacobian: &DMatrix<f64>, residual: &DVector<f64>, rows_per_channel: usize) -> DMatrix<f64> {
    let k = jacobian.ncols();
    let size = rows_per_channel.div_ceil(BLOCKS).max(1);
    let blocks = rows_per_channel.div_ceil(size);
    let mut scores: DMatrix<f64> = DMatrix::zeros(k, blocks);
    for row in 0..jacobian.nrows() {
        let block = (row % rows_per_channel) / size;
        for c in 0..k {
            scores[(c, block)] += jacobian[(row, c)] * residual[row];
        }
    }
    let correction = blocks as f64 / (blocks as f64 - 1.0).max(1.0);
    let meat = &scores * scores.transpose() * correction;
    least_squares::covariance(&jacobian.tr_mul(jacobian), Some(&meat), &vec![true; k])
}
