//! A function of a small symmetric matrix times a vector, over and over without memory of its own.

use nalgebra::{DMatrix, DVector};

/// Sweeps after which rounding alone is left.
const SWEEPS: usize = 30;

/// Writes Q·f(Λ)·Qᵀ·`v` to `out`, where `a` = Q·Λ·Qᵀ is symmetric: cyclic Jacobi rotations (Golub & Van Loan, "Matrix
/// Computations", section 8.5). `a` is used up, `axes` holds Q afterwards; both are square and as long as `v` and `out`.
pub fn function_times(
    a: &mut DMatrix<f64>,
    axes: &mut DMatrix<f64>,
    v: &DVector<f64>,
    f: impl Fn(f64) -> f64,
    out: &mut DVector<f64>,
) {
    let n = v.len();
    axes.fill_with_identity();
    for _ in 0..SWEEPS {
        let mut turned = false;
        for q in 1..n {
            for p in 0..q {
                let beside = a[(p, q)];
                // Also false for NaN.
                if beside.abs() > f64::EPSILON * (a[(p, p)] * a[(q, q)]).abs().sqrt() {
                    let half = 0.5 * (a[(q, q)] - a[(p, p)]) / beside;
                    // A square beyond all numbers makes no turn, as it should.
                    let t = half.signum() / (half.abs() + (half * half + 1.0).sqrt());
                    let c = (t * t + 1.0).sqrt().recip();
                    rotate(a, axes, [p, q], [c, t * c]);
                    turned = true;
                }
            }
        }
        if !turned {
            break;
        }
    }
    out.fill(0.0);
    for k in 0..n {
        let axis = axes.column(k);
        out.axpy(f(a[(k, k)]) * axis.dot(v), &axis, 1.0);
    }
}

/// One rotation of rows and columns `p` and `q` by cosine and sine, and of the axes.
fn rotate(a: &mut DMatrix<f64>, axes: &mut DMatrix<f64>, [p, q]: [usize; 2], [c, s]: [f64; 2]) {
    let turn = |x: f64, y: f64| [c * x - s * y, s * x + c * y];
    for k in 0..a.nrows() {
        [a[(k, p)], a[(k, q)]] = turn(a[(k, p)], a[(k, q)]);
        [axes[(k, p)], axes[(k, q)]] = turn(axes[(k, p)], axes[(k, q)]);
    }
    for k in 0..a.nrows() {
        [a[(p, k)], a[(q, k)]] = turn(a[(p, k)], a[(q, k)]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SymmetricEigen;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_the_function_by_eigenvalues(
            n in 1usize..6, entries in prop::collection::vec(-1.0..1.0f64, 36), v in prop::collection::vec(-1.0..1.0f64, 6),
        ) {
            let half = DMatrix::from_fn(n, n, |r, c| entries[6 * r + c]);
            let a = half.tr_mul(&half) * 0.1;
            let v = DVector::from_column_slice(&v[..n]);
            let f = |x: f64| (1.0 - x).clamp(0.05, 1.0).sqrt().recip();
            let eigen = SymmetricEigen::new(a.clone());
            let along = eigen.eigenvectors.tr_mul(&v).component_mul(&eigen.eigenvalues.map(f));
            let expected = &eigen.eigenvectors * along;
            let mut found = v.clone();
            function_times(&mut a.clone(), &mut DMatrix::zeros(n, n), &v, f, &mut found);
            // Both ways find the eigenvalues of a matrix that is off by some ten roundings a row, so each is off by that times the
            // steepest slope of f, in the Frobenius norm (Wihler, 2009). The products add a rounding of the result for each term.
            let steepest = 0.5 * 0.05f64.powf(-1.5);
            let rows = n as f64 * f64::EPSILON;
            prop_assert!((found - &expected).norm() <= 10.0 * rows * (steepest * a.norm() * v.norm() + expected.norm()));
        }
    }
}
