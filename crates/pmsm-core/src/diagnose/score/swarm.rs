//! The start for an effect whose fit has many minima: by a particle swarm over all its parameters.

use super::{Prospect, Scorer};
use crate::effects::EffectId;
use crate::error::{Error, Result};
use crate::monitor::{Monitor, Silent};
use crate::optimise::swarm::{Swarm, SwarmSettings, by_generations};
use rayon::prelude::*;

/// How far the swarm ranges beyond the grid of shapes, as a factor.
const BEYOND: f64 = 2.0;
/// Shares of its range in which a strength is looked for.
const STRENGTHS: (f64, f64) = (0.05, 0.98);
/// Smallest value that is tried, over the typical one.
const SMALLEST: f64 = 1e-3;
/// Particles that run beside one another.
const TOGETHER: usize = 4;
/// Seed of the swarm: the same recording has the same answer.
const SEED: u64 = 1;

/// Where a swarm looks, and for how long.
#[derive(Debug, Clone, Copy)]
pub struct Ranging<'a> {
    /// Particles and moves.
    pub size: (usize, usize),
    /// Parameters about which it looks, within a factor; the whole range where there are none.
    pub about: Option<(&'a [f64], f64)>,
}

impl Scorer<'_> {
    /// The parameters of an effect that explain most by exact simulation, whatever else was fitted giving way to first order. The logarithms of
    /// the parameters are drawn.
    ///
    /// # Errors
    /// [`Error::Interrupted`], and those of the swarm.
    pub fn by_swarm(&self, effect: EffectId, ranging: Ranging, monitor: &dyn Monitor) -> Result<Prospect> {
        let count = effect.info().parameters.len();
        let bounds: Vec<(f64, f64)> = (0..count).map(|k| self.range(effect, k, ranging.about)).collect();
        let (particles, iterations) = ranging.size;
        // Constriction coefficients of Clerc & Kennedy, IEEE Trans. Evol. Comput. 6 (2002) 58: a swarm that comes to rest.
        let (inertia, pull) = (0.73, 1.5);
        let pulls = SwarmSettings { inertia, cognitive: pull, social: pull, ..Default::default() };
        let settings = SwarmSettings { particles, iterations, ..pulls };
        let own = |point: &[f64]| point.iter().map(|x| x.exp()).collect::<Vec<f64>>();
        let evaluate = |swarm: &Swarm, costs: &mut Vec<f64>| {
            let points: Vec<Vec<f64>> = swarm.positions().chunks(count).map(own).collect();
            let scores = |some: &[Vec<f64>]| match monitor.go_on() {
                Ok(()) => self.trials(effect, some),
                Err(_) => Vec::new(),
            };
            let scored: Vec<f64> =
                points.par_chunks(TOGETHER).map(scores).collect::<Vec<Vec<f64>>>().concat();
            for (cost, score) in costs.iter_mut().zip(&scored) {
                *cost = -score;
            }
            scored.len()
        };
        let start = ranging.about.map(|(at, _)| {
            let logarithms = at.iter().zip(&bounds).map(|(x, (low, high))| x.ln().clamp(*low, *high));
            logarithms.collect::<Vec<f64>>()
        });
        let found = by_generations(&settings, &bounds, SEED, start.as_deref(), evaluate, &Silent)?;
        if found.interrupted {
            return Err(Error::Interrupted);
        }
        Ok(Prospect { effect, start: own(&found.parameters), score: -found.cost })
    }

    /// Logarithms of the smallest and the largest value of a parameter that are tried.
    fn range(&self, effect: EffectId, k: usize, about: Option<(&[f64], f64)>) -> (f64, f64) {
        let context = self.hypothesis.model.context();
        let parameter = &effect.info().parameters[k];
        let (low, high) = ((parameter.low)(context), (parameter.high)(context));
        let least = low.max(SMALLEST * (parameter.typical)(context));
        let within = |x: f64| x.clamp(least, high).ln();
        if let Some((at, factor)) = about {
            return (within(at[k] / factor), within(at[k] * factor));
        }
        let grid = effect.probes(context);
        let (first, last) = grid.iter().fold((f64::INFINITY, 0f64), |(a, b), p| (a.min(p[k]), b.max(p[k])));
        if first < last {
            return (within(first / BEYOND), within(last * BEYOND));
        }
        let share = |x: f64| within(low + x * (high - low));
        (share(STRENGTHS.0), share(STRENGTHS.1))
    }
}
