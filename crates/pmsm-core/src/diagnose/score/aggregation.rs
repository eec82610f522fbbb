//! Temporal aggregation of whitened currents: sums over blocks of samples. White noise keeps its mean square in them, and a systematic
//! residual grows. Hypotheses are compared by them, see [`crate::experiment::Experiment::mean_squares`].

use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::experiment::{Channel, Linearisation};
use crate::numerics::basis::orthonormal;
use nalgebra::{DMatrix, DVector};

/// The currents of all recordings in sums over blocks.
pub(super) struct Aggregated {
    blocks: Blocks,
    /// Blocks that count, of each channel.
    pub(super) count: usize,
    /// Orthonormal basis of what fitted parameters can do, and what is left.
    pub(super) basis: DMatrix<f64>,
    pub(super) residual: DVector<f64>,
}

/// Which rows are added up.
struct Blocks {
    /// Samples of a block.
    size: usize,
    /// Samples of all recordings.
    samples: usize,
    /// Places of the currents among the channels.
    currents: Vec<usize>,
}

impl Aggregated {
    /// At the scale at which `hypothesis` leaves most; `None` where that is single samples. `order` are the channels of the rows.
    pub(super) fn new(
        data: &Data,
        hypothesis: &Hypothesis,
        order: &[Channel],
        linear: &Linearisation,
    ) -> Option<Self> {
        if !data.runs().iter().any(|run| run.whitening.as_ref().is_some_and(|w| w.wanders())) {
            return None;
        }
        let experiment = data.whole(hypothesis);
        let size = experiment.scale_of_currents(&experiment.residual(&hypothesis.parameters));
        let count = data.counted() / size;
        if size == 1 || count == 0 {
            return None;
        }
        let currents = (0..order.len()).filter(|k| order[*k].is_electrical()).collect();
        let blocks = Blocks { size, samples: data.signals.len(), currents };
        let basis = orthonormal(&blocks.sums(&linear.jacobian));
        let left = DMatrix::from_column_slice(linear.residual.len(), 1, linear.residual.as_slice());
        let left = blocks.sums(&left).column(0).into_owned();
        let residual = &left - &basis * basis.tr_mul(&left);
        Some(Self { blocks, count, basis, residual })
    }

    /// The sums over blocks of the currents' rows, column by column.
    pub(super) fn sums(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        self.blocks.sums(rows)
    }
}

impl Blocks {
    /// The sums of each column, divided by the root of the number of samples.
    fn sums(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        let root = (self.size as f64).sqrt();
        let blocks = self.samples / self.size;
        DMatrix::from_fn(blocks * self.currents.len(), rows.ncols(), |row, column| {
            let first = self.currents[row / blocks] * self.samples + (row % blocks) * self.size;
            let block = first..first + self.size;
            rows.column(column).as_slice()[block].iter().sum::<f64>() / root
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::normal_pair;

    #[test]
    fn noise_keeps_its_mean_square_and_what_lasts_grows() {
        // The speed lies between the currents; the last samples fill no block.
        let (size, samples) = (16, 16 * 500 + 7);
        let blocks = Blocks { size, samples, currents: vec![0, 2] };
        let rows = DMatrix::from_fn(3 * samples, 2, |row, column| match (row / samples, column) {
            (1, _) => f64::NAN,
            (_, 0) => 0.5,
            _ => normal_pair(7, [row as u32, 0, 0, 0]).0,
        });
        let sums = blocks.sums(&rows);
        assert_eq!(sums.shape(), (2 * 500, 2));
        assert!(sums.column(0).iter().all(|x| (x - 2.0).abs() < 1e-12));
        let square = sums.column(1).norm_squared() / sums.nrows() as f64;
        assert!((square - 1.0).abs() < 0.15, "{square}");
    }
}
