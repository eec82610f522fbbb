//! The two ways to the minimum: the paper's swarm, and least squares.

use super::plan::Plan;
use crate::error::Result;
use crate::least_squares::{self, Fit, Normal, Problem, Settings};
use crate::monitor::Monitor;
use crate::objective::Objective;
use crate::swarm::{Swarm, SwarmResult, SwarmSettings};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// When least squares has converged: a thousandth of a standard error or better.
const SETTINGS: Settings =
    Settings { max_iterations: 100, cost_tolerance: 1e-12, step_tolerance: 1e-9, initial_damping: 1e-3 };

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
    /// Cost at the start and after each accepted step.
    pub history: Vec<f64>,
    /// Number of evaluations of the sum of squares.
    pub evaluations: usize,
}

/// Least squares on the residuals of the objective from `values` (one per fitted parameter).
///
/// # Errors
/// Those of [`least_squares::minimise`].
pub fn descend(objective: &Objective, plan: &Plan, values: &[f64], monitor: &dyn Monitor) -> Result<Descent> {
    let problem = Descending {
        objective,
        plan,
        free: plan.free(),
        history: Mutex::default(),
        evaluations: AtomicUsize::new(0),
    };
    let fit = least_squares::minimise(&problem, values, &plan.bounds, &SETTINGS, monitor)?;
    let history = problem.history.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Descent { fit, history, evaluations: problem.evaluations.into_inner() })
}

struct Descending<'a> {
    objective: &'a Objective<'a>,
    plan: &'a Plan,
    free: Vec<usize>,
    history: Mutex<Vec<f64>>,
    evaluations: AtomicUsize,
}

impl Problem for Descending<'_> {
    fn dim(&self) -> usize {
        self.free.len()
    }

    fn cost(&self, values: &[f64]) -> f64 {
        self.evaluations.fetch_add(1, Ordering::Relaxed);
        self.objective.residual(&self.plan.point(values)).norm_squared()
    }

    fn normal(&self, values: &[f64]) -> Normal {
        self.evaluations.fetch_add(1, Ordering::Relaxed);
        let linear = self.objective.linearise(&self.plan.point(values), &self.free);
        let cost = linear.residual.norm_squared();
        self.history.lock().unwrap_or_else(PoisonError::into_inner).push(cost);
        Normal {
            cost,
            jtj: linear.jacobian.tr_mul(&linear.jacobian),
            jtr: linear.jacobian.tr_mul(&linear.residual),
        }
    }
}
