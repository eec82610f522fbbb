//! Products of matrices with many more rows than columns, such as Jacobians: taken in blocks of rows that stay in the cache, always in
//! the same order.

use crate::numerics::lanes::{self, Job, Lane, Path};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::array::from_fn;
use std::iter::once;
use std::ops::Range;

/// Rows of a block: a dozen columns of them fit in the first cache.
const BLOCK: usize = 256;
/// Partial sums of a dot product, the same on every processor.
const SUMS: usize = 8;
/// Rows of a long column that one thread takes up at a time.
const PART: usize = 64 * BLOCK;
/// Dot products with one column that are taken at once.
const WIDE: usize = 4;

/// AᵀB. Shapes: n × p and n × q give p × q.
///
/// # Panics
/// If the numbers of rows differ.
pub fn tr_mul(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    assert_eq!(a.nrows(), b.nrows(), "rows of a product");
    tr_mul_rows((a, 0), (b, 0), a.nrows())
}

/// The same of so many rows alone, from a first one of each matrix on.
///
/// # Panics
/// If a matrix does not have these rows.
pub fn tr_mul_rows(
    (a, first): (&DMatrix<f64>, usize),
    (b, second): (&DMatrix<f64>, usize),
    count: usize,
) -> DMatrix<f64> {
    assert!(first + count <= a.nrows() && second + count <= b.nrows(), "rows of a product");
    let mut out = DMatrix::zeros(a.ncols(), b.ncols());
    let parts = [(first, second, count)];
    fast(Product { a: Columns::of(a), b: Columns::of(b), parts, symmetric: false, out: &mut out });
    out
}

/// Aᵀy. Shapes: n × p and n give p.
///
/// # Panics
/// If the numbers of rows differ.
pub fn tr_mul_vector(a: &DMatrix<f64>, y: &DVector<f64>) -> DVector<f64> {
    let y = DMatrix::from_column_slice(y.len(), 1, y.as_slice());
    tr_mul(a, &y).column(0).into_owned()
}

/// aᵀb.
///
/// # Panics
/// If the lengths differ.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "rows of a product");
    let mut sums = [0.0; SUMS];
    let (a, b) = (a.chunks_exact(SUMS), b.chunks_exact(SUMS));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for k in 0..SUMS {
            sums[k] += a[k] * b[k];
        }
    }
    rest + sums.iter().sum::<f64>()
}

/// The sum of a column.
pub fn sum(a: &[f64]) -> f64 {
    let (groups, rest) = a.as_chunks::<SUMS>();
    let mut sums = [0.0; SUMS];
    for group in groups {
        for k in 0..SUMS {
            sums[k] += group[k];
        }
    }
    rest.iter().sum::<f64>() + sums.iter().sum::<f64>()
}

/// AᵀA, symmetric to the bit. Shape: n × p gives p × p.
pub fn gram(a: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(a.ncols(), a.ncols());
    add_gram(a, once(0..a.nrows()), &mut out);
    out
}

/// Adds AᵀA of some `rows` of A, range by range, to `sums`, which is symmetric and stays so to the bit. Shapes: n × p and p × p.
///
/// # Panics
/// If A does not have these rows, or `sums` not this shape.
pub fn add_gram(a: &DMatrix<f64>, rows: impl IntoIterator<Item = Range<usize>>, sums: &mut DMatrix<f64>) {
    assert!(sums.shape() == (a.ncols(), a.ncols()), "shapes of a product");
    let parts = rows.into_iter().map(|rows| {
        assert!(rows.end <= a.nrows(), "rows of a product");
        (rows.start, rows.start, rows.len())
    });
    fast(Product { a: Columns::of(a), b: Columns::of(a), parts, symmetric: true, out: sums });
    sums.fill_lower_triangle_with_upper_triangle();
}

/// Subtracts B·C from A in place. Shapes: n × q, n × p and p × q.
///
/// # Panics
/// If shapes do not agree.
pub fn subtract(a: &mut DMatrix<f64>, b: &DMatrix<f64>, c: &DMatrix<f64>) {
    assert!(b.nrows() == a.nrows() && c.shape() == (b.ncols(), a.ncols()), "shapes of a product");
    fast(Difference { a: a.as_mut_slice(), b: Columns::of(b), c });
}

