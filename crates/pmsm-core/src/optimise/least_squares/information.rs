//! What the normal equations at a minimum say of the parameters: how well each is known, and which are not.

use crate::error::{Error, Result};
use nalgebra::{DMatrix, SymmetricEigen};

/// Relative eigenvalue of the information matrix with unit diagonal below which a direction is lost in the rounding
/// of the normal equations (columns dependent to about 1e-6).
const UNDETERMINED: f64 = 1e-12;

/// Covariance of the free parameters, dim × dim in the parameters' units squared.
///
/// With H = JᵀJ weighted by 1/σ it is H⁻¹ (multiply by the residual variance if the weights are not 1/σ); with `meat`
/// M, the covariance of Jᵀr (which autocorrelated residuals make differ from H), it is the sandwich H⁻¹ M H⁻¹. H is
/// inverted with unit diagonal, D⁻¹ (D⁻¹ H D⁻¹)⁺ D⁻¹ with D² = diag H, through its eigenvalues; those below 1e-12 of
/// the largest belong to directions that the data do not show. A parameter that takes part in such a direction has
/// an infinite variance and zero covariances. A parameter that is not free has zeros throughout. If `jtj` or `meat`
/// is not finite, nothing is known: every free variance is infinite.
///
/// # Panics
/// If the dimensions of the arguments differ.
pub fn covariance(jtj: &DMatrix<f64>, meat: Option<&DMatrix<f64>>, free: &[bool]) -> DMatrix<f64> {
    let dim = free.len();
    assert_eq!(jtj.shape(), (dim, dim), "one free flag per row and column of jtj");
    let mut result = DMatrix::zeros(dim, dim);
    let index: Vec<usize> = (0..dim).filter(|&k| free[k]).collect();
    let known = jtj.iter().chain(meat.into_iter().flat_map(|m| m.iter())).all(|x| x.is_finite());
    let scale: Vec<f64> = index.iter().map(|&k| jtj[(k, k)].max(0.0).sqrt()).collect();
    let shown: Vec<usize> = (0..index.len()).filter(|&i| known && scale[i] > 0.0).collect();
    let n = shown.len();
    for &k in &index {
        result[(k, k)] = f64::INFINITY;
    }
    if n == 0 {
        return result;
    }
    let at = |i: usize| index[shown[i]];
    let unit = DMatrix::from_fn(n, n, |i, j| jtj[(at(i), at(j))] / (scale[shown[i]] * scale[shown[j]]));
    let eigen = SymmetricEigen::new(unit);
    let floor = UNDETERMINED * eigen.eigenvalues.max();
    let mut inverse = DMatrix::zeros(n, n);
    let mut lost = vec![false; n];
    for (&value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if value > floor {
            inverse.ger(1.0 / value, &vector, &vector, 1.0);
        } else {
            for i in 0..n {
                // A smaller share would add less than 1/H_ii to the variance if the eigenvalue were at the floor.
                lost[i] |= vector[i].abs() > UNDETERMINED.sqrt();
            }
        }
    }
    if let Some(meat) = meat {
        assert_eq!(meat.shape(), (dim, dim), "meat has the shape of jtj");
        let scaled =
            DMatrix::from_fn(n, n, |i, j| meat[(at(i), at(j))] / (scale[shown[i]] * scale[shown[j]]));
        inverse = &inverse * scaled * &inverse;
    }
    for i in (0..n).filter(|&i| !lost[i]) {
        for j in (0..n).filter(|&j| !lost[j]) {
            result[(at(i), at(j))] = inverse[(i, j)] / (scale[shown[i]] * scale[shown[j]]);
        }
    }
    result
}

