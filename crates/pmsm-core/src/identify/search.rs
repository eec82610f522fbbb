//! The two ways to the minimum: the paper's swarm, and least squares.

use super::plan::Plan;
use crate::error::Result;
use crate::experiment::Linearisation;
use crate::kernels::objective::{Course, Nearby, Objective, Starts};
use crate::monitor::Monitor;
use crate::optimise::least_squares::{self, Fit, Normal, Problem, Settings, Status};
use crate::optimise::swarm::{self, Swarm, SwarmResult, SwarmSettings};
use nalgebra::{DMatrix, DVector};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// When least squares has converged: some thousandths of a standard error or better.
pub const SETTINGS: Settings = Settings {
    max_iterations: 100,
    cost_tolerance: 1e-12,
    step_tolerance: 1e-9,
    initial_damping: 1e-3,
    leaves_rest: true,
    stall_tolerance: 0.0,
};
/// The same for a start that is nearly right: undamped at first, and done within a tenth of a standard error.
pub const WARM: Settings =
    Settings { max_iterations: 30, cost_tolerance: 1e-6, initial_damping: 0.0, ..SETTINGS };

/// Most times that a minimum is run anew from the initial values that it calls for. They hardly move.
const ROUNDS: usize = 4;
/// Change of an initial value (A, rad/s), relative above one, that no longer matters: what is left of it after it was taken
/// out to first order is about its square.
const SETTLED: f64 = 1e-2;
/// A step that promises to lower the cost by less than this share may be the last: what the answer needs is recorded on it.
const LAST: f64 = 0.1;

/// The swarm of [`crate::optimise::swarm`] on the fitness (9), the particles of a generation in parallel. A particle is abandoned
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
    /// The initial values that belong to it, where the kernels know the model.
    pub starts: Option<Starts>,
    /// The residual there and derivatives there or one step before, if they were recorded.
    pub linear: Option<Linearisation>,
    /// Cost at the start and after each accepted step, the last one as the normal equations promise it.
    pub history: Vec<f64>,
    /// Number of evaluations of the sum of squares.
    pub evaluations: usize,
}

impl Descent {
    /// Takes what is left of the way without another run; initial values and residual follow to first order.
    fn go_on(&mut self, bounds: &[(f64, f64)], course: Option<&Course>) {
        let Some(moves) = self.fit.go_on(bounds) else { return };
        let last = self.history.last().copied().unwrap_or(f64::INFINITY);
        self.history.push(self.fit.cost.min(last));
        self.starts = course.map(|course| course.at(moves.as_slice()));
        if let Some(linear) = &mut self.linear {
            linear.residual.gemv(1.0, &linear.jacobian, &moves, 1.0);
        }
    }
}

/// Least squares on the residuals of the objective from `values` (one per fitted parameter). Every step takes the initial
/// values along.
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
    let problem = Descending { objective, plan, free: plan.free(), monitor, kept: Mutex::default() };
    problem.kept().begin = objective.has_kernels().then(|| objective.measured_starts());
    let mut fit = least_squares::minimise(&problem, values, &plan.bounds, settings, monitor)?;
    for _ in 0..ROUNDS {
        if fit.status == Status::Interrupted || !fit.cost.is_finite() || problem.kept().settled() {
            break;
        }
        fit = least_squares::minimise(&problem, &fit.parameters, &plan.bounds, settings, monitor)?;
    }
    let kept = problem.kept.into_inner().unwrap_or_else(PoisonError::into_inner);
    let here = kept.here.filter(|run| run.values == fit.parameters && fit.cost.is_finite());
    let (course, linear) = here.map(|run| (run.nearby.course, run.nearby.linear)).unzip();
    let mut descent = Descent {
        starts: course.as_ref().map(|course| course.best().clone()),
        linear: linear.flatten(),
        history: kept.history,
        evaluations: kept.evaluations,
        fit,
    };
    if descent.fit.status == Status::Converged {
        descent.go_on(&plan.bounds, course.as_ref());
    }
    Ok(descent)
}

/// Whether initial values have settled.
fn close(a: &Starts, b: &Starts) -> bool {
    let off = |a: f64, b: f64| (a - b).abs() <= SETTLED * a.abs().max(b.abs()).max(1.0);
    a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| off(*a, *b))
}

