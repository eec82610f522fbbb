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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::monitor::{Silent, StopFlag};

    fn sphere(x: &[f64]) -> f64 {
        x.iter().map(|v| v * v).sum()
    }

    #[test]
    fn history_has_an_entry_per_generation_and_never_rises() {
        let result =
            minimise(&SwarmSettings::default(), &[(-5.0, 5.0); 3], 1, None, &sphere, &Silent).unwrap();
        assert_eq!((result.history.len(), result.evaluations), (31, 310));
        assert!(result.history.windows(2).all(|w| w[1] <= w[0]) && !result.interrupted);
        assert_eq!(result.cost, *result.history.last().unwrap());
        assert_eq!(result.cost, sphere(&result.parameters));
    }

    #[test]
    fn nan_and_infinite_costs_never_win() {
        let half = |x: &[f64]| if x[0] < 0.0 { f64::NAN } else { sphere(x) };
        let result = minimise(&SwarmSettings::default(), &[(-5.0, 5.0); 2], 2, None, &half, &Silent).unwrap();
        assert!(result.cost.is_finite() && result.parameters[0] >= 0.0);
        let none = |_: &[f64]| f64::NAN;
        let result = minimise(&SwarmSettings::default(), &[(-5.0, 5.0); 2], 2, None, &none, &Silent).unwrap();
        assert_eq!(result.cost, f64::INFINITY);
        assert!(result.parameters.iter().all(|x| x.is_finite()) && !result.interrupted);
    }

    #[test]
    fn an_interrupted_run_keeps_its_best() {
        let flag = StopFlag::default();
        let calls = AtomicUsize::new(0);
        let cost = |x: &[f64]| {
            if calls.fetch_add(1, Ordering::Relaxed) == 24 {
                flag.stop();
            }
            sphere(x)
        };
        let result = minimise(&SwarmSettings::default(), &[(-5.0, 5.0); 2], 2, None, &cost, &flag).unwrap();
        assert!(result.interrupted && (25..40).contains(&result.evaluations));
        assert_eq!(result.cost, sphere(&result.parameters));
        let at_once = minimise(&SwarmSettings::default(), &[(-5.0, 5.0); 2], 2, None, &cost, &flag).unwrap();
        assert!(at_once.interrupted && at_once.evaluations == 0 && at_once.history.is_empty());
    }
}
