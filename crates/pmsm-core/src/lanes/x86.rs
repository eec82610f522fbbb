//! Vectors of x86-64, and the only unsafe code of the crate.
//!
//! Why it is sound: the types [`Avx2`] and [`Avx512`] are visible in this module alone, and a job meets them as the type
//! parameter of [`Job::run`], called by [`avx2`] and [`avx512`] after they have asked the processor. So whoever holds
//! such a value, or calls a function of such a type, runs on a processor that has the instructions.

#![allow(unsafe_code)]

use super::{Job, Lane, Path, angles};
use crate::real::Real;
use std::arch::x86_64::*;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// Runs a job on vectors of eight.
///
/// # Panics
/// If the processor has no AVX-512F.
pub fn avx512<J: Job, const FUSED: bool>(job: J) -> J::Output {
    #[target_feature(enable = "avx512f")]
    fn enter<J: Job, const FUSED: bool>(job: J) -> J::Output {
        job.run::<Avx512<FUSED>>()
    }
    assert!(Path::Avx512.available(), "this processor has no AVX-512F");
    // SAFETY: the instructions that `enter` enables were found on this processor one line above.
    unsafe { enter::<J, FUSED>(job) }
}

/// Runs a job on vectors of four.
///
/// # Panics
/// If the processor has no AVX2 or no FMA.
pub fn avx2<J: Job, const FUSED: bool>(job: J) -> J::Output {
    #[target_feature(enable = "avx2,fma")]
    fn enter<J: Job, const FUSED: bool>(job: J) -> J::Output {
        job.run::<Avx2<FUSED>>()
    }
    assert!(Path::Avx2.available(), "this processor has no AVX2 with FMA");
    // SAFETY: the instructions that `enter` enables were found on this processor one line above.
    unsafe { enter::<J, FUSED>(job) }
}

/// See [`super::prefetch`].
#[inline(always)]
pub fn prefetch(from: &[f64], at: usize) {
    // SAFETY: a prefetch reads nothing that the program could see and does not fault, whatever the address.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(from.as_ptr().wrapping_add(at).cast()) }
}

/// Eight numbers.
#[derive(Debug, Clone, Copy)]
#[repr(transparent)]
pub struct Avx512<const FUSED: bool>(__m512d);

/// Four numbers.
#[derive(Debug, Clone, Copy)]
#[repr(transparent)]
pub struct Avx2<const FUSED: bool>(__m256d);

/// Two numbers; there is nothing to fuse with.
#[derive(Debug, Clone, Copy)]
#[repr(transparent)]
pub struct Sse2<const FUSED: bool>(__m128d);

/// The binary operators of a vector type, with a vector and with a number on the right.
macro_rules! operators {
    ($name:ident, $($op:ident $method:ident $intrinsic:ident),+) => {$(
        impl<const FUSED: bool> $op for $name<FUSED> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: (1)
                #[allow(unused_unsafe)]
                Self(unsafe { $intrinsic(self.0, other.0) })
            }
        }
        impl<const FUSED: bool> $op<f64> for $name<FUSED> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                self.$method(Self::splat(other))
            }
        }
    )+};
}

