//! T-optimality: what a rival leaves of a manoeuvre on which another hypothesis is true, however its parameters are adjusted.
//!
//! For a log y of the true hypothesis the criterion is min_θ |y − f_rival(θ)|² (Atkinson & Fedorov, Biometrika 62 (1975) 57 and
//! 289), in their sequential form: the recording that is already there holds the rival's parameters as far as it shows them,
//! by the quadratic term (θ − θ̂)ᵀ·I·(θ − θ̂) with its information I, freed of what that run left open.

use super::bench::level;
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::unmodelled::MOST_WORTH;
use crate::error::Result;
use crate::experiment::{Block, Channel, Channels, Joint};
use crate::monitor::Monitor;
use crate::optimise::least_squares::{self, Normal, Problem, Settings};
use crate::simulate::mechanical::Nuisance;
use nalgebra::{DMatrix, DVector};

/// Singular values of a run's own parameters below this share of the largest carry no information.
const SINGULAR: f64 = 1e-10;

/// Least weight of a channel, which keeps a hopeless misfit from dividing by zero.
const LEAST_WEIGHT: f64 = 1e-6;
/// Share of the cost below which a step of a rival ends its fit: manoeuvres are ranked, and no parameter of it is told.
const ROUGH: f64 = 1e-4;

/// A hypothesis with what the recording says of its parameters.
pub struct Rival<'a> {
    /// Fitted on the recording.
    pub fitted: &'a Hypothesis,
    /// Its own fitted parameters.
    free: Vec<usize>,
    /// Their information, 1/unit².
    information: DMatrix<f64>,
    /// Weight of each channel: root of the share of its samples that are independent, over what is left in it.
    weights: Vec<(Channel, f64)>,
}

/// What a manoeuvre shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Separation {
    /// Evidence against the rival on the scale of the diagnosis, nats.
    pub nats: f64,
    /// Channel in which it fails most.
    pub channel: Channel,
    /// Root mean square of what is left there, noise included, in units of the noise.
    pub left: f64,
}

impl<'a> Rival<'a> {
    /// Takes the information from the recording and the nameplate.
    pub fn new(data: &Data, fitted: &'a Hypothesis) -> Self {
        let blocks = data.whole(fitted).blocks();
        let weigh = |((block, (channel, square)), samples): ((&Block, &(Channel, f64)), &f64)| {
            let share = (samples / block.rows.len() as f64).min(1.0);
            (*channel, (share / square.max(1.0)).sqrt())
        };
        let all: Vec<(Channel, f64)> =
            blocks.iter().zip(&fitted.squares).zip(&fitted.samples).map(weigh).collect();
        let mut channels = data.channels(true, true);
        for ((_, sigma), (_, weight)) in channels.iter_mut().flatten().zip(&all) {
            *sigma /= weight.max(LEAST_WEIGHT);
        }
        let experiment = data.experiment(&fitted.model, &fitted.nuisances, channels);
        // The manoeuvre is logged as the leading recording was.
        let leading = data.runs().iter().position(|run| std::ptr::eq(run, data.leading())).unwrap_or(0);
        let weights = blocks.iter().zip(&all).filter(|(b, _)| b.run == leading).map(|(_, w)| *w).collect();
        let own = fitted.model.parameter_count();
        let (free, run): (Vec<usize>, Vec<usize>) = fitted.free.iter().partition(|k| **k < own);
        let both = [free.clone(), run].concat();
        let j = experiment.linearise(&fitted.parameters, &both).jacobian;
        let gram = j.tr_mul(&j);
        let (a, b) = (free.len(), both.len() - free.len());
        let mut information = gram.view((0, 0), (a, a)).into_owned();
        if b > 0 {
            let cross = gram.view((0, a), (a, b)).into_owned();
            let inner = gram.view((a, a), (b, b)).into_owned();
            let tolerance = SINGULAR * inner.amax();
            // A run without information on its own parameters takes none away either.
            let finite = inner.iter().all(|x| x.is_finite());
            if let Some(inverse) =
                Some(inner).filter(|_| finite).and_then(|m| m.pseudo_inverse(tolerance).ok())
            {
                information -= &cross * inverse * cross.transpose();
            }
        }
        for prior in &data.prior {
            if let Some(k) = free.iter().position(|f| *f == prior.index) {
                information[(k, k)] += prior.off(fitted.parameters[prior.index]).1.powi(2);
            }
        }
        Self { fitted, free, information, weights }
    }

