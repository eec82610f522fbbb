//! Selection of the set of effects by evidence: whole sets are grown, pruned and exchanged, each refitted by simulation.
//!
//! At a fitted set every absent effect is scored to first order; the whole set is refitted with each of the best few, and the one with
//! the most evidence is gone on from. What the others make superfluous is dropped. Nothing is asked of an effect by itself: on a bench on
//! which several things are missing none explains much alone.

mod exchange;
mod refit;
mod subset;

use super::able;
use super::data::Data;
use super::evidence::Evidence;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::power::{Shown, Traces};
use super::shortlist::{Prospect, Scorer};
use super::transfer::transfer;
use super::verdict::{self, Judged};
use crate::effect::{Role, Site};
use crate::effects::EffectId;
use crate::error::Result;
use crate::monitor::Monitor;
use crate::recording::Kind;
use rayon::prelude::*;

pub use exchange::Swap;
use subset::left_out;
pub use subset::{in_place, reduced, special_cases};

/// Effects with which the whole set is refitted before the best of them is gone on from.
const REFITTED: usize = 3;
/// Share of the leading score from which an effect of the same side is refitted, too.
const RIVAL: f64 = 0.5;
/// Share of what an effect explains to first order that it must still explain beside others to be taken up along with them.
const APART: f64 = 0.5;
/// Score (mean square in units of what is left in each channel) below which nothing is refitted.
const LEAST_SCORE: f64 = 0.002;

/// The recording, other runs, and how much may be chosen.
pub struct Search<'a> {
    /// The recording.
    pub data: &'a Data,
    /// Recordings that are not used for fitting.
    pub held_out: Vec<&'a Data>,
    /// Recordings that can only refute a model, with the bare machine on them.
    pub refuting: Vec<(&'a Data, Hypothesis)>,
    /// Most effects in one model.
    pub most: usize,
    /// The set from which it begins, where noise was measured anew with its help; the bare machine where there is none.
    pub from: Option<Hypothesis>,
    /// Asked whether to go on.
    pub monitor: &'a dyn Monitor,
}

/// Scored effects, each with the set that was refitted with it, if it was.
type Tried = Vec<(Prospect, Option<Judged>)>;

/// What came out of a selection.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The bare machine.
    pub base: Judged,
    /// The effects that were scored beside the bare machine, with what came of their refit.
    pub singles: Tried,
    /// The best set of effects (possibly none).
    pub best: Judged,
    /// For each effect of `best`, the sets in which another effect or none is in its place.
    pub swaps: Vec<Swap>,
    /// Effects that could not be asked about, and why.
    pub unfit: Vec<(EffectId, String)>,
    /// What the recording would have shown of the effects that are not in the best set.
    pub shown: Vec<Shown>,
    /// By what the sets were compared.
    pub evidence: Evidence,
    /// The way to the best set, one effect more at each step.
    pub path: Vec<Judged>,
}

impl Outcome {
    /// The bare machine and the best set as they are fitted to all samples.
    pub fn ends(&self) -> (&Judged, &Judged) {
        (&self.path[0], &self.path[self.path.len() - 1])
    }

    /// Whether the best set without `effect`, all else fitted anew, has more than noise: then no other parameter makes up for it.
    pub fn needs(&self, effect: EffectId) -> bool {
        let without = self.swaps.iter().find(|s| s.replaced == effect && s.by.is_none());
        without.map_or(&self.base, |s| &s.judged).excess() > self.evidence.options().mismatch
    }

    /// Takes the bare machine for the best set.
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
    /// Runs the selection from the fitted bare machine.
    ///
    /// # Errors
    /// Those of the fits; an interruption ends it with the best so far.
    pub fn run(&self, base: Hypothesis) -> Result<Outcome> {
        let base = self.judge(base)?;
        let (able, unfit) = able::able(self.data);
        let mut seen = vec![base.clone()];
        let rough = self.data.roughly();
        let growing = Search {
            data: &rough,
            held_out: self.held_out.clone(),
            refuting: Vec::new(),
            from: self.from.clone(),
            ..*self
        };
        let (grown, singles) = growing.grow(&base, &able, &mut seen)?;
        let mut best = match grown.fitted.effects().is_empty() {
            true => base.clone(),
            false => self.judge(fitting::on_from(self.data, &grown.fitted, self.monitor)?)?,
        };
        self.monitor.report("alternatives", 0.85);
        let mut swaps = Vec::new();
        let mut shown = Vec::new();
        for _ in 0..self.data.options.most_effects {
            let evidence = self.evidence().limited(std::iter::once(&best));
            let fitted = best.fitted.clone();
            let traces = Traces::new(self.data, &fitted);
            let (worth, over) = (traces.worth(evidence.samples()), traces.over_remainder());
            if let Some(simpler) = self.simpler(&best, (&worth, &over), &evidence, &mut seen)? {
                best = simpler;
                continue;
            }
            let (absent, poor) = (absent(&able, &best), self.most < self.data.options.most_effects);
            shown = traces.survey(&absent, evidence.samples(), poor, self.monitor);
            swaps = self.exchange(&best, &worth, &shown, &mut seen)?;
            let better = swaps.iter().filter(|s| evidence.prefers(&s.judged, &best));
            let better = better.min_by(|a, b| evidence.cost(&a.judged).total_cmp(&evidence.cost(&b.judged)));
            let Some(better) = better.map(|s| s.judged.clone()) else { break };
            best = better;
        }
        let evidence = self.evidence().limited(std::iter::once(&best));
        seen.extend(singles.iter().filter_map(|(_, set)| set.clone()));
        let path = path(&base, &best, &seen, &evidence);
        Ok(Outcome { base, singles, best, swaps, unfit, shown, evidence, path })
    }

