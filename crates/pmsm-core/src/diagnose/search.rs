//! The search for the set of effects: all singles, then pairs and triples grown from the best, each refitted by
//! simulation and judged on the recording and on the held-out run.

mod again;
mod hidden;
mod refit;
mod sets;
mod smaller;
mod variants;

use super::able;
use super::data::Data;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::power::{self, Shown};
use super::scale::Scale;
use super::shortlist::{Prospect, Scorer};
use super::transfer::transfer;
use super::verdict::{self, Judged, MISMATCH, PROGRESS};
use crate::effect::Site;
use crate::effects::{self, EffectId};
use crate::error::Result;
use crate::experiment::Channel;
use crate::monitor::Monitor;
use rayon::prelude::*;
use sets::{explains, foothold, hopeless, mismatched_by, path, progress, same, sorted, steps};

pub use variants::Swap;
use variants::preferred;

/// Effects whose first-order score (mean square in units of what is left) is below this are not refitted.
const LEAST_SCORE: f64 = 0.002;
/// Beside other effects, one that scores less than this share of the worst channel's excess is not refitted either, unless it is
/// the best of its site: it has to take away a good part of it to be taken up.
const LEAST_SHARE: f64 = 0.1;
/// Of single effects, none is that scores less than this share of the best: it is no rival to it, and what it may explain beside it is
/// seen when pairs are grown.
const RIVAL: f64 = 0.05;
/// Steps of an unknown load, or noise that lets the rotor wander, may hide what moves: mechanical effects are asked from this share of a
/// mismatch on, unless they score less than that.
const HIDING: f64 = 1.0 / 3.0;
const LEAST_HIDDEN: f64 = 0.1;
/// Single effects refitted at most.
const SINGLES: usize = 10;
/// Sets from which larger ones are grown.
const BEAM: usize = 2;
/// Effects added to each of them.
const BRANCHES: usize = 3;
/// Most effects in one model, unless the recording is too poor for more than one.
pub const MOST: usize = 3;
/// Times that a rival which the recordings prefer becomes the best set.
const PREFERRED: usize = 2;

/// The recording, the held-out run, and what was tried on them.
pub struct Search<'a> {
    /// The recording.
    pub data: &'a Data,
    /// Recordings that are not used for fitting.
    pub held_out: Vec<&'a Data>,
    /// Recordings that can only refute a model, with the bare machine on them.
    pub refuting: Vec<(&'a Data, Hypothesis)>,
    /// Most effects in one model.
    pub most: usize,
    /// Asked whether to go on.
    pub monitor: &'a dyn Monitor,
}

/// What came out of a search.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The bare machine.
    pub base: Judged,
    /// Single effects that were refitted, with their scores, in the order of the catalogue.
    pub singles: Vec<(Prospect, Option<Judged>)>,
    /// The best set of effects (possibly none).
    pub best: Judged,
    /// For each effect of `best`, the models in which another effect or none stands in its place.
    pub swaps: Vec<Swap>,
    /// Effects that could not be judged, and why.
    pub unfit: Vec<(EffectId, String)>,
    /// What the recording would have shown of the effects that are not in the best set.
    pub shown: Vec<Shown>,
    /// How they were compared.
    pub scale: Scale,
    /// The way to the best set, one effect more at each step: the bare machine, the best of its singles, …, the best.
    pub path: Vec<Judged>,
}

