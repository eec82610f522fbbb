//! The rotor angle: whole turns, rates, and whether it agrees with the speed.

use super::Finding;
use crate::error::{Error, Result};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::ops::Range;

/// Farthest a held rotor turns, rad: what a sensor's noise and the twist of a shaft do.
const HELD: f64 = 0.5;
/// Samples from which the speed and its slope beside a gap are taken at most.
const BESIDE: usize = 400;
/// Rows over which the advance of the angle is compared with the integral of the speed: a run is cut into this many stretches, each of at most
/// so many rows. Steps of a coarse angle, and of a speed by its differences, are small beside the advance over a stretch.
const STRETCHES: usize = 16;
const LONGEST_STRETCH: usize = 64;

/// Removes the jumps of a wrapped angle.
pub fn unwrap(angle: &[f64]) -> Vec<f64> {
    let mut turns = 0.0;
    let mut last = angle[0];
    angle
        .iter()
        .map(|&x| {
            let jump = x - last;
            if jump.abs() > PI {
                turns -= (jump / TAU).round();
            }
            last = x;
            x + turns * TAU
        })
        .collect()
}

/// Derivative of a noisy `x` with respect to `t`, segment by segment: the slope of the straight line through `half` samples to either side
/// as far as there are any.
pub fn slopes(t: &[f64], x: &[f64], segments: &[Range<usize>], half: usize) -> Vec<f64> {
    let mut slopes = vec![0.0; x.len()];
    for segment in segments {
        for k in segment.clone() {
            let near = k.saturating_sub(half).max(segment.start)..(k + half + 1).min(segment.end);
            slopes[k] = line(&t[near.clone()], &x[near], t[k]).1;
        }
    }
    slopes
}

/// Values of a noisy `x` at the times `t`, segment by segment: of the straight line through `half` samples to either side as far as there are
/// as many on both.
pub fn smoothed(t: &[f64], x: &[f64], segments: &[Range<usize>], half: usize) -> Vec<f64> {
    let mut out = x.to_vec();
    for segment in segments {
        for k in segment.clone() {
            let reach = half.min(k - segment.start).min(segment.end - 1 - k);
            let near = k - reach..k + reach + 1;
            out[k] = line(&t[near.clone()], &x[near], t[k]).0;
        }
    }
    out
}

/// Integral of `rate` over the times `t`, from zero, by the trapezoidal rule.
pub fn integrate(t: &[f64], rate: &[f64]) -> Vec<f64> {
    let mut sum = 0.0;
    (0..t.len())
        .map(|k| {
            if k > 0 {
                sum += 0.5 * (rate[k] + rate[k - 1]) * (t[k] - t[k - 1]);
            }
            sum
        })
        .collect()
}

