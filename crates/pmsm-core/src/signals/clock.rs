//! Time stamps that jitter although the samples were taken evenly.
//!
//! A logger may stamp rows when it writes them. The rotor tells: where the angle turns by ω times the mean period instead of ω times
//! the stamped one, the stamps are wrong and the samples are even.

use std::ops::Range;

/// Relative spread of the periods that is looked at: below it does not matter, above the log is not nearly uniform.
const SPREAD: (f64, f64) = (1e-3, 0.2);
/// Share of the stamped deviations that the angle must follow at least for them to be real.
const REAL: f64 = 0.5;
/// Standard errors by which it must miss that.
const SIGNIFICANT: f64 = 6.0;

/// Evenly spaced times in place of `t` (s), and the jitter of the stamps as a share of the period, if the unwrapped electrical
/// angle `theta` (rad) shows at the electrical speed `omega` (rad/s) that the samples are even.
pub fn even(t: &[f64], segments: &[Range<usize>], theta: &[f64], omega: &[f64]) -> Option<(Vec<f64>, f64)> {
    let pairs = || segments.iter().flat_map(|s| s.start..s.end - 1);
    let steps: Vec<f64> =
        segments.iter().flat_map(|s| t[s.clone()].windows(2)).map(|x| x[1] - x[0]).collect();
    let count = steps.len() as f64;
    let period = steps.iter().sum::<f64>() / count;
    let spread = (steps.iter().map(|step| (step - period).powi(2)).sum::<f64>() / count).sqrt() / period;
    if !(SPREAD.0..SPREAD.1).contains(&spread) {
        return None;
    }
    let point = |k: usize| {
        let speed = 0.5 * (omega[k] + omega[k + 1]);
        ((t[k + 1] - t[k] - period) * speed, theta[k + 1] - theta[k] - period * speed)
    };
    let (mut product, mut square) = (0.0, 0.0);
    for (x, y) in pairs().map(point) {
        product += x * y;
        square += x * x;
    }
    let slope = product / square;
    let rest: f64 = pairs().map(point).map(|(x, y)| (y - slope * x).powi(2)).sum();
    let error = (rest / count / square).sqrt();
    let highest = slope + SIGNIFICANT * error;
    if highest.is_nan() || highest >= REAL {
        return None;
    }
    // Numbers of the samples on an even clock; a gap is a whole number of periods.
    let mut number = vec![0.0; t.len()];
    for k in 1..t.len() {
        number[k] = number[k - 1] + ((t[k] - t[k - 1]) / period).round().max(1.0);
    }
    let middle = (number.iter().sum::<f64>() / t.len() as f64, t.iter().sum::<f64>() / t.len() as f64);
    let (mut product, mut square) = (0.0, 0.0);
    for (n, t) in number.iter().zip(t) {
        product += (n - middle.0) * (t - middle.1);
        square += (n - middle.0).powi(2);
    }
    let step = product / square;
    Some((number.iter().map(|n| n * step).collect(), spread))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Deterministic numbers between −1 and 1.
    fn chance(k: usize) -> f64 {
        let x = (k as f64 * 12.9898).sin() * 43_758.545_3;
        2.0 * (x - x.floor()) - 1.0
    }

    fn whole(t: &[f64]) -> Vec<Range<usize>> {
        std::iter::once(0..t.len()).collect()
    }

    fn turning(real: bool) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let speed = |t: f64| 300.0 * (3.0 * t).sin();
        let angle = |t: f64| 100.0 * (1.0 - (3.0 * t).cos());
        let even = |k: usize| k as f64 * 1e-4;
        let stamped = |k: usize| even(k) + if k == 0 { 0.0 } else { 2e-6 * chance(k) };
        let taken = |k: usize| if real { stamped(k) } else { even(k) };
        let n = 20_000;
        (
            (0..n).map(stamped).collect(),
            (0..n).map(|k| angle(taken(k))).collect(),
            (0..n).map(|k| speed(taken(k)) + 0.05 * chance(k + n)).collect(),
        )
    }

    #[test]
    fn stamps_that_the_rotor_contradicts_are_evened_out() {
        let (t, theta, omega) = turning(false);
        let (even, jitter) = even(&t, &whole(&t), &theta, &omega).unwrap();
        let worst = even.iter().enumerate().map(|(k, t)| (t - k as f64 * 1e-4).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-7, "{worst}");
        assert!((jitter - 0.02 * (2.0f64 / 3.0).sqrt()).abs() < 1e-3, "{jitter}");
    }

    #[test]
    fn samples_that_were_taken_unevenly_keep_their_times() {
        let (t, theta, omega) = turning(true);
        assert!(even(&t, &whole(&t), &theta, &omega).is_none());
    }
}
