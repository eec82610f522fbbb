//! Numbers without derivatives, one at a time and several beside one another.

use super::Beside;
use crate::numerics::lanes::{self, Job, Lane, Path};
use crate::numerics::real::{Abreast, Real, Several};

impl Real for f64 {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        // The same bits on every platform, and in a third of the time that a C library may take.
        libm::sincos(self)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        f64::exp(self)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        f64::ln(self)
    }
    #[inline(always)]
    fn tanh(self) -> Self {
        f64::tanh(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }
    #[inline(always)]
    fn if_positive(self, yes: Self, no: Self) -> Self {
        if self > 0.0 { yes } else { no }
    }
    #[inline(always)]
    fn positive(self) -> bool {
        self > 0.0
    }
    #[inline(always)]
    fn size(self) -> f64 {
        f64::abs(self)
    }
    #[inline(always)]
    fn abreast<L: Abreast<Self>>(task: L) -> Option<L::Output> {
        run(task)
    }
}

impl<V: Lane> Several<f64> for Beside<V, 0> {
    const COUNT: usize = V::WIDTH;
    #[inline(always)]
    fn of(from: &[f64]) -> Self {
        Self::fixed(V::load(from))
    }
    #[inline(always)]
    fn plain(from: &[f64]) -> Self {
        Self::fixed(V::load(from))
    }
    #[inline(always)]
    fn all(x: f64) -> Self {
        Self::fixed(V::constant(x))
    }
    #[inline(always)]
    fn put(self, to: &mut [f64]) {
        self.re.store(to);
    }
}

#[inline(always)]
fn run<L: Abreast<f64>>(task: L) -> Option<L::Output> {
    if const { L::FEWEST == 0 } {
        match Path::best() {
            Path::Avx512 => return Some(lanes::avx512(Plain(task))),
            Path::Avx2 => return Some(lanes::avx2(Plain(task))),
            Path::Sse2 | Path::Portable => {}
        }
    }
    None
}

/// A task on numbers without derivatives as a job on vectors.
struct Plain<L>(L);

impl<L: Abreast<f64>> Job for Plain<L> {
    type Output = L::Output;
    #[inline(always)]
    fn run<V: Lane>(self) -> L::Output {
        self.0.run::<Beside<V, 0>>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::real::testing::formula;

    /// A formula of two numbers of each row.
    struct Rows<'a>(&'a [[f64; 2]]);

    impl Abreast<f64> for Rows<'_> {
        type Output = Vec<f64>;
        const FEWEST: usize = 0;
        #[inline(always)]
        fn run<W: Several<f64>>(self) -> Vec<f64> {
            let mut out = vec![0.0; self.0.len()];
            for (rows, out) in self.0.chunks_exact(W::COUNT).zip(out.chunks_exact_mut(W::COUNT)) {
                let [mut x, mut y] = [[0.0; 8]; 2];
                for (lane, [a, b]) in rows.iter().enumerate() {
                    (x[lane], y[lane]) = (*a, *b);
                }
                (formula(W::of(&x), W::plain(&y)) + W::all(rows[0][1])).put(out);
            }
            out
        }
    }

    #[test]
    fn several_at_a_time_have_the_bits_of_one_at_a_time() {
        let rows: Vec<[f64; 2]> =
            (0..32).map(|k| [0.31 * f64::from(k) - 1.0, 0.2 * f64::from(k) - 3.0]).collect();
        let Some(found) = f64::abreast(Rows(&rows)) else {
            assert!(Path::best() < Path::Avx2);
            return;
        };
        let width = Path::best().width();
        for (k, [x, y]) in rows.iter().enumerate() {
            let expected = formula(*x, *y) + rows[k - k % width][1];
            assert_eq!(found[k].to_bits(), expected.to_bits(), "{k}");
        }
    }
}
