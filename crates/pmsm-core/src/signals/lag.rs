//! A logged speed that lags behind the angle: a low-pass filter or a delay in the log, found by comparing both and undone.

use super::low_pass::{has_passed, sharpen};
use crate::numerics::differences::white_noise;
use std::ops::Range;

/// Half the widths of the windows over which angle and speed may be compared, samples. Wide ones average the steps of a coarse angle, narrow
/// ones show a lag where the speed ripples.
const HALVES: [usize; 3] = [2, 5, 10];
/// Time constants after which a low pass has forgotten what was before the first sample.
const FORGOTTEN: f64 = 3.0;
/// Shortest lag that is undone, sample periods.
const LEAST: f64 = 0.3;
/// And its standard errors.
const SIGNIFICANT: f64 = 6.0;
/// Longest lag that is looked for, share of the longest run without a gap: a longer one is not forgotten within a good part of the run.
const MOST: f64 = 0.05;
/// What may remain of the mean square difference between angle and speed for the lag to be understood.
const UNDERSTOOD: f64 = 0.5;
/// How the log let the speed lag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lag {
    /// First-order low pass with this time constant, s.
    Filter(f64),
    /// Delay, s.
    Delay(f64),
}

/// The speed (rad/s) without its lag, and what the lag was, if there is one: `omega` as logged, `theta` the unwrapped electrical angle,
/// `t` the times, all sample by sample.
pub fn undo(t: &[f64], theta: &[f64], omega: &[f64], segments: &[Range<usize>]) -> Option<(Vec<f64>, Lag)> {
    let log = Log { t, theta, omega, segments };
    let estimates = HALVES.iter().filter_map(|half| log.lag(*half));
    let Estimate { half, lag, error } =
        estimates.max_by(|a, b| (a.lag / a.error).total_cmp(&(b.lag / b.error)))?;
    let period = (t[t.len() - 1] - t[0]) / (t.len() - 1) as f64;
    let longest = segments.iter().map(Range::len).max().unwrap_or(0) as f64 * period;
    if lag < LEAST * period || lag > MOST * longest || lag < SIGNIFICANT * error {
        return None;
    }
    // The angle is made late and not the speed prompt, which would raise its noise.
    let windows = log.windows(half, (FORGOTTEN * lag / period) as usize);
    let misfit = |theta: &[f64]| windows.iter().map(|w| log.ahead(theta, *w).powi(2)).sum::<f64>();
    // A low pass smooths the steps of the angle, and a delay hardly does: what these leave by themselves counts for neither.
    let steps = log.misfit_of_steps(windows.len(), 2 * half, period);
    let best_of = |make: &dyn Fn(f64) -> Vec<f64>, of_steps: &dyn Fn(f64) -> f64| {
        let cost = |x: f64| misfit(&make(x)) - steps * of_steps(x);
        let best = golden(&cost, 0.3 * lag, 2.0 * lag);
        (best, cost(best))
    };
    let filter = best_of(&|tau| log.filtered_angle(tau), &|tau| {
        let a = (-period / tau).exp();
        (1.0 - a) / (1.0 + a) * (1.0 - a.powi(2 * half as i32))
    });
    let delay = best_of(&|tau| shifted(t, theta, segments, -tau), &|tau| {
        let share = (tau / period).fract();
        share * share + (1.0 - share) * (1.0 - share)
    });
    if filter.1.min(delay.1) >= UNDERSTOOD * (misfit(theta) - steps) {
        return None;
    }
    let by_chance = SIGNIFICANT * (2.0 / windows.len() as f64).sqrt() * (filter.1.max(delay.1) + steps);
    Some(if filter.1 + by_chance < delay.1 || has_passed(omega, segments, (-period / filter.0).exp()) {
        (sharpen(t, omega, segments, filter.0), Lag::Filter(filter.0))
    } else {
        (shifted(t, omega, segments, delay.0), Lag::Delay(delay.0))
    })
}

/// Angle and speed as they were logged.
struct Log<'a> {
    t: &'a [f64],
    theta: &'a [f64],
    omega: &'a [f64],
    segments: &'a [Range<usize>],
}

/// A lag of the speed behind the angle, s, its standard error, and half the width of the windows that show it.
struct Estimate {
    half: usize,
    lag: f64,
    error: f64,
}

