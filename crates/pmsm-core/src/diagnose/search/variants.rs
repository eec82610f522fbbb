//! Sets beside the best one: without one of its effects, with a special case of it, or with another in its place.

use super::sets::{same, steps};
use super::{BRANCHES, Search};
use crate::base::BASE;
use crate::diagnose::fitting;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::power::Shown;
use crate::diagnose::shortlist::Scorer;
use crate::diagnose::verdict::{Judged, LEAST_GAIN, Scale};
use crate::effect::{Role, Site};
use crate::effects::{self, EffectId};
use crate::error::Result;
use crate::model::Model;

/// Look-alikes of the found effects refitted at most beside those that were tried anyway.
const LOOK_ALIKES: usize = 4;

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
            for wide in &effects {
                for narrow in special_cases(*wide).filter(|e| !effects.contains(e)) {
                    let simpler = self.narrowed(&best, *wide, narrow, seen)?;
                    let simpler = self.sharpened(&best, *wide, narrow, simpler, scale, seen)?;
                    if !scale.widens(&best, &simpler) {
                        best = simpler;
                        continue 'again;
                    }
                }
            }
            for drop in &effects {
                let fewer = self.without_from_here(&best, *drop, scale, seen)?;
                let fewer = self.under_same_load(&best, *drop, fewer, scale, seen)?;
                if scale.loss(&fewer) < scale.loss(&best) + LEAST_GAIN {
                    best = fewer;
                    continue 'again;
                }
            }
            return Ok(best);
        }
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

    /// The set `simpler`, in which a special case stands in place of the effect `wide`, fitted also with a torque that turns over as fast as
    /// it may, if `wide` does better: few samples tell how fast it does, and what makes up for a wrong answer on another recording is no
    /// effect.
    fn sharpened(
        &self,
        best: &Judged,
        wide: EffectId,
        narrow: EffectId,
        simpler: Judged,
        scale: &Scale,
        seen: &mut [Judged],
    ) -> Result<Judged> {
        let (model, mut start) = in_place(&best.fitted, wide, narrow);
        let parameters = narrow.info().parameters;
        let first = start.len() - parameters.len();
        let shapes: Vec<usize> =
            (0..parameters.len()).filter(|k| parameters[*k].role == Role::Shape).collect();
        if !narrow.jumps() || shapes.is_empty() || !scale.widens(best, &simpler) || self.monitor.cancelled() {
            return Ok(simpler);
        }
        for k in shapes {
            start[first + k] = (parameters[k].low)(model.context());
        }
        let again = self.judge(fitting::fit(self.data, &model, &start, false, self.monitor)?)?;
        if scale.loss(&again) >= scale.loss(&simpler) {
            return Ok(simpler);
        }
        replace(seen, &again);
        Ok(again)
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

    /// The same set without one effect, fitted also from where the set stands if it was tried before and does worse: from afar its shapes
    /// may have run astray, and what made up for that is no effect.
    fn without_from_here(
        &self,
        best: &Judged,
        drop: EffectId,
        scale: &Scale,
        seen: &mut Vec<Judged>,
    ) -> Result<Judged> {
        let tried = seen.len();
        let fewer = self.without(best, drop, seen)?;
        let (fresh, effects) = (seen.len() > tried, fewer.fitted.effects());
        let gone = scale.loss(&fewer) < scale.loss(best) + LEAST_GAIN;
        if fresh || effects.is_empty() || gone || self.monitor.cancelled() {
            return Ok(fewer);
        }
        let (model, start) = reduced(&best.fitted, drop);
        let again = self.judge(fitting::fit(self.data, &model, &start, false, self.monitor)?)?;
        if scale.loss(&again) >= scale.loss(&fewer) {
            return Ok(fewer);
        }
        replace(seen, &again);
        Ok(again)
    }

    /// The set `fewer` without the effect `drop`, or the same fitted under the load that was found with it if that is better: steps
    /// found without a needless effect may be steps in the wrong places.
    fn under_same_load(
        &self,
        best: &Judged,
        drop: EffectId,
        fewer: Judged,
        scale: &Scale,
        seen: &mut [Judged],
    ) -> Result<Judged> {
        if drop.info().site != Site::Mechanical || !steps(best) || self.monitor.cancelled() {
            return Ok(fewer);
        }
        let (model, start) = reduced(&best.fitted, drop);
        let (electrical, _, sensors) = fitting::free_parameters(self.data, &model);
        let free = if self.data.has(true) { [electrical, sensors].concat() } else { Vec::new() };
        let without = Hypothesis { free, ..Hypothesis::bare(model, start) };
        let same = self.under_load_of(best, &without, fewer.refuted)?;
        if scale.loss(&same) >= scale.loss(&fewer) {
            return Ok(fewer);
        }
        replace(seen, &same);
        Ok(same)
    }

    /// For each effect of the best set, the set without it and what other effects in its place achieve.
    pub(super) fn swaps(
        &self,
        best: &Judged,
        able: &[EffectId],
        seen: &mut Vec<Judged>,
    ) -> Result<Vec<Swap>> {
        let effects = best.fitted.effects();
        let mut out = Vec::new();
        for &effect in &effects {
            if self.monitor.cancelled() {
                break;
            }
            let fewer = self.without(best, effect, seen)?;
            let kept = fewer.fitted.effects();
            let tried = |e: EffectId, seen: &[Judged]| {
                seen.iter().find(|j| same(&j.fitted.effects(), &kept, e)).cloned()
            };
            let rest: Vec<EffectId> = able.iter().copied().filter(|e| !effects.contains(e)).collect();
            if !rest.iter().any(|e| tried(*e, seen).is_some()) {
                let extended = self.extend(&fewer, &rest, BRANCHES, true)?;
                seen.extend(extended.into_iter().filter_map(|(_, j)| j));
            }
            let rivals = rest
                .iter()
                .filter_map(|e| Some(Swap { replaced: effect, by: Some(*e), judged: tried(*e, seen)? }));
            out.extend(rivals.collect::<Vec<_>>());
            out.push(Swap { replaced: effect, by: None, judged: fewer });
        }
        Ok(out)
    }

    /// The best set, or the same under the load that was found with what contains one of its effects, if that is better: a step found in
    /// the wrong place must not speak for the wider form of an effect.
    pub(super) fn under_wider_load(&self, mut best: Judged, swaps: &[Swap], scale: &Scale) -> Result<Judged> {
        for swap in swaps {
            let wider = swap.by.is_some_and(|by| special_cases(by).any(|e| e == swap.replaced));
            let better = scale.loss(&swap.judged) < scale.loss(&best);
            if wider && better && steps(&swap.judged) && !self.monitor.cancelled() {
                let same = self.under_load_of(&swap.judged, &best.fitted, best.refuted)?;
                if scale.loss(&same) < scale.loss(&best) {
                    best = same;
                }
            }
        }
        Ok(best)
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
                let prospect = Scorer::new(self.data, &fewer.fitted).score(rival);
                let judged = self.refit(&fewer, &prospect)?;
                if !judged.fitted.vanishes(rival) {
                    swaps.push(Swap { replaced: found, by: Some(rival), judged });
                }
            }
        }
        Ok(())
    }
}

