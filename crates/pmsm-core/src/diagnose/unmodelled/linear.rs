//! The equations of one side linearised at a fitted model: the residual, and its derivatives by parameters and coefficients of a map.

use super::Side;
use super::integral::Integral;
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::effect::Site;
use crate::experiment::{Answering, Joint, LAGS, TURNED};
use crate::map::Part;
use crate::model::Model;
use nalgebra::{DMatrix, DVector};

/// The equations of one side: of the motion in integral form where the rotor has no states of its own, else in free run.
pub(super) enum Linear<'a> {
    Integral(Integral<'a>),
    FreeRun(FreeRun<'a>),
}

/// A free run from the fitted initial values.
pub(super) struct FreeRun<'a> {
    data: &'a Data,
    best: &'a Hypothesis,
    side: Side,
    torque: &'a [f64],
    starts: Option<Vec<f64>>,
    /// How the currents answer to a voltage that is lost, where that is asked and can be told.
    answering: Option<Vec<Answering>>,
}

impl<'a> Linear<'a> {
    pub(super) fn new(data: &'a Data, best: &'a Hypothesis, side: Side, torque: &'a [f64]) -> Self {
        if side == Side::Mechanical
            && let Some(integral) = Integral::new(data, best, torque)
        {
            return Self::Integral(integral);
        }
        let mut run = FreeRun { data, best, side, torque, starts: None, answering: None };
        let experiment = run.experiment(&best.model);
        let starts = experiment.estimated_starts(&best.parameters);
        let electrical = side == Side::Electrical;
        let answering = electrical.then(|| experiment.answering(&best.parameters)).flatten();
        (run.starts, run.answering) = (starts, answering);
        Self::FreeRun(run)
    }

    /// What the model leaves, in units of the noise, and its derivatives by the parameters `free`.
    pub(super) fn at(&self, free: &[usize]) -> (DVector<f64>, DMatrix<f64>) {
        match self {
            Self::Integral(integral) => (integral.residual(), integral.jacobian(free)),
            Self::FreeRun(run) => {
                let linear = run.experiment(&run.best.model).linearise(&run.best.parameters, free);
                (linear.residual, linear.jacobian)
            }
        }
    }

    /// Derivatives of what is left by the coefficients of a part, at zero.
    pub(super) fn columns(&self, part: &Part) -> DMatrix<f64> {
        match self {
            Self::Integral(integral) => integral.columns(part),
            Self::FreeRun(run) => run.columns(part),
        }
    }

    /// Derivatives of what is left by how the sensors err: [`LAGS`] columns of currents that lag, then [`TURNED`] of an angle that is late or
    /// flawed. None where the currents are not compared over time.
    pub(super) fn sensor_columns(&self) -> Option<DMatrix<f64>> {
        let Self::FreeRun(run) = self else { return None };
        let answering = run.answering.as_ref()?;
        let experiment = run.experiment(&run.best.model);
        let lag = experiment.lag_columns(&run.best.parameters, answering);
        let mut columns = lag.resize_horizontally(LAGS + TURNED, 0.0);
        columns
            .columns_mut(LAGS, TURNED)
            .copy_from(&experiment.turned_columns(&run.best.parameters, answering));
        Some(columns)
    }
}

impl FreeRun<'_> {
    fn experiment<'b>(&'b self, model: &'b Model) -> Joint<'b> {
        let electrical = self.side == Side::Electrical;
        let channels = self.data.channels(electrical, !electrical);
        let experiment = self.data.experiment(model, &self.best.nuisances, channels).with_plain_speed();
        let experiment = experiment.with_starts(self.starts.as_deref());
        if electrical { experiment } else { experiment.with_torque(self.torque) }
    }

    fn columns(&self, part: &Part) -> DMatrix<f64> {
        // An error of the angle turns voltages and currents: that is no voltage that is lost.
        if let Some(answering) = self.answering.as_ref().filter(|_| part.site() == Site::Electrical) {
            let experiment = self.experiment(&self.best.model);
            return experiment.lost_columns(&self.best.parameters, answering, part);
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
}
