//! A recording as the kernels read it.

use super::step::Scale;
use crate::recording::Load;
use crate::signals::Signals;
use crate::simulate::coupled;
use std::ops::Range;

/// Largest relative deviation of a sample interval from the mean that still counts as uniform: what writing times down
/// in double precision does to them.
const UNIFORM: f64 = 1e-6;

/// A gap-free stretch of a recording.
#[derive(Debug, Clone)]
pub(super) struct Segment {
    /// Its samples in the recording.
    pub range: Range<usize>,
    /// The measured i_d, i_q (A), ω_e (rad/s) of its first sample.
    pub first: [f64; 3],
    /// Scales of the states there.
    pub scale: Scale,
    /// Steps per sample.
    pub pieces: usize,
    /// Weight of ω_e over g.
    pub show_w: f64,
    /// Its samples, see [`super::step::Sample`], and one of zeros behind them.
    padded: Vec<[f64; 6]>,
}

impl Segment {
    /// Its samples.
    pub fn samples(&self) -> &[[f64; 6]] {
        &self.padded[..self.range.len()]
    }

    /// Its samples one after the other, with room to read eight numbers at the last one.
    pub fn records(&self) -> &[f64] {
        self.padded.as_flattened()
    }

    /// The measured i_d, i_q (A), ω_e (rad/s) of sample number `k` of the segment.
    pub fn measured(&self, k: usize) -> [f64; 3] {
        let sample = &self.padded[k];
        let Scale { g, current, .. } = self.scale;
        [-sample[2] / current, -sample[3] / current, -sample[4] / (self.show_w * g)]
    }
}

/// A uniformly sampled recording, scaled for the kernels.
#[derive(Debug, Clone)]
pub struct Track {
    pub(super) segments: Vec<Segment>,
    pub(super) has_load: bool,
}

impl Track {
    /// Prepares a recording in which a squared error of i_d or i_q counts `current` and one of ω_e `speed`. `None` without
    /// voltages or currents, or where the samples are not evenly spaced.
    pub fn new(signals: &Signals, current: f64, speed: f64) -> Option<Self> {
        let (Some(v), Some(i)) = (&signals.v, &signals.i) else { return None };
        let omega = &signals.omega_e;
        let (current, speed) = (current.sqrt(), speed.sqrt());
        let mut segments = Vec::with_capacity(signals.segments.len());
        for range in &signals.segments {
            let (start, end) = (range.start, range.end);
            let t = &signals.t[range.clone()];
            let h = if t.len() > 1 { (t[t.len() - 1] - t[0]) / (t.len() - 1) as f64 } else { signals.period };
            if !t.windows(2).all(|pair| (pair[1] - pair[0] - h).abs() <= UNIFORM * h) {
                return None;
            }
            let pieces = coupled::pieces(coupled::fastest_rate(signals, range), h);
            let g = 0.5 * h / pieces as f64;
            let mut padded = Vec::with_capacity(range.len() + 1);
            for k in range.clone() {
                let load = coupled::known_load(signals, k, end);
                let measured = [-current * i[0][k], -current * i[1][k], -speed * omega[k]];
                padded.push([g * v[0][k], g * v[1][k], measured[0], measured[1], measured[2], load]);
            }
            padded.push([0.0; 6]);
            segments.push(Segment {
                range: range.clone(),
                first: [i[0][start], i[1][start], omega[start]],
                scale: Scale { g, n_p: signals.n_p, current },
                pieces,
                show_w: speed / g,
                padded,
            });
        }
        let has_load = matches!(signals.load, Load::KnownConstant(_) | Load::Measured);
        Some(Self { segments, has_load })
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.segments.iter().map(|s| s.range.len()).sum()
    }

    /// True without samples.
    pub fn is_empty(&self) -> bool {
        self.segments.is_empty()
    }
}
