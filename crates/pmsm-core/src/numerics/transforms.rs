//! Clarke and Park transforms, amplitude-invariant, d axis on the magnet flux.
//!
//! A balanced set of phase quantities of amplitude A becomes a vector of length A. Angles are electrical
//! radians between phase a's axis and the d axis.

use crate::numerics::real::Real;

/// √3.
pub const SQRT3: f64 = 1.732_050_807_568_877_2;

/// Phase quantities to stationary α, β (the zero sequence is dropped).
#[inline(always)]
pub fn clarke<T: Real>(abc: [T; 3]) -> [T; 2] {
    [(abc[0] * 2.0 - abc[1] - abc[2]) * (1.0 / 3.0), (abc[1] - abc[2]) * (1.0 / SQRT3)]
}

/// Stationary α, β to phase quantities without zero sequence.
#[inline(always)]
pub fn inverse_clarke<T: Real>(ab: [T; 2]) -> [T; 3] {
    let (half, beta) = (ab[0] * -0.5, ab[1] * (SQRT3 / 2.0));
    [ab[0], half + beta, half - beta]
}

/// Turns a vector by the angle whose cosine and sine are given.
#[inline(always)]
pub fn rotate<T: Real>(x: [T; 2], cos: T, sin: T) -> [T; 2] {
    [x[0] * cos - x[1] * sin, x[0] * sin + x[1] * cos]
}

/// Phase quantities to the rotor frame at the electrical angle with the given cosine and sine.
#[inline(always)]
pub fn park<T: Real>(abc: [T; 3], cos: T, sin: T) -> [T; 2] {
    rotate(clarke(abc), cos, -sin)
}

/// Rotor-frame quantities to phase quantities.
#[inline(always)]
pub fn inverse_park<T: Real>(dq: [T; 2], cos: T, sin: T) -> [T; 3] {
    inverse_clarke(rotate(dq, cos, sin))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(10_000))]
        #[test]
        fn park_and_its_inverse_cancel(d in -1e3..1e3f64, q in -1e3..1e3f64, angle in -100.0..100.0f64) {
            let (s, c) = angle.sin_cos();
            let abc = inverse_park([d, q], c, s);
            let back = park(abc, c, s);
            // Some twenty products and sums of numbers no larger than both together, half an ε each.
            let allowed = 10.0 * f64::EPSILON * (d.abs() + q.abs());
            prop_assert!((back[0] - d).abs() <= allowed && (back[1] - q).abs() <= allowed);
            prop_assert!((abc[0] + abc[1] + abc[2]).abs() <= allowed);
        }

        #[test]
        fn power_is_three_halves_of_the_dq_product(
            v in prop::array::uniform2(-1e3..1e3f64), i in prop::array::uniform2(-1e3..1e3f64), angle in -10.0..10.0f64
        ) {
            let (s, c) = angle.sin_cos();
            let (va, ia) = (inverse_park(v, c, s), inverse_park(i, c, s));
            let phases: f64 = (0..3).map(|x| va[x] * ia[x]).sum();
            // Each phase quantity takes some six roundings, three products and their sum as many again, half an ε each.
            let size = 3.0 * (v[0].abs() + v[1].abs()) * (i[0].abs() + i[1].abs());
            prop_assert!((phases - 1.5 * (v[0] * i[0] + v[1] * i[1])).abs() <= 10.0 * f64::EPSILON * size);
        }
    }

    #[test]
    fn amplitude_is_kept() {
        let theta: f64 = 0.7;
        let abc = [theta.cos(), (theta - TAU / 3.0).cos(), (theta + TAU / 3.0).cos()];
        let dq = park(abc, theta.cos(), theta.sin());
        assert!((dq[0] - 1.0).abs() < 1e-15 && dq[1].abs() < 1e-15);
    }
}