    /// Adds effects one at a time as long as the evidence of the recording grows: the largest set, and what came of the first effects tried.
    fn grow(&self, base: &Judged, able: &[EffectId], seen: &mut Vec<Judged>) -> Result<(Judged, Tried)> {
        let mut best = base.clone();
        let mut singles = Vec::new();
        let evidence = self.evidence();
        let cost = |set: &Judged| evidence.cost_on_recording(&set.fitted);
        if let Some(from) = &self.from {
            let fitted = fitting::carried_over(self.data, from, self.monitor)?;
            best = Judged { fitted, held_out: Vec::new(), refuted: false };
        }
        // Of steady points the noise is known from a few neighbours alone: what may be noise is not looked into.
        let noise = |set: &Judged| {
            self.data.signals.kind == Kind::OperatingPoints && set.excess() <= self.data.options.mismatch
        };
        while best.fitted.effects().len() < self.most && !noise(&best) && !self.monitor.cancelled() {
            let scorer = Scorer::new(self.data, &best.fitted);
            let larger = self.extended(&scorer, &best, &absent(able, &best))?;
            let sets = larger.iter().filter_map(|(_, set)| set.as_ref());
            let sets = sets.filter(|set| self.explains_its_part(&set.fitted, &best.fitted));
            let next = sets.min_by(|a, b| cost(a).total_cmp(&cost(b))).cloned();
            let worth = next.filter(|next| cost(next) < cost(&best));
            let beside = match &worth {
                Some(next) => self.beside(&scorer, (&best, next), &larger, &cost),
                None => Vec::new(),
            };
            if singles.is_empty() {
                singles = larger;
            }
            let Some(mut next) = worth else { break };
            if !beside.is_empty() && !self.monitor.cancelled() {
                let fitted = self.with_all(&next, &beside)?;
                let all = Judged { fitted, held_out: Vec::new(), refuted: false };
                if cost(&all) < cost(&next) && self.explains_its_part(&all.fitted, &next.fitted) {
                    seen.push(next);
                    next = all;
                }
            }
            best = self.renewed(next)?;
            seen.push(best.clone());
            let share = best.fitted.effects().len() as f64 / self.data.options.most_effects as f64;
            self.monitor.report("effects", 0.2 + 0.6 * share);
        }
        Ok((best, singles))
    }

    /// Whether the effects that `larger` has more take away what the leading one of so many as there may still be must: of several effects
    /// that together explain the rest of a channel, one explains at least their mean. Where nothing does, the rest is not in the catalogue,
    /// and what trades one channel for another describes it no better. What the forms of right effects may leave is not asked about.
    fn explains_its_part(&self, larger: &Hypothesis, smaller: &Hypothesis) -> bool {
        let excess = |set: &Hypothesis| verdict::beyond_chance(set).map(|x| x.max(0.0)).collect::<Vec<f64>>();
        let (before, after) = (excess(smaller), excess(larger));
        let options = &self.data.options;
        if before.iter().all(|x| *x <= options.remaining_times.powi(2) - 1.0) {
            return true;
        }
        let room = options.most_effects.saturating_sub(smaller.effects().len()).max(1) as f64;
        let leads = before
            .iter()
            .zip(&after)
            .any(|(before, after)| (before - after) * room >= *before && before > after);
        leads && after.iter().sum::<f64>() < before.iter().sum()
    }

