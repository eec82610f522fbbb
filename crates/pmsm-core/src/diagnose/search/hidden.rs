//! What the steps of an unknown load hide where the speed reverses: a friction that jumps there, which the load can stand in for.

use super::extend::Aim;
use super::sets::{explains, sorted};
use super::{BRANCHES, Search};
use crate::diagnose::reversals;
use crate::diagnose::scale::Scale;
use crate::diagnose::verdict::Judged;
use crate::effects::EffectId;
use crate::error::Result;

impl Search<'_> {
    /// Whether the load steps where the speed reverses, on any recording.
    pub(super) fn steps_reverse(&self, judged: &Judged) -> bool {
        let held_out = self.held_out.iter().zip(&judged.held_out);
        std::iter::once((&self.data, &judged.fitted))
            .chain(held_out)
            .any(|(d, h)| reversals::meets_step(d, h))
    }

    /// The bare machine as `best` is to be compared with: without the load steps that an effect of it makes needless.
    pub(super) fn compared(&self, best: &Judged, base: Judged) -> Result<Judged> {
        let effects = best.fitted.effects();
        if effects.is_empty() {
            return Ok(best.clone());
        }
        if !effects.iter().any(|e| e.jumps()) || !self.steps_reverse(&base) {
            return Ok(base);
        }
        self.under_load_of(best, &base.fitted, base.refuted)
    }

    /// The best set, with an effect more that jumps at reversals if it beats it: where everything is explained, and the load steps at
    /// reversals, a further effect takes away steps and hardly any squares.
    pub(super) fn behind_steps(
        &self,
        best: Judged,
        base: &Judged,
        able: &[EffectId],
        seen: &mut Vec<Judged>,
        scale: &mut Scale,
    ) -> Result<Judged> {
        let effects = best.fitted.effects();
        let asked = !effects.is_empty() && effects.len() < self.most && !effects.iter().any(|e| e.jumps());
        if !asked || self.monitor.cancelled() || !explains(&best, base) || !self.steps_reverse(&best) {
            return Ok(best);
        }
        let jumping: Vec<EffectId> = self.rest(able, &best).into_iter().filter(|e| e.jumps()).collect();
        let aim = Aim { base, best: None, most: BRANCHES, thorough: false };
        let extended = self.extend(&best, &jumping, aim)?;
        let larger: Vec<Judged> = extended.into_iter().filter_map(|(_, j)| j).collect();
        seen.extend(larger.iter().cloned());
        *scale = Scale::new(seen.iter());
        let first = sorted(&larger, scale).into_iter().next();
        Ok(first.filter(|first| scale.beats(first, &best)).unwrap_or(best))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::drive::{Schedule, Shape};
    use crate::monitor::Silent;

    /// The effects found beside a drag that explains everything, under an unknown load, for Coulomb friction of this strength.
    fn beside_drag(tau_c: f64) -> (bool, Vec<EffectId>) {
        let mut manoeuvre =
            speeds(2.0, &[(0.1, 60.0), (0.5, -60.0), (1.0, -40.0), (1.3, 70.0), (1.7, -50.0)]);
        manoeuvre.i_d = Some(Schedule::new(vec![(0.0, 0.0), (0.3, -4.0), (1.4, 2.0)], Shape::Steps).unwrap());
        manoeuvre.tau_load = Some(Schedule::new(vec![(0.0, 0.4), (0.55, 1.2)], Shape::Steps).unwrap());
        manoeuvre.load_kind = Some("unknown_piecewise".into());
        let mut effects = vec![choice("quadratic_drag", "k", 1e-4)];
        if tau_c > 0.0 {
            effects.push(choice("coulomb_friction", "tau_c", tau_c));
        }
        let (data, base) = data(&setup(manoeuvre, effects));
        let judged = |fitted| Judged { fitted, held_out: Vec::new(), refuted: false };
        let drag = judged(fitted(&data, &base, EffectId::QuadraticDrag));
        let base = judged(base);
        assert!(explains(&drag, &base), "{}", drag.excess());
        let search =
            Search { data: &data, held_out: Vec::new(), refuting: Vec::new(), most: 3, monitor: &Silent };
        let mut seen = vec![base.clone(), drag.clone()];
        let mut scale = Scale::new(seen.iter());
        let reverses = search.steps_reverse(&drag);
        let able = [EffectId::SaturationQ, EffectId::CoulombFriction];
        let best = search.behind_steps(drag, &base, &able, &mut seen, &mut scale).unwrap();
        (reverses, best.fitted.effects())
    }

    #[test]
    fn friction_behind_the_steps_of_a_load_is_found_beside_an_effect_that_explains_everything() {
        let (reverses, found) = beside_drag(0.02);
        assert!(reverses);
        assert_eq!(found, [EffectId::QuadraticDrag, EffectId::CoulombFriction]);
    }

    #[test]
    fn a_load_that_steps_beside_a_reversal_is_no_friction() {
        let (_, found) = beside_drag(0.0);
        assert_eq!(found, [EffectId::QuadraticDrag]);
    }
}
