//! Signals behind a first-order low pass: whether their noise has passed one, and what went into it.

use super::{Finding, Signals, turned};
use crate::recording::Kind;
use std::f64::consts::TAU;
use std::ops::Range;

/// Coefficients of third differences, in which motion hardly shows beside noise.
const THIRD: [f64; 4] = [1.0, -3.0, 3.0, -1.0];
/// Standard errors by which the colours of white and of filtered noise must differ to be told apart.
const DISTINCT: f64 = 10.0;
/// Standard errors by which the colour of noise must differ from that of white noise for a filter to be looked for.
const COLOURED: f64 = 4.0;
/// Differences larger than this many medians are no noise.
const OUTLYING: f64 = 8.0;

/// Correlation of neighbouring third differences of noise with this correlation over a lag.
fn correlation(of: &dyn Fn(i32) -> f64) -> f64 {
    let covariance = |lag: i32| -> f64 {
        let pairs = (0..4).flat_map(|i| (0..4).map(move |j| (i, j)));
        pairs.map(|(i, j): (i32, i32)| THIRD[i as usize] * THIRD[j as usize] * of(lag + i - j)).sum()
    };
    covariance(1) / covariance(0)
}

/// That of white noise.
fn of_white() -> f64 {
    correlation(&|lag| f64::from(u8::from(lag == 0)))
}

/// That of a series as it was seen, and the number of differences behind it; `None` where nothing changes.
fn seen(y: &[f64], segments: &[Range<usize>]) -> Option<(f64, f64)> {
    let differences: Vec<Vec<f64>> = segments
        .iter()
        .map(|s| y[s.clone()].windows(4).map(|w| w.iter().zip(THIRD).map(|(y, c)| y * c).sum()).collect())
        .collect();
    let mut sizes: Vec<f64> = differences.iter().flatten().map(|d| d.abs()).collect();
    if sizes.is_empty() {
        return None;
    }
    let middle = sizes.len() / 2;
    let most = OUTLYING * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
    let (mut product, mut square, mut count) = (0.0, 0.0, 0.0);
    for pair in differences.iter().flat_map(|d| d.windows(2)).filter(|p| p[0].abs().max(p[1].abs()) <= most) {
        product += pair[0] * pair[1];
        square += 0.5 * (pair[0] * pair[0] + pair[1] * pair[1]);
        count += 1.0;
    }
    (square > 0.0).then_some((product / square, count))
}

/// Whether the noise of `y` has passed a first-order low pass with the coefficient `a`, rather than being white: noise that was filtered
/// along with a signal shows it where the motion is too slow to.
pub(super) fn has_passed(y: &[f64], segments: &[Range<usize>], a: f64) -> bool {
    let Some((seen, count)) = seen(y, segments) else { return false };
    let (white, filtered) = (of_white(), correlation(&|lag| a.powi(lag.abs())));
    let distinct = (filtered - white).abs() * f64::sqrt(count) > DISTINCT;
    // Motion, where it shows, looks like neither.
    distinct && (seen - filtered).abs() < 0.5 * (filtered - white).abs()
}

/// What went into a first-order low pass y_k = a·y_{k−1} + (1 − a)·x_k, a = exp(−h/τ).
pub(super) fn sharpen(t: &[f64], y: &[f64], segments: &[Range<usize>], tau: f64) -> Vec<f64> {
    let mut x = y.to_vec();
    for segment in segments {
        for k in segment.start + 1..segment.end {
            let a = (-(t[k] - t[k - 1]) / tau).exp();
            x[k] = (y[k] - a * y[k - 1]) / (1.0 - a);
        }
        if segment.len() > 1 {
            x[segment.start] = x[segment.start + 1];
        }
    }
    x
}

impl Signals {
    /// Whether the currents were logged in the rotor's frame and their noise may have passed a low pass.
    pub fn currents_may_be_filtered(&self) -> bool {
        let Some(i) = self.i.as_ref().filter(|_| !self.phase_currents && self.kind != Kind::OperatingPoints)
        else {
            return false;
        };
        let coloured = |x: &Vec<f64>| {
            seen(x, &self.segments)
                .is_some_and(|(seen, count)| (seen - of_white()) * f64::sqrt(count) > COLOURED)
        };
        i.iter().all(coloured)
    }

    /// Takes a first-order low pass with the time constant `tau` (s) out of currents in the rotor's axes, and says so.
    pub fn take_filter_out(&mut self, tau: f64) {
        let Some([d, q]) = self.i.as_ref().filter(|_| !self.phase_currents) else { return };
        let [d, q] = [d, q].map(|x| sharpen(&self.t, x, &self.segments, tau));
        self.phases = Some(turned::to_phases([&d, &q], &self.theta_e));
        (self.i, self.current_filter) = (Some([d, q]), Some(tau));
        self.limited_by(Finding {
            finding: format!(
                "the logged currents are low-pass filtered at {:.0} Hz, as their noise and the voltages show",
                1.0 / (TAU * tau)
            ),
            consequence: "the filter is taken out of them, which raises their noise".into(),
            fix: "log the currents before their filter".into(),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::normal_pair;

    #[test]
    fn what_a_low_pass_took_away_comes_back_and_its_noise_tells_of_it() {
        let n = 20_000;
        let t: Vec<f64> = (0..n).map(|k| 1e-4 * f64::from(k)).collect();
        let whole = std::iter::once(0..t.len()).collect::<Vec<_>>();
        let x: Vec<f64> = (0..n)
            .map(|k| 5.0 * (30.0 * t[k as usize]).sin() + 0.02 * normal_pair(5, [k, 0, 0, 0]).0)
            .collect();
        let (tau, mut y) = (4e-4, x.clone());
        let a = (-1e-4f64 / tau).exp();
        for k in 1..y.len() {
            y[k] = a * y[k - 1] + (1.0 - a) * x[k];
        }
        let back = sharpen(&t, &y, &whole, tau);
        assert!(back[1..].iter().zip(&x[1..]).all(|(a, b)| (a - b).abs() < 1e-9));
        assert!(has_passed(&y, &whole, a) && !has_passed(&x, &whole, a));
    }
}
