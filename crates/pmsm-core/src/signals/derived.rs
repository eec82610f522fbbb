//! A speed that has to be derived from the angle, and how far it may be off.
//!
//! The slope of a line through few samples is noisy, as an angle comes in steps. Through many samples it is biased, as the rotor
//! accelerates. Twice the width gives an eighth of the variance and four times the bias. The width is chosen at which the slope changes
//! least when the width is doubled, less one doubling. Noise then dominates the error, and the change measures it.

use super::angle::{slopes, smoothed};
use std::ops::Range;

/// Half the width of the widest line, samples.
const WIDEST: usize = 64;

/// A derived speed.
#[derive(Debug, Clone)]
pub struct Derived {
    /// Electrical speed, rad/s.
    pub omega: Vec<f64>,
    /// How far it may be off, rad/s, sample by sample.
    pub error: Vec<f64>,
    /// Half the width of the lines, samples.
    pub half: usize,
}

/// Variance of a slope over that of its change when its line is made twice as wide: the wider line has an eighth of it and is part of it.
const OF_CHANGE: f64 = 8.0 / 7.0;

/// The speed of an unwrapped electrical angle `theta` (rad) at the times `t`.
pub fn derive(t: &[f64], theta: &[f64], segments: &[Range<usize>]) -> Derived {
    let shortest = segments.iter().map(Range::len).min().unwrap_or(0);
    let widened = |narrow: &Derived| {
        let half = 2 * narrow.half;
        let omega = slopes(t, theta, segments, half);
        let error = omega.iter().zip(&narrow.omega).map(|(w, n)| OF_CHANGE.sqrt() * (w - n)).collect();
        (Derived { error, ..narrow.clone() }, Derived { omega, error: Vec::new(), half })
    };
    let square = |x: &Derived| x.error.iter().map(|e| e * e).sum::<f64>();
    let first = Derived { omega: slopes(t, theta, segments, 1), error: vec![0.0; theta.len()], half: 1 };
    if shortest <= 8 {
        return first;
    }
    let (mut best, mut wide) = widened(&first);
    let mut narrower = best.clone();
    while wide.half < WIDEST && 8 * wide.half < shortest {
        let (next, wider) = widened(&wide);
        if square(&next) >= square(&best) {
            break;
        }
        (narrower, best, wide) = (best, next, wider);
    }
    narrower
}

/// Share of a step by which an angle is moved before it is rounded anew: no simple fraction, so that it falls elsewhere in its steps.
const MOVED: f64 = 0.382;

/// What steps of `quantum` rad do to the lines of half the width `half` through an unwrapped angle `theta` (rad): the error of the angle, rad,
/// and that of its slope, rad/s, sample by sample. The angle is drawn through its steps, rounded to them anew from another place, and seen
/// through the same lines again. What it then differs by has the size and the colour of the error, and comes at the same speeds; the lines
/// lag behind a curved speed as they did the first time.
pub fn rounded_anew(
    t: &[f64],
    theta: &[f64],
    segments: &[Range<usize>],
    half: usize,
    quantum: f64,
) -> (Vec<f64>, Vec<f64>) {
    let drawn = smoothed(t, theta, segments, half);
    let moved = |x: &f64| quantum * ((x / quantum + MOVED).floor() - MOVED + 0.5);
    let anew: Vec<f64> = drawn.iter().map(moved).collect();
    let differ = |a: Vec<f64>, b: Vec<f64>| a.into_iter().zip(b).map(|(a, b)| a - b).collect();
    (
        differ(smoothed(t, &anew, segments, half), drawn.clone()),
        differ(slopes(t, &anew, segments, half), slopes(t, &drawn, segments, half)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_angle_in_steps_shows_its_speed_within_the_error_that_is_said() {
        let n = 8000;
        let t: Vec<f64> = (0..n).map(|k| 2e-4 * k as f64).collect();
        let speed = |t: f64| 400.0 * (9.0 * t).sin();
        let angle = |t: f64| 400.0 / 9.0 * (1.0 - (9.0 * t).cos());
        let quantum = 6e-3;
        let exact: Vec<f64> = t.iter().map(|t| angle(*t)).collect();
        let steps: Vec<f64> = exact.iter().map(|x| quantum * (x / quantum).floor()).collect();
        let rms = |x: &[f64]| (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt();
        let off = |derived: &Derived| -> f64 {
            let off: Vec<f64> = t.iter().zip(&derived.omega).map(|(t, w)| w - speed(*t)).collect();
            rms(&off)
        };
        let whole = 0..n;
        let all = std::slice::from_ref(&whole);
        let derived = derive(&t, &steps, all);
        assert!(derived.half >= 4, "{}", derived.half);
        let (off, said) = (off(&derived), rms(&derived.error));
        assert!((off / said - 1.0).abs() < 0.3 && said < 3.0, "{off} {said}");
        // Rounded anew, it shows the same error.
        let (angle_error, error) = rounded_anew(&t, &steps, all, derived.half, quantum);
        let left = smoothed(&t, &steps, all, derived.half);
        let lag: Vec<f64> = left.iter().zip(&exact).map(|(a, b)| a - b + 0.5 * quantum).collect();
        assert!((rms(&error) / off - 1.0).abs() < 0.2, "{} {off}", rms(&error));
        assert!((rms(&angle_error) / rms(&lag) - 1.0).abs() < 0.3, "{} {}", rms(&angle_error), rms(&lag));
        // An angle without steps is differentiated as it stands.
        assert_eq!(derive(&t, &exact, all).half, 1);
    }
}
