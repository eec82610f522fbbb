//! The two ways to the minimum: the paper's swarm, and least squares.

use super::plan::Plan;
use crate::error::Result;
use crate::least_squares::{self, Fit, Normal, Problem, Settings};
use crate::monitor::Monitor;
use crate::objective::{Drive, Objective};
use crate::swarm::{Swarm, SwarmResult, SwarmSettings};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// When least squares has converged: a thousandth of a standard error or better.
pub const SETTINGS: Settings =
    Settings { max_iterations: 100, cost_tolerance: 1e-12, step_tolerance: 1e-9, initial_damping: 1e-3 };
/// The same for a start that is nearly right: undamped at first, and done within a hundredth of a standard error.
pub const WARM: Settings =
    Settings { max_iterations: 30, cost_tolerance: 1e-8, step_tolerance: 1e-9, initial_damping: 0.0 };

/// The swarm of [`crate::swarm`] on the fitness (9), the particles of a generation in parallel. A particle is abandoned
/// once its sum has passed its own best, which does not change the swarm's path. `warm` puts one particle on the
/// starting point of the plan.
///
/// # Errors
/// Those of [`Swarm::new`].
pub fn swarm(
    objective: &Objective,
    plan: &Plan,
    settings: &SwarmSettings,
    seed: u64,
    warm: bool,
    monitor: &dyn Monitor,
) -> Result<SwarmResult> {
    let mut swarm = Swarm::new(settings, &plan.bounds, seed)?;
    if warm {
        swarm.with_start(&plan.first())?;
    }
    let evaluations = AtomicUsize::new(0);
    let mut costs = vec![f64::INFINITY; settings.particles];
    let mut interrupted = false;
    while !swarm.done() && !interrupted {
        let before = evaluations.load(Ordering::Relaxed);
        let points = swarm.positions().par_chunks(plan.targets.len());
        points.zip(swarm.personal_costs()).zip(&mut costs).for_each(|((values, best), cost)| {
            *cost = f64::INFINITY;
            if !monitor.cancelled() {
                *cost = objective.fitness(&plan.point(values), *best);
                evaluations.fetch_add(1, Ordering::Relaxed);
            }
        });
        let evaluated = evaluations.load(Ordering::Relaxed) - before;
        interrupted = evaluated < settings.particles;
        if evaluated > 0 {
            swarm.tell(&costs)?;
        }
        monitor.report("particle swarm", swarm.generation() as f64 / (settings.iterations + 1) as f64);
    }
    let (parameters, cost) = swarm.best();
    Ok(SwarmResult {
        parameters: parameters.to_vec(),
        cost,
        history: swarm.history().to_vec(),
        evaluations: evaluations.into_inner(),
        interrupted,
    })
}

/// Outcome of [`descend`].
pub struct Descent {
    /// The fit.
    pub fit: Fit,
    /// Initial values of the segments at the answer, three each; none unless the model is coupled.
    pub starts: Vec<f64>,
    /// Cost at the start and after each accepted step.
    pub history: Vec<f64>,
    /// Number of evaluations of the sum of squares.
    pub evaluations: usize,
}

/// Least squares on the residuals of the objective from `values` (one per fitted parameter). In the coupled model the
/// initial values of each segment are sought along with them, from the measured ones.
///
/// # Errors
/// Those of [`least_squares::minimise`].
pub fn descend(
    objective: &Objective,
    plan: &Plan,
    values: &[f64],
    settings: &Settings,
    monitor: &dyn Monitor,
) -> Result<Descent> {
    let coupled = plan.drive == Drive::Coupled;
    let starts = if coupled { objective.measured_starts() } else { Vec::new() };
    let problem = Descending {
        objective,
        plan,
        free: plan.free(),
        starts: starts.len(),
        history: Mutex::default(),
        evaluations: AtomicUsize::new(0),
    };
    let bounds: Vec<_> = plan
        .bounds
        .iter()
        .copied()
        .chain(starts.iter().map(|_| (f64::NEG_INFINITY, f64::INFINITY)))
        .collect();
    let from: Vec<f64> = values.iter().copied().chain(starts).collect();
    let mut fit = least_squares::minimise(&problem, &from, &bounds, settings, monitor)?;
    let starts = fit.parameters.split_off(plan.targets.len());
    let history = problem.history.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Descent { fit, starts, history, evaluations: problem.evaluations.into_inner() })
}

struct Descending<'a> {
    objective: &'a Objective<'a>,
    plan: &'a Plan,
    free: Vec<usize>,
    /// Number of initial values behind the fitted parameters; none unless the model is coupled.
    starts: usize,
    history: Mutex<Vec<f64>>,
    evaluations: AtomicUsize,
}

impl Problem for Descending<'_> {
    fn dim(&self) -> usize {
        self.free.len() + self.starts
    }

    fn cost(&self, values: &[f64]) -> f64 {
        self.evaluations.fetch_add(1, Ordering::Relaxed);
        if self.starts > 0 {
            let (values, starts) = values.split_at(self.free.len());
            return self.objective.free_cost(&self.plan.point(values), starts);
        }
        self.objective.residual(&self.plan.point(values)).norm_squared()
    }

    fn normal(&self, values: &[f64]) -> Normal {
        self.evaluations.fetch_add(1, Ordering::Relaxed);
        let normal = if self.starts > 0 {
            let (values, starts) = values.split_at(self.free.len());
            self.objective.free_normal(&self.plan.point(values), &self.free, starts)
        } else {
            let linear = self.objective.linearise(&self.plan.point(values), &self.free);
            Normal {
                cost: linear.residual.norm_squared(),
                jtj: linear.jacobian.tr_mul(&linear.jacobian),
                jtr: linear.jacobian.tr_mul(&linear.residual),
            }
        };
        self.history.lock().unwrap_or_else(PoisonError::into_inner).push(normal.cost);
        normal
    }
}