/// A run of the kernels: at which point, from which initial values, and what it tells.
struct Run {
    values: Vec<f64>,
    starts: Starts,
    nearby: Nearby,
}

impl Run {
    /// How far `values` are away.
    fn moves(&self, values: &[f64]) -> DVector<f64> {
        DVector::from_iterator(values.len(), values.iter().zip(&self.values).map(|(to, from)| to - from))
    }

    /// Whether the cost hardly changes on the way to `values`.
    fn is_near(&self, values: &[f64]) -> bool {
        let (moves, Normal { cost, jtj, jtr }) = (self.moves(values), &self.nearby.normal);
        let promised = -2.0 * jtr.dot(&moves) - moves.dot(&(jtj * &moves));
        promised.abs() <= LAST * cost
    }
}

/// What one evaluation leaves for the next.
#[derive(Default)]
struct Kept {
    history: Vec<f64>,
    evaluations: usize,
    /// Where the kernels know the model: initial values for the first run.
    begin: Option<Starts>,
    /// The run at the best point so far.
    here: Option<Run>,
    /// The run tried last.
    tried: Option<Run>,
}

impl Kept {
    /// Initial values for a run at `values`.
    fn starts(&self, values: &[f64]) -> Option<Starts> {
        let Some(here) = &self.here else { return self.begin.clone() };
        Some(here.nearby.course.at(here.moves(values).as_slice()))
    }

    /// Whether the best point was run from the initial values that it calls for. If not, the next run begins there.
    fn settled(&self) -> bool {
        let Some(here) = &self.here else { return true };
        close(&here.starts, here.nearby.course.best())
    }
}

struct Descending<'a> {
    objective: &'a Objective<'a>,
    plan: &'a Plan,
    free: Vec<usize>,
    monitor: &'a dyn Monitor,
    kept: Mutex<Kept>,
}

impl Descending<'_> {
    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A run of the kernels, which delivers normal equations for hardly more than the cost. With `finish` nothing cuts it
    /// short.
    fn on_kernels(&self, values: &[f64], kept: &Kept, finish: bool) -> Option<Run> {
        let stop = || !finish && self.monitor.cancelled();
        let starts = kept.starts(values)?;
        let record = kept.here.as_ref().is_some_and(|here| here.is_near(values));
        let point = self.plan.point(values);
        let nearby = self.objective.normal(&point, &self.free, &starts, record, &stop)?;
        Some(Run { values: values.to_vec(), starts, nearby })
    }
}

impl Problem for Descending<'_> {
    fn dim(&self) -> usize {
        self.free.len()
    }

    fn cost(&self, values: &[f64]) -> f64 {
        let mut kept = self.kept();
        kept.evaluations += 1;
        kept.tried = self.on_kernels(values, &kept, false);
        match &kept.tried {
            Some(run) => run.nearby.normal.cost,
            None if self.monitor.cancelled() => f64::INFINITY,
            None => self.objective.residual(&self.plan.point(values)).norm_squared(),
        }
    }

    fn normal(&self, values: &[f64]) -> Normal {
        let mut kept = self.kept();
        let known = kept.tried.take().filter(|run| run.values == values);
        kept.evaluations += usize::from(known.is_none());
        // The start is evaluated in any case, so that an interrupted fit has a cost.
        let first = kept.history.is_empty();
        let normal = match known.or_else(|| self.on_kernels(values, &kept, first)) {
            Some(run) => {
                let normal = run.nearby.normal.clone();
                kept.here = Some(run);
                normal
            }
            None if !first && self.monitor.cancelled() => {
                let dim = self.dim();
                Normal { cost: f64::NAN, jtj: DMatrix::zeros(dim, dim), jtr: DVector::zeros(dim) }
            }
            None => {
                let linear = self.objective.linearise(&self.plan.point(values), &self.free, None);
                Normal {
                    cost: linear.residual.norm_squared(),
                    jtj: linear.jacobian.tr_mul(&linear.jacobian),
                    jtr: linear.jacobian.tr_mul(&linear.residual),
                }
            }
        };
        // Settling initial values anew may raise the cost in its last digits.
        let last = kept.history.last().copied().unwrap_or(f64::INFINITY);
        kept.history.push(normal.cost.min(last));
        normal
    }
}
