//! The search for the set of effects: all singles, then pairs and triples grown from the best, each refitted by
//! simulation and judged on the recording and on the held-out run.

mod again;
mod extend;
mod hidden;
mod jointly;
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
use super::shortlist::Prospect;
use super::transfer::transfer;
use super::verdict::{self, Judged};
use crate::effect::Site;
use crate::effects::EffectId;
use crate::error::Result;
use crate::monitor::Monitor;
use extend::Aim;
use sets::{
    explains, explains_more, foothold, hopeless, mismatched_by, path, progress, same, sorted, steps, widened,
};

pub use variants::Swap;
use variants::preferred;

/// Steps of an unknown load, or noise that lets the rotor wander, may hide what moves: mechanical effects are asked from this share of a
/// mismatch on.
const HIDING: f64 = 1.0 / 3.0;
/// Single effects refitted at most.
const SINGLES: usize = 10;
/// Share of its excess that an effect leaves of which all but a little is explained.
const MOSTLY: f64 = 0.1;
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

/// What single effects explain.
pub struct Singles {
    /// The bare machine.
    pub base: Judged,
    /// The best of them, or the bare machine.
    pub best: Judged,
    /// Effects that this recording could show, and those that could not be judged, and why.
    able: Vec<EffectId>,
    unfit: Vec<(EffectId, String)>,
    tried: Vec<(Prospect, Option<Judged>)>,
    seen: Vec<Judged>,
    scale: Scale,
}

impl Singles {
    /// Whether one of them takes away most of what the bare machine leaves.
    pub fn explain_most(&self) -> bool {
        self.best.excess() < MOSTLY * self.base.excess()
    }
}

/// What came out of a search.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The bare machine.
    pub base: Judged,
    /// Single effects that were scored, with what came of their refit, in the order of the catalogue.
    pub singles: Vec<(Prospect, Option<Judged>)>,
    /// The best set of effects (possibly none).
    pub best: Judged,
    /// For each effect of `best`, the models in which another effect or none stands in its place.
    pub swaps: Vec<Swap>,
    /// Effects that could not be judged, and why.
    pub unfit: Vec<(EffectId, String)>,
    /// What the recording would have shown of the effects that are not in the best set.
    pub shown: Vec<Shown>,
    /// Rivals, of which effect and which, that lose on the other run alone and not where they are fitted to it, too.
    pub open: Vec<(EffectId, EffectId)>,
    /// How they were compared.
    pub scale: Scale,
    /// The way to the best set, one effect more at each step: the bare machine, the best of its singles, …, the best. Where the search left
    /// samples out, all of these are fitted to every one.
    pub path: Vec<Judged>,
}

impl Outcome {
    /// The bare machine and the best set as they are fitted to all samples.
    pub fn ends(&self) -> (&Judged, &Judged) {
        (&self.path[0], &self.path[self.path.len() - 1])
    }

    /// Whether the best set has several effects of which the first takes no part of a mismatch away by itself: of two things that are
    /// missing one shows without the other, and what shows only together bends to something else.
    pub fn only_together(&self) -> bool {
        matches!(&self.path[..], [base, first, _, ..] if mismatched_by(base, 1.0) && !foothold(first, base))
    }

