//! The classical Runge–Kutta method of fourth order, for states of fixed size over any number type.

use crate::real::Real;

/// One step of length `h` (s) from `state`. `rhs(c, state)` is the derivative at fraction `c` (0, ½ or 1) of the step.
#[inline(always)]
pub fn step<T: Real, const N: usize>(h: f64, state: &[T; N], rhs: impl Fn(f64, &[T; N]) -> [T; N]) -> [T; N] {
    ends(h, state, &stages(h, state, rhs))
}

/// One step of length `h` (s) from `state`, as [`step`], and the state in its middle, to third order (Hairer, Nørsett & Wanner,
/// "Solving ordinary differential equations I", section II.6).
#[inline(always)]
pub fn step_with_middle<T: Real, const N: usize>(
    h: f64,
    state: &[T; N],
    rhs: impl Fn(f64, &[T; N]) -> [T; N],
) -> ([T; N], [T; N]) {
    let k = stages(h, state, rhs);
    let mut middle = *state;
    for n in 0..N {
        middle[n] += (k[0][n] * 5.0 + (k[1][n] + k[2][n]) * 4.0 - k[3][n]) * (h / 24.0);
    }
    (middle, ends(h, state, &k))
}

#[inline(always)]
fn stages<T: Real, const N: usize>(
    h: f64,
    state: &[T; N],
    rhs: impl Fn(f64, &[T; N]) -> [T; N],
) -> [[T; N]; 4] {
    let k1 = rhs(0.0, state);
    let k2 = rhs(0.5, &ahead(state, &k1, 0.5 * h));
    let k3 = rhs(0.5, &ahead(state, &k2, 0.5 * h));
    let k4 = rhs(1.0, &ahead(state, &k3, h));
    [k1, k2, k3, k4]
}

#[inline(always)]
fn ends<T: Real, const N: usize>(h: f64, state: &[T; N], k: &[[T; N]; 4]) -> [T; N] {
    let mut next = *state;
    for n in 0..N {
        next[n] += (k[0][n] + (k[1][n] + k[2][n]) * 2.0 + k[3][n]) * (h / 6.0);
    }
    next
}

#[inline(always)]
fn ahead<T: Real, const N: usize>(state: &[T; N], slope: &[T; N], h: f64) -> [T; N] {
    let mut moved = *state;
    for n in 0..N {
        moved[n] += slope[n] * h;
    }
    moved
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
            let ([middle, _], _) = step_with_middle(h, &[1.0, 0.0], |_, s: &[f64; 2]| [s[1], -s[0]]);
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