/// A vector type from its intrinsics; in each block marked (1) a value or type parameter of the type is at hand, so the
/// processor has the instructions (see the module's documentation), and no intrinsic used there asks for more. Those of SSE2 are safe
/// to call, as every x86-64 has them.
macro_rules! vector {
    ($name:ident, $width:literal,
     $splat:ident $add:ident $sub:ident $mul:ident $div:ident $sqrt:ident $load:ident $store:ident,
     |$f:ident, $g:ident, $h:ident| $mul_add:expr, $neg_mul_add:expr, |$x:ident| $abs:expr, |$s:ident, $yes:ident, $no:ident| $select:expr,
     |$l:ident, $b:ident| $within:expr $(, $columns:item)?) => {
        operators!($name, Add add $add, Sub sub $sub, Mul mul $mul, Div div $div);
        impl<const FUSED: bool> $name<FUSED> {
            #[inline(always)]
            fn splat(x: f64) -> Self {
                // SAFETY: (1)
                #[allow(unused_unsafe)]
                Self(unsafe { $splat(x) })
            }
            #[inline(always)]
            fn each(self, f: impl Fn(f64) -> f64) -> Self {
                let mut x = [0.0; $width];
                self.store(&mut x);
                for x in &mut x {
                    *x = f(*x);
                }
                Self::load(&x)
            }
        }
        impl<const FUSED: bool> Neg for $name<FUSED> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                // The sign of zero turns over, too.
                Self::splat(-0.0) - self
            }
        }
        impl<const FUSED: bool> AddAssign for $name<FUSED> {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }
        impl<const FUSED: bool> SubAssign for $name<FUSED> {
            #[inline(always)]
            fn sub_assign(&mut self, other: Self) {
                *self = *self - other;
            }
        }
        impl<const FUSED: bool> Lane for $name<FUSED> {
            const WIDTH: usize = $width;
            #[inline(always)]
            fn load(from: &[f64]) -> Self {
                let from: &[f64; $width] = from[..$width].try_into().expect("as long as the range");
                // SAFETY: (1), and the array has as many numbers as are read.
                Self(unsafe { $load(from.as_ptr()) })
            }
            $($columns)?
            #[inline(always)]
            fn store(self, to: &mut [f64]) {
                let to: &mut [f64; $width] = (&mut to[..$width]).try_into().expect("as long as the range");
                // SAFETY: (1), and the array has as many numbers as are written.
                unsafe { $store(to.as_mut_ptr(), self.0) }
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                let ($f, $g, $h) = (self, a, b);
                $mul_add
            }
            #[inline(always)]
            fn neg_mul_add(self, a: Self, b: Self) -> Self {
                let ($f, $g, $h) = (self, a, b);
                $neg_mul_add
            }
            #[inline(always)]
            fn first(self) -> f64 {
                let mut x = [0.0; $width];
                self.store(&mut x);
                x[0]
            }
            #[inline(always)]
            fn any_within(self, bound: Self) -> bool {
                let ($l, $b) = (self.0, bound.0);
                // SAFETY: (1)
                #[allow(unused_unsafe)]
                unsafe { $within }
            }
        }
        impl<const FUSED: bool> Real for $name<FUSED> {
            #[inline(always)]
            fn constant(x: f64) -> Self {
                Self::splat(x)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                // SAFETY: (1)
                #[allow(unused_unsafe)]
                Self(unsafe { $sqrt(self.0) })
            }
            #[inline(always)]
            fn sin_cos(self) -> (Self, Self) {
                angles::sin_cos(self)
            }
            #[inline(always)]
            fn exp(self) -> Self {
                self.each(f64::exp)
            }
            #[inline(always)]
            fn ln(self) -> Self {
                self.each(f64::ln)
            }
            #[inline(always)]
            fn tanh(self) -> Self {
                self.each(f64::tanh)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                let $x = self.0;
                // SAFETY: (1)
                #[allow(unused_unsafe)]
                Self(unsafe { $abs })
            }
            #[inline(always)]
            fn if_positive(self, yes: Self, no: Self) -> Self {
                let ($s, $yes, $no) = (self.0, yes.0, no.0);
                // SAFETY: (1)
                #[allow(unused_unsafe)]
                Self(unsafe { $select })
            }
            #[inline(always)]
            fn positive(self) -> bool {
                self.first() > 0.0
            }
            #[inline(always)]
            fn size(self) -> f64 {
                let mut x = [0.0; $width];
                self.store(&mut x);
                x.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
            }
        }
    };
}