    /// What this rival leaves of a trial on which `truth` is true.
    ///
    /// # Errors
    /// Those of [`least_squares::minimise`]; [`Error::Interrupted`](crate::error::Error::Interrupted).
    pub fn separation(
        &self,
        trial: &Data,
        truth: &Hypothesis,
        iterations: usize,
        monitor: &dyn Monitor,
    ) -> Result<Separation> {
        monitor.go_on()?;
        let exact = {
            let (nuisance, start) = on_trial(trial, truth);
            let experiment = trial.experiment(&truth.model, &[nuisance], trial.channels(true, true));
            experiment.relative_rms(&experiment.residual(&start))
        };
        let (nuisance, start) = on_trial(trial, self.fitted);
        let own = self.fitted.model.parameter_count();
        let experiment = self.seen(trial, nuisance, true);
        let starts = experiment.estimated_starts(&start);
        let experiment = experiment.with_starts(starts.as_deref());
        let free: Vec<usize> = self.free.iter().copied().chain(own..start.len()).collect();
        let bounds: Vec<(f64, f64)> = free.iter().map(|k| experiment.bounds(*k)).collect();
        let at: Vec<f64> = free.iter().map(|k| start[*k]).collect();
        let problem = Together { experiment: &experiment, rival: self, start: &start, free: &free };
        let settings =
            Settings { max_iterations: iterations, cost_tolerance: ROUGH, ..crate::diagnose::data::SETTINGS };
        let fit = least_squares::minimise(&problem, &at, &bounds, &settings, monitor)?;
        monitor.go_on()?;
        let whole = problem.whole(&fit.parameters);
        let experiment = self.seen(trial, nuisance, false);
        let rms = experiment.relative_rms(&experiment.residual(&whole));
        let n = trial.signals.len() as f64;
        let mut out = Separation { nats: 0.0, channel: experiment.channels()[0], left: 1.0 };
        for ((channel, rival), exact) in experiment.channels().iter().zip(&rms).zip(&exact) {
            let square = (rival * rival - exact * exact).max(0.0);
            // What cannot be simulated cannot be compared.
            let square = if square.is_finite() { square } else { 0.0 };
            out.nats += 0.5 * MOST_WORTH.min(n) * square.ln_1p();
            let left = (1.0 + square).sqrt();
            if left > out.left {
                (out.channel, out.left) = (*channel, left);
            }
        }
        Ok(out)
    }

    /// The trial seen through this rival, channels with the weights of the recording or without.
    fn seen<'t>(&'t self, trial: &'t Data, nuisance: Nuisance, weighed: bool) -> Joint<'t> {
        let mut channels: Channels = trial.channels(true, true);
        for (channel, sigma) in channels.iter_mut().flatten().filter(|_| weighed) {
            if let Some((_, weight)) = self.weights.iter().find(|(c, _)| c == channel) {
                *sigma /= weight.max(LEAST_WEIGHT);
            }
        }
        trial.experiment(&self.fitted.model, &[nuisance], channels)
    }

    /// Relative standard errors of the parameters `indices` from the recording alone, and together with a trial.
    pub fn spreads(&self, trial: &Data, indices: &[usize]) -> Vec<(f64, f64)> {
        let (nuisance, start) = on_trial(trial, self.fitted);
        let own = self.fitted.model.parameter_count();
        let experiment = self.seen(trial, nuisance, true);
        let free: Vec<usize> = self.free.iter().copied().chain(own..start.len()).collect();
        let j = experiment.linearise(&start, &free).jacobian;
        let a = self.free.len();
        let mut together = j.tr_mul(&j);
        let upper = together.view((0, 0), (a, a)) + &self.information;
        together.view_mut((0, 0), (a, a)).copy_from(&upper);
        let before = least_squares::covariance(&self.information, None, &vec![true; a]);
        let after = least_squares::covariance(&together, None, &vec![true; free.len()]);
        let of = |covariance: &DMatrix<f64>, index: usize| {
            let at = self.free.iter().position(|f| *f == index);
            at.map_or(f64::NAN, |k| covariance[(k, k)].sqrt() / start[index].abs())
        };
        indices.iter().map(|index| (of(&before, *index), of(&after, *index))).collect()
    }
}

/// The parameters of a hypothesis on a trial, whose load is constant at most, and what that run leaves open.
fn on_trial(trial: &Data, hypothesis: &Hypothesis) -> (Nuisance, Vec<f64>) {
    let states = hypothesis.model.mechanical_states();
    let unknown = trial.signals.load == crate::recording::Load::UnknownConstant;
    let nuisance = if unknown { Nuisance::unknown(0, states) } else { Nuisance::known(states) };
    let mut parameters = hypothesis.own().to_vec();
    parameters.extend(unknown.then(|| level(hypothesis)));
    parameters.extend(std::iter::repeat_n(0.0, states));
    (nuisance, parameters)
}

/// A rival fitted to the trial and to what the recording says of it.
struct Together<'a> {
    experiment: &'a Joint<'a>,
    rival: &'a Rival<'a>,
    start: &'a [f64],
    free: &'a [usize],
}

impl Together<'_> {
    fn whole(&self, point: &[f64]) -> Vec<f64> {
        let mut p = self.start.to_vec();
        for (index, value) in self.free.iter().zip(point) {
            p[*index] = *value;
        }
        p
    }

    /// Distance from the recording's estimate, and its information times that.
    fn away(&self, point: &[f64]) -> (DVector<f64>, DVector<f64>) {
        let away = DVector::from_fn(self.rival.free.len(), |k, _| point[k] - self.start[self.rival.free[k]]);
        let pull = &self.rival.information * &away;
        (away, pull)
    }
}

impl Problem for Together<'_> {
    fn dim(&self) -> usize {
        self.free.len()
    }

    fn cost(&self, point: &[f64]) -> f64 {
        let (away, pull) = self.away(point);
        self.experiment.residual(&self.whole(point)).norm_squared() + away.dot(&pull)
    }

    fn normal(&self, point: &[f64]) -> Normal {
        let (away, pull) = self.away(point);
        let linear = self.experiment.linearise(&self.whole(point), self.free);
        let mut normal = Normal {
            cost: linear.residual.norm_squared() + away.dot(&pull),
            jtj: linear.jacobian.tr_mul(&linear.jacobian),
            jtr: linear.jacobian.tr_mul(&linear.residual),
        };
        let a = away.len();
        let upper = normal.jtj.view((0, 0), (a, a)) + &self.rival.information;
        normal.jtj.view_mut((0, 0), (a, a)).copy_from(&upper);
        for k in 0..a {
            normal.jtr[k] += pull[k];
        }
        normal
    }
}
