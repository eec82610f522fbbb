//! What moved between windows, and what that looks like: heat, load, or a model that leaves something out.
//!
//! Two series of past results are tested alike: the last [`RECENT`] windows, and the whole run thinned out
//! to at most [`LONG`] points, each a weighted mean of equally many windows. A parameter *trends* if the slope of its
//! weighted regression on time is more than [`SIGNIFICANT`] standard errors (widened where the points scatter more than
//! their errors say) and no step of the series goes back by more than [`BACK`] standard errors of a difference; it
//! *jumps* if this window differs from the last by more than [`SIGNIFICANT`] of those and it was not on its way there.
//!
//! - r_s rising by a trend while current flows, or falling by one after the mean of i² fell, looks thermal; so does a
//!   falling psi_m.
//! - A jump or a trend of the load torque, of J or of B looks like load.
//! - r_s that jumps, or trends where heat cannot be the reason, and inductances that move are read as a mismatch; so is a
//!   residual that is not white: of n samples with white noise σ (from third differences) and a residual of variance v,
//!   (v/σ² − 1)/√(2.62/n) is standard normal if the model is right; more than [`words::WHITE`] counts where v also exceeds
//!   [`words::EXCESS`]·σ² and the excess a thousandth of the channel's peak.

mod words;

use super::noise::Noise;
use crate::identify::Target;
use serde::{Deserialize, Serialize};

/// Windows of the short series.
const RECENT: usize = 8;
/// Points of the long series.
const LONG: usize = 32;
/// Fewest points of a trend.
const FEWEST: usize = 4;
/// Standard errors from which a slope or a jump counts.
const SIGNIFICANT: f64 = 5.0;
/// Standard errors by which a trend may go back.
const BACK: f64 = 3.0;
/// How much farther a jump goes than any step before it.
const SUDDEN: f64 = 3.0;

/// What a movement looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The winding or the magnets change their temperature.
    Thermal,
    /// The load, or what turns with the rotor, changes.
    Load,
    /// The model leaves something out, and the estimates take it up.
    Mismatch,
}

/// The reading of one window.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Drift {
    /// What it looks like; empty if nothing moved by more than its uncertainty. `None` for a skipped window.
    pub looks_like: Option<Vec<Cause>>,
    /// The same in plain words with the figures behind it.
    pub sentence: String,
}

impl Drift {
    /// That of a skipped window.
    pub fn unknown() -> Self {
        Self { looks_like: None, sentence: "Nothing is known of this window.".into() }
    }
}

/// What a window, or several together, left behind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Past {
    /// Its middle, s.
    pub t: f64,
    /// Mean square of the current, A².
    pub heat: Option<f64>,
    /// Parameter, value, standard error.
    pub values: Vec<(Target, f64, f64)>,
}

/// The past results that are kept.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct History {
    recent: Vec<Past>,
    long: Vec<Past>,
    /// Windows per point of the long series (0 before the first window).
    stride: u64,
    /// The point under way, and how many windows it is the mean of.
    waiting: Option<Past>,
    waited: u64,
}

/// One parameter over time: (t, value, standard error, heat).
type Series = Vec<(f64, f64, f64, Option<f64>)>;

#[derive(Debug, Clone, Copy)]
enum Move {
    /// Change over the series, its first value, and its length in s.
    Trend {
        change: f64,
        from: f64,
        time: f64,
        cooled: bool,
        current: bool,
    },
    Jump {
        change: f64,
        from: f64,
    },
}