impl Log<'_> {
    /// First and last sample of the windows, each of which overlaps the next by half, that begin at least `skip` samples behind a gap.
    fn windows(&self, half: usize, skip: usize) -> Vec<(usize, usize)> {
        let of = |s: &Range<usize>| {
            (s.start.saturating_add(skip)..s.end.saturating_sub(2 * half))
                .step_by(half)
                .map(|k| (k, k + 2 * half))
        };
        self.segments.iter().flat_map(of).collect()
    }

    /// By how much the mean speed by `theta` exceeds the logged one in a window.
    fn ahead(&self, theta: &[f64], (a, b): (usize, usize)) -> f64 {
        (theta[b] - theta[a]) / (self.t[b] - self.t[a]) - mean(self.t, self.omega, a, b)
    }

    /// The lag by which the speed of the angle is ahead where the logged one rises, by least squares.
    fn lag(&self, half: usize) -> Option<Estimate> {
        let point = |w: (usize, usize)| {
            let slope = (self.omega[w.1] - self.omega[w.0]) / (self.t[w.1] - self.t[w.0]);
            (self.ahead(self.theta, w), slope)
        };
        let points: Vec<(f64, f64)> = self.windows(half, 0).into_iter().map(point).collect();
        let product: f64 = points.iter().map(|(ahead, slope)| ahead * slope).sum();
        let square: f64 = points.iter().map(|(_, slope)| slope * slope).sum();
        let count = points.len() as f64;
        if count < 10.0 || square <= 0.0 {
            return None;
        }
        let lag = product / square;
        let rest: f64 = points.iter().map(|(ahead, slope)| (ahead - lag * slope).powi(2)).sum();
        // Neighbouring windows overlap by half.
        Some(Estimate { half, lag, error: (2.0 * rest / count / square).sqrt() })
    }

    /// What white noise of the angle, such as its steps, adds to the misfit of so many windows of `width` samples.
    fn misfit_of_steps(&self, windows: usize, width: usize, period: f64) -> f64 {
        let longest = self.segments.iter().max_by_key(|s| s.len());
        let noise = longest.map_or(0.0, |s| white_noise(&self.theta[s.clone()]));
        2.0 * windows as f64 * (noise / (width as f64 * period)).powi(2)
    }

    /// The angle behind the low pass of [`sharpen`], which is taken to have been settled at the first logged speed.
    fn filtered_angle(&self, tau: f64) -> Vec<f64> {
        let mut y = self.theta.to_vec();
        for segment in self.segments.iter().filter(|s| s.len() > 1) {
            let at = segment.start;
            let h = self.t[at + 1] - self.t[at];
            let a = (-h / tau).exp();
            y[at] -= self.omega[at] * h * a / (1.0 - a);
            for k in at + 1..segment.end {
                let a = (-(self.t[k] - self.t[k - 1]) / tau).exp();
                y[k] = a * y[k - 1] + (1.0 - a) * self.theta[k];
            }
        }
        y
    }
}

/// Mean of `x` over the times of samples `a` to `b`.
fn mean(t: &[f64], x: &[f64], a: usize, b: usize) -> f64 {
    (a..b).map(|k| 0.5 * (x[k] + x[k + 1]) * (t[k + 1] - t[k])).sum::<f64>() / (t[b] - t[a])
}

/// The signal as it is `tau` (s) later, straight between samples; beyond its ends it is held.
fn shifted(t: &[f64], y: &[f64], segments: &[Range<usize>], tau: f64) -> Vec<f64> {
    let mut x = y.to_vec();
    for segment in segments {
        let mut at = segment.start;
        for k in segment.clone() {
            let wanted = t[k] + tau;
            while at + 2 < segment.end && t[at + 1] < wanted {
                at += 1;
            }
            let next = (at + 1).min(segment.end - 1);
            let span = t[next] - t[at];
            let share = if span > 0.0 { ((wanted - t[at]) / span).clamp(0.0, 1.0) } else { 0.0 };
            x[k] = y[at] + share * (y[next] - y[at]);
        }
    }
    x
}

