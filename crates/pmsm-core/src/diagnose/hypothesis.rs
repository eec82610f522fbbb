//! A set of effects fitted to a recording by simulation: the electrical equations first, with the measured speed; then
//! the mechanical one, with the torque of the measured currents; where a sensor is suspected, both together.

use super::data::{Data, SETTINGS};
use super::motion;
use crate::effect::{Role, Site};
use crate::effects::EffectId;
use crate::error::Result;
use crate::experiment::{Channel, Channels, Joint};
use crate::machine::BaseParameter;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::noise::{self, Floor};
use crate::simulate::electrical::incremental_inductances;
use crate::simulate::mechanical::Nuisance;
use crate::whitening::Whitening;

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
        let (floors, input) = noise::floors(&experiment.runs()[0], &hypothesis.parameters);
        let sensor = |channel| floors.iter().find(|f| f.channel == channel).map(|f| f.sensor);
        self.whitening = match (sensor(Channel::ID), sensor(Channel::IQ)) {
            (Some(d), Some(q)) if !input.is_none() || self.signals.segments.len() > 1 => {
                let own = hypothesis.own();
                let l = incremental_inductances(&hypothesis.model, &self.signals, own);
                Some(Whitening::new(&self.signals, own[BaseParameter::RS.index()], l, [d, q], &input))
            }
            _ => None,
        };
        (self.floors, self.input) = (floors, input);
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
    /// What each recording left open.
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
    pub fn bare(model: Model, parameters: Vec<f64>) -> Self {
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

    /// Its effects.
    pub fn effects(&self) -> Vec<EffectId> {
        self.model.effects()
    }

    /// Model parameters without the run's nuisance.
    pub fn own(&self) -> &[f64] {
        &self.parameters[..self.model.parameter_count()]
    }

    /// Whether an effect of the set was left next to no strength: what is fitted then is not the effect, but the values in which its own
    /// states begin.
    pub fn vanishes(&self, effect: EffectId) -> bool {
        let context = self.model.context();
        let Some(slot) = self.model.slots().iter().find(|s| s.effect == effect) else { return false };
        let mut strengths = effect.info().parameters.iter().zip(&self.parameters[slot.parameters.clone()]);
        strengths.all(|(p, x)| p.role != Role::Amplitude || x.abs() <= VANISHING * (p.typical)(context).abs())
    }

    /// The mean square of one channel, over the floor's, in the recording where it is largest.
    pub fn square(&self, channel: Channel) -> f64 {
        let all = self.squares.iter().filter(|(c, _)| *c == channel).map(|(_, s)| *s);
        all.reduce(f64::max).unwrap_or(f64::NAN)
    }

    /// Number of recordings that it was fitted to.
    pub fn runs(&self) -> usize {
        self.nuisances.len().max(1)
    }
}

/// Channels with their noise times `factors`, one per channel of each recording in turn.
pub fn rescaled(channels: Channels, factors: impl IntoIterator<Item = f64>) -> Channels {
    let mut factors = factors.into_iter();
    let mut own = |(c, s): (Channel, f64)| (c, s * factors.next().unwrap_or(1.0));
    channels.into_iter().map(|run| run.into_iter().map(&mut own).collect()).collect()
}

/// Fits the effects of `model` to `data`, starting from the model parameters `start`. `electrical_done` says that the
/// electrical parameters of `start` are already the fitted ones.
///
/// # Errors
/// Those of the least-squares fit.
pub fn fit(
    data: &Data,
    model: &Model,
    start: &[f64],
    electrical_done: bool,
    monitor: &dyn Monitor,
) -> Result<Hypothesis> {
    let (electrical, rotor, sensors) = free_parameters(data, model);
    let mut parameters = start.to_vec();
    let mut nuisances = vec![Nuisance::known(0); data.runs().len()];
    let mut free = Vec::new();
    if data.has(true) {
        let mut wanted = electrical.clone();
        wanted.extend(&sensors);
        if !electrical_done {
            let experiment = data.experiment(model, &nuisances, data.channels(true, false));
            parameters = experiment.fit(&parameters, &wanted, &SETTINGS, monitor)?.parameters;
        }
        free = wanted;
    }
    if data.has(false) {
        let fitted = motion::fit(data, model, &parameters, &rotor, monitor)?;
        (parameters, nuisances) = (fitted.parameters, fitted.nuisances);
        free.extend(fitted.free);
        if together(data, model) {
            let channels = data.channels(true, true);
            let experiment = data.experiment(model, &nuisances, channels.clone());
            let rms = experiment.relative_rms(&experiment.residual(&parameters));
            // A channel that does not fit for other reasons must not bend the sensor's parameters.
            let channels = rescaled(channels, rms.into_iter().map(|r| r.max(1.0)));
            let experiment = data.experiment(model, &nuisances, channels);
            parameters = experiment.fit(&parameters, &free, &SETTINGS, monitor)?.parameters;
        }
    }
    Ok(finish(data, model.clone(), parameters, free, nuisances))
}

