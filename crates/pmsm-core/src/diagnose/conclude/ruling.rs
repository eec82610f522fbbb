//! The verdict with its candidates, and what changes them: a model that does not fit, a remaining residual, and strengths that may be zero.

use super::step;
use crate::diagnose::adjusted_likelihood::AdjustedLikelihood;
use crate::diagnose::answer::{Estimate, Verdict};
use crate::diagnose::collinearity::Collinearity;
use crate::diagnose::consistency::{self, Contradiction};
use crate::diagnose::data::Data;
use crate::diagnose::decide::{self, Ranked};
use crate::diagnose::evidence::Evidence;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::outputs::Outputs;
use crate::diagnose::remaining::{self, Remaining};
use crate::diagnose::select::{Outcome, reduced};
use crate::diagnose::transfer::transfer;
use crate::diagnose::unmodelled::{Supported, Unmodelled};
use crate::diagnose::verdict::Validated;
use crate::diagnose::{adequacy, coverage, fitting, identifiability, power, unmodelled};
use crate::effect::Site;
use crate::effects::EffectId;
use crate::error::Result;
use crate::monitor::Monitor;
use crate::signals::Finding;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// The recordings and the validation run, if there is one, of which a ruling is made.
#[derive(Clone, Copy)]
pub(super) struct Runs<'a> {
    pub(super) data: &'a Data,
    pub(super) validation: Option<&'a Data>,
    pub(super) monitor: &'a dyn Monitor,
}

/// A verdict, its candidates and the reasons for both.
pub(super) struct Ruling<'a> {
    runs: Runs<'a>,
    pub(super) outcome: Outcome,
    pub(super) verdict: Verdict,
    pub(super) ranked: Vec<Ranked>,
    /// Why nothing can be said, if so.
    pub(super) reason: Option<String>,
    /// The dq-model as the search compared it, which may have left samples out.
    pub(super) searched: Validated,
    /// Whether what fits the recording predicts the validation run worse than the dq-model does.
    pub(super) refuted: bool,
    pub(super) contradiction: Option<Contradiction>,
    pub(super) lack_of_fit: Option<Finding>,
    pub(super) few_currents: Option<Finding>,
    pub(super) ties: Vec<Collinearity>,
    pub(super) asymmetric_friction: BTreeMap<String, Estimate>,
    /// The dq-model and the best set on the validation run.
    pub(super) before: Option<Hypothesis>,
    pub(super) after: Option<Hypothesis>,
    /// What the best set leaves of each equation.
    pub(super) remaining: Vec<Remaining>,
    /// The best set with a map of what remains beside its effects, if that was asked.
    pub(super) described: Option<(Hypothesis, Unmodelled)>,
}

impl<'a> Ruling<'a> {
    /// The verdict that a search calls for, with final estimates of its sets.
    ///
    /// # Errors
    /// Those of the least-squares fits.
    pub(super) fn new(runs: Runs<'a>, mut outcome: Outcome) -> Result<Self> {
        let Runs { data, monitor, .. } = runs;
        if data.poor && outcome.base.excess() <= data.options.mismatch {
            // On a poor recording a small gain of one effect is no evidence against the dq-model.
            outcome.names_nothing();
            let asked = identifiability::identifiable(data).0;
            let worth = outcome.evidence.samples();
            let traces = power::Traces::new(data, &outcome.base.fitted);
            outcome.shown = traces.survey(&asked, worth, true, monitor)?;
        }
        let (verdict, ranked) = decide::decide(&outcome, cannot_tell(data, &outcome.best.fitted));
        let refuted = outcome.best.refuted;
        if refuted {
            // It stays a candidate, but is no model to predict with.
            outcome.best = outcome.base.clone();
            outcome.path.truncate(1);
        }
        let last = outcome.path.len() - 1;
        outcome.path.par_iter_mut().try_for_each(|set| {
            monitor.go_on()?;
            set.fitted = final_estimate(data, &set.fitted, monitor)?;
            Ok(())
        })?;
        let (first, end) = (outcome.path[0].clone(), outcome.path[last].clone());
        let searched = std::mem::replace(&mut outcome.base, first);
        outcome.best = end;
        let (before, after) = rayon::join(
            || runs.on_validation(&outcome.base.fitted),
            || runs.on_validation(&outcome.best.fitted),
        );
        let (before, after) = (before?, after?);
        let remaining = runs.remaining(&outcome.best.fitted, after.as_ref());
        let own = Outputs::new(data, &outcome.best.fitted);
        // Steady points have no dynamics, and base parameters may replace an effect of any strength.
        let ties = if data.is_steady() { own.ties() } else { Vec::new() };
        Ok(Self {
            contradiction: consistency::contradiction(data, &outcome.best.fitted, monitor)?,
            lack_of_fit: adequacy::lack_of_fit(data, &outcome.best.fitted),
            few_currents: coverage::held_at_few_currents(data),
            asymmetric_friction: own.effect(EffectId::AsymmetricFriction),
            reason: None,
            runs,
            outcome,
            verdict,
            ranked,
            searched,
            refuted,
            ties,
            before,
            after,
            remaining,
            described: None,
        })
    }

