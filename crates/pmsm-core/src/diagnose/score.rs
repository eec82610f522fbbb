//! Score test: how much of what a fitted model leaves could each effect explain, to first order?
//!
//! The derivatives of the exact simulation with respect to an effect's amplitudes, at zero amplitude and for every shape
//! on its grid, are freed of what the already fitted parameters can do; what they then explain of the residual is the score.
//! Channels are weighed by what is left in them, so that a large misfit in one does not hide a small one in another.

mod aggregation;
mod projector;
mod swarm;
mod trials;

use super::data::Data;
use super::fitting;
use super::hypothesis::Hypothesis;
use crate::effect::{Context, Parameter, Role, Site};
use crate::effects::EffectId;
use crate::error::Result;
use crate::experiment::{Block, Channel, Joint, split};
use crate::model::Model;
use crate::monitor::Monitor;
use crate::numerics::basis::{DEPENDENT, orthonormal_beside};
use crate::numerics::tall;
use crate::simulate::mechanical::Nuisance;
use nalgebra::{DMatrix, DVector};
use projector::Projector;
use rayon::prelude::*;
pub use swarm::Ranging;

/// Most shapes whose columns are computed together.
const SHAPES: usize = 8;
/// Most columns that are computed together.
const COLUMNS: usize = 12;

/// The most promising start for fitting one more effect.
#[derive(Debug, Clone)]
pub struct Prospect {
    /// The effect.
    pub effect: EffectId,
    /// Its parameters: best shape, first-order amplitudes within bounds.
    pub start: Vec<f64>,
    /// Mean square explained, in units of what is left in each channel, summed over the channels.
    pub score: f64,
}

impl Prospect {
    /// An effect that explains nothing, in the first of its shapes.
    pub fn nothing(effect: EffectId, context: &Context) -> Self {
        let start = effect.probes(context).into_iter().next().unwrap_or_default();
        Self { effect, start, score: 0.0 }
    }
}

/// Scores effects on top of one fitted hypothesis.
pub struct Scorer<'a> {
    data: &'a Data,
    hypothesis: &'a Hypothesis,
    whole: Projector,
    rotor: Option<Projector>,
    /// Derivatives of the residual with respect to what was fitted.
    jacobian: DMatrix<f64>,
}

/// A basis of the columns of fitted parameters, the residual orthogonal to it, and the number of samples of each channel.
struct Against<'a> {
    basis: &'a DMatrix<f64>,
    residual: &'a DVector<f64>,
    samples: usize,
}

impl<'a> Scorer<'a> {
    /// Prepares the score test on `hypothesis`.
    pub fn new(data: &'a Data, hypothesis: &'a Hypothesis) -> Self {
        // Parameters fitted to both may be biased in both: a flux that absorbs friction shows in the currents.
        let rotor = data.floors.iter().any(|f| !f.channel.is_electrical())
            && !fitting::together(data, &hypothesis.model);
        let (whole, jacobian) = Projector::new(data, hypothesis);
        let rotor = rotor.then(|| whole.of_rotor(data, hypothesis, &jacobian)).flatten();
        Self { data, hypothesis, whole, rotor, jacobian }
    }

    /// Scores `effect` over its grid of shapes. Amplitudes found beyond their physical bounds count as far as the
    /// bounds allow.
    ///
    /// # Errors
    /// [`Error::Interrupted`](crate::error::Error::Interrupted).
    pub fn score(&self, effect: EffectId, monitor: &dyn Monitor) -> Result<Prospect> {
        if effect.is_multimodal() {
            return Ok(Prospect::nothing(effect, self.hypothesis.model.context()));
        }
        let by_trials =
            (!effect.is_first_order()).then(|| self.score_of_trials(effect, monitor)).transpose()?;
        let probes = effect.probes(self.hypothesis.model.context());
        let amplitudes = self.amplitudes(effect);
        let nothing = Prospect::nothing(effect, self.hypothesis.model.context());
        let together: Vec<&[Vec<f64>]> = batches(&probes, amplitudes.len()).collect();
        let best = |shapes: &[Vec<f64>]| self.best_of(&nothing, shapes, &amplitudes, monitor);
        let best: Vec<Prospect> = together.into_par_iter().map(best).collect::<Result<_>>()?;
        let all = best.into_iter().chain(by_trials);
        Ok(all.fold(nothing, |best, next| if next.score > best.score { next } else { best }))
    }