/// Whether the electrical parameters are fitted to the motion, too: a sensor shows in both; and where the voltage is noisy, the torque
/// tells more of the flux than the currents do.
pub fn together(data: &Data, model: &Model) -> bool {
    data.has(true) && data.has(false) && (model.has_sensor() || data.input.voltage > 0.0)
}

/// The final estimate: the mechanical parameters fitted once more with whitened residuals where the speed's residual is
/// coloured. Hypotheses are compared before that, on the residuals as they are.
///
/// # Errors
/// Those of the least-squares fit.
pub fn efficient(data: &Data, hypothesis: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let model = &hypothesis.model;
    if !data.has(false) || (model.has_sensor() && data.has(true)) {
        return Ok(hypothesis.clone());
    }
    let (_, rotor, _) = free_parameters(data, model);
    let nuisances = &hypothesis.nuisances;
    let fitted = motion::whitened(data, model, &hypothesis.parameters, nuisances, &rotor, monitor)?;
    Ok(match fitted {
        Some(parameters) => {
            finish(data, model.clone(), parameters, hypothesis.free.clone(), nuisances.clone())
        }
        None => hypothesis.clone(),
    })
}

/// Estimates on another recording only what a run leaves open: the unknown load, initial values, and the electrical turn in
/// which the run begins.
///
/// # Errors
/// Those of the least-squares fit.
pub fn transfer(data: &Data, hypothesis: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let model = &hypothesis.model;
    let on_run = |own: &[f64]| -> Result<Hypothesis> {
        let mut parameters = own.to_vec();
        let mut nuisances = vec![Nuisance::known(0); data.runs().len()];
        if data.has(false) {
            let fitted = motion::fit(data, model, &parameters, &[], monitor)?;
            (parameters, nuisances) = (fitted.parameters, fitted.nuisances);
        }
        Ok(finish(data, model.clone(), parameters, Vec::new(), nuisances))
    };
    let mut best = on_run(hypothesis.own())?;
    // Without a logged mechanical angle the run may begin in any electrical turn of the revolution.
    for turn in 1..data.signals.n_p as usize {
        let shift = std::f64::consts::TAU * turn as f64 / data.signals.n_p;
        let Some(turned) = model.turned(hypothesis.own(), shift) else { break };
        if data.signals.turn_known {
            break;
        }
        let tried = on_run(&turned)?;
        let total = |h: &Hypothesis| h.squares.iter().map(|(_, s)| s.max(0.9).ln()).sum::<f64>();
        if total(&tried) < total(&best) {
            best = tried;
        }
    }
    Ok(best)
}

/// The fitted `bare` machine under the load that another hypothesis finds on the same recordings, without the steps that only it
/// needs; its rotor is fitted anew if `anew`.
///
/// # Errors
/// Those of the least-squares fit.
pub fn under_load_of(
    other: &Hypothesis,
    data: &Data,
    bare: &Hypothesis,
    anew: bool,
    monitor: &dyn Monitor,
) -> Result<Hypothesis> {
    let rotor = if anew { free_parameters(data, &bare.model).1 } else { Vec::new() };
    let load = (&other.nuisances[..], &other.parameters[other.model.parameter_count()..]);
    let fitted = motion::fit_under(data, &bare.model, &bare.parameters, &rotor, load, monitor)?;
    let mut free = Vec::new();
    if anew {
        let rigid = |k: &&usize| **k < bare.model.parameter_count() && !rotor.contains(k);
        free = bare.free.iter().filter(rigid).copied().collect();
        free.extend(fitted.free);
    }
    Ok(finish(data, bare.model.clone(), fitted.parameters, free, fitted.nuisances))
}

