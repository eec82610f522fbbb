//! Scores of effects whose trace changes with their strength, such as a shaft that rings: by exact simulation over a grid of shapes and
//! strengths.

use super::{Prospect, Scorer};
use crate::effect::{Role, Site};
use crate::effects::EffectId;
use crate::error::Result;
use crate::experiment::split;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::numerics::tall;
use crate::simulate::mechanical::Nuisance;
use nalgebra::DVector;
use rayon::prelude::*;

/// Strengths, over the typical one, at which an effect is tried whose trace changes with it, and factors by which the best is refined.
const STRENGTHS: [f64; 2] = [0.3, 1.0];
const FINER: [f64; 6] = [1.25, 1.12, 1.06, 2.0, 1.1, 1.03];

/// Trials that run beside one another.
const TOGETHER: usize = 4;

/// Score below which the best is not refined.
const LEAST_TRIAL: f64 = 0.01;

impl Scorer<'_> {
    /// The score of an effect whose trace changes with its strength: of exact simulations over a grid of shapes and strengths, and of a
    /// finer one around the best.
    pub(super) fn score_of_trials(&self, effect: EffectId, monitor: &dyn Monitor) -> Result<Prospect> {
        let context = self.hypothesis.model.context();
        let parameters = effect.info().parameters;
        let nothing = Prospect::nothing(effect, context);
        let with = |shape: &Vec<f64>, share: f64| -> Vec<f64> {
            let scaled = shape.iter().zip(parameters).map(|(x, p)| match p.role {
                Role::Amplitude => ((p.typical)(context) * share).clamp((p.low)(context), (p.high)(context)),
                _ => x.clamp((p.low)(context), (p.high)(context)),
            });
            scaled.collect()
        };
        let best_of = |trials: Vec<Vec<f64>>, nothing: Prospect| -> Result<Prospect> {
            let scores = |some: &[Vec<f64>]| {
                monitor.go_on()?;
                Ok(self.trials(effect, some))
            };
            let scored: Vec<Vec<f64>> = trials.par_chunks(TOGETHER).map(scores).collect::<Result<_>>()?;
            let best = trials.into_iter().zip(scored.concat()).max_by(|a, b| a.1.total_cmp(&b.1));
            Ok(match best {
                Some((start, score)) if score > nothing.score => Prospect { effect, start, score },
                _ => nothing,
            })
        };
        let probes = effect.probes(context);
        let coarse = probes.iter().flat_map(|shape| STRENGTHS.map(|share| with(shape, share))).collect();
        let mut best = best_of(coarse, nothing)?;
        for step in FINER {
            if best.score < LEAST_TRIAL {
                break;
            }
            let around = |k: usize, times: f64| {
                let mut own = best.start.clone();
                own[k] = (own[k] * times).clamp((parameters[k].low)(context), (parameters[k].high)(context));
                own
            };
            let open = (0..parameters.len()).filter(|k| parameters[*k].role != Role::Fixed);
            let mut finer: Vec<Vec<f64>> =
                open.flat_map(|k| [around(k, step), around(k, 1.0 / step)]).collect();
            finer.dedup();
            best = best_of(finer, best)?;
        }
        Ok(best)
    }

    /// Mean square that an effect explains at each of these of its parameters, by exact simulation, whatever was fitted giving way to first
    /// order.
    pub(super) fn trials(&self, effect: EffectId, trials: &[Vec<f64>]) -> Vec<f64> {
        let hypothesis = self.hypothesis;
        let projector = self.projector(effect);
        // One that the set holds is tried with other parameters.
        let held = hypothesis.model.slots().iter().find(|slot| slot.effect == effect);
        let more = if held.is_some() { Vec::new() } else { vec![effect] };
        let model = Model::new(*hypothesis.model.context(), &[hypothesis.effects(), more].concat());
        let (mut behind, mut nuisances) = (Vec::new(), Vec::with_capacity(hypothesis.nuisances.len()));
        for (nuisance, left_open) in
            split(&hypothesis.nuisances, &hypothesis.parameters[hypothesis.own().len()..])
        {
            let run = &self.data.runs()[nuisances.len()];
            let initial = if run.has_mechanical() { run.initial_states(&model) } else { 0 };
            behind.extend(left_open);
            behind.extend(std::iter::repeat_n(0.0, initial - nuisance.initial));
            nuisances.push(Nuisance { initial, ..nuisance });
        }
        let whole = |own: &Vec<f64>| match held {
            None => [hypothesis.own(), own, &behind].concat(),
            Some(slot) => {
                let mut set = hypothesis.own().to_vec();
                set[slot.parameters.clone()].copy_from_slice(own);
                [&set[..], &behind].concat()
            }
        };
        let parameters: Vec<Vec<f64>> = trials.iter().map(whole).collect();
        let mut channels = projector.channels.clone();
        let moves = effect.info().site == Site::Mechanical;
        if moves {
            channels.iter_mut().for_each(|run| run.retain(|(c, _)| !c.is_electrical()));
        }
        let experiment = self.data.experiment(&model, &nuisances, channels).with_plain_speed();
        // The currents follow the measured speed: what moves the rotor otherwise leaves them as they are.
        let residuals = match moves {
            true => experiment.with_starts(projector.starts.as_deref()).motion_residuals(&parameters),
            false => parameters.iter().map(|p| experiment.residual(p)).collect(),
        };
        let gain = |seen: &DVector<f64>| {
            let mut residual = projector.left.clone();
            let first = residual.len() - seen.len();
            residual.rows_mut(first, seen.len()).copy_from(seen);
            let free = &residual - &projector.basis * tall::tr_mul_vector(&projector.basis, &residual);
            let gain = projector.residual.norm_squared() - free.norm_squared();
            if gain.is_finite() { gain / self.data.counted() as f64 } else { 0.0 }
        };
        residuals.iter().map(gain).collect()
    }
}
