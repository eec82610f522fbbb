//! Vectors of x86-64, and the only unsafe code of the crate.
//!
//! Why it is sound: the types [`Avx2`] and [`Avx512`] are visible in this module alone, and a job meets them as the type
//! parameter of [`super::Job::run`], called by [`avx2`] and [`avx512`] after they have asked the processor, or as the [`Lane::Half`] of
//! the latter, for which AVX-512F stands good: it includes AVX2 and FMA. So whoever holds such a value, or calls a function of
//! such a type, runs on a processor that has the instructions.

#![allow(unsafe_code)]

mod entry;

use super::{Lane, angles};
use crate::numerics::real::{Real, Task};
use std::arch::x86_64::*;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

pub use entry::{avx2, avx512};

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

/// Columns number `n` and `next`, where they are asked for, from the pairs of numbers that begin with number `n` of the records in `even`
/// and in `odd` lanes.
macro_rules! pair {
    ($columns:ident $n:literal $next:literal, $parts:ident $place:ident [$($even:literal)+] [$($odd:literal)+], $low:ident $high:ident) => {
        if const { $n < N } {
            // SAFETY: (1), and the numbers that are read end no later than the eight of the last record, which are there.
            unsafe {
                let even = $parts([$($place[$even].add($n)),+]);
                let odd = $parts([$($place[$odd].add($n)),+]);
                $columns[$n] = Self($low(even, odd));
                if const { $next < N } {
                    $columns[$next] = Self($high(even, odd));
                }
            }
        }
    };
}

/// [`Lane::columns`] by pairs of numbers that `parts` brings into one vector.
macro_rules! columns {
    ($width:literal, $parts:ident [$($even:literal)+] [$($odd:literal)+], $low:ident $high:ident) => {
        #[inline(always)]
        fn columns<const N: usize>(records: &[f64], begin: &[usize], size: usize, k: usize) -> [Self; N] {
            const { assert!(N <= 8) };
            // One look at the last of them in place of one at each.
            let begin: &[usize; $width] = begin[..$width].try_into().expect("as long as the range");
            let last = begin.iter().fold(0, |last, begin| last.max(*begin));
            assert!(last.saturating_add(k).saturating_mul(size).saturating_add(8) <= records.len(), "no such record");
            let mut place = [records.as_ptr(); $width];
            for lane in 0..$width {
                place[lane] = place[lane].wrapping_add((begin[lane] + k) * size);
            }
            let mut columns = [Self::zero(); N];
            pair!(columns 0 1, $parts place [$($even)+] [$($odd)+], $low $high);
            pair!(columns 2 3, $parts place [$($even)+] [$($odd)+], $low $high);
            pair!(columns 4 5, $parts place [$($even)+] [$($odd)+], $low $high);
            pair!(columns 6 7, $parts place [$($even)+] [$($odd)+], $low $high);
            columns
        }
    };
}

