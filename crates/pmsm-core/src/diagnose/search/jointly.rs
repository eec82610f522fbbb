//! Rivals that explain the recording, but not the run that they were not fitted to, fitted to both.
//!
//! Parameters that a recording hardly shows take a rival astray elsewhere, and it loses there against a best set that does not do quite
//! well either. Fitted to both runs it may do as well or better, which it could not if its physics were wrong.

use super::Search;
use super::variants::Swap;
use crate::diagnose::data::Data;
use crate::diagnose::fitting;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::scale::{INDISTINGUISHABLE, Scale};
use crate::diagnose::transfer::transfer;
use crate::diagnose::verdict::{Judged, MISMATCH, UNEXPLAINED};
use crate::effects::EffectId;
use crate::error::Result;
use crate::signals::Signals;

/// Rivals that are fitted to both runs at most.
const ASKED: usize = 2;

impl Search<'_> {
    /// Rivals of the best set (the effect of it, what stands in its place) that lose on the other run alone, and that, fitted to both at
    /// once, explain them as well as it does. None are looked for where it explains that run, nor among several recordings.
    pub(super) fn reopened(
        &self,
        best: &Judged,
        swaps: &[Swap],
        scale: &Scale,
    ) -> Result<Vec<(EffectId, EffectId)>> {
        let [other] = self.held_out[..] else { return Ok(Vec::new()) };
        let asked = best.excess() < MISMATCH && best.held_out_excess() > UNEXPLAINED.1;
        if !asked || !alike(self.data, other) || !self.fits_both(best) || self.monitor.cancelled() {
            return Ok(Vec::new());
        }
        let here = scale.fitted_misfit(best);
        let astray = |swap: &&Swap| {
            swap.by.is_some_and(|by| !by.contains(swap.replaced))
                && self.fits_both(&swap.judged)
                && swap.judged.excess() < MISMATCH
                && scale.fitted_misfit(&swap.judged) < here + INDISTINGUISHABLE
                && scale.loss(&swap.judged) >= scale.loss(best) + INDISTINGUISHABLE
        };
        let mut rivals: Vec<&Swap> = swaps.iter().filter(astray).collect();
        rivals.sort_by(|a, b| scale.loss(&a.judged).total_cmp(&scale.loss(&b.judged)));
        rivals.truncate(ASKED);
        if rivals.is_empty() {
            return Ok(Vec::new());
        }
        let all = Data::joined(vec![self.data.clone(), other.clone()], Vec::new());
        let together = self.together(&all, best)?;
        let mut open = Vec::new();
        for rival in rivals {
            let judged = self.together(&all, &rival.judged)?;
            // A fit that was stopped tells nothing.
            if self.monitor.cancelled() {
                return Ok(Vec::new());
            }
            let scale = Scale::new([&together, &judged].into_iter());
            if scale.loss(&judged) < scale.loss(&together) + INDISTINGUISHABLE {
                open.extend(rival.by.map(|by| (rival.replaced, by)));
            }
        }
        Ok(open)
    }

    /// The set `simpler`, in which a special case stands in place of an effect of `wide`, as it does on the other run where it is fitted to
    /// both: if it is as good on the recording and as good on both, what it leaves there tells how little the recording pins it down, and
    /// nothing of what is missing.
    pub(super) fn eased(&self, wide: &Judged, simpler: Judged, scale: &Scale) -> Result<Judged> {
        let [other] = self.held_out[..] else { return Ok(simpler) };
        let as_good = scale.fitted_misfit(&simpler) < scale.fitted_misfit(wide) + INDISTINGUISHABLE;
        let asked = as_good
            && simpler.excess() < MISMATCH
            && scale.held_out_misfit(wide) < scale.held_out_misfit(&simpler);
        let comparable = alike(self.data, other) && self.fits_both(wide) && self.fits_both(&simpler);
        if !asked || !comparable || self.monitor.cancelled() {
            return Ok(simpler);
        }
        let all = Data::joined(vec![self.data.clone(), other.clone()], Vec::new());
        let (wide, narrow) = (self.together(&all, wide)?, self.together(&all, &simpler)?);
        if self.monitor.cancelled() || Scale::new([&wide, &narrow].into_iter()).widens(&wide, &narrow) {
            return Ok(simpler);
        }
        let mut fitted = simpler.fitted.clone();
        let own = narrow.fitted.own();
        fitted.parameters[..own.len()].copy_from_slice(own);
        let held_out = vec![transfer(other, &fitted, self.monitor)?];
        Ok(Judged { held_out, ..simpler })
    }

    /// Whether the parameters of a set mean the same on both runs, which may begin in different electrical turns of the revolution unless
    /// both are parts of one.
    fn fits_both(&self, judged: &Judged) -> bool {
        let one_turn = self.data.signals.turn_known || self.data.held_out.is_some();
        one_turn || judged.fitted.model.turned(judged.fitted.own(), 1.0).is_none()
    }

    /// A set fitted to both runs, or as it stands on them if that is better: loads and a fit of everything at once may not be found again.
    fn together(&self, all: &Data, judged: &Judged) -> Result<Judged> {
        let Hypothesis { model, mut parameters, free, mut nuisances, .. } = judged.fitted.clone();
        let count = model.parameter_count();
        for run in &judged.held_out {
            parameters.extend(&run.parameters[count..]);
            nuisances.extend(&run.nuisances);
        }
        let free: Vec<usize> = free.into_iter().filter(|k| *k < count).collect();
        let as_it_is = Hypothesis::on(all, model, parameters, free, nuisances);
        let fitted = fitting::refit(all, &judged.fitted, self.monitor)?;
        let [as_it_is, fitted] =
            [as_it_is, fitted].map(|fitted| Judged { fitted, held_out: Vec::new(), refuted: false });
        let scale = Scale::new([&as_it_is, &fitted].into_iter());
        Ok(if scale.loss(&as_it_is) < scale.loss(&fitted) { as_it_is } else { fitted })
    }
}

