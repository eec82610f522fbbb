//! The budget of the mismatch: the share of the excess mean square of the dq-model that each effect explains.
//!
//! The model without an effect, refitted, shows what it explains beside the others; the dq-model with the effect shows what it explains alone.
//! A part that any of several effects could explain is shared.

use super::data::Data;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::locate;
use super::select::reduced;
use super::transfer::transfer;
use crate::effects::EffectId;
use crate::error::Result;
use crate::experiment::Channel;
use crate::monitor::Monitor;
use rayon::prelude::*;
use serde::Serialize;

/// What an effect explains, shares of the excess mean square of the dq-model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Part {
    /// The effect.
    pub effect: String,
    /// By itself. Above one where that fit found a lower minimum than the whole set, below zero where it is worse than the dq-model.
    pub alone: f64,
    /// Beside the others, none of which takes its place.
    pub beside: f64,
}

/// The budget of one channel on one run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Budget {
    /// `recording` or `validation`.
    pub run: &'static str,
    /// The channel.
    pub channel: &'static str,
    /// `d`, `q` or `mechanical`.
    pub equation: &'static str,
    /// Residual of the dq-model, times the noise.
    pub before: f64,
    /// Residual of the model, times the noise.
    pub after: f64,
    /// What each effect of the model explains.
    pub parts: Vec<Part>,
    /// Share that any of several effects could explain.
    pub shared: f64,
    /// Share that the map without a name explains.
    pub unmodelled: f64,
    /// Share that remains.
    pub rest: f64,
}

/// A model on the recording and, where there is one, on the validation run.
type On = (Hypothesis, Option<Hypothesis>);

/// The models between which the budget is drawn.
pub struct Ends<'a> {
    /// The dq-model.
    pub base: (&'a Hypothesis, Option<&'a Hypothesis>),
    /// The set of effects without a map, as it was fitted to the recording.
    pub set: &'a Hypothesis,
    /// The model that is told, with a map where there is one.
    pub told: (&'a Hypothesis, Option<&'a Hypothesis>),
}

/// The budgets of all channels that the dq-model leaves mismatched: those of the recording, then those of the validation run.
///
/// # Errors
/// Those of the least-squares fits.
pub fn budgets(
    data: &Data,
    validation: Option<&Data>,
    ends: &Ends,
    monitor: &dyn Monitor,
) -> Result<Vec<Budget>> {
    let effects = ends.set.effects();
    let mapped = !ends.told.0.model.map_parameters().is_empty();
    if effects.is_empty() && !mapped {
        return Ok(Vec::new());
    }
    let rough = data.roughly();
    let on = |fitted: Hypothesis| -> Result<On> {
        let there = validation.map(|run| transfer(run, &fitted, monitor)).transpose()?;
        Ok((fitted, there))
    };
    let base = (ends.base.0.clone(), ends.base.1.cloned());
    // A map is none of the effects': with one in the model they are compared without it.
    let set = if mapped { on(ends.set.clone())? } else { (ends.told.0.clone(), ends.told.1.cloned()) };
    let without = |effect: &EffectId| -> Result<(On, On)> {
        let others = || {
            let (model, start) = reduced(&set.0, *effect);
            on(fitting::fit(&rough, &model, &start, false, monitor)?)
        };
        let alone = || {
            let rest = effects.iter().filter(|e| *e != effect);
            let only = rest.fold(set.0.clone(), |set, e| {
                let (model, start) = reduced(&set, *e);
                Hypothesis::unfitted(model, start)
            });
            on(fitting::fit(&rough, &only.model, only.own(), false, monitor)?)
        };
        match effects.len() {
            1 => Ok((base.clone(), set.clone())),
            _ => Ok((others()?, alone()?)),
        }
    };
    let each: Vec<(On, On)> = effects.par_iter().map(without).collect::<Result<_>>()?;
    let told = (ends.told.0.clone(), ends.told.1.cloned());
    let mut out = Vec::new();
    for (run, of) in [("recording", first as Side), ("validation", second as Side)] {
        let (Some(before), Some(named), Some(after)) = (of(&base), of(&set), of(&told)) else { continue };
        for channel in before.channels() {
            let excess = |h: Option<&Hypothesis>| h.map_or(0.0, |h| (square(h, channel) - 1.0).max(0.0));
            let whole = excess(Some(before));
            if whole <= data.options.mismatch {
                continue;
            }
            let share = |x: f64| x / whole;
            let (left, rest) = (share(excess(Some(named))), share(excess(Some(after))));
            let mut parts: Vec<Part> = effects
                .iter()
                .zip(&each)
                .map(|(effect, (others, alone))| Part {
                    effect: effect.id().into(),
                    alone: 1.0 - share(excess(of(alone))),
                    beside: (share(excess(of(others))) - left).max(0.0),
                })
                .collect();
            // A part that one effect explains and another absorbs counts once.
            let (explained, sum) = ((1.0 - left).max(0.0), parts.iter().map(|p| p.beside).sum::<f64>());
            if sum > explained {
                parts.iter_mut().for_each(|part| part.beside *= explained / sum);
            }
            parts.sort_by(|a, b| b.beside.total_cmp(&a.beside));
            out.push(Budget {
                run,
                channel: channel.name(),
                equation: locate::equation_of(channel),
                before: square(before, channel).sqrt(),
                after: square(after, channel).sqrt(),
                parts,
                shared: (explained - sum).max(0.0),
                unmodelled: (left - rest).max(0.0),
                rest,
            });
        }
    }
    Ok(out)
}

