//! The search for the parameters of any residuals: swarm, least squares, or both.

use crate::error::{Error, Result};
use crate::experiment::Linearisation;
use crate::identify::Method;
use crate::monitor::Monitor;
use crate::optimise::least_squares::{self, Normal, Problem, Settings, Status};
use crate::optimise::swarm::{self, Swarm, SwarmSettings};
use crate::optimise::uncertainty::{self, Estimate, Judge, NotShown};
use crate::pairs;
use serde::Serialize;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// When least squares has converged: a thousandth of a standard error or better.
const SETTINGS: Settings = Settings {
    max_iterations: 100,
    cost_tolerance: 1e-12,
    step_tolerance: 1e-9,
    initial_damping: 1e-3,
    leaves_rest: false,
    stall_tolerance: 0.0,
};
/// Share of its value, or of its range where that is larger, by which a parameter must change to matter.
const MATTERS: f64 = 0.02;

/// A model's weighted errors as functions of its parameters.
pub trait Residuals: Sync {
    /// Number of parameters.
    fn parameters(&self) -> usize;
    /// Number of samples per output.
    fn samples(&self) -> usize;
    /// Sum of squares at each of several points (row-major); it may be given as infinite once it has passed the point's
    /// entry of `bounds`, and must be where the model cannot be evaluated.
    fn costs(&self, points: &[f64], bounds: &[f64]) -> Vec<f64>;
    /// Residuals, model minus measurement, stacked output by output, and their derivatives.
    fn linearise(&self, p: &[f64]) -> Linearisation;
}

/// How the minimum is sought.
#[derive(Debug, Clone)]
pub struct Request {
    /// Swarm, least squares, or both.
    pub method: Method,
    /// Settings of the swarm.
    pub swarm: SwarmSettings,
    /// Seed of the swarm.
    pub seed: u64,
    /// Where least squares alone begins, and one particle of a swarm; the middle of the bounds if left out.
    pub start: Option<Vec<f64>>,
}

impl Default for Request {
    /// A contracting swarm of 30 particles over 100 iterations, then least squares.
    fn default() -> Self {
        let swarm = SwarmSettings {
            particles: 30,
            iterations: 100,
            inertia: 0.72,
            cognitive: 1.49,
            social: 1.49,
            ..SwarmSettings::default()
        };
        Self { method: Method::Both, swarm, seed: 1, start: None }
    }
}

/// The answer; serialises to the object that is written to files.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SystemFit {
    /// Estimates by name, in the order given. Their unit is empty: it is the caller's.
    #[serde(serialize_with = "pairs::as_map")]
    pub parameters: Vec<(String, Estimate)>,
    /// Weighted sum of squares at the answer.
    pub cost: f64,
    /// Best cost after each generation of the swarm, then after each step of least squares.
    pub history: Vec<f64>,
    /// How the minimum was sought.
    pub method: Method,
    /// Number of evaluations of the sum of squares.
    pub evaluations: usize,
    /// True if least squares met its tolerance, or the swarm came to rest.
    pub converged: bool,
    /// True if the monitor stopped the search: this is the best so far.
    pub interrupted: bool,
    /// Root mean square of the weighted error of each output.
    pub rms: Vec<f64>,
    /// Parameters, or combinations of them, that the recording does not show.
    pub cannot_show: Vec<NotShown>,
    /// Seed of the swarm.
    pub seed: u64,
}

impl SystemFit {
    /// The estimate of a parameter.
    pub fn get(&self, name: &str) -> Option<&Estimate> {
        self.parameters.iter().find(|(n, _)| n == name).map(|(_, e)| e)
    }
}

/// Finds the parameters, named in `names`, that lower the sum of squares within `bounds`. Once `monitor` says stop, the
/// best so far is returned.
///
/// # Errors
/// [`Error::Unusable`] for names and bounds that do not go together, bounds that are no finite range, and residuals that
/// are finite nowhere; [`Error::Quantity`] for absurd settings of the swarm.
pub fn fit(
    residuals: &dyn Residuals,
    names: &[&str],
    bounds: &[(f64, f64)],
    request: &Request,
    monitor: &dyn Monitor,
) -> Result<SystemFit> {
    let dim = residuals.parameters();
    if dim == 0 || names.len() != dim || bounds.len() != dim {
        return Err(Error::unusable(
            format!("{} names and {} bounds for {dim} parameters", names.len(), bounds.len()),
            "give one of each per parameter, and at least one parameter",
        ));
    }
    for (name, (low, high)) in names.iter().zip(bounds) {
        if !((high - low).is_finite() && low < high) {
            return Err(Error::unusable(
                format!("the bounds of {name} are {low} and {high}"),
                "give two finite numbers, the lower one first",
            ));
        }
    }
    let middle = || bounds.iter().map(|(low, high)| 0.5 * (low + high)).collect::<Vec<f64>>();
    let start = request.start.clone().unwrap_or_else(middle);
    if start.len() != dim || start.iter().any(|x| !x.is_finite()) {
        return Err(Error::unusable(format!("the start is {start:?}"), format!("give {dim} finite values")));
    }
    let mut search = Search { at: start, ..Search::empty(residuals, bounds, monitor) };
    if request.method != Method::LeastSquares {
        search.swarm(request)?;
    }
    if request.method != Method::Swarm && !search.interrupted {
        search.descend()?;
    }
    if !search.cost.is_finite() && !search.interrupted {
        return Err(Error::unusable(
            "the system cannot be simulated where it was tried",
            "check its equations and units, take more substeps, or give narrower bounds",
        ));
    }
    search.answer(names, request)
}

