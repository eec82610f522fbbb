//! Selection of the set of effects by evidence: whole sets are grown, pruned and exchanged, each refitted by simulation.
//!
//! At a fitted set every absent effect is scored to first order; the whole set is refitted with each of the best few, and the one with
//! the most evidence is kept. An effect that the others make superfluous is dropped, and one that another recording needs is added. Single
//! effects are not tested: where several are missing none explains much alone.

mod exchange;
mod grow;
mod refit;
mod reversals;
mod subset;
mod validation_run;

use super::data::Data;
use super::evidence::Evidence;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::identifiability;
use super::incumbent::Incumbent;
use super::power::{Shown, Traces};
use super::score::Prospect;
use super::transfer::transfer;
use super::verdict::{self, Validated};
use crate::effects::EffectId;
use crate::error::Result;
use crate::monitor::Monitor;

pub use exchange::Swap;
pub use subset::{in_place, reduced, special_cases};

/// The recording, other runs, and how much may be chosen.
pub struct Search<'a> {
    /// The recording.
    pub data: &'a Data,
    /// Recordings that are not used for fitting.
    pub held_out: Vec<&'a Data>,
    /// Recordings that can only refute a model, with the dq-model on them.
    pub refuting: Vec<(&'a Data, Hypothesis)>,
    /// Most effects in one model.
    pub most: usize,
    /// The set from which it begins, where the noise was measured again with it; the dq-model where there is none.
    pub from: Option<Hypothesis>,
    /// Progress and interruption of the call.
    pub monitor: &'a dyn Monitor,
    /// Keeps the best set so far.
    pub incumbent: &'a Incumbent,
}

/// Scored effects, each with the set that was refitted with it, if it was.
type Tried = Vec<(Prospect, Option<Validated>)>;

/// What came out of a selection.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The dq-model.
    pub base: Validated,
    /// The effects that were scored beside the dq-model, with what came of their refit.
    pub singles: Tried,
    /// The best set of effects (possibly none).
    pub best: Validated,
    /// For each effect of `best`, the sets in which another effect or none is in its place.
    pub swaps: Vec<Swap>,
    /// Effects that the recordings cannot show, and why.
    pub unidentifiable: Vec<(EffectId, String)>,
    /// What the recording would have shown of the effects that are not in the best set.
    pub shown: Vec<Shown>,
    /// The evidence by which the sets were compared.
    pub evidence: Evidence,
    /// The way to the best set, one effect more at each step.
    pub path: Vec<Validated>,
}

impl Outcome {
    /// The dq-model and the best set as they are fitted to all samples.
    pub fn ends(&self) -> (&Validated, &Validated) {
        (&self.path[0], &self.path[self.path.len() - 1])
    }

    /// Whether the best set without `effect`, refitted, has a residual above the noise, so that no other parameter absorbs the effect.
    pub fn needs(&self, effect: EffectId) -> bool {
        let without = self.swaps.iter().find(|s| s.replaced == effect && s.by.is_none());
        without.map_or(&self.base, |s| &s.validated).excess() > self.evidence.options().mismatch
    }

    /// Takes the dq-model for the best set.
    pub fn names_nothing(&mut self) {
        self.best = self.base.clone();
        self.path.truncate(1);
        self.swaps.clear();
    }

    /// The effects of the best set in the order in which the path takes them up.
    pub fn order(&self) -> Vec<EffectId> {
        let mut order: Vec<EffectId> = Vec::new();
        for step in &self.path {
            let added: Vec<EffectId> =
                step.fitted.effects().into_iter().filter(|e| !order.contains(e)).collect();
            order.extend(added);
        }
        order
    }
}