/// Whether two runs have the same equations and refer to the same temperatures.
fn alike(a: &Data, b: &Data) -> bool {
    let told = |data: &Data| {
        let Signals { kind, context, .. } = &data.signals;
        (*kind, context.has_temperature, context.has_magnet_temperature)
    };
    a.parts.is_empty() && b.parts.is_empty() && told(a) == told(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, narrow, setup, speeds};
    use crate::drive::Choice;
    use crate::monitor::Silent;

    #[test]
    fn what_both_runs_fit_together_is_left_open_and_nothing_else() {
        // On the recording, in one direction and at hardly any change of speed, drag and dry friction look alike; on the other run not.
        let (drag, dry) = (EffectId::QuadraticDrag, EffectId::CoulombFriction);
        let with = |manoeuvre| data(&setup(manoeuvre, vec![choice("quadratic_drag", "k", 8e-6)]));
        let (data, base) = with(narrow());
        let (other, _) = with(speeds(1.0, &[(0.1, 90.0), (0.4, -80.0), (0.8, 60.0)]));
        let search = Search {
            data: &data,
            held_out: vec![&other],
            refuting: Vec::new(),
            most: super::super::MOST,
            monitor: &Silent,
        };
        // As a fit to the recording leaves them elsewhere that went astray by this much.
        let astray = |effect, much: f64| {
            let mut judged = search.judge(fitted(&data, &base, effect)).unwrap();
            judged.held_out[0].squares.iter_mut().for_each(|(_, square)| *square = much);
            judged
        };
        let open = |best: (EffectId, f64), rival: (EffectId, f64)| {
            let (replaced, by) = (best.0, Some(rival.0));
            let (best, judged) = (astray(best.0, best.1), astray(rival.0, rival.1));
            let scale = Scale::new([&best, &judged].into_iter());
            search.reopened(&best, &[Swap { replaced, by, judged }], &scale).unwrap()
        };
        assert_eq!(open((dry, 1.5), (drag, 3.0)), [(dry, drag)]);
        assert_eq!(open((drag, 1.5), (dry, 3.0)), []);
        // A best set that explains the other run is not asked about.
        assert_eq!(open((dry, 1.05), (drag, 3.0)), []);
    }

    #[test]
    fn a_special_case_that_fits_both_runs_is_not_held_to_what_one_hardly_shows() {
        let (dry, sticking) = (EffectId::CoulombFriction, EffectId::StribeckFriction);
        let held_out = |truth: Choice| {
            let with = |manoeuvre| data(&setup(manoeuvre, vec![truth.clone()]));
            let (data, base) = with(speeds(1.0, &[(0.1, 90.0), (0.4, -80.0), (0.8, 60.0)]));
            let (other, _) = with(speeds(1.0, &[(0.1, -60.0), (0.4, 40.0), (0.8, -90.0)]));
            let (held_out, refuting) = (vec![&other], Vec::new());
            let search =
                Search { data: &data, held_out, refuting, most: super::super::MOST, monitor: &Silent };
            let wide = search.judge(fitted(&data, &base, sticking)).unwrap();
            let mut narrow = search.judge(fitted(&data, &base, dry)).unwrap();
            // As good on the recording, and astray on the other run.
            narrow.fitted.squares.clone_from(&wide.fitted.squares);
            narrow.held_out[0].squares.iter_mut().for_each(|(_, square)| *square = 3.0);
            let scale = Scale::new([&wide, &narrow].into_iter());
            let eased = search.eased(&wide, narrow.clone(), &scale).unwrap();
            assert_eq!(eased.fitted.parameters, narrow.fitted.parameters);
            (eased.held_out_excess(), scale.widens(&wide, &eased))
        };
        let (left, widens) = held_out(choice("coulomb_friction", "tau_c", 0.1));
        assert!(left < 0.1 && !widens, "{left}");
        let mut sticks = choice("stribeck_friction", "tau_c", 0.05);
        sticks.parameters.insert("tau_x".into(), 0.25);
        let (left, widens) = held_out(sticks);
        assert!(left > 1.0 && widens, "{left}");
    }
}
