//! Products of matrices with many more rows than columns, such as Jacobians: taken in blocks of rows that stay in the cache, always in
//! the same order.

use nalgebra::{DMatrix, DVector};

/// Rows of a block: a dozen columns of them fit in the first caches.
const BLOCK: usize = 1024;
/// Partial sums of a dot product.
const LANES: usize = 8;

/// AᵀB. Shapes: n × p and n × q give p × q.
///
/// # Panics
/// If the numbers of rows differ.
pub fn tr_mul(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let (p, q) = (a.ncols(), b.ncols());
    let mut out = DMatrix::zeros(p, q);
    blocks(a, b, |of_a, of_b, from, to| {
        for l in 0..q {
            for k in 0..p {
                out[(k, l)] += dot(column(of_a, k, from, to), column(of_b, l, from, to));
            }
        }
    });
    out
}

/// Aᵀy. Shapes: n × p and n give p.
///
/// # Panics
/// If the numbers of rows differ.
pub fn tr_mul_vector(a: &DMatrix<f64>, y: &DVector<f64>) -> DVector<f64> {
    assert_eq!(a.nrows(), y.len(), "rows of a product");
    DVector::from_iterator(a.ncols(), a.as_slice().chunks_exact(a.nrows().max(1)).map(|c| dot(c, y.as_slice())))
}

/// AᵀA, symmetric to the bit. Shape: n × p gives p × p.
pub fn gram(a: &DMatrix<f64>) -> DMatrix<f64> {
    let p = a.ncols();
    let mut out = DMatrix::zeros(p, p);
    blocks(a, a, |of_a, _, from, to| {
        for l in 0..p {
            for k in 0..=l {
                out[(k, l)] += dot(column(of_a, k, from, to), column(of_a, l, from, to));
            }
        }
    });
    out.fill_lower_triangle_with_upper_triangle();
    out
}

/// Subtracts B·C from A in place. Shapes: n × q, n × p and p × q.
///
/// # Panics
/// If shapes do not agree.
pub fn subtract(a: &mut DMatrix<f64>, b: &DMatrix<f64>, c: &DMatrix<f64>) {
    let n = a.nrows();
    assert!(b.nrows() == n && c.shape() == (b.ncols(), a.ncols()), "shapes of a product");
    for from in (0..n).step_by(BLOCK) {
        let to = (from + BLOCK).min(n);
        for (l, own) in a.as_mut_slice().chunks_exact_mut(n).enumerate() {
            for (k, basis) in b.as_slice().chunks_exact(n).enumerate() {
                let times = c[(k, l)];
                for (x, y) in own[from..to].iter_mut().zip(&basis[from..to]) {
                    *x -= times * y;
                }
            }
        }
    }
}

/// Hands out blocks of rows of both matrices.
fn blocks(a: &DMatrix<f64>, b: &DMatrix<f64>, mut each: impl FnMut(&DMatrix<f64>, &DMatrix<f64>, usize, usize)) {
    let n = a.nrows();
    assert_eq!(n, b.nrows(), "rows of a product");
    for from in (0..n).step_by(BLOCK) {
        each(a, b, from, (from + BLOCK).min(n));
    }
}

fn column(a: &DMatrix<f64>, k: usize, from: usize, to: usize) -> &[f64] {
    &a.as_slice()[k * a.nrows() + from..k * a.nrows() + to]
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    let (heads, tails) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f64 = heads.remainder().iter().zip(tails.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in heads.zip(tails) {
        for (sum, (x, y)) in sums.iter_mut().zip(x.iter().zip(y)) {
            *sum += x * y;
        }
    }
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn matrix(rows: usize, columns: usize, seed: f64) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |r, c| (seed + 0.37 * r as f64 + 1.9 * c as f64).sin())
    }

    proptest! {
        #[test]
        fn products_are_those_of_the_definition(rows in 0..2500usize, p in 0..5usize, q in 0..5usize, seed in 0.0..9.0f64) {
            let (a, b) = (matrix(rows, p, seed), matrix(rows, q, seed + 1.0));
            let expected = a.transpose() * &b;
            prop_assert!((tr_mul(&a, &b) - &expected).amax() < 1e-10);
            prop_assert!((gram(&a) - a.transpose() * &a).amax() < 1e-10);
            prop_assert_eq!(gram(&a), gram(&a).transpose());
            let mut left = b.clone();
            subtract(&mut left, &a, &expected);
            prop_assert!((left - (&b - &a * &expected)).amax() < 1e-9);
            if q > 0 {
                let y = b.column(0).into_owned();
                prop_assert!((tr_mul_vector(&a, &y) - a.transpose() * &y).amax() < 1e-10);
            }
        }
    }
}
