//! A set of effects with the parameters that were fitted to a recording, and what it leaves there.

use super::data::Data;
use crate::effect::Role;
use crate::effects::EffectId;
use crate::experiment::floor::{self, Floor};
use crate::experiment::{Channel, Joint};
use crate::machine::BaseParameter;
use crate::model::Model;
use crate::noise::colour::effective_samples;
use crate::noise::whitening::{Bench, Whitening};
use crate::simulate::inductances::incremental_inductances;
use crate::simulate::mechanical::Nuisance;

/// Share of its typical strength below which an effect counts as absent.
const VANISHING: f64 = 2e-3;

impl Data {
    /// Measures the floors and the voltages' noise with the help of a fitted hypothesis.
    pub fn settle_floors(&mut self, hypothesis: &Hypothesis) {
        if !self.parts.is_empty() {
            return self.settle_each(hypothesis);
        }
        let channels = vec![self.floors.iter().map(|f| (f.channel, f.sensor)).collect()];
        let experiment = self.experiment(&hypothesis.model, &hypothesis.nuisances, channels);
        let (floors, input) = floor::floors(&experiment.runs()[0], &hypothesis.parameters);
        let sensor = |channel| floors.iter().find(|f| f.channel == channel).map(|f| f.sensor);
        self.whitening = match (sensor(Channel::ID), sensor(Channel::IQ)) {
            (Some(d), Some(q)) if !input.is_none() || self.signals.segments.len() > 1 => {
                let own = hypothesis.own();
                let l = incremental_inductances(&hypothesis.model, &self.signals, own);
                let [r_s, psi_m] = [BaseParameter::RS, BaseParameter::PsiM].map(|x| own[x.index()]);
                let speed = sensor(Channel::OmegaE).filter(|_| self.signals.speed_known).unwrap_or(0.0);
                let bench = Bench { r_s, psi_m, sensor: [d, q], speed, input: input.clone() };
                Some(Whitening::new(&self.signals, l, bench))
            }
            _ => None,
        };
        (self.floors, self.input) = (floors, input);
        if self.whitening.is_some() {
            // What the driven noise does to the currents is taken out there.
            self.floors.iter_mut().filter(|f| f.channel.is_electrical()).for_each(|f| f.swing = 0.0);
        }
    }

    /// How far (ln) the inductances of a fitted hypothesis are at most from those that the noise of the voltages was estimated with.
    pub fn away(&self, hypothesis: &Hypothesis) -> f64 {
        let away = |run: &Data| {
            let l = incremental_inductances(&hypothesis.model, &run.signals, hypothesis.own());
            run.whitening
                .as_ref()
                .map_or(0.0, |w| w.away(l).into_iter().fold(0.0, |m: f64, x| m.max(x.abs())))
        };
        self.runs().iter().map(away).fold(0.0, f64::max)
    }

    /// All channels with the floors as weights, seen through a hypothesis.
    pub fn whole<'a>(&'a self, hypothesis: &'a Hypothesis) -> Joint<'a> {
        self.experiment(&hypothesis.model, &hypothesis.nuisances, self.channels(true, true))
    }
}

/// A fitted set of effects.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    /// The model.
    pub model: Model,
    /// Model parameters followed by those of each recording's nuisance.
    pub parameters: Vec<f64>,
    /// Parameters that were fitted.
    pub free: Vec<usize>,
    /// The parameters of each recording: its unknown load and initial values.
    pub nuisances: Vec<Nuisance>,
    /// Mean square of the residual over the floor's, per channel of each recording in turn.
    pub squares: Vec<(Channel, f64)>,
    /// Independent samples that each channel's mean square rests on.
    pub samples: Vec<f64>,
    /// How far each channel's mean square may lie above one by chance. Noise on the inputs of a simulation comes out integrated:
    /// most of its energy is in a few slow swings, so that in one run it is off by about its mean.
    pub chance: Vec<f64>,
}

impl Hypothesis {
    /// A model at given parameters, before anything was fitted.
    pub fn unfitted(model: Model, parameters: Vec<f64>) -> Self {
        Self {
            model,
            parameters,
            free: Vec::new(),
            nuisances: Vec::new(),
            squares: Vec::new(),
            samples: Vec::new(),
            chance: Vec::new(),
        }
    }

    /// A model as it was fitted to `data`, with what it leaves there.
    pub fn on(
        data: &Data,
        model: Model,
        parameters: Vec<f64>,
        free: Vec<usize>,
        nuisances: Vec<Nuisance>,
    ) -> Self {
        let mut out = Self { free, nuisances, ..Self::unfitted(model, parameters) };
        let experiment = data.whole(&out);
        let residual = experiment.residual(&out.parameters);
        let seen = experiment.mean_squares(&residual, independent_samples);
        let channels = experiment.blocks().into_iter().map(|block| block.channel);
        let squares = channels.zip(&seen).map(|(c, (square, _))| (c, *square)).collect();
        let samples = seen.iter().map(|(_, samples)| *samples).collect();
        (out.squares, out.samples) = (squares, samples);
        out.chance = data.runs().iter().flat_map(|run| run.floors.iter().map(Floor::chance)).collect();
        out
    }

