//! Numbers with their derivatives beside one another, one in each lane of a vector.

use super::Dual;
use super::tangent::Tangent;
use crate::numerics::lanes::{self, Job, Lane, Path};
use crate::numerics::real::{Abreast, Several};

/// As many numbers as a vector has lanes, each with `R` derivatives of its own.
pub type Beside<V, const R: usize> = Tangent<V, R, true>;

/// Lanes at most.
const LANES: usize = 8;
/// Derivatives at most: with more of them a number fills the registers.
const MOST: usize = 4;

impl<V: Lane, const R: usize> Beside<V, R> {
    /// From values, and derivative number `slot` of each.
    #[inline(always)]
    pub fn variable(re: V, slot: usize, eps: V) -> Self {
        let mut own = Self { re, eps: [V::zero(); R] };
        own.eps[slot] = eps;
        own
    }
    /// From values that do not change.
    #[inline(always)]
    pub fn fixed(re: V) -> Self {
        Self { re, eps: [V::zero(); R] }
    }
    /// The values.
    #[inline(always)]
    pub fn values(self) -> V {
        self.re
    }
    /// Derivative number `slot` of each.
    #[inline(always)]
    pub fn slopes(self, slot: usize) -> V {
        self.eps[slot]
    }
    /// Times numbers without derivatives.
    #[inline(always)]
    pub fn scaled(self, by: V) -> Self {
        self.chain(self.re * by, by)
    }
}

impl<V: Lane, const R: usize> Several<Dual<R>> for Beside<V, R> {
    const COUNT: usize = V::WIDTH;
    #[inline(always)]
    fn of(from: &[Dual<R>]) -> Self {
        let from = &from[..V::WIDTH];
        let (mut re, mut eps) = ([0.0; LANES], [[0.0; LANES]; R]);
        for lane in 0..V::WIDTH {
            re[lane] = from[lane].re;
            for r in 0..R {
                eps[r][lane] = from[lane].eps[r];
            }
        }
        let mut own = Self::fixed(V::load(&re));
        for r in 0..R {
            own.eps[r] = V::load(&eps[r]);
        }
        own
    }
    #[inline(always)]
    fn plain(from: &[f64]) -> Self {
        Self::fixed(V::load(from))
    }
    #[inline(always)]
    fn all(x: Dual<R>) -> Self {
        let mut own = Self::fixed(V::constant(x.re));
        for r in 0..R {
            own.eps[r] = V::constant(x.eps[r]);
        }
        own
    }
    #[inline(always)]
    fn put(self, to: &mut [Dual<R>]) {
        let to = &mut to[..V::WIDTH];
        let (mut re, mut eps) = ([0.0; LANES], [[0.0; LANES]; R]);
        self.re.store(&mut re);
        for r in 0..R {
            self.eps[r].store(&mut eps[r]);
        }
        for lane in 0..V::WIDTH {
            to[lane].re = re[lane];
            for r in 0..R {
                to[lane].eps[r] = eps[r][lane];
            }
        }
    }
}

/// See [`crate::numerics::real::Real::abreast`].
#[inline(always)]
pub fn run<const N: usize, L: Abreast<Dual<N>>>(task: L) -> Option<L::Output> {
    if const { L::FEWEST <= N && N <= MOST } {
        match Path::best() {
            Path::Avx512 => return Some(lanes::avx512(Numbers::<N, L>(task))),
            Path::Avx2 => return Some(lanes::avx2(Numbers::<N, L>(task))),
            Path::Sse2 | Path::Portable => {}
        }
    }
    None
}

/// A task on dual numbers as a job on vectors.
struct Numbers<const N: usize, L>(L);

impl<const N: usize, L: Abreast<Dual<N>>> Job for Numbers<N, L> {
    type Output = L::Output;
    #[inline(always)]
    fn run<V: Lane>(self) -> L::Output {
        self.0.run::<Beside<V, N>>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::real::{Real, testing::formula};

    /// A formula of two numbers of each row.
    struct Rows<'a>(&'a [[Dual<3>; 2]]);

    impl Abreast<Dual<3>> for Rows<'_> {
        type Output = (Vec<Dual<3>>, f64);
        const FEWEST: usize = 3;
        #[inline(always)]
        fn run<W: Several<Dual<3>>>(self) -> Self::Output {
            let mut out = vec![Dual::zero(); self.0.len()];
            let mut most = 0.0f64;
            for (rows, out) in self.0.chunks_exact(W::COUNT).zip(out.chunks_exact_mut(W::COUNT)) {
                let [mut x, mut y] = [[Dual::zero(); LANES]; 2];
                for (lane, [a, b]) in rows.iter().enumerate() {
                    (x[lane], y[lane]) = (*a, *b);
                }
                let mut third = [0.0; LANES];
                for (lane, [a, _]) in rows.iter().enumerate() {
                    third[lane] = a.re;
                }
                let both = formula(W::of(&x), W::of(&y)) + W::plain(&third) * W::all(rows[0][1]);
                most = most.max(both.size());
                both.put(out);
            }
            (out, most)
        }
    }

    #[test]
    fn several_at_a_time_have_the_bits_of_one_at_a_time() {
        let number = |k: f64| Dual { re: 0.31 * k - 1.0, eps: [k.sin(), 0.0, -k] };
        let rows: Vec<[Dual<3>; 2]> =
            (0..32).map(|k| [number(f64::from(k)), number(0.7 * f64::from(k) + 0.1)]).collect();
        let check = |(out, most): (Vec<Dual<3>>, f64), width: usize| {
            for (k, [x, y]) in rows.iter().enumerate() {
                let first = rows[k - k % width][1];
                let expected = formula(*x, *y) + Dual::constant(x.re) * first;
                assert_eq!(out[k].re.to_bits(), expected.re.to_bits(), "{width} {k}");
                assert_eq!(out[k].eps, expected.eps, "{width} {k}");
            }
            assert_eq!(most, out.iter().map(|x| x.re.abs()).fold(0.0, f64::max));
        };
        match Dual::abreast(Rows(&rows)) {
            Some(found) => check(found, Path::best().width()),
            None => assert!(Path::best() < Path::Avx2),
        }
        if Path::Avx2.available() {
            check(lanes::avx2(Numbers::<3, _>(Rows(&rows))), 4);
        }
    }
}
