//! A recording as one side sees it: what the fitted parameters can do to it and what they leave, and beside that the columns of a map.

use super::Side;
use super::integral::Integral;
use crate::basis::orthonormal;
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::experiment::{Answering, Joint};
use crate::least_squares::Normal;
use crate::map::Part;
use crate::tall;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// The recording as one side sees it: what the fitted parameters can do, and what they leave.
pub(super) struct View<'a> {
    data: &'a Data,
    best: &'a Hypothesis,
    side: Side,
    torque: &'a [f64],
    starts: Option<Vec<f64>>,
    /// Basis of what the fitted parameters can do, and behind it what they leave.
    pub(super) known: DMatrix<f64>,
    /// The rows of each fold, and the products of what is known over them.
    folds: Vec<Vec<Range<usize>>>,
    of_folds: Vec<DMatrix<f64>>,
    /// How the currents answer to a voltage that is lost, where that is asked and can be told.
    answering: Option<Vec<Answering>>,
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
        let (known, folds, of_folds) = (DMatrix::zeros(0, 0), Vec::new(), Vec::new());
        let mut view =
            Self { data, best, side, torque, starts: None, known, folds, of_folds, answering: None };
        let experiment = view.experiment(&best.model);
        let electrical = |k: usize| experiment.is_electrical(k);
        let free: Vec<usize> =
            best.free.iter().copied().filter(|k| electrical(*k) == (side == Side::Electrical)).collect();
        let starts = experiment.estimated_starts(&best.parameters);
        let electrical = side == Side::Electrical;
        let answering = electrical.then(|| experiment.answering(&best.parameters)).flatten();
        let (residual, jacobian) = match view.integral() {
            Some(integral) => (integral.residual(), integral.jacobian(&free)),
            None => {
                let seen = experiment.with_starts(starts.as_deref());
                let linear = seen.linearise(&best.parameters, &free);
                (linear.residual, linear.jacobian)
            }
        };
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
        view.of_folds = folds.iter().map(products).collect();
        (view.starts, view.known, view.folds, view.answering) = (starts, known, folds, answering);
        view
    }

    /// The equation of motion in integral form, where this side has it.
    fn integral(&self) -> Option<Integral<'a>> {
        (self.side == Side::Mechanical).then(|| Integral::new(self.data, self.best, self.torque)).flatten()
    }

    fn experiment<'b>(&'b self, model: &'b crate::model::Model) -> Joint<'b> {
        let electrical = self.side == Side::Electrical;
        let channels = self.data.channels(electrical, !electrical);
        let experiment = self.data.experiment(model, &self.best.nuisances, channels).with_plain_speed();
        let experiment = experiment.with_starts(self.starts.as_deref());
        if electrical { experiment } else { experiment.with_torque(self.torque) }
    }

    /// Derivatives of the residual with respect to the coefficients of a part, at zero.
    pub(super) fn columns(&self, part: &Part) -> DMatrix<f64> {
        if let Some(answering) = &self.answering {
            let experiment = self.experiment(&self.best.model);
            return experiment.lost_columns(&self.best.parameters, answering, part);
        }
        if let Some(integral) = self.integral() {
            return integral.columns(part);
        }
        let own = self.best.own();
        let mut map = self.best.model.map().cloned().unwrap_or_default();
        map.parts.push(part.clone());
        let model = self.best.model.clone().with_map(map);
        let mut parameters = own.to_vec();
        parameters.resize(own.len() + part.count(), 0.0);
        parameters.extend(&self.best.parameters[own.len()..]);
        let free: Vec<usize> = (own.len()..own.len() + part.count()).collect();
        self.experiment(&model).linearise(&parameters, &free).jacobian
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
