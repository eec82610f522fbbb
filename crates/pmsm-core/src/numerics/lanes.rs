//! Vectors of numbers, and the choice of the widest that the processor has, made at run time.
//!
//! A computation that is to run on vectors is a [`Job`]: its body is generic over a [`Lane`], a vector of [`Lane::WIDTH`]
//! numbers that is itself a [`Real`], so that every equation of the crate works on it. [`run`] compiles the body once per
//! [`Path`] with that path's instructions enabled and picks one:
//!
//! | path | vector | needs |
//! |---|---|---|
//! | [`Path::Avx512`] | 8, and 4 where they do | AVX-512F and VL |
//! | [`Path::Avx2`] | 4 | AVX2 and FMA |
//! | [`Path::Sse2`] | 2 | any x86-64 |
//! | [`Path::Portable`] | 1 | nothing |
//!
//! Arithmetic is lane by lane and nothing is contracted in [`Rounding::Reproducible`], so a lane holds the same bits on
//! every path and next to any neighbours. [`Rounding::Fused`] lets [`Lane::mul_add`] round once where the path has the
//! instruction: fewer instructions, but results that differ in the last bits between processors.
//!
//! Bodies and everything they call in an inner loop must be `#[inline(always)]`: what is not inlined, and does not enable the path's
//! instructions itself as sine and exponential do, is compiled for the processor that the crate was built for, which is correct and slow.

mod angles;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

use crate::numerics::real::Real;

/// A vector of numbers.
pub trait Lane: Real {
    /// Number of entries.
    const WIDTH: usize;
    /// Half as many entries that round alike, for what does not fill a vector; or the same where there is no such type.
    type Half: Lane;
    /// The first [`Lane::WIDTH`] entries of a slice.
    ///
    /// # Panics
    /// If there are fewer.
    fn load(from: &[f64]) -> Self;
    /// Number `n` of record `begin[lane] + k` for each lane, for each `n` below `N`; records of `size` numbers lie one after
    /// the other. At least eight numbers must follow the beginning of each.
    ///
    /// # Panics
    /// If they do not, or if there are fewer beginnings than lanes.
    #[inline(always)]
    fn columns<const N: usize>(records: &[f64], begin: &[usize], size: usize, k: usize) -> [Self; N] {
        let mut rows = [[0.0; 8]; N];
        for lane in 0..Self::WIDTH {
            let record = &records[(begin[lane] + k) * size..][..8];
            for n in 0..N {
                rows[n][lane] = record[n];
            }
        }
        let mut columns = [Self::zero(); N];
        for n in 0..N {
            columns[n] = Self::load(&rows[n]);
        }
        columns
    }
    /// Writes its entries to the head of a slice.
    ///
    /// # Panics
    /// If there is no room.
    fn store(self, to: &mut [f64]);
    /// `self·a + b`; rounded once on a path that fuses, else after the product as well.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// `b − self·a`, rounded as [`Lane::mul_add`].
    fn neg_mul_add(self, a: Self, b: Self) -> Self;
    /// The first entry.
    fn first(self) -> f64;
    /// Whether an entry is at most its counterpart in `bound`; NaN is not.
    fn any_within(self, bound: Self) -> bool;
}

/// Which instructions carry a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Path {
    /// One number at a time.
    Portable,
    /// Two, on any x86-64.
    Sse2,
    /// Four, with AVX2 and FMA.
    Avx2,
    /// Eight, with AVX-512F and VL.
    Avx512,
}

impl Path {
    /// All, narrowest first.
    pub const ALL: [Self; 4] = [Self::Portable, Self::Sse2, Self::Avx2, Self::Avx512];

    /// Whether this processor has it.
    #[cfg(target_arch = "x86_64")]
    pub fn available(self) -> bool {
        match self {
            Self::Portable | Self::Sse2 => true,
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            Self::Avx512 => is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vl"),
        }
    }

    /// Whether this processor has it.
    #[cfg(not(target_arch = "x86_64"))]
    pub fn available(self) -> bool {
        self == Self::Portable
    }

    /// The widest that this processor has.
    pub fn best() -> Self {
        Self::ALL.into_iter().rev().find(|path| path.available()).unwrap_or(Self::Portable)
    }

    /// Numbers per vector.
    pub fn width(self) -> usize {
        match self {
            Self::Portable => 1,
            Self::Sse2 => 2,
            Self::Avx2 => 4,
            Self::Avx512 => 8,
        }
    }
}

/// How products and sums are rounded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rounding {
    /// After every operation: the same bits on every path.
    Reproducible,
    /// Once per [`Lane::mul_add`] where the path has the instruction.
    Fused,
}

/// A computation on vectors of any width.
pub trait Job {
    /// What it returns.
    type Output;
    /// The computation. Implementations are `#[inline(always)]`.
    fn run<V: Lane>(self) -> Self::Output;
}

/// Tells the processor that the number at `at` will soon be read, where it can be told. Any place is allowed.
#[inline(always)]
pub fn prefetch(from: &[f64], at: usize) {
    #[cfg(target_arch = "x86_64")]
    x86::prefetch(from, at);
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (from, at);
}

/// Runs `job` on `path`, or on the widest path below it that this processor has.
pub fn run<J: Job>(path: Path, rounding: Rounding, job: J) -> J::Output {
    #[cfg(target_arch = "x86_64")]
    match (available(path), rounding) {
        (Path::Avx512, Rounding::Fused) => return x86::avx512::<J, true>(job),
        (Path::Avx2, Rounding::Fused) => return x86::avx2::<J, true>(job),
        _ => {}
    }
    let _ = rounding;
    reproducible(path, job)
}

