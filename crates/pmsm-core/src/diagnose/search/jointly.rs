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
        // Runs may begin in different electrical turns of the revolution, unless both are parts of one.
        let one_turn = self.data.signals.turn_known || self.data.held_out.is_some();
        let fits_both = |j: &Judged| one_turn || j.fitted.model.turned(j.fitted.own(), 1.0).is_none();
        if !asked || !alike(self.data, other) || !fits_both(best) || self.monitor.cancelled() {
            return Ok(Vec::new());
        }
        let here = scale.fitted_misfit(best);
        let astray = |swap: &&Swap| {
            swap.by.is_some_and(|by| !by.contains(swap.replaced))
                && fits_both(&swap.judged)
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
}