/// Compares how far the angle turned with the integral of the speed.
///
/// # Errors
/// [`Error::Sample`] where the rotor turns too far between two samples, [`Error::Column`] where angle and speed contradict each other.
pub fn check_sense(
    t: &[f64],
    theta: &[f64],
    omega: &[f64],
    segments: &[Range<usize>],
    n_p: u32,
) -> Result<()> {
    // From row to row, and over stretches.
    let (mut rows, mut stretches, mut travelled) = ([0.0; 2], [0.0; 2], 0.0);
    let add = |sums: &mut [f64; 2], advance: f64, turned: f64| {
        *sums = [sums[0] + advance * turned, sums[1] + advance * advance];
    };
    for segment in segments {
        let stretch = (segment.len() / STRETCHES).clamp(1, LONGEST_STRETCH);
        let (mut first, mut advance) = (segment.start, 0.0);
        for k in segment.start + 1..segment.end {
            let expected = 0.5 * (omega[k] + omega[k - 1]) * (t[k] - t[k - 1]);
            if expected.abs() > PI {
                return Err(Error::Sample {
                    column: "theta_e".into(),
                    row: k,
                    problem: "the rotor turns more than half an electrical turn between two samples".into(),
                    fix: "sample faster, or leave the angle out".into(),
                });
            }
            travelled += expected.abs();
            advance += expected;
            add(&mut rows, expected, theta[k] - theta[k - 1]);
            if k - first == stretch || k + 1 == segment.end {
                add(&mut stretches, advance, theta[k] - theta[first]);
                (first, advance) = (k, 0.0);
            }
        }
    }
    if travelled < 2.0 * TAU {
        return Ok(());
    }
    let (ratio, over_rows, n_p) = (stretches[0] / stretches[1], rows[0] / rows[1], f64::from(n_p));
    let same = |ratio: f64, x: f64| (ratio / x - 1.0).abs() < 0.2;
    let near = |x: f64| same(ratio, x);
    let refuse = |problem: String, fix: String| Err(Error::Column { column: "theta_e".into(), problem, fix });
    // A speed that swings to and fro within a stretch shows from row to row.
    if near(1.0) || same(over_rows, 1.0) {
        Ok(())
    } else if near(1.0 / n_p) {
        refuse(
            format!("the angle turns {ratio:.3} times as far as the speed says, which is 1/n_p"),
            "one of the two is mechanical: map the angle to theta_m, or the speed to omega_m".into(),
        )
    } else if near(n_p) {
        refuse(
            format!("the angle turns {ratio:.3} times as far as the speed says, which is n_p"),
            "one of the two is mechanical: map the speed to omega_m, or the angle to theta_e".into(),
        )
    } else {
        refuse(
            format!("the angle turns {ratio:.3} times as far as the integral of the speed"),
            "check units, n_p and the sense of rotation (scale = -1 in [columns] turns a signal round)"
                .into(),
        )
    }
}

/// Adds whole turns to the unwrapped electrical angle `theta` (rad) behind each gap, so that it goes on by as much as the speeds `omega`
/// (rad/s) before and behind call for. Says so where they leave open by how many.
pub fn bridge(t: &[f64], theta: &mut [f64], omega: &[f64], segments: &[Range<usize>]) -> Option<Finding> {
    let mut open = 0;
    for pair in segments.windows(2) {
        let (before, behind) = (&pair[0], &pair[1]);
        let (last, first) = (before.end - 1, behind.start);
        let gap = t[first] - t[last];
        let beside = |range: Range<usize>, at: f64| line(&t[range.clone()], &omega[range], at);
        let (w0, a0) = beside(before.start.max(before.end.saturating_sub(BESIDE))..before.end, t[last]);
        let (w1, a1) = beside(first..behind.end.min(first + BESIDE), t[first]);
        // Hermite's cubic through both speeds and slopes; the straight line between the speeds says how far to trust it.
        let straight = 0.5 * gap * (w0 + w1);
        let bent = gap * gap / 12.0 * (a0 - a1);
        let travelled = theta[first] - theta[last];
        let turns = ((straight + bent - travelled) / TAU).round() * TAU;
        let off = straight + bent - travelled - turns;
        open += usize::from(bent.abs() > PI || off.abs() > FRAC_PI_2);
        theta[first..].iter_mut().for_each(|x| *x += turns);
    }
    (open > 0).then(|| Finding {
        finding: format!("how many electrical turns passed in {open} of the gaps is not certain"),
        consequence: "what repeats once per revolution may not add up over the recording".into(),
        fix: "log the mechanical angle theta_m, or record without interruption".into(),
    })
}

/// A held rotor has no speed: what the sensor shows is noise, which would induce a voltage in the model. A rotor that turned all the same
/// keeps its speed and is reported.
pub fn hold(theta: &[f64], omega: &mut [f64]) -> Option<Finding> {
    let farthest = theta.iter().map(|x| (x - theta[0]).abs()).fold(0.0, f64::max);
    if farthest <= HELD {
        omega.fill(0.0);
        return None;
    }
    Some(Finding {
        finding: format!("the rotor is said to be locked but turned by {farthest:.1} rad (electrical)"),
        consequence: "its measured speed is used, its motion is not".into(),
        fix: "fix the shaft, or say what loads it".into(),
    })
}