/// The best point so far and how it was reached.
struct Search<'a> {
    residuals: &'a dyn Residuals,
    bounds: &'a [(f64, f64)],
    monitor: &'a dyn Monitor,
    at: Vec<f64>,
    cost: f64,
    history: Vec<f64>,
    evaluations: usize,
    converged: bool,
    interrupted: bool,
}

impl<'a> Search<'a> {
    fn empty(residuals: &'a dyn Residuals, bounds: &'a [(f64, f64)], monitor: &'a dyn Monitor) -> Self {
        Self {
            residuals,
            bounds,
            monitor,
            at: Vec::new(),
            cost: f64::INFINITY,
            history: Vec::new(),
            evaluations: 0,
            converged: false,
            interrupted: false,
        }
    }

    fn swarm(&mut self, request: &Request) -> Result<()> {
        let start = request.start.as_ref().map(|_| self.at.as_slice());
        let evaluate = |swarm: &Swarm, costs: &mut Vec<f64>| {
            *costs = self.residuals.costs(swarm.positions(), swarm.personal_costs());
            // A generation in which the caller said stop may not be whole.
            if self.monitor.cancelled() { 0 } else { request.swarm.particles }
        };
        let (settings, seed) = (&request.swarm, request.seed);
        let result = swarm::by_generations(settings, self.bounds, seed, start, evaluate, self.monitor)?;
        self.converged = result.settled();
        self.interrupted = result.interrupted;
        self.evaluations += result.evaluations;
        self.history = result.history;
        if result.cost.is_finite() {
            (self.at, self.cost) = (result.parameters, result.cost);
        }
        Ok(())
    }

    fn descend(&mut self) -> Result<()> {
        let problem =
            Descending { residuals: self.residuals, history: Mutex::default(), count: AtomicUsize::new(0) };
        let fit = least_squares::minimise(&problem, &self.at, self.bounds, &SETTINGS, self.monitor)?;
        self.evaluations += problem.count.into_inner();
        self.history.extend(problem.history.into_inner().unwrap_or_else(PoisonError::into_inner));
        self.interrupted = fit.status == Status::Interrupted || self.monitor.cancelled();
        if fit.cost.is_finite() && fit.cost <= self.cost {
            (self.at, self.cost) = (fit.parameters, fit.cost);
            self.converged = fit.status == Status::Converged;
        }
        Ok(())
    }

    fn answer(self, names: &[&str], request: &Request) -> Result<SystemFit> {
        let samples = self.residuals.samples();
        let linear = self.residuals.linearise(&self.at);
        let finite = linear.jacobian.iter().chain(linear.residual.iter()).all(|x| x.is_finite());
        let mut cannot_show = Vec::new();
        let mut parameters = Vec::with_capacity(names.len());
        if finite && self.cost.is_finite() {
            let sizes: Vec<f64> = self
                .at
                .iter()
                .zip(self.bounds)
                .map(|(x, (low, high))| x.abs().max(MATTERS * (high - low)))
                .collect();
            let spread = uncertainty::spread(&linear.jacobian, &linear.residual, samples);
            let advice = |_: &str| "let the inputs move more, or fix it".to_owned();
            cannot_show = uncertainty::not_shown(names, &sizes, &spread, advice)?;
            let on_bound = |k: &usize| self.at[*k] <= self.bounds[*k].0 || self.at[*k] >= self.bounds[*k].1;
            let inside: Vec<usize> = (0..names.len()).filter(|k| !on_bound(k)).collect();
            let jacobian = linear.jacobian.select_columns(&inside);
            let spread = uncertainty::spread(&jacobian, &linear.residual, samples);
            let judge = Judge::new(spread);
            for (k, name) in names.iter().enumerate() {
                let estimate = match inside.iter().position(|x| *x == k) {
                    Some(at) => judge.estimate(at, self.at[k], ""),
                    None => Estimate::on_bound(
                        self.at[k],
                        "",
                        !cannot_show.iter().any(|x| x.parameters == [*name]),
                    ),
                };
                parameters.push(((*name).to_owned(), estimate));
            }
        } else {
            for (name, x) in names.iter().zip(&self.at) {
                let why = "the search was interrupted; run it to the end for an uncertainty";
                parameters.push(((*name).to_owned(), Estimate::bare(Some(*x), "", why)));
            }
        }
        let rms = (0..linear.residual.len() / samples)
            .map(|c| (linear.residual.rows(c * samples, samples).norm_squared() / samples as f64).sqrt())
            .collect();
        Ok(SystemFit {
            parameters,
            cost: self.cost,
            history: self.history,
            method: request.method,
            evaluations: self.evaluations,
            converged: self.converged,
            interrupted: self.interrupted,
            rms,
            cannot_show,
            seed: request.seed,
        })
    }
}

struct Descending<'a> {
    residuals: &'a dyn Residuals,
    history: Mutex<Vec<f64>>,
    count: AtomicUsize,
}

impl Problem for Descending<'_> {
    fn dim(&self) -> usize {
        self.residuals.parameters()
    }

    fn cost(&self, p: &[f64]) -> f64 {
        self.count.fetch_add(1, Ordering::Relaxed);
        self.residuals.costs(p, &[f64::INFINITY]).first().copied().unwrap_or(f64::INFINITY)
    }

    fn normal(&self, p: &[f64]) -> Normal {
        self.count.fetch_add(1, Ordering::Relaxed);
        let linear = self.residuals.linearise(p);
        let cost = linear.residual.norm_squared();
        self.history.lock().unwrap_or_else(PoisonError::into_inner).push(cost);
        Normal {
            cost,
            jtj: linear.jacobian.tr_mul(&linear.jacobian),
            jtr: linear.jacobian.tr_mul(&linear.residual),
        }
    }
}
