//! A recording as the kernels read it.

use super::step::{Scale, fields};
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
    /// Its samples, see [`super::step::Sample`], one after the other, and one of zeros behind them.
    records: Vec<f64>,
    /// Numbers per sample.
    fields: usize,
}

impl Segment {
    /// Its samples one after the other.
    pub fn samples(&self) -> &[f64] {
        &self.records[..self.range.len() * self.fields]
    }

    /// Its samples in parts of `count`, the last one perhaps shorter.
    pub fn stretches(&self, count: usize) -> std::slice::Chunks<'_, f64> {
        self.samples().chunks(count * self.fields)
    }

    /// Its samples with room to read eight numbers at the last one.
    pub fn records(&self) -> &[f64] {
        &self.records
    }

    /// The measured i_d, i_q (A), ω_e (rad/s) of sample number `k` of the segment.
    pub fn measured(&self, k: usize) -> [f64; 3] {
        let sample = &self.records[k * self.fields..];
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
        // A load that is not known is no column: long recordings are read as fast as memory delivers them.
        let has_load = matches!(signals.load, Load::KnownConstant(_) | Load::Measured);
        let fields = fields(has_load);
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
            let mut records = vec![0.0; (range.len() + 1) * fields];
            let columns =
                [&v[0][range.clone()], &v[1][range.clone()], &i[0][range.clone()], &i[1][range.clone()]];
            let [v_d, v_q, i_d, i_q] = columns;
            let samples = v_d.iter().zip(v_q).zip(i_d.iter().zip(i_q)).zip(&omega[range.clone()]);
            for (record, (((v_d, v_q), (i_d, i_q)), omega)) in records.chunks_exact_mut(fields).zip(samples) {
                let sample = [g * v_d, g * v_q, -current * i_d, -current * i_q, -speed * omega];
                record[..sample.len()].copy_from_slice(&sample);
            }
            if has_load {
                for (k, record) in range.clone().zip(records.chunks_exact_mut(fields)) {
                    record[fields - 1] = coupled::known_load(signals, k, end);
                }
            }
            segments.push(Segment {
                range: range.clone(),
                first: [i[0][start], i[1][start], omega[start]],
                scale: Scale { g, n_p: signals.n_p, current },
                pieces,
                show_w: speed / g,
                records,
                fields,
            });
        }
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
