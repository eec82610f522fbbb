//! The fitness (9) by itself, for optimisers of one's own.

use super::Target;
use super::plan::Plan;
use crate::error::{Error, Result};
use crate::kernels::objective::{Objective, Prepared};
use crate::machine::Machine;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::recording::Recording;
use crate::signals::Signals;
use std::ops::Range;

/// A recording prepared for evaluating the fitness of many parameter sets.
#[derive(Debug, Clone)]
pub struct Fitness {
    signals: Signals,
    windows: Vec<Range<usize>>,
    model: Model,
    plan: Plan,
    prepared: Prepared,
}

impl Fitness {
    /// The fitness as a function of the parameters `fit`; the others stay at the nameplate.
    ///
    /// # Errors
    /// Those of [`super::identify`]; [`Error::Unusable`] if a parameter is not in the equations of this recording, or if an
    /// unknown load is not among those named.
    pub fn new(recording: &Recording, machine: &Machine, fit: &[Target]) -> Result<Self> {
        let mut signals = Signals::new(recording, machine)?;
        let asked: Vec<_> = fit.iter().map(|target| (*target, None)).collect();
        let plan = Plan::new(&mut signals, machine, &asked)?;
        if plan.targets != fit {
            let names = |targets: &[Target]| targets.iter().map(|t| t.name()).collect::<Vec<_>>().join(", ");
            return Err(Error::unusable(
                format!("the fitness of this recording is a function of {}", names(&plan.targets)),
                format!("name these in place of {}", names(fit)),
            ));
        }
        let windows = plan.drive.windows(&signals);
        let model = Model::new(signals.context, &[]);
        let prepared = Objective::new(plan.drive, &model, &signals, &windows).into_prepared();
        Ok(Self { signals, windows, model, plan, prepared })
    }

    /// Parameters per point.
    pub fn dim(&self) -> usize {
        self.plan.targets.len()
    }

    /// Writes to `costs` the fitness of each of the `points` (row-major, [`Fitness::dim`] values each, SI); infinite where the
    /// model cannot be evaluated.
    ///
    /// # Errors
    /// [`Error::Interrupted`] once `monitor` says stop; [`Error::Unusable`] if lengths do not agree.
    pub fn evaluate(&self, points: &[f64], costs: &mut [f64], monitor: &dyn Monitor) -> Result<()> {
        if points.len() != self.dim() * costs.len() {
            return Err(Error::unusable(
                format!("{} values for {} points", points.len(), costs.len()),
                format!("give {} values per point", self.dim()),
            ));
        }
        let objective = Objective::with(
            self.plan.drive,
            &self.model,
            &self.signals,
            &self.windows,
            self.prepared.clone(),
        );
        let whole: Vec<f64> =
            points.chunks_exact(self.dim()).flat_map(|values| self.plan.point(values)).collect();
        let bounds = vec![f64::INFINITY; costs.len()];
        let evaluated = objective.fitnesses(&whole, &bounds, costs, &|| monitor.cancelled());
        if evaluated < costs.len() { Err(Error::Interrupted) } else { Ok(()) }
    }
}
