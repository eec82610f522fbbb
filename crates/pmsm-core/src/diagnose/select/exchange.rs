//! Sets beside the best one: without one of its effects, or with another in its place.

use super::Search;
use super::subset::{in_place, reduced, special_cases};
use crate::diagnose::fitting;
use crate::diagnose::power::Shown;
use crate::diagnose::shortlist::Scorer;
use crate::diagnose::verdict::Judged;
use crate::effects::EffectId;
use crate::error::Result;
use rayon::prelude::*;

/// To first order a rival may lose this many nats more than it does once refitted.
const FIRST_ORDER: f64 = 20.0;
/// Rivals of one effect that are refitted in its place.
const RIVALS: usize = 2;

/// A variant of the best set.
#[derive(Debug, Clone)]
pub struct Swap {
    /// The effect that was taken out.
    pub replaced: EffectId,
    /// What is in its place, if anything.
    pub by: Option<EffectId>,
    /// The refitted set.
    pub judged: Judged,
}

impl Search<'_> {
    /// Drops effects without which the evidence is larger, the most superfluous first, and puts special cases in place of wider ones.
    pub(super) fn prune(&self, mut best: Judged, seen: &mut Vec<Judged>) -> Result<Judged> {
        loop {
            let ways: Vec<(EffectId, Option<EffectId>)> = ways(&best.fitted.effects());
            let tried = self.each(&best, &ways, seen)?;
            let evidence = self.evidence();
            let simpler = tried.into_iter().min_by(|a, b| evidence.cost(a).total_cmp(&evidence.cost(b)));
            match simpler {
                Some(simpler) if !evidence.prefers(&best, &simpler) && !self.monitor.cancelled() => {
                    if std::env::var("PMSM_TRACE").is_ok() {
                        eprintln!("prune {:?} -> {:?}: {:.1} {:.1} elsewhere {:.1} {:.1}", best.fitted.effects(), simpler.fitted.effects(), evidence.cost(&best), evidence.cost(&simpler), evidence.cost_elsewhere(&best), evidence.cost_elsewhere(&simpler));
                    }
                    best = simpler;
                }
                _ => return Ok(best),
            }
        }
    }

    /// The sets in which the first of each pair is taken out of `best`, with the second in its place, as fitted before or now.
    fn each(
        &self,
        best: &Judged,
        ways: &[(EffectId, Option<EffectId>)],
        seen: &mut Vec<Judged>,
    ) -> Result<Vec<Judged>> {
        let one = |(gone, instead): &(EffectId, Option<EffectId>)| -> Result<Option<(Judged, bool)>> {
            if self.monitor.cancelled() {
                return Ok(None);
            }
            let wanted: Vec<EffectId> =
                best.fitted.effects().into_iter().filter(|e| e != gone).chain(*instead).collect();
            if let Some(known) = self.known(seen, &wanted) {
                return Ok(Some((known.clone(), false)));
            }
            let (model, start) = match instead {
                Some(narrow) => in_place(&best.fitted, *gone, *narrow),
                None => reduced(&best.fitted, *gone),
            };
            let fitted = fitting::fit(self.data, &model, &start, false, self.monitor)?;
            Ok(Some((self.judge(fitted)?, true)))
        };
        let all: Result<Vec<Option<(Judged, bool)>>> = ways.par_iter().map(one).collect();
        let all: Vec<(Judged, bool)> = all?.into_iter().flatten().collect();
        seen.extend(all.iter().filter(|(_, new)| *new).map(|(set, _)| set.clone()));
        Ok(all.into_iter().map(|(set, _)| set).collect())
    }

    /// A set of these effects that was fitted and held against all recordings.
    fn known<'s>(&self, seen: &'s [Judged], wanted: &[EffectId]) -> Option<&'s Judged> {
        let whole = seen.iter().filter(|set| set.held_out.len() == self.held_out.len());
        whole.filter(|set| is_set(&set.fitted.effects(), wanted)).last()
    }

    /// For each effect of the best set, the set without it, and those with another effect in its place that may do as well as it to first
    /// order.
    pub(super) fn exchange(
        &self,
        best: &Judged,
        shown: &[Shown],
        seen: &mut Vec<Judged>,
    ) -> Result<Vec<Swap>> {
        let effects = best.fitted.effects();
        let ways: Vec<(EffectId, Option<EffectId>)> = effects.iter().map(|e| (*e, None)).collect();
        let without = self.each(best, &ways, seen)?;
        let evidence = self.evidence();
        let mut out: Vec<Swap> = Vec::new();
        let mut tasks = Vec::new();
        for (replaced, fewer) in effects.iter().zip(&without) {
            out.push(Swap { replaced: *replaced, by: None, judged: fewer.clone() });
            let worth = evidence.cost(fewer) - evidence.cost(best);
            let loses = |s: &Shown| worth * (1.0 - s.cosine(*replaced).powi(2));
            let mut rivals: Vec<&Shown> = shown.iter().filter(|s| loses(s) < FIRST_ORDER).collect();
            rivals.sort_by(|a, b| loses(a).total_cmp(&loses(b)));
            tasks.extend(rivals.into_iter().take(RIVALS).map(|s| (*replaced, s.effect, fewer)));
        }
        let refit = |(replaced, by, fewer): &(EffectId, EffectId, &Judged)| -> Result<Option<Swap>> {
            let mut wanted = fewer.fitted.effects();
            wanted.push(*by);
            if self.monitor.cancelled() {
                return Ok(None);
            }
            let judged = match self.known(seen, &wanted) {
                Some(known) => Some(known.clone()),
                None => {
                    let prospect = Scorer::new(self.data, &fewer.fitted).score(*by);
                    self.refit(fewer, &prospect)?.map(|fitted| self.judge(fitted)).transpose()?
                }
            };
            Ok(judged.map(|judged| Swap { replaced: *replaced, by: Some(*by), judged }))
        };
        let swaps: Result<Vec<Option<Swap>>> = tasks.par_iter().map(refit).collect();
        let swaps: Vec<Swap> = swaps?.into_iter().flatten().collect();
        seen.extend(swaps.iter().map(|s| s.judged.clone()));
        out.extend(swaps);
        Ok(out)
    }
}

/// Ways to make a set simpler: each effect dropped, or with a special case of it in its place.
fn ways(effects: &[EffectId]) -> Vec<(EffectId, Option<EffectId>)> {
    let fewer = effects.iter().map(|gone| (*gone, None));
    let narrower = effects.iter().flat_map(|gone| {
        let instead = special_cases(*gone).filter(|e| !effects.contains(e));
        instead.map(|narrow| (*gone, Some(narrow)))
    });
    fewer.chain(narrower).collect()
}

/// Whether both hold the same effects.
fn is_set(a: &[EffectId], b: &[EffectId]) -> bool {
    a.len() == b.len() && a.iter().all(|e| b.contains(e))
}
