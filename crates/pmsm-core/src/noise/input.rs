//! How far the logged voltage is from the one that acted: noise of a voltage measurement, and what an average over several
//! control periods hides.
//!
//! Voltage noise σ_v makes the current of a free run wander by s = σ_v·h/l per sample. Third differences over a lag of m samples have
//! the variance 20·σ_i² + 6·m·s² then: they see the sensors' white noise σ_i, which the log tells by itself, and the wandering, but
//! neither physics that is smooth over 3·m samples nor, through the median, rare transients.

use crate::signals::{Finding, Signals};

/// Lags over which the wandering is looked for, samples; the last one only where the others show nothing for certain, as it sees the
/// most physics: large inductances let noise through slowly.
const LAGS: [usize; 5] = [1, 2, 4, 8, FAR];
const FAR: usize = 16;
/// Share of the samples that must have a difference over a lag: of short pieces between gaps long lags see hardly any.
const FEWEST: f64 = 0.25;
/// A longer lag that shows more than this factor of what a shorter one did sees physics.
const GROWTH: f64 = 1.2;
/// Relative standard error of the wandering's variance at which no longer lag is asked: longer ones see more physics.
const PRECISE: f64 = 0.05;
/// Standard errors from which noise counts as found.
const SIGNIFICANT: f64 = 4.0;
/// Log periods over control periods from which a voltage counts as averaged.
const AVERAGED: f64 = 1.5;
/// Relative standard error of such a variance of white noise, times the root of the number of samples: the median is 1.65 times as
/// uncertain as the mean, and third differences are correlated.
const UNCERTAIN: f64 = 3.6;
/// Median of the square of a standard normal number.
const MEDIAN: f64 = 0.454_936;

/// Noise that enters the voltage equations, beside that of the current sensors.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct InputNoise {
    /// Standard deviation of white noise on the logged voltage, V per axis.
    pub voltage: f64,
    /// Change of the voltage within a sample of the log, V per sample, where it was averaged over several control periods; empty
    /// where each sample is one period.
    pub hidden: Vec<f64>,
    /// Whether the voltage is drawn straight from one mean to the next.
    pub drawn: bool,
}

impl InputNoise {
    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        self.voltage == 0.0 && self.hidden.is_empty()
    }

    /// Standard deviation of the voltage's error in the interval that begins at sample `k`, V. A step Δ at an unknown place of an
    /// interval whose mean voltage is known acts like an error Δ·h·a·√(1/120), with a the fastest rate of the dynamics.
    pub fn at(&self, k: usize, turn: f64) -> f64 {
        let hidden =
            self.hidden.get(k).filter(|_| !self.drawn).map_or(0.0, |step| step * turn / 120f64.sqrt());
        self.voltage.hypot(hidden)
    }

    /// Standard deviation of the error of a mean voltage that is drawn straight to the next one, V: a step Δ at an unknown place of its
    /// interval is worth Δ·√(1/120) up to the middle of that, and as much less behind it.
    pub fn between_means(&self, k: usize) -> f64 {
        self.hidden.get(k).filter(|_| self.drawn).map_or(0.0, |step| step / 120f64.sqrt())
    }
}

