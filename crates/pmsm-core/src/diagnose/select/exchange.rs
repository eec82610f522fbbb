//! Sets beside the best one: without one of its effects, or with another in its place.

use super::Search;
use super::grow::has_whole_number;
use super::subset::{in_place, reduced, special_cases};
use crate::diagnose::evidence::Evidence;
use crate::diagnose::fitting;
use crate::diagnose::power::{OfEach, Shown};
use crate::diagnose::score::Scorer;
use crate::diagnose::stated_load;
use crate::diagnose::verdict::Validated;
use crate::effect::Site;
use crate::effects::EffectId;
use crate::error::Result;
use rayon::prelude::*;

/// Nats by which a refit may improve a rival over its first-order gain.
const FIRST_ORDER: f64 = 20.0;
/// Nats to first order from which an effect is needed, whatever a refit without it could make up for.
const SURE: f64 = 60.0;
/// Multiple of the remaining excess from which an effect explains more than errors in the forms of the others.
const COMPARABLE: f64 = 3.0;
/// Rivals of one effect that are refitted in its place.
const RIVALS: usize = 2;

/// Whether an effect may do what `gone` did once another whole number, such as an order, is chosen for it.
fn may_replace(effect: EffectId, gone: EffectId) -> bool {
    effect != gone && gone.info().look_alikes.contains(&effect.id()) && has_whole_number(effect)
}

/// A variant of the best set.
#[derive(Debug, Clone)]
pub struct Swap {
    /// The effect that was taken out.
    pub replaced: EffectId,
    /// What is in its place, if anything.
    pub by: Option<EffectId>,
    /// The refitted set.
    pub validated: Validated,
}

