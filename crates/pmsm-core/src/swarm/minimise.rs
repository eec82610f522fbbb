//! A whole run of the swarm, particles in parallel.

use super::{Swarm, SwarmSettings};
use crate::error::Result;
use crate::monitor::Monitor;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A swarm is at rest if its last quarter lowered the cost by no more than this share.
const FLAT: f64 = 0.01;

/// Outcome of [`minimise`].
#[derive(Debug, Clone, PartialEq)]
pub struct SwarmResult {
    /// Best point found.
    pub parameters: Vec<f64>,
    /// Its cost; infinite if no evaluated point had a cost below infinity.
    pub cost: f64,
    /// Best cost after each generation, an interrupted one included.
    pub history: Vec<f64>,
    /// Number of cost evaluations.
    pub evaluations: usize,
    /// True if the monitor stopped the run before its last evaluation.
    pub interrupted: bool,
}

impl SwarmResult {
    /// Whether the swarm ran to its end and came to rest: its last quarter hardly lowered the cost.
    pub(crate) fn settled(&self) -> bool {
        let quarter = self.history.len().checked_sub(1 + self.history.len() / 4).map(|k| self.history[k]);
        !self.interrupted && quarter.is_some_and(|before| before - self.cost <= FLAT * self.cost)
    }
}

/// Runs a whole swarm, evaluating the particles of a generation in parallel in the caller's rayon pool. The result has
/// the same bits for any number of threads. `start` places one particle (see [`Swarm::with_start`]). The monitor is
/// asked before every evaluation; once it says stop, the best point so far is returned.
///
/// # Errors
/// Those of [`Swarm::new`] and [`Swarm::with_start`].
pub fn minimise(
    settings: &SwarmSettings,
    bounds: &[(f64, f64)],
    seed: u64,
    start: Option<&[f64]>,
    cost: &(dyn Fn(&[f64]) -> f64 + Sync),
    monitor: &dyn Monitor,
) -> Result<SwarmResult> {
    let evaluate = |swarm: &Swarm, costs: &mut Vec<f64>| {
        let evaluated = AtomicUsize::new(0);
        swarm.positions().par_chunks(bounds.len()).zip(costs.par_iter_mut()).for_each(|(point, slot)| {
            *slot = f64::INFINITY;
            if !monitor.cancelled() {
                *slot = cost(point);
                evaluated.fetch_add(1, Ordering::Relaxed);
            }
        });
        evaluated.into_inner()
    };
    by_generations(settings, bounds, seed, start, evaluate, monitor)
}

/// As [`minimise`], for whoever evaluates a generation in one go: `evaluate` puts one cost per position in place and
/// returns how many it evaluated. Fewer than there are particles end the run, none leaves it where it was.
///
/// # Errors
/// Those of [`Swarm::new`], [`Swarm::with_start`] and [`Swarm::tell`].
pub(crate) fn by_generations(
    settings: &SwarmSettings,
    bounds: &[(f64, f64)],
    seed: u64,
    start: Option<&[f64]>,
    mut evaluate: impl FnMut(&Swarm, &mut Vec<f64>) -> usize,
    monitor: &dyn Monitor,
) -> Result<SwarmResult> {
    let mut swarm = Swarm::new(settings, bounds, seed)?;
    if let Some(point) = start {
        swarm.with_start(point)?;
    }
    let mut costs = vec![f64::INFINITY; settings.particles];
    let (mut evaluations, mut interrupted) = (0, false);
    while !swarm.done() && !interrupted {
        let evaluated = evaluate(&swarm, &mut costs);
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
