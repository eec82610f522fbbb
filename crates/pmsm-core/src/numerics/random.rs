//! Random numbers by counter: a number is a function of the seed and of the place where it is used, so it depends on
//! neither the order of evaluation nor the number of threads. Built from integer arithmetic and the four operations
//! alone, so that every platform draws the same bits.

/// Two numbers in [0, 1) with 53 bits each, belonging to this seed and place and to no other.
pub fn uniform_pair(seed: u64, place: [u32; 4]) -> (f64, f64) {
    let word = philox(place, [seed as u32, (seed >> 32) as u32]);
    let unit =
        |high: u32, low: u32| ((u64::from(high) << 32 | u64::from(low)) >> 11) as f64 * (0.5 * f64::EPSILON);
    (unit(word[0], word[1]), unit(word[2], word[3]))
}

/// Half a step off zero, whose quantile is infinite.
const INSIDE: f64 = 0.25 * f64::EPSILON;

/// Two independent standard normal numbers belonging to this seed and place.
pub fn normal_pair(seed: u64, place: [u32; 4]) -> (f64, f64) {
    let (a, b) = uniform_pair(seed, place);
    (normal_quantile(a + INSIDE), normal_quantile(b + INSIDE))
}

/// The first of them alone.
pub fn normal(seed: u64, place: [u32; 4]) -> f64 {
    normal_quantile(uniform_pair(seed, place).0 + INSIDE)
}

/// Philox4x32-10: counter-based generator of Salmon, Moraes, Dror & Shaw, "Parallel random numbers: as easy as 1, 2,
/// 3", SC11.
fn philox(mut counter: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
    for _ in 0..10 {
        let a = u64::from(counter[0]) * 0xD251_1F53;
        let b = u64::from(counter[2]) * 0xCD9E_8D57;
        counter = [
            (b >> 32) as u32 ^ counter[1] ^ key[0],
            b as u32,
            (a >> 32) as u32 ^ counter[3] ^ key[1],
            a as u32,
        ];
        key = [key[0].wrapping_add(0x9E37_79B9), key[1].wrapping_add(0xBB67_AE85)];
    }
    counter
}

/// Quantile of the standard normal distribution for 0 < p < 1, to about 16 digits: algorithm AS 241 (PPND16) of
/// Wichura, Applied Statistics 37 (1988) 477.
fn normal_quantile(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180625 - q * q;
        return q * ratio(r, &CENTRE);
    }
    let r = (-logarithm(if q < 0.0 { p } else { 1.0 - p })).sqrt();
    let size = if r <= 5.0 { ratio(r - 1.6, &SHOULDER) } else { ratio(r - 5.0, &TAIL) };
    if q < 0.0 { -size } else { size }
}

/// Numerator and denominator of a rational function, highest power first.
type Rational = [[f64; 8]; 2];

fn ratio(r: f64, polynomials: &Rational) -> f64 {
    let [above, below] = polynomials.map(|c| c.iter().fold(0.0, |sum, c| sum * r + c));
    above / below
}

const CENTRE: Rational = [
    [
        2_509.080_928_730_122_7,
        33_430.575_583_588_13,
        67_265.770_927_008_7,
        45_921.953_931_549_87,
        13_731.693_765_509_46,
        1_971.590_950_306_551_3,
        133.141_667_891_784_38,
        3.387_132_872_796_366_5,
    ],
    [
        5_226.495_278_852_854,
        28_729.085_735_721_943,
        39_307.895_800_092_71,
        21_213.794_301_586_597,
        5_394.196_021_424_751,
        687.187_007_492_057_9,
        42.313_330_701_600_91,
        1.0,
    ],
];
const SHOULDER: Rational = [
    [
        7.745_450_142_783_414e-4,
        0.022_723_844_989_269_184,
        0.241_780_725_177_450_6,
        1.270_458_252_452_368_4,
        3.647_848_324_763_204_5,
        5.769_497_221_460_691,
        4.630_337_846_156_546,
        1.423_437_110_749_683_5,
    ],
    [
        1.050_750_071_644_416_9e-9,
        5.475_938_084_995_345e-4,
        0.015_198_666_563_616_457,
        0.148_103_976_427_480_08,
        0.689_767_334_985_1,
        1.676_384_830_183_803_8,
        2.053_191_626_637_759,
        1.0,
    ],
];
const TAIL: Rational = [
    [
        2.010_334_399_292_288_1e-7,
        2.711_555_568_743_487_6e-5,
        0.001_242_660_947_388_078_4,
        0.026_532_189_526_576_124,
        0.296_560_571_828_504_87,
        1.784_826_539_917_291_3,
        5.463_784_911_164_114,
        6.657_904_643_501_103,
    ],
    [
        2.044_263_103_389_939_8e-15,
        1.421_511_758_316_446e-7,
        1.846_318_317_510_054_8e-5,
        7.868_691_311_456_133e-4,
        0.014_875_361_290_850_615,
        0.136_929_880_922_735_8,
        0.599_832_206_555_888,
        1.0,
    ],
];