    /// A model whose electrical parameters were fitted to `data`, with what it leaves of the voltage equations there; the motion, of which
    /// nothing is known, stands at its floor.
    pub fn of_currents(data: &Data, model: &Model, parameters: &[f64], free: &[usize]) -> Self {
        let own = parameters[..model.parameter_count()].to_vec();
        let nuisances = vec![Nuisance::known(0); data.runs().len()];
        let experiment = data.experiment(model, &nuisances, data.channels(true, false));
        let mut electrical =
            experiment.mean_squares(&experiment.residual(&own), independent_samples).into_iter();
        let floors = || data.runs().iter().flat_map(|run| &run.floors);
        let seen = |floor: &Floor| if floor.channel.is_electrical() { electrical.next() } else { None };
        let seen: Vec<(f64, f64)> = floors().map(seen).map(|found| found.unwrap_or((1.0, 1.0))).collect();
        Self {
            free: free.to_vec(),
            nuisances,
            squares: floors().map(|floor| floor.channel).zip(seen.iter().map(|s| s.0)).collect(),
            samples: seen.iter().map(|s| s.1).collect(),
            chance: floors().map(Floor::chance).collect(),
            ..Self::unfitted(model.clone(), own)
        }
    }

    /// The same under floors that were settled anew.
    pub fn seen_again(self, data: &Data) -> Self {
        Self::on(data, self.model, self.parameters, self.free, self.nuisances)
    }

    /// Its effects.
    pub fn effects(&self) -> Vec<EffectId> {
        self.model.effects()
    }

    /// Model parameters without the run's nuisance.
    pub fn own(&self) -> &[f64] {
        &self.parameters[..self.model.parameter_count()]
    }

    /// Whether an effect of the set has next to no strength, or does not do what its name says. Of an effect with states only their initial
    /// values would then be fitted.
    pub fn vanishes(&self, effect: EffectId) -> bool {
        let context = self.model.context();
        let Some(slot) = self.model.slots().iter().find(|s| s.effect == effect) else { return false };
        let own = &self.parameters[slot.parameters.clone()];
        let mut strengths = effect.info().parameters.iter().zip(own);
        strengths.all(|(p, x)| p.role != Role::Amplitude || x.abs() <= VANISHING * (p.typical)(context).abs())
            || effect.idles(own, context)
    }

    /// The channels that it was compared on, each once.
    pub fn channels(&self) -> Vec<Channel> {
        let mut channels: Vec<Channel> = self.squares.iter().map(|(channel, _)| *channel).collect();
        channels.sort_unstable();
        channels.dedup();
        channels
    }

    /// The mean square of one channel, over the floor's, in the recording where it is largest.
    pub fn square(&self, channel: Channel) -> f64 {
        let all = self.squares.iter().filter(|(c, _)| *c == channel).map(|(_, s)| *s);
        all.reduce(f64::max).unwrap_or(f64::NAN)
    }
}

/// Blocks over which the energy of a residual is compared.
const BLOCKS: usize = 24;

/// Independent samples of a residual: the smaller of the estimates by its correlation and by the variance of its energy.
pub fn independent_samples(residual: &[f64]) -> f64 {
    energy_samples(residual).min(effective_samples(residual))
}

/// Independent samples behind a mean square, from how much it varies from block to block: for n normal samples the mean
/// square has the variance 2σ⁴/n. Held-out samples, which are exactly zero, do not count.
pub fn energy_samples(residual: &[f64]) -> f64 {
    let kept: Vec<f64> = residual.iter().filter(|r| **r != 0.0).map(|r| r * r).collect();
    let size = (kept.len() / BLOCKS).max(1);
    let means: Vec<f64> = kept.chunks_exact(size).map(|b| b.iter().sum::<f64>() / size as f64).collect();
    let count = means.len() as f64;
    let mean = means.iter().sum::<f64>() / count;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    if variance > 0.0 { 2.0 * mean * mean * count / variance } else { kept.len() as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::BASE;
    use crate::effects::testing::CX;

    #[test]
    fn a_shaft_without_a_load_on_it_is_no_shaft() {
        let with = |effects: &[EffectId], own: &[f64]| {
            Hypothesis::unfitted(Model::new(CX, effects), [&[1.0; BASE], own].concat())
        };
        let shaft = |share: f64| {
            with(&[EffectId::TwoMassShaft], &[share, 3.0, 0.01]).vanishes(EffectId::TwoMassShaft)
        };
        assert!(shaft(0.0) && shaft(1e-6) && !shaft(0.05));
        // One strength of several is enough, and what is not in the set is not asked for.
        let load = with(&[EffectId::TimeVaryingLoad], &[0.0, 0.1, 0.0, 2.0]);
        assert!(!load.vanishes(EffectId::TimeVaryingLoad) && !load.vanishes(EffectId::TwoMassShaft));
        // One that is the same all along does nothing in time.
        let still = [0.368, 0.554, 1.903 / CX.duration, 0.8 / CX.duration];
        assert!(with(&[EffectId::TimeVaryingLoad], &still).vanishes(EffectId::TimeVaryingLoad));
    }
}
