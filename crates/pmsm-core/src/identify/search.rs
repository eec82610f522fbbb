//! The two ways to the minimum: the paper's swarm, and least squares.

use super::plan::Plan;
use crate::error::Result;
use crate::least_squares::{self, Fit, Normal, Problem, Settings};
use crate::monitor::Monitor;
use crate::objective::{Objective, Starts};
use crate::swarm::{Swarm, SwarmResult, SwarmSettings};
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
    let mut evaluations = 0;
    let mut costs = vec![f64::INFINITY; settings.particles];
    let mut points = plan.start.repeat(settings.particles);
    let mut interrupted = false;
    while !swarm.done() && !interrupted {
        let positions = swarm.positions().chunks_exact(plan.targets.len());
        for (point, values) in points.chunks_exact_mut(plan.start.len()).zip(positions) {
            for (target, value) in plan.targets.iter().zip(values) {
                point[target.index()] = *value;
            }
        }
        let stop = || monitor.cancelled();
        let evaluated = objective.fitnesses(&points, swarm.personal_costs(), &mut costs, &stop);
        evaluations += evaluated;
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
        evaluations,
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
        monitor,
        kept: Mutex::new(Kept { starts: objective.measured_starts(), ..Kept::default() }),
    };
    let fit = least_squares::minimise(&problem, values, &plan.bounds, &SETTINGS, monitor)?;
    let kept = problem.kept.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Descent { fit, history: kept.history, evaluations: kept.evaluations })
}

/// What one evaluation leaves for the next.
#[derive(Default)]
struct Kept {
    history: Vec<f64>,
    evaluations: usize,
    /// Initial values that belong to the last accepted point, and whether they were estimated there.
    starts: Starts,
    settled: bool,
    /// The point tried last, its normal equations and initial values.
    tried: Option<(Vec<f64>, Normal, Starts)>,
}

struct Descending<'a> {
    objective: &'a Objective<'a>,
    plan: &'a Plan,
    free: Vec<usize>,
    monitor: &'a dyn Monitor,
    kept: Mutex<Kept>,
}

impl Descending<'_> {
    /// Normal equations on the kernels, which cost hardly more than a run; initial values are taken over from the last
    /// accepted point, which brings them to their minimum along with the parameters.
    fn on_kernels(&self, values: &[f64], kept: &mut Kept) -> Option<(Normal, Starts)> {
        let point = self.plan.point(values);
        // The start is evaluated in any case, so that an interrupted fit has a cost.
        let first = !kept.settled;
        let stop = || !first && self.monitor.cancelled();
        if first {
            kept.starts = self.objective.normal(&point, &[], &kept.starts, &stop)?.1;
            kept.settled = true;
        }
        self.objective.normal(&point, &self.free, &kept.starts, &stop)
    }
}

impl Problem for Descending<'_> {
    fn dim(&self) -> usize {
        self.free.len()
    }

    fn cost(&self, values: &[f64]) -> f64 {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.evaluations += 1;
        if let Some((normal, starts)) = self.on_kernels(values, &mut kept) {
            let cost = normal.cost;
            kept.tried = Some((values.to_vec(), normal, starts));
            return cost;
        }
        self.objective.residual(&self.plan.point(values)).norm_squared()
    }

    fn normal(&self, values: &[f64]) -> Normal {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let tried = kept.tried.take().filter(|(at, ..)| at == values);
        let known = tried.map(|(_, normal, starts)| (normal, starts));
        if known.is_none() {
            kept.evaluations += 1;
        }
        let normal = match known.or_else(|| self.on_kernels(values, &mut kept)) {
            Some((normal, starts)) => {
                kept.starts = starts;
                normal
            }
            None => {
                let linear = self.objective.linearise(&self.plan.point(values), &self.free);
                Normal {
                    cost: linear.residual.norm_squared(),
                    jtj: linear.jacobian.tr_mul(&linear.jacobian),
                    jtr: linear.jacobian.tr_mul(&linear.residual),
                }
            }
        };
        kept.history.push(normal.cost);
        normal
    }
}
