//! Where a model fails, the dq-model first of all: equation, operating region, angle order, frequency, time.

mod lines;

use super::data::Data;
use super::hypothesis::Hypothesis;
use super::wording::enumerated;
use crate::experiment::Channel;
use crate::figures::fixed;
use crate::recording::Kind;
pub use lines::strongest_frequency;
use lines::{frequency, order};
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::TAU;

/// Excess mean square over the floor's from which a channel is listed.
const LISTED: f64 = 0.05;
/// Share of the excess that a region must hold, and the largest share of the samples it may take to be worth naming.
const REGION: (f64, f64) = (0.7, 0.6);
/// A range narrower than this share of its larger end is a fixed setting, not a region.
const NARROW: f64 = 0.02;
/// Blocks of a residual whose mean squares are compared, and fewest of them for a trend over the recording.
const BLOCKS: usize = 24;
const FEWEST_BLOCKS: f64 = 12.0;
/// Student's t of the logarithm of a residual's energy over time from which it is said to grow or to fade: far beyond chance, as many
/// quantities are looked at.
const TREND: f64 = 4.5;
/// Standard deviation of a floor's mean square, share of it: the floor is known to three per cent.
const FLOOR_SPREAD: f64 = 0.06;
/// Bins of equal count per variable.
const BINS: usize = 10;

/// A range of one variable.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Region {
    /// Column name of the variable.
    pub variable: String,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// SI unit.
    pub unit: String,
}

impl Region {
    /// The region in words, rounded to three digits of its larger end.
    pub fn words(&self) -> String {
        let size = self.low.abs().max(self.high.abs()).max(1e-300);
        let decimals = (2.0 - size.log10().floor()).clamp(0.0, 12.0) as usize;
        let (low, high) = (self.low, self.high);
        let [low, high] = [low, high].map(|x| fixed(x, decimals));
        format!("{} between {low} and {high} {}", self.variable, self.unit)
    }
}

/// One place of the mismatch.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Located {
    /// `d`, `q`, `mechanical` or `sensor`.
    pub equation: String,
    /// Share of the whole excess that is attributed to this equation. A mismatch of the motion that the currents cause counts as theirs.
    pub share: f64,
    /// The place in plain words.
    pub sentence: String,
    /// Operating regions that hold most of it.
    #[serde(rename = "where")]
    pub regions: Vec<Region>,
    /// Periods per electrical revolution, if it repeats with the electrical angle.
    pub order_electrical: Option<f64>,
    /// Periods per mechanical revolution, if it repeats with the mechanical angle.
    pub order_mechanical: Option<f64>,
    /// Frequency, if it swings in time, Hz.
    pub frequency_hz: Option<f64>,
    /// `grows` or `fades`, if it changes over the recording.
    pub trend: Option<String>,
    /// Probability of so much excess by chance.
    pub p_value: f64,
    /// The recordings that show it, counted from one, where not all of several do.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub recordings: Vec<usize>,
}

/// The places where the residual of `base` exceeds the floors, largest share first. Of several recordings the one with most of a channel's
/// excess is described, and named where others show none.
pub fn locate(data: &Data, base: &Hypothesis) -> Vec<Located> {
    let experiment = data.whole(base);
    let (residual, plain) = rayon::join(
        || experiment.residual(&base.parameters),
        || experiment.clone().with_plain_speed().residual(&base.parameters),
    );
    let blocks = experiment.blocks();
    let excess: Vec<f64> = base.squares.iter().map(|(_, s)| (s - 1.0).max(0.0)).collect();
    let total: f64 = excess.iter().sum();
    let mut out: Vec<Located> = experiment
        .channels()
        .par_iter()
        .filter_map(|channel| {
            let own: Vec<usize> = (0..blocks.len()).filter(|b| blocks[*b].channel == *channel).collect();
            let shown: Vec<usize> = own.iter().copied().filter(|b| excess[*b] > LISTED).collect();
            let most = *shown.iter().rev().max_by(|a, b| excess[**a].total_cmp(&excess[**b]))?;
            let seen = if channel.is_electrical() { &residual } else { &plain };
            let part = &seen.as_slice()[blocks[most].rows.clone()];
            let share = own.iter().map(|b| excess[*b]).sum::<f64>() / total;
            let number = |run: usize| data.number(run).unwrap_or(1);
            let runs: Vec<usize> = shown.iter().map(|b| number(blocks[*b].run)).collect();
            let recordings = if shown.len() < own.len() { runs } else { Vec::new() };
            let run = blocks[most].run;
            let mut at = describe(&data.runs()[run], *channel, part, excess[most], share);
            if own.len() > 1 {
                at.sentence = at.sentence.replacen(
                    &format!(" in {}", channel.name()),
                    &format!(" in {}{}", channel.name(), where_words(number(run), own.len(), &recordings)),
                    1,
                );
            }
            at.recordings = recordings;
            Some(at)
        })
        .collect();
    out.sort_by(|a, b| b.share.total_cmp(&a.share));
    out
}

