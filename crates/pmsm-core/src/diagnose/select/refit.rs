//! A set refitted with one effect more, starting from the values of its score.

use super::Search;
use crate::diagnose::data::Data;
use crate::diagnose::fitting;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::score::Prospect;
use crate::diagnose::verdict::Validated;
use crate::effect::{Parameter, Role, Site};
use crate::error::Result;
use crate::model::Model;
use crate::monitor::Monitor;

/// Share of its score that a fit must explain; else it is repeated, first with fixed shapes and then from a fraction of the strength.
const KEPT_PROMISE: f64 = 0.1;
/// That fraction of the strength.
const FAINTER: f64 = 0.1;
/// Score below which no fit is repeated.
const LEAST_PROMISE: f64 = 0.02;

impl Search<'_> {
    /// The set of `parent` with one effect more; nothing where the effect vanishes.
    pub(super) fn refit(&self, parent: &Validated, prospect: &Prospect) -> Result<Option<Hypothesis>> {
        let fitted = beside(self.data, &parent.fitted, prospect, self.monitor)?;
        Ok((!fitted.vanishes(prospect.effect)).then_some(fitted))
    }

    /// The set of `parent` with several effects more, fitted together from where the prospects begin.
    pub(super) fn with_all(&self, parent: &Validated, prospects: &[Prospect]) -> Result<Hypothesis> {
        let mut effects = parent.fitted.effects();
        let mut start = parent.fitted.own().to_vec();
        for prospect in prospects {
            effects.push(prospect.effect);
            start.extend(&prospect.start);
        }
        let model = Model::new(*parent.fitted.model.context(), &effects);
        let moves = prospects.iter().any(|p| p.effect.mechanical_state_count() > 0);
        let under = moves.then_some(&parent.fitted);
        fitting::fit_under(under, &[], self.data, &model, (&start, false), self.monitor)
    }
}

/// `parent` with one effect more, fitted to `data`.
///
/// A score lets the parameters of the parent adjust, but a fit starts from their present values. To first order a strength may also come
/// out far too large. Both can lead a shape to a wrong minimum.
fn beside(
    data: &Data,
    parent: &Hypothesis,
    prospect: &Prospect,
    monitor: &dyn Monitor,
) -> Result<Hypothesis> {
    let mut effects = parent.effects();
    effects.push(prospect.effect);
    let model = Model::new(*parent.model.context(), &effects);
    let parameters = prospect.effect.info().parameters;
    let first = model.parameter_count() - parameters.len();
    let mechanical = prospect.effect.info().site == Site::Mechanical;
    let fit = |own: &[f64], held: &[usize], under: Option<&Hypothesis>| {
        let start = [parent.own(), own].concat();
        fitting::fit_under(under, held, data, &model, (&start, mechanical), monitor)
    };
    // What moves beside the rotor is no step of a load, which need not be found anew for it.
    let under = (prospect.effect.mechanical_state_count() > 0).then_some(parent);
    let mut best = fit(&prospect.start, &[], under)?;
    let shapes: Vec<usize> =
        (0..parameters.len()).filter(|k| parameters[*k].role == Role::Shape).map(|k| first + k).collect();
    let short = |fitted: &Hypothesis| {
        let promised = prospect.score > LEAST_PROMISE && !shapes.is_empty();
        promised && explained(parent, fitted) < KEPT_PROMISE * prospect.score
    };
    let better =
        |a: Hypothesis, b: Hypothesis| if explained(parent, &b) > explained(parent, &a) { b } else { a };
    if short(&best) {
        best = better(best, fit(&prospect.start, &shapes, Some(parent))?);
    }
    if short(&best) {
        let strength = |p: &Parameter| if p.role == Role::Amplitude { FAINTER } else { 1.0 };
        let fainter: Vec<f64> = prospect.start.iter().zip(parameters).map(|(x, p)| x * strength(p)).collect();
        best = better(best, fit(&fainter, &[], Some(parent))?);
    }
    Ok(best)
}

/// Mean square that `larger` takes away, in units of what `smaller` has left in each channel: what a score promises.
fn explained(smaller: &Hypothesis, larger: &Hypothesis) -> f64 {
    let both = smaller.squares.iter().zip(&larger.squares);
    both.map(|((_, before), (_, after))| (before - after) / before.max(1.0)).sum()
}
