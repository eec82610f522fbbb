//! Effects beside a map: which of a set explain what a smooth map of the same equation cannot.
//!
//! Where a set has more than noise left, something else is missing, and it may have lent its shape to a name: a curve of friction that no
//! catalogue holds looks like a sum of those that it holds. So each effect is held against maps of what the set without it has left. One
//! that a map replaces has not earned its name.

use super::{Side, explain, sides};
use crate::diagnose::data::Data;
use crate::diagnose::evidence::{DECISIVE, Evidence};
use crate::diagnose::fitting;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::select::reduced;
use crate::diagnose::transfer::transfer;
use crate::diagnose::verdict::Judged;
use crate::effect::Site;
use crate::effects::EffectId;
use crate::error::Result;
use crate::monitor::Monitor;
use rayon::prelude::*;

/// Mean square that an effect must explain, over that which remains: four times as much by its root. Chosen by hand,
/// not calibrated.
const OUTWEIGHS: f64 = 16.0;

/// A set of effects, each of which explains what a map cannot.
pub struct Earned {
    /// The set without a map.
    pub set: Hypothesis,
    /// Posterior probability of each of its effects beside a map.
    pub probabilities: Vec<(EffectId, f64)>,
}

/// The effects of `best` that explain what a map cannot: those of an equation with nothing but noise left as they are, the others as far as
/// the recordings say so.
///
/// # Errors
/// Those of the least-squares fits.
pub fn earned(data: &Data, judge: Option<&Data>, best: &Hypothesis, monitor: &dyn Monitor) -> Result<Earned> {
    let held_out: Vec<&Data> = judge.into_iter().collect();
    let with_map = |set: &Hypothesis| -> Result<Judged> {
        let (fitted, _) = explain(data, judge, set, monitor)?;
        let held_out: Result<Vec<Hypothesis>> =
            held_out.iter().map(|other| transfer(other, &fitted, monitor)).collect();
        Ok(Judged { fitted, held_out: held_out?, refuted: false })
    };
    let mut set = best.clone();
    loop {
        let open = sides(data, &set);
        let doubtful = |effect: &EffectId| match effect.info().site {
            Site::Mechanical => open.contains(&Side::Mechanical),
            Site::Electrical => open.contains(&Side::Electrical),
            Site::Sensor => !open.is_empty(),
        };
        let asked: Vec<EffectId> = set.effects().into_iter().filter(doubtful).collect();
        if asked.is_empty() {
            let probabilities = set.effects().into_iter().map(|effect| (effect, 1.0)).collect();
            return Ok(Earned { set, probabilities });
        }
        let whole = with_map(&set)?;
        let without = |effect: &EffectId| -> Result<(EffectId, Hypothesis, Judged)> {
            let (model, start) = reduced(&set, *effect);
            let fewer = fitting::fit(data, &model, &start, false, monitor)?;
            let mapped = with_map(&fewer)?;
            Ok((*effect, fewer, mapped))
        };
        let tried: Result<Vec<(EffectId, Hypothesis, Judged)>> = asked.par_iter().map(without).collect();
        let tried = tried?;
        let sets = std::iter::once(&whole).chain(tried.iter().map(|t| &t.2));
        let evidence = Evidence::new(data, &held_out).limited(sets);
        let lent: Vec<EffectId> = tried
            .iter()
            .filter(|(.., mapped)| !outweighs(mapped, &whole))
            .map(|(effect, ..)| *effect)
            .collect();
        if !lent.is_empty() && !monitor.cancelled() {
            for effect in lent {
                let (model, start) = reduced(&set, effect);
                set = Hypothesis::bare(model, start);
            }
            set = fitting::fit(data, &set.model, &set.parameters, false, monitor)?;
            continue;
        }
        let tried: Vec<(EffectId, f64, Hypothesis)> = tried
            .into_iter()
            .map(|(effect, fewer, mapped)| (effect, evidence.cost(&mapped) - evidence.cost(&whole), fewer))
            .collect();
        // The least needed goes first: what the others are worth may change.
        let least = tried.iter().min_by(|a, b| a.1.total_cmp(&b.1));
        match least {
            Some((_, nats, fewer)) if *nats < DECISIVE && !monitor.cancelled() => set = fewer.clone(),
            _ => {
                let probability = |effect: EffectId| {
                    let nats = tried.iter().find(|(e, ..)| *e == effect).map_or(f64::INFINITY, |t| t.1);
                    (effect, 1.0 / (1.0 + (-nats).exp()))
                };
                let probabilities = set.effects().into_iter().map(probability).collect();
                return Ok(Earned { set, probabilities });
            }
        }
    }
}

/// Whether what an effect explains is far larger than what neither the set nor a map does: `without` is the set without it, `whole` the
/// set, each with its map. Of what remains nothing is known, and a part of it may have passed for the effect.
fn outweighs(without: &Judged, whole: &Judged) -> bool {
    let each = |set: &Judged| -> Vec<(f64, f64)> {
        let runs = std::iter::once(&set.fitted).chain(&set.held_out);
        runs.flat_map(|run| run.squares.iter().zip(&run.chance).map(|((_, s), chance)| (*s, *chance)))
            .collect()
    };
    let (mut explained, mut remains) = (0.0, 0.0);
    for ((without, _), (whole, chance)) in each(without).into_iter().zip(each(whole)) {
        explained += (without - whole).max(0.0);
        remains += (whole - 1.0 - chance).max(0.0);
    }
    explained >= OUTWEIGHS * remains
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::drive::Choice;
    use crate::monitor::Silent;

    /// The effects of a set that holds `named` alone which a map cannot replace.
    fn kept(present: Vec<Choice>, named: EffectId) -> Vec<(EffectId, f64)> {
        let path: Vec<(f64, f64)> =
            (0..8).map(|k| (0.05 + 0.2 * f64::from(k), [60.0, -50.0, 20.0][k as usize % 3])).collect();
        let (data, base) = data(&setup(speeds(1.6, &path), present));
        let set = fitted(&data, &base, named);
        let earned = earned(&data, None, &set, &Silent).unwrap();
        assert_eq!(earned.set.effects().len(), earned.probabilities.len());
        earned.probabilities
    }

    #[test]
    fn friction_beside_a_torque_that_no_effect_of_the_set_explains_stays_named() {
        let both = vec![choice("coulomb_friction", "tau_c", 0.3), choice("cogging_torque", "a_1", 0.3)];
        let kept = kept(both, EffectId::CoulombFriction);
        assert_eq!(kept.len(), 1, "{kept:?}");
        assert!(kept[0].0 == EffectId::CoulombFriction && kept[0].1 > 0.9, "{kept:?}");
    }

    #[test]
    fn such_a_torque_alone_names_nothing() {
        let alone = vec![choice("cogging_torque", "a_1", 0.3)];
        assert_eq!(kept(alone, EffectId::QuadraticDrag), []);
    }
}