/// Which of several recordings a place is described for, and whether others show it.
fn where_words(run: usize, count: usize, only: &[usize]) -> String {
    match only {
        [] if count == 2 => format!(" of recording {run}, less in recording {}", 3 - run),
        [] => format!(" of recording {run}, less in the others"),
        [one] => format!(" of recording {one} alone"),
        _ => format!(" of recording {run}, the most of recordings {}", listed(only)),
    }
}

fn listed(numbers: &[usize]) -> String {
    let words: Vec<String> = numbers.iter().map(usize::to_string).collect();
    let (last, rest) = words.split_last().expect("some recordings");
    if rest.is_empty() { last.clone() } else { format!("{} and {last}", rest.join(", ")) }
}

/// Name of the equation to which a channel belongs.
pub fn equation_of(channel: Channel) -> &'static str {
    match channel {
        Channel::ID | Channel::VD => "d",
        Channel::IQ | Channel::VQ => "q",
        Channel::OmegaE => "mechanical",
    }
}

fn describe(data: &Data, channel: Channel, residual: &[f64], excess: f64, share: f64) -> Located {
    let regions = regions(data, residual);
    let transient = data.signals.kind != Kind::OperatingPoints;
    let orders = if transient && data.signals.angle_known { order(data, residual) } else { None };
    let frequency = if transient && orders.is_none() { frequency(data, residual) } else { None };
    let n_p = data.signals.n_p;
    let (electrical, mechanical) = match orders {
        Some(order) if (order / n_p).fract().abs() < 1e-9 => (Some(order / n_p), None),
        Some(order) => (None, Some(order)),
        None => (None, None),
    };
    let trend = trend(data, residual);
    let mut located = Located {
        equation: equation_of(channel).into(),
        share,
        sentence: String::new(),
        regions,
        order_electrical: electrical,
        order_mechanical: mechanical,
        frequency_hz: frequency,
        trend,
        p_value: chance(residual),
        recordings: Vec::new(),
    };
    located.sentence = sentence(&located, channel, excess);
    located
}

fn sentence(at: &Located, channel: Channel, excess: f64) -> String {
    let equation = match at.equation.as_str() {
        "mechanical" => "The equation of motion".to_string(),
        axis => format!("The {axis}-axis voltage equation"),
    };
    let mut text = format!(
        "{equation} has a residual of {:.1} times the noise in {}",
        (1.0 + excess).sqrt(),
        channel.name()
    );
    let regions: Vec<String> = at.regions.iter().map(Region::words).collect();
    if !regions.is_empty() {
        text += &format!(", most of it for {}", enumerated(&regions));
    }
    let times = |order: f64| if order == 1.0 { "once".to_string() } else { format!("{order:.0} times") };
    if let Some(order) = at.order_electrical {
        text += &format!("; it repeats {} per electrical revolution", times(order));
    }
    if let Some(order) = at.order_mechanical {
        text += &format!("; it repeats {} per mechanical revolution", times(order));
    }
    if let Some(f) = at.frequency_hz {
        text += &format!("; it swings at {f:.1} Hz");
    }
    if let Some(trend) = &at.trend {
        text += &format!("; it {trend} over the recording");
    }
    text + "."
}

/// Per variable, the narrowest run of bins that holds most of the excess, if it is narrow enough to say something.
pub fn regions(data: &Data, residual: &[f64]) -> Vec<Region> {
    let s = &data.signals;
    let mut variables: Vec<(&str, &str, &[f64])> = vec![("omega_e", "rad/s", &s.omega_e)];
    if let Some([d, q]) = &s.i {
        variables.push(("i_d", "A", d));
        variables.push(("i_q", "A", q));
    }
    if let Some(tau) = &s.tau_e {
        variables.push(("tau_e", "N m", tau));
    }
    variables.into_iter().filter_map(|(name, unit, x)| narrowest(name, unit, x, residual)).collect()
}

