//! Functions of one variable from which a map is made: harmonics of an angle, a swing in time, the direction of rotation,
//! B-splines.

use crate::effect::Env;
use crate::numerics::real::Real;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Most functions of one factor.
pub const MOST: usize = 32;

/// A variable over which a map is laid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Variable {
    /// Electrical angle, rad.
    ThetaE,
    /// Mechanical angle, rad.
    ThetaM,
    /// Electrical speed, rad/s.
    OmegaE,
    /// d-axis current, A.
    ID,
    /// q-axis current, A.
    IQ,
    /// Commanded d-axis voltage, V.
    VD,
    /// Commanded q-axis voltage, V.
    VQ,
    /// Motor torque, N·m.
    TauE,
    /// Time since the first sample, s.
    T,
}

impl Variable {
    /// Column name.
    pub fn name(self) -> &'static str {
        ["theta_e", "theta_m", "omega_e", "i_d", "i_q", "v_d", "v_q", "tau_e", "t"][self as usize]
    }

    /// SI unit.
    pub fn unit(self) -> &'static str {
        ["rad", "rad", "rad/s", "A", "A", "V", "V", "N m", "s"][self as usize]
    }
}

/// Where a map is evaluated.
#[derive(Debug, Clone, Copy)]
pub struct Point<T> {
    /// Where the machine is.
    pub env: Env<T>,
    /// Stator current d, q, A; the voltage equations know it.
    pub i: [T; 2],
    /// Commanded voltage d, q, V; the voltage equations know it.
    pub v: [T; 2],
    /// Motor torque, N·m; the equation of motion knows it.
    pub tau_e: T,
}

impl<T: Real> Point<T> {
    /// The value of a variable.
    #[inline(always)]
    pub fn value(&self, variable: Variable) -> T {
        match variable {
            Variable::ThetaE => self.env.theta_e,
            Variable::ThetaM => self.env.theta_m,
            Variable::OmegaE => self.env.omega_e,
            Variable::ID => self.i[0],
            Variable::IQ => self.i[1],
            Variable::VD => self.v[0],
            Variable::VQ => self.v[1],
            Variable::TauE => self.tau_e,
            Variable::T => self.env.t,
        }
    }
}

/// Uniform B-splines of degree 1, 2 or 3 (de Boor, A Practical Guide to Splines, 1978, chapter IX) over a range, whose ends
/// hold outside it. On the range they are a partition of unity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spline {
    /// The variable.
    pub variable: Variable,
    /// Lower end of the range, in the variable's unit.
    pub low: f64,
    /// Upper end of the range.
    pub high: f64,
    /// Degree of the pieces, 1 to 3.
    pub degree: usize,
    /// Pieces into which the range is divided.
    pub pieces: usize,
    /// Half-width w about zero within which the pieces are narrow, in the variable's unit: they are uniform in x/(w + |x|). Zero for
    /// pieces that are uniform in x.
    pub warp: f64,
    /// Whether there are odd functions alone, each a spline less its mirror image: of a range that is symmetric about zero.
    #[serde(default)]
    pub odd: bool,
}

impl Spline {
    /// A value of the variable on the scale on which the pieces are uniform.
    #[inline(always)]
    fn warped<T: Real>(&self, x: T) -> T {
        if self.warp > 0.0 { x / (x.abs() + self.warp) } else { x }
    }

    #[inline(always)]
    fn fill<T: Real>(&self, at: &Point<T>, out: &mut [T; MOST]) {
        let pieces = self.pieces as f64;
        let (low, high) = (self.warped(self.low), self.warped(self.high));
        let x = (self.warped(at.value(self.variable)) - T::constant(low)) * (pieces / (high - low));
        let x = positive(x);
        let rest = T::constant(pieces) - x;
        let x = rest.if_positive(x, T::constant(pieces));
        for (k, value) in out.iter_mut().enumerate().take(self.count()) {
            *value = self.function(k, x);
            if self.odd {
                *value -= self.function(self.pieces + self.degree - 1 - k, x);
            }
        }
    }

    /// Number of functions.
    pub fn count(&self) -> usize {
        let all = self.pieces + self.degree;
        if self.odd { all / 2 } else { all }
    }

