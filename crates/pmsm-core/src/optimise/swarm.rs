//! Particle swarm of Liu, Liu & Cartes 2008, eq. (5) and Fig. 2:
//!
//! ```text
//! v ← w·v + c₁·r₁·(pbest − x) + c₂·r₂·(gbest − x)        (5a)
//! x ← x + v                                              (5b)
//! ```
//!
//! with r₁, r₂ uniform in [0, 1), drawn anew for every particle and dimension, and velocities and positions clamped
//! to their limits after (5a) and (5b). The swarm advances one generation at a time: the caller evaluates
//! [`Swarm::positions`] in any order and hands the costs to [`Swarm::tell`]. A random number is a function of (seed,
//! generation, particle, dimension), so a run depends on neither evaluation order nor thread count.
//!
//! The variants that the paper cites are options ([`Inertia`], [`Update`], [`Neighbourhood`]); they are off by default.

mod advance;
mod minimise;
mod settings;
mod variants;

use advance::uniform_pair;

use crate::error::{Error, Result};

pub(crate) use minimise::by_generations;
pub use minimise::{SwarmResult, minimise};
pub use settings::SwarmSettings;
pub use variants::{Inertia, Neighbourhood, Update};

/// A swarm between two generations. Allocates when built and never again.
#[derive(Debug, Clone)]
pub struct Swarm {
    settings: SwarmSettings,
    bounds: Vec<(f64, f64)>,
    seed: u64,
    positions: Vec<f64>,
    velocities: Vec<f64>,
    personal: Vec<f64>,
    personal_costs: Vec<f64>,
    best: Vec<f64>,
    best_cost: f64,
    /// Neighbours of each particle where it does not simply listen to the best of all.
    neighbours: Vec<Vec<usize>>,
    /// Share of particles that the last costs bettered.
    bettered: f64,
    history: Vec<f64>,
}

impl Swarm {
    /// Draws generation 0: positions uniform within `bounds` (one `(low, high)` per dimension), velocities uniform
    /// within their limits. A dimension with `low == high` stays fixed.
    ///
    /// # Errors
    /// Settings that [`SwarmSettings::validate`] refuses; no dimension; a bound that is not finite or is reversed.
    pub fn new(settings: &SwarmSettings, bounds: &[(f64, f64)], seed: u64) -> Result<Self> {
        settings.validate()?;
        if bounds.is_empty() {
            return Err(Error::unusable("the swarm has no dimension", "give at least one pair of bounds"));
        }
        for (k, &(low, high)) in bounds.iter().enumerate() {
            if !((high - low).is_finite() && low <= high) {
                return Err(Error::unusable(
                    format!("the bounds of dimension {k} are {low} and {high}"),
                    "both must be finite, the lower one first",
                ));
            }
        }
        let (n, dims) = (settings.particles, bounds.len());
        let mut swarm = Self {
            settings: *settings,
            bounds: bounds.to_vec(),
            seed,
            positions: vec![0.0; n * dims],
            velocities: vec![0.0; n * dims],
            personal: vec![0.0; n * dims],
            personal_costs: vec![f64::INFINITY; n],
            best: vec![0.0; dims],
            best_cost: f64::INFINITY,
            neighbours: Vec::new(),
            bettered: 0.0,
            history: Vec::with_capacity(settings.iterations + 1),
        };
        for i in 0..n {
            for (k, &(low, high)) in bounds.iter().enumerate() {
                let (r1, r2) = uniform_pair(seed, 0, i, k);
                swarm.positions[i * dims + k] = (low + r1 * (high - low)).clamp(low, high);
                swarm.velocities[i * dims + k] = (2.0 * r2 - 1.0) * settings.velocity_limit * (high - low);
            }
        }
        if settings.neighbourhood != Neighbourhood::All || settings.update == Update::FullyInformed {
            swarm.neighbours = (0..n).map(|i| settings.neighbourhood.of(i, n)).collect();
        }
        swarm.personal.copy_from_slice(&swarm.positions);
        swarm.best.copy_from_slice(&swarm.positions[..dims]);
        Ok(swarm)
    }

