//! A set grown by the effects that explain most of what it leaves.

use super::subset::left_out;
use super::{Search, Tried, absent};
use crate::diagnose::evidence::Evidence;
use crate::diagnose::fitting;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::score::{Prospect, Scorer};
use crate::diagnose::verdict::{self, Validated};
use crate::effect::{Role, Site};
use crate::effects::EffectId;
use crate::error::Result;
use crate::recording::Kind;
use rayon::prelude::*;

/// Leading effects with each of which the whole set is refitted before the best is kept.
pub(super) const REFITTED: usize = 3;
/// Share of the leading score from which an effect of the same side is refitted, too.
const RIVAL: f64 = 0.5;
/// Share of what an effect explains to first order that it must still explain beside others to be taken up along with them.
const APART: f64 = 0.5;
/// Score (mean square in units of what is left in each channel) below which nothing is refitted.
const LEAST_SCORE: f64 = 0.002;

impl Search<'_> {
    /// Adds effects one at a time as long as the evidence of the recording grows: the largest set, and what came of the first effects tried.
    pub(super) fn grow(
        &self,
        base: &Validated,
        identifiable: &[EffectId],
        seen: &mut Vec<Validated>,
    ) -> Result<(Validated, Tried)> {
        let mut best = base.clone();
        let mut singles = Vec::new();
        let evidence = self.evidence();
        let cost = |set: &Validated| evidence.cost_on_recording(&set.fitted);
        if let Some(from) = &self.from {
            let fitted = fitting::carried_over(self.data, from, self.monitor)?;
            best = Validated { fitted, held_out: Vec::new(), refuted: false };
        }
        // The noise of steady points is known from a few neighbours alone: a residual that may be noise is not explained.
        let noise = |set: &Validated| {
            self.data.signals.kind == Kind::OperatingPoints && set.excess() <= self.data.options.mismatch
        };
        while best.fitted.effects().len() < self.most && !noise(&best) {
            self.monitor.go_on()?;
            let scorer = Scorer::new(self.data, &best.fitted);
            let larger = self.extended(&scorer, &best, &absent(identifiable, &best))?;
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
            if !beside.is_empty() {
                let fitted = self.with_all(&next, &beside)?;
                let all = Validated { fitted, held_out: Vec::new(), refuted: false };
                if cost(&all) < cost(&next) && self.explains_its_part(&all.fitted, &next.fitted) {
                    seen.push(next);
                    next = all;
                }
            }
            let alone = next.fitted.effects().len() == 1;
            // The number of a single effect was chosen for it alone.
            best = if alone { next } else { self.renewed(next, &|_| true)? };
            self.incumbent.note(&best.fitted);
            seen.push(best.clone());
            let share = best.fitted.effects().len() as f64 / self.data.options.most_effects as f64;
            self.monitor.report("effects", 0.2 + 0.6 * share);
        }
        Ok((best, singles))
    }

    /// The set with one of the `absent` effects more, if that has more evidence on all recordings. A set that growth did not end with may
    /// want an effect that was dropped: it was fitted beside others, with an order or a frequency that was chosen for what they left.
    pub(super) fn grown_again(
        &self,
        best: &Validated,
        absent: &[EffectId],
        evidence: &Evidence,
    ) -> Result<Option<Validated>> {
        if best.fitted.effects().len() >= self.most {
            return Ok(None);
        }
        let scorer = Scorer::new(self.data, &best.fitted);
        let larger = self.extended(&scorer, best, absent)?;
        let sets = larger.into_iter().filter_map(|(_, set)| set);
        let sets = sets.filter(|set| self.explains_its_part(&set.fitted, &best.fitted));
        let sets: Vec<Validated> = sets.map(|set| self.validate(set.fitted)).collect::<Result<_>>()?;
        Ok(evidence.best_of(sets.iter(), best).cloned())
    }

    /// Whether the further effects of `larger` explain the part that the leading one of those still possible must explain. Of several effects
    /// that together explain the rest of a channel, one explains at least their mean. If none does, the rest is outside the catalogue. An
    /// effect that improves one channel and worsens another explains nothing either. A residual up to the error of forms is not tested.
    fn explains_its_part(&self, larger: &Hypothesis, smaller: &Hypothesis) -> bool {
        let excess = |set: &Hypothesis| verdict::beyond_chance(set).map(|x| x.max(0.0)).collect::<Vec<f64>>();
        let (before, after) = (excess(smaller), excess(larger));
        let options = &self.data.options;
        if before.iter().all(|x| *x <= options.form_error()) {
            return true;
        }
        let room = options.most_effects.saturating_sub(smaller.effects().len()).max(1) as f64;
        let leads = before
            .iter()
            .zip(&after)
            .any(|(before, after)| (before - after) * room >= *before && before > after);
        leads && after.iter().sum::<f64>() < before.iter().sum()
    }

    /// Chooses whole numbers, such as an order, again for those effects of a set that are `asked`: they were chosen beside other effects. The
    /// numbers with the highest scores are refitted, and the one with most evidence stays.
    pub(super) fn renewed(&self, mut set: Validated, asked: &dyn Fn(EffectId) -> bool) -> Result<Validated> {
        let effects = set.fitted.effects();
        if set.excess() <= self.data.options.mismatch {
            return Ok(set);
        }
        let evidence = self.evidence();
        for effect in effects.iter().copied().filter(|e| asked(*e) && has_whole_number(*e)) {
            let Some((model, parameters, free)) = left_out(&set.fitted, effect) else { continue };
            self.monitor.go_on()?;
            let nuisances = set.fitted.nuisances.clone();
            let without = Hypothesis::on(self.data, model, parameters, free, nuisances);
            let prospects = Scorer::new(self.data, &without).leading(effect, REFITTED, self.monitor)?;
            let slot =
                set.fitted.model.slots().iter().find(|s| s.effect == effect).expect("it is in the set");
            let own = set.fitted.parameters[slot.parameters.clone()].to_vec();
            let same = |prospect: &&Prospect| {
                let each = effect.info().parameters.iter().zip(&own).zip(&prospect.start);
                each.filter(|((p, _), _)| p.role == Role::Fixed).all(|((_, a), b)| a == b)
            };
            // Where one number leads by far, no other is tried.
            let present = prospects.iter().find(same).map_or(0.0, |p| p.score);
            let rivals = |p: &&Prospect| !same(p) && p.score > RIVAL * present;
            let without = Validated { fitted: without, ..set.clone() };
            let asked: Vec<&Prospect> = prospects.iter().filter(rivals).collect();
            let tried: Vec<Option<Hypothesis>> =
                asked.par_iter().map(|prospect| self.refit(&without, prospect)).collect::<Result<_>>()?;
            for fitted in tried.into_iter().flatten() {
                if evidence.cost_on_recording(&fitted) < evidence.cost_on_recording(&set.fitted) {
                    set = Validated { fitted, held_out: Vec::new(), refuted: false };
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
        (parent, next): (&Validated, &Validated),
        larger: &Tried,
        cost: &dyn Fn(&Validated) -> f64,
    ) -> Vec<Prospect> {
        let as_fitted = |(prospect, set): &(Prospect, Option<Validated>)| {
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
    fn extended(&self, scorer: &Scorer, parent: &Validated, candidates: &[EffectId]) -> Result<Tried> {
        let score = |effect: &EffectId| scorer.score(*effect, self.monitor);
        let mut prospects: Vec<Prospect> = candidates.par_iter().map(score).collect::<Result<_>>()?;
        prospects.sort_by(|a, b| b.score.total_cmp(&a.score));
        // The leading effects of each side, and those with a score near theirs.
        let mut leading: Vec<EffectId> = Vec::new();
        for moves in [true, false] {
            let side =
                || prospects.iter().filter(|p| is_mechanical(p.effect) == moves && p.score > LEAST_SCORE);
            let top = side().next().map_or(0.0, |p| p.score);
            leading.extend(side().take(REFITTED).filter(|p| p.score >= RIVAL * top).map(|p| p.effect));
        }
        // Steps of an unknown load absorb a friction whose torque jumps at reversals, so that its score is small.
        if parent.fitted.nuisances.iter().any(|nuisance| nuisance.steps() > 0) {
            leading.extend(candidates.iter().filter(|effect| effect.jumps()));
        }
        let refit = |prospect: Prospect| -> Result<(Prospect, Option<Validated>)> {
            let asked = leading.contains(&prospect.effect);
            let set = if asked { self.refit(parent, &prospect)? } else { None };
            Ok((prospect, set.map(|fitted| Validated { fitted, held_out: Vec::new(), refuted: false })))
        };
        prospects.into_par_iter().map(refit).collect()
    }
}

/// Whether an effect has a whole number, such as an order, among its parameters.
pub(super) fn has_whole_number(effect: EffectId) -> bool {
    effect.info().parameters.iter().any(|p| p.role == Role::Fixed)
}

fn is_mechanical(effect: EffectId) -> bool {
    effect.info().site == Site::Mechanical
}

#[cfg(test)]
mod tests {
    use super::super::tests::{rich, search};
    use super::*;
    use crate::diagnose::testing::{self, choice, setup, speeds};
    use crate::monitor::Silent;

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
    fn a_swing_that_was_dropped_is_found_again_beside_what_hid_it() {
        let both = vec![choice("dead_time", "v_err", 4.0), choice("time_varying_load", "a", 0.2)];
        let (data, base) = testing::data(&setup(rich(), both));
        let search = search(&data);
        let (swing, dead_time) = (EffectId::TimeVaryingLoad, EffectId::DeadTime);
        let typical = dead_time.info().parameters.iter().map(|p| (p.typical)(&data.signals.context));
        let start: Vec<f64> = base.own().iter().copied().chain(typical).collect();
        let model = crate::model::Model::new(data.signals.context, &[dead_time]);
        let fitted = fitting::fit(&data, &model, &start, false, &Silent).unwrap();
        let without = Validated { fitted, held_out: Vec::new(), refuted: false };
        let evidence = search.evidence().limited(std::iter::once(&without));
        let absent = [EffectId::CoggingTorque, EffectId::QuadraticDrag, swing];
        let again = |set: &Validated| search.grown_again(set, &absent, &evidence).unwrap();
        let found = again(&without).expect("the swing is there");
        assert_eq!(found.fitted.effects(), [dead_time, swing]);
        assert!(found.excess() < data.options.mismatch, "{:?}", found.fitted.squares);
        let nothing_more = search.grown_again(&found, &absent[..2], &evidence).unwrap();
        assert!(nothing_more.is_none());
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
        let wrong = Validated { fitted, held_out: Vec::new(), refuted: false };
        assert!(wrong.excess() > data.options.mismatch && wrong.fitted.own()[order] == right / 3.0);
        let found = search(&data).renewed(wrong, &|_| true).unwrap();
        let slot = found.fitted.model.slots().iter().find(|s| s.effect == cogging).unwrap();
        assert_eq!(found.fitted.own()[slot.parameters.end - 1], right);
        assert!(found.excess() < data.options.mismatch, "{:?}", found.fitted.squares);
    }
}