/// Minimum of `cost` between `low` and `high` by golden section.
fn golden(cost: &dyn Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    let (mut a, mut b) = (high - ratio * (high - low), low + ratio * (high - low));
    let (mut at_a, mut at_b) = (cost(a), cost(b));
    for _ in 0..24 {
        if at_a < at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - ratio * (high - low);
            at_a = cost(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + ratio * (high - low);
            at_b = cost(b);
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::normal_pair;

    const H: f64 = 1e-4;

    fn whole(t: &[f64]) -> Vec<Range<usize>> {
        std::iter::once(0..t.len()).collect()
    }

    fn run() -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let n = 20_000;
        let t: Vec<f64> = (0..n).map(|k| f64::from(k) * H).collect();
        let omega = t.iter().map(|t| 200.0 * (20.0 * t).sin() + 40.0 * (150.0 * t).sin()).collect();
        let theta = t
            .iter()
            .map(|t| 10.0 * (1.0 - (20.0 * t).cos()) + 40.0 / 150.0 * (1.0 - (150.0 * t).cos()))
            .map(|x| (x / 1e-4).round() * 1e-4)
            .collect();
        (t, theta, omega)
    }

    #[test]
    fn a_filter_is_found_and_undone() {
        let (t, theta, omega) = run();
        let tau = 4.3e-4;
        let a = (-H / tau).exp();
        let mut logged = omega.clone();
        for k in 1..logged.len() {
            logged[k] = a * logged[k - 1] + (1.0 - a) * omega[k];
        }
        let (restored, lag) = undo(&t, &theta, &logged, &whole(&t)).unwrap();
        let Lag::Filter(found) = lag else { panic!("{lag:?}") };
        assert!((found / tau - 1.0).abs() < 0.02, "{found}");
        let worst = restored.iter().zip(&omega).skip(1).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 2.0, "{worst}");
    }

    #[test]
    fn a_delay_is_told_from_a_filter() {
        let (t, theta, omega) = run();
        let logged: Vec<f64> = (0..omega.len()).map(|k| omega[k.saturating_sub(5)]).collect();
        let (_, lag) = undo(&t, &theta, &logged, &whole(&t)).unwrap();
        let Lag::Delay(found) = lag else { panic!("{lag:?}") };
        assert!((found / (5.0 * H) - 1.0).abs() < 0.02, "{found}");
    }

    /// A rotor so heavy that a filter and a delay do the same to its speed, with noise of the sensor.
    fn heavy(noisy: impl Fn(&[f64]) -> Vec<f64>) -> Lag {
        let t: Vec<f64> = (0..20_000).map(|k| f64::from(k) * H).collect();
        let omega: Vec<f64> = t.iter().map(|t| 200.0 * (4.0 * t).sin()).collect();
        let theta: Vec<f64> =
            t.iter().map(|t| ((50.0 * (1.0 - (4.0 * t).cos())) / 1e-3).round() * 1e-3).collect();
        undo(&t, &theta, &noisy(&omega), &whole(&t)).unwrap().1
    }

    fn with_noise(omega: &[f64]) -> Vec<f64> {
        omega.iter().enumerate().map(|(k, w)| w + 0.3 * normal_pair(5, [k as u32, 0, 0, 0]).0).collect()
    }

    #[test]
    fn noise_tells_a_filter_from_a_delay_where_the_motion_does_not() {
        let a = (-H / 6e-4).exp();
        let filter = |omega: &[f64]| {
            let mut y = with_noise(omega);
            for k in 1..y.len() {
                y[k] = a * y[k - 1] + (1.0 - a) * y[k];
            }
            y
        };
        let Lag::Filter(found) = heavy(filter) else { panic!("a filter") };
        assert!((found / 6e-4 - 1.0).abs() < 0.05, "{found}");
        let late = |omega: &[f64]| {
            let y = with_noise(omega);
            (0..y.len()).map(|k| y[k.saturating_sub(6)]).collect()
        };
        let Lag::Delay(found) = heavy(late) else { panic!("a delay") };
        assert!((found / 6e-4 - 1.0).abs() < 0.05, "{found}");
    }

    #[test]
    fn a_filter_is_found_where_the_speed_ripples_about_one_value() {
        // A ripple of 60 Hz, which windows of 20 samples average away, and the angle of an encoder of 20 000 counts.
        let h = 1e-3;
        let t: Vec<f64> = (0..7000).map(|k| f64::from(k) * h).collect();
        let (mean, ripple, rate) = (63.0, 8.0, 380.0);
        let omega: Vec<f64> = t.iter().map(|t| mean + ripple * (rate * t).sin()).collect();
        let count = 12.0 * std::f64::consts::TAU / 20_000.0;
        let theta: Vec<f64> = t
            .iter()
            .map(|t| mean * t + ripple / rate * (1.0 - (rate * t).cos()))
            .map(|x| (x / count).round() * count)
            .collect();
        let tau: f64 = 2.5e-3;
        let a = (-h / tau).exp();
        let mut logged = omega.clone();
        for k in 1..logged.len() {
            logged[k] = a * logged[k - 1] + (1.0 - a) * omega[k];
        }
        let (_, lag) = undo(&t, &theta, &logged, &whole(&t)).unwrap();
        let Lag::Filter(found) = lag else { panic!("{lag:?}") };
        assert!((found / tau - 1.0).abs() < 0.05, "{found}");
    }

    #[test]
    fn a_prompt_speed_is_left_alone() {
        let (t, theta, omega) = run();
        assert!(undo(&t, &theta, &omega, &whole(&t)).is_none());
    }
}
