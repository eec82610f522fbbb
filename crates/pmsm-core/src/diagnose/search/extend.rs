//! One effect more beside a set: which are worth a refit, and which of those a whole one.

use super::refit::Claim;
use super::sets::{explains, least_beside, mismatched_by};
use super::{MOSTLY, Search};
use crate::diagnose::shortlist::{Prospect, Scorer};
use crate::diagnose::verdict::{Judged, MISMATCH, PROGRESS, UNEXPLAINED};
use crate::effect::{Role, Site};
use crate::effects::{self, EffectId};
use crate::error::Result;
use crate::experiment::Channel;
use rayon::prelude::*;

/// Effects whose first-order score (mean square in units of what is left) is below this are not refitted.
const LEAST_SCORE: f64 = 0.002;
/// The same where the bare machine leaves no mismatch, only what a load or noise may hide.
const LEAST_HIDDEN: f64 = 0.1;
/// Of single effects, none is that scores less than this share of the best: it is no rival to it, and what it may explain beside it is
/// seen when pairs are grown.
const RIVAL: f64 = 0.05;
/// Effects that score this share of the best are refitted first. Where one of them explains the recordings, the others only have to
/// show that they are no rivals to it.
const LEADING: f64 = 0.5;

/// Share of the motion's mean square that one of all the effects which move the rotor may explain by chance.
const BY_CHANCE: f64 = 0.1;

/// What an extension is for.
#[derive(Clone, Copy)]
pub(super) struct Aim<'a> {
    /// The bare machine.
    pub(super) base: &'a Judged,
    /// The set that the new ones must not fall far behind, if there is one already.
    pub(super) best: Option<&'a Judged>,
    /// Effects refitted at most.
    pub(super) most: usize,
    /// Whether those whose score tells little are refitted, too, if the set does not explain the motion.
    pub(super) thorough: bool,
}

/// The number of a prospect, and where its first fit to the currents has led.
type Begun = (usize, Vec<f64>);

/// Numbers of prospects that are worth a refit.
struct Chosen {
    /// By their score.
    worth: Vec<usize>,
    /// Those of whose motion it tells little, while much of that is not explained.
    dim: Vec<usize>,
    /// The others that score best of their site: what they explain may show once something else is found. They are no rivals to what
    /// explains the recordings.
    faint: Vec<usize>,
}