/// Inverse of an information matrix, dim × dim, after scaling to unit diagonal, by eigenvalues none of which counts as less than 1e-12.
/// What the data do not show is thereby said to be known very badly, and nothing is infinite.
pub fn scaled_inverse(jtj: &DMatrix<f64>) -> DMatrix<f64> {
    let n = jtj.nrows();
    if n == 0 {
        return jtj.clone();
    }
    let size = |x: f64| if x > 0.0 { x.sqrt() } else { 1.0 };
    let scale: Vec<f64> = (0..n).map(|k| size(jtj[(k, k)])).collect();
    let scaled = DMatrix::from_fn(n, n, |r, c| jtj[(r, c)] / (scale[r] * scale[c]));
    let eigen = scaled.symmetric_eigen();
    let inverse = eigen.eigenvalues.map(|x| 1.0 / x.max(UNDETERMINED));
    let full = &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose();
    DMatrix::from_fn(n, n, |r, c| full[(r, c)] / (scale[r] * scale[c]))
}

/// A combination of parameters that the data do not determine.
#[derive(Debug, Clone, PartialEq)]
pub struct WeakDirection {
    /// Parameters that make up the combination, the largest share first.
    pub parameters: Vec<usize>,
    /// Their shares in units of `scale`, in the same order; signs are relative to each other.
    pub weights: Vec<f64>,
    /// √(λ_max/λ): how many times less sharply than the best-determined combination this one is seen; infinite if
    /// not at all.
    pub condition: f64,
}

