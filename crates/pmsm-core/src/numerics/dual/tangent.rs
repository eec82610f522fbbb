//! A value with its derivatives held in vectors: what [`Dual`] means, at the speed of the lanes.
//!
//! Every operation is that of [`Dual`] in the same order and without contraction, so a result has the same bits whether
//! it was computed here or there. The value fills a vector of its own: products with the derivatives need no broadcast.

use super::Dual;
use super::outlined::Outlined;
use crate::numerics::lanes::{self, Job, Lane, Path};
use crate::numerics::real::{Carries, Loop, Real, Task};
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// Derivatives that one pass carries on vectors.
const MOST: usize = 8;
/// Derivatives that fit into a vector of half that width.
const HALF: usize = 4;
/// Fewer derivatives than this are as fast one by one.
const LEAST: usize = 3;

/// Runs `task` on tangents where this processor has vectors wide enough, else on dual numbers; where those are the exception,
/// on outlined ones.
pub fn run<const N: usize, L: Loop<Dual<N>>>(task: L) -> L::Output {
    let path = Path::best();
    if const { LEAST <= N && N <= HALF } {
        if path >= Path::Avx2 && Path::Avx2.available() {
            return lanes::avx2(Wide::<N, 1, L>(task));
        }
    } else if const { HALF < N && N <= MOST } {
        if path == Path::Avx512 {
            return lanes::avx512(Wide::<N, 1, L>(task));
        }
        if path == Path::Avx2 {
            return lanes::avx2(Wide::<N, 2, L>(task));
        }
    }
    if const { LEAST <= N && cfg!(target_arch = "x86_64") } { compact(task) } else { task.run::<Dual<N>>() }
}

/// Runs `task` with little machine code: with no more derivatives than a pass on vectors carries, on the one outlined number of that
/// many.
pub fn compact<const N: usize, L: Loop<Dual<N>>>(task: L) -> L::Output {
    if const { N <= MOST } { task.run::<Outlined<MOST>>() } else { task.run::<Dual<N>>() }
}

/// A loop over dual numbers as a job on vectors.
struct Wide<const N: usize, const R: usize, L>(L);

impl<const N: usize, const R: usize, L: Loop<Dual<N>>> Job for Wide<N, R, L> {
    type Output = L::Output;
    #[inline(always)]
    fn run<V: Lane>(self) -> L::Output {
        self.0.run::<Tangent<V, R, false>>()
    }
}

/// A value, in every lane of a vector, and its derivatives in `R` vectors; or, where the lanes stand `APART`, a number in each of
/// them with `R` derivatives of its own.
#[derive(Debug, Clone, Copy)]
pub struct Tangent<V, const R: usize, const APART: bool> {
    pub(super) re: V,
    pub(super) eps: [V; R],
}

/// A tangent with the value `re` and the derivatives that an expression of `k` gives; it begins as `like`. A closure would be compiled
/// without the path's instructions, and thousands of loops over a few vectors, that which repeats a zero included, take the compiler
/// minutes to unroll.
macro_rules! each {
    ($like:expr, $re:expr, $k:ident => $eps:expr) => {{
        let mut tangent = Self { re: $re, eps: $like.eps };
        if const { R > 0 } {
            let $k = 0;
            tangent.eps[0] = $eps;
        }
        if const { R > 1 } {
            let $k = 1;
            tangent.eps[1] = $eps;
        }
        if const { R > 2 } {
            let $k = 2;
            tangent.eps[2] = $eps;
        }
        if const { R > 3 } {
            let $k = 3;
            tangent.eps[3] = $eps;
        }
        if const { R > 4 } {
            for $k in 4..R {
                tangent.eps[$k] = $eps;
            }
        }
        tangent
    }};
}

impl<V: Lane, const R: usize, const N: usize> Carries<Dual<N>> for Tangent<V, R, false> {
    #[inline(always)]
    fn carry(x: Dual<N>) -> Self {
        let mut eps = [0.0; MOST];
        eps[..N].copy_from_slice(&x.eps);
        each!(Self::constant(0.0), V::constant(x.re), r => V::load(&eps[r * V::WIDTH..]))
    }
    #[inline(always)]
    fn give(self) -> Dual<N> {
        let mut eps = [0.0; MOST];
        for r in 0..R {
            self.eps[r].store(&mut eps[r * V::WIDTH..]);
        }
        Dual { re: self.re.first(), eps: std::array::from_fn(|k| eps[k]) }
    }
}

impl<V: Lane, const R: usize, const APART: bool> Tangent<V, R, APART> {
    /// `f(self)` from the value and the derivative of `f` there.
    #[inline(always)]
    pub(super) fn chain(self, value: V, slope: V) -> Self {
        each!(self, value, k => self.eps[k] * slope)
    }
    /// A function's value, taken `once` for all lanes or in `each`.
    #[inline(always)]
    fn value(self, once: fn(f64) -> f64, each: fn(V) -> V) -> V {
        if APART { each(self.re) } else { V::constant(once(self.re.first())) }
    }
}

impl<V: Lane, const R: usize, const APART: bool> Add for Tangent<V, R, APART> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        each!(self, self.re + other.re, k => self.eps[k] + other.eps[k])
    }
}

impl<V: Lane, const R: usize, const APART: bool> Sub for Tangent<V, R, APART> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        each!(self, self.re - other.re, k => self.eps[k] - other.eps[k])
    }
}

