//! Particle swarms on test functions with known optima.

use crate::CONTRACTING;
use pmsm_core::monitor::Silent;
use pmsm_core::optimise::swarm::{self, Inertia, Neighbourhood, SwarmSettings, Update};
use std::f64::consts::TAU;

fn sphere(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum()
}

fn rosenbrock(x: &[f64]) -> f64 {
    x.windows(2).map(|w| 100.0 * (w[1] - w[0] * w[0]).powi(2) + (1.0 - w[0]).powi(2)).sum()
}

fn rastrigin(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v - 10.0 * (TAU * v).cos() + 10.0).sum()
}

fn ackley(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let waves: f64 = x.iter().map(|v| (TAU * v).cos()).sum();
    20.0 + 1f64.exp() - 20.0 * (-0.2 * (sphere(x) / n).sqrt()).exp() - (waves / n).exp()
}

fn griewank(x: &[f64]) -> f64 {
    let product: f64 = x.iter().enumerate().map(|(k, v)| (v / ((k + 1) as f64).sqrt()).cos()).product();
    1.0 + sphere(x) / 4000.0 - product
}

fn himmelblau(x: &[f64]) -> f64 {
    (x[0] * x[0] + x[1] - 11.0).powi(2) + (x[0] + x[1] * x[1] - 7.0).powi(2)
}

/// How many of 20 seeds end below `target` (every optimum here is 0).
fn successes(
    settings: &SwarmSettings,
    cost: fn(&[f64]) -> f64,
    dims: usize,
    reach: f64,
    target: f64,
) -> usize {
    // Unequal sides keep the optimum away from the middle of the box.
    let bounds = vec![(-reach, 0.8 * reach); dims];
    (1..=20)
        .filter(|&seed| {
            let run = swarm::minimise(settings, &bounds, seed, None, &cost, &Silent).unwrap();
            assert_eq!(run.cost, cost(&run.parameters));
            run.cost < target
        })
        .count()
}

#[test]
fn a_contracting_swarm_finds_known_optima() {
    for (name, cost, dims, reach, target, least) in [
        ("sphere", sphere as fn(&[f64]) -> f64, 5, 10.0, 1e-10, 20),
        ("rosenbrock", rosenbrock, 2, 5.0, 1e-8, 20),
        ("rastrigin", rastrigin, 2, 5.12, 1e-8, 18),
        ("ackley", ackley, 5, 32.0, 1e-8, 18),
        // Its many basins differ by less than 0.01.
        ("griewank", griewank, 2, 100.0, 1e-8, 10),
        ("himmelblau", himmelblau, 2, 6.0, 1e-10, 20),
    ] {
        let found = successes(&CONTRACTING, cost, dims, reach, target);
        assert!(found >= least, "{name}: {found} of 20");
    }
}

#[test]
fn every_variant_that_contracts_finds_the_floor_of_one_basin() {
    let paper = SwarmSettings { particles: 20, iterations: 200, ..SwarmSettings::default() };
    let falling = SwarmSettings { inertia: 0.9, schedule: Inertia::Linear { last: 0.4 }, ..paper };
    let constricted = SwarmSettings { update: Update::Constriction, cognitive: 2.05, social: 2.05, ..paper };
    let informed = SwarmSettings { update: Update::FullyInformed, ..constricted };
    let social = SwarmSettings { cognitive: 1.49, social: 1.49, inertia: 0.72, ..paper };
    for (name, settings) in [
        ("falling inertia", falling),
        ("random inertia", SwarmSettings { schedule: Inertia::Random { last: 0.5 }, ..social }),
        ("adaptive inertia", SwarmSettings { schedule: Inertia::Adaptive { last: 0.4 }, ..social }),
        ("constriction", constricted),
        ("constriction on a ring", SwarmSettings { neighbourhood: Neighbourhood::Ring, ..constricted }),
        ("constriction on a grid", SwarmSettings { neighbourhood: Neighbourhood::VonNeumann, ..constricted }),
        ("informed on a ring", SwarmSettings { neighbourhood: Neighbourhood::Ring, ..informed }),
        ("informed on a grid", SwarmSettings { neighbourhood: Neighbourhood::VonNeumann, ..informed }),
    ] {
        let found = successes(&settings, sphere, 3, 10.0, 1e-6);
        assert!(found >= 19, "{name}: {found} of 20");
    }
}

/// w = 0.8, c₁ = c₂ = 2 does not contract by itself: 10 particles and 30 iterations find the basin, not its floor.
#[test]
fn the_papers_swarm_finds_the_basin_of_two_parameters() {
    let paper = SwarmSettings::default();
    for (name, cost, reach, target) in
        [("sphere", sphere as fn(&[f64]) -> f64, 10.0, 0.2), ("himmelblau", himmelblau, 6.0, 2.0)]
    {
        let found = successes(&paper, cost, 2, reach, target);
        assert!(found >= 16, "{name}: {found} of 20");
    }
}

#[test]
fn the_swarm_gives_the_same_bits_on_any_number_of_threads() {
    let settings = SwarmSettings { particles: 37, iterations: 40, ..SwarmSettings::default() };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            swarm::minimise(&settings, &[(-5.0, 4.0); 6], 11, Some(&[1.0; 6]), &rastrigin, &Silent).unwrap()
        })
    };
    let one = run(1);
    for threads in [2, 4, 8] {
        let many = run(threads);
        let bits = |x: &[f64]| x.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&one.parameters), bits(&many.parameters), "{threads} threads");
        assert_eq!(bits(&one.history), bits(&many.history), "{threads} threads");
        assert_eq!(one, many);
    }
    let other = swarm::minimise(&settings, &[(-5.0, 4.0); 6], 12, None, &rastrigin, &Silent).unwrap();
    assert_ne!(one.parameters, other.parameters);
}
