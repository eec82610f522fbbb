//! Covariance of a fit, and how often its confidence intervals cover the truth.

use crate::{FREE, fit, normal};
use nalgebra::{DMatrix, DVector};
use pmsm_core::optimise::least_squares::{Normal, Problem, covariance};
use std::f64::consts::TAU;

/// Standard normal numbers from a 64-bit linear congruential generator (Knuth's MMIX) by the Box–Muller transform.
struct Gauss(u64);

impl Gauss {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) * 0.5 * f64::EPSILON
    }
    fn next(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (TAU * self.uniform()).cos()
    }
}

/// y = p₀ + p₁ x
struct Line {
    x: Vec<f64>,
    y: Vec<f64>,
}

impl Line {
    fn residuals(&self, p: &[f64]) -> Vec<f64> {
        self.x.iter().zip(&self.y).map(|(x, y)| p[0] + p[1] * x - y).collect()
    }
}

impl Problem for Line {
    fn dim(&self) -> usize {
        2
    }
    fn cost(&self, p: &[f64]) -> f64 {
        self.residuals(p).iter().map(|r| r * r).sum()
    }
    fn normal(&self, p: &[f64]) -> Normal {
        normal(2, self.residuals(p).into_iter().zip(&self.x).map(|(r, &x)| (r, vec![1.0, x])))
    }
}

#[test]
fn covariance_of_a_straight_line_is_the_textbooks() {
    let x: Vec<f64> = (0..40).map(|k| 100.0 + 0.01 * f64::from(k)).collect();
    let problem = Line { y: x.iter().map(|x| 3.0 - 0.2 * x).collect(), x };
    let found = fit(&problem, &[0.0, 0.0], &[FREE; 2]);
    let c = covariance(&found.normal.jtj, None, &[true; 2]);
    let n = problem.x.len() as f64;
    let mean = problem.x.iter().sum::<f64>() / n;
    let spread: f64 = problem.x.iter().map(|x| (x - mean).powi(2)).sum();
    for (found, exact) in
        [(c[(1, 1)], 1.0 / spread), (c[(0, 0)], 1.0 / n + mean * mean / spread), (c[(0, 1)], -mean / spread)]
    {
        assert!((found / exact - 1.0).abs() < 1e-6, "{found} {exact}");
    }
}

/// Long-run covariance of the scores x·r, Bartlett weights up to `lag` (Newey & West 1987).
fn long_run(problem: &Line, p: &[f64], lag: usize) -> DMatrix<f64> {
    let residuals = problem.residuals(p);
    let score = |k: usize| DVector::from_row_slice(&[residuals[k], residuals[k] * problem.x[k]]);
    let mut meat = DMatrix::zeros(2, 2);
    for k in 0..residuals.len() {
        for l in k.saturating_sub(lag)..(k + lag + 1).min(residuals.len()) {
            let weight = 1.0 - k.abs_diff(l) as f64 / (lag + 1) as f64;
            meat.ger(weight, &score(k), &score(l), 1.0);
        }
    }
    meat
}

/// Noise and regressor both AR(1) with 0.8: the plain interval is far too narrow, the sandwich's is nearly right.
#[test]
fn the_sandwich_covers_under_autocorrelated_noise() {
    let (runs, n, rho) = (300, 800, 0.8f64);
    let innovation = (1.0 - rho * rho).sqrt();
    let mut gauss = Gauss(1);
    let (mut plain, mut sandwich) = (0, 0);
    for _ in 0..runs {
        let (mut x, mut noise) = (gauss.next(), gauss.next());
        let mut problem = Line { x: Vec::new(), y: Vec::new() };
        for _ in 0..n {
            x = rho * x + innovation * gauss.next();
            noise = rho * noise + innovation * gauss.next();
            problem.x.push(x);
            problem.y.push(1.0 + 2.0 * x + noise);
        }
        let found = fit(&problem, &[0.0, 0.0], &[FREE; 2]);
        let variance = found.cost / (n - 2) as f64;
        let meat = long_run(&problem, &found.parameters, 30);
        let covers = |c: &DMatrix<f64>, factor: f64| {
            (found.parameters[1] - 2.0).abs() < 1.96 * (factor * c[(1, 1)]).sqrt()
        };
        plain += usize::from(covers(&covariance(&found.normal.jtj, None, &[true; 2]), variance));
        sandwich += usize::from(covers(&covariance(&found.normal.jtj, Some(&meat), &[true; 2]), 1.0));
    }
    let (plain, sandwich) = (plain as f64 / f64::from(runs), sandwich as f64 / f64::from(runs));
    assert!(plain < 0.75, "plain interval covers {plain}");
    assert!((0.89..0.98).contains(&sandwich), "sandwich covers {sandwich}");
}