impl<V: Lane, const R: usize, const APART: bool> Mul for Tangent<V, R, APART> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        each!(self, self.re * other.re, k => self.eps[k] * other.re + self.re * other.eps[k])
    }
}

impl<V: Lane, const R: usize, const APART: bool> Div for Tangent<V, R, APART> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let (inverse, value) = (V::one() / other.re, self.re / other.re);
        each!(self, value, k => (self.eps[k] - value * other.eps[k]) * inverse)
    }
}

impl<V: Lane, const R: usize, const APART: bool> Add<f64> for Tangent<V, R, APART> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: f64) -> Self {
        Self { re: self.re + other, eps: self.eps }
    }
}

impl<V: Lane, const R: usize, const APART: bool> Sub<f64> for Tangent<V, R, APART> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: f64) -> Self {
        Self { re: self.re - other, eps: self.eps }
    }
}

impl<V: Lane, const R: usize, const APART: bool> Mul<f64> for Tangent<V, R, APART> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: f64) -> Self {
        let other = V::constant(other);
        self.chain(self.re * other, other)
    }
}

impl<V: Lane, const R: usize, const APART: bool> Neg for Tangent<V, R, APART> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        each!(self, -self.re, k => -self.eps[k])
    }
}

impl<V: Lane, const R: usize, const APART: bool> AddAssign for Tangent<V, R, APART> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<V: Lane, const R: usize, const APART: bool> SubAssign for Tangent<V, R, APART> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<V: Lane, const R: usize, const APART: bool> Real for Tangent<V, R, APART> {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Self { re: V::constant(x), eps: [V::zero(); R] }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.re.sqrt();
        self.chain(root, root.if_positive(V::constant(0.5) / root, V::zero()))
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (s, c) = if APART {
            self.re.sin_cos()
        } else {
            let (s, c) = Real::sin_cos(self.re.first());
            (V::constant(s), V::constant(c))
        };
        (self.chain(s, c), self.chain(c, -s))
    }
    #[inline(always)]
    fn exp(self) -> Self {
        let e = self.value(f64::exp, V::exp);
        self.chain(e, e)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.chain(self.value(f64::ln, V::ln), V::one() / self.re)
    }
    #[inline(always)]
    fn tanh(self) -> Self {
        let t = self.value(f64::tanh, V::tanh);
        self.chain(t, V::one() - t * t)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        let (one, zero) = (V::one(), V::zero());
        let slope = self.re.if_positive(one, (-self.re).if_positive(-one, zero));
        self.chain(self.re.abs(), slope)
    }
    #[inline(always)]
    fn if_positive(self, yes: Self, no: Self) -> Self {
        each!(self, self.re.if_positive(yes.re, no.re), k => self.re.if_positive(yes.eps[k], no.eps[k]))
    }
    #[inline(always)]
    fn apart<K: Task<U>, U: Real>(task: K) -> K::Output {
        V::apart(task)
    }
    #[inline(always)]
    fn positive(self) -> bool {
        self.re.first() > 0.0
    }
    #[inline(always)]
    fn size(self) -> f64 {
        if APART { self.re.size() } else { self.re.first().abs() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A formula that uses every operation.
    #[inline(always)]
    fn formula<T: Real>(x: T, y: T) -> T {
        let (s, c) = (x * y).sin_cos();
        let a = (x.squared() + 1.0).sqrt() / (y.squared() + 2.0);
        let b = (x - y).tanh() * s - (c * 0.3).exp() + (y.squared() + 1.5).ln();
        let mut sum = (x - 0.2).if_positive(a, -a) + b + x.abs().pow_nonnegative(y.abs() + 1.0);
        sum += x.sqrt() - 0.7;
        sum -= y;
        sum
    }

    struct Formula<const N: usize>([Dual<N>; 2]);

    impl<const N: usize> Loop<Dual<N>> for Formula<N> {
        type Output = Dual<N>;
        #[inline(always)]
        fn run<W: Carries<Dual<N>>>(self) -> Dual<N> {
            formula(W::carry(self.0[0]), W::carry(self.0[1])).give()
        }
    }

    fn bits<const N: usize>(x: Dual<N>) -> (u64, [u64; N]) {
        (x.re.to_bits(), x.eps.map(f64::to_bits))
    }

    fn same_bits<const N: usize>(x: f64, y: f64, e: &[f64; 16]) {
        let pair = [
            Dual::<N> { re: x, eps: std::array::from_fn(|k| e[k]) },
            Dual::<N> { re: y, eps: std::array::from_fn(|k| e[k + 8]) },
        ];
        let expected = bits(formula(pair[0], pair[1]));
        assert_eq!(bits(Dual::fastest(Formula(pair))), expected);
        assert_eq!(bits(Wide::<N, MOST, _>(Formula(pair)).run::<f64>()), expected);
        assert_eq!(bits(Formula(pair).run::<Outlined<MOST>>()), expected);
    }

    proptest! {
        #[test]
        fn tangents_have_the_bits_of_dual_numbers(
            x in 0.0..2.0f64, y in -2.0..2.0f64, e in prop::array::uniform16(-3.0..3.0f64),
        ) {
            same_bits::<2>(x, y, &e);
            same_bits::<4>(x, y, &e);
            same_bits::<7>(x, y, &e);
            same_bits::<8>(x, y, &e);
        }
    }
}