    /// The effect with each of its whole numbers, such as an order, that explains most: no more than `count`, the best first.
    ///
    /// # Errors
    /// [`Error::Interrupted`](crate::error::Error::Interrupted).
    pub fn leading(&self, effect: EffectId, count: usize, monitor: &dyn Monitor) -> Result<Vec<Prospect>> {
        let context = self.hypothesis.model.context();
        let (amplitudes, nothing) = (self.amplitudes(effect), Prospect::nothing(effect, context));
        let numbers = |shape: &[f64]| -> Vec<f64> {
            let each = effect.info().parameters.iter().zip(shape);
            each.filter(|(p, _)| p.role == Role::Fixed).map(|(_, x)| *x).collect()
        };
        let probes = effect.probes(context);
        let alike: Vec<&[Vec<f64>]> = probes.chunk_by(|a, b| numbers(a) == numbers(b)).collect();
        let best = |shapes: &[Vec<f64>]| self.best_of(&nothing, shapes, &amplitudes, monitor);
        let mut all: Vec<Prospect> = alike.into_par_iter().map(best).collect::<Result<_>>()?;
        all.sort_by(|a, b| b.score.total_cmp(&a.score));
        all.truncate(count);
        Ok(all)
    }

    /// The best of some `shapes`, or `nothing` where none explains anything.
    fn best_of(
        &self,
        nothing: &Prospect,
        shapes: &[Vec<f64>],
        amplitudes: &[usize],
        monitor: &dyn Monitor,
    ) -> Result<Prospect> {
        monitor.go_on()?;
        let projector = self.projector(nothing.effect);
        let columns = self.columns(nothing.effect, shapes, amplitudes, projector, true);
        let all =
            Against { basis: &projector.basis, residual: &projector.residual, samples: self.data.counted() };
        let best = self.best_against(nothing, shapes, amplitudes, &columns, all);
        let Some(aggregated) = &projector.aggregated else { return Ok(best) };
        let sums = aggregated.sums(&columns);
        let slow =
            Against { basis: &aggregated.basis, residual: &aggregated.residual, samples: aggregated.count };
        let slow = self.best_against(nothing, shapes, amplitudes, &sums, slow);
        Ok(if slow.score > best.score { slow } else { best })
    }

    /// The same by these `columns`, shape by shape.
    fn best_against(
        &self,
        nothing: &Prospect,
        shapes: &[Vec<f64>],
        amplitudes: &[usize],
        columns: &DMatrix<f64>,
        against: Against,
    ) -> Prospect {
        let (effect, mut best) = (nothing.effect, nothing.clone());
        let context = self.hypothesis.model.context();
        let parameters: Vec<&Parameter> = amplitudes.iter().map(|k| &effect.info().parameters[*k]).collect();
        let each = columns.ncols() / shapes.len();
        // Products of the columns freed of the basis, in which nothing of the residual lies.
        let along = tall::tr_mul(against.basis, columns);
        let whole = tall::gram(columns);
        let square = |k: usize| whole[(k, k)];
        let gram = &whole - along.tr_mul(&along);
        let right = tall::tr_mul_vector(columns, against.residual);
        for (at, shape) in shapes.iter().enumerate() {
            let own = at * each..(at + 1) * each;
            let length: Vec<f64> = own.clone().map(|k| square(k).sqrt()).collect();
            let gram = gram.view_range(own.clone(), own.clone()).into_owned();
            let right = right.rows_range(own).into_owned();
            let Some(step) = solve(&gram, &right, &length) else { continue };
            let mut bounded: DVector<f64> = -step;
            for (x, parameter) in bounded.iter_mut().zip(&parameters) {
                *x = x.clamp((parameter.low)(context), (parameter.high)(context));
            }
            let count = amplitudes.len();
            if bounded.rows(0, count).iter().all(|x| *x == 0.0) {
                continue;
            }
            if each > count {
                // The initial values follow the bounded strength.
                let begun = count..each;
                let left = right.rows_range(begun.clone())
                    + gram.view_range(begun.clone(), 0..count) * bounded.rows(0, count);
                let among = gram.view_range(begun.clone(), begun.clone()).into_owned();
                // States that do nothing at zero strength have columns of zeros: they begin at zero.
                if let Some(step) = solve(&among, &left, &length[begun.clone()]) {
                    bounded.rows_range_mut(begun).copy_from(&-step);
                }
            }
            // ‖r‖² − ‖r + F·b‖², with the free columns F and the bounded step b.
            let gain = -(bounded.dot(&right) * 2.0 + bounded.dot(&(&gram * &bounded)));
            let score = gain / against.samples as f64;
            if score > best.score {
                (best.score, best.start) = (score, shape.clone());
                for ((k, x), parameter) in amplitudes.iter().zip(bounded.iter()).zip(&parameters) {
                    let least = 0.02 * (parameter.typical)(context).abs();
                    best.start[*k] = if x.abs() < least { least.copysign(*x) } else { *x };
                }
            }
        }
        best
    }