    /// A set with those of its effects that have a whole number among their parameters, such as an order, at the number with which the whole
    /// set does best: it was chosen when the others were not there. The numbers that lead to first order are refitted.
    fn renewed(&self, mut set: Judged) -> Result<Judged> {
        let effects = set.fitted.effects();
        if set.excess() <= self.data.options.mismatch {
            return Ok(set);
        }
        let evidence = self.evidence();
        let chosen = |e: &EffectId| e.info().parameters.iter().any(|p| p.role == Role::Fixed);
        for effect in effects.iter().copied().filter(chosen) {
            let Some((model, parameters, free)) = left_out(&set.fitted, effect) else { continue };
            if effects.len() == 1 || self.monitor.cancelled() {
                continue;
            }
            let nuisances = set.fitted.nuisances.clone();
            let without = Hypothesis::on(self.data, model, parameters, free, nuisances);
            let prospects = Scorer::new(self.data, &without).leading(effect, REFITTED);
            let slot =
                set.fitted.model.slots().iter().find(|s| s.effect == effect).expect("it is in the set");
            let own = set.fitted.parameters[slot.parameters.clone()].to_vec();
            let same = |prospect: &&Prospect| {
                let each = effect.info().parameters.iter().zip(&own).zip(&prospect.start);
                each.filter(|((p, _), _)| p.role == Role::Fixed).all(|((_, a), b)| a == b)
            };
            // Beside a number that leads by far no other is asked about.
            let present = prospects.iter().find(same).map_or(0.0, |p| p.score);
            let rivals = |p: &&Prospect| !same(p) && p.score > RIVAL * present;
            let without = Judged { fitted: without, ..set.clone() };
            let asked: Vec<&Prospect> = prospects.iter().filter(rivals).collect();
            let tried: Vec<Option<Hypothesis>> =
                asked.par_iter().map(|prospect| self.refit(&without, prospect)).collect::<Result<_>>()?;
            for fitted in tried.into_iter().flatten() {
                if evidence.cost_on_recording(&fitted) < evidence.cost_on_recording(&set.fitted) {
                    set = Judged { fitted, held_out: Vec::new(), refuted: false };
                }
            }
        }
        Ok(set)
    }

    /// The refitted effects that are worth their place by themselves and, to first order, beside the one that `next` took up and beside one
    /// another: as they were fitted, the best first. No more than there may be.
    fn beside(
        &self,
        scorer: &Scorer,
        (parent, next): (&Judged, &Judged),
        larger: &Tried,
        cost: &dyn Fn(&Judged) -> f64,
    ) -> Vec<Prospect> {
        let as_fitted = |(prospect, set): &(Prospect, Option<Judged>)| {
            let set = set.as_ref()?;
            let slot = set.fitted.model.slots().last()?;
            let start = set.fitted.parameters[slot.parameters.clone()].to_vec();
            Some((Prospect { start, ..prospect.clone() }, cost(set)))
        };
        let Some(added) = next.fitted.effects().last().copied() else { return Vec::new() };
        let (lead, others): (Vec<_>, Vec<_>) =
            larger.iter().filter_map(as_fitted).partition(|(p, _)| p.effect == added);
        let mut taken: Vec<Prospect> = lead.into_iter().map(|(p, _)| p).collect();
        let gains = |(_, with): &(Prospect, f64)| *with + self.data.options.decisive < cost(parent);
        let mut others: Vec<(Prospect, f64)> = others.into_iter().filter(gains).collect();
        others.sort_by(|a, b| a.1.total_cmp(&b.1));
        for (prospect, _) in others {
            let room = next.fitted.effects().len() + taken.len() <= self.most;
            if room && scorer.share_beside(&taken, &prospect) >= APART {
                taken.push(prospect);
            }
        }
        taken.into_iter().skip(1).collect()
    }

    /// Scores `candidates` beside a set and refits it with each of the best of them.
    fn extended(&self, scorer: &Scorer, parent: &Judged, candidates: &[EffectId]) -> Result<Tried> {
        let score = |effect: &EffectId| match self.monitor.cancelled() {
            true => Prospect::nothing(*effect, parent.fitted.model.context()),
            false => scorer.score(*effect),
        };
        let mut prospects: Vec<Prospect> = candidates.par_iter().map(score).collect();
        prospects.sort_by(|a, b| b.score.total_cmp(&a.score));
        // Those that lead on their side, and those that may be what leads.
        let mut leading: Vec<EffectId> = Vec::new();
        for moves in [true, false] {
            let side =
                || prospects.iter().filter(|p| is_mechanical(p.effect) == moves && p.score > LEAST_SCORE);
            let top = side().next().map_or(0.0, |p| p.score);
            leading.extend(side().take(REFITTED).filter(|p| p.score >= RIVAL * top).map(|p| p.effect));
        }
        // The steps of an unknown load can do what a friction does whose torque jumps at reversals: no score tells.
        if parent.fitted.nuisances.iter().any(|nuisance| nuisance.steps() > 0) {
            leading.extend(candidates.iter().filter(|effect| effect.jumps()));
        }
        let refit = |prospect: Prospect| -> Result<(Prospect, Option<Judged>)> {
            let asked = leading.contains(&prospect.effect) && !self.monitor.cancelled();
            let set = if asked { self.refit(parent, &prospect)? } else { None };
            Ok((prospect, set.map(|fitted| Judged { fitted, held_out: Vec::new(), refuted: false })))
        };
        prospects.into_par_iter().map(refit).collect()
    }

