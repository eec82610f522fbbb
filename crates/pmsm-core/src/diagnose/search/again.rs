//! A set that does worse than one beside it, fitted again from what that one found: what makes up for a fit that ran astray is no
//! effect.

use super::Search;
use super::sets::{is_set, replace, steps};
use super::smaller::{in_place, left_out, reduced};
use super::variants::Swap;
use crate::diagnose::fitting;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::scale::{LEAST_GAIN, Scale, asks_for, loses};
use crate::diagnose::verdict::Judged;
use crate::effect::{Role, Site};
use crate::effects::EffectId;
use crate::error::Result;

impl Search<'_> {
    /// The set `simpler`, in which a special case stands in place of the effect `wide`, or the same fitted with a torque that turns over
    /// as fast as it may, if that is better: few samples tell how fast it does.
    pub(super) fn sharpened(
        &self,
        best: &Judged,
        wide: EffectId,
        narrow: EffectId,
        simpler: Judged,
        scale: &Scale,
        seen: &mut [Judged],
    ) -> Result<Judged> {
        let parameters = narrow.info().parameters;
        let shapes: Vec<usize> =
            (0..parameters.len()).filter(|k| parameters[*k].role == Role::Shape).collect();
        if !narrow.jumps() || shapes.is_empty() || !scale.widens(best, &simpler) || self.monitor.cancelled() {
            return Ok(simpler);
        }
        let (model, mut start) = in_place(&best.fitted, wide, narrow);
        let first = start.len() - parameters.len();
        for k in shapes {
            start[first + k] = (parameters[k].low)(model.context());
        }
        let again = self.judge(fitting::fit(self.data, &model, &start, false, self.monitor)?)?;
        Ok(better(again, simpler, scale, seen))
    }

    /// The best set without the effect `drop`, everything else being as it is, if it is worth no more with it: an effect may owe its place
    /// to a fit of everything at once that was made for its sake.
    pub(super) fn needless(
        &self,
        best: &Judged,
        drop: EffectId,
        scale: &Scale,
        seen: &mut [Judged],
    ) -> Result<Option<Judged>> {
        let Some((model, parameters, free)) = left_out(&best.fitted, drop) else { return Ok(None) };
        if self.monitor.cancelled() {
            return Ok(None);
        }
        let fitted = Hypothesis::on(self.data, model, parameters, free, best.fitted.nuisances.clone());
        if loses(&fitted, false, best) {
            return Ok(None);
        }
        let fewer = self.judge(fitted)?;
        if scale.loss(&fewer) >= scale.loss(best) + LEAST_GAIN {
            return Ok(None);
        }
        let known = seen.iter().find(|j| is_set(&j.fitted.effects(), &fewer.fitted.effects())).cloned();
        Ok(Some(match known {
            Some(known) => better(fewer, known, scale, seen),
            None => fewer,
        }))
    }

    /// The set `fewer` without the effect `drop`, or the same fitted from where the set stands with it, if that is better: from afar its
    /// shapes may have run astray.
    pub(super) fn fitted_here(
        &self,
        best: &Judged,
        drop: EffectId,
        fewer: Judged,
        scale: &Scale,
        seen: &mut [Judged],
    ) -> Result<Judged> {
        let gone = scale.loss(&fewer) < scale.loss(best) + LEAST_GAIN;
        if fewer.fitted.effects().is_empty() || gone || self.monitor.cancelled() {
            return Ok(fewer);
        }
        let (model, start) = reduced(&best.fitted, drop);
        let again = self.judge(fitting::fit(self.data, &model, &start, false, self.monitor)?)?;
        Ok(better(again, fewer, scale, seen))
    }

    /// The set `fewer` without the effect `drop`, or the same fitted under the load that was found with it, if that is better: steps
    /// found without a needless effect may be steps in the wrong places.
    pub(super) fn under_same_load(
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
        Ok(better(same, fewer, scale, seen))
    }

    /// The best set, or the same fitted from where the set with what contains one of its effects stands, if that is worth more, or under the
    /// load that was found with that one, if that is better, or, where no load steps, as fitted to both runs: a shape that ran astray, a
    /// step found in the wrong place, or what the recording hardly shows, must not speak for the wider form of an effect.
    pub(super) fn as_wider(&self, mut best: Judged, swaps: &[Swap], scale: &Scale) -> Result<Judged> {
        for swap in swaps {
            let Some(wider) = swap.by.filter(|by| by.contains(swap.replaced)) else { continue };
            if scale.loss(&swap.judged) >= scale.loss(&best) || self.monitor.cancelled() {
                continue;
            }
            let gained = scale.loss(&swap.judged) + LEAST_GAIN < scale.loss(&best);
            if gained || asks_for(&swap.judged, &best) {
                let (model, start) = in_place(&swap.judged.fitted, wider, swap.replaced);
                let again = self.judge(fitting::fit(self.data, &model, &start, false, self.monitor)?)?;
                best = better(again, best, scale, &mut []);
            }
            best = if steps(&swap.judged) {
                let same = self.under_load_of(&swap.judged, &best.fitted, best.refuted)?;
                better(same, best, scale, &mut [])
            } else {
                self.eased(&swap.judged, best, scale)?
            };
        }
        Ok(best)
    }
}