    /// Share of what a prospect explains to first order that it still explains beside those `taken`. Nothing is known, and none is told, of
    /// two on the same side of which one has a trace that changes with its strength.
    pub fn share_beside(&self, taken: &[Prospect], prospect: &Prospect) -> f64 {
        let side = |p: &Prospect| p.effect.info().site;
        let shared =
            |p: &&Prospect| side(p) == side(prospect) || [side(p), side(prospect)].contains(&Site::Sensor);
        let alike: Vec<&Prospect> = taken.iter().filter(shared).collect();
        if alike.is_empty() {
            return 1.0;
        }
        if !alike.iter().chain([&prospect]).all(|p| p.effect.is_first_order()) {
            return 0.0;
        }
        let columns = |p: &Prospect| {
            let shapes = std::slice::from_ref(&p.start);
            self.columns(p.effect, shapes, &self.amplitudes(p.effect), &self.whole, false)
        };
        let own = columns(prospect);
        let explained = |beside: &DMatrix<f64>| {
            let alone = orthonormal_beside(beside, &own);
            tall::tr_mul_vector(&alone, &self.whole.residual).norm_squared()
        };
        let mut beside = vec![self.whole.basis.clone()];
        for p in alike {
            let all = side_by_side(&beside);
            beside.push(orthonormal_beside(&all, &columns(p)));
        }
        explained(&side_by_side(&beside)) / explained(&self.whole.basis).max(f64::MIN_POSITIVE)
    }

    /// Parameters of an effect that carry its strength and are fitted on this recording.
    pub fn amplitudes(&self, effect: EffectId) -> Vec<usize> {
        let context = self.hypothesis.model.context();
        let parameters = effect.info().parameters;
        (0..parameters.len())
            .filter(|k| parameters[*k].role == Role::Amplitude && effect.fitted(context, *k))
            .collect()
    }

    /// Derivatives of the residual, in units of what is left in each channel, with respect to the amplitudes of an effect at zero
    /// strength: those of the first of these `shapes`, those of the second, …
    pub fn sensitivity(&self, effect: EffectId, shapes: &[Vec<f64>]) -> Sensitivity<'_> {
        let projector = self.projector(effect);
        let columns = self.columns(effect, shapes, &self.amplitudes(effect), projector, false);
        Sensitivity { columns, samples: self.data.signals.len(), order: &projector.order }
    }

    /// The recording as it is scored: all channels in units of what is left in them, initial speeds as estimated.
    pub fn experiment(&self) -> Joint<'_> {
        let Hypothesis { model, nuisances, .. } = self.hypothesis;
        let experiment = self.data.experiment(model, nuisances, self.whole.channels.clone());
        experiment.with_plain_speed().with_starts(self.whole.starts.as_deref())
    }

    /// Derivatives of the residual, in units of what is left in each channel, with respect to what was fitted, and an orthonormal basis of
    /// what they span.
    pub fn fitted(&self) -> (&DMatrix<f64>, &DMatrix<f64>) {
        (&self.jacobian, &self.whole.basis)
    }

    fn projector(&self, effect: EffectId) -> &Projector {
        // A purely mechanical effect leaves the voltage equations as they are, and what was fitted to them alone.
        match (&self.rotor, effect.info().site) {
            (Some(rotor), Site::Mechanical) => rotor,
            _ => &self.whole,
        }
    }

    /// Derivatives of the residual with respect to the effect's amplitudes at zero strength, shape by shape; each time followed by those
    /// with respect to what its states have where each recording begins, if that is `begun`.
    fn columns(
        &self,
        effect: EffectId,
        shapes: &[Vec<f64>],
        amplitudes: &[usize],
        projector: &Projector,
        begun: bool,
    ) -> DMatrix<f64> {
        let hypothesis = self.hypothesis;
        let mut effects = hypothesis.effects();
        effects.push(effect);
        let model = Model::new(*hypothesis.model.context(), &effects);
        let own = hypothesis.own();
        let count = model.parameter_count();
        let mut free: Vec<usize> = amplitudes.iter().map(|k| own.len() + k).collect();
        let weak = |(k, x): (usize, &f64)| if amplitudes.contains(&k) { 0.0 } else { *x };
        let mut nuisances = Vec::with_capacity(hypothesis.nuisances.len());
        let mut open = Vec::new();
        for (nuisance, left_open) in split(&hypothesis.nuisances, &hypothesis.parameters[own.len()..]) {
            // A recording that does not show the motion leaves none of it open.
            let run = &self.data.runs()[nuisances.len()];
            let initial = if run.has_mechanical() { run.initial_states(&model) } else { 0 };
            open.extend(left_open);
            let new = if begun && nuisance.initial == 0 { model.mechanical_states().min(initial) } else { 0 };
            free.extend((0..new).map(|k| count + open.len() + k));
            open.extend(std::iter::repeat_n(0.0, initial - nuisance.initial));
            nuisances.push(Nuisance { initial, ..nuisance });
        }
        let form = |shape: &Vec<f64>| {
            let shape = shape.iter().enumerate().map(weak);
            own.iter().copied().chain(shape).chain(open.iter().copied()).collect()
        };
        let forms: Vec<Vec<f64>> = shapes.iter().map(form).collect();
        let experiment = self.data.experiment(&model, &nuisances, projector.channels.clone());
        experiment.with_plain_speed().linearise_forms(&forms, &free, &projector.courses)
    }
}

