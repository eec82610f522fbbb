//! One move of the swarm: eq. (5) and its variants.

use super::variants::constriction;
use super::{Inertia, Swarm, SwarmSettings, Update};
use crate::numerics::random;
use rayon::prelude::*;

/// Particles of a part of the swarm that moves on one thread.
const PART: usize = 125;

impl Swarm {
    /// Eq. (5), or a variant of it, with both clamps.
    pub(super) fn advance(&mut self) {
        let (mut positions, mut velocities) =
            (std::mem::take(&mut self.positions), std::mem::take(&mut self.velocities));
        if self.settings.particles < 2 * PART || rayon::current_num_threads() == 1 {
            self.advance_part(0, &mut positions, &mut velocities);
        } else {
            // A particle's move depends on nothing that another one changes.
            let size = PART * self.bounds.len();
            let parts = positions.par_chunks_mut(size).zip(velocities.par_chunks_mut(size)).enumerate();
            parts.for_each(|(part, (positions, velocities))| {
                self.advance_part(part * PART, positions, velocities);
            });
        }
        (self.positions, self.velocities) = (positions, velocities);
    }

    /// Moves the particles from number `first` on.
    fn advance_part(&self, first: usize, positions: &mut [f64], velocities: &mut [f64]) {
        let SwarmSettings { cognitive, social, velocity_limit, update, .. } = self.settings;
        let (generation, dims) = (self.generation(), self.bounds.len());
        let keep = self.kept(generation);
        let chi = if update == Update::Inertia { 1.0 } else { constriction(cognitive + social) };
        let rows = positions.chunks_exact_mut(dims).zip(velocities.chunks_exact_mut(dims)).enumerate();
        for (row, (positions, velocities)) in rows {
            let i = first + row;
            let (there, known) = self.leader(i);
            let social = if known { social } else { 0.0 };
            let cognitive = if self.personal_costs[i] < f64::INFINITY { cognitive } else { 0.0 };
            let personal = &self.personal[i * dims..][..dims];
            for (k, &(low, high)) in self.bounds.iter().enumerate() {
                let x = positions[k];
                let limit = velocity_limit * (high - low);
                let v = if update == Update::FullyInformed {
                    chi * (velocities[k] + self.informed(i, k, x))
                } else {
                    let (r1, r2) = uniform_pair(self.seed, generation, i, k);
                    let v = keep * velocities[k]
                        + cognitive * r1 * (personal[k] - x)
                        + social * r2 * (there[k] - x);
                    if update == Update::Inertia { v } else { chi * v }
                };
                velocities[k] = v.clamp(-limit, limit);
                positions[k] = (x + velocities[k]).clamp(low, high);
            }
        }
    }

    /// Share of the velocity that this move keeps.
    fn kept(&self, generation: usize) -> f64 {
        let first = self.settings.inertia;
        if self.settings.update != Update::Inertia {
            return 1.0;
        }
        match self.settings.schedule {
            Inertia::Constant => first,
            Inertia::Linear { last } => {
                let moves = self.settings.iterations.saturating_sub(1).max(1);
                first + (last - first) * ((generation - 1) as f64 / moves as f64)
            }
            Inertia::Random { last } => {
                // A place that no particle has.
                let (r, _) = uniform_pair(self.seed, generation, self.settings.particles, 0);
                last + (first - last) * r
            }
            Inertia::Adaptive { last } => last + (first - last) * self.bettered,
        }
    }

    /// The best point that particle `i` hears of, and whether there is one yet.
    fn leader(&self, i: usize) -> (&[f64], bool) {
        if self.neighbours.is_empty() {
            return (&self.best, self.best_cost < f64::INFINITY);
        }
        let costs = &self.personal_costs;
        let best =
            self.neighbours[i].iter().fold(i, |best, n| if costs[*n] < costs[best] { *n } else { best });
        let dims = self.bounds.len();
        (&self.personal[best * dims..][..dims], costs[best] < f64::INFINITY)
    }

    /// Pull of all neighbours' own best points on dimension `k` of particle `i` at `x`; a particle without neighbours, or
    /// one none of whose neighbours has a point yet, listens to itself.
    fn informed(&self, i: usize, k: usize, x: f64) -> f64 {
        let phi = self.settings.cognitive + self.settings.social;
        let dims = self.bounds.len();
        let known = |n: &usize| self.personal_costs[*n] < f64::INFINITY;
        let own = [i];
        let heard = if self.neighbours[i].iter().any(known) { &self.neighbours[i][..] } else { &own[..] };
        let count = heard.iter().filter(|n| known(n)).count().max(1);
        let place = [self.generation() as u32, i as u32, k as u32];
        let mut pull = 0.0;
        for (slot, &n) in heard.iter().enumerate().filter(|(_, n)| known(n)) {
            // Pairs of numbers beside the one of the place itself.
            let pair = random::uniform_pair(self.seed, [place[0], place[1], place[2], 1 + (slot / 2) as u32]);
            let r = if slot % 2 == 0 { pair.0 } else { pair.1 };
            pull += r * (self.personal[n * dims + k] - x);
        }
        pull * phi / count as f64
    }
}

/// The two random numbers of this place in the run.
pub(super) fn uniform_pair(seed: u64, generation: usize, particle: usize, dimension: usize) -> (f64, f64) {
    random::uniform_pair(seed, [generation as u32, particle as u32, dimension as u32, 0])
}

#[cfg(test)]
mod tests {
    use super::super::Neighbourhood;
    use super::*;

