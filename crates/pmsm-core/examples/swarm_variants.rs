//! Compares the particle swarm's variants with multi-start least squares on two problems, and prints the tables of
//! docs/swarm_variants.md:
//!
//! ```text
//! cargo run --release -p pmsm-core --example swarm_variants [SEEDS]
//! ```
//!
//! A run succeeds if its cost ends within 1 % of the lowest that any run found.

use pmsm_core::drive::{Manoeuvre, Schedule, Sensors, Setup, Shape, simulate};
use pmsm_core::error::Result;
use pmsm_core::kernels::objective::{Drive, Objective};
use pmsm_core::machine::Machine;
use pmsm_core::model::Model;
use pmsm_core::monitor::Silent;
use pmsm_core::numerics::random::uniform_pair;
use pmsm_core::optimise::least_squares::{self, Normal, Problem, Settings};
use pmsm_core::optimise::swarm::{Inertia, Neighbourhood, Swarm, SwarmSettings, Update};
use pmsm_core::signals::Signals;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A cost within this factor of the lowest is a success.
const NEAR: f64 = 1.01;

/// Which entries of the objective's point (r_s, l_d, l_q, psi_m, j, b, tau_load) are sought, and where.
struct Task {
    title: &'static str,
    settings: SwarmSettings,
    free: Vec<usize>,
    bounds: Vec<(f64, f64)>,
    start: Vec<f64>,
    setup: Setup,
}

/// One run: cost after each generation (or at the end) and how often the model was simulated until then.
struct Run {
    costs: Vec<f64>,
    evaluations: Vec<usize>,
}

impl Run {
    fn last(&self) -> f64 {
        *self.costs.last().expect("a run has an end")
    }

    /// Simulations until the cost was near the lowest, if it ever was.
    fn until(&self, lowest: f64) -> Option<usize> {
        let first = self.costs.iter().position(|c| *c <= NEAR * lowest)?;
        Some(self.evaluations[first])
    }
}

fn main() -> Result<()> {
    let seeds = std::env::args().nth(1).and_then(|x| x.parse().ok()).unwrap_or(100u64);
    for task in [window()?, whole()?] {
        compare(&task, seeds)?;
    }
    Ok(())
}

/// The paper's window: 3300 samples at 100 kHz of the motor of its Table 1, r_s and the load sought.
fn window() -> Result<Task> {
    let mut setup = Setup::new(Machine::liu_2008(), Manoeuvre::new(0.033));
    setup.drive.f_sample = Some(100e3);
    let swing = vec![(0.0, 60.0), (0.015, 80.0), (0.033, 70.0)];
    setup.manoeuvre.omega_m = Some(Schedule::new(swing, Shape::Linear)?);
    setup.manoeuvre.start_omega_m = 60.0;
    setup.manoeuvre.settle = 0.2;
    setup.manoeuvre.tau_load = Some(Schedule::constant(3.0)?);
    setup.drive.sensors = Sensors { noise_i: 0.05, noise_omega_e: 0.1, ..Sensors::default() };
    let start = truth(&setup, 3.0);
    Ok(Task {
        title: "The paper's window: r_s and tau_load from 3300 samples, 10 particles, 30 iterations",
        settings: SwarmSettings::default(),
        free: vec![0, 6],
        bounds: vec![(0.05, 0.5), (0.0, 10.0)],
        start,
        setup,
    })
}

