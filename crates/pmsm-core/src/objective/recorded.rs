//! Residual and derivatives of a run of perturbed copies, without what the initial values can still do.

use crate::bare::Kernel;
use crate::bare::copies::{self, INITIAL};
use crate::experiment::Linearisation;
use crate::lanes::{self, Job, Lane};
use nalgebra::{DMatrix, DVector, Vector3};
use std::ops::Range;

/// Channels of a sample: i_d, i_q, ω_e.
const CHANNELS: usize = 3;
/// Numbers of a row that are read at a time; a row has one or two times as many.
const PART: usize = 8;

/// Rows as they come from the kernels, see [`copies::Rows`], and what becomes of them once it is known what the initial values
/// can still do.
pub(super) struct Recorded {
    rows: Vec<f64>,
    linear: Linearisation,
}

impl Recorded {
    pub(super) fn room(samples: usize, free: usize) -> Self {
        let linear = Linearisation {
            residual: DVector::zeros(CHANNELS * samples),
            jacobian: DMatrix::zeros(CHANNELS * samples, free),
        };
        Self { rows: Vec::with_capacity(CHANNELS * samples * copies::width(free)), linear }
    }

    /// Where the rows go, one behind the other.
    pub(super) fn rows(&mut self) -> &mut Vec<f64> {
        &mut self.rows
    }

    /// Whether the rows of all samples are there: a run that was stopped has not recorded all.
    pub(super) fn is_complete(&self) -> bool {
        self.rows.len() == copies::width(self.linear.jacobian.ncols()) * self.linear.residual.len()
    }

    /// Writes down residual and derivatives of a segment without what the initial values can still do: derivatives follow
    /// them by `slopes`, the residual by `error`.
    pub(super) fn project(
        &mut self,
        kernel: Kernel,
        segment: &Range<usize>,
        slopes: &[Vector3<f64>],
        error: &Vector3<f64>,
    ) {
        let Linearisation { residual, jacobian } = &mut self.linear;
        let (samples, width) = (residual.len() / CHANNELS, copies::width(slopes.len()));
        let job = Projection {
            rows: &self.rows[CHANNELS * width * segment.start..CHANNELS * width * segment.end],
            residual: residual.as_mut_slice(),
            jacobian: jacobian.as_mut_slice(),
            first: segment.start,
            samples,
            slopes,
            error,
        };
        lanes::run(kernel.path, kernel.rounding, job);
    }

    pub(super) fn linear(self) -> Linearisation {
        self.linear
    }
}

/// One segment on its way from rows to columns.
struct Projection<'a> {
    rows: &'a [f64],
    residual: &'a mut [f64],
    jacobian: &'a mut [f64],
    /// Number of its first sample in the recording, and samples of the recording.
    first: usize,
    samples: usize,
    slopes: &'a [Vector3<f64>],
    error: &'a Vector3<f64>,
}

impl Job for Projection<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(mut self) {
        match copies::width(self.slopes.len()) / PART {
            1 => self.columns::<V, 1>(),
            2 => self.columns::<V, 2>(),
            parts => unreachable!("{parts} parts of a row: more than all parameters and initial values"),
        }
    }
}

impl Projection<'_> {
    /// Of rows of `PARTS` parts.
    #[inline(always)]
    fn columns<V: Lane, const PARTS: usize>(&mut self) {
        let count = self.rows.len() / (CHANNELS * PART * PARTS);
        let full = count - count % V::WIDTH;
        for sample in (0..full).step_by(V::WIDTH) {
            self.group::<V, PARTS>(sample);
        }
        for sample in full..count {
            self.group::<f64, PARTS>(sample);
        }
    }

    /// As many samples as a vector holds, from number `sample` of the segment on.
    #[inline(always)]
    fn group<V: Lane, const PARTS: usize>(&mut self, sample: usize) {
        let (size, free) = (PART * PARTS, self.slopes.len());
        let begin: [usize; PART] = std::array::from_fn(|lane| CHANNELS * lane);
        for channel in 0..CHANNELS {
            let mut row = [[V::zero(); PART]; PARTS];
            for part in 0..PARTS {
                let (records, k) = (&self.rows[part * PART..], CHANNELS * sample + channel);
                row[part] = V::columns::<PART>(records, &begin, size, k);
            }
            let column = |n: usize| row[n / PART][n % PART];
            let initial: [V; INITIAL] = std::array::from_fn(|k| column(free + k));
            let follow = |by: &Vector3<f64>| initial[0] * by[0] + initial[1] * by[1] + initial[2] * by[2];
            let at = channel * self.samples + self.first + sample;
            (column(size - 1) - follow(self.error)).store(&mut self.residual[at..]);
            for (k, by) in self.slopes.iter().enumerate() {
                let at = k * CHANNELS * self.samples + at;
                (column(k) + follow(by)).store(&mut self.jacobian[at..]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::{Path, Rounding};

    /// Samples behind the projected ones.
    const BEHIND: usize = 2;

    /// Rows with no pattern in them, and what becomes of `count` samples of them behind `skipped` others.
    fn projected(kernel: Kernel, free: usize, skipped: usize, count: usize) -> Linearisation {
        let samples = skipped + count + BEHIND;
        let mut recorded = Recorded::room(samples, free);
        let numbers = CHANNELS * samples * copies::width(free);
        recorded.rows().extend((0..numbers).map(|k| (k as f64 * 0.7).sin()));
        assert!(recorded.is_complete());
        let slopes: Vec<_> = (0..free).map(|k| Vector3::new(0.3, -1.0, 0.1 * k as f64)).collect();
        recorded.project(kernel, &(skipped..skipped + count), &slopes, &Vector3::new(0.5, 2.0, -0.2));
        recorded.linear()
    }

    #[test]
    fn a_projection_takes_out_what_the_initial_values_do_on_every_path() {
        for (free, skipped, count) in [(0, 0, 16), (2, 3, 19), (4, 8, 8), (5, 0, 21), (7, 5, 3)] {
            let (width, samples) = (copies::width(free), skipped + count + BEHIND);
            let number = |sample: usize, channel: usize, column: usize| {
                (((CHANNELS * sample + channel) * width + column) as f64 * 0.7).sin()
            };
            let kernel = |path, rounding| Kernel { path, rounding, ..Kernel::default() };
            let plain = projected(kernel(Path::Portable, Rounding::Reproducible), free, skipped, count);
            for sample in 0..samples {
                for channel in 0..CHANNELS {
                    let x: Vec<f64> = (0..width).map(|column| number(sample, channel, column)).collect();
                    let initial = &x[free..];
                    let at = channel * samples + sample;
                    if !(skipped..skipped + count).contains(&sample) {
                        assert_eq!(plain.residual[at], 0.0);
                        assert!(plain.jacobian.row(at).iter().all(|x| *x == 0.0));
                        continue;
                    }
                    let error = x[width - 1] - (0.5 * initial[0] + 2.0 * initial[1] - 0.2 * initial[2]);
                    assert!((plain.residual[at] - error).abs() < 1e-14);
                    for k in 0..free {
                        let follow = 0.3 * initial[0] - initial[1] + 0.1 * k as f64 * initial[2];
                        assert!((plain.jacobian[(at, k)] - (x[k] + follow)).abs() < 1e-14);
                    }
                }
            }
            for path in Path::ALL {
                for rounding in [Rounding::Reproducible, Rounding::Fused] {
                    let other = projected(kernel(path, rounding), free, skipped, count);
                    assert_eq!(other.residual, plain.residual, "{path:?}");
                    assert_eq!(other.jacobian, plain.jacobian, "{path:?}");
                }
            }
        }
    }
}