/// Effects that an effect contains.
fn special_cases(wide: EffectId) -> impl Iterator<Item = EffectId> {
    let narrow = wide.info().contains;
    effects::ALL.iter().copied().filter(move |e| narrow.contains(&e.id()))
}

/// Model and parameters without one of the effects.
fn reduced(hypothesis: &Hypothesis, drop: EffectId) -> (Model, Vec<f64>) {
    let kept: Vec<EffectId> = hypothesis.effects().into_iter().filter(|e| *e != drop).collect();
    let mut start = hypothesis.own()[..BASE].to_vec();
    for slot in hypothesis.model.slots().iter().filter(|s| s.effect != drop) {
        start.extend(&hypothesis.parameters[slot.parameters.clone()]);
    }
    (Model::new(*hypothesis.model.context(), &kept), start)
}

/// Model and parameters with the special case `narrow` in place of the effect `wide`; parameters of the same name keep their values.
fn in_place(hypothesis: &Hypothesis, wide: EffectId, narrow: EffectId) -> (Model, Vec<f64>) {
    let (rest, mut start) = reduced(hypothesis, wide);
    let slot = hypothesis.model.slots().iter().find(|s| s.effect == wide).expect("it is in the set");
    let own = &hypothesis.parameters[slot.parameters.clone()];
    let mut shared = narrow.probes(rest.context()).into_iter().next().unwrap_or_default();
    for (x, info) in shared.iter_mut().zip(narrow.info().parameters) {
        if let Some(k) = wide.info().parameters.iter().position(|p| p.name == info.name) {
            *x = own[k];
        }
    }
    start.extend(shared);
    let mut effects = rest.effects();
    effects.push(narrow);
    (Model::new(*rest.context(), &effects), start)
}

