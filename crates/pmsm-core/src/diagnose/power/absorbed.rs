//! Absorption: which fitted parameters take up the trace of an effect.

use crate::numerics::tall;
use nalgebra::{DMatrix, DVector, DVectorView};

/// Share of what the fitted parameters absorb from which one of them is said to do it.
const ABSORBS: f64 = 0.2;
/// Parameters named at most.
const NAMED: usize = 2;

/// What the fitted parameters do.
pub struct Fitted {
    /// Derivatives of the residual along an orthonormal basis, one column per parameter, in units of their lengths.
    along: DMatrix<f64>,
    /// (JᵀJ)⁻¹ in these units, unless the columns are not finite.
    inverse: Option<DMatrix<f64>>,
}

impl Fitted {
    /// From the derivatives J of the residual, which an orthonormal `basis` spans.
    pub fn new(jacobian: &DMatrix<f64>, basis: &DMatrix<f64>) -> Self {
        // A parameter that changes nothing absorbs nothing; its scale must only not be zero.
        let norm = |c: DVectorView<f64>| Some(c.norm()).filter(|x| *x > 1e-100).unwrap_or(1.0);
        let scale: Vec<f64> = jacobian.column_iter().map(norm).collect();
        let gram = tall::gram(jacobian);
        let unit = DMatrix::from_fn(gram.nrows(), gram.ncols(), |r, c| gram[(r, c)] / (scale[r] * scale[c]));
        // A decomposition of what is not finite never ends.
        let finite = unit.iter().all(|x| x.is_finite());
        let inverse = Some(unit).filter(|_| finite).and_then(|m| m.pseudo_inverse(1e-12).ok());
        let mut along = tall::tr_mul(basis, jacobian);
        along.column_iter_mut().zip(&scale).for_each(|(mut column, scale)| column /= *scale);
        Self { along, inverse }
    }

    /// Numbers of the fitted parameters without which much less would be absorbed of what lies so `along` the basis: for the
    /// least-squares coefficients x that is x_k²/(JᵀJ)⁻¹_kk.
    pub fn absorbing(&self, along: &DVector<f64>) -> Vec<usize> {
        let Some(inverse) = &self.inverse else { return Vec::new() };
        let absorbed = along.norm_squared();
        let x = inverse * self.along.tr_mul(along);
        let mut shares: Vec<(usize, f64)> = (0..x.len())
            .map(|k| (k, x[k] * x[k] / inverse[(k, k)].max(1e-300) / absorbed.max(1e-300)))
            .collect();
        shares.sort_by(|a, b| b.1.total_cmp(&a.1));
        shares.into_iter().take(NAMED).filter(|(_, s)| *s > ABSORBS).map(|(k, _)| k).collect()
    }
}
