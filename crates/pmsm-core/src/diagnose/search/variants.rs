//! Sets beside the best one: without one of its effects, with a special case of it, or with another in its place.

use super::extend::Aim;
use super::refit::Claim;
use super::sets::{explains, is_set, same};
use super::smaller::{in_place, reduced, special_cases};
use super::{BRANCHES, Search};
use crate::diagnose::fitting;
use crate::diagnose::power::Shown;
use crate::diagnose::scale::{LEAST_GAIN, Scale};
use crate::diagnose::shortlist::Scorer;
use crate::diagnose::stated_load;
use crate::diagnose::verdict::Judged;
use crate::effect::Site;
use crate::effects::EffectId;
use crate::error::Result;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Look-alikes of the found effects refitted at most beside those that were tried anyway.
const LOOK_ALIKES: usize = 4;

/// Cosine to a found effect below which another one in its place would not explain enough of what is left without it to be worth a refit: a
/// little below the root of the least share.
const UNLIKE: f64 = 0.25;

/// A way to do with less than a set of effects.
struct Less {
    /// The effect that is taken out.
    gone: EffectId,
    /// What stands in its place, if anything: a special case of it.
    instead: Option<EffectId>,
}

impl Less {
    /// What is left of these effects.
    fn effects(&self, of: &[EffectId]) -> Vec<EffectId> {
        of.iter().copied().filter(|e| *e != self.gone).chain(self.instead).collect()
    }
}

/// A variant of the best set.
#[derive(Debug, Clone)]
pub struct Swap {
    /// The effect that was taken out.
    pub replaced: EffectId,
    /// What stands in its place, if anything.
    pub by: Option<EffectId>,
    /// The refitted set.
    pub judged: Judged,
}