impl Search<'_> {
    /// A simpler set with more evidence, if there is one: without an effect, or with a special case of it. An effect is not tested if its
    /// first-order gain `worth`, nats, is large and it explains many times the remaining excess, by the factor `over`.
    pub(super) fn simpler(
        &self,
        best: &Validated,
        (worth, over): (&OfEach, &OfEach),
        evidence: &Evidence,
        seen: &mut Vec<Validated>,
    ) -> Result<Option<Validated>> {
        let effects = best.fitted.effects();
        let of_load = |e: &&EffectId| stated_load::accounts_for(self.data, &best.fitted, **e);
        if let Some(gone) = effects.iter().find(of_load) {
            // A stated load is known to a share of its value: within that it is as likely to be off, and no effect is called for.
            return Ok(self.each(best, &[(*gone, None)], seen)?.pop());
        }
        let comparable = |effect: EffectId| over.iter().any(|(e, times)| *e == effect && *times < COMPARABLE);
        let asked = |(effect, nats): &&(EffectId, f64)| {
            let replaced = effects.iter().any(|other| may_replace(*other, *effect));
            *nats < SURE || replaced || self.wanders(*effect) || comparable(*effect)
        };
        let weak = worth.iter().filter(asked);
        let weak = weak.map(|(e, _)| (*e, None));
        let narrower = effects.iter().flat_map(|gone| {
            let instead = special_cases(*gone).filter(|e| !effects.contains(e));
            instead.map(|narrow| (*gone, Some(narrow)))
        });
        let ways: Vec<(EffectId, Option<EffectId>)> = weak.chain(narrower).collect();
        let tried = self.each(best, &ways, seen)?;
        let needless = |simpler: &Validated| {
            !evidence.prefers(best, simpler) || !evidence.more_than_remains(best, simpler)
        };
        let simpler = tried.into_iter().filter(needless);
        Ok(simpler.min_by(|a, b| evidence.cost(a).total_cmp(&evidence.cost(b))))
    }

    /// Whether an effect acts on a speed with driven noise. The first-order gain does not filter that noise and counts it for the effect.
    fn wanders(&self, effect: EffectId) -> bool {
        effect.info().site == Site::Mechanical && self.data.runs().iter().any(|run| run.wander().is_some())
    }

    /// The sets in which one effect is taken out of `best`, with another in its place if one is given, as fitted before or now. What may do
    /// the same with another whole number is fitted with that.
    fn each(
        &self,
        best: &Validated,
        ways: &[(EffectId, Option<EffectId>)],
        seen: &mut Vec<Validated>,
    ) -> Result<Vec<Validated>> {
        let one = |(gone, instead): &(EffectId, Option<EffectId>)| -> Result<(Validated, bool)> {
            self.monitor.go_on()?;
            let wanted: Vec<EffectId> =
                best.fitted.effects().into_iter().filter(|e| e != gone).chain(*instead).collect();
            let renewed = wanted.iter().any(|other| may_replace(*other, *gone));
            if let Some(known) = self.known(seen, &wanted).filter(|_| !renewed) {
                return Ok((known.clone(), false));
            }
            let (model, start) = match instead {
                Some(narrow) => in_place(&best.fitted, *gone, *narrow),
                None => reduced(&best.fitted, *gone),
            };
            let mut fitted = fitting::fit(self.data, &model, &start, false, self.monitor)?;
            if renewed {
                let set = Validated { fitted, held_out: Vec::new(), refuted: false };
                fitted = self.renewed(set, &|other| may_replace(other, *gone))?.fitted;
            }
            Ok((self.validate(fitted)?, true))
        };
        let all: Vec<(Validated, bool)> = ways.par_iter().map(one).collect::<Result<_>>()?;
        seen.extend(all.iter().filter(|(_, new)| *new).map(|(set, _)| set.clone()));
        Ok(all.into_iter().map(|(set, _)| set).collect())
    }

    /// A set of these effects that was fitted and held against all recordings.
    fn known<'s>(&self, seen: &'s [Validated], wanted: &[EffectId]) -> Option<&'s Validated> {
        let mut whole = seen.iter().filter(|set| set.held_out.len() == self.held_out.len());
        whole.rfind(|set| is_set(&set.fitted.effects(), wanted))
    }

    /// Sets beside the best one that may have as much evidence to first order: without one of its effects, or with another in its place.
    /// An effect that explains less than what remains beside a further cause gets no name, and no other is tried in its place.
    pub(super) fn exchange(
        &self,
        best: &Validated,
        (worth, over): (&OfEach, &OfEach),
        shown: &[Shown],
        seen: &mut Vec<Validated>,
    ) -> Result<Vec<Swap>> {
        let unexplained = best.excess() > self.data.options.mismatch;
        let loses = |s: &Shown, found: EffectId, nats: f64| nats * (1.0 - s.cosine(found).powi(2));
        // Beside a remainder another curve of friction may be the right one, whatever it gains to first order.
        let other_curve = |s: &Shown, found: EffectId| unexplained && found.jumps() && s.effect.jumps();
        let open = |found: EffectId, nats: f64| {
            let rival = |s: &Shown| loses(s, found, nats) < FIRST_ORDER || other_curve(s, found);
            nats < SURE || shown.iter().any(rival)
        };
        let explained = best.excess() <= self.data.options.form_error();
        let least = self.data.options.beside_remainder;
        let named =
            |effect: EffectId| explained || over.iter().any(|(e, times)| *e == effect && *times >= least);
        let asked: Vec<(EffectId, f64)> =
            worth.iter().copied().filter(|(e, nats)| named(*e) && open(*e, *nats)).collect();
        let ways: Vec<(EffectId, Option<EffectId>)> = asked.iter().map(|(e, _)| (*e, None)).collect();
        let without = self.each(best, &ways, seen)?;
        let mut out: Vec<Swap> = Vec::new();
        let mut tasks = Vec::new();
        for ((replaced, nats), fewer) in asked.iter().zip(&without) {
            out.push(Swap { replaced: *replaced, by: None, validated: fewer.clone() });
            let loses = |s: &Shown| loses(s, *replaced, *nats);
            let mut rivals: Vec<&Shown> = shown.iter().filter(|s| loses(s) < FIRST_ORDER).collect();
            rivals.sort_by(|a, b| loses(a).total_cmp(&loses(b)));
            rivals.truncate(RIVALS);
            let curves = shown.iter().filter(|s| other_curve(s, *replaced));
            let curves: Vec<&Shown> =
                curves.filter(|s| rivals.iter().all(|rival| rival.effect != s.effect)).collect();
            tasks.extend(rivals.into_iter().chain(curves).map(|s| (*replaced, s.effect, fewer)));
        }
        let refit = |(replaced, by, fewer): &(EffectId, EffectId, &Validated)| -> Result<Option<Swap>> {
            let mut wanted = fewer.fitted.effects();
            wanted.push(*by);
            self.monitor.go_on()?;
            let validated = match self.known(seen, &wanted) {
                Some(known) => Some(known.clone()),
                None => {
                    let prospect = Scorer::new(self.data, &fewer.fitted).score(*by, self.monitor)?;
                    self.refit(fewer, &prospect)?.map(|fitted| self.validate(fitted)).transpose()?
                }
            };
            Ok(validated.map(|validated| Swap { replaced: *replaced, by: Some(*by), validated }))
        };
        let swaps: Result<Vec<Option<Swap>>> = tasks.par_iter().map(refit).collect();
        let swaps: Vec<Swap> = swaps?.into_iter().flatten().collect();
        seen.extend(swaps.iter().map(|s| s.validated.clone()));
        out.extend(swaps);
        Ok(out)
    }
}