impl InputNoise {
    /// Reads it from the current residuals `rest` (A, d and q) of a fitted free run of a machine with the inductances `l` (d, q), H, and the
    /// sensors' noise in each axis, A; `known` says that this was measured without any model. Otherwise it is corrected in place.
    pub fn estimate(
        signals: &Signals,
        l: [f64; 2],
        rest: [&[f64]; 2],
        sensor: &mut [f64; 2],
        known: bool,
    ) -> Self {
        let h = signals.period;
        let mut wander = [(0.0, 0.0); 2];
        let count = (signals.len() as f64).sqrt();
        for axis in 0..2 {
            let spread: Vec<f64> = LAGS.iter().map(|m| third_differences(signals, rest[axis], *m)).collect();
            if !known {
                // From lags of one and four.
                let step = (spread[2] - spread[0]) / 18.0;
                let noise = (spread[0] - 6.0 * step.max(0.0)) / 20.0;
                let certain = 18.0 * step > SIGNIFICANT * 2.0 * UNCERTAIN * spread[2] / count;
                sensor[axis] = if certain { noise } else { spread[0] / 20.0 }.max(0.0).sqrt();
            }
            // Noise of the sensors that lasts shows over all lags, by itself.
            let own = signals.limits.current_noise.as_ref();
            let white = |m: usize| {
                own.map_or(20.0 * sensor[axis].powi(2), |x| third_differences(signals, &x.series, m))
            };
            let mut found: Option<(f64, f64)> = None;
            for (m, variance) in LAGS.iter().zip(&spread) {
                let known = found.is_some_and(|(square, error)| square > SIGNIFICANT * error);
                if (*m == FAR && known)
                    || (found.is_some() && differences(signals, *m) < FEWEST * count * count)
                {
                    break;
                }
                let (white, m) = (white(*m), *m as f64);
                let scale = 6.0 * m * (h / l[axis]).powi(2);
                let rest = variance - white;
                let square = rest / scale;
                let error = UNCERTAIN * (white + rest.abs() * m.sqrt()) / (count * scale);
                match found {
                    Some((before, doubt)) if square > GROWTH * before.max(0.0) + 2.0 * doubt => break,
                    _ => found = Some((square, error)),
                }
                if error < PRECISE * square {
                    break;
                }
            }
            wander[axis] = found.unwrap_or((0.0, f64::INFINITY));
        }
        // Both axes see the same noise; the one that sees it better counts more.
        let weight: f64 = wander.iter().map(|(_, error)| error.powi(-2)).sum();
        let square = wander.iter().map(|(square, error)| square * error.powi(-2)).sum::<f64>() / weight;
        let voltage = if square > SIGNIFICANT / weight.sqrt() { square.sqrt() } else { 0.0 };
        Self { voltage, hidden: hidden(signals), drawn: signals.voltages_drawn }
    }
}

impl InputNoise {
    /// What the user should know of it.
    pub fn findings(&self, signals: &Signals) -> Vec<Finding> {
        let mut out = Vec::new();
        if self.voltage > 0.0 {
            out.push(Finding {
                finding: format!(
                    "the logged voltage carries noise of {:.3} V per axis, {:.2} % of the link voltage",
                    self.voltage,
                    100.0 * self.voltage / signals.context.v_dc
                ),
                consequence:
                    "simulated currents wander by themselves; weak effects in the voltage equations drown"
                        .into(),
                fix: "log the commanded voltage instead of a measured one, or measure it with less noise"
                    .into(),
            });
        }
        out.extend(self.of_rows(signals));
        out
    }

    /// What the user should know of rows that each cover several control periods.
    pub fn of_rows(&self, signals: &Signals) -> Option<Finding> {
        let control = signals.control_period.filter(|_| !self.hidden.is_empty())?;
        Some(Finding {
            finding: format!("one row of the log covers {:.1} control periods", signals.period / control),
            consequence: "what the voltage did between the rows is unknown; transients count less".into(),
            fix: "log every control period, or the mean of the voltages commanded from one row to the next"
                .into(),
        })
    }
}

/// Number of third differences over `lag` samples.
fn differences(signals: &Signals, lag: usize) -> f64 {
    signals.segments.iter().map(|s| s.len().saturating_sub(3 * lag)).sum::<usize>() as f64
}

/// Variance of third differences over `lag` samples, by the median.
fn third_differences(signals: &Signals, x: &[f64], lag: usize) -> f64 {
    let mut squares: Vec<f64> = Vec::with_capacity(x.len());
    for segment in &signals.segments {
        for k in segment.start..segment.end.saturating_sub(3 * lag) {
            let difference = x[k + 3 * lag] - 3.0 * (x[k + 2 * lag] - x[k + lag]) - x[k];
            squares.push(difference * difference);
        }
    }
    if squares.is_empty() {
        return 0.0;
    }
    let middle = squares.len() / 2;
    *squares.select_nth_unstable_by(middle, f64::total_cmp).1 / MEDIAN
}

