//! One more effect, found on the validation run. On the fitted recording other parameters may compensate for it; at other operating points
//! they cannot.

use super::Search;
use super::grow::REFITTED;
use crate::diagnose::data::Data;
use crate::diagnose::evidence::Evidence;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::score::{Prospect, Scorer};
use crate::diagnose::verdict::{self, Validated};
use crate::effects::EffectId;
use crate::error::Result;
use rayon::prelude::*;

impl Search<'_> {
    /// Adds to `best` that one of the `absent` effects which explains its residual on the other recordings, if the evidence grows. The
    /// effects are scored there. The set is refitted to the fitted recording with each of the leading ones. Where a set does not explain the
    /// fitted recording either, that one has been asked already.
    pub(super) fn extended_by_validation(
        &self,
        best: &Validated,
        absent: &[EffectId],
        evidence: &Evidence,
    ) -> Result<Option<Validated>> {
        // Both halves of one recording hold the same operating points.
        let same_points = self.data.held_out.is_some();
        let explained = best.excess() <= self.data.options.form_error();
        if best.fitted.effects().len() >= self.most || same_points || !explained {
            return Ok(None);
        }
        let mut sets: Vec<Validated> = Vec::new();
        for (data, there) in self.held_out.iter().zip(&best.held_out) {
            if verdict::largest_excess(there) <= self.data.options.mismatch {
                continue;
            }
            let prospects = self.leading_on(data, &best.fitted, there, absent)?;
            let refit = |prospect: &Prospect| -> Result<Option<Validated>> {
                self.refit(best, prospect)?.map(|fitted| self.validate(fitted)).transpose()
            };
            let refitted: Vec<Option<Validated>> = prospects.par_iter().map(refit).collect::<Result<_>>()?;
            sets.extend(refitted.into_iter().flatten());
        }
        Ok(evidence.best_of(sets.iter(), best).cloned())
    }

    /// The effects with the highest scores on another recording `data`, beside the fitted parameters of `set`. `there` is the set as it
    /// predicts that recording.
    fn leading_on(
        &self,
        data: &Data,
        set: &Hypothesis,
        there: &Hypothesis,
        absent: &[EffectId],
    ) -> Result<Vec<Prospect>> {
        let own = set.own().len();
        let fitted = set.free.iter().copied().filter(|k| *k < own);
        let there = Hypothesis { free: fitted.chain(own..there.parameters.len()).collect(), ..there.clone() };
        let scorer = Scorer::new(data, &there);
        let score = |effect: &EffectId| scorer.score(*effect, self.monitor);
        let mut prospects: Vec<Prospect> = absent.par_iter().map(score).collect::<Result<_>>()?;
        prospects.sort_by(|a, b| b.score.total_cmp(&a.score));
        prospects.truncate(REFITTED);
        Ok(prospects)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::search;
    use super::*;
    use crate::diagnose::testing::{self, choice, setup, speeds};
    use crate::drive::Manoeuvre;

    #[test]
    fn a_drag_that_the_recording_hides_in_the_viscous_friction_is_found_by_the_validation_run() {
        let run = |manoeuvre: Manoeuvre| {
            let present = vec![choice("quadratic_drag", "k", 2e-5)];
            testing::data(&setup(manoeuvre, present))
        };
        // Between two speeds the drag is a line; from one of them to a standstill it is not.
        let near = [(0.0, 100.0), (0.3, 90.0), (0.5, 100.0), (0.7, 90.0), (0.9, 100.0)];
        let (data, base) = run(speeds(1.1, &near));
        let (other, _) = run(speeds(1.1, &[(0.1, 110.0), (0.4, 5.0), (0.7, 110.0), (0.9, 30.0)]));
        let mut search = search(&data);
        search.held_out = vec![&other];
        let bare = search.validate(base).unwrap();
        let absent = [EffectId::CoggingTorque, EffectId::QuadraticDrag, EffectId::TimeVaryingLoad];
        let asked = |search: &Search, set: &Validated| {
            let evidence = search.evidence().limited(std::iter::once(set));
            search.extended_by_validation(set, &absent, &evidence).unwrap()
        };
        let larger = asked(&search, &bare);
        assert!(bare.fitted.squares.iter().all(|(_, s)| *s < 1.5), "{:?}", bare.fitted.squares);
        assert_eq!(larger.unwrap().fitted.effects(), [EffectId::QuadraticDrag]);
        // Nothing is added where the recording itself is not explained, nor where the other run is.
        let mut far = bare.clone();
        far.fitted.squares.iter_mut().for_each(|(_, square)| *square = 100.0);
        assert!(asked(&search, &far).is_none());
        search.held_out = vec![&data];
        let same = search.validate(bare.fitted.clone()).unwrap();
        assert!(asked(&search, &same).is_none());
    }
}