impl Outcome {
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
    /// Runs the search from the fitted bare machine.
    ///
    /// # Errors
    /// Those of the fits; an interruption ends the search with the best so far.
    pub fn run(&self, base: Hypothesis) -> Result<Outcome> {
        let base = self.judge(base)?;
        let (able, unfit) = able::able(self.data);
        // What explains less than would be called a mismatch may be the floor's own error; an unknown load may hide what moves, and so may
        // a rotor that noise lets wander.
        let reversing = self.steps_reverse(&base);
        let wanders = self.data.runs().iter().any(|run| run.wander().is_some());
        let hiding = (steps(&base) || wanders) && mismatched_by(&base, HIDING);
        let asked = |e: &EffectId| {
            let hidden = hiding && e.info().site == Site::Mechanical;
            mismatched_by(&base, 1.0) || hidden || (e.jumps() && reversing)
        };
        let asked: Vec<EffectId> = able.iter().copied().filter(asked).collect();
        let singles = self.extend(&base, &asked, SINGLES, true)?;
        self.monitor.report("single effects", 0.6);
        let mut seen = self.refined(&base, &singles)?;
        seen.extend(singles.iter().filter_map(|(_, j)| j.clone()));
        seen.push(base.clone());
        let mut scale = Scale::new(seen.iter());
        let first = sorted(&seen, &scale).swap_remove(0);
        let mut best = if scale.beats(&first, &base) { first } else { base.clone() };
        for size in 2..=self.most {
            if explains(&best, &base) || self.monitor.cancelled() {
                break;
            }
            self.monitor.report("combinations of effects", 0.5 + 0.1 * size as f64);
            let mut beam = sorted(&seen, &scale);
            let smaller = beam.iter().find(|j| j.fitted.effects().len() == size - 2).cloned();
            let holds = |j: &Judged| smaller.as_ref().is_none_or(|smaller| foothold(j, smaller));
            beam.retain(|j| j.fitted.effects().len() == size - 1 && holds(j));
            beam.truncate(BEAM);
            let mut larger: Vec<Judged> = Vec::new();
            for (rank, parent) in beam.iter().enumerate() {
                if hopeless(parent, &beam[0], larger.iter().any(|j| explains(j, &base))) {
                    continue;
                }
                let tried = |e: &EffectId| {
                    let sets = seen.iter().chain(&larger);
                    sets.map(|j| j.fitted.effects()).any(|set| same(&set, &parent.fitted.effects(), *e))
                };
                let rest: Vec<EffectId> =
                    self.rest(&able, parent).into_iter().filter(|e| !tried(e)).collect();
                let extended = self.extend(parent, &rest, BRANCHES, rank == 0)?;
                larger.extend(self.refined(parent, &extended)?);
                larger.extend(extended.into_iter().filter_map(|(_, j)| j));
            }
            seen.extend(larger.iter().cloned());
            scale = Scale::new(seen.iter());
            match sorted(&larger, &scale).into_iter().next() {
                Some(first) if scale.beats(&first, &best) && progress(&first, &best) => best = first,
                // What was found together may still be a part of something larger.
                _ if best.fitted.effects().len() >= size => {}
                _ => break,
            }
        }
        let best = self.behind_steps(best, &base, &able, &mut seen, &mut scale)?;
        let mut best = self.pruned(best, &scale, &mut seen)?;
        let mut swaps = self.swaps(&best, &able, &mut seen)?;
        for _ in 0..PREFERRED {
            let Some(better) = preferred(&best, &swaps, &scale) else { break };
            best = self.pruned(better, &scale, &mut seen)?;
            swaps = self.swaps(&best, &able, &mut seen)?;
        }
        let best = self.under_wider_load(best, &swaps, &scale)?;
        self.monitor.report("alternatives", 0.92);
        let absent = self.rest(&able, &best);
        let poor = self.most < MOST;
        let shown = power::survey(self.data, &best.fitted, &absent, scale.worth(), poor, self.monitor);
        self.look_alikes(&best, &shown, &mut swaps)?;
        self.monitor.report("alternatives", 0.95);
        let base = self.compared(&best, base)?;
        let path = path(&base, &best, &seen, &scale);
        Ok(Outcome { base, singles, best, swaps, unfit, shown, scale, path })
    }

    /// Transfers a fitted hypothesis to the held-out runs.
    fn judge(&self, fitted: Hypothesis) -> Result<Judged> {
        let on = |data: &Data| transfer(data, &fitted, self.monitor);
        let held_out: Result<Vec<Hypothesis>> = self.held_out.iter().map(|data| on(data)).collect();
        let held_out = held_out?;
        let mut refuted = false;
        for (data, bare) in &self.refuting {
            refuted |= !fitted.effects().is_empty() && verdict::refutes(&on(data)?, bare);
        }
        Ok(Judged { fitted, held_out, refuted })
    }