/// Takes out of a column what lies in one orthonormal basis after the other; the columns of each stand one behind the other.
///
/// # Panics
/// If a basis is no number of whole columns.
pub fn remove(bases: &[&[f64]], column: &mut DVector<f64>) {
    let rows = column.len();
    let mut before: Option<(Columns, Vec<f64>)> = None;
    // What lies in a basis is taken out of each block where the block is looked at along the next one.
    for next in bases.iter().filter(|data| !data.is_empty()).map(Some).chain([None]) {
        let next = next.map(|data| Columns { data, rows });
        let count = next.map_or(0, Columns::count);
        assert_eq!(next.map_or(0, |basis| basis.data.len()), count * rows, "whole columns");
        let before_it = before.as_ref().map(|(basis, lies)| (*basis, &lies[..]));
        let pass = |(part, own)| fast(Pass { first: part * PART, own, before: before_it, next });
        let sums: Vec<Vec<f64>> = column.as_mut_slice().par_chunks_mut(PART).enumerate().map(pass).collect();
        before = next.map(|basis| {
            let mut lies = vec![0.0; count];
            for sums in sums.iter().flat_map(|sums| sums.chunks_exact(count)) {
                lies.iter_mut().zip(sums).for_each(|(x, sum)| *x += sum);
            }
            (basis, lies)
        });
    }
}

/// Columns of one length, one behind the other.
#[derive(Clone, Copy)]
struct Columns<'a> {
    data: &'a [f64],
    rows: usize,
}

impl<'a> Columns<'a> {
    fn of(matrix: &'a DMatrix<f64>) -> Self {
        Self { data: matrix.as_slice(), rows: matrix.nrows() }
    }

    #[inline(always)]
    fn count(self) -> usize {
        self.data.len() / self.rows.max(1)
    }

    /// So many rows of column `k`.
    #[inline(always)]
    fn part(self, k: usize, first: usize, count: usize) -> &'a [f64] {
        &self.data[k * self.rows + first..][..count]
    }
}

/// Runs on the widest vectors of this processor.
fn fast<J: Job>(job: J) -> J::Output {
    lanes::reproducible(Path::best(), job)
}

struct Product<'a, P> {
    a: Columns<'a>,
    b: Columns<'a>,
    /// First row of each, and number of rows.
    parts: P,
    /// Whether only the upper triangle is asked for.
    symmetric: bool,
    /// What the product is added to.
    out: &'a mut DMatrix<f64>,
}

impl<P: IntoIterator<Item = (usize, usize, usize)>> Job for Product<'_, P> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(self) {
        let Self { a, b, parts, symmetric, out } = self;
        let (p, q) = out.shape();
        let mut live = Vec::with_capacity(p);
        let blocks = parts.into_iter().flat_map(|(first, second, count)| {
            (0..count).step_by(BLOCK).map(move |from| (first, second, count, from))
        });
        for (first, second, count, from) in blocks {
            let rows = BLOCK.min(count - from);
            let left = |k: usize| a.part(k, first + from, rows);
            // What acts for a while only has zeros elsewhere.
            live.clear();
            live.extend((0..p).filter(|k| left(*k).iter().any(|x| *x != 0.0)));
            for l in 0..q {
                let right = b.part(l, second + from, rows);
                let last = if symmetric { live.partition_point(|k| *k <= l) } else { live.len() };
                if symmetric && live[..last].last() != Some(&l) {
                    continue;
                }
                let groups = live[..last].chunks_exact(WIDE);
                let rest = groups.remainder();
                for group in groups {
                    let sums = dots::<WIDE>(from_fn(|x| left(group[x])), right);
                    for (k, sum) in group.iter().zip(sums) {
                        out[(*k, l)] += sum;
                    }
                }
                for k in rest {
                    out[(*k, l)] += dots([left(*k)], right)[0];
                }
            }
        }
    }
}

struct Difference<'a> {
    a: &'a mut [f64],
    b: Columns<'a>,
    c: &'a DMatrix<f64>,
}

