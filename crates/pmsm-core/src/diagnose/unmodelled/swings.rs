//! Frequencies at which something may swing in time: those that were located, and that at which the currents answer to a command that swings.

use super::Side;
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::locate::{Located, equation_of, strongest_frequency};
use crate::map::Factor;
use crate::numerics::real::Real;
use crate::recording::Kind;
use std::f64::consts::TAU;

/// Steps on either side by which a frequency is refined: over one line of the spectrum, then over one such step.
const REFINED: i32 = 12;

/// Values beside the times at which they were logged.
type Series<'a> = (&'a [f64], &'a [f64]);

/// Swings at the located frequencies, each moved to where the residual of its channel swings most: a spectrum's own steps are too coarse to
/// keep step over a whole recording. Of the currents the one at which they swing with the command is among them. Each has so many multiples
/// at most, up to a share of the sampling theorem's limit.
pub fn swings(
    data: &Data,
    best: &Hypothesis,
    side: Side,
    located: &[Located],
    (sampled, multiples): (f64, usize),
) -> Vec<Factor> {
    // Each recording has a clock of its own.
    let t: Vec<f64> = data.runs().iter().flat_map(|run| &run.signals.t).copied().collect();
    let experiment = data.whole(best);
    let residual = experiment.residual(&best.parameters);
    let rows = |at: usize| &residual.as_slice()[at * t.len()..(at + 1) * t.len()];
    let swing = |from: f64, series: &[Series]| -> Option<Factor> {
        let frequency = refined(from, series, data.signals.context.duration)?;
        let count = ((sampled * 0.5 / (data.signals.period * frequency)) as usize).min(multiples);
        (count > 0).then_some(Factor::Swing { frequency, count })
    };
    let of_channel = |place: &Located| -> Option<Factor> {
        let at = experiment.channels().iter().position(|c| equation_of(*c) == place.equation)?;
        swing(place.frequency_hz?, &[(rows(at), &t)])
    };
    let mut swings: Vec<Factor> = located.iter().filter_map(of_channel).collect();
    let longest = (0..data.runs().len()).max_by_key(|run| data.samples_of(*run).len());
    if let Some(run) = longest.filter(|_| side == Side::Electrical && data.signals.kind == Kind::Full)
        && let Some(v) = &data.runs()[run].signals.v
    {
        let samples = data.samples_of(run);
        let electrical =
            (0..experiment.channels().len()).filter(|at| experiment.channels()[*at].is_electrical());
        let series: Vec<Vec<f64>> =
            electrical.flat_map(|at| with_command(&rows(at)[samples.clone()], v)).collect();
        if let Some(from) = strongest_frequency(data.signals.period, &series) {
            let own: Vec<Series> = series.iter().map(|x| (&x[..], &t[samples.clone()])).collect();
            swings.extend(swing(from, &own).filter(|found| !swings.contains(found)));
        }
    }
    swings
}

/// How fast a current leaves the model, which tells the voltage that is missing: as it is, and times the command of either axis; each with
/// squares that sum to one.
fn with_command(residual: &[f64], v: &[Vec<f64>; 2]) -> [Vec<f64>; 3] {
    let rate: Vec<f64> = residual.windows(2).map(|pair| pair[1] - pair[0]).chain([0.0]).collect();
    let times = |v: &[f64]| -> Vec<f64> { rate.iter().zip(v).map(|(r, v)| r * v).collect() };
    let scaled = |x: Vec<f64>| -> Vec<f64> {
        let length = x.iter().map(|x| x * x).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
        x.iter().map(|x| x / length).collect()
    };
    let [d, q] = [times(&v[0]), times(&v[1])];
    [rate, d, q].map(scaled)
}

/// The frequency near one line of a spectrum at which some series swing most together.
fn refined(from: f64, series: &[Series], duration: f64) -> Option<f64> {
    let power = |f: f64| {
        let of_one = |(values, t): &Series| {
            let (mut c, mut q) = (0.0, 0.0);
            for (x, t) in values.iter().zip(t.iter()) {
                let (sin, cos) = Real::sin_cos(TAU * f * t);
                c += x * cos;
                q += x * sin;
            }
            c * c + q * q
        };
        series.iter().map(of_one).sum::<f64>()
    };
    let finest = |from: f64, over: f64| {
        let tried = (-REFINED..=REFINED).map(|k| from + f64::from(k) / f64::from(REFINED) * over);
        tried.map(|f| (f, power(f))).max_by(|a, b| a.1.total_cmp(&b.1)).map(|(f, _)| f)
    };
    finest(finest(from, 1.0 / duration)?, 1.0 / (duration * f64::from(REFINED)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frequency_is_refined_to_far_within_a_line_of_the_spectrum() {
        let t: Vec<f64> = (0..4000).map(|k| 5e-4 * f64::from(k)).collect();
        let x: Vec<f64> = t.iter().map(|t| (TAU * 83.217 * t + 0.3).cos()).collect();
        let found = refined(83.0, &[(&x, &t)], 2.0).unwrap();
        assert!((found - 83.217).abs() < 0.01, "{found}");
    }

    #[test]
    fn a_swing_that_follows_the_sign_of_the_command_is_one_line_times_the_command() {
        // A current that answers to a link that swings, under a voltage that reverses.
        let t: Vec<f64> = (0..4000).map(|k| 5e-4 * f64::from(k)).collect();
        let v_q: Vec<f64> = t.iter().map(|t| if *t < 1.0 { 10.0 } else { -10.0 }).collect();
        let residual: Vec<f64> = t.iter().zip(&v_q).map(|(t, v)| v * (TAU * 90.0 * t).sin()).collect();
        let series = with_command(&residual, &[vec![0.0; 4000], v_q]);
        let line = |x: &[f64]| {
            let (c, s) = x.iter().zip(&t).fold((0.0, 0.0), |(c, s), (x, t)| {
                (c + x * (TAU * 90.0 * t).cos(), s + x * (TAU * 90.0 * t).sin())
            });
            2.0 * (c * c + s * s) / 4000.0
        };
        assert!(
            line(&series[0]) < 0.01 && line(&series[2]) > 0.9,
            "{} {}",
            line(&series[0]),
            line(&series[2])
        );
        let found = strongest_frequency(5e-4, &series).unwrap();
        assert!((found - 90.0).abs() < 0.6, "{found}");
    }
}
