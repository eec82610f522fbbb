//! Effects whose fit has many minima, such as backlash: each impact of a load falls at a time of its own, and a small error of a parameter
//! moves all of them. A particle swarm looks for their parameters, where nothing else explains the motion.

use super::data::Data;
use super::decimation;
use super::evidence::{Evidence, price};
use super::fitting;
use super::hypothesis::Hypothesis;
use super::identifiability::identifiable;
use super::score::{Ranging, Scorer};
use super::select::reduced;
use crate::effects::EffectId;
use crate::error::Result;
use crate::model::Model;
use crate::monitor::Monitor;

/// Particles and moves of the swarm that tells whether an effect explains anything, of the one that looks for its parameters, and of those
/// that look again about a fit.
const SCOUTS: (usize, usize) = (48, 5);
const SEARCHERS: (usize, usize) = (48, 25);
const NEARER: (usize, usize) = (24, 12);
/// Factors about a fit within which the swarm looks again, beside the parameters that were fitted with it.
const FACTORS: [f64; 2] = [1.6, 1.25];

/// The set with most evidence of those with one such effect more, each in place of its special cases. None where none has more than `set`.
///
/// # Errors
/// Those of the swarm and of the least-squares fits.
pub fn grown(data: &Data, set: &Hypothesis, monitor: &dyn Monitor) -> Result<Option<Hypothesis>> {
    let fewer = decimation::decimated(data, &[]).map(|found| found.0);
    let data = &fewer.as_ref().unwrap_or(data).roughly();
    let present = set.effects();
    let evidence = Evidence::new(data, &[]);
    let cost = |set: &Hypothesis| evidence.cost_on_recording(set);
    let bare = fitting::fit(data, &set.model, set.own(), true, monitor)?;
    let (mut best, mut least) = (None, cost(&bare));
    let asked = |e: &EffectId| e.is_multimodal() && !present.contains(e);
    for effect in identifiable(data).0.into_iter().filter(asked) {
        monitor.go_on()?;
        let special = present.iter().copied().filter(|e| effect.contains(*e));
        let (model, own) = special.fold((set.model.clone(), set.own().to_vec()), |(model, own), narrow| {
            reduced(&Hypothesis::unfitted(model, own), narrow)
        });
        let without = fitting::fit(data, &model, &own, true, monitor)?;
        if let Some(fitted) = with_one(data, &without, effect, &cost, monitor)?
            && cost(&fitted) < least
        {
            (least, best) = (cost(&fitted), Some(fitted));
        }
    }
    Ok(best)
}

/// A set with one such effect more, where the first moves of a swarm explain as much as the effect costs.
fn with_one(
    data: &Data,
    without: &Hypothesis,
    effect: EffectId,
    cost: &dyn Fn(&Hypothesis) -> f64,
    monitor: &dyn Monitor,
) -> Result<Option<Hypothesis>> {
    let (options, samples) = (&data.options, data.counted() as f64 / data.options.rows_per_sample);
    let asked = options.effect_cost + price(&[samples], options) * effect.info().parameters.len() as f64;
    let short = data.in_short_windows();
    let beside = fitting::fit(&short, &without.model, without.own(), true, monitor)?;
    let scorer = Scorer::new(&short, &beside);
    let scouted = scorer.by_swarm(effect, Ranging { size: SCOUTS, about: None }, monitor)?;
    if -0.5 * samples * (1.0 - scouted.score).max(f64::MIN_POSITIVE).ln() < asked {
        return Ok(None);
    }
    let found = scorer.by_swarm(effect, Ranging { size: SEARCHERS, about: None }, monitor)?;
    let model = Model::new(*without.model.context(), &[without.effects(), vec![effect]].concat());
    let mut fitted = fitting::fit(data, &model, &[without.own(), &found.start].concat(), true, monitor)?;
    for factor in FACTORS {
        let again = nearer(data, &fitted, effect, factor, monitor)?;
        if cost(&again) < cost(&fitted) {
            fitted = again;
        }
    }
    Ok(Some(fitted))
}

/// A set fitted anew from the best parameters of an effect within a factor about those it has.
fn nearer(
    data: &Data,
    set: &Hypothesis,
    effect: EffectId,
    factor: f64,
    monitor: &dyn Monitor,
) -> Result<Hypothesis> {
    let slot = set.model.slots().iter().find(|slot| slot.effect == effect).expect("the set holds it");
    let place = slot.parameters.clone();
    let others = set.free.iter().copied().filter(|k| !place.contains(k)).collect();
    let held = Hypothesis { free: others, ..set.clone() };
    let about = Some((&set.own()[place.clone()], factor));
    let found = Scorer::new(data, &held).by_swarm(effect, Ranging { size: NEARER, about }, monitor)?;
    let mut start = set.own().to_vec();
    start[place].copy_from_slice(&found.start);
    fitting::fit(data, &set.model, &start, true, monitor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{data, fitted, setup, speeds};
    use crate::drive::Choice;
    use crate::experiment::Channel;
    use crate::monitor::Silent;

    #[test]
    fn play_between_rotor_and_load_is_found_by_a_swarm_and_not_where_there_is_none() {
        let path: Vec<(f64, f64)> =
            (0..6).map(|k| (0.05 + 0.2 * f64::from(k), [30.0, -20.0][k as usize % 2])).collect();
        let play = [("inertia_ratio", 0.5), ("gap", 0.06), ("f_contact", 60.0), ("zeta", 0.2)];
        let play = Choice {
            effect: "backlash".into(),
            parameters: play.map(|(name, x)| (name.to_string(), x)).into(),
            definition: None,
        };
        let (with, base) = data(&setup(speeds(1.2, &path), vec![play]));
        let found = grown(&with, &base, &Silent).unwrap().expect("there is play");
        assert_eq!(found.effects(), [EffectId::Backlash]);
        let square = |set: &Hypothesis| set.square(Channel::OmegaE);
        assert!(square(&found) - 1.0 < 0.1 * (square(&base) - 1.0), "{} {}", square(&found), square(&base));
        let own = &found.own()[found.model.slots()[0].parameters.clone()];
        assert!((own[0] - 0.5).abs() < 0.05 && (own[1] - 0.06).abs() < 0.006, "{own:?}");
        // Where friction is missing, no play is found beside it.
        let friction = crate::diagnose::testing::choice("coulomb_friction", "tau_c", 0.4);
        let (without, base) = data(&setup(speeds(1.2, &path), vec![friction]));
        let friction = fitted(&without, &base, EffectId::CoulombFriction);
        assert!(grown(&without, &friction, &Silent).unwrap().is_none());
    }
}
