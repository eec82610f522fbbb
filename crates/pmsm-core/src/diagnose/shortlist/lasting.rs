//! What lasts in whitened currents: sums over blocks of samples, in which white noise keeps its mean square and what is left for a reason
//! stands out. Hypotheses are judged by them, see [`crate::experiment::Experiment::mean_squares`].

use crate::basis::orthonormal;
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::experiment::{Channel, Linearisation};
use nalgebra::{DMatrix, DVector};

/// The currents of all recordings in sums over blocks, each divided by the root of its length.
pub(super) struct Lasting {
    /// Samples of a block.
    size: usize,
    /// Samples of all recordings.
    samples: usize,
    /// Places of the currents among the channels.
    currents: Vec<usize>,
    /// Blocks that count, of each channel.
    pub(super) count: usize,
    /// Orthonormal basis of what fitted parameters can do, and what is left.
    pub(super) basis: DMatrix<f64>,
    pub(super) residual: DVector<f64>,
}

impl Lasting {
    /// At the scale at which `hypothesis` leaves most; `None` where that is single samples. `order` are the channels of the rows.
    pub(super) fn new(
        data: &Data,
        hypothesis: &Hypothesis,
        order: &[Channel],
        linear: &Linearisation,
    ) -> Option<Self> {
        data.runs().iter().find(|run| run.whitening.as_ref().is_some_and(|w| w.wanders()))?;
        let experiment = data.whole(hypothesis);
        let size = experiment.scale_of_currents(&experiment.residual(&hypothesis.parameters));
        let samples = data.signals.len();
        let currents = (0..order.len()).filter(|k| order[*k].is_electrical()).collect();
        let (basis, residual) = (DMatrix::zeros(0, 0), DVector::zeros(0));
        let mut out = Self { size, samples, currents, count: data.counted() / size, basis, residual };
        if size == 1 || out.count == 0 {
            return None;
        }
        out.basis = orthonormal(&out.sums(&linear.jacobian));
        let left = DMatrix::from_column_slice(linear.residual.len(), 1, linear.residual.as_slice());
        let left = out.sums(&left).column(0).into_owned();
        out.residual = &left - &out.basis * out.basis.tr_mul(&left);
        Some(out)
    }

    /// The sums over blocks of the currents' rows, column by column.
    pub(super) fn sums(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        let root = (self.size as f64).sqrt();
        let blocks = self.samples / self.size;
        DMatrix::from_fn(blocks * self.currents.len(), rows.ncols(), |row, column| {
            let first = self.currents[row / blocks] * self.samples + (row % blocks) * self.size;
            let block = first..first + self.size;
            rows.column(column).as_slice()[block].iter().sum::<f64>() / root
        })
    }
}