    /// Warm start: moves particle 0 to `point`, clamped to the bounds, before the first generation is evaluated.
    ///
    /// # Errors
    /// [`Error::Unusable`] if `point` has another dimension or a value that is not finite, or if costs were told.
    pub fn with_start(&mut self, point: &[f64]) -> Result<()> {
        if point.len() != self.bounds.len() || !point.iter().all(|x| x.is_finite()) {
            return Err(Error::unusable(
                format!("the swarm cannot start from {point:?}"),
                format!("give {} finite values", self.bounds.len()),
            ));
        }
        if !self.history.is_empty() {
            return Err(Error::unusable("the swarm is already under way", "set its start before any cost"));
        }
        for (k, (&x, &(low, high))) in point.iter().zip(&self.bounds).enumerate() {
            let x = x.clamp(low, high);
            self.positions[k] = x;
            self.personal[k] = x;
            self.best[k] = x;
        }
        Ok(())
    }

    /// The points to evaluate now: row-major, particles × dimensions.
    pub fn positions(&self) -> &[f64] {
        &self.positions
    }

    /// Best cost of each particle so far. A sum of squares that has passed it may be abandoned and told as infinite
    /// without changing the swarm's path.
    pub fn personal_costs(&self) -> &[f64] {
        &self.personal_costs
    }

    /// Takes the cost of each position in order and moves the swarm on. NaN counts as infinite. While a particle, or
    /// the swarm, has seen no cost below infinity, it has no best point and is not pulled towards one.
    ///
    /// # Errors
    /// [`Error::Unusable`] if the number of costs is not the number of particles, or if the swarm is done.
    pub fn tell(&mut self, costs: &[f64]) -> Result<()> {
        if costs.len() != self.settings.particles {
            return Err(Error::unusable(
                format!("{} costs for {} particles", costs.len(), self.settings.particles),
                "give one cost per particle",
            ));
        }
        if self.done() {
            return Err(Error::unusable("the swarm has made all its iterations", "build a new one"));
        }
        let dims = self.bounds.len();
        let mut bettered = 0usize;
        for (i, &cost) in costs.iter().enumerate() {
            let row = i * dims..(i + 1) * dims;
            // Comparisons with NaN are false: it never becomes a best.
            if cost < self.personal_costs[i] {
                bettered += 1;
                self.personal_costs[i] = cost;
                self.personal[row.clone()].copy_from_slice(&self.positions[row.clone()]);
            }
            if cost < self.best_cost {
                self.best_cost = cost;
                self.best.copy_from_slice(&self.positions[row]);
            }
        }
        self.bettered = bettered as f64 / costs.len() as f64;
        self.history.push(self.best_cost);
        if !self.done() {
            self.advance();
        }
        Ok(())
    }

    /// Best point so far and its cost. While no cost was below infinity: particle 0's first position and infinity.
    pub fn best(&self) -> (&[f64], f64) {
        (&self.best, self.best_cost)
    }

    /// Number of generations whose costs were told, which is also the index of the present positions until
    /// [`Swarm::done`].
    pub fn generation(&self) -> usize {
        self.history.len()
    }

    /// Best cost after each generation: `iterations + 1` entries after a full run, never rising.
    pub fn history(&self) -> &[f64] {
        &self.history
    }