    fn swarm(settings: SwarmSettings) -> Swarm {
        let settings = SwarmSettings { velocity_limit: 1.0, ..settings };
        let mut swarm = Swarm::new(&settings, &[(-1e3, 1e3)], 7).unwrap();
        swarm.velocities.fill(2.0);
        swarm
    }

    /// Velocities after one move from these costs, and the positions before it.
    fn moved(settings: SwarmSettings, costs: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut swarm = swarm(settings);
        let before = swarm.positions().to_vec();
        swarm.tell(costs).unwrap();
        (swarm.velocities, before)
    }

    const FOUR: [f64; 4] = [4.0, 1.0, 2.0, 3.0];

    fn four() -> SwarmSettings {
        SwarmSettings { particles: 4, ..SwarmSettings::default() }
    }

    #[test]
    fn on_a_ring_a_particle_follows_the_better_neighbour() {
        let (v, x) = moved(SwarmSettings { neighbourhood: Neighbourhood::Ring, ..four() }, &FOUR);
        // Around the ring 0 1 2 3: 0 hears 1 and 3, 1 is itself the best, 2 hears 1 and 3, 3 hears 0 and 2.
        for (i, best) in [(0, 1), (1, 1), (2, 1), (3, 2)] {
            let (_, r2) = uniform_pair(7, 1, i, 0);
            assert_eq!(v[i], 0.8 * 2.0 + 2.0 * r2 * (x[best] - x[i]), "{i}");
        }
    }

    #[test]
    fn constriction_shortens_the_whole_velocity() {
        let settings =
            SwarmSettings { update: Update::Constriction, cognitive: 2.05, social: 2.05, ..four() };
        let (v, x) = moved(settings, &FOUR);
        let (_, r2) = uniform_pair(7, 1, 3, 0);
        assert_eq!(v[3], constriction(4.1) * (2.0 + 2.05 * r2 * (x[1] - x[3])));
        assert!(SwarmSettings { cognitive: 2.0, social: 2.0, ..settings }.validate().is_err());
    }

    #[test]
    fn a_fully_informed_particle_hears_every_neighbour_but_itself() {
        let settings = SwarmSettings {
            update: Update::FullyInformed,
            neighbourhood: Neighbourhood::Ring,
            cognitive: 2.05,
            social: 2.05,
            ..four()
        };
        let (v, x) = moved(settings, &FOUR);
        let (r1, r2) = random::uniform_pair(7, [1, 0, 0, 1]);
        let pull = r1 * (x[1] - x[0]) + r2 * (x[3] - x[0]);
        let expected = |pull: f64| (constriction(4.1) * (2.0 + 4.1 * pull)).clamp(-2e3, 2e3);
        assert!((v[0] - expected(0.5 * pull)).abs() < 1e-9);
        // The one neighbour that could be evaluated counts whole; without any, the particle's own point.
        let (v, x) = moved(settings, &[f64::NAN, 1.0, f64::NAN, f64::NAN]);
        let (r1, _) = random::uniform_pair(7, [1, 0, 0, 1]);
        assert!((v[0] - expected(r1 * (x[1] - x[0]))).abs() < 1e-9);
        assert!((v[3] - constriction(4.1) * 2.0).abs() < 1e-12);
        let alone = SwarmSettings { particles: 1, ..settings };
        assert!(moved(alone, &[1.0]).0[0].is_finite());
    }

    #[test]
    fn inertia_follows_its_schedule() {
        let kept = |schedule: Inertia, generation: usize, bettered: f64| {
            let settings = SwarmSettings { schedule, inertia: 0.9, iterations: 11, ..four() };
            let mut swarm = swarm(settings);
            swarm.bettered = bettered;
            swarm.kept(generation)
        };
        let linear = Inertia::Linear { last: 0.4 };
        assert_eq!((kept(linear, 1, 1.0), kept(linear, 6, 1.0)), (0.9, 0.65));
        assert!((kept(linear, 11, 1.0) - 0.4).abs() < 1e-15);
        let adaptive = Inertia::Adaptive { last: 0.4 };
        assert!((kept(adaptive, 3, 0.0) - 0.4).abs() < 1e-15 && (kept(adaptive, 3, 1.0) - 0.9).abs() < 1e-15);
        let random: Vec<f64> = (1..50).map(|g| kept(Inertia::Random { last: 0.4 }, g, 0.0)).collect();
        assert!(random.iter().all(|w| (0.4..0.9).contains(w)));
        assert!((random.iter().sum::<f64>() / 49.0 - 0.65).abs() < 0.06);
        assert_eq!(kept(Inertia::Constant, 5, 0.3), 0.9);
        assert!(SwarmSettings { schedule: Inertia::Linear { last: -0.1 }, ..four() }.validate().is_err());
    }

    #[test]
    fn settings_are_written_by_name() {
        let text = r#"{"particles":20,"schedule":{"linear":{"last":0.4}},"neighbourhood":"von_neumann"}"#;
        let settings: SwarmSettings = serde_json::from_str(text).unwrap();
        assert_eq!(settings.schedule, Inertia::Linear { last: 0.4 });
        assert_eq!((settings.particles, settings.neighbourhood), (20, Neighbourhood::VonNeumann));
        assert_eq!((settings.inertia, settings.update), (0.8, Update::Inertia));
        assert!(serde_json::from_str::<SwarmSettings>(r#"{"particle":20}"#).is_err());
    }
}
