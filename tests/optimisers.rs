//! The optimisers on problems whose answers are known.

#[path = "optimisers/coverage.rs"]
mod coverage;
#[path = "optimisers/descent.rs"]
mod descent;
#[path = "optimisers/nist.rs"]
mod nist;
#[path = "optimisers/particles.rs"]
mod particles;

use nalgebra::{DMatrix, DVector};
use pmsm_core::monitor::Silent;
use pmsm_core::optimise::least_squares::{self, Fit, Normal, Problem, Settings};
use pmsm_core::optimise::swarm::{Inertia, Neighbourhood, SwarmSettings, Update};

/// Bounds of a parameter without any.
const FREE: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

/// Constriction coefficients of Clerc & Kennedy 2002, with which a swarm contracts.
const CONTRACTING: SwarmSettings = SwarmSettings {
    particles: 40,
    iterations: 500,
    inertia: 0.7298,
    cognitive: 1.49618,
    social: 1.49618,
    velocity_limit: 0.5,
    schedule: Inertia::Constant,
    update: Update::Inertia,
    neighbourhood: Neighbourhood::All,
};

/// A residual and its gradient: one row of r and J.
type Row = (f64, Vec<f64>);

/// Sum of squares, J'J and J'r of rows.
fn normal(dim: usize, rows: impl Iterator<Item = Row>) -> Normal {
    let mut sum = Normal { cost: 0.0, jtj: DMatrix::zeros(dim, dim), jtr: DVector::zeros(dim) };
    for (r, gradient) in rows {
        let gradient = DVector::from_vec(gradient);
        sum.cost += r * r;
        sum.jtj.ger(1.0, &gradient, &gradient, 1.0);
        sum.jtr.axpy(r, &gradient, 1.0);
    }
    sum
}

fn fit(problem: &dyn Problem, start: &[f64], bounds: &[(f64, f64)]) -> Fit {
    least_squares::minimise(problem, start, bounds, &Settings::default(), &Silent).unwrap()
}