/// Matrices of as many rows beside one another.
fn side_by_side(parts: &[DMatrix<f64>]) -> DMatrix<f64> {
    let columns: Vec<_> = parts.iter().flat_map(|part| part.column_iter()).collect();
    DMatrix::from_columns(&columns)
}

/// What an effect does to the channels that it may reach.
pub struct Sensitivity<'a> {
    /// One column per amplitude and shape.
    pub columns: DMatrix<f64>,
    /// Samples of all recordings.
    pub samples: usize,
    /// Its channels in the order of the rows.
    pub order: &'a [Channel],
}

impl Sensitivity<'_> {
    /// The first of its rows that belong to `block`; `None` where the effect does not reach that channel.
    pub fn first_row(&self, block: &Block) -> Option<usize> {
        let place = self.order.iter().position(|c| *c == block.channel)?;
        Some(place * self.samples + block.rows.start % self.samples)
    }
}

/// Shapes of an effect, of so many amplitudes, that are looked at together.
pub fn batches(shapes: &[Vec<f64>], amplitudes: usize) -> impl Iterator<Item = &[Vec<f64>]> {
    let most = (COLUMNS / amplitudes.max(1)).clamp(1, SHAPES);
    let count = shapes.len().div_ceil(most).max(1);
    shapes.chunks(shapes.len().div_ceil(count).max(1))
}