/// Steps of the voltage over the neighbours of each sample, where the log averages over several control periods; where it is drawn, by how much it is
/// not straight there.
fn hidden(signals: &Signals) -> Vec<f64> {
    let (Some(v), Some(control)) = (&signals.v, signals.control_period) else { return Vec::new() };
    if signals.period < AVERAGED * control {
        return Vec::new();
    }
    let n = signals.len();
    (0..n)
        .map(|k| {
            let (before, after) = (k.saturating_sub(1), (k + 1).min(n - 1));
            let change = |x: &[f64]| match signals.voltages_drawn {
                // Of a step half is in the mean of two rows.
                true => 2.0 * (x[after] - 2.0 * x[k] + x[before]),
                false => x[after] - x[before],
            };
            change(&v[0]).hypot(change(&v[1]))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Machine;
    use crate::numerics::random::normal_pair;
    use crate::recording::Recording;

    const COUNT: usize = 40_000;

    fn running() -> Signals {
        let t: Vec<f64> = (0..COUNT).map(|k| 1e-4 * k as f64).collect();
        let column = |f: fn(f64) -> f64| t.iter().map(|t| f(*t)).collect::<Vec<f64>>();
        let columns = [
            ("t", column(|t| t)),
            ("omega_e", column(|t| 400.0 * (9.0 * t).cos())),
            ("theta_e", column(|t| 400.0 / 9.0 * (9.0 * t).sin())),
            ("v_d", column(|t| -5.0 * (20.0 * t).sin())),
            ("v_q", column(|t| 40.0 * (9.0 * t).cos())),
            ("i_d", column(|t| -2.0 + (30.0 * t).sin())),
            ("i_q", column(|t| 4.0 * (14.0 * t).cos())),
        ];
        let recording = Recording::new(columns.map(|(n, x)| (n.to_owned(), x)).to_vec(), None).unwrap();
        Signals::new(&recording, &Machine::new(4).unwrap()).unwrap()
    }

    /// The voltage noise found, relative to the true one, where currents measured with noise of 1 A wander by `step` A per sample and
    /// swing by `swing` A in 64 samples.
    fn found(step: f64, swing: f64) -> f64 {
        found_in(running(), step, swing)
    }

    fn found_in(signals: Signals, step: f64, swing: f64) -> f64 {
        let l = signals.period / step.max(1e-3);
        let wandering = |axis: u32| -> Vec<f64> {
            let mut at = 0.0;
            let place = |k: usize| {
                let (noise, moved) = normal_pair(7, [k as u32, axis, 0, 0]);
                at += step * moved;
                at + noise + swing * (std::f64::consts::TAU * k as f64 / 64.0).sin()
            };
            (0..COUNT).map(place).collect()
        };
        let rest = [wandering(0), wandering(1)];
        InputNoise::estimate(&signals, [l; 2], [&rest[0], &rest[1]], &mut [1.0; 2], true).voltage
    }

    #[test]
    fn noise_that_large_inductances_let_through_slowly_is_found() {
        assert!((found(0.15, 0.0) - 1.0).abs() < 0.2, "{}", found(0.15, 0.0));
    }

    #[test]
    fn the_farthest_lag_is_not_asked_where_noise_is_certain() {
        assert!((found(0.5, 1.0) - 1.0).abs() < 0.05, "{}", found(0.5, 1.0));
    }

    #[test]
    fn pieces_too_short_for_a_lag_do_not_hide_what_shorter_ones_show() {
        let mut signals = running();
        signals.segments = (0..COUNT / 40).map(|k| 40 * k..40 * (k + 1)).collect();
        let found = found_in(signals, 0.18, 0.0);
        assert!((found - 1.0).abs() < 0.2, "{found}");
    }

    #[test]
    fn sensors_alone_make_no_noise_of_the_voltage() {
        assert_eq!(found(0.0, 0.0), 0.0);
    }
}