impl Search<'_> {
    /// Scores `candidates` on top of `parent` and refits the best, in parallel.
    pub(super) fn extend(
        &self,
        parent: &Judged,
        candidates: &[EffectId],
        aim: Aim,
    ) -> Result<Vec<(Prospect, Option<Judged>)>> {
        let scorer = Scorer::new(self.data, &parent.fitted);
        let claim = aim.best.map_or(Claim::Open, Claim::Beside);
        let rotor_is_lost = self.rotor_is_lost(parent, claim)?;
        let able = |e: &EffectId| !(rotor_is_lost && mechanical(*e));
        let effects: Vec<EffectId> = candidates.iter().copied().filter(able).collect();
        let (mut prospects, postponed) = self.scored(&scorer, parent, &effects, aim);
        let mut chosen = self.chosen(parent, &prospects, aim);
        let top = highest(&prospects);
        let leads = |k: &usize| aim.best.is_none() && prospects[*k].score >= LEADING * top;
        let (first, second): (Vec<usize>, Vec<usize>) = chosen.worth.iter().copied().partition(leads);
        let first = long_ones_first(first, |k| length(effects[*k]));

        let mut judged: Vec<Option<Judged>> = vec![None; prospects.len()];
        // What is refitted in any case can begin meanwhile.
        let ahead: &[usize] = if first.is_empty() { &[] } else { &second };
        let (leading, begun) = rayon::join(
            || self.refit_each(parent, &prospects, &first, &[], claim),
            || self.begin_each(parent, &prospects, ahead),
        );
        let begun = begun?;
        for (k, one) in first.iter().zip(leading?) {
            judged[*k] = one;
        }
        let least = |a: &&Judged, b: &&Judged| a.excess().total_cmp(&b.excess());
        let done = judged.iter().flatten().filter(|j| explains(j, aim.base)).min_by(least).cloned();
        let ahead = judged.iter().flatten().min_by(least).cloned();
        let claim = match (aim.best, &done, &ahead) {
            (None, Some(done), _) => Claim::Outdone(done),
            (None, None, Some(ahead)) => Claim::Behind(ahead),
            _ => claim,
        };
        let waits = match (claim, &ahead) {
            (Claim::Behind(_), Some(ahead)) => self.rotor_waits(parent, ahead),
            _ => false,
        };
        let moving = |k: &usize| mechanical(effects[*k]);
        let asked = |chosen: &Chosen| {
            let mut asked = chosen.worth.clone();
            asked.retain(|k| !first.contains(k));
            if matches!(claim, Claim::Open | Claim::Behind(_)) {
                asked.extend(&chosen.faint);
            }
            if ahead.as_ref().is_none_or(|ahead| ahead.excess() > MOSTLY * parent.excess()) {
                asked.extend(&chosen.dim);
            }
            asked.sort_unstable();
            asked
        };
        let mut second = asked(&chosen);
        let asks = if postponed { (0..effects.len()).any(|k| moving(&k)) } else { second.iter().any(moving) };
        if asks && (waits || self.rotor_is_lost(parent, claim)?) {
            second.retain(|k| !moving(k));
        } else if postponed {
            self.score(&scorer, &mut prospects, mechanical);
            chosen = self.chosen(parent, &prospects, aim);
            second = asked(&chosen);
        }
        let second = long_ones_first(second, |k| length(effects[*k]));
        for (k, one) in second.iter().zip(self.refit_each(parent, &prospects, &second, &begun, claim)?) {
            judged[*k] = one;
        }
        Ok(prospects.into_iter().zip(judged).collect())
    }

    /// Refits those of the `prospects` that have these numbers, in parallel, from where they have `begun`.
    fn refit_each(
        &self,
        parent: &Judged,
        prospects: &[Prospect],
        numbers: &[usize],
        begun: &[Begun],
        claim: Claim,
    ) -> Result<Vec<Option<Judged>>> {
        let refit = |k: &usize| {
            if self.monitor.cancelled() {
                return Ok(None);
            }
            let begun = begun.iter().find(|(begun, _)| begun == k);
            self.refit(parent, &prospects[*k], begun.map(|(_, at)| &at[..]), claim)
        };
        numbers.par_iter().map(refit).collect()
    }

    /// Begins with the refits of those of the `prospects` that have these numbers, in parallel.
    fn begin_each(&self, parent: &Judged, prospects: &[Prospect], numbers: &[usize]) -> Result<Vec<Begun>> {
        let begin = |k: &usize| {
            if self.monitor.cancelled() {
                return Ok(None);
            }
            Ok(self.begin(parent, &prospects[*k])?.map(|at| (*k, at)))
        };
        let begun: Result<Vec<Option<Begun>>> = numbers.par_iter().map(begin).collect();
        Ok(begun?.into_iter().flatten().collect())
    }

    /// The `effects` scored on top of `parent`, but for those that move the rotor where that is postponed: none of them can lead where one of
    /// the currents' explains more than all the motion leaves, and it may turn out that they are lost, or wait, and need no score.
    fn scored(
        &self,
        scorer: &Scorer,
        parent: &Judged,
        effects: &[EffectId],
        aim: Aim,
    ) -> (Vec<Prospect>, bool) {
        let context = parent.fitted.model.context();
        let mut prospects: Vec<Prospect> = effects.iter().map(|e| Prospect::nothing(*e, context)).collect();
        let in_motion = self.left_of_motion(parent);
        let outdone = |score: f64| aim.best.is_none() && score > in_motion + BY_CHANCE;
        if outdone(left_of_currents(parent) + in_motion) {
            self.score(scorer, &mut prospects, |e| !mechanical(e));
            if outdone(highest(&prospects)) {
                return (prospects, true);
            }
            self.score(scorer, &mut prospects, mechanical);
        } else {
            self.score(scorer, &mut prospects, |_| true);
        }
        (prospects, false)
    }

    /// Scores those of the `prospects` that are `wanted`, in parallel.
    fn score(&self, scorer: &Scorer, prospects: &mut [Prospect], wanted: impl Fn(EffectId) -> bool + Sync) {
        let asked = prospects.par_iter_mut().filter(|p| wanted(p.effect) && !self.monitor.cancelled());
        asked.for_each(|prospect| *prospect = scorer.score(prospect.effect));
    }

    /// Share of the speed's mean square, on the recording on which it is largest, that is no noise, as far as that is known.
    fn left_of_motion(&self, parent: &Judged) -> f64 {
        if self.data.runs().iter().any(|run| run.wander().is_some()) {
            return 1.0;
        }
        let speeds = parent.fitted.squares.iter().filter(|(channel, _)| !channel.is_electrical());
        speeds.map(|(_, square)| beyond_noise(*square)).fold(0.0, f64::max)
    }

    /// Which of the `prospects` are worth a refit.
    fn chosen(&self, parent: &Judged, prospects: &[Prospect], aim: Aim) -> Chosen {
        let mut order: Vec<usize> = (0..prospects.len()).collect();
        order.sort_by(|a, b| prospects[*b].score.total_cmp(&prospects[*a].score));
        let beside = !parent.fitted.effects().is_empty();
        let least = if beside {
            least_beside(parent).max(LEAST_SCORE)
        } else {
            let best = prospects.iter().map(|p| p.score).fold(0.0, f64::max);
            (RIVAL * best).max(if mismatched_by(parent, 1.0) { LEAST_SCORE } else { LEAST_HIDDEN })
        };
        let shaken = aim.thorough && parent.fitted.square(Channel::OmegaE) > 1.0 + MISMATCH;
        let reversing = self.steps_reverse(parent);
        // What the voltages leave may look like much in the motion: beside other effects the best of each site is tried.
        let site = |k: usize| prospects[k].effect.info().site;
        let first_of_site = |k: usize| beside && order.iter().find(|o| site(**o) == site(k)) == Some(&k);
        let worth = |k: &usize| {
            let (effect, score) = (prospects[*k].effect, prospects[*k].score);
            let top = score > least && order.iter().take(aim.most).any(|o| o == k);
            top || (effect.jumps() && reversing)
        };
        let (worth, rest): (Vec<usize>, Vec<usize>) = (0..prospects.len()).partition(worth);
        let dim = |k: &usize| shaken && !prospects[*k].effect.is_first_order();
        let (dim, rest): (Vec<usize>, Vec<usize>) = rest.into_iter().partition(dim);
        let faint = |k: &usize| first_of_site(*k) && prospects[*k].score > LEAST_SCORE;
        Chosen { worth, dim, faint: rest.into_iter().filter(faint).collect() }
    }

    /// Of the `extended` sets those whose new effect only refines another one, with that one beside it: neither may be worth much without
    /// the other.
    pub(super) fn refined(
        &self,
        parent: &Judged,
        extended: &[(Prospect, Option<Judged>)],
    ) -> Result<Vec<Judged>> {
        let mut out = Vec::new();
        for (prospect, judged) in extended {
            let (Some(judged), Some(plain)) = (judged, prospect.effect.refines()) else { continue };
            let plain =
                effects::ALL.iter().copied().find(|e| e.id() == plain).expect("it is in the catalogue");
            let effects = judged.fitted.effects();
            let room = effects.len() < self.most && !effects.contains(&plain);
            if room && judged.excess() > UNEXPLAINED.1 && judged.excess() < PROGRESS * parent.excess() {
                let prospect = Scorer::new(self.data, &judged.fitted).score(plain);
                out.extend(self.refit(judged, &prospect, None, Claim::Open)?);
            }
        }
        Ok(out)
    }
}