    /// A model that does not fit, recordings that contradict each other, and effects that move nothing or that base parameters may replace.
    ///
    /// # Errors
    /// [`Error::Interrupted`](crate::error::Error::Interrupted).
    pub(super) fn weigh_model(&mut self) -> Result<()> {
        let Runs { data, monitor, .. } = self.runs;
        let effects = self.outcome.best.fitted.effects();
        let contradicted = self.contradiction.as_ref().filter(|c| c.concerns(&effects)).map(|c| &c.finding);
        self.reason = self.lack_of_fit.as_ref().or(contradicted).map(Finding::reason);
        if self.reason.is_some() {
            self.verdict = Verdict::Undetermined;
            self.doubt_all(data.options.ceiling_unknown);
        }
        if let Some(why) = data.signals.limits.coarse.as_ref().filter(|_| self.verdict == Verdict::NoMismatch)
        {
            // The motion is explained; the voltages were left out, so that `no_mismatch` would claim too much.
            let explained = "the equation of motion explains the speed down to the noise, but the voltage equations cannot be checked";
            self.verdict = Verdict::Undetermined;
            self.reason = Some(format!("{explained}, as {}", why.reason()));
        }
        monitor.go_on()?;
        let own = Outputs::new(data, &self.outcome.best.fitted);
        if self.verdict == Verdict::Named && effects.iter().any(|e| own.moves_nothing(*e)) {
            self.verdict = Verdict::Unknown;
            self.doubt_all(data.options.ceiling_unknown);
        }
        let replaceable = |tie: &Collinearity| tie.doubtful && !self.outcome.needs(tie.effect);
        if self.verdict == Verdict::Named && self.ties.iter().any(replaceable) {
            self.verdict = Verdict::Ambiguous;
        }
        if data.poor && self.verdict == Verdict::Ambiguous && !self.remaining.is_empty() {
            // Beside another cause no name is sure, however much of the mismatch it explains.
            self.doubt_all(data.options.ceiling_doubtful);
        }
        Ok(())
    }

    /// Where more than noise remains: which effects explain what a smooth term cannot.
    ///
    /// # Errors
    /// Those of the least-squares fits.
    pub(super) fn weigh_remainder(&mut self) -> Result<()> {
        let Runs { data, validation, monitor } = self.runs;
        let best = &self.outcome.best.fitted;
        let found = !best.effects().is_empty() && !cannot_tell(data, best);
        let open = match self.verdict {
            Verdict::Named | Verdict::Ambiguous => !self.remaining.is_empty(),
            verdict => verdict == Verdict::Unknown,
        };
        if found && open {
            let mut supported = unmodelled::supported(data, validation, best, monitor)?;
            supported.set = final_estimate(data, &supported.set, monitor)?;
            // Steady points have no memory, as the evidence counts them.
            if !data.is_steady() {
                supported = self.by_adjusted_likelihood(supported)?;
            }
            self.keep(supported)?;
        }
        let best = &self.outcome.best.fitted;
        let doubtful = self.verdict == Verdict::Ambiguous && found && open;
        if (doubtful || matches!(self.verdict, Verdict::Named | Verdict::Partial))
            && unmodelled::rival(data, validation, best, monitor)?.is_some()
        {
            // Of the motion nothing is named; what acts in the voltage equations stays.
            let set = unmodelled::without_motion(data, best, monitor)?;
            self.keep_only(final_estimate(data, &set, monitor)?, None)?;
        }
        Ok(())
    }

