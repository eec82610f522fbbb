//! A whole run of the swarm, particles in parallel.

use super::{Swarm, SwarmSettings};
use crate::error::Result;
use crate::monitor::Monitor;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

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

/// Runs a whole swarm, evaluating the particles of a generation in parallel in the caller's rayon pool. The result has
/// the same bits for any number of threads. `start` places one particle (see [`Swarm::with_start`]). The monitor is
/// asked before every generation and every evaluation; once it says stop, the best point so far is returned.
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
    let mut swarm = Swarm::new(settings, bounds, seed)?;
    if let Some(point) = start {
        swarm.with_start(point)?;
    }
    let mut costs = vec![f64::INFINITY; settings.particles];
    let evaluations = AtomicUsize::new(0);
    let mut interrupted = false;
    while !swarm.done() && !interrupted {
        if monitor.cancelled() {
            interrupted = true;
            break;
        }
        let before = evaluations.load(Ordering::Relaxed);
        swarm.positions().par_chunks(bounds.len()).zip(costs.par_iter_mut()).for_each(|(point, slot)| {
            *slot = f64::INFINITY;
            if !monitor.cancelled() {
                *slot = cost(point);
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