fn narrowest(name: &str, unit: &str, x: &[f64], residual: &[f64]) -> Option<Region> {
    let mut order: Vec<usize> = (0..x.len()).collect();
    order.sort_by(|a, b| x[*a].total_cmp(&x[*b]));
    if x[order[0]] == x[order[order.len() - 1]] {
        return None;
    }
    let edge = |bin: usize| bin * order.len() / BINS;
    let excess: Vec<f64> = (0..BINS)
        .map(|b| order[edge(b)..edge(b + 1)].iter().map(|k| (residual[*k].powi(2) - 1.0).max(0.0)).sum())
        .collect();
    let total: f64 = excess.iter().sum();
    for width in 1..=((REGION.1 * BINS as f64) as usize) {
        let run = (0..=BINS - width)
            .map(|b| (b, excess[b..b + width].iter().sum::<f64>()))
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        if run.1 > REGION.0 * total {
            let (low, high) = (x[order[edge(run.0)]], x[order[edge(run.0 + width) - 1]]);
            if high - low < NARROW * low.abs().max(high.abs()) {
                return None;
            }
            return Some(Region { variable: name.into(), low, high, unit: unit.into() });
        }
    }
    None
}

/// Mean squares of blocks of the residual.
fn blocks(residual: &[f64]) -> Vec<f64> {
    let size = (residual.len() / BLOCKS).max(1);
    residual.chunks(size).map(|b| b.iter().map(|r| r * r).sum::<f64>() / b.len() as f64).collect()
}

fn trend(data: &Data, residual: &[f64]) -> Option<String> {
    let energy: Vec<f64> = blocks(residual).iter().map(|b| b.max(1e-300).ln()).collect();
    let n = energy.len() as f64;
    if n < FEWEST_BLOCKS || data.signals.kind == Kind::OperatingPoints {
        return None;
    }
    let mean = energy.iter().sum::<f64>() / n;
    let centre = (n - 1.0) / 2.0;
    let (mut xy, mut xx, mut yy) = (0.0, 0.0, 0.0);
    for (k, e) in energy.iter().enumerate() {
        let x = k as f64 - centre;
        xy += x * (e - mean);
        xx += x * x;
        yy += (e - mean).powi(2);
    }
    let correlation = xy / (xx * yy).sqrt().max(f64::MIN_POSITIVE);
    let score = correlation * ((n - 2.0) / (1.0 - correlation * correlation).max(1e-9)).sqrt();
    (score.abs() > TREND).then(|| if score > 0.0 { "grows" } else { "fades" }.to_string())
}

/// One-sided probability that blocks of pure noise average so much more than the floor, from their own scatter and a
/// floor that is known to three per cent.
fn chance(residual: &[f64]) -> f64 {
    let energy = blocks(residual);
    let n = energy.len() as f64;
    let mean = energy.iter().sum::<f64>() / n;
    let scatter = energy.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0) / n;
    let z = (mean - 1.0) / (scatter + FLOOR_SPREAD.powi(2)).sqrt();
    upper_tail(z)
}

/// Upper tail of the normal distribution (Abramowitz & Stegun 7.1.26, with its asymptote far out).
pub fn upper_tail(z: f64) -> f64 {
    if z < 0.0 {
        return 1.0 - upper_tail(-z);
    }
    if z > 5.0 {
        return ((-0.5 * z * z).exp() / (z * TAU.sqrt())).max(1e-300);
    }
    let x = z / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let poly = t
        * (0.254_829_592
            + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    0.5 * poly * (-x * x).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normal_tail_is_right_where_it_is_known() {
        for (z, p) in [(0.0, 0.5), (1.0, 0.158_655_25), (1.96, 0.024_997_9), (-1.0, 0.841_344_75)] {
            assert!((upper_tail(z) - p).abs() < 2e-7, "{z}");
        }
        assert!((upper_tail(6.0) / 9.865_9e-10 - 1.0).abs() < 0.03);
    }

    #[test]
    fn noise_is_not_significant_and_excess_is() {
        let noise: Vec<f64> = (0..4800).map(|k| if k % 2 == 0 { 1.0 } else { -1.0 }).collect();
        assert!(chance(&noise) > 0.3);
        let loud: Vec<f64> = noise.iter().map(|x| 2.0 * x).collect();
        assert!(chance(&loud) < 1e-6);
    }
}
