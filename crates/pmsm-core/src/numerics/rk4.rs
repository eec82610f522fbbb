//! The classical Runge–Kutta method of fourth order, for states of fixed size over any number type.

use crate::numerics::real::Real;
use std::ops::Mul;

/// The derivative of a state within a step.
pub trait Slope<T, const N: usize> {
    /// The derivative at fraction `c` (0, ½ or 1) of the step.
    fn at(&self, c: f64, state: &[T; N]) -> [T; N];
}

/// The length of a step, s.
pub trait Length: Copy {
    /// The share `c` of it.
    fn times(self, c: f64) -> Self;
    /// One of `n` equal parts of it.
    fn over(self, n: f64) -> Self;
}

impl Length for f64 {
    #[inline(always)]
    fn times(self, c: f64) -> Self {
        c * self
    }
    #[inline(always)]
    fn over(self, n: f64) -> Self {
        self / n
    }
}

/// A closure as a slope.
struct Plain<F>(F);

impl<T, const N: usize, F: Fn(f64, &[T; N]) -> [T; N]> Slope<T, N> for Plain<F> {
    #[inline(always)]
    fn at(&self, c: f64, state: &[T; N]) -> [T; N] {
        (self.0)(c, state)
    }
}

/// One step of length `h` (s) from `state`. `rhs(c, state)` is the derivative at fraction `c` (0, ½ or 1) of the step.
#[inline(always)]
pub fn step<T: Real, const N: usize>(h: f64, state: &[T; N], rhs: impl Fn(f64, &[T; N]) -> [T; N]) -> [T; N] {
    advance(h, state, &Plain(rhs))
}

/// [`step`] along a slope that is a type of its own: unlike a closure it can insist on being inlined.
#[inline(always)]
pub fn advance<T: Real, const N: usize>(h: f64, state: &[T; N], rhs: &impl Slope<T, N>) -> [T; N] {
    ends(h, state, &stages(h, state, rhs))
}

/// One step of length `h` from `state`, as [`advance`], and before its end the state in its middle, to third order (Hairer,
/// Nørsett & Wanner, "Solving ordinary differential equations I", section II.6).
#[inline(always)]
pub fn advance_with_middle<T: Real + Mul<H, Output = T>, H: Length, const N: usize>(
    h: H,
    state: &[T; N],
    rhs: &impl Slope<T, N>,
) -> ([T; N], [T; N]) {
    let k = stages(h, state, rhs);
    let mut middle = *state;
    for n in 0..N {
        middle[n] += (k[0][n] * 5.0 + (k[1][n] + k[2][n]) * 4.0 - k[3][n]) * h.over(24.0);
    }
    (middle, ends(h, state, &k))
}

/// The derivatives at the four stages, in one loop, so that a long right-hand side is compiled once.
#[inline(always)]
fn stages<T: Real + Mul<H, Output = T>, H: Length, const N: usize>(
    h: H,
    state: &[T; N],
    rhs: &impl Slope<T, N>,
) -> [[T; N]; 4] {
    let mut k = [[T::zero(); N]; 4];
    let mut at = *state;
    for (stage, (c, reach)) in [(0.0, 0.5), (0.5, 0.5), (0.5, 1.0), (1.0, 0.0)].into_iter().enumerate() {
        k[stage] = rhs.at(c, &at);
        if stage < 3 {
            for n in 0..N {
                at[n] = state[n] + k[stage][n] * h.times(reach);
            }
        }
    }
    k
}

#[inline(always)]
fn ends<T: Real + Mul<H, Output = T>, H: Length, const N: usize>(
    h: H,
    state: &[T; N],
    k: &[[T; N]; 4],
) -> [T; N] {
    let mut next = *state;
    for n in 0..N {
        next[n] += (k[0][n] + (k[1][n] + k[2][n]) * 2.0 + k[3][n]) * h.over(6.0);
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_is_four_on_an_oscillator() {
        let error = |steps: u32| {
            let h = 2.0 / f64::from(steps);
            let mut x = [1.0, 0.0];
            for _ in 0..steps {
                x = step(h, &x, |_, s| [s[1], -s[0]]);
            }
            ((x[0] - 2f64.cos()).powi(2) + (x[1] + 2f64.sin()).powi(2)).sqrt()
        };
        let order = (error(50) / error(100)).log2();
        assert!((order - 4.0).abs() < 0.05, "{order}");
    }

    #[test]
    fn the_middle_is_of_third_order() {
        let error = |h: f64| {
            let ([middle, _], _) =
                advance_with_middle(h, &[1.0, 0.0], &Plain(|_, s: &[f64; 2]| [s[1], -s[0]]));
            (middle - (0.5 * h).cos()).abs()
        };
        let order = (error(0.1) / error(0.05)).log2();
        assert!(order > 3.9, "local error of order {order}");
    }

    #[test]
    fn time_dependence_uses_the_right_fractions() {
        let x = step(1.0, &[0.0], |c, _| [4.0 * c * c * c]);
        assert!((x[0] - 1.0).abs() < 1e-15);
    }
}