/// One of the two runs.
type Side = fn(&On) -> Option<&Hypothesis>;

fn first(on: &On) -> Option<&Hypothesis> {
    Some(&on.0)
}

fn second(on: &On) -> Option<&Hypothesis> {
    on.1.as_ref()
}

/// Mean square of a channel over the floor's, over all recordings that hold it.
fn square(hypothesis: &Hypothesis, channel: Channel) -> f64 {
    let own: Vec<f64> =
        hypothesis.squares.iter().filter(|(c, _)| *c == channel).map(|(_, square)| *square).collect();
    own.iter().sum::<f64>() / own.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, setup, speeds};
    use crate::model::Model;
    use crate::monitor::Silent;

    fn reversals() -> crate::drive::Manoeuvre {
        speeds(2.0, &[(0.2, 60.0), (0.6, 100.0), (1.0, -40.0), (1.4, -90.0), (1.8, 70.0)])
    }

    #[test]
    fn shares_add_up_and_each_effect_has_what_it_takes_away() {
        let present = vec![choice("coulomb_friction", "tau_c", 0.3), choice("quadratic_drag", "k", 2e-5)];
        let (data, base) = data(&setup(reversals(), present));
        let effects = [EffectId::CoulombFriction, EffectId::QuadraticDrag];
        let typical = effects.iter().flat_map(|e| e.info().parameters);
        let start: Vec<f64> =
            base.own().iter().copied().chain(typical.map(|p| (p.typical)(&data.signals.context))).collect();
        let model = Model::new(data.signals.context, &effects);
        let set = fitting::fit(&data, &model, &start, false, &Silent).unwrap();
        let ends = Ends { base: (&base, None), set: &set, told: (&set, None) };
        let budgets = budgets(&data, None, &ends, &Silent).unwrap();
        let motion = budgets.iter().find(|b| b.equation == "mechanical").unwrap();
        assert!(motion.before > 3.0 && motion.after < 1.2 && motion.run == "recording", "{motion:?}");
        let sum = motion.parts.iter().map(|p| p.beside).sum::<f64>();
        assert!((sum + motion.shared + motion.unmodelled + motion.rest - 1.0).abs() < 1e-9, "{motion:?}");
        assert_eq!(motion.parts[0].effect, "coulomb_friction");
        assert!(motion.parts[0].beside > 0.3 && motion.parts.iter().all(|p| p.alone <= 1.0), "{motion:?}");
    }

    #[test]
    fn one_effect_has_all_that_is_explained_and_a_machine_at_the_noise_has_no_budget() {
        let (data, base) = data(&setup(reversals(), vec![choice("coulomb_friction", "tau_c", 0.3)]));
        let set = crate::diagnose::testing::fitted(&data, &base, EffectId::CoulombFriction);
        let drawn = |base: &Hypothesis| {
            budgets(&data, None, &Ends { base: (base, None), set: &set, told: (&set, None) }, &Silent)
                .unwrap()
        };
        let [motion] = &drawn(&base)[..] else { panic!("{:?}", base.squares) };
        assert!((motion.parts[0].beside + motion.rest - 1.0).abs() < 1e-9 && motion.shared == 0.0);
        assert_eq!(motion.parts[0].alone, motion.parts[0].beside);
        assert_eq!(drawn(&set), []);
    }
}