impl Search<'_> {
    /// Drops effects that the others make superfluous.
    pub(super) fn pruned(&self, mut best: Judged, scale: &Scale, seen: &mut Vec<Judged>) -> Result<Judged> {
        'again: loop {
            let effects = best.fitted.effects();
            // What an effect has beyond a special case of it must be plain.
            let narrower = effects.iter().flat_map(|gone| {
                let instead = special_cases(*gone).filter(|e| !effects.contains(e));
                instead.map(|narrow| Less { gone: *gone, instead: Some(narrow) })
            });
            let fewer = effects.iter().map(|gone| Less { gone: *gone, instead: None });
            let ways: Vec<Less> = narrower.chain(fewer).collect();
            // What comes behind one that will do is not asked for.
            let done = AtomicUsize::new(ways.len());
            let try_one = |(k, way): (usize, &Less)| {
                if done.load(Ordering::Relaxed) < k {
                    return None;
                }
                let mut own = seen.clone();
                let will_do = self.will_do(&best, way, scale, &mut own);
                if matches!(will_do, Ok(Some(_))) {
                    done.fetch_min(k, Ordering::Relaxed);
                }
                let set = way.effects(&effects);
                let learned = own.into_iter().enumerate().filter(|(_, j)| is_set(&j.fitted.effects(), &set));
                Some((will_do, learned.collect::<Vec<_>>()))
            };
            let tried: Vec<_> = ways.par_iter().enumerate().map(try_one).collect();
            let known = seen.len();
            for (will_do, learned) in tried.into_iter().map_while(|x| x) {
                let will_do = will_do?;
                for (at, judged) in learned {
                    if at < known { seen[at] = judged } else { seen.push(judged) }
                }
                if let Some(simpler) = will_do {
                    best = simpler;
                    continue 'again;
                }
            }
            return Ok(best);
        }
    }

    /// The set with less, if it will do; the best fit of it is put among those `seen`.
    fn will_do(
        &self,
        best: &Judged,
        way: &Less,
        scale: &Scale,
        seen: &mut Vec<Judged>,
    ) -> Result<Option<Judged>> {
        if let Some(narrow) = way.instead {
            let simpler = self.narrowed(best, way.gone, narrow, seen)?;
            let mut simpler = self.sharpened(best, way.gone, narrow, simpler, scale, seen)?;
            if scale.widens(best, &simpler) {
                simpler = self.eased(best, simpler, scale)?;
            }
            return Ok((!scale.widens(best, &simpler)).then_some(simpler));
        }
        if let Some(fewer) = self.needless(best, way.gone, scale, seen)? {
            return Ok(Some(fewer));
        }
        let tried = seen.len();
        let mut fewer = self.without(best, way.gone, seen)?;
        if seen.len() == tried {
            fewer = self.fitted_here(best, way.gone, fewer, scale, seen)?;
        }
        let fewer = self.under_same_load(best, way.gone, fewer, scale, seen)?;
        let will_do = scale.loss(&fewer) < scale.loss(best) + LEAST_GAIN;
        let bare = || seen.iter().find(|j| j.fitted.effects().is_empty());
        // A load that is a little off may make up for what the others leave.
        let owed = || {
            bare().is_some_and(|bare| explains(&fewer, bare))
                && stated_load::accounts_for(self.data, &best.fitted, way.gone)
        };
        Ok((will_do || owed()).then_some(fewer))
    }

    /// The same set with a special case in place of one effect, refitted unless it was tried before.
    fn narrowed(
        &self,
        best: &Judged,
        wide: EffectId,
        narrow: EffectId,
        seen: &mut Vec<Judged>,
    ) -> Result<Judged> {
        let mut kept: Vec<EffectId> = best.fitted.effects();
        kept.retain(|e| *e != wide);
        if let Some(known) = seen.iter().find(|j| same(&j.fitted.effects(), &kept, narrow)) {
            return Ok(known.clone());
        }
        let (model, start) = in_place(&best.fitted, wide, narrow);
        let judged = self.judge(fitting::fit(self.data, &model, &start, false, self.monitor)?)?;
        seen.push(judged.clone());
        Ok(judged)
    }

    /// The same set without one effect, refitted unless it was tried before.
    fn without(&self, best: &Judged, drop: EffectId, seen: &mut Vec<Judged>) -> Result<Judged> {
        let kept: Vec<EffectId> = best.fitted.effects().into_iter().filter(|e| *e != drop).collect();
        if let Some(known) = seen.iter().find(|j| is_set(&j.fitted.effects(), &kept)) {
            return Ok(known.clone());
        }
        let (model, start) = reduced(&best.fitted, drop);
        let judged = self.judge(fitting::fit(self.data, &model, &start, false, self.monitor)?)?;
        seen.push(judged.clone());
        Ok(judged)
    }

    /// For each effect of the best set, the set without it and what other effects in its place achieve: of the sets `seen`, and of those
    /// that are grown from it, by what may be worth it as far as is `shown`, unless it is one of those which have `grown`.
    pub(super) fn swaps(
        &self,
        best: &Judged,
        base: &Judged,
        (able, shown): (&[EffectId], &[Shown]),
        (seen, grown): (&mut Vec<Judged>, &mut Vec<Vec<EffectId>>),
    ) -> Result<Vec<Swap>> {
        let effects = best.fitted.effects();
        let rest = self.rest(able, best);
        let beside = |effect: &EffectId| {
            if self.monitor.cancelled() {
                return None;
            }
            let mut own = seen.clone();
            let fewer = match self.without(best, *effect, &mut own) {
                Ok(fewer) => fewer,
                Err(error) => return Some(Err(error)),
            };
            let kept = fewer.fitted.effects();
            let tried = |e: &EffectId, own: &[Judged]| {
                own.iter().find(|j| same(&j.fitted.effects(), &kept, *e)).cloned()
            };
            let grows =
                !grown.iter().any(|set| is_set(set, &kept)) && !rest.iter().any(|e| tried(e, &own).is_some());
            if grows {
                let aim = Aim { base, best: Some(best), most: BRANCHES, thorough: true };
                let hopeless = |e: &EffectId| {
                    let plain = e.is_first_order() && !e.jumps();
                    plain && shown.iter().any(|s| s.effect == *e && s.cosine(*effect) < UNLIKE)
                };
                let rivals: Vec<EffectId> = rest.iter().copied().filter(|e| !hopeless(e)).collect();
                match self.extend(&fewer, &rivals, aim) {
                    Ok(extended) => own.extend(extended.into_iter().filter_map(|(_, j)| j)),
                    Err(error) => return Some(Err(error)),
                }
            }
            let rival =
                |e: &EffectId| Some(Swap { replaced: *effect, by: Some(*e), judged: tried(e, &own)? });
            let mut swaps: Vec<Swap> = rest.iter().filter_map(rival).collect();
            swaps.push(Swap { replaced: *effect, by: None, judged: fewer });
            Some(Ok((swaps, own.split_off(seen.len()), grows.then_some(kept))))
        };
        let all: Vec<_> = effects.par_iter().map(beside).collect();
        let mut out = Vec::new();
        for one in all.into_iter().map_while(|x| x) {
            let (swaps, new, kept) = one?;
            out.extend(swaps);
            seen.extend(new);
            grown.extend(kept);
        }
        Ok(out)
    }

    /// Refits what first-order analysis cannot tell from an effect of the best set and was not tried in its place.
    pub(super) fn look_alikes(&self, best: &Judged, shown: &[Shown], swaps: &mut Vec<Swap>) -> Result<()> {
        let mut rest = LOOK_ALIKES;
        for found in best.fitted.effects() {
            let fewer =
                swaps.iter().find(|s| s.replaced == found && s.by.is_none()).map(|s| s.judged.clone());
            let Some(fewer) = fewer else { continue };
            for rival in shown.iter().filter(|s| s.resembles(found)).map(|s| s.effect) {
                let tried = swaps.iter().any(|s| s.replaced == found && s.by == Some(rival));
                if tried || rest == 0 || self.monitor.cancelled() {
                    continue;
                }
                rest -= 1;
                let claim = Claim::Beside(best);
                if rival.info().site == Site::Mechanical && self.rotor_is_lost(&fewer, claim)? {
                    continue;
                }
                let prospect = Scorer::new(self.data, &fewer.fitted).score(rival);
                if let Some(judged) = self.refit(&fewer, &prospect, None, claim)? {
                    swaps.push(Swap { replaced: found, by: Some(rival), judged });
                }
            }
        }
        Ok(())
    }
}