/// Whether both hold the same effects.
pub(super) fn is_set(a: &[EffectId], b: &[EffectId]) -> bool {
    a.len() == b.len() && a.iter().all(|e| b.contains(e))
}

#[cfg(test)]
mod tests {
    use super::super::tests::search;
    use super::*;
    use crate::diagnose::data::Data;
    use crate::diagnose::hypothesis::Hypothesis;
    use crate::diagnose::power::Traces;
    use crate::diagnose::testing::{choice, data, setup, speeds};
    use crate::drive::{Choice, Manoeuvre, Schedule};
    use crate::model::Model;
    use crate::monitor::Silent;

    fn reversing() -> Manoeuvre {
        speeds(1.0, &[(0.1, 90.0), (0.3, -80.0), (0.5, 60.0), (0.7, -60.0), (0.9, 80.0)])
    }

    /// A fitted set of these effects, from their typical strengths.
    fn set(data: &Data, base: &Hypothesis, effects: &[EffectId]) -> Validated {
        let context = data.signals.context;
        let typical = effects.iter().flat_map(|e| e.info().parameters).map(|p| (p.typical)(&context));
        let start: Vec<f64> = base.own().iter().copied().chain(typical).collect();
        let fitted = fitting::fit(data, &Model::new(context, effects), &start, false, &Silent).unwrap();
        Validated { fitted, held_out: Vec::new(), refuted: false }
    }

    /// The effects of the simpler set that is preferred to the set `of` these effects, if one is.
    fn simpler(manoeuvre: Manoeuvre, present: Vec<Choice>, of: &[EffectId]) -> Option<Vec<EffectId>> {
        let (data, base) = data(&setup(manoeuvre, present));
        let search = search(&data);
        let best = set(&data, &base, of);
        let evidence = search.evidence();
        let worth = Traces::new(&data, &best.fitted).worth(evidence.samples());
        let simpler = search.simpler(&best, (&worth, &[]), &evidence, &mut Vec::new()).unwrap();
        simpler.map(|set| set.fitted.effects())
    }

    #[test]
    fn an_effect_that_the_others_make_superfluous_is_dropped_and_one_that_is_needed_is_not() {
        let (dry, drag) = (EffectId::CoulombFriction, EffectId::QuadraticDrag);
        let friction = || vec![choice("coulomb_friction", "tau_c", 0.3)];
        assert_eq!(simpler(reversing(), friction(), &[dry, drag]), Some(vec![dry]));
        assert_eq!(simpler(reversing(), friction(), &[dry]), None);
    }

    #[test]
    fn a_special_case_takes_the_place_of_a_wider_effect() {
        let friction = vec![choice("coulomb_friction", "tau_c", 0.3)];
        let narrower = simpler(reversing(), friction, &[EffectId::StribeckFriction]);
        assert_eq!(narrower, Some(vec![EffectId::CoulombFriction]));
    }

    #[test]
    fn no_rival_is_tried_for_an_effect_that_explains_less_than_remains() {
        let friction = vec![choice("coulomb_friction", "tau_c", 0.3)];
        let (data, base) = data(&setup(reversing(), friction));
        let dry = EffectId::CoulombFriction;
        let mut best = set(&data, &base, &[dry]);
        let search = search(&data);
        let tried = |best: &Validated, times: f64| {
            let (worth, over) = (vec![(dry, 0.5 * SURE)], vec![(dry, times)]);
            search.exchange(best, (&worth, &over), &[], &mut Vec::new()).unwrap().len()
        };
        assert_eq!(tried(&best, 0.5), 1);
        best.fitted.squares.iter_mut().for_each(|(_, square)| *square = 100.0);
        assert_eq!((tried(&best, 0.5), tried(&best, 2.0)), (0, 1));
    }

    #[test]
    fn what_a_stated_load_may_be_off_by_is_no_friction() {
        let dropped = |tau_a: f64| {
            let mut manoeuvre = speeds(0.6, &[(0.05, 50.0), (0.2, -40.0), (0.35, 60.0), (0.5, -30.0)]);
            manoeuvre.tau_load = Some(Schedule::constant(5.0).unwrap());
            manoeuvre.load_kind = Some("known_constant".into());
            let present = vec![choice("asymmetric_friction", "tau_a", tau_a)];
            simpler(manoeuvre, present, &[EffectId::AsymmetricFriction])
        };
        assert_eq!(dropped(0.003), Some(Vec::new()));
        assert_eq!(dropped(0.1), None);
    }
}