/// The same for [`Rounding::Reproducible`] alone: the other one is not compiled.
pub fn reproducible<J: Job>(path: Path, job: J) -> J::Output {
    match available(path) {
        #[cfg(target_arch = "x86_64")]
        Path::Avx512 => x86::avx512::<J, false>(job),
        #[cfg(target_arch = "x86_64")]
        Path::Avx2 => x86::avx2::<J, false>(job),
        #[cfg(target_arch = "x86_64")]
        Path::Sse2 => job.run::<x86::Sse2<false>>(),
        _ => job.run::<f64>(),
    }
}

fn available(path: Path) -> Path {
    if path.available() { path } else { Path::best() }
}

/// Runs a job on vectors of eight, reproducibly; the processor must have [`Path::Avx512`].
///
/// # Panics
/// If it has not.
pub fn avx512<J: Job>(job: J) -> J::Output {
    #[cfg(target_arch = "x86_64")]
    return x86::avx512::<J, false>(job);
    #[cfg(not(target_arch = "x86_64"))]
    panic!("this processor has no AVX-512F with VL: {}", std::any::type_name_of_val(&job));
}

/// Runs a job on vectors of four, reproducibly; the processor must have [`Path::Avx2`].
///
/// # Panics
/// If it has not.
pub fn avx2<J: Job>(job: J) -> J::Output {
    #[cfg(target_arch = "x86_64")]
    return x86::avx2::<J, false>(job);
    #[cfg(not(target_arch = "x86_64"))]
    panic!("this processor has no AVX2 with FMA: {}", std::any::type_name_of_val(&job));
}

#[cfg(test)]
mod tests {
    //! `make miri` runs them under Miri.

    use super::*;

    /// Lane-by-lane operations and records taken apart, as bits per lane.
    struct Arithmetic<'a>(&'a [f64; 64]);

    impl Job for Arithmetic<'_> {
        type Output = [Vec<u64>; 8];
        #[inline(always)]
        fn run<V: Lane>(self) -> [Vec<u64>; 8] {
            let mut out: [Vec<u64>; 8] = Default::default();
            let begin = [0, 3, 1, 2, 0, 1, 3, 2];
            for at in (0..8).step_by(V::WIDTH) {
                let (x, y) = (V::load(&self.0[at..]), V::load(&self.0[at + 8..]));
                let [a, b, c, d, e, f, g] = V::columns::<7>(self.0, &begin[at..], 7, 1);
                for value in [
                    x + y,
                    x - y,
                    x * y,
                    x / y,
                    -x,
                    x.abs().sqrt(),
                    x.mul_add(y, x),
                    x.neg_mul_add(y, x),
                    x * 0.3 + 0.1 - y,
                    a,
                    b,
                    c,
                    d,
                    e,
                    f,
                    g,
                ] {
                    let mut lanes = [0.0; 8];
                    value.store(&mut lanes);
                    for lane in 0..V::WIDTH {
                        out[at + lane].push(lanes[lane].to_bits());
                    }
                }
            }
            out
        }
    }

    #[test]
    fn arithmetic_has_the_bits_of_single_numbers_on_every_path() {
        let numbers: [f64; 64] = std::array::from_fn(|k| 0.37 * (k as f64 - 20.5) / (1.0 + k as f64));
        let expected = run(Path::Portable, Rounding::Reproducible, Arithmetic(&numbers));
        for path in Path::ALL {
            assert_eq!(run(path, Rounding::Reproducible, Arithmetic(&numbers)), expected, "{path:?}");
        }
        let widest = run(Path::Avx512, Rounding::Fused, Arithmetic(&numbers));
        assert_eq!(run(Path::best(), Rounding::Fused, Arithmetic(&numbers)), widest);
    }

    /// Sizes and signs, in bits: one number that is greater than zero gives 1, all others 2.
    struct Signs<'a>(&'a [f64; 8]);

    impl Job for Signs<'_> {
        type Output = [[u64; 2]; 8];
        #[inline(always)]
        fn run<V: Lane>(self) -> Self::Output {
            let (mut size, mut sign) = ([0.0; 8], [0.0; 8]);
            for at in (0..8).step_by(V::WIDTH) {
                let x = V::load(&self.0[at..]);
                x.abs().store(&mut size[at..]);
                x.if_positive(V::one(), V::constant(2.0)).store(&mut sign[at..]);
            }
            std::array::from_fn(|k| [size[k].to_bits(), sign[k].to_bits()])
        }
    }

    #[test]
    fn zeros_of_either_sign_infinities_and_what_is_no_number_are_taken_as_by_single_numbers() {
        let odd = [0.0, -0.0, f64::NAN, -f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 5e-324, -5e-324];
        for path in Path::ALL {
            for (x, [size, sign]) in odd.into_iter().zip(run(path, Rounding::Reproducible, Signs(&odd))) {
                let (size, sign) = (f64::from_bits(size), f64::from_bits(sign));
                assert!(size.to_bits() == x.abs().to_bits() || x.is_nan() && size.is_nan(), "{path:?} {x}");
                assert_eq!(sign, if x > 0.0 { 1.0 } else { 2.0 }, "{path:?} {x}");
            }
        }
    }

    #[test]
    fn a_path_that_is_missing_gives_way_to_the_best_there_is() {
        assert!(Path::best().available() && Path::ALL[0].available());
        for path in Path::ALL {
            assert_eq!(path.width(), 1 << (path as usize));
        }
    }
}