/// Combinations of parameters that are not determined: eigenvectors of S·JᵀJ·S, S = diag(`scale`), whose eigenvalue is
/// below `threshold` times the largest, the weakest first.
///
/// `scale` says how large a change of each parameter matters, in its unit: its typical size for "known in percent", or
/// 1/√(JᵀJ)ᵢᵢ to look for parameters that replace one another. A parameter with scale 0 is left out. A
/// parameter belongs to a combination if its share is at least a quarter of the largest one's.
///
/// # Errors
/// [`Error::Unusable`] if dimensions differ, or a value is not finite, or a scale or the threshold is negative.
pub fn weak_directions(jtj: &DMatrix<f64>, scale: &[f64], threshold: f64) -> Result<Vec<WeakDirection>> {
    let proper = |x: &f64| x.is_finite() && *x >= 0.0;
    if jtj.shape() != (scale.len(), scale.len())
        || !jtj.iter().all(|x| x.is_finite())
        || !scale.iter().all(proper)
        || !proper(&threshold)
    {
        return Err(Error::unusable(
            format!("weak directions of a matrix {:?} with scale {scale:?}", jtj.shape()),
            "matrix, scale and threshold must be finite and fit together, the latter two not negative",
        ));
    }
    let index: Vec<usize> = (0..scale.len()).filter(|&k| scale[k] > 0.0).collect();
    if index.is_empty() {
        return Ok(Vec::new());
    }
    let scaled = DMatrix::from_fn(index.len(), index.len(), |i, j| {
        jtj[(index[i], index[j])] * scale[index[i]] * scale[index[j]]
    });
    let eigen = SymmetricEigen::new(scaled);
    let largest = eigen.eigenvalues.max().max(0.0);
    // What rounding leaves of an eigenvalue that is zero.
    let noise = index.len() as f64 * f64::EPSILON * largest;
    let mut weak = Vec::new();
    for (&value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if value > noise && value >= threshold * largest {
            continue;
        }
        let mut order: Vec<usize> =
            (0..index.len()).filter(|&i| vector[i].abs() >= 0.25 * vector.amax()).collect();
        order.sort_by(|&i, &j| vector[j].abs().total_cmp(&vector[i].abs()));
        weak.push(WeakDirection {
            parameters: order.iter().map(|&i| index[i]).collect(),
            weights: order.iter().map(|&i| vector[i]).collect(),
            condition: if value > noise { (largest / value).sqrt() } else { f64::INFINITY },
        });
    }
    weak.sort_by(|a, b| b.condition.total_cmp(&a.condition));
    Ok(weak)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DVector;

    #[test]
    fn covariance_is_the_inverse_information() {
        let h = DMatrix::from_row_slice(2, 2, &[4e8, 1e3, 1e3, 9e-2]);
        let exact = h.clone().try_inverse().unwrap();
        let found = covariance(&h, None, &[true, true]);
        assert!((&found - &exact).component_div(&exact).amax() < 1e-9, "{found} {exact}");
        let meat = DMatrix::from_row_slice(2, 2, &[8e8, 5e2, 5e2, 7e-1]);
        let sandwich = covariance(&h, Some(&meat), &[true, true]);
        let exact = &exact * meat * &exact;
        assert!((&sandwich - &exact).component_div(&exact).amax() < 1e-9);
        let held = covariance(&h, None, &[false, true]);
        assert_eq!((held[(0, 0)], held[(0, 1)]), (0.0, 0.0));
        assert!((held[(1, 1)] * 9e-2 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn what_the_data_cannot_show_has_infinite_variance() {
        // Parameters 0 and 1 act only through their sum, 3 not at all.
        let h = DMatrix::from_fn(4, 4, |i, j| match (i, j) {
            (0 | 1, 0 | 1) => 5.0,
            (2, 2) => 2.0,
            (2, 0 | 1) | (0 | 1, 2) => 0.5,
            _ => 0.0,
        });
        let c = covariance(&h, None, &[true; 4]);
        assert_eq!([c[(0, 0)], c[(1, 1)], c[(3, 3)]], [f64::INFINITY; 3]);
        assert_eq!((c[(0, 1)], c[(0, 2)]), (0.0, 0.0));
        assert!((c[(2, 2)] - 1.0 / (2.0 - 0.25 / 5.0)).abs() < 1e-9, "{c}");
        assert!((covariance(&h, None, &[true, false, true, true])[(0, 0)]).is_finite());
        let unknown = covariance(&DMatrix::from_element(1, 1, f64::NAN), None, &[true]);
        assert_eq!(unknown[(0, 0)], f64::INFINITY);
    }

    #[test]
    fn what_the_data_do_not_show_leaves_the_inverse_finite() {
        let h = DMatrix::from_row_slice(3, 3, &[4e8, 0.0, 1e3, 0.0, 0.0, 0.0, 1e3, 0.0, 9e-2]);
        let inverse = scaled_inverse(&h);
        let exact = DMatrix::from_row_slice(2, 2, &[4e8, 1e3, 1e3, 9e-2]).try_inverse().unwrap();
        for (r, c) in [(0, 0), (0, 1), (1, 1)] {
            let found = inverse[(2 * r, 2 * c)];
            assert!((found / exact[(r, c)] - 1.0).abs() < 1e-9, "{inverse}");
        }
        assert!(inverse[(1, 1)] > 1e11 && inverse.iter().all(|x| x.is_finite()), "{inverse}");
        assert_eq!(scaled_inverse(&DMatrix::zeros(0, 0)).len(), 0);
    }

    #[test]
    fn weak_directions_name_the_combination() {
        let a = DMatrix::from_fn(20, 3, |i, j| match j {
            0 => 1.0 + 1e-5 * (i as f64).sin(),
            1 => 1.0,
            _ => i as f64,
        });
        let h = a.tr_mul(&a);
        let weak = weak_directions(&h, &[1.0, 1.0, 0.1], 1e-6).unwrap();
        assert_eq!(weak.len(), 1);
        let mut who = weak[0].parameters.clone();
        who.sort_unstable();
        assert_eq!(who, [0, 1]);
        assert!(weak[0].weights[0] * weak[0].weights[1] < 0.0);
        assert!(weak[0].condition > 1e3 && weak[0].condition.is_finite());
        assert!(weak_directions(&h, &[1.0, 0.0, 0.1], 1e-6).unwrap().is_empty());
        let dead = DMatrix::from_diagonal(&DVector::from_row_slice(&[1.0, 0.0]));
        let weak = weak_directions(&dead, &[1.0, 1.0], 1e-6).unwrap();
        assert_eq!((weak[0].parameters.as_slice(), weak[0].condition), ([1].as_slice(), f64::INFINITY));
        assert!(weak_directions(&dead, &[1.0], 1e-6).is_err());
        assert!(weak_directions(&dead, &[1.0, -1.0], 1e-6).is_err());
    }
}
