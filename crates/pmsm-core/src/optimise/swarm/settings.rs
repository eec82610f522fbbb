//! Settings of the swarm, and which of them make sense.

use super::{Inertia, Neighbourhood, Update};
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Largest accepted number of particles and of iterations: memory is reserved for them in advance.
const MAX_COUNT: usize = 1_000_000;
/// The same where every particle keeps a list of all others.
const MOST_INFORMED: usize = 3000;

/// Settings of the swarm. The default is the paper's: 10 particles, 30 iterations, w = 0.8, c₁ = c₂ = 2; the paper
/// leaves the velocity limit open, here it is 0.2 of each range.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SwarmSettings {
    /// Number of particles, at least 1.
    pub particles: usize,
    /// Number of moves, at least 1; a full run evaluates `iterations + 1` generations.
    pub iterations: usize,
    /// w: share of the velocity that is kept, ≥ 0.
    pub inertia: f64,
    /// c₁: pull towards the particle's own best point, ≥ 0.
    pub cognitive: f64,
    /// c₂: pull towards the swarm's best point, ≥ 0.
    pub social: f64,
    /// Largest move per generation and dimension as a share of that dimension's range, in (0, 1].
    pub velocity_limit: f64,
    /// How w goes over the iterations.
    pub schedule: Inertia,
    /// How a velocity is made.
    pub update: Update,
    /// Whom a particle listens to.
    pub neighbourhood: Neighbourhood,
}

impl Default for SwarmSettings {
    fn default() -> Self {
        Self {
            particles: 10,
            iterations: 30,
            inertia: 0.8,
            cognitive: 2.0,
            social: 2.0,
            velocity_limit: 0.2,
            schedule: Inertia::Constant,
            update: Update::Inertia,
            neighbourhood: Neighbourhood::All,
        }
    }
}

impl SwarmSettings {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Quantity`] naming the first setting that is out of range.
    pub fn validate(&self) -> Result<()> {
        for (name, count) in [("particles", self.particles), ("iterations", self.iterations)] {
            if !(1..=MAX_COUNT).contains(&count) {
                return Err(Error::quantity(name, count as f64, "", "it must be between 1 and 1000000"));
            }
        }
        let last = match self.schedule {
            Inertia::Constant => self.inertia,
            Inertia::Linear { last } | Inertia::Random { last } | Inertia::Adaptive { last } => last,
        };
        for (name, weight) in [
            ("inertia", self.inertia),
            ("last inertia", last),
            ("cognitive", self.cognitive),
            ("social", self.social),
        ] {
            if !(weight.is_finite() && weight >= 0.0) {
                return Err(Error::quantity(name, weight, "", "it must be finite and not negative"));
            }
        }
        if !(self.velocity_limit > 0.0 && self.velocity_limit <= 1.0) {
            let expected = "it must be above 0 and at most 1 (a share of each range)";
            return Err(Error::quantity("velocity_limit", self.velocity_limit, "", expected));
        }
        let phi = self.cognitive + self.social;
        if self.update != Update::Inertia && phi <= 4.0 {
            let expected = "a constricted swarm needs more than 4, such as 2.05 + 2.05";
            return Err(Error::quantity("cognitive + social", phi, "", expected));
        }
        let crowded = self.update == Update::FullyInformed && self.neighbourhood == Neighbourhood::All;
        if crowded && self.particles > MOST_INFORMED {
            let expected = "where each listens to all others it must be at most 3000; name a neighbourhood, ring or von_neumann";
            return Err(Error::quantity("particles", self.particles as f64, "", expected));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_makes_no_sense_is_refused() {
        let ok = SwarmSettings::default();
        let informed = SwarmSettings { update: Update::FullyInformed, cognitive: 2.05, social: 2.05, ..ok };
        for bad in [
            SwarmSettings { particles: 0, ..ok },
            SwarmSettings { iterations: 0, ..ok },
            SwarmSettings { particles: usize::MAX, ..ok },
            SwarmSettings { inertia: f64::NAN, ..ok },
            SwarmSettings { cognitive: -1.0, ..ok },
            SwarmSettings { social: f64::INFINITY, ..ok },
            SwarmSettings { velocity_limit: 0.0, ..ok },
            SwarmSettings { velocity_limit: 1.5, ..ok },
            SwarmSettings { particles: 100_000, ..informed },
        ] {
            assert!(matches!(bad.validate(), Err(Error::Quantity { .. })), "{bad:?}");
        }
        let ring = SwarmSettings { neighbourhood: Neighbourhood::Ring, particles: 100_000, ..informed };
        assert!(ring.validate().is_ok() && informed.validate().is_ok());
    }
}