vector!(Avx512, 8,
_mm512_set1_pd _mm512_add_pd _mm512_sub_pd _mm512_mul_pd _mm512_div_pd _mm512_sqrt_pd _mm512_loadu_pd _mm512_storeu_pd,
|x, a, b| if FUSED {
    // SAFETY: (1)
    Self(unsafe { _mm512_fmadd_pd(x.0, a.0, b.0) })
} else {
    x * a + b
},
if FUSED {
    // SAFETY: (1)
    Self(unsafe { _mm512_fnmadd_pd(x.0, a.0, b.0) })
} else {
    b - x * a
},
|x| _mm512_abs_pd(x),
|x, yes, no| {
    _mm512_mask_blend_pd(_mm512_cmp_pd_mask::<_CMP_GT_OQ>(x, _mm512_setzero_pd()), no, yes)
},
|x, bound| _mm512_cmp_pd_mask::<_CMP_LE_OQ>(x, bound) != 0,
#[inline(always)]
fn columns<const N: usize>(records: &[f64], begin: &[usize], size: usize, k: usize) -> [Self; N] {
    const { assert!(N <= 8) };
    let mut r = [Self::zero(); 8];
    for lane in 0..8 {
        r[lane] = Self::load(&records[(begin[lane] + k) * size..][..8]);
    }
    // Pairs of rows interleaved, then quarters gathered: a transposition.
    let mut all = [Self::zero(); 8];
    for odd in 0..2 {
        let mut t = [Self::zero(); 4];
        for pair in 0..4 {
            let (a, b) = (r[2 * pair].0, r[2 * pair + 1].0);
            // SAFETY: (1)
            t[pair] = Self(unsafe { if odd == 0 { _mm512_unpacklo_pd(a, b) } else { _mm512_unpackhi_pd(a, b) } });
        }
        // SAFETY: (1)
        unsafe {
            let (a, b) = (
                _mm512_shuffle_f64x2::<0x88>(t[0].0, t[1].0),
                _mm512_shuffle_f64x2::<0x88>(t[2].0, t[3].0),
            );
            let (c, d) = (
                _mm512_shuffle_f64x2::<0xdd>(t[0].0, t[1].0),
                _mm512_shuffle_f64x2::<0xdd>(t[2].0, t[3].0),
            );
            all[odd] = Self(_mm512_shuffle_f64x2::<0x88>(a, b));
            all[odd + 2] = Self(_mm512_shuffle_f64x2::<0x88>(c, d));
            all[odd + 4] = Self(_mm512_shuffle_f64x2::<0xdd>(a, b));
            all[odd + 6] = Self(_mm512_shuffle_f64x2::<0xdd>(c, d));
        }
    }
    let mut columns = [Self::zero(); N];
    columns.copy_from_slice(&all[..N]);
    columns
});

vector!(Avx2, 4,
    _mm256_set1_pd _mm256_add_pd _mm256_sub_pd _mm256_mul_pd _mm256_div_pd _mm256_sqrt_pd _mm256_loadu_pd _mm256_storeu_pd,
    |x, a, b| if FUSED {
        // SAFETY: (1)
        Self(unsafe { _mm256_fmadd_pd(x.0, a.0, b.0) })
    } else {
        x * a + b
    },
    if FUSED {
        // SAFETY: (1)
        Self(unsafe { _mm256_fnmadd_pd(x.0, a.0, b.0) })
    } else {
        b - x * a
    },
    |x| _mm256_andnot_pd(_mm256_set1_pd(-0.0), x),
    |x, yes, no| _mm256_blendv_pd(no, yes, _mm256_cmp_pd::<_CMP_GT_OQ>(x, _mm256_setzero_pd())),
    |x, bound| _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(x, bound)) != 0);

vector!(Sse2, 2,
    _mm_set1_pd _mm_add_pd _mm_sub_pd _mm_mul_pd _mm_div_pd _mm_sqrt_pd _mm_loadu_pd _mm_storeu_pd,
    |x, a, b| x * a + b, b - x * a,
    |x| _mm_andnot_pd(_mm_set1_pd(-0.0), x),
    |x, yes, no| {
        let positive = _mm_cmpgt_pd(x, _mm_setzero_pd());
        _mm_or_pd(_mm_and_pd(positive, yes), _mm_andnot_pd(positive, no))
    },
    |x, bound| _mm_movemask_pd(_mm_cmple_pd(x, bound)) != 0);