/// Natural logarithm of a normal positive number by the four operations alone: x = m·2^e with m in [√½, √2), then
/// ln m = 2·artanh((m − 1)/(m + 1)) as a series.
fn logarithm(x: f64) -> f64 {
    let bits = x.to_bits();
    let mut exponent = ((bits >> 52) & 0x7ff) as i32 - 1023;
    let mut m = f64::from_bits((bits & 0x000f_ffff_ffff_ffff) | 0x3ff0_0000_0000_0000);
    if m > std::f64::consts::SQRT_2 {
        m *= 0.5;
        exponent += 1;
    }
    let z = (m - 1.0) / (m + 1.0);
    let square = z * z;
    let series = (0..12).rev().fold(0.0, |sum, k| sum * square + 1.0 / f64::from(2 * k + 1));
    f64::from(exponent) * std::f64::consts::LN_2 + 2.0 * z * series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_of_a_pair_is_the_first_of_both() {
        for k in 0..100 {
            let place = [k, 3, 0, 1];
            assert_eq!(normal(7, place), normal_pair(7, place).0);
        }
    }

    #[test]
    fn philox_gives_its_published_answers() {
        assert_eq!(philox([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(
            philox([u32::MAX; 4], [u32::MAX; 2]),
            [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]
        );
        let pi = [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344];
        assert_eq!(
            philox(pi, [0xa409_3822, 0x299f_31d0]),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
        );
    }

    #[test]
    fn numbers_are_uniform_and_differ_by_every_index() {
        let n = 20_000;
        let (mut sum, mut square, mut product) = (0.0, 0.0, 0.0);
        for i in 0..n {
            let (a, b) = uniform_pair(5, [i, 3, 1, 0]);
            assert!((0.0..1.0).contains(&a) && (0.0..1.0).contains(&b));
            sum += a;
            square += a * a;
            product += (a - 0.5) * (b - 0.5);
        }
        let n = f64::from(n);
        assert!((sum / n - 0.5).abs() < 0.01 && (square / n - 1.0 / 3.0).abs() < 0.01);
        assert!((product / n).abs() < 0.003);
        let here = uniform_pair(1, [2, 3, 4, 0]);
        for (seed, place) in [
            (1 << 32 | 1, [2, 3, 4, 0]),
            (1, [3, 3, 4, 0]),
            (1, [2, 4, 4, 0]),
            (1, [2, 3, 5, 0]),
            (1, [2, 3, 4, 1]),
        ] {
            assert_ne!(here, uniform_pair(seed, place));
        }
    }

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (p, x) in [
            (0.5, 0.0),
            (0.55, 0.125_661_346_855_074_13),
            (0.7, 0.524_400_512_708_040_7),
            (0.975, 1.959_963_984_540_054),
            (0.9, 1.281_551_565_544_600_4),
            (1e-3, -3.090_232_306_167_813_5),
            (1e-9, -5.997_807_015_007_686_5),
            (1e-15, -7.941_345_326_170_996),
            (1e-100, -21.273_453_560_965_32),
        ] {
            assert!((normal_quantile(p) - x).abs() < 2e-15 * x.abs().max(1.0), "{p}: {}", normal_quantile(p));
        }
    }

    #[test]
    fn the_logarithm_is_that_of_the_library() {
        for k in 1..2000 {
            let x = f64::from(k).powi(7) * 1e-20;
            assert!((logarithm(x) - x.ln()).abs() <= 4e-16 * x.ln().abs().max(1.0), "{x}");
        }
    }

    #[test]
    fn normal_numbers_have_mean_zero_variance_one_and_kurtosis_three() {
        let n = 50_000;
        let mut moments = [0.0; 4];
        for k in 0..n {
            let (a, b) = normal_pair(9, [k, 0, 0, 1]);
            for x in [a, b] {
                for (power, moment) in moments.iter_mut().enumerate() {
                    *moment += x.powi(power as i32 + 1);
                }
            }
        }
        let [mean, variance, skew, kurtosis] = moments.map(|m| m / f64::from(2 * n));
        assert!(mean.abs() < 0.015 && (variance - 1.0).abs() < 0.02, "{mean} {variance}");
        assert!(skew.abs() < 0.03 && (kurtosis - 3.0).abs() < 0.1, "{skew} {kurtosis}");
    }
}