/// All seven parameters from a run with steps of both currents.
fn whole() -> Result<Task> {
    let mut setup = Setup::new(Machine::liu_2008(), Manoeuvre::new(0.2));
    setup.drive.f_sample = Some(5e3);
    let speed = vec![(0.0, 0.0), (0.06, 60.0), (0.1, 60.0), (0.14, -30.0), (0.2, -30.0)];
    setup.manoeuvre.omega_m = Some(Schedule::new(speed, Shape::Linear)?);
    let field = vec![(0.0, 0.0), (0.04, -15.0), (0.09, 10.0), (0.15, -10.0)];
    setup.manoeuvre.i_d = Some(Schedule::new(field, Shape::Steps)?);
    setup.manoeuvre.tau_load = Some(Schedule::constant(3.0)?);
    setup.drive.sensors = Sensors { noise_i: 0.05, noise_omega_e: 0.1, ..Sensors::default() };
    let start = truth(&setup, 3.0);
    let mut bounds: Vec<(f64, f64)> = start[..5].iter().map(|x| (0.2 * x, 5.0 * x)).collect();
    bounds.extend([(0.0, 0.05), (-10.0, 10.0)]);
    Ok(Task {
        title: "Seven parameters from 1000 samples, 30 particles, 150 iterations",
        settings: SwarmSettings { particles: 30, iterations: 150, ..SwarmSettings::default() },
        free: (0..7).collect(),
        bounds,
        start,
        setup,
    })
}

fn truth(setup: &Setup, tau_load: f64) -> Vec<f64> {
    setup.machine.base.iter().map(|x| x.unwrap_or(0.0)).chain([tau_load]).collect()
}

fn variants(base: SwarmSettings) -> Vec<(&'static str, SwarmSettings)> {
    let clerc = SwarmSettings { update: Update::Constriction, cognitive: 2.05, social: 2.05, ..base };
    let informed = SwarmSettings { update: Update::FullyInformed, ..clerc };
    let contracting = SwarmSettings { inertia: 0.72, cognitive: 1.49, social: 1.49, ..base };
    let ring = |s| SwarmSettings { neighbourhood: Neighbourhood::Ring, ..s };
    let grid = |s| SwarmSettings { neighbourhood: Neighbourhood::VonNeumann, ..s };
    let with = |inertia, schedule| SwarmSettings { inertia, schedule, ..base };
    vec![
        ("the paper's: w = 0.8, c = 2", base),
        ("w = 0.72, c = 1.49", contracting),
        ("w from 0.9 to 0.4", with(0.9, Inertia::Linear { last: 0.4 })),
        (
            "w at random, 0.5 to 1, c = 1.49",
            SwarmSettings { inertia: 1.0, schedule: Inertia::Random { last: 0.5 }, ..contracting },
        ),
        (
            "w by success, 0 to 1, c = 1.49",
            SwarmSettings { inertia: 1.0, schedule: Inertia::Adaptive { last: 0.0 }, ..contracting },
        ),
        ("constriction", clerc),
        ("constriction, ring", ring(clerc)),
        ("constriction, von Neumann", grid(clerc)),
        ("fully informed, all", informed),
        ("fully informed, ring", ring(informed)),
        ("fully informed, von Neumann", grid(informed)),
    ]
}

fn compare(task: &Task, seeds: u64) -> Result<()> {
    let simulation = simulate(&task.setup, &Silent)?;
    let signals = Signals::new(&simulation.recording, &task.setup.nameplate)?;
    let model = Model::new(signals.context, &[]);
    let objective = Objective::new(Drive::Coupled, &model, &signals, &[]);
    let mut rows: Vec<(String, Vec<Run>)> = Vec::new();
    for (name, settings) in variants(task.settings) {
        let runs = (1..=seeds).into_par_iter().map(|seed| swarm(task, &objective, &settings, seed));
        rows.push((name.into(), runs.collect::<Result<_>>()?));
    }
    let lowest = lowest(&rows);
    let mut descents: Vec<(String, Vec<Run>)> = Vec::new();
    for starts in [1, 3, 10] {
        let runs = (1..=seeds).into_par_iter().map(|seed| descend(task, &objective, starts, seed));
        descents.push((format!("least squares, best of {starts}"), runs.collect::<Result<_>>()?));
    }
    // Least squares estimates the initial values, too, so its cost has a lowest value of its own.
    let own = self::lowest(&descents);
    println!("### {}\n", task.title);
    println!(
        "| method | success of {seeds} | simulations until then, median | final cost over lowest, median |"
    );
    println!("|---|---|---|---|");
    for (rows, lowest) in [(&rows, lowest), (&descents, own)] {
        for (name, runs) in rows {
            let until: Vec<f64> = runs.iter().filter_map(|r| r.until(lowest)).map(|n| n as f64).collect();
            let excess = median(runs.iter().map(|r| r.last() / lowest).collect());
            let when = if until.is_empty() { "–".into() } else { format!("{:.0}", median(until.clone())) };
            println!("| {name} | {} | {when} | {excess:.3} |", until.len());
        }
    }
    println!();
    Ok(())
}

