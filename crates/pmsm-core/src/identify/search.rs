//! The two ways to the minimum: the paper's swarm, and least squares.

use super::plan::Plan;
use crate::error::Result;
use crate::least_squares::{self, Fit, Normal, Problem, Settings, Status};
use crate::monitor::Monitor;
use crate::objective::{Objective, Starts};
use crate::swarm::{self, Swarm, SwarmResult, SwarmSettings};
use std::sync::{Mutex, PoisonError};

/// When least squares has converged: a thousandth of a standard error or better.
pub const SETTINGS: Settings =
    Settings { max_iterations: 100, cost_tolerance: 1e-12, step_tolerance: 1e-9, initial_damping: 1e-3 };
/// The same for a start that is nearly right: undamped at first, and done within a hundredth of a standard error.
pub const WARM: Settings =
    Settings { max_iterations: 30, cost_tolerance: 1e-8, step_tolerance: 1e-9, initial_damping: 0.0 };

/// Most times that initial values are settled anew at a minimum. They hardly move.
const ROUNDS: usize = 4;
/// Change of an initial value (A, rad/s), relative above one, that no longer matters.
const SETTLED: f64 = 1e-6;

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
    let start = warm.then(|| plan.first());
    let mut points = plan.start.repeat(settings.particles);
    let evaluate = |swarm: &Swarm, costs: &mut Vec<f64>| {
        let positions = swarm.positions().chunks_exact(plan.targets.len());
        for (point, values) in points.chunks_exact_mut(plan.start.len()).zip(positions) {
            for (target, value) in plan.targets.iter().zip(values) {
                point[target.index()] = *value;
            }
        }
        objective.fitnesses(&points, swarm.personal_costs(), costs, &|| monitor.cancelled())
    };
    swarm::by_generations(settings, &plan.bounds, seed, start.as_deref(), evaluate, monitor)
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
pub fn descend(
    objective: &Objective,
    plan: &Plan,
    values: &[f64],
    settings: &Settings,
    monitor: &dyn Monitor,
) -> Result<Descent> {
    let starts = objective.has_kernels().then(|| objective.measured_starts());
    let mut problem =
        Descending { objective, plan, free: plan.free(), monitor, starts, kept: Mutex::default() };
    let mut fit = least_squares::minimise(&problem, values, &plan.bounds, settings, monitor)?;
    for _ in 0..ROUNDS {
        let Some(starts) = problem.starts.take() else { break };
        if fit.status == Status::Interrupted || !fit.cost.is_finite() {
            break;
        }
        let next = objective.settled_starts(&plan.point(&fit.parameters), starts.clone());
        if next.as_ref().is_none_or(|next| close(&starts, next)) {
            break;
        }
        problem.starts = next;
        fit = least_squares::minimise(&problem, &fit.parameters, &plan.bounds, settings, monitor)?;
    }
    let kept = problem.kept.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Descent { fit, history: kept.history, evaluations: kept.evaluations })
}

/// Whether initial values have settled.
fn close(a: &Starts, b: &Starts) -> bool {
    let off = |a: f64, b: f64| (a - b).abs() <= SETTLED * a.abs().max(b.abs()).max(1.0);
    a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| off(*a, *b))
}

/// What one evaluation leaves for the next.
#[derive(Default)]
struct Kept {
    history: Vec<f64>,
    evaluations: usize,
    /// The point tried last and its normal equations.
    tried: Option<(Vec<f64>, Normal)>,
}

struct Descending<'a> {
    objective: &'a Objective<'a>,
    plan: &'a Plan,
    free: Vec<usize>,
    monitor: &'a dyn Monitor,
    /// Where the kernels know the model: initial values around which they are eliminated.
    starts: Option<Starts>,
    kept: Mutex<Kept>,
}

impl Descending<'_> {
    /// Normal equations on the kernels, which cost hardly more than a run.
    fn on_kernels(&self, values: &[f64], first: bool) -> Option<Normal> {
        // The start is evaluated in any case, so that an interrupted fit has a cost.
        let stop = || !first && self.monitor.cancelled();
        let starts = self.starts.as_ref()?;
        Some(self.objective.normal(&self.plan.point(values), &self.free, starts, &stop)?.0)
    }
}

impl Problem for Descending<'_> {
    fn dim(&self) -> usize {
        self.free.len()
    }

    fn cost(&self, values: &[f64]) -> f64 {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.evaluations += 1;
        if let Some(normal) = self.on_kernels(values, false) {
            let cost = normal.cost;
            kept.tried = Some((values.to_vec(), normal));
            return cost;
        }
        self.objective.residual(&self.plan.point(values)).norm_squared()
    }

    fn normal(&self, values: &[f64]) -> Normal {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let known = kept.tried.take().filter(|(at, _)| at == values).map(|(_, normal)| normal);
        kept.evaluations += usize::from(known.is_none());
        let first = kept.history.is_empty();
        let normal = known.or_else(|| self.on_kernels(values, first)).unwrap_or_else(|| {
            let linear = self.objective.linearise(&self.plan.point(values), &self.free);
            Normal {
                cost: linear.residual.norm_squared(),
                jtj: linear.jacobian.tr_mul(&linear.jacobian),
                jtr: linear.jacobian.tr_mul(&linear.residual),
            }
        });
        // Settling initial values anew may raise the cost in its last digits.
        let last = kept.history.last().copied().unwrap_or(f64::INFINITY);
        kept.history.push(normal.cost.min(last));
        normal
    }
}
