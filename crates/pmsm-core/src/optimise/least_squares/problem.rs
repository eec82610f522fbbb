//! A sum of squares to be minimised, by its normal equations.

use crate::error::{Error, Result};
use nalgebra::{DMatrix, DVector};

/// Normal equations at one point.
#[derive(Debug, Clone, PartialEq)]
pub struct Normal {
    /// Sum of squared weighted residuals, rᵀr.
    pub cost: f64,
    /// JᵀJ, dim × dim.
    pub jtj: DMatrix<f64>,
    /// Jᵀr, half the gradient of the cost, with r = model − data.
    pub jtr: DVector<f64>,
}

impl Normal {
    pub(super) fn is_finite(&self) -> bool {
        self.cost.is_finite() && self.jtj.iter().chain(self.jtr.iter()).all(|x| x.is_finite())
    }
}

/// A sum of squares to be minimised.
pub trait Problem: Sync {
    /// Number of parameters.
    fn dim(&self) -> usize;
    /// Number of residuals that count, where it is known.
    fn residuals(&self) -> Option<usize> {
        None
    }
    /// Sum of squared weighted residuals at `p`. Not finite where the model cannot be evaluated.
    fn cost(&self, p: &[f64]) -> f64;
    /// Cost and normal equations at `p`.
    fn normal(&self, p: &[f64]) -> Normal;
    /// Cost at a trial point, with the normal equations if they are worth having at once. The first trial of a search is
    /// the one that is mostly accepted.
    fn trial(&self, p: &[f64], _first: bool) -> (f64, Option<Normal>) {
        (self.cost(p), None)
    }
}

/// Normal equations at `p`, checked.
pub(super) fn evaluate(problem: &dyn Problem, p: &[f64]) -> Result<Normal> {
    checked(problem.normal(p), p.len())
}

/// These normal equations if they are those of so many parameters.
pub(super) fn checked(normal: Normal, dim: usize) -> Result<Normal> {
    if normal.jtj.shape() != (dim, dim) || normal.jtr.len() != dim {
        return Err(Error::unusable(
            format!("normal equations of shape {:?} for {dim} parameters", normal.jtj.shape()),
            "the problem must deliver a square matrix and a vector of its dimension",
        ));
    }
    Ok(normal)
}