    /// The set without effects that are less probable than not by the adjusted likelihood, one after the other, and the others no more probable
    /// than it says.
    fn by_adjusted_likelihood(&self, mut supported: Supported) -> Result<Supported> {
        let Runs { data, monitor, .. } = self.runs;
        loop {
            let worth = AdjustedLikelihood::new(data, &supported.set).of_effects(monitor)?;
            let least = worth.iter().min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, nats)| *nats < 0.0);
            let Some(&(effect, _)) = least else {
                for (effect, probability) in &mut supported.probabilities {
                    let nats = worth.iter().find(|x| x.0 == *effect).map_or(f64::INFINITY, |x| x.1);
                    *probability = probability.min(unmodelled::probability(nats));
                }
                return Ok(supported);
            };
            let nearest = (effect.info().site == Site::Mechanical).then(|| supported.set.clone());
            let (model, start) = reduced(&supported.set, effect);
            let without = fitting::fit(data, &model, &start, false, monitor)?;
            supported.set = final_estimate(data, &without, monitor)?;
            supported.nearest = nearest.or(supported.nearest);
            supported.probabilities.retain(|(other, _)| *other != effect);
            supported.alternatives.retain(|a| a.present != effect);
        }
    }

    /// Which of the effects beside a map of what remains the map does not replace. One is replaced only if the smaller set with a map of its
    /// own has as much evidence, on the validation run, too.
    ///
    /// # Errors
    /// Those of the least-squares fits.
    pub(super) fn weigh_against_map(&mut self) -> Result<()> {
        let Runs { data, validation, monitor } = self.runs;
        if self.verdict != Verdict::Partial {
            return Ok(());
        }
        let mut described = unmodelled::explain(data, validation, &self.outcome.best.fitted, monitor)?;
        while let Some(effect) = unmodelled::replaced(data, &described.0, monitor)? {
            let best = &self.outcome.best.fitted;
            let (model, start) = reduced(best, effect);
            let set = final_estimate(data, &fitting::fit(data, &model, &start, false, monitor)?, monitor)?;
            let smaller = unmodelled::explain(data, validation, &set, monitor)?;
            if self.runs.cost(&smaller.0)? > self.runs.cost(&described.0)? {
                break;
            }
            let nearest = (effect.info().site == Site::Mechanical).then(|| best.clone());
            self.keep_only(set, nearest)?;
            if self.verdict != Verdict::Partial {
                return Ok(());
            }
            described = smaller;
        }
        self.described = Some(described);
        Ok(())
    }

    /// Keeps the effects of a smaller set, as probable as they were. Of what it lost a smooth torque does as well as the form of `nearest`.
    fn keep_only(&mut self, set: Hypothesis, nearest: Option<Hypothesis>) -> Result<()> {
        let known = |c: &&Ranked| set.effects().contains(&c.effect);
        let share = 1.0 - self.runs.data.options.unknown;
        let probabilities = self.ranked.iter().filter(known);
        let probabilities = probabilities.map(|c| (c.effect, (c.probability / share).min(1.0))).collect();
        self.keep(Supported { set, probabilities, alternatives: Vec::new(), nearest })
    }

    /// The verdict with those effects alone that a remaining residual leaves.
    fn keep(&mut self, supported: Supported) -> Result<()> {
        let nearest = supported.nearest.as_ref().map(|set| step(self.runs.data, set));
        self.verdict = decide::beside_discrepancy(&mut self.outcome, &mut self.ranked, supported);
        if self.verdict != Verdict::Unknown {
            let best = &self.outcome.best.fitted;
            self.after = self.runs.on_validation(best)?;
            self.remaining = self.runs.remaining(best, self.after.as_ref());
        }
        if let Some(motion) = self.remaining.iter_mut().find(|r| r.equation == "mechanical") {
            motion.set_nearest(nearest);
        }
        Ok(())
    }

    /// Names whose strength may be zero are in doubt.
    pub(super) fn weigh_strengths(&mut self) {
        if !matches!(self.verdict, Verdict::Named | Verdict::Partial | Verdict::Ambiguous) {
            return;
        }
        let (data, best) = (self.runs.data, &self.outcome.best.fitted);
        let (outputs, effects) = (Outputs::new(data, best), best.effects());
        let doubtful = |c: &&mut Ranked| effects.contains(&c.effect) && outputs.may_be_absent(c.effect);
        for candidate in self.ranked.iter_mut().filter(doubtful) {
            candidate.probability = candidate.probability.min(data.options.ceiling_doubtful);
            self.verdict = Verdict::Ambiguous;
        }
    }

    /// Without a name the model is the dq-model, and at a few levels of current nothing can be said.
    pub(super) fn settle(&mut self) {
        if self.verdict != Verdict::Unknown {
            return;
        }
        // No effect has enough evidence for a name: it stays a candidate, and is no part of the model.
        self.outcome.best = self.outcome.base.clone();
        self.outcome.path.truncate(1);
        self.after.clone_from(&self.before);
        if let Some(finding) = adequacy::lack_of_fit(self.runs.data, &self.outcome.best.fitted) {
            self.verdict = Verdict::Undetermined;
            self.reason = Some(finding.reason());
            self.lack_of_fit = Some(finding);
        }
        if self.few_currents.is_some() {
            // Any two parameters explain two levels of current.
            self.verdict = Verdict::Undetermined;
        }
    }

    fn doubt_all(&mut self, ceiling: f64) {
        decide::doubt(&mut self.ranked, ceiling);
    }
}