/// The most likely of the sets with another effect in place of one of `best`, if one beats it. What only generalises an effect of it has
/// been asked for before.
pub(super) fn preferred(best: &Judged, swaps: &[Swap], scale: &Scale) -> Option<Judged> {
    let rivals = swaps.iter().filter(|swap| {
        swap.by.is_some_and(|by| !by.contains(swap.replaced)) && scale.beats(&swap.judged, best)
    });
    rivals.map(|s| &s.judged).min_by(|a, b| scale.loss(a).total_cmp(&scale.loss(b))).cloned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::hypothesis::Hypothesis;
    use crate::effects::testing::CX;
    use crate::experiment::Channel;
    use crate::model::Model;

    #[test]
    fn a_rival_that_the_recordings_prefer_is_taken_unless_it_is_only_wider() {
        let judged = |effects: &[EffectId], square: f64| {
            let mut fitted = Hypothesis::bare(Model::new(CX, effects), Vec::new());
            (fitted.squares, fitted.samples) = (vec![(Channel::OmegaE, square)], vec![200.0]);
            fitted.chance = vec![0.0];
            Judged { fitted, held_out: Vec::new(), refuted: false }
        };
        let (coulomb, swing) = (EffectId::CoulombFriction, EffectId::TimeVaryingLoad);
        let (stribeck, directional) = (EffectId::StribeckFriction, EffectId::AsymmetricFriction);
        let best = judged(&[swing, coulomb], 1.12);
        let chosen = |square: f64| {
            let swap = |replaced, by, with: &[EffectId], square| Swap {
                replaced,
                by: Some(by),
                judged: judged(with, square),
            };
            let swaps = [
                swap(coulomb, stribeck, &[swing, stribeck], 1.0),
                swap(swing, directional, &[coulomb, directional], square),
            ];
            let scale = Scale::new(std::iter::once(&best).chain(swaps.iter().map(|s| &s.judged)));
            preferred(&best, &swaps, &scale).map(|j| j.fitted.effects())
        };
        assert_eq!(chosen(1.02), Some(vec![coulomb, directional]));
        assert_eq!(chosen(1.11), None);
    }
}