    /// True once all iterations are made and their last generation was evaluated.
    pub fn done(&self) -> bool {
        self.history.len() > self.settings.iterations
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::monitor::Silent;

    fn sphere(x: &[f64]) -> f64 {
        x.iter().map(|v| v * v).sum()
    }

    #[test]
    fn one_move_is_equation_5() {
        let settings = SwarmSettings { particles: 2, velocity_limit: 1.0, ..SwarmSettings::default() };
        let mut swarm = Swarm::new(&settings, &[(-1e3, 1e3)], 7).unwrap();
        swarm.velocities = vec![1.0, -2.0];
        swarm.with_start(&[10.0]).unwrap();
        let x = swarm.positions().to_vec();
        swarm.tell(&[3.0, 4.0]).unwrap();
        // Both sit on their own best point; only particle 1 is pulled, towards particle 0.
        let (_, r2) = uniform_pair(7, 1, 1, 0);
        assert_eq!(swarm.velocities[0], 0.8);
        assert_eq!(swarm.velocities[1], 0.8 * -2.0 + 2.0 * r2 * (x[0] - x[1]));
        assert_eq!(swarm.positions()[1], x[1] + swarm.velocities[1]);
        let x = swarm.positions().to_vec();
        let v = swarm.velocities.clone();
        swarm.tell(&[5.0, 6.0]).unwrap();
        let (r1, _) = uniform_pair(7, 2, 0, 0);
        let (_, r2) = uniform_pair(7, 2, 0, 0);
        assert_eq!(swarm.velocities[0], 0.8 * v[0] + 2.0 * r1 * (10.0 - x[0]) + 2.0 * r2 * (10.0 - x[0]));
    }

    #[test]
    fn a_warm_start_is_never_lost_and_is_clamped() {
        let settings = SwarmSettings::default();
        let run = |p: &[f64]| minimise(&settings, &[(-5.0, 5.0); 2], 3, Some(p), &sphere, &Silent).unwrap();
        assert_eq!(run(&[0.0, 0.0]).cost, 0.0);
        let mut swarm = Swarm::new(&settings, &[(-5.0, 5.0); 2], 3).unwrap();
        swarm.with_start(&[9.0, 1.0]).unwrap();
        assert_eq!(&swarm.positions()[..2], &[5.0, 1.0]);
        assert!(swarm.with_start(&[1.0]).is_err() && swarm.with_start(&[f64::NAN, 0.0]).is_err());
        swarm.tell(&[1.0; 10]).unwrap();
        assert!(swarm.with_start(&[1.0, 1.0]).is_err());
    }

    #[test]
    fn abandoned_evaluations_do_not_change_the_path() {
        let mut whole = Swarm::new(&SwarmSettings::default(), &[(-5.0, 5.0); 3], 9).unwrap();
        let mut cut = whole.clone();
        while !whole.done() {
            let costs: Vec<f64> = whole.positions().chunks(3).map(sphere).collect();
            whole.tell(&costs).unwrap();
            let short: Vec<f64> = costs
                .iter()
                .zip(cut.personal_costs())
                .map(|(&c, &own)| if c > own { f64::INFINITY } else { c })
                .collect();
            cut.tell(&short).unwrap();
            assert_eq!(whole.positions(), cut.positions());
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        let ok = SwarmSettings::default();
        for bounds in [vec![], vec![(1.0, 0.0)], vec![(0.0, f64::INFINITY)], vec![(f64::NAN, 1.0)]] {
            assert!(Swarm::new(&ok, &bounds, 1).is_err(), "{bounds:?}");
        }
        let mut swarm = Swarm::new(&SwarmSettings { iterations: 1, ..ok }, &[(0.0, 1.0)], 1).unwrap();
        assert!(swarm.tell(&[0.0; 9]).is_err());
        swarm.tell(&[0.0; 10]).unwrap();
        swarm.tell(&[0.0; 10]).unwrap();
        assert!(swarm.done() && swarm.tell(&[0.0; 10]).is_err());
    }

    proptest! {
        #[test]
        fn positions_and_velocities_stay_within_their_limits(
            seed: u64,
            box_ in proptest::collection::vec((-1e6..1e6f64, 0.0..1e6f64), 1..5),
            limit in 0.01..1.0f64,
            inertia in 0.0..3.0f64,
            pull in 0.0..5.0f64,
            costs in proptest::collection::vec(proptest::num::f64::ANY, 7 * 6),
        ) {
            let bounds: Vec<(f64, f64)> = box_.iter().map(|&(low, width)| (low, low + width)).collect();
            let settings = SwarmSettings {
                particles: 7, iterations: 5, inertia, cognitive: pull, social: pull, velocity_limit: limit,
                ..SwarmSettings::default()
            };
            let mut swarm = Swarm::new(&settings, &bounds, seed).unwrap();
            for told in costs.chunks(7) {
                for at in 0..swarm.positions.len() {
                    let (low, high) = bounds[at % bounds.len()];
                    prop_assert!((low..=high).contains(&swarm.positions[at]));
                    prop_assert!(swarm.velocities[at].abs() <= limit * (high - low));
                }
                swarm.tell(told).unwrap();
            }
            prop_assert!(swarm.done());
            prop_assert!(!swarm.best().1.is_nan());
        }
    }
}