fn finish(
    data: &Data,
    model: Model,
    parameters: Vec<f64>,
    free: Vec<usize>,
    nuisances: Vec<Nuisance>,
) -> Hypothesis {
    let mut out = Hypothesis { free, nuisances, ..Hypothesis::bare(model, parameters) };
    let experiment = data.whole(&out);
    let residual = experiment.residual(&out.parameters);
    let judged = experiment.mean_squares(&residual, energy_samples);
    let channels = experiment.blocks().into_iter().map(|block| block.channel);
    let squares = channels.zip(&judged).map(|(c, (square, _))| (c, *square)).collect();
    let samples = judged.iter().map(|(_, samples)| *samples).collect();
    (out.squares, out.samples) = (squares, samples);
    out.chance = data.runs().iter().flat_map(|run| run.floors.iter().map(Floor::chance)).collect();
    out
}

/// Blocks over which the energy of a residual is compared.
const BLOCKS: usize = 24;

/// Independent samples behind a mean square, from how much it varies from block to block: for n normal samples the mean
/// square has the variance 2σ⁴/n. Held-out samples, which are exactly zero, do not count.
fn energy_samples(residual: &[f64]) -> f64 {
    let kept: Vec<f64> = residual.iter().filter(|r| **r != 0.0).map(|r| r * r).collect();
    let size = (kept.len() / BLOCKS).max(1);
    let means: Vec<f64> = kept.chunks_exact(size).map(|b| b.iter().sum::<f64>() / size as f64).collect();
    let count = means.len() as f64;
    let mean = means.iter().sum::<f64>() / count;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    if variance > 0.0 { 2.0 * mean * mean * count / variance } else { kept.len() as f64 }
}

/// Free model parameters: electrical, mechanical, and those of sensors.
pub fn free_parameters(data: &Data, model: &Model) -> (Vec<usize>, Vec<usize>, Vec<usize>) {
    let wanted = |p: &BaseParameter| data.needs(*p);
    let mut electrical: Vec<usize> =
        BaseParameter::ELECTRICAL.iter().filter(|p| wanted(p)).map(|p| p.index()).collect();
    if !data.has(true) {
        electrical.clear();
    }
    let mut rotor: Vec<usize> = BaseParameter::MECHANICAL.iter().map(|p| p.index()).collect();
    let mut sensors = Vec::new();
    for slot in model.slots() {
        let fitted = slot
            .parameters
            .clone()
            .enumerate()
            .filter(|(k, _)| slot.effect.fitted(model.context(), *k))
            .map(|(_, index)| index);
        match slot.effect.info().site {
            Site::Electrical => electrical.extend(fitted),
            Site::Mechanical => rotor.extend(fitted),
            Site::Sensor => sensors.extend(fitted),
        }
    }
    if let Some(map) = model.map() {
        let start = model.map_parameters().start;
        for (part, place) in map.places() {
            let side = if part.is_electrical() { &mut electrical } else { &mut rotor };
            side.extend(place.map(|k| start + k));
        }
    }
    (electrical, rotor, sensors)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::BASE;
    use crate::effects::testing::CX;

    #[test]
    fn a_shaft_without_a_load_on_it_is_no_shaft() {
        let with = |effects: &[EffectId], own: &[f64]| {
            Hypothesis::bare(Model::new(CX, effects), [&[1.0; BASE], own].concat())
        };
        let shaft = |share: f64| {
            with(&[EffectId::TwoMassShaft], &[share, 3.0, 0.01]).vanishes(EffectId::TwoMassShaft)
        };
        assert!(shaft(0.0) && shaft(1e-6) && !shaft(0.05));
        // One strength of several is enough, and what is not in the set is not asked for.
        let load = with(&[EffectId::TimeVaryingLoad], &[0.0, 0.1, 0.0, 2.0]);
        assert!(!load.vanishes(EffectId::TimeVaryingLoad) && !load.vanishes(EffectId::TwoMassShaft));
    }
}
