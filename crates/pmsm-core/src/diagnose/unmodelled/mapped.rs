//! A model with a map, whose parts are added one after the other while each improves the prediction.

use super::Side;
use super::choice::Choice;
use crate::diagnose::data::Data;
use crate::diagnose::evidence::Evidence;
use crate::diagnose::fitting;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::transfer::transfer;
use crate::diagnose::verdict::{Validated, excess};
use crate::effect::Site;
use crate::error::Result;
use crate::experiment::Prior;
use crate::map::{Map, Part};
use crate::model::Model;
use crate::monitor::Monitor;
use std::borrow::Cow;

/// A model with a map, and how far from zero the map's coefficients are believed to be beforehand.
#[derive(Clone)]
pub(super) struct Mapped {
    pub(super) fitted: Hypothesis,
    spreads: Vec<f64>,
}

/// What a map is fitted to and validated on.
pub(super) struct Recordings<'a> {
    pub(super) data: &'a Data,
    pub(super) validation: Option<&'a Data>,
    pub(super) monitor: &'a dyn Monitor,
}

impl Mapped {
    /// A set without a map.
    pub(super) fn new(set: &Hypothesis) -> Self {
        Self { fitted: set.clone(), spreads: Vec::new() }
    }

    /// The recording with what is believed of the coefficients that the map of a `model` has.
    pub(super) fn recording<'a>(&self, data: &'a Data, model: &Model) -> Cow<'a, Data> {
        if self.spreads.is_empty() {
            return Cow::Borrowed(data);
        }
        let of_each = model.map_parameters().zip(&self.spreads);
        let more: Vec<Prior> = of_each.map(|(k, spread)| Prior::normal(k, 0.0, *spread)).collect();
        Cow::Owned(data.clone().with_prior(&more))
    }

    /// The same with that one of the parts in question which has most evidence, if one predicts better what it was not fitted to.
    ///
    /// # Errors
    /// Those of the least-squares fits.
    pub(super) fn with(
        &self,
        choices: &[Choice],
        side: Side,
        recordings: &Recordings,
    ) -> Result<Option<Self>> {
        let Recordings { data, validation, monitor } = *recordings;
        let mut best: Option<(Self, f64)> = None;
        for choice in choices {
            let mut map: Map = self.fitted.model.map().cloned().unwrap_or_default();
            map.parts.push(choice.part.clone());
            let model = self.fitted.model.clone().with_map(map);
            let mut spreads = self.spreads.clone();
            spreads.resize(spreads.len() + choice.part.count(), self.spread(&model, choice, side, data));
            let mut richer = Self { fitted: self.fitted.clone(), spreads };
            let believed = richer.recording(data, &model).roughly();
            let trial = Trial { data: &believed, validation, monitor };
            let improved = trial.improves(&self.fitted, (&model, &choice.start), side)?;
            let Some((fitted, cost)) = improved else { continue };
            richer.fitted = fitted;
            if best.as_ref().is_none_or(|(_, least)| cost < *least) {
                best = Some((richer, cost));
            }
        }
        Ok(best.map(|(richer, _)| richer))
    }

    /// Standard deviation of the prior of a part's coefficients, the last ones of the `model`, by what the recording says of them in a fit: noise
    /// that drives the speed leaves less than the choice saw.
    fn spread(&self, model: &Model, choice: &Choice, side: Side, data: &Data) -> f64 {
        let (own, behind) = self.fitted.parameters.split_at(self.fitted.own().len());
        let parameters = [own, &vec![0.0; choice.part.count()], behind].concat();
        let free: Vec<usize> = (own.len()..own.len() + choice.part.count()).collect();
        let electrical = side == Side::Electrical;
        let channels = data.channels(electrical, !electrical);
        let experiment = data.experiment(model, &self.fitted.nuisances, channels);
        let squares = experiment.linearise(&parameters, &free).jacobian.norm_squared();
        1.0 / (choice.ridge * squares / free.len() as f64).max(f64::MIN_POSITIVE).sqrt()
    }

    /// Where its last part acts.
    pub(super) fn last_site(&self) -> Option<Site> {
        self.fitted.model.map().and_then(|map| map.parts.last()).map(Part::site)
    }
}

/// Fits with and without a part of a map, and what they are compared on.
struct Trial<'a> {
    data: &'a Data,
    validation: Option<&'a Data>,
    monitor: &'a dyn Monitor,
}

impl Trial<'_> {
    /// The model with the chosen part, fitted to the whole recording, if it beats the model without, and its cost (nats). Its residuals are not whitened: a
    /// prior holds the coefficients, and what a filter takes out of them it would pull to zero.
    fn improves(
        &self,
        current: &Hypothesis,
        (model, first): (&Model, &[f64]),
        side: Side,
    ) -> Result<Option<(Hypothesis, f64)>> {
        let from = |coefficients: &[f64]| [current.own(), coefficients].concat();
        let none = from(&vec![0.0; first.len()]);
        let along = |start: &[f64], data: &Data| {
            fitting::fit(data, model, start, side == Side::Mechanical, self.monitor)
        };
        // First-order coefficients may start a fit in a wrong minimum where load and friction change much; a second one starts from zero.
        let fit = |data: &Data| -> Result<Hypothesis> {
            let fitted = along(&from(first), data)?;
            let held = current.clone().seen_again(data);
            if excess(&fitted) < excess(&held) { Ok(fitted) } else { along(&none, data) }
        };
        let halves = if self.validation.is_none() { self.data.halves() } else { None };
        let (before, after) = match &halves {
            Some((fitted, held_out)) => {
                let bare = fitting::refit(fitted, current, self.monitor)?;
                (self.validated(bare, Some(held_out))?, self.validated(fit(fitted)?, Some(held_out))?)
            }
            None => (
                self.validated(current.clone(), self.validation)?,
                self.validated(fit(self.data)?, self.validation)?,
            ),
        };
        let (data, held_out) = match &halves {
            Some((fitted, held_out)) => (fitted, vec![held_out]),
            None => (self.data, self.validation.into_iter().collect()),
        };
        let evidence = Evidence::new(data, &held_out);
        if !evidence.prefers(&after, &before) {
            return Ok(None);
        }
        // What the fit gains and the prediction loses is no model of what is missing.
        if !before.held_out.is_empty() && after.held_out_squares() >= before.held_out_squares() {
            return Ok(None);
        }
        let cost = evidence.cost(&after);
        let whole = if halves.is_some() { fit(self.data)? } else { after.fitted };
        Ok(Some((whole, cost)))
    }

    fn validated(&self, fitted: Hypothesis, held_out: Option<&Data>) -> Result<Validated> {
        let transferred = held_out.map(|data| transfer(data, &fitted, self.monitor)).transpose()?;
        Ok(Validated { fitted, held_out: transferred.into_iter().collect(), refuted: false })
    }
}