impl Job for Difference<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(self) {
        let (n, (p, q)) = (self.b.rows, self.c.shape());
        for from in (0..n).step_by(BLOCK) {
            let to = (from + BLOCK).min(n);
            for l in 0..q {
                let own = &mut self.a[l * n + from..l * n + to];
                less(own, (self.b, from), &self.c.as_slice()[l * p..][..p]);
            }
        }
    }
}

/// Rows of a column on its way through bases.
struct Pass<'a> {
    /// Number of the first of these rows.
    first: usize,
    own: &'a mut [f64],
    /// The basis behind it, and what lies along each of its columns.
    before: Option<(Columns<'a>, &'a [f64])>,
    /// The basis ahead.
    next: Option<Columns<'a>>,
}

impl Job for Pass<'_> {
    /// Sums along the columns of the basis ahead, block by block.
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<V: Lane>(self) -> Vec<f64> {
        let count = self.next.map_or(0, Columns::count);
        let mut sums = Vec::with_capacity(count * self.own.len().div_ceil(BLOCK));
        for (block, own) in self.own.chunks_mut(BLOCK).enumerate() {
            let from = self.first + block * BLOCK;
            if let Some((basis, lies)) = self.before {
                less(own, (basis, from), lies);
            }
            let Some(basis) = self.next else { continue };
            let left = |k: usize| basis.part(k, from, own.len());
            let mut k = 0;
            while k + WIDE <= count {
                sums.extend(dots::<WIDE>(from_fn(|x| left(k + x)), own));
                k += WIDE;
            }
            for k in k..count {
                sums.extend(dots([left(k)], own));
            }
        }
        sums
    }
}

/// Subtracts from a block of a column, whose first row is given with the `basis`, so many `times` each of its columns.
#[inline(always)]
fn less(own: &mut [f64], (basis, from): (Columns, usize), times: &[f64]) {
    let rows = own.len();
    let mut k = 0;
    while k + WIDE <= times.len() {
        let columns: [&[f64]; WIDE] = from_fn(|x| basis.part(k + x, from, rows));
        let times: [f64; WIDE] = from_fn(|x| times[k + x]);
        for (row, x) in own.iter_mut().enumerate() {
            for (column, times) in columns.iter().zip(times) {
                *x -= times * column[row];
            }
        }
        k += WIDE;
    }
    for k in k..times.len() {
        for (x, y) in own.iter_mut().zip(basis.part(k, from, rows)) {
            *x -= times[k] * y;
        }
    }
}

