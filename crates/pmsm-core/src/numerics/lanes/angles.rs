//! Sine and cosine in all lanes at once, with the bits of one number at a time.
//!
//! The steps are those of `libm::sincos` (FreeBSD msun, `e_rem_pio2.c`, `k_sin.c` and `k_cos.c`), operation by operation: what is
//! beyond the nearest multiple of π/2, in two numbers, and a polynomial each. Where that may take another branch, at odd multiples of
//! π/4, small ones of π/2, and beyond [`MOST`], the lane is computed by itself.

use super::Lane;
use crate::numerics::real::Real;
use std::f64::consts::{FRAC_2_PI, FRAC_PI_4};

/// Largest angle, rad.
const MOST: f64 = 1.6e6;
/// Adding it rounds to a whole number.
const TO_INT: f64 = 1.5 / f64::EPSILON;
/// The first 33 bits of π/2.
const PIO2_1: f64 = 1.570_796_326_734_125_6;
/// What they leave of it.
const PIO2_1T: f64 = 6.077_100_506_506_192e-11;
/// The next 33 bits.
const PIO2_2: f64 = 6.077_100_506_303_966e-11;
/// What these leave.
const PIO2_2T: f64 = 2.022_266_248_795_950_6e-21;
/// A remainder up to here is that of the nearest multiple for certain.
const NEAREST: f64 = FRAC_PI_4 - 1e-4;
/// A remainder below this share of the power of two in the angle has lost too many digits, and after a second round below that.
const LOST: f64 = 1.0 / 65536.0;
const LOST_AGAIN: f64 = LOST * LOST * LOST * 0.5;
/// Up to this angle, rad, there is no second round.
const CLOSE: f64 = 7.1;
/// Angles below it are their own sine.
const TINY: f64 = 1e-8;

const S: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
const C: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// Sine and cosine of each entry.
#[inline(always)]
pub fn sin_cos<V: Lane>(x: V) -> (V, V) {
    let constant = V::constant;
    let n = (x * FRAC_2_PI + TO_INT) - TO_INT;
    let r = x - n * PIO2_1;
    let w = n * PIO2_1T;
    let y = r - w;
    let turned = n.abs() - 0.5;
    // Where few digits are left, the next 33 bits of π/2.
    let power = power_of_two(x);
    let lost = power * LOST - y.abs();
    let again = r - n * PIO2_2;
    let rest = n * PIO2_2T - ((r - again) - n * PIO2_2);
    let (r, w) = (lost.if_positive(again, r), lost.if_positive(rest, w));
    let y = r - w;
    let tail = (r - y) - w;

    let far = (x.abs() - CLOSE).if_positive(y.abs() - power * LOST_AGAIN, -V::one());
    let kept = turned.if_positive(lost.if_positive(far, V::one()), V::one());
    let nearest = (constant(NEAREST) - y.abs()).if_positive(kept, -V::one());
    let plain = (constant(MOST) - x.abs()).if_positive(nearest, -V::one());

    let z = y * y;
    let w = z * z;
    let v = z * y;
    let poly = (z * S[3] + S[2]) * z + S[1] + z * w * (z * S[5] + S[4]);
    let bent = y - ((z * (tail * 0.5 - v * poly) - tail) - v * S[0]);
    let straight = y + v * (z * poly + S[0]);
    let tiny = constant(TINY) - x.abs();
    let sin = turned.if_positive(bent, tiny.if_positive(x, straight));

    let poly = z * ((z * C[2] + C[1]) * z + C[0]) + w * w * ((z * C[5] + C[4]) * z + C[3]);
    let half = z * 0.5;
    let w = V::one() - half;
    let cos = w + (((V::one() - w) - half) + (z * poly - y * tail));

    // n modulo four, as 0, ¼, ±½ or −¼.
    let quarter = n * 0.25;
    let quarter = quarter - ((quarter + TO_INT) - TO_INT);
    let odd = (quarter.abs() - 0.125) * (constant(0.375) - quarter.abs());
    let (s, c) = (odd.if_positive(cos, sin), odd.if_positive(sin, cos));
    let lower = (-quarter - 0.125).if_positive(V::one(), quarter - 0.375);
    let left = (quarter - 0.125).if_positive(V::one(), -quarter - 0.375);
    let (s, c) = (lower.if_positive(-s, s), left.if_positive(-c, c));

    if V::one().any_within(plain.if_positive(V::zero(), V::one())) {
        return one_by_one(x, plain, s, c);
    }
    (s, c)
}