fn lowest(rows: &[(String, Vec<Run>)]) -> f64 {
    rows.iter().flat_map(|(_, runs)| runs).map(Run::last).fold(f64::INFINITY, f64::min)
}

fn median(mut x: Vec<f64>) -> f64 {
    x.sort_by(f64::total_cmp);
    x[x.len() / 2]
}

/// The whole point with the sought entries at `values`.
fn point(task: &Task, values: &[f64]) -> Vec<f64> {
    let mut point = task.start.clone();
    for (index, value) in task.free.iter().zip(values) {
        point[*index] = *value;
    }
    point
}

fn swarm(task: &Task, objective: &Objective, settings: &SwarmSettings, seed: u64) -> Result<Run> {
    let mut swarm = Swarm::new(settings, &task.bounds, seed)?;
    let mut run = Run { costs: Vec::new(), evaluations: Vec::new() };
    while !swarm.done() {
        let points = swarm.positions().chunks(task.free.len());
        let costs: Vec<f64> = points
            .zip(swarm.personal_costs())
            .map(|(values, best)| objective.fitness(&point(task, values), *best))
            .collect();
        swarm.tell(&costs)?;
        run.costs.push(swarm.best().1);
        run.evaluations.push(swarm.generation() * settings.particles);
    }
    Ok(run)
}

/// Least squares from `starts` points drawn uniformly within the bounds; the best counts.
fn descend(task: &Task, objective: &Objective, starts: usize, seed: u64) -> Result<Run> {
    let problem = Sought { task, objective, count: AtomicUsize::new(0) };
    let mut best = f64::INFINITY;
    for start in 0..starts {
        let draw = |k: usize| uniform_pair(seed, [start as u32, k as u32, 0, 2]).0;
        let from: Vec<f64> =
            task.bounds.iter().enumerate().map(|(k, (low, high))| low + (high - low) * draw(k)).collect();
        let settings = Settings { cost_tolerance: 1e-9, ..Settings::default() };
        let fit = least_squares::minimise(&problem, &from, &task.bounds, &settings, &Silent)?;
        best = best.min(if fit.cost.is_finite() { fit.cost } else { f64::INFINITY });
    }
    Ok(Run { costs: vec![best], evaluations: vec![problem.count.into_inner()] })
}

/// The objective's residuals as a least-squares problem.
struct Sought<'a> {
    task: &'a Task,
    objective: &'a Objective<'a>,
    count: AtomicUsize,
}

impl Problem for Sought<'_> {
    fn dim(&self) -> usize {
        self.task.free.len()
    }

    fn cost(&self, values: &[f64]) -> f64 {
        // Initial values are estimated in one run and used in a second.
        self.count.fetch_add(2, Ordering::Relaxed);
        self.objective.residual(&point(self.task, values)).norm_squared()
    }

    fn normal(&self, values: &[f64]) -> Normal {
        // The second run carries derivatives, which cost about as much as one run per parameter.
        self.count.fetch_add(2 + self.dim(), Ordering::Relaxed);
        let linear = self.objective.linearise(&point(self.task, values), &self.task.free, None);
        Normal {
            cost: linear.residual.norm_squared(),
            jtj: linear.jacobian.tr_mul(&linear.jacobian),
            jtr: linear.jacobian.tr_mul(&linear.residual),
        }
    }
}