/// The better of two fits of a set; the second one is among those that were `seen` and gives way there, too.
fn better(again: Judged, first: Judged, scale: &Scale, seen: &mut [Judged]) -> Judged {
    if scale.loss(&again) >= scale.loss(&first) {
        return first;
    }
    replace(seen, &again);
    again
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::BASE;
    use crate::diagnose::data::Data;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::drive::{Schedule, Shape};
    use crate::machine::BaseParameter;
    use crate::model::Model;
    use crate::monitor::Silent;

    /// Coulomb friction of this strength on a manoeuvre that reverses four times, with the bare machine fitted to it.
    fn reversing(tau_c: f64) -> (Data, Hypothesis) {
        let manoeuvre = speeds(1.0, &[(0.1, 90.0), (0.3, -80.0), (0.5, 60.0), (0.7, -60.0), (0.9, 80.0)]);
        data(&setup(manoeuvre, vec![choice("coulomb_friction", "tau_c", tau_c)]))
    }

    fn search(data: &Data) -> Search<'_> {
        Search { data, held_out: Vec::new(), refuting: Vec::new(), most: 3, monitor: &Silent }
    }

    fn judged(fitted: Hypothesis) -> Judged {
        Judged { fitted, held_out: Vec::new(), refuted: false }
    }

    /// The same fit with other values of some parameters.
    fn astray(data: &Data, right: &Judged, change: impl Fn(&mut [f64])) -> Judged {
        let Hypothesis { model, mut parameters, free, nuisances, .. } = right.fitted.clone();
        change(&mut parameters);
        judged(Hypothesis::on(data, model, parameters, free, nuisances))
    }

    #[test]
    fn a_step_in_the_wrong_place_does_not_speak_for_a_wider_effect() {
        let mut manoeuvre = speeds(1.2, &[(0.1, 90.0), (0.5, -80.0), (0.9, 60.0)]);
        let steps = vec![(0.0, 0.5), (0.62, 2.0)];
        manoeuvre.tau_load = Some(Schedule::new(steps, Shape::Steps).unwrap());
        manoeuvre.load_kind = Some("unknown_piecewise".into());
        let (data, base) = data(&setup(manoeuvre, vec![choice("coulomb_friction", "tau_c", 0.3)]));
        let [narrow, wide] =
            [EffectId::CoulombFriction, EffectId::StribeckFriction].map(|e| judged(fitted(&data, &base, e)));
        assert!(narrow.excess() < 0.1 && narrow.fitted.nuisances[0].steps() == 1);
        // Levels, instants and initial values follow the model's own parameters.
        let instant = narrow.fitted.own().len() + 2;
        let astray = astray(&data, &narrow, |x| x[instant] += 0.02);
        assert!(astray.excess() > 1.0);

        let scale = Scale::new([&narrow, &wide, &astray].into_iter());
        let replaced = EffectId::CoulombFriction;
        let by = |rival| Swap { replaced, by: Some(rival), judged: wide.clone() };
        let under = |swap| search(&data).as_wider(astray.clone(), &[swap], &scale).unwrap();
        let found = under(by(EffectId::StribeckFriction));
        assert_eq!(found.fitted.effects(), [replaced]);
        assert!(found.excess() < 0.1 && scale.loss(&found) < scale.loss(&wide) + LEAST_GAIN);
        // Another effect's load is that effect's own.
        let same = under(by(EffectId::QuadraticDrag));
        assert_eq!(same.fitted.parameters, astray.fitted.parameters);
    }

    #[test]
    fn what_makes_up_for_a_fit_that_ran_astray_is_no_effect() {
        let (data, base) = reversing(0.3);
        let right = judged(fitted(&data, &base, EffectId::CoulombFriction));
        let both = judged({
            let model =
                Model::new(data.signals.context, &[EffectId::CoulombFriction, EffectId::QuadraticDrag]);
            let start = [right.fitted.own(), &[1e-9, 0.0]].concat();
            fitting::fit(&data, &model, &start[..model.parameter_count()], false, &Silent).unwrap()
        });
        let astray = astray(&data, &right, |x| x[BASE] *= 1.5);
        assert!(right.excess() < 0.1 && astray.excess() > 1.0);

        let scale = Scale::new([&right, &both, &astray].into_iter());
        let mut seen = vec![judged(base), astray];
        let found = search(&data).pruned(both, &scale, &mut seen).unwrap();
        assert_eq!(found.fitted.effects(), [EffectId::CoulombFriction]);
        assert!(found.excess() < 0.1 && seen[1].excess() < 0.1, "{}", found.excess());
    }

    #[test]
    fn what_adds_nothing_to_a_fit_made_for_its_sake_is_no_effect() {
        let (data, base) = reversing(0.3);
        let right = judged(fitted(&data, &base, EffectId::CoulombFriction));
        let with_offset = |offset: f64| {
            let Hypothesis { model, parameters, nuisances, .. } = right.fitted.clone();
            let (own, open) = parameters.split_at(model.parameter_count());
            let model =
                Model::new(data.signals.context, &[EffectId::CoulombFriction, EffectId::CurrentOffset]);
            let parameters = [own, &[offset, 0.0], open].concat();
            judged(Hypothesis::on(&data, model, parameters, Vec::new(), nuisances))
        };
        let mut seen = vec![judged(base), astray(&data, &right, |x| x[BASE] *= 1.5)];
        let scale = Scale::new([&right].into_iter());
        let found = search(&data).pruned(with_offset(0.0), &scale, &mut seen).unwrap();
        assert_eq!(found.fitted.effects(), [EffectId::CoulombFriction]);
        assert_eq!(found.fitted.parameters, right.fitted.parameters);
        let (strong, offset) = (with_offset(5.0), EffectId::CurrentOffset);
        assert!(
            search(&data).needless(&strong, offset, &scale, &mut []).unwrap().is_some(),
            "it is worse with it"
        );
        let friction = search(&data).needless(&right, EffectId::CoulombFriction, &scale, &mut []).unwrap();
        assert!(friction.is_none());
    }

    #[test]
    fn an_effect_of_no_strength_gives_its_fit_to_the_bare_machine() {
        let (data, base) = reversing(0.0);
        let right = judged(base);
        let offset = judged({
            let Hypothesis { parameters, nuisances, .. } = right.fitted.clone();
            let (own, open) = parameters.split_at(BASE);
            let model = Model::new(data.signals.context, &[EffectId::CurrentOffset]);
            Hypothesis::on(&data, model, [own, &[0.0, 0.0], open].concat(), Vec::new(), nuisances)
        });
        let mut seen = vec![astray(&data, &right, |x| x[BaseParameter::J.index()] *= 1.02)];
        assert!(right.excess() < 0.1 && seen[0].excess() > 0.3, "{}", seen[0].excess());
        let scale = Scale::new([&right, &seen[0]].into_iter());
        let found = search(&data).pruned(offset, &scale, &mut seen).unwrap();
        assert_eq!(found.fitted.effects(), []);
        assert!(found.excess() < 0.1 && seen[0].excess() < 0.1, "{}", found.excess());
    }

    #[test]
    fn a_torque_that_turns_over_too_slowly_does_not_speak_for_a_wider_effect() {
        let (data, base) = reversing(0.5);
        let [right, wide] =
            [EffectId::CoulombFriction, EffectId::StribeckFriction].map(|e| judged(fitted(&data, &base, e)));
        let slow = astray(&data, &right, |x| x[BASE + 1] = 20.0);
        assert!(right.excess() < 0.1 && slow.excess() > 0.3, "{}", slow.excess());

        let scale = Scale::new([&right, &wide, &slow].into_iter());
        let (replaced, by) = (EffectId::CoulombFriction, Some(EffectId::StribeckFriction));
        let swap = Swap { replaced, by, judged: wide.clone() };
        let found = search(&data).as_wider(slow.clone(), &[swap], &scale).unwrap();
        assert_eq!(found.fitted.effects(), [EffectId::CoulombFriction]);
        assert!(found.excess() < 0.1, "{}", found.excess());
        let mut seen = vec![judged(base), slow];
        let found = search(&data).pruned(wide, &scale, &mut seen).unwrap();
        assert_eq!(found.fitted.effects(), [EffectId::CoulombFriction]);
        assert!(found.excess() < 0.1 && seen[1].excess() < 0.1, "{}", found.excess());
    }
}