/// Least-squares step; directions that the fitted parameters can make alone are left out.
pub fn solve(gram: &DMatrix<f64>, right: &DVector<f64>, length: &[f64]) -> Option<DVector<f64>> {
    let n = right.len();
    let scale: Vec<f64> = (0..n).map(|k| gram[(k, k)].sqrt()).collect();
    let alive = |k: usize| length[k] > 0.0 && scale[k] > DEPENDENT * length[k];
    if !(0..n).any(alive) {
        return None;
    }
    let unit = DMatrix::from_fn(n, n, |r, c| {
        if alive(r) && alive(c) { gram[(r, c)] / (scale[r] * scale[c]) } else { f64::from(u8::from(r == c)) }
    });
    let rhs = DVector::from_fn(n, |k, _| if alive(k) { right[k] / scale[k] } else { 0.0 });
    let solved = unit.pseudo_inverse(1e-8).ok()? * rhs;
    Some(DVector::from_fn(n, |k, _| if alive(k) { solved[k] / scale[k] } else { 0.0 }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, narrow, setup, speeds};
    use crate::diagnose::{baseline, join};
    use crate::drive::{Choice, simulate};
    use crate::monitor::Silent;
    use crate::recording::Recording;

    /// A run whose voltages are not known exactly.
    fn noisy(turned: f64, effects: Vec<Choice>) -> Recording {
        let manoeuvre = speeds(0.6, &[(0.1, 90.0 * turned), (0.3, -80.0 * turned), (0.5, 60.0)]);
        let recording = simulate(&setup(manoeuvre, effects), &Silent).unwrap().recording;
        let names = ["t", "v_d", "v_q", "i_a", "i_b", "i_c", "theta_e", "omega_e"];
        let column = |name: &str| {
            let mut x = recording.column(name).unwrap().to_vec();
            if name.starts_with('v') {
                let mut state = if name == "v_d" { 0.17 } else { 0.71 };
                for x in &mut x {
                    state = 3.99 * state * (1.0 - state);
                    *x += 8.0 * (state - 0.5);
                }
            }
            (name.to_string(), x)
        };
        Recording::new(names.map(column).to_vec(), None).unwrap()
    }

    #[test]
    fn shapes_show_together_what_they_show_alone() {
        let machine = setup(speeds(0.1, &[(0.0, 1.0)]), Vec::new()).nameplate;
        let (first, second) = (noisy(1.0, Vec::new()), noisy(-1.0, Vec::new()));
        for recordings in [&[&first][..], &[&first, &second]] {
            let mut data = join::prepare(recordings, &machine, &Default::default()).unwrap();
            let base = baseline::fit(&mut data, &Silent).unwrap();
            assert!(data.runs().iter().all(|run| run.whitening.is_some()));
            let scorer = Scorer::new(&data, &base);
            // One changes the inductances that the whitening follows; each has states or an angle of its own, or neither.
            for effect in [
                EffectId::SaturationD,
                EffectId::InterTurnShort,
                EffectId::DeadTime,
                EffectId::TwoMassShaft,
                EffectId::TimeVaryingLoad,
            ] {
                let probes: Vec<Vec<f64>> = effect.probes(base.model.context()).into_iter().take(3).collect();
                assert!(probes.len() > 1);
                let count = scorer.amplitudes(effect).len();
                let together = scorer.sensitivity(effect, &probes).columns;
                for (at, shape) in probes.into_iter().enumerate() {
                    let alone = scorer.sensitivity(effect, &[shape]).columns;
                    let off = (together.columns(at * count, count) - &alone).norm();
                    assert!(alone.norm() > 0.0 && off <= 1e-9 * alone.norm(), "{effect:?} {at}: {off}");
                }
            }
        }
    }

    #[test]
    fn a_voltage_that_lasts_stands_out_of_the_noise_of_the_others() {
        let machine = setup(speeds(0.1, &[(0.0, 1.0)]), Vec::new()).nameplate;
        let recording = noisy(1.0, vec![choice("dead_time", "v_err", 8.0)]);
        let mut data = join::prepare(&[&recording], &machine, &Default::default()).unwrap();
        let base = baseline::fit(&mut data, &Silent).unwrap();
        let mut scorer = Scorer::new(&data, &base);
        let score = scorer.score(EffectId::DeadTime, &Silent).unwrap().score;
        // Of each sample it explains next to nothing.
        assert!(scorer.whole.aggregated.take().is_some());
        let by_samples = scorer.score(EffectId::DeadTime, &Silent).unwrap().score;
        assert!(score > 0.1 && by_samples < 0.3 * score, "{score} {by_samples}");
    }

    #[test]
    fn a_shaft_is_seen_by_the_ringing_with_which_a_recording_begins() {
        // A small mass that was struck before the recording begins and is hardly moved later.
        let mut shaft = choice("two_mass_shaft", "inertia_ratio", 0.04);
        shaft.parameters.extend([("f_antires".into(), 37.0), ("zeta".into(), 0.02)]);
        let mut manoeuvre = speeds(1.2, &[(0.0, 0.0), (0.02, 80.0), (0.6, 84.0), (1.0, 78.0)]);
        manoeuvre.settle = 0.0;
        let whole = simulate(&setup(manoeuvre, vec![shaft]), &Silent).unwrap();
        let nameplate = setup(narrow(), Vec::new()).nameplate;
        let cut: Vec<(String, Vec<f64>)> = ["t", "v_d", "v_q", "i_a", "i_b", "i_c", "theta_e", "omega_e"]
            .map(|name| (name.to_string(), whole.recording.column(name).unwrap()[150..].to_vec()))
            .to_vec();
        let mut data =
            join::prepare(&[&Recording::new(cut, None).unwrap()], &nameplate, &Default::default()).unwrap();
        let base = baseline::fit(&mut data, &Silent).unwrap();
        let prospect = Scorer::new(&data, &base).score(EffectId::TwoMassShaft, &Silent).unwrap();
        let off = (prospect.start[1] / 37.0).ln().abs();
        assert!(off < 0.1 && prospect.score > 0.2, "{prospect:?}");
    }
}
