//! Levenberg–Marquardt on test functions with known optima, free and along bounds.

use crate::{FREE, Row, fit, normal};
use pmsm_core::optimise::least_squares::{Normal, Problem, Status};

/// A test function as a sum of squares.
struct Residuals {
    dim: usize,
    rows: fn(&[f64]) -> Vec<Row>,
}

impl Problem for Residuals {
    fn dim(&self) -> usize {
        self.dim
    }
    fn cost(&self, p: &[f64]) -> f64 {
        (self.rows)(p).iter().map(|(r, _)| r * r).sum()
    }
    fn normal(&self, p: &[f64]) -> Normal {
        normal(self.dim, (self.rows)(p).into_iter())
    }
}

fn rosenbrock_rows(p: &[f64]) -> Vec<Row> {
    vec![(10.0 * (p[1] - p[0] * p[0]), vec![-20.0 * p[0], 10.0]), (1.0 - p[0], vec![-1.0, 0.0])]
}

fn beale_rows(p: &[f64]) -> Vec<Row> {
    [1.5, 2.25, 2.625]
        .iter()
        .zip(1..)
        .map(|(c, k)| {
            let slope = f64::from(k) * p[0] * p[1].powi(k - 1);
            (c - p[0] * (1.0 - p[1].powi(k)), vec![p[1].powi(k) - 1.0, slope])
        })
        .collect()
}

fn powell_rows(p: &[f64]) -> Vec<Row> {
    let (five, ten) = (5f64.sqrt(), 10f64.sqrt());
    let (a, b) = (p[1] - 2.0 * p[2], p[0] - p[3]);
    vec![
        (p[0] + 10.0 * p[1], vec![1.0, 10.0, 0.0, 0.0]),
        (five * (p[2] - p[3]), vec![0.0, 0.0, five, -five]),
        (a * a, vec![0.0, 2.0 * a, -4.0 * a, 0.0]),
        (ten * b * b, vec![2.0 * ten * b, 0.0, 0.0, -2.0 * ten * b]),
    ]
}

#[test]
fn least_squares_solves_rosenbrock_and_beale() {
    let problem = Residuals { dim: 2, rows: rosenbrock_rows };
    let found = fit(&problem, &[-1.2, 1.0], &[FREE; 2]);
    assert_eq!(found.status, Status::Converged);
    assert!(found.parameters.iter().all(|x| (x - 1.0).abs() < 1e-9), "{found:?}");
    let problem = Residuals { dim: 2, rows: beale_rows };
    let found = fit(&problem, &[1.0, 0.8], &[FREE; 2]);
    assert_eq!(found.status, Status::Converged);
    assert!(
        (found.parameters[0] - 3.0).abs() < 1e-8 && (found.parameters[1] - 0.5).abs() < 1e-8,
        "{found:?}"
    );
}

/// The Jacobian loses rank at the optimum 0, where convergence is only linear.
#[test]
fn least_squares_gets_down_to_the_optimum_of_powells_singular_function() {
    let problem = Residuals { dim: 4, rows: powell_rows };
    let found = fit(&problem, &[3.0, -1.0, 0.0, 1.0], &[FREE; 4]);
    assert!(found.cost < 1e-20 && found.parameters.iter().all(|x| x.abs() < 1e-5), "{found:?}");
}

#[test]
fn least_squares_follows_a_valley_along_its_bounds() {
    // On x ≤ 0.5 the minimum of Rosenbrock's function is (0.5, 0.25); on y ≤ −1 it is near (0, −1).
    let problem = Residuals { dim: 2, rows: rosenbrock_rows };
    let found = fit(&problem, &[-1.2, 1.0], &[(-2.0, 0.5), FREE]);
    assert_eq!((found.status, found.at_bound.clone()), (Status::Converged, vec![true, false]));
    assert!((found.parameters[1] - 0.25).abs() < 1e-8, "{found:?}");
    let found = fit(&problem, &[-1.2, -3.0], &[(-2.0, 2.0), (-5.0, -1.0)]);
    assert_eq!((found.status, found.at_bound.clone()), (Status::Converged, vec![false, true]));
    // There 400 x (x² + 1) = 2 (1 − x).
    let x = found.parameters[0];
    assert!((400.0 * x * (x * x + 1.0) - 2.0 * (1.0 - x)).abs() < 1e-4, "{found:?}");
}