fn mechanical(effect: EffectId) -> bool {
    effect.info().site == Site::Mechanical
}

fn highest(prospects: &[Prospect]) -> f64 {
    prospects.iter().map(|p| p.score).fold(0.0, f64::max)
}

/// Shares of the currents' mean squares that are no noise, summed over the channels of all recordings.
fn left_of_currents(parent: &Judged) -> f64 {
    let currents = parent.fitted.squares.iter().filter(|(channel, _)| channel.is_electrical());
    currents.map(|(_, square)| beyond_noise(*square)).sum()
}

/// Share of a mean square, in units of the floor's, that is no noise.
fn beyond_noise(square: f64) -> f64 {
    1.0 - 1.0 / square.max(1.0)
}

/// How long a refit may take, beside others: with states of the rotor far longer, and with each shape that may call for a second start.
fn length(effect: EffectId) -> usize {
    let shapes = effect.info().parameters.iter().filter(|p| p.role == Role::Shape).count();
    4 * effect.mechanical_state_count() + shapes
}

/// Tasks in the order in which two threads that halve the list begin with the longest.
fn long_ones_first<T: Copy>(mut tasks: Vec<T>, length: impl Fn(&T) -> usize) -> Vec<T> {
    tasks.sort_by_key(|task| std::cmp::Reverse(length(task)));
    let every_other = |from: usize| tasks.iter().copied().skip(from).step_by(2);
    every_other(1).chain(every_other(0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::drive::Choice;
    use crate::monitor::Silent;

    /// Those of these effects that are refitted beside the bare machine of a recording with `present`.
    fn refitted(present: Vec<Choice>, effects: &[EffectId]) -> Vec<EffectId> {
        let path: Vec<(f64, f64)> =
            (0..8).map(|k| (0.05 + 0.2 * f64::from(k), [110.0, -90.0][k as usize % 2])).collect();
        let (data, base) = data(&setup(speeds(1.6, &path), present));
        let base = Judged { fitted: base, held_out: Vec::new(), refuted: false };
        let search =
            Search { data: &data, held_out: Vec::new(), refuting: Vec::new(), most: 3, monitor: &Silent };
        let aim = Aim { base: &base, best: None, most: effects.len(), thorough: true };
        let singles = search.extend(&base, effects, aim).unwrap();
        singles.iter().filter(|(_, judged)| judged.is_some()).map(|(prospect, _)| prospect.effect).collect()
    }

    #[test]
    fn each_half_of_the_tasks_begins_with_its_longest() {
        let sorted = |tasks: &[usize]| long_ones_first(tasks.to_vec(), |task| *task);
        assert_eq!(sorted(&[1, 5, 2, 4, 3]), [4, 2, 5, 3, 1]);
        assert_eq!(sorted(&[1, 2]), [1, 2]);
        assert_eq!((sorted(&[7]), sorted(&[])), (vec![7], vec![]));
        assert!(length(EffectId::TwoMassShaft) > length(EffectId::StribeckFriction));
        assert!(length(EffectId::StribeckFriction) > length(EffectId::QuadraticDrag));
    }

    #[test]
    fn a_shaft_is_taken_up_where_it_is_there_and_not_where_friction_explains_all() {
        let effects = [EffectId::CoulombFriction, EffectId::TwoMassShaft];
        let shaft = [("inertia_ratio", 0.4), ("f_antires", 25.0), ("zeta", 0.02)];
        let shaft = shaft.map(|(name, value)| (name.to_string(), value)).into();
        let shaft = Choice { effect: "two_mass_shaft".into(), parameters: shaft };
        assert_eq!(refitted(vec![choice("coulomb_friction", "tau_c", 0.5)], &effects), effects[..1]);
        assert!(refitted(vec![shaft], &effects).contains(&EffectId::TwoMassShaft));
    }

    #[test]
    fn what_moves_the_rotor_is_scored_at_once_where_it_might_lead() {
        let path: Vec<(f64, f64)> =
            (0..8).map(|k| (0.05 + 0.2 * f64::from(k), [110.0, -90.0][k as usize % 2])).collect();
        let scored = |present: Vec<Choice>| {
            let (data, base) = data(&setup(speeds(1.6, &path), present));
            let base = Judged { fitted: base, held_out: Vec::new(), refuted: false };
            let search =
                Search { data: &data, held_out: Vec::new(), refuting: Vec::new(), most: 3, monitor: &Silent };
            let aim = Aim { base: &base, best: None, most: 3, thorough: true };
            let effects = [EffectId::CoulombFriction, EffectId::DeadTime];
            let (prospects, postponed) =
                search.scored(&Scorer::new(&data, &base.fitted), &base, &effects, aim);
            (prospects[0].score > 0.1, prospects[1].score > 0.1, postponed)
        };
        assert_eq!(scored(vec![choice("dead_time", "v_err", 1.0)]), (false, true, true));
        assert_eq!(scored(vec![choice("coulomb_friction", "tau_c", 0.5)]), (true, false, false));
    }

    #[test]
    fn what_refines_an_effect_is_tried_with_it_unless_next_to_nothing_is_left() {
        let asymmetric = EffectId::AsymmetricFriction;
        let refined = |tau_c: f64| {
            let manoeuvre = speeds(1.0, &[(0.1, 90.0), (0.3, -80.0), (0.5, 60.0), (0.7, -60.0), (0.9, 80.0)]);
            let both = vec![
                choice("coulomb_friction", "tau_c", tau_c),
                choice("asymmetric_friction", "tau_a", 0.04),
            ];
            let (data, base) = data(&setup(manoeuvre, both));
            let judged = |fitted| Judged { fitted, held_out: Vec::new(), refuted: false };
            let (alone, base) = (judged(fitted(&data, &base, asymmetric)), judged(base));
            let search =
                Search { data: &data, held_out: Vec::new(), refuting: Vec::new(), most: 3, monitor: &Silent };
            let prospect = Prospect { effect: asymmetric, start: Vec::new(), score: 1.0 };
            let sets = search.refined(&base, &[(prospect, Some(alone.clone()))]).unwrap();
            (alone.excess(), sets.iter().map(|j| j.fitted.effects()).collect::<Vec<_>>())
        };
        let (left, sets) = refined(0.0175);
        assert!(left > UNEXPLAINED.1 && left < MISMATCH, "{left}");
        assert_eq!(sets, [[asymmetric, EffectId::CoulombFriction]]);
        let (left, sets) = refined(0.0);
        assert!(left < UNEXPLAINED.1 && sets.is_empty(), "{left}");
    }
}