impl Runs<'_> {
    /// What a set predicts of the validation run, if there is one.
    fn on_validation(&self, set: &Hypothesis) -> Result<Option<Hypothesis>> {
        self.validation.map(|run| transfer(run, set, self.monitor)).transpose()
    }

    /// Cost of a set on the recordings and the validation run, nats.
    fn cost(&self, set: &Hypothesis) -> Result<f64> {
        let evidence = Evidence::new(self.data, &Vec::from_iter(self.validation));
        let held_out = Vec::from_iter(self.on_validation(set)?);
        Ok(evidence.cost(&Validated { fitted: set.clone(), held_out, refuted: false }))
    }

    /// What a set leaves of each equation, on the recordings and, `predicted`, on the validation run.
    fn remaining(&self, set: &Hypothesis, predicted: Option<&Hypothesis>) -> Vec<Remaining> {
        remaining::beside(self.data, set, self.validation.zip(predicted))
    }
}

/// The final estimate of a set, weighted by the colour of its residual. Where that fit no longer describes the recording, the weights are
/// left out: they assume a model without mismatch.
fn final_estimate(data: &Data, set: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let weighted = fitting::efficient(data, set, monitor)?;
    Ok(if adequacy::lack_of_fit(data, &weighted).is_none() { weighted } else { set.clone() })
}

/// Whether a recording is too poor to tell the effects of a set from physics outside the catalogue. That holds for electrical effects on a
/// poor recording, and for all effects at a single operating point.
fn cannot_tell(data: &Data, set: &Hypothesis) -> bool {
    let electrical = set.effects().iter().any(|e| e.info().site != Site::Mechanical);
    data.poor && (electrical || coverage::stays_at_one_point(&data.signals))
}