impl History {
    /// Reads window `now` against the past and adds it; `rms` and `noise` are those of its channels, `n` its samples.
    pub fn read(&mut self, now: &Past, rms: &[(&'static str, f64)], noise: &[Noise], n: usize) -> Drift {
        // A log that was restarted has a time of its own.
        if self.recent.last().is_some_and(|last| last.t >= now.t) {
            *self = Self::default();
        }
        self.add(now.clone());
        let mut causes = Vec::new();
        let mut said = Vec::new();
        for target in now.values.iter().map(|(target, ..)| *target) {
            let Some(moved) = self.moved(target) else { continue };
            let (cause, words) = words::explain(target, moved);
            causes.push(cause);
            said.push(words);
        }
        if let Some(words) = words::coloured(rms, noise, n) {
            causes.push(Cause::Mismatch);
            said.push(words);
        }
        causes.sort_by_key(|cause| *cause as usize);
        causes.dedup();
        let sentence = if said.is_empty() {
            "Nothing moved by more than its uncertainty.".to_owned()
        } else {
            said.join(" ")
        };
        Drift { looks_like: Some(causes), sentence }
    }

    /// Whether everything in it can have come about by [`History::read`].
    pub fn is_sound(&self) -> bool {
        let finite = |p: &Past| {
            p.t.is_finite()
                && p.heat.is_none_or(|x| x.is_finite() && x >= 0.0)
                && p.values.len() <= Target::ALL.len()
                && p.values.iter().all(|(_, x, s)| x.is_finite() && s.is_finite() && *s > 0.0)
        };
        let ordered = |x: &[Past]| x.windows(2).all(|pair| pair[0].t < pair[1].t) && x.iter().all(finite);
        ordered(&self.recent)
            && ordered(&self.long)
            && self.waiting.iter().all(finite)
            && self.recent.len() <= RECENT
            && self.long.len() < LONG
            && self.waiting.is_some() == (self.waited > 0)
            && (self.waited < self.stride || self.waited == 0)
            && self.stride < 1 << 53
    }

    fn add(&mut self, now: Past) {
        if self.recent.len() == RECENT {
            self.recent.remove(0);
        }
        self.recent.push(now.clone());
        self.stride = self.stride.max(1);
        let point = match self.waiting.take() {
            Some(before) => mean(&before, self.waited, &now),
            None => now,
        };
        self.waited += 1;
        if self.waited < self.stride {
            self.waiting = Some(point);
            return;
        }
        self.waited = 0;
        self.long.push(point);
        if self.long.len() == LONG {
            self.long = self.long.chunks(2).map(|pair| mean(&pair[0], 1, &pair[1])).collect();
            self.stride *= 2;
        }
    }

    fn series(past: &[Past], target: Target) -> Series {
        let of =
            |p: &Past| p.values.iter().find(|(t, ..)| *t == target).map(|(_, x, s)| (p.t, *x, *s, p.heat));
        past.iter().filter_map(of).collect()
    }

    fn moved(&self, target: Target) -> Option<Move> {
        let recent = Self::series(&self.recent, target);
        if let Some(steady) = trend(&recent) {
            return Some(steady);
        }
        if let [.., before, last] = recent.as_slice() {
            let change = last.1 - before.1;
            let earlier = recent[..recent.len() - 1].windows(2).map(|x| (x[1].1 - x[0].1).abs());
            let sudden = recent.len() >= FEWEST && change.abs() > SUDDEN * earlier.fold(0.0, f64::max);
            let is_load = target == Target::TauLoad;
            if change.abs() > SIGNIFICANT * last.2.hypot(before.2) && (sudden || is_load) {
                return Some(Move::Jump { change, from: before.1 });
            }
        }
        trend(&Self::series(&self.long, target))
    }
}

/// The mean of `n` results whose mean is `a`, and of `b`: values weighted by their standard errors.
fn mean(a: &Past, n: u64, b: &Past) -> Past {
    let n = n as f64;
    let plain = |a: f64, b: f64| (n * a + b) / (n + 1.0);
    let heat = match (a.heat, b.heat) {
        (Some(a), Some(b)) => Some(plain(a, b)),
        (a, b) => a.or(b),
    };
    let values = Target::ALL.into_iter().filter_map(|target| {
        let of = |p: &Past| p.values.iter().find(|(t, ..)| *t == target).copied();
        match (of(a), of(b)) {
            (Some((_, x, s)), Some((_, y, r))) => {
                let share = r * r / (s * s + r * r);
                Some((target, share * x + (1.0 - share) * y, s * (r / s.hypot(r))))
            }
            (a, b) => a.or(b),
        }
    });
    Past { t: plain(a.t, b.t), heat, values: values.collect() }
}

fn trend(series: &Series) -> Option<Move> {
    if series.len() < FEWEST {
        return None;
    }
    let (mut w, mut wt, mut wx) = (0.0, 0.0, 0.0);
    for (t, x, s, _) in series {
        let weight = 1.0 / (s * s);
        w += weight;
        wt += weight * t;
        wx += weight * x;
    }
    let (middle, level) = (wt / w, wx / w);
    let (mut tt, mut tx) = (0.0, 0.0);
    for (t, x, s, _) in series {
        let weight = 1.0 / (s * s);
        tt += weight * (t - middle).powi(2);
        tx += weight * (t - middle) * (x - level);
    }
    let slope = tx / tt;
    let scatter: f64 =
        series.iter().map(|(t, x, s, _)| ((x - level - slope * (t - middle)) / s).powi(2)).sum();
    let widen = (scatter / (series.len() - 2) as f64).max(1.0).sqrt();
    let steady = series.windows(2).all(|pair| {
        let back = -(pair[1].1 - pair[0].1) * slope.signum();
        back <= BACK * pair[0].2.hypot(pair[1].2)
    });
    if !(steady && slope.abs() * tt.sqrt() > SIGNIFICANT * widen) {
        return None;
    }
    let (first, last) = (series[0], series[series.len() - 1]);
    let time = last.0 - first.0;
    let heats: Vec<f64> = series.iter().filter_map(|(.., heat)| *heat).collect();
    let (early, late) = heats.split_at(heats.len() / 2);
    let average = |x: &[f64]| x.iter().sum::<f64>() / x.len().max(1) as f64;
    Some(Move::Trend {
        change: slope * time,
        from: first.1,
        time,
        cooled: average(late) < average(early),
        current: average(&heats) > 0.0,
    })
}
