//! Projection of the derivatives of effects, orthogonal to those of the fitted parameters.

use super::aggregation::Aggregated;
use crate::diagnose::data::Data;
use crate::diagnose::fitting::rescaled;
use crate::diagnose::hypothesis::Hypothesis;
use crate::experiment::{Channel, Channels, Course};
use crate::numerics::basis::orthonormal;
use nalgebra::{DMatrix, DVector};

/// Orthonormal basis of what fitted parameters can do, and the residual they leave.
pub(super) struct Projector {
    /// Channels with what is left in them.
    pub(super) channels: Channels,
    /// The channels in the order of the rows.
    pub(super) order: Vec<Channel>,
    /// Motion of the rotor on each recording. An effect at zero strength does not change it.
    pub(super) courses: Vec<Option<Course>>,
    /// Initial speeds of the windows, rad/s.
    pub(super) starts: Option<Vec<f64>>,
    pub(super) basis: DMatrix<f64>,
    pub(super) residual: DVector<f64>,
    /// The residual as it is.
    pub(super) left: DVector<f64>,
    /// The aggregated residual, where the currents are compared by that.
    pub(super) aggregated: Option<Aggregated>,
}

impl Projector {
    /// With the derivatives with respect to what was fitted.
    pub(super) fn new(data: &Data, hypothesis: &Hypothesis) -> (Self, DMatrix<f64>) {
        let channels = rescaled(data.channels(true, true), left(data, hypothesis));
        let experiment = data.experiment(&hypothesis.model, &hypothesis.nuisances, channels.clone());
        let experiment = experiment.with_plain_speed();
        let order = experiment.channels().to_vec();
        let starts = experiment.estimated_starts(&hypothesis.parameters);
        let experiment = experiment.with_starts(starts.as_deref());
        let linear = experiment.linearise(&hypothesis.parameters, &hypothesis.free);
        let basis = orthonormal(&linear.jacobian);
        let residual = &linear.residual - &basis * basis.tr_mul(&linear.residual);
        let courses = experiment.courses(&hypothesis.parameters);
        let aggregated = Aggregated::new(data, hypothesis, &order, &linear);
        let left = linear.residual;
        (Self { channels, order, courses, starts, basis, residual, left, aggregated }, linear.jacobian)
    }

    /// What of it, with the derivatives `jacobian` with respect to what was fitted, belongs to the speed and to what was fitted to the speed
    /// alone; nothing where no speed is compared.
    pub(super) fn of_rotor(
        &self,
        data: &Data,
        hypothesis: &Hypothesis,
        jacobian: &DMatrix<f64>,
    ) -> Option<Self> {
        let place = self.order.iter().position(|c| !c.is_electrical())?;
        let samples = data.signals.len();
        let experiment = data.experiment(&hypothesis.model, &hypothesis.nuisances, self.channels.clone());
        let own = (0..hypothesis.free.len()).filter(|k| !experiment.is_electrical(hypothesis.free[*k]));
        let columns: Vec<usize> = own.collect();
        let jacobian = jacobian.rows(place * samples, samples).select_columns(&columns);
        let basis = orthonormal(&jacobian);
        let left = self.left.rows(place * samples, samples).into_owned();
        let residual = &left - &basis * basis.tr_mul(&left);
        let mut channels = self.channels.clone();
        channels.iter_mut().for_each(|run| run.retain(|(c, _)| !c.is_electrical()));
        let (order, courses, starts) = (vec![self.order[place]], self.courses.clone(), self.starts.clone());
        Some(Self { channels, order, courses, starts, basis, residual, left, aggregated: None })
    }
}

/// What a hypothesis leaves in each channel of each recording, over the floor: of a speed as it is.
fn left(data: &Data, hypothesis: &Hypothesis) -> Vec<f64> {
    let mut left: Vec<f64> = hypothesis.squares.iter().map(|(_, s)| s.max(1.0).sqrt()).collect();
    if data.runs().iter().any(|run| run.wander().is_some()) {
        let experiment = data.whole(hypothesis).with_plain_speed();
        let rms = experiment.relative_rms(&experiment.residual(&hypothesis.parameters));
        for ((left, (channel, _)), rms) in left.iter_mut().zip(&hypothesis.squares).zip(rms) {
            if !channel.is_electrical() {
                *left = rms.max(1.0);
            }
        }
    }
    left
}