    /// Scores `candidates` on top of `parent` and refits the `most` best, in parallel. Those whose score tells little are
    /// refitted, too, if the parent does not explain the motion and `thorough` is asked for.
    fn extend(
        &self,
        parent: &Judged,
        candidates: &[EffectId],
        most: usize,
        thorough: bool,
    ) -> Result<Vec<(Prospect, Option<Judged>)>> {
        let scorer = Scorer::new(self.data, &parent.fitted);
        let prospects: Vec<Prospect> = candidates
            .par_iter()
            .map(|effect| {
                if self.monitor.cancelled() {
                    let probes = effect.probes(parent.fitted.model.context());
                    let start = probes.into_iter().next().unwrap_or_default();
                    return Prospect { effect: *effect, start, score: 0.0 };
                }
                scorer.score(*effect)
            })
            .collect();
        let mut order: Vec<usize> = (0..prospects.len()).collect();
        order.sort_by(|a, b| prospects[*b].score.total_cmp(&prospects[*a].score));
        let beside = !parent.fitted.effects().is_empty();
        let least = if beside {
            (LEAST_SHARE * parent.excess() / (1.0 + parent.excess())).max(LEAST_SCORE)
        } else {
            let best = prospects.iter().map(|p| p.score).fold(0.0, f64::max);
            (RIVAL * best).max(if mismatched_by(parent, 1.0) { LEAST_SCORE } else { LEAST_HIDDEN })
        };
        let shaken = thorough && parent.fitted.square(Channel::OmegaE) > 1.0 + MISMATCH;
        let reversing = self.steps_reverse(parent);
        // What the voltages leave may look like much in the motion: beside other effects the best of each site is tried.
        let leads = |k: usize| {
            let site = |k: usize| prospects[k].effect.info().site;
            beside && order.iter().find(|o| site(**o) == site(k)) == Some(&k)
        };
        let chosen: Vec<bool> = (0..prospects.len())
            .map(|k| {
                let (effect, score) = (prospects[k].effect, prospects[k].score);
                let top = score > least && order.iter().take(most).any(|o| *o == k);
                let asked = (leads(k) && score > LEAST_SCORE) || (effect.jumps() && reversing);
                top || asked || (!effect.is_first_order() && shaken)
            })
            .collect();
        let judged: Vec<Result<Option<Judged>>> = prospects
            .par_iter()
            .zip(&chosen)
            .map(|(prospect, chosen)| {
                if !*chosen || self.monitor.cancelled() {
                    return Ok(None);
                }
                let judged = self.refit(parent, prospect)?;
                Ok((!judged.fitted.vanishes(prospect.effect)).then_some(judged))
            })
            .collect();
        prospects.into_iter().zip(judged).map(|(p, j)| j.map(|j| (p, j))).collect()
    }

    /// Of the `extended` sets those whose new effect only refines another one, with that one beside it: neither may be worth much without
    /// the other.
    fn refined(&self, parent: &Judged, extended: &[(Prospect, Option<Judged>)]) -> Result<Vec<Judged>> {
        let mut out = Vec::new();
        for (prospect, judged) in extended {
            let (Some(judged), Some(plain)) = (judged, prospect.effect.refines()) else { continue };
            let plain =
                effects::ALL.iter().copied().find(|e| e.id() == plain).expect("it is in the catalogue");
            let effects = judged.fitted.effects();
            let room = effects.len() < self.most && !effects.contains(&plain);
            if room && judged.excess() > MISMATCH && judged.excess() < PROGRESS * parent.excess() {
                let prospect = Scorer::new(self.data, &judged.fitted).score(plain);
                out.push(self.refit(judged, &prospect)?);
            }
        }
        Ok(out)
    }

    fn rest(&self, able: &[EffectId], parent: &Judged) -> Vec<EffectId> {
        let effects = parent.fitted.effects();
        able.iter().copied().filter(|e| !effects.contains(e)).collect()
    }

    /// `other` fitted anew under the load that `best` finds on each recording.
    fn under_load_of(&self, best: &Judged, other: &Hypothesis, refuted: bool) -> Result<Judged> {
        let fitted = fitting::under_load_of(&best.fitted, self.data, other, true, self.monitor)?;
        let on_others = self
            .held_out
            .iter()
            .zip(&best.held_out)
            .map(|(data, best)| fitting::under_load_of(best, data, &fitted, false, self.monitor));
        let held_out = on_others.collect::<Result<Vec<_>>>()?;
        Ok(Judged { fitted, held_out, refuted })
    }
}