    /// Whether the best set without `effect`, all else fitted anew, leaves more than noise: then no other parameter stands in for it.
    pub fn needs(&self, effect: EffectId) -> bool {
        let without = self.swaps.iter().find(|s| s.replaced == effect && s.by.is_none());
        without.map_or(&self.base, |s| &s.judged).excess() > verdict::MISMATCH
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
    /// Runs the search from the fitted bare machine.
    ///
    /// # Errors
    /// Those of the fits; an interruption ends the search with the best so far.
    pub fn run(&self, base: Hypothesis) -> Result<Outcome> {
        self.finish(self.singles(base)?)
    }

    /// Tries single effects beside the fitted bare machine.
    ///
    /// # Errors
    /// Those of the fits.
    pub fn singles(&self, base: Hypothesis) -> Result<Singles> {
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
        let (asked, silent): (Vec<EffectId>, Vec<EffectId>) = able.iter().copied().partition(asked);
        let aim = Aim { base: &base, best: None, most: SINGLES, thorough: true };
        let mut singles = self.extend(&base, &asked, aim)?;
        self.monitor.report("single effects", 0.6);
        let mut seen = self.refined(&base, &singles)?;
        seen.extend(singles.iter().filter_map(|(_, j)| j.clone()));
        seen.push(base.clone());
        let best_of = |seen: &[Judged]| {
            let scale = Scale::new(seen.iter());
            let first = sorted(seen, &scale).swap_remove(0);
            let best = if scale.beats(&first, &base) { first } else { base.clone() };
            (scale, best)
        };
        let (mut scale, mut best) = best_of(&seen);
        if !best.fitted.effects().is_empty() && !silent.is_empty() {
            // What was not asked may move the rotor just so.
            let aim = Aim { base: &base, best: Some(&best), most: SINGLES, thorough: false };
            let rivals = self.extend(&base, &silent, aim)?;
            seen.extend(rivals.iter().filter_map(|(_, j)| j.clone()));
            singles.extend(rivals);
            singles.sort_by_key(|(p, _)| able.iter().position(|e| *e == p.effect));
            (scale, best) = best_of(&seen);
        }
        Ok(Singles { base, able, unfit, tried: singles, seen, scale, best })
    }

    /// Goes on from single effects to pairs and triples, and to what else it could be.
    ///
    /// # Errors
    /// Those of the fits; an interruption ends the search with the best so far.
    pub fn finish(&self, begun: Singles) -> Result<Outcome> {
        let Singles { base, able, unfit, tried: singles, mut seen, mut scale, mut best } = begun;
        let mut grown = vec![Vec::new()];
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
                let done = larger.iter().any(|j| explains(j, &base));
                if hopeless(parent, &beam[0], done) || (done && widened(parent, &beam[0])) {
                    continue;
                }
                let tried = |e: &EffectId| {
                    let sets = seen.iter().chain(&larger);
                    sets.map(|j| j.fitted.effects()).any(|set| same(&set, &parent.fitted.effects(), *e))
                };
                let rest: Vec<EffectId> =
                    self.rest(&able, parent).into_iter().filter(|e| !tried(e)).collect();
                let done = larger.iter().find(|j| explains(j, &base));
                let aim = Aim { base: &base, best: done, most: BRANCHES, thorough: rank == 0 };
                let extended = self.extend(parent, &rest, aim)?;
                grown.push(parent.fitted.effects());
                larger.extend(self.refined(parent, &extended)?);
                larger.extend(extended.into_iter().filter_map(|(_, j)| j));
            }
            seen.extend(larger.iter().cloned());
            scale = Scale::new(seen.iter());
            match sorted(&larger, &scale).into_iter().next() {
                Some(first) if scale.beats(&first, &best) && progress(&first, &best) => best = first,
                // What was found together may still be a part of something larger.
                _ if best.fitted.effects().len() >= size => {}
                // A part of what is missing may do worse than nothing on other recordings.
                Some(first) if explains_more(&first, &best) => {}
                _ => break,
            }
        }
        let best = self.behind_steps(best, &base, &able, &mut seen, &mut scale)?;
        let mut best = self.pruned(best, &scale, &mut seen)?;
        self.monitor.report("alternatives", 0.85);
        let mut shown = self.survey(&best, &able, &scale);
        let mut swaps = self.swaps(&best, &base, (&able, &shown), (&mut seen, &mut grown))?;
        for _ in 0..PREFERRED {
            let Some(better) = preferred(&best, &swaps, &scale) else { break };
            best = self.pruned(better, &scale, &mut seen)?;
            shown = self.survey(&best, &able, &scale);
            swaps = self.swaps(&best, &base, (&able, &shown), (&mut seen, &mut grown))?;
        }
        let surveyed = best.fitted.parameters.clone();
        let best = self.as_wider(best, &swaps, &scale)?;
        if best.fitted.parameters != surveyed {
            shown = self.survey(&best, &able, &scale);
        }
        self.look_alikes(&best, &shown, &mut swaps)?;
        self.monitor.report("alternatives", 0.95);
        let open = self.reopened(&best, &swaps, &scale)?;
        let base = self.compared(&best, base)?;
        let path = path(&base, &best, &seen, &scale);
        Ok(Outcome { base, singles, best, swaps, unfit, shown, open, scale, path })
    }

    /// What the recording would have shown of the effects that are not in the best set.
    fn survey(&self, best: &Judged, able: &[EffectId], scale: &Scale) -> Vec<Shown> {
        let absent = self.rest(able, best);
        power::survey(self.data, &best.fitted, &absent, scale.worth(), self.most < MOST, self.monitor)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::bare;
    use crate::diagnose::testing::{choice, setup, speeds};
    use crate::drive::simulate;
    use crate::monitor::Silent;
    use crate::signals::Signals;

    #[test]
    fn what_little_moves_a_rotor_that_wanders_is_asked_of_every_kind_of_effect() {
        let tried = |tau_c: f64| {
            let path: Vec<(f64, f64)> =
                (0..8).map(|k| (0.1 + 0.25 * f64::from(k), [90.0, -70.0][k as usize % 2])).collect();
            let mut setup = setup(speeds(2.0, &path), vec![choice("coulomb_friction", "tau_c", tau_c)]);
            setup.drive.sensors.noise_i = 0.3;
            let recording = simulate(&setup, &Silent).unwrap().recording;
            let signals = Signals::new(&recording, &setup.nameplate).unwrap();
            let mut data = Data::new(signals, &setup.nameplate).unwrap();
            let base = bare::fit(&mut data, &Silent).unwrap();
            assert!(data.wander().is_some());
            let search =
                Search { data: &data, held_out: Vec::new(), refuting: Vec::new(), most: 3, monitor: &Silent };
            let singles = search.singles(base).unwrap();
            assert!(!mismatched_by(&singles.base, 1.0), "{:?}", singles.base.fitted.squares);
            let moves = |e: &EffectId| e.info().site == Site::Mechanical;
            let found = singles.best.fitted.effects();
            assert!(found.iter().all(moves), "{found:?}");
            (found.len(), singles.tried.iter().any(|(p, _)| !moves(&p.effect)))
        };
        assert_eq!(tried(0.0), (0, false));
        assert_eq!(tried(0.05), (1, true));
    }
}