/// A vector type from its intrinsics; in each block marked (1) a value or type parameter of the type is at hand, or of the one that it
/// is half of, so the processor has the instructions (see the module's documentation), and no intrinsic used there asks for more. Those
/// of SSE2 are safe to call, as every x86-64 has them.
macro_rules! vector {
    ($name:ident, $width:literal, $features:literal, $half:ty,
     $splat:ident $add:ident $sub:ident $mul:ident $div:ident $sqrt:ident $load:ident $store:ident,
     |$f:ident, $g:ident, $h:ident| $mul_add:expr, $neg_mul_add:expr, |$x:ident| $abs:expr, |$s:ident, $yes:ident, $no:ident| $select:expr,
     |$l:ident, $b:ident| $within:expr $(, columns!($($columns:tt)+))?) => {
        operators!($name, Add add $add, Sub sub $sub, Mul mul $mul, Div div $div);
        impl<const FUSED: bool> $name<FUSED> {
            #[inline(always)]
            fn splat(x: f64) -> Self {
                // SAFETY: (1)
                #[allow(unused_unsafe)]
                Self(unsafe { $splat(x) })
            }
            // What takes so many instructions that a call is nothing is called: inlined, it is most of what there is to compile.
            #[inline(never)]
            #[target_feature(enable = $features)]
            fn each(self, f: fn(f64) -> f64) -> Self {
                let mut x = [0.0; $width];
                self.store(&mut x);
                for x in &mut x {
                    *x = f(*x);
                }
                Self::load(&x)
            }
            #[inline(never)]
            #[target_feature(enable = $features)]
            fn turned(self) -> (Self, Self) {
                angles::sin_cos(self)
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
            type Half = $half;
            #[inline(always)]
            fn load(from: &[f64]) -> Self {
                let from: &[f64; $width] = from[..$width].try_into().expect("as long as the range");
                // SAFETY: (1), and the array has as many numbers as are read.
                Self(unsafe { $load(from.as_ptr()) })
            }
            $(columns!($($columns)+);)?
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
                // SAFETY: (1)
                #[allow(unused_unsafe)]
                unsafe { self.turned() }
            }
            #[inline(always)]
            fn exp(self) -> Self {
                // SAFETY: (1)
                #[allow(unused_unsafe)]
                unsafe { self.each(f64::exp) }
            }
            #[inline(always)]
            fn ln(self) -> Self {
                // SAFETY: (1)
                #[allow(unused_unsafe)]
                unsafe { self.each(f64::ln) }
            }
            #[inline(always)]
            fn tanh(self) -> Self {
                // SAFETY: (1)
                #[allow(unused_unsafe)]
                unsafe { self.each(f64::tanh) }
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
            fn apart<K: Task<U>, U: Real>(task: K) -> K::Output {
                #[inline(never)]
                #[target_feature(enable = $features)]
                fn called<K: Task<U>, U: Real>(task: K) -> K::Output {
                    task.run()
                }
                // SAFETY: (1)
                #[allow(unused_unsafe)]
                unsafe { called(task) }
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

vector!(Avx512, 8, "avx512f,avx512vl", Avx2<FUSED>,
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
columns!(8, quarters [0 2 4 6] [1 3 5 7], _mm512_unpacklo_pd _mm512_unpackhi_pd));

/// A vector whose quarters are read from four places.
///
/// # Safety
/// The processor has AVX-512F, and two numbers stand at each place.
#[inline(always)]
unsafe fn quarters(from: [*const f64; 4]) -> __m512d {
    // SAFETY: the caller's.
    unsafe {
        let [a, b, c, d] = from;
        let one = _mm512_castps128_ps512(_mm_loadu_ps(a.cast()));
        let two = _mm512_mask_broadcast_f32x4(one, 0x00f0, _mm_loadu_ps(b.cast()));
        let three = _mm512_mask_broadcast_f32x4(two, 0x0f00, _mm_loadu_ps(c.cast()));
        _mm512_castps_pd(_mm512_mask_broadcast_f32x4(three, 0xf000, _mm_loadu_ps(d.cast())))
    }
}

/// A vector whose halves are read from two places.
///
/// # Safety
/// The processor has AVX, and two numbers stand at each place.
#[inline(always)]
unsafe fn halves([a, b]: [*const f64; 2]) -> __m256d {
    // SAFETY: the caller's.
    unsafe { _mm256_insertf128_pd::<1>(_mm256_castpd128_pd256(_mm_loadu_pd(a)), _mm_loadu_pd(b)) }
}

vector!(Avx2, 4, "avx2,fma", Self,
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
    |x| _mm256_max_pd(x, _mm256_sub_pd(_mm256_setzero_pd(), x)),
    |x, yes, no| select(x, yes, no),
    |x, bound| _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(x, bound)) != 0,
    columns!(4, halves [0 2] [1 3], _mm256_unpacklo_pd _mm256_unpackhi_pd));

/// `yes` where `x` is positive, else `no`. Both this and the absolute value above are written so that vectors of numbers are not taken for
/// vectors of bits where they are inlined: the compiler is minutes at getting a long function rid of those.
#[inline]
#[target_feature(enable = "avx")]
fn select(x: __m256d, yes: __m256d, no: __m256d) -> __m256d {
    _mm256_blendv_pd(no, yes, _mm256_cmp_pd::<_CMP_GT_OQ>(x, _mm256_setzero_pd()))
}

vector!(Sse2, 2, "sse2", Self,
    _mm_set1_pd _mm_add_pd _mm_sub_pd _mm_mul_pd _mm_div_pd _mm_sqrt_pd _mm_loadu_pd _mm_storeu_pd,
    |x, a, b| x * a + b, b - x * a,
    |x| _mm_andnot_pd(_mm_set1_pd(-0.0), x),
    |x, yes, no| {
        let positive = _mm_cmpgt_pd(x, _mm_setzero_pd());
        _mm_or_pd(_mm_and_pd(positive, yes), _mm_andnot_pd(positive, no))
    },
    |x, bound| _mm_movemask_pd(_mm_cmple_pd(x, bound)) != 0);