/// Dot products of some columns with another: several at once keep the adders busy, and each has the bits that it has alone.
#[inline(always)]
fn dots<const K: usize>(a: [&[f64]; K], b: &[f64]) -> [f64; K] {
    let mut sums = [[0.0; SUMS]; K];
    let whole = b.len() - b.len() % SUMS;
    let mut at = 0;
    while at < whole {
        let right: &[f64; SUMS] = b[at..at + SUMS].try_into().expect("of this length");
        for k in 0..K {
            let left: &[f64; SUMS] = a[k][at..at + SUMS].try_into().expect("of this length");
            for lane in 0..SUMS {
                sums[k][lane] += left[lane] * right[lane];
            }
        }
        at += SUMS;
    }
    let mut out = [0.0; K];
    for k in 0..K {
        let rest: f64 = a[k][whole..].iter().zip(&b[whole..]).map(|(x, y)| x * y).sum();
        out[k] = sums[k].iter().sum::<f64>() + rest;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn matrix(rows: usize, columns: usize, seed: f64) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |r, c| (seed + 0.37 * r as f64 + 1.9 * c as f64).sin())
    }

    #[test]
    fn columns_of_zeros_in_places_change_nothing() {
        let mut a = matrix(1000, 6, 0.5);
        a.view_mut((0, 1), (600, 1)).fill(0.0);
        a.view_mut((300, 4), (700, 2)).fill(0.0);
        let expected = a.transpose() * &a;
        assert!((gram(&a) - &expected).amax() < 1e-10 && (tr_mul(&a, &a) - expected).amax() < 1e-10);
        a[(700, 1)] = f64::NAN;
        assert!(gram(&a)[(1, 1)].is_nan());
    }

    #[test]
    #[should_panic(expected = "rows of a product")]
    fn rows_beyond_the_end_are_not_those_of_the_next_column() {
        add_gram(&matrix(10, 2, 0.5), [0..4, 8..11], &mut DMatrix::zeros(2, 2));
    }

    #[test]
    fn a_product_of_two_columns_is_that_of_their_entries() {
        let (a, b) = (matrix(37, 1, 0.4), matrix(37, 1, 2.2));
        for count in [0, 5, 8, 37] {
            let (a, b) = (&a.as_slice()[..count], &b.as_slice()[..count]);
            let expected: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
            assert!((dot(a, b) - expected).abs() < 1e-13);
            assert!((sum(a) - a.iter().sum::<f64>()).abs() < 1e-13);
        }
    }

    #[test]
    fn a_long_column_loses_what_lies_in_bases_to_the_same_bits_on_any_number_of_threads() {
        let rows = 2 * PART + 3 * BLOCK + 17;
        let [one, other] = [(4, 0.3), (6, 2.1)].map(|(columns, seed)| matrix(rows, columns, seed).qr().q());
        let column = matrix(rows, 1, 5.0).column(0).into_owned();
        let freed = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut free = column.clone();
            pool.install(|| remove(&[one.as_slice(), &[], other.as_slice()], &mut free));
            free
        };
        let expected = &column - &one * one.tr_mul(&column);
        let expected = &expected - &other * other.tr_mul(&expected);
        let free = freed(1);
        assert!((&free - expected).amax() < 1e-10 * column.norm());
        assert_eq!(free, freed(3));
    }

    proptest! {
        #[test]
        fn products_are_those_of_the_definition(rows in 0..2500usize, p in 0..5usize, q in 0..5usize, seed in 0.0..9.0f64) {
            let (a, b) = (matrix(rows, p, seed), matrix(rows, q, seed + 1.0));
            let (size_a, size_b) = (a.abs(), b.abs());
            // Sums over the rows differ by no more than a rounding a row, whatever their order (Higham, 2002, section 3.1), and
            // some of their own, of the same sums of absolute values.
            let rounding = (rows as f64 + 8.0) * f64::EPSILON;
            let near = |x: &DMatrix<f64>, y: &DMatrix<f64>, size: &DMatrix<f64>| (x - y).amax() <= rounding * size.amax();
            let expected = a.transpose() * &b;
            prop_assert!(near(&tr_mul(&a, &b), &expected, &(size_a.transpose() * &size_b)));
            let square = size_a.transpose() * &size_a;
            prop_assert!(near(&gram(&a), &(a.transpose() * &a), &square));
            prop_assert_eq!(gram(&a), gram(&a).transpose());
            let (from, count) = (rows / 3, rows / 2);
            let part = a.rows(from, count);
            let mut sums = gram(&a);
            add_gram(&a, [from..from + count / 2, from + count / 2..from + count], &mut sums);
            prop_assert!(near(&(sums - gram(&a)), &(part.transpose() * part), &square));
            let rest = rows - from - count;
            let own = a.rows(from, count).transpose() * b.rows(rest, count);
            prop_assert!(near(&tr_mul_rows((&a, from), (&b, rest), count), &own, &(size_a.transpose() * &size_b)));
            let mut left = b.clone();
            subtract(&mut left, &a, &expected);
            prop_assert!(near(&left, &(&b - &a * &expected), &(&size_b + &size_a * expected.abs())));
            let y = matrix(rows, 1, seed + 2.0);
            let mut out = y.column(0).into_owned();
            remove(&[a.as_slice()], &mut out);
            let (removed, size) = (&a * (a.transpose() * &y), &size_a * (size_a.transpose() * y.abs()));
            prop_assert!(near(&DMatrix::from_columns(&[out]), &(&y - removed), &(y.abs() + size)));
            if q > 0 {
                let y = b.column(0).into_owned();
                let (found, expected) = (tr_mul_vector(&a, &y), a.transpose() * &y);
                prop_assert!((found - expected).amax() <= rounding * (size_a.transpose() * y.abs()).amax());
            }
        }
    }
}
