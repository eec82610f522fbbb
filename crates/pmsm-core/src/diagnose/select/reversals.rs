//! A friction in place of the steps of an unknown load at reversals. Both describe the same torque, the friction with one parameter.

use super::Search;
use crate::diagnose::evidence::Evidence;
use crate::diagnose::fitting;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::motion;
use crate::diagnose::verdict::Validated;
use crate::effect::Role;
use crate::effects::EffectId;
use crate::error::Result;
use crate::model::Model;

impl Search<'_> {
    /// Tries a friction in place of the load steps at reversals: each of the `absent` effects whose torque jumps there. The set with most
    /// evidence comes back, if it has more than `best`. A fit that begins without friction beside these steps does not find it.
    pub(super) fn friction_for_steps(
        &self,
        best: &Validated,
        absent: &[EffectId],
        evidence: &Evidence,
    ) -> Result<Option<Validated>> {
        if best.fitted.effects().len() >= self.most {
            return Ok(None);
        }
        let Some((under, height)) = motion::without_reversals(self.data, &best.fitted) else {
            return Ok(None);
        };
        let mut sets = Vec::new();
        for effect in absent.iter().copied().filter(|e| e.jumps()) {
            self.monitor.go_on()?;
            if let Some(fitted) = self.under(&best.fitted, effect, &under, height)? {
                sets.push(self.validate(fitted)?);
            }
        }
        Ok(evidence.best_of(sets.iter(), best).cloned())
    }

    /// A set fitted with one effect more, which begins with a torque of this height, `under` a load that has no more steps than that.
    fn under(
        &self,
        set: &Hypothesis,
        effect: EffectId,
        under: &Hypothesis,
        height: f64,
    ) -> Result<Option<Hypothesis>> {
        let (context, parameters) = (set.model.context(), effect.info().parameters);
        let strength = parameters.iter().position(|p| p.role == Role::Amplitude && p.unit == "N m");
        let (Some(strength), Some(mut own)) = (strength, effect.probes(context).into_iter().next()) else {
            return Ok(None);
        };
        let (low, high) = ((parameters[strength].low)(context), (parameters[strength].high)(context));
        own[strength] = height.clamp(low, high);
        let model = Model::new(*context, &[set.effects(), vec![effect]].concat());
        let start = [set.own(), &own].concat();
        let fitted = fitting::fit_under(Some(under), &[], self.data, &model, (&start, true), self.monitor)?;
        Ok((!fitted.vanishes(effect)).then_some(fitted))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::search;
    use super::*;
    use crate::diagnose::testing::{self, choice, setup, speeds};
    use crate::drive::{Schedule, Shape};

    #[test]
    fn friction_takes_the_place_of_load_steps_at_reversals() {
        let mut manoeuvre =
            speeds(2.0, &[(0.1, 60.0), (0.5, -60.0), (1.0, -40.0), (1.3, 70.0), (1.7, -50.0)]);
        let steps = vec![(0.0, 0.4), (0.8, 2.2), (1.5, 0.9)];
        manoeuvre.tau_load = Some(Schedule::new(steps, Shape::Steps).unwrap());
        let friction = EffectId::CoulombFriction;
        let present = setup(manoeuvre, vec![choice("coulomb_friction", "tau_c", 0.1)]);
        let (data, base) = testing::data(&present);
        let count = |found: &Hypothesis| found.nuisances[0].steps();
        assert!(count(&base) > 3, "{:?}", base.parameters);
        let parent = Validated { fitted: base, held_out: Vec::new(), refuted: false };
        let search = search(&data);
        let evidence = search.evidence().limited(std::iter::once(&parent));
        let asked = [EffectId::QuadraticDrag, friction];
        let found = search.friction_for_steps(&parent, &asked, &evidence).unwrap();
        let found = found.expect("friction is there").fitted;
        assert_eq!((found.effects(), count(&found)), (vec![friction], 2), "{:?}", found.parameters);
        let slot = &found.model.slots()[0];
        let tau_c = found.parameters[slot.parameters.start];
        assert!((tau_c - 0.1).abs() < 0.02, "{tau_c}");
    }
}
