//! Residual and derivatives of a run of perturbed copies, without what the initial values can still do.

use crate::experiment::Linearisation;
use crate::kernels::bare::Kernel;
use crate::kernels::bare::copies::{self, INITIAL};
use crate::numerics::lanes::{self, Job, Lane};
use nalgebra::{DMatrix, DVector, Vector3};
use std::array::from_fn;
use std::ops::Range;

/// Channels of a sample: i_d, i_q, ω_e.
const CHANNELS: usize = 3;
/// Numbers of a row that are read at a time; a row has one or two times as many.
const PART: usize = 8;

/// A run as its rows come from the kernels, see [`copies::Rows`], and what becomes of it once it is known what the initial values
/// can still do.
pub(super) struct Recorded {
    linear: Linearisation,
    /// Derivatives with respect to the initial values, one column each.
    initial: DMatrix<f64>,
    /// Number of samples that have come.
    come: usize,
}

impl Recorded {
    pub(super) fn room(samples: usize, free: usize) -> Self {
        let columns = |count| DMatrix::zeros(CHANNELS * samples, count);
        let linear = Linearisation { residual: DVector::zeros(CHANNELS * samples), jacobian: columns(free) };
        Self { linear, initial: columns(INITIAL), come: 0 }
    }

    fn samples(&self) -> usize {
        self.linear.residual.len() / CHANNELS
    }

    /// Takes the rows of the next samples.
    pub(super) fn take(&mut self, kernel: Kernel, rows: &[f64]) {
        let (samples, first) = (self.samples(), self.come);
        let Linearisation { residual, jacobian } = &mut self.linear;
        let free = jacobian.ncols();
        let (residual, jacobian) = (residual.as_mut_slice(), jacobian.as_mut_slice());
        let initial = self.initial.as_mut_slice();
        let job = Columns { rows, free, residual, jacobian, initial, first, samples };
        lanes::run(kernel.path, kernel.rounding, job);
        self.come += rows.len() / (CHANNELS * copies::width(free));
    }

    /// Whether the rows of all samples are there: a run that was stopped has not recorded all.
    pub(super) fn is_complete(&self) -> bool {
        self.come == self.samples()
    }

    /// Takes out of a segment what the initial values can still do: derivatives follow them by `slopes`, the residual by `error`.
    pub(super) fn project(
        &mut self,
        kernel: Kernel,
        segment: &Range<usize>,
        slopes: &[Vector3<f64>],
        error: &Vector3<f64>,
    ) {
        let samples = self.samples();
        let Linearisation { residual, jacobian } = &mut self.linear;
        for channel in 0..CHANNELS {
            let rows = channel * samples + segment.start..channel * samples + segment.end;
            let part = |column: usize| &self.initial.as_slice()[column * CHANNELS * samples..][rows.clone()];
            let initial: [&[f64]; INITIAL] = from_fn(part);
            let follow = |to: &mut [f64], by: [f64; INITIAL]| {
                lanes::run(kernel.path, kernel.rounding, Follow { to, initial, by });
            };
            follow(&mut residual.as_mut_slice()[rows.clone()], (-error).into());
            for (column, by) in jacobian.as_mut_slice().chunks_exact_mut(CHANNELS * samples).zip(slopes) {
                follow(&mut column[rows.clone()], (*by).into());
            }
        }
    }

    pub(super) fn linear(self) -> Linearisation {
        self.linear
    }
}

/// Rows on their way to columns.
struct Columns<'a> {
    rows: &'a [f64],
    /// Number of free parameters.
    free: usize,
    residual: &'a mut [f64],
    jacobian: &'a mut [f64],
    initial: &'a mut [f64],
    /// Number of the first of these samples in the recording, and samples of the recording.
    first: usize,
    samples: usize,
}

impl Job for Columns<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(mut self) {
        match copies::width(self.free) / PART {
            1 => self.all::<V, 1>(),
            2 => self.all::<V, 2>(),
            parts => unreachable!("{parts} parts of a row: more than all parameters and initial values"),
        }
    }
}

impl Columns<'_> {
    /// Of rows of `PARTS` parts.
    #[inline(always)]
    fn all<V: Lane, const PARTS: usize>(&mut self) {
        let count = self.rows.len() / (CHANNELS * PART * PARTS);
        let full = count - count % V::WIDTH;
        for sample in (0..full).step_by(V::WIDTH) {
            self.group::<V, PARTS>(sample);
        }
        for sample in full..count {
            self.group::<f64, PARTS>(sample);
        }
    }

    /// As many samples as a vector holds, from number `sample` of these rows on.
    #[inline(always)]
    fn group<V: Lane, const PARTS: usize>(&mut self, sample: usize) {
        let (size, free) = (PART * PARTS, self.free);
        let begin: [usize; PART] = from_fn(|lane| CHANNELS * lane);
        for channel in 0..CHANNELS {
            let mut row = [[V::zero(); PART]; PARTS];
            for part in 0..PARTS {
                let (records, k) = (&self.rows[part * PART..], CHANNELS * sample + channel);
                row[part] = V::columns::<PART>(records, &begin, size, k);
            }
            let column = |n: usize| row[n / PART][n % PART];
            let (length, at) = (CHANNELS * self.samples, channel * self.samples + self.first + sample);
            column(size - 1).store(&mut self.residual[at..]);
            for k in 0..free {
                column(k).store(&mut self.jacobian[k * length + at..]);
            }
            for k in 0..INITIAL {
                column(free + k).store(&mut self.initial[k * length + at..]);
            }
        }
    }
}

/// A column that follows the initial values.
struct Follow<'a> {
    to: &'a mut [f64],
    initial: [&'a [f64]; INITIAL],
    /// By how much it follows each.
    by: [f64; INITIAL],
}

impl Job for Follow<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(mut self) {
        let full = self.to.len() - self.to.len() % V::WIDTH;
        for at in (0..full).step_by(V::WIDTH) {
            self.part::<V>(at);
        }
        for at in full..self.to.len() {
            self.part::<f64>(at);
        }
    }
}

impl Follow<'_> {
    #[inline(always)]
    fn part<V: Lane>(&mut self, at: usize) {
        let moved = |k: usize| V::load(&self.initial[k][at..]) * V::constant(self.by[k]);
        let follow = moved(0) + moved(1) + moved(2);
        (V::load(&self.to[at..]) + follow).store(&mut self.to[at..]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::lanes::{Path, Rounding};

    /// Samples behind the projected ones.
    const BEHIND: usize = 2;

    /// Rows with no pattern in them, and what becomes of `count` samples of them behind `skipped` others.
    fn projected(kernel: Kernel, free: usize, skipped: usize, count: usize) -> Linearisation {
        let samples = skipped + count + BEHIND;
        let mut recorded = Recorded::room(samples, free);
        let numbers = CHANNELS * samples * copies::width(free);
        let rows: Vec<f64> = (0..numbers).map(|k| (k as f64 * 0.7).sin()).collect();
        // They come in parts.
        let (first, rest) = rows.split_at(CHANNELS * copies::width(free) * samples.min(9));
        for part in [first, rest] {
            assert!(!recorded.is_complete());
            recorded.take(kernel, part);
        }
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
                        // Another segment, and still as it came.
                        assert_eq!(plain.residual[at], x[width - 1]);
                        assert!(plain.jacobian.row(at).iter().eq(&x[..free]));
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