/// Puts a better fit of a set in the place of the one that was tried.
fn replace(seen: &mut [Judged], better: &Judged) {
    let effects = better.fitted.effects();
    seen.iter_mut().filter(|j| is_set(&j.fitted.effects(), &effects)).for_each(|j| *j = better.clone());
}

/// The most likely of the sets with another effect in place of one of `best`, if one beats it. What only generalises an effect of it has
/// been asked for before.
pub(super) fn preferred(best: &Judged, swaps: &[Swap], scale: &Scale) -> Option<Judged> {
    let rivals = swaps.iter().filter(|swap| {
        let wider = |by: EffectId| special_cases(by).any(|e| e == swap.replaced);
        swap.by.is_some_and(|by| !wider(by)) && scale.beats(&swap.judged, best)
    });
    rivals.map(|s| &s.judged).min_by(|a, b| scale.loss(a).total_cmp(&scale.loss(b))).cloned()
}

/// Whether both hold the same effects.
fn is_set(a: &[EffectId], b: &[EffectId]) -> bool {
    a.len() == b.len() && a.iter().all(|e| b.contains(e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::drive::{Schedule, Shape};
    use crate::effects::testing::CX;
    use crate::experiment::Channel;
    use crate::monitor::Silent;

    #[test]
    fn a_step_in_the_wrong_place_does_not_speak_for_a_wider_effect() {
        let mut manoeuvre = speeds(1.2, &[(0.1, 90.0), (0.5, -80.0), (0.9, 60.0)]);
        let steps = vec![(0.0, 0.5), (0.62, 2.0)];
        manoeuvre.tau_load = Some(Schedule::new(steps, Shape::Steps).unwrap());
        manoeuvre.load_kind = Some("unknown_piecewise".into());
        let (data, base) = data(&setup(manoeuvre, vec![choice("coulomb_friction", "tau_c", 0.3)]));
        let judged = |fitted| Judged { fitted, held_out: Vec::new(), refuted: false };
        let [narrow, wide] =
            [EffectId::CoulombFriction, EffectId::StribeckFriction].map(|e| judged(fitted(&data, &base, e)));
        assert!(narrow.excess() < 0.1 && narrow.fitted.nuisances[0].steps() == 1);
        // Levels, instants and initial values follow the model's own parameters.
        let mut astray = narrow.fitted.clone();
        astray.parameters[narrow.fitted.own().len() + 2] += 0.02;
        let Hypothesis { model, parameters, free, nuisances, .. } = astray;
        let astray = judged(Hypothesis::on(&data, model, parameters, free, nuisances));
        assert!(astray.excess() > 1.0);

        let search =
            Search { data: &data, held_out: Vec::new(), refuting: Vec::new(), most: 3, monitor: &Silent };
        let scale = Scale::new([&narrow, &wide, &astray].into_iter());
        let replaced = EffectId::CoulombFriction;
        let by = |rival| Swap { replaced, by: Some(rival), judged: wide.clone() };
        let found =
            search.under_wider_load(astray.clone(), &[by(EffectId::StribeckFriction)], &scale).unwrap();
        assert_eq!(found.fitted.effects(), [replaced]);
        assert!(found.excess() < 0.1 && scale.loss(&found) < scale.loss(&wide) + LEAST_GAIN);
        // Another effect's load is that effect's own.
        let same = search.under_wider_load(astray.clone(), &[by(EffectId::QuadraticDrag)], &scale).unwrap();
        assert_eq!(same.fitted.parameters, astray.fitted.parameters);
    }

    #[test]
    fn what_makes_up_for_a_fit_that_ran_astray_is_no_effect() {
        let manoeuvre = speeds(1.0, &[(0.1, 90.0), (0.3, -80.0), (0.5, 60.0), (0.7, -60.0), (0.9, 80.0)]);
        let (data, base) = data(&setup(manoeuvre, vec![choice("coulomb_friction", "tau_c", 0.3)]));
        let judged = |fitted| Judged { fitted, held_out: Vec::new(), refuted: false };
        let right = judged(fitted(&data, &base, EffectId::CoulombFriction));
        let both = judged({
            let model =
                Model::new(data.signals.context, &[EffectId::CoulombFriction, EffectId::QuadraticDrag]);
            let start = [right.fitted.own(), &[1e-9, 0.0]].concat();
            fitting::fit(&data, &model, &start[..model.parameter_count()], false, &Silent).unwrap()
        });
        let Hypothesis { model, mut parameters, free, nuisances, .. } = right.fitted.clone();
        parameters[BASE] *= 1.5;
        let astray = judged(Hypothesis::on(&data, model, parameters, free, nuisances));
        assert!(right.excess() < 0.1 && astray.excess() > 1.0);

        let search =
            Search { data: &data, held_out: Vec::new(), refuting: Vec::new(), most: 3, monitor: &Silent };
        let scale = Scale::new([&right, &both, &astray].into_iter());
        let mut seen = vec![judged(base), astray];
        let found = search.pruned(both, &scale, &mut seen).unwrap();
        assert_eq!(found.fitted.effects(), [EffectId::CoulombFriction]);
        assert!(found.excess() < 0.1 && seen[1].excess() < 0.1, "{}", found.excess());
    }

    #[test]
    fn a_torque_that_turns_over_too_slowly_does_not_speak_for_a_wider_effect() {
        let manoeuvre = speeds(1.0, &[(0.1, 90.0), (0.3, -80.0), (0.5, 60.0), (0.7, -60.0), (0.9, 80.0)]);
        let (data, base) = data(&setup(manoeuvre, vec![choice("coulomb_friction", "tau_c", 0.5)]));
        let judged = |fitted| Judged { fitted, held_out: Vec::new(), refuted: false };
        let [right, wide] =
            [EffectId::CoulombFriction, EffectId::StribeckFriction].map(|e| judged(fitted(&data, &base, e)));
        let Hypothesis { model, mut parameters, free, nuisances, .. } = right.fitted.clone();
        parameters[BASE + 1] = 20.0;
        let slow = judged(Hypothesis::on(&data, model, parameters, free, nuisances));
        assert!(right.excess() < 0.1 && slow.excess() > 0.3, "{}", slow.excess());

        let search =
            Search { data: &data, held_out: Vec::new(), refuting: Vec::new(), most: 3, monitor: &Silent };
        let scale = Scale::new([&right, &wide, &slow].into_iter());
        let mut seen = vec![judged(base), slow];
        let found = search.pruned(wide, &scale, &mut seen).unwrap();
        assert_eq!(found.fitted.effects(), [EffectId::CoulombFriction]);
        assert!(found.excess() < 0.1 && seen[1].excess() < 0.1, "{}", found.excess());
    }

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