/// The largest power of two that is not above the size of each entry: the "unit in the first place" of S. M. Rump, T. Ogita and S. Oishi,
/// "Accurate floating-point summation, part I", SIAM J. Sci. Comput. 31 (2008).
#[inline(always)]
fn power_of_two<V: Lane>(x: V) -> V {
    let q = x * (2f64.powi(52) + 1.0);
    (q - q * (1.0 - 0.5 * f64::EPSILON)).abs()
}

/// The same with those lanes computed by themselves that are not `plain`.
#[cold]
#[inline(never)]
fn one_by_one<V: Lane>(x: V, plain: V, s: V, c: V) -> (V, V) {
    let mut rows = [[0.0; 8]; 4];
    for (row, value) in rows.iter_mut().zip([x, plain, s, c]) {
        value.store(row);
    }
    let [x, plain, mut s, mut c] = rows;
    for k in 0..V::WIDTH {
        if plain[k].is_nan() || plain[k] <= 0.0 {
            (s[k], c[k]) = Real::sin_cos(x[k]);
        }
    }
    (V::load(&s), V::load(&c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::lanes::{Job, Path, Rounding, run};
    use proptest::prelude::*;

    struct All<'a>(&'a [f64; 8]);

    impl Job for All<'_> {
        type Output = [[u64; 2]; 8];
        #[inline(always)]
        fn run<V: Lane>(self) -> Self::Output {
            let (mut sin, mut cos) = ([0.0; 8], [0.0; 8]);
            for at in (0..8).step_by(V::WIDTH) {
                let (s, c) = sin_cos(V::load(&self.0[at..]));
                s.store(&mut sin[at..]);
                c.store(&mut cos[at..]);
            }
            std::array::from_fn(|k| [sin[k].to_bits(), cos[k].to_bits()])
        }
    }

    fn same_bits(x: [f64; 8]) {
        let expected = x.map(|x| {
            let (s, c) = Real::sin_cos(x);
            [s.to_bits(), c.to_bits()]
        });
        for path in Path::ALL {
            assert_eq!(run(path, Rounding::Reproducible, All(&x)), expected, "{path:?} {x:?}");
        }
    }

    #[test]
    fn single_numbers_have_the_same_bits_at_the_branches_of_the_method() {
        for k in 0..4000 {
            let near = f64::from(k) * FRAC_PI_4;
            let off = [0.0, 1e-16, 1e-12, 3e-10, 1e-7, 1.4e-5, 3.1e-5, 1.1e-4];
            same_bits(off.map(|off| near * (1.0 + off)));
            same_bits(off.map(|off| -near * (1.0 - off)));
        }
        same_bits([0.0, -0.0, 1e-300, -1e-9, 1.1e-8, 2e-8, 1e-5, 0.5]);
        for k in (4000..2_000_000).step_by(997) {
            let near = f64::from(k) * FRAC_PI_4;
            same_bits([0.0, 1e-15, 2e-13, 4e-12, 1.1e-10, 3e-9, 1e-8, 5e-7].map(|off| near * (1.0 + off)));
        }
        same_bits([1_599_999.9, 1_600_000.1, 1e7, -1e20, 1e300, -3e5, 2e6, 1.0]);
        let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1.0, 2.0, 3.0, 4.0, 5.0];
        let (all, lanes) = (odd.map(Real::sin_cos), run(Path::best(), Rounding::Reproducible, All(&odd)));
        for (one, [s, c]) in all.into_iter().zip(lanes) {
            let same = |x: f64, bits: u64| x.to_bits() == bits || x.is_nan() && f64::from_bits(bits).is_nan();
            assert!(same(one.0, s) && same(one.1, c), "{one:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        #[test]
        fn single_numbers_have_the_same_bits(
            close in prop::array::uniform4(-8.0..8.0f64), far in prop::array::uniform4(-1.7e6..1.7e6f64),
        ) {
            let [a, b, c, d] = close;
            let [e, f, g, h] = far;
            same_bits([a, b, c, d, e, f, g, h]);
        }
    }
}
