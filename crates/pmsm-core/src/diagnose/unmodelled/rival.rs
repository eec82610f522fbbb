//! Whether the torque that the named effects do not explain is of their own size. An effect may explain nine tenths of a speed error and
//! still describe the torque badly. Inertia filters fast changes, so that the mean of a torque at one place of the turn resembles friction.

use super::{Side, Unmodelled, candidates, choice, places, sides, with_maps};
use crate::base::Base;
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::effect::{Mechanical, Site};
use crate::error::Result;
use crate::map::Map;
use crate::model::Slot;
use crate::monitor::Monitor;
use crate::simulate::environment::measured_env;

/// Root mean square of an unmodelled torque, over that of the effects, from which these are no explanation.
const COMPARABLE: f64 = 0.5;

/// The map of the torque that the effects of `best`, of which at least one is mechanical, leave unexplained, with the model it stands in:
/// if it predicts what it was not fitted to and is as large as half of what they explain.
///
/// # Errors
/// Those of the least-squares fits.
pub fn rival(
    data: &Data,
    validation: Option<&Data>,
    best: &Hypothesis,
    monitor: &dyn Monitor,
) -> Result<Option<(Hypothesis, Unmodelled)>> {
    let mechanical = best.effects().iter().any(|e| e.info().site == Site::Mechanical);
    if !mechanical || best.model.mechanical_states() > 0 || !sides(data, best).contains(&Side::Mechanical) {
        return Ok(None);
    }
    // To first order already; the fits cost more.
    let first = choice::choose(data, best, Side::Mechanical, &places(data, best, Side::Mechanical), monitor)?;
    let Some(first) = first.into_iter().next() else { return Ok(None) };
    let model = best.model.clone().with_map(Map { parts: vec![first.part] });
    let promised = Hypothesis::unfitted(model, [best.own(), &first.start].concat());
    if share(data, &promised) < COMPARABLE {
        return Ok(None);
    }
    let (fitted, unmodelled) = with_maps(data, validation, best, &[Side::Mechanical], monitor)?;
    Ok((share(data, &fitted) > COMPARABLE).then_some((fitted, unmodelled)))
}

/// Root mean square of the map's torque over that of the effects, along the recording.
fn share(data: &Data, fitted: &Hypothesis) -> f64 {
    let base = Base::new(fitted.own());
    let torque = candidates::torque(data, fitted);
    let samples = data.runs().iter().flat_map(|run| (0..run.signals.len()).map(move |k| (&run.signals, k)));
    let slots: Vec<&Slot> = fitted.model.slots().iter().collect();
    let (mut map, mut effects) = (0.0, 0.0);
    for ((signals, k), tau_e) in samples.zip(torque) {
        let env = measured_env(signals, k);
        let at = Mechanical { env, omega_m: env.omega_e / signals.n_p, tau_e, tau_load: 0.0, j: base.j };
        map += fitted.model.mapped_torque(fitted.own(), &at).powi(2);
        effects += fitted.model.torque_lost((&slots, false), fitted.own(), &at).powi(2);
    }
    if map == 0.0 { 0.0 } else { (map / effects).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::effects::EffectId;
    use crate::monitor::Silent;

    /// Friction of 0.3 N·m with a torque of this size that comes once per turn, friction alone being known.
    fn beside_friction(size: f64) -> Option<(Hypothesis, Unmodelled)> {
        let manoeuvre = speeds(2.0, &[(0.2, 60.0), (0.6, 100.0), (1.0, -40.0), (1.4, -90.0), (1.8, 70.0)]);
        let mut pulsating = choice("load_torque_pulsation", "a", size);
        pulsating.parameters.insert("order_mech".into(), 1.0);
        let (data, base) = data(&setup(manoeuvre, vec![choice("coulomb_friction", "tau_c", 0.3), pulsating]));
        let friction = fitted(&data, &base, EffectId::CoulombFriction);
        rival(&data, None, &friction, &Silent).unwrap()
    }

    #[test]
    fn what_friction_leaves_takes_its_name_away_only_if_it_is_of_its_size() {
        let (model, unmodelled) = beside_friction(0.5).expect("it is larger than the friction");
        assert_eq!(model.effects(), [EffectId::CoulombFriction]);
        assert!((unmodelled.terms[0].peak - 0.5).abs() < 0.05, "{unmodelled:?}");
        assert!(beside_friction(0.1).is_none());
    }
}