impl Search<'_> {
    /// Runs the selection from the fitted dq-model.
    ///
    /// # Errors
    /// Those of the fits, an interruption among them.
    pub fn run(&self, base: Hypothesis) -> Result<Outcome> {
        let base = self.validate(base)?;
        let (identifiable, unidentifiable) = identifiability::identifiable(self.data);
        let mut seen = vec![base.clone()];
        // Sets that are only compared may end their fits before the last digit.
        let rough = self.data.roughly();
        let (held_out, refuting) = (self.held_out.clone(), self.refuting.clone());
        let quick = Search { data: &rough, held_out, refuting, from: self.from.clone(), ..*self };
        let (grown, singles) = quick.grow(&base, &identifiable, &mut seen)?;
        let mut best = match grown.fitted.effects().is_empty() {
            true => base.clone(),
            false => quick.validate(fitting::on_from(&rough, &grown.fitted, self.monitor)?)?,
        };
        self.monitor.report("alternatives", 0.85);
        let mut swaps = Vec::new();
        let mut shown = Vec::new();
        // Sets with which growth ended.
        let mut ends = vec![grown.fitted.effects()];
        for _ in 0..self.data.options.most_effects {
            self.monitor.go_on()?;
            self.incumbent.note(&best.fitted);
            let evidence = self.evidence().limited(std::iter::once(&best));
            let fitted = best.fitted.clone();
            let traces = Traces::new(self.data, &fitted);
            let (worth, over) = (traces.worth(evidence.samples()), traces.over_remainder());
            if let Some(simpler) = quick.simpler(&best, (&worth, &over), &evidence, &mut seen)? {
                best = simpler;
                continue;
            }
            let (absent, poor) = (absent(&identifiable, &best), self.most < self.data.options.most_effects);
            shown = traces.survey(&absent, evidence.samples(), poor, self.monitor)?;
            swaps = quick.exchange(&best, (&worth, &over), &shown, &mut seen)?;
            let mut better = evidence.best_of(swaps.iter().map(|swap| &swap.validated), &best).cloned();
            if better.is_none() {
                better = quick.friction_for_steps(&best, &absent, &evidence)?;
            }
            let effects = best.fitted.effects();
            if better.is_none() && !ends.iter().any(|end| exchange::is_set(end, &effects)) {
                better = quick.grown_again(&best, &absent, &evidence)?;
                ends.push(effects);
            }
            if better.is_none() {
                better = quick.extended_by_validation(&best, &absent, &evidence)?;
            }
            let Some(better) = better else { break };
            best = better;
        }
        if !best.fitted.effects().is_empty() {
            best = self.validate(fitting::on_from(self.data, &best.fitted, self.monitor)?)?;
        }
        let evidence = self.evidence().limited(std::iter::once(&best));
        seen.extend(singles.iter().filter_map(|(_, set)| set.clone()));
        let path = path(&base, &best, &seen, &evidence);
        Ok(Outcome { base, singles, best, swaps, unidentifiable, shown, evidence, path })
    }

    /// The evidence by which sets are compared.
    fn evidence(&self) -> Evidence {
        Evidence::new(self.data, &self.held_out)
    }

    /// A fitted set with what it predicts of the other recordings.
    fn validate(&self, fitted: Hypothesis) -> Result<Validated> {
        let on = |data: &Data| transfer(data, &fitted, self.monitor);
        let held_out: Result<Vec<Hypothesis>> = self.held_out.iter().map(|data| on(data)).collect();
        let held_out = held_out?;
        let mut refuted = false;
        for (data, bare) in &self.refuting {
            refuted |= !fitted.effects().is_empty() && verdict::refutes(&on(data)?, bare, &self.data.options);
        }
        Ok(Validated { fitted, held_out, refuted })
    }
}

/// Those effects that are not in a set.
fn absent(identifiable: &[EffectId], set: &Validated) -> Vec<EffectId> {
    let effects = set.fitted.effects();
    identifiable.iter().copied().filter(|e| !effects.contains(e)).collect()
}

/// From the dq-model to the best set, through the best subsets that were fitted.
fn path(base: &Validated, best: &Validated, seen: &[Validated], evidence: &Evidence) -> Vec<Validated> {
    let goal = best.fitted.effects();
    let mut path = vec![base.clone()];
    for size in 1..goal.len() {
        let so_far = path[path.len() - 1].fitted.effects();
        let step = seen.iter().filter(|set| {
            let effects = set.fitted.effects();
            effects.len() == size
                && effects.iter().all(|e| goal.contains(e))
                && so_far.iter().all(|e| effects.contains(e))
        });
        path.extend(step.min_by(|a, b| evidence.cost(a).total_cmp(&evidence.cost(b))).cloned());
    }
    if !goal.is_empty() {
        path.push(best.clone());
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{self, choice, setup, speeds};
    use crate::drive::{Choice, Manoeuvre, Schedule, Shape};
    use crate::monitor::Silent;

    /// Reversals at several speeds with steps of i_d.
    pub(super) fn rich() -> Manoeuvre {
        let path: Vec<(f64, f64)> =
            (0..8).map(|k| (0.05 + 0.2 * f64::from(k), [110.0, -90.0, 40.0][k as usize % 3])).collect();
        let mut manoeuvre = speeds(1.6, &path);
        manoeuvre.i_d = Some(Schedule::new(vec![(0.0, 0.0), (0.4, -4.0), (1.1, 2.0)], Shape::Steps).unwrap());
        manoeuvre
    }

    pub(super) fn search(data: &Data) -> Search<'_> {
        Search {
            data,
            held_out: Vec::new(),
            refuting: Vec::new(),
            most: data.options.most_effects,
            from: None,
            monitor: &Silent,
            incumbent: Box::leak(Box::default()),
        }
    }

    fn selected(present: Vec<Choice>) -> Vec<EffectId> {
        let (data, base) = testing::data(&setup(rich(), present));
        let outcome = search(&data).run(base).unwrap();
        let found = outcome.best.fitted.effects();
        assert_eq!(outcome.order().len(), found.len());
        assert!(outcome.path.windows(2).all(|w| w[0].fitted.effects().len() < w[1].fitted.effects().len()));
        found
    }

    #[test]
    fn three_effects_at_once_are_all_found_and_nothing_else() {
        let present = vec![
            choice("dead_time", "v_err", 4.0),
            choice("coulomb_friction", "tau_c", 0.3),
            choice("cogging_torque", "a_1", 0.2),
        ];
        let mut found = selected(present);
        found.sort_by_key(|e| e.id());
        assert_eq!(found, [EffectId::CoggingTorque, EffectId::CoulombFriction, EffectId::DeadTime]);
    }

    #[test]
    fn a_clean_machine_gets_no_effect() {
        assert_eq!(selected(Vec::new()), []);
    }
}