    /// Spline `k` at `x`, in pieces from the lower end.
    #[inline(always)]
    fn function<T: Real>(&self, k: usize, x: T) -> T {
        // It lies symmetrically about its centre; truncated powers of the distance from there.
        let a = (x - T::constant(k as f64 + 0.5 * (1.0 - self.degree as f64))).abs();
        match self.degree {
            1 => positive(T::one() - a),
            2 => {
                let (outer, inner) = (positive(T::constant(1.5) - a), positive(T::constant(0.5) - a));
                (outer.squared() - inner.squared() * 3.0) * 0.5
            }
            _ => {
                let (outer, inner) = (positive(T::constant(2.0) - a), positive(T::one() - a));
                (outer.squared() * outer - inner.squared() * inner * 4.0) * (1.0 / 6.0)
            }
        }
    }
}

/// cos and sin of an angle and of its multiples.
#[inline(always)]
fn multiples<T: Real>(angle: T, out: &mut [T]) {
    let (s, c) = angle.sin_cos();
    let (mut sine, mut cosine) = (s, c);
    for pair in out.chunks_exact_mut(2) {
        (pair[0], pair[1]) = (cosine, sine);
        (cosine, sine) = (cosine * c - sine * s, sine * c + cosine * s);
    }
}

/// The number where it is positive, else zero.
#[inline(always)]
fn positive<T: Real>(x: T) -> T {
    x.if_positive(x, T::zero())
}

fn one() -> usize {
    1
}

/// Functions of one variable.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Factor {
    /// cos and sin of `order`, 2·`order`, … `count`·`order` times an angle.
    Harmonics {
        /// `ThetaE` or `ThetaM`.
        angle: Variable,
        /// Lowest order, periods per revolution.
        order: u32,
        /// Number of orders, at most half of [`MOST`].
        count: usize,
    },
    /// The Fourier series of an angle: 1, then cos and sin of it once to `count` times.
    Fourier {
        /// `ThetaE` or `ThetaM`.
        angle: Variable,
        /// Highest order, less than half of [`MOST`].
        count: usize,
    },
    /// cos and sin of time at one frequency and its multiples.
    Swing {
        /// Lowest frequency, Hz.
        frequency: f64,
        /// Number of frequencies, at most half of [`MOST`].
        #[serde(default = "one")]
        count: usize,
    },
    /// One function for either direction of rotation, (1 ± tanh(ω_e/width))/2.
    Direction {
        /// Electrical speed over which it turns over, rad/s.
        width: f64,
    },
    /// B-splines.
    Spline(Spline),
}

impl Factor {
    /// Number of functions.
    pub fn count(&self) -> usize {
        match self {
            Self::Harmonics { count, .. } | Self::Swing { count, .. } => 2 * count,
            Self::Fourier { count, .. } => 2 * count + 1,
            Self::Direction { .. } => 2,
            Self::Spline(spline) => spline.count(),
        }
    }

    /// The variable on which they depend.
    pub fn variable(&self) -> Variable {
        match self {
            Self::Harmonics { angle, .. } | Self::Fourier { angle, .. } => *angle,
            Self::Swing { .. } => Variable::T,
            Self::Direction { .. } => Variable::OmegaE,
            Self::Spline(spline) => spline.variable,
        }
    }

    /// Writes how the functions change with the electrical angle of a rotor with `n_p` pole pairs, given their values; zero for those of
    /// anything but an angle.
    #[inline(always)]
    pub fn slope<T: Real>(&self, values: &[T; MOST], n_p: f64, out: &mut [T; MOST]) {
        let (angle, order, count, first) = match self {
            Self::Harmonics { angle, order, count } => (angle, f64::from(*order), count, 0),
            Self::Fourier { angle, count } => (angle, 1.0, count, 1),
            _ => return,
        };
        let turns = order / if *angle == Variable::ThetaM { n_p } else { 1.0 };
        let pairs = out[first..].chunks_exact_mut(2).zip(values[first..].chunks_exact(2)).take(*count);
        for (k, (slope, value)) in pairs.enumerate() {
            let rate = turns * (k + 1) as f64;
            (slope[0], slope[1]) = (-value[1] * rate, value[0] * rate);
        }
    }