/// Value at `at` and slope of the straight line through samples `x` at times `t`.
fn line(t: &[f64], x: &[f64], at: f64) -> (f64, f64) {
    let n = t.len() as f64;
    let (mean_t, mean_x) = (t.iter().sum::<f64>() / n, x.iter().sum::<f64>() / n);
    let square: f64 = t.iter().map(|t| (t - mean_t).powi(2)).sum();
    let product: f64 = t.iter().zip(x).map(|(t, x)| (t - mean_t) * (x - mean_x)).sum();
    let slope = if square > 0.0 { product / square } else { 0.0 };
    (mean_x + slope * (at - mean_t), slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_turns_within_a_gap_are_counted_by_the_speed() {
        // Slowing down and turning round, with two seconds in which some turns pass unseen.
        let (theta, omega) = (|t: f64| 40.0 * t - 7.0 * t * t, |t: f64| 40.0 - 14.0 * t);
        let t: Vec<f64> = (0..800).map(|k| f64::from(k) * 0.005).filter(|t| *t < 1.0 || *t > 3.0).collect();
        let wrapped: Vec<f64> = t.iter().map(|t| theta(*t).rem_euclid(TAU)).collect();
        let speed: Vec<f64> = t.iter().map(|t| omega(*t)).collect();
        let gap = t.iter().position(|t| *t > 2.0).unwrap();
        let mut found = unwrap(&wrapped);
        assert!((found[gap] - found[gap - 1]).abs() < PI, "the gap hides turns");
        assert!(bridge(&t, &mut found, &speed, &[0..gap, gap..t.len()]).is_none());
        for (found, t) in found.iter().zip(&t) {
            assert!((found - theta(*t)).abs() < 1e-9);
        }
    }

    #[test]
    fn a_held_rotor_has_no_speed() {
        let mut noise = [0.3, -0.4, 0.2];
        assert!(hold(&[1.0, 1.01, 0.98], &mut noise).is_none() && noise == [0.0; 3]);
        let mut turning = [30.0; 3];
        let finding = hold(&[0.0, 0.3, 0.6], &mut turning);
        assert!(finding.is_some_and(|f| f.finding.contains("0.6 rad")) && turning == [30.0; 3]);
    }

    #[test]
    fn an_angle_in_coarse_steps_agrees_with_the_speed_that_its_differences_make() {
        let (step, held) = (0.3, 12);
        let n = 20_000;
        let t: Vec<f64> = (0..n).map(|k| 6e-5 * f64::from(k)).collect();
        let theta: Vec<f64> =
            t.iter().map(|t| step * (60.0 * (1.0 - (5.0 * t).cos()) / step).floor()).collect();
        let speed = |k: usize| {
            let at = k / held * held;
            if at == 0 { 0.0 } else { (theta[at] - theta[at - held]) / (t[at] - t[at - held]) }
        };
        let omega: Vec<f64> = (0..t.len()).map(speed).collect();
        let whole = 0..t.len();
        let all = std::slice::from_ref(&whole);
        check_sense(&t, &theta, &omega, all, 12).unwrap();
        let mechanical: Vec<f64> = theta.iter().map(|x| x / 12.0).collect();
        assert!(check_sense(&t, &mechanical, &omega, all, 12).unwrap_err().to_string().contains("theta_m"));
        let back: Vec<f64> = theta.iter().map(|x| -x).collect();
        assert!(check_sense(&t, &back, &omega, all, 12).is_err());
    }

    #[test]
    fn turns_that_the_speeds_leave_open_are_said() {
        // The speed hardly changes on either side, and yet not the same number of turns passed.
        let t = [0.0, 0.1, 0.2, 2.0, 2.1, 2.2];
        let mut theta = [0.0, 1.0, 2.0, 2.0 + PI, 3.0 + PI, 4.0 + PI];
        let finding = bridge(&t, &mut theta, &[10.0; 6], &[0..3, 3..6]);
        assert!(finding.is_some_and(|f| f.fix.contains("theta_m")));
    }
}