    /// By what sets are compared.
    fn evidence(&self) -> Evidence {
        Evidence::new(self.data, &self.held_out)
    }

    /// A fitted set with what it predicts of the other recordings.
    fn judge(&self, fitted: Hypothesis) -> Result<Judged> {
        let on = |data: &Data| transfer(data, &fitted, self.monitor);
        let held_out: Result<Vec<Hypothesis>> = self.held_out.iter().map(|data| on(data)).collect();
        let held_out = held_out?;
        let mut refuted = false;
        for (data, bare) in &self.refuting {
            refuted |= !fitted.effects().is_empty() && verdict::refutes(&on(data)?, bare, &self.data.options);
        }
        Ok(Judged { fitted, held_out, refuted })
    }
}

fn is_mechanical(effect: EffectId) -> bool {
    effect.info().site == Site::Mechanical
}

/// Those effects that are not in a set.
fn absent(able: &[EffectId], set: &Judged) -> Vec<EffectId> {
    let effects = set.fitted.effects();
    able.iter().copied().filter(|e| !effects.contains(e)).collect()
}

/// From the bare machine to the best set, through the best subsets that were fitted.
fn path(base: &Judged, best: &Judged, seen: &[Judged], evidence: &Evidence) -> Vec<Judged> {
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
    fn rich() -> Manoeuvre {
        let path: Vec<(f64, f64)> =
            (0..8).map(|k| (0.05 + 0.2 * f64::from(k), [110.0, -90.0, 40.0][k as usize % 3])).collect();
        let mut manoeuvre = speeds(1.6, &path);
        manoeuvre.i_d = Some(Schedule::new(vec![(0.0, 0.0), (0.4, -4.0), (1.1, 2.0)], Shape::Steps).unwrap());
        manoeuvre
    }

    fn search(data: &Data) -> Search<'_> {
        Search {
            data,
            held_out: Vec::new(),
            refuting: Vec::new(),
            most: data.options.most_effects,
            from: None,
            monitor: &Silent,
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

    #[test]
    fn what_leads_must_explain_its_part_of_a_rest_that_the_catalogue_could_explain() {
        let (data, base) = testing::data(&setup(speeds(0.6, &[(0.1, 60.0)]), Vec::new()));
        let left = |squares: [f64; 3]| {
            let mut set = base.clone();
            set.squares.iter_mut().zip(squares).for_each(|((_, s), x)| *s = x);
            set
        };
        let explains_its_part = |before, after| search(&data).explains_its_part(&left(after), &left(before));
        // Ten effects could explain this rest, so the first explains a tenth of it.
        assert!(explains_its_part([1.0, 1.0, 101.0], [1.0, 1.0, 80.0]));
        assert!(!explains_its_part([1.0, 1.0, 101.0], [1.0, 1.0, 95.0]));
        // What leaves more on the whole describes nothing, though one channel gains.
        assert!(!explains_its_part([31.0, 1.0, 51.0], [71.0, 1.0, 21.0]));
        // Of what the forms of right effects leave the evidence alone decides.
        assert!(explains_its_part([1.0, 1.0, 2.0], [1.0, 1.0, 1.95]));
    }

    #[test]
    fn an_order_chosen_before_the_others_were_known_is_corrected() {
        let both = vec![choice("cogging_torque", "a_1", 0.2), choice("coulomb_friction", "tau_c", 0.3)];
        let (data, base) = testing::data(&setup(rich(), both));
        let (cogging, friction) = (EffectId::CoggingTorque, EffectId::CoulombFriction);
        let model = crate::model::Model::new(data.signals.context, &[friction, cogging]);
        let typical = |e: EffectId| -> Vec<f64> {
            e.info().parameters.iter().map(|p| (p.typical)(&data.signals.context)).collect()
        };
        let mut start = [base.own(), &typical(friction), &typical(cogging)].concat();
        let order = start.len() - 1;
        assert_eq!(cogging.info().parameters.last().map(|p| p.role), Some(Role::Fixed));
        let right = start[order];
        start[order] = right / 3.0;
        let fitted = fitting::fit(&data, &model, &start, false, &Silent).unwrap();
        let wrong = Judged { fitted, held_out: Vec::new(), refuted: false };
        assert!(wrong.excess() > data.options.mismatch && wrong.fitted.own()[order] == right / 3.0);
        let found = search(&data).renewed(wrong).unwrap();
        let slot = found.fitted.model.slots().iter().find(|s| s.effect == cogging).unwrap();
        assert_eq!(found.fitted.own()[slot.parameters.end - 1], right);
        assert!(found.excess() < data.options.mismatch, "{:?}", found.fitted.squares);
    }
}