    /// Writes the functions' values and returns their number.
    #[inline(always)]
    pub fn fill<T: Real>(&self, at: &Point<T>, out: &mut [T; MOST]) -> usize {
        match self {
            Self::Harmonics { angle, order, count } => {
                multiples(at.value(*angle) * f64::from(*order), &mut out[..2 * count]);
            }
            Self::Fourier { angle, count } => {
                out[0] = T::one();
                multiples(at.value(*angle), &mut out[1..=2 * count]);
            }
            Self::Swing { frequency, count } => {
                multiples(at.env.t * (TAU * frequency), &mut out[..2 * count]);
            }
            Self::Direction { width } => {
                let half = (at.env.omega_e * (1.0 / width)).tanh() * 0.5;
                (out[0], out[1]) = (half + 0.5, -half + 0.5);
            }
            Self::Spline(spline) => spline.fill(at, out),
        }
        self.count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::env;

    fn at_speed(omega_e: f64) -> Point<f64> {
        Point { env: env(0.4, omega_e), i: [0.0; 2], v: [0.0; 2], tau_e: 0.0 }
    }

    fn values(factor: Factor, at: &Point<f64>) -> Vec<f64> {
        let mut out = [f64::NAN; MOST];
        let count = factor.fill(at, &mut out);
        out[..count].to_vec()
    }

    #[test]
    fn splines_are_a_partition_of_unity_and_hold_their_ends() {
        for degree in 1..=3 {
            let spline = Spline {
                variable: Variable::OmegaE,
                low: -50.0,
                high: 150.0,
                degree,
                pieces: 4,
                warp: 0.0,
                odd: false,
            };
            let at = |omega| values(Factor::Spline(spline), &at_speed(omega));
            for k in 0..=100 {
                let b = at(-50.0 + 2.0 * f64::from(k));
                assert_eq!(b.len(), 4 + degree);
                assert!((b.iter().sum::<f64>() - 1.0).abs() < 1e-12, "degree {degree}");
                assert!(b.iter().all(|x| *x >= -1e-15));
            }
            assert_eq!(at(-80.0), at(-50.0));
            assert_eq!(at(1e4), at(150.0));
        }
    }

    #[test]
    fn odd_functions_change_sign_with_the_variable_and_are_half_as_many() {
        for (pieces, warp) in [(4, 0.0), (6, 3.0), (7, 0.0)] {
            let variable = Variable::OmegaE;
            let spline = Spline { variable, low: -50.0, high: 50.0, degree: 3, pieces, warp, odd: true };
            let at = |omega| values(Factor::Spline(spline), &at_speed(omega));
            let whole = |omega| values(Factor::Spline(Spline { odd: false, ..spline }), &at_speed(omega));
            for k in 0..=60 {
                let omega = f64::from(k);
                let (forward, back, all) = (at(omega), at(-omega), whole(omega));
                assert_eq!(forward.len(), (pieces + 3) / 2);
                assert!(
                    forward.iter().zip(&back).all(|(a, b)| (a + b).abs() < 1e-12),
                    "{forward:?} {back:?}"
                );
                assert!((0..forward.len()).all(|k| forward[k] == all[k] - all[all.len() - 1 - k]));
            }
        }
    }

    #[test]
    fn a_spline_of_its_nodes_is_the_variable_itself() {
        let spline = Spline {
            variable: Variable::OmegaE,
            low: 0.0,
            high: 4.0,
            degree: 3,
            pieces: 4,
            warp: 0.0,
            odd: false,
        };
        for omega in [0.0, 0.7, 1.9, 3.3, 4.0] {
            let b = values(Factor::Spline(spline), &at_speed(omega));
            let sum: f64 = b.iter().enumerate().map(|(k, b)| b * (k as f64 - 1.0)).sum();
            assert!((sum - omega).abs() < 1e-12, "{omega}");
        }
    }

    #[test]
    fn either_direction_has_its_own_function() {
        let at = |omega| values(Factor::Direction { width: 2.0 }, &at_speed(omega));
        assert_eq!((at(400.0), at(-400.0), at(0.0)), (vec![1.0, 0.0], vec![0.0, 1.0], vec![0.5, 0.5]));
        assert!((at(1.3).iter().sum::<f64>() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn harmonics_are_multiples_of_the_lowest_order() {
        let factor = Factor::Harmonics { angle: Variable::ThetaE, order: 3, count: 4 };
        let found = values(factor, &at_speed(0.0));
        for (k, pair) in found.chunks(2).enumerate() {
            let (s, c) = (3.0 * (k + 1) as f64 * 0.4f64).sin_cos();
            assert!((pair[0] - c).abs() < 1e-12 && (pair[1] - s).abs() < 1e-12);
        }
    }
}
