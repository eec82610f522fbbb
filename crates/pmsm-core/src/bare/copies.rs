//! Errors and their derivatives from perturbed copies: for each parameter one copy a little above and one a little below, all
//! in one group of vectors beside the point itself, so that derivatives cost hardly more than the run.

use super::block::{self, BLOCK, Block, Differences, Stretch};
use super::track::Track;
use super::{Kernel, POINT};
use crate::lanes::{self, Job, Lane};

/// Relative size of a perturbation: truncation, about its square, and the rounding of a run, about 1e-12 over it, both stay
/// below 1e-7 of a derivative.
const NUDGE: f64 = 3e-5;
/// Samples simulated before their errors are used, while they are in the cache.
const STRETCH: usize = 64;
/// Initial values of a segment: i_d, i_q, ω_e.
pub const INITIAL: usize = 3;

/// A point, what is varied around it, and how large a change of each matters.
#[derive(Debug, Clone, Copy)]
pub struct Around<'a> {
    /// The point.
    pub p: &'a [f64; POINT],
    /// Its entries that are varied.
    pub free: &'a [usize],
    /// Scale of each entry of a point, in its unit.
    pub sizes: &'a [f64; POINT],
    /// Scales of i_d, i_q (A) and ω_e (rad/s).
    pub initial_sizes: [f64; INITIAL],
    /// i_d, i_q (A), ω_e (rad/s) at the beginning of each segment.
    pub starts: &'a [[f64; INITIAL]],
}

/// Rows of derivatives: free parameters, the initial values, zeros, and the error itself in the last place.
#[derive(Debug)]
pub struct Rows<'a> {
    /// Number of the segment.
    pub segment: usize,
    /// First sample.
    pub first: usize,
    /// The rows, [`width`] numbers each, per sample one for i_d, i_q and ω_e.
    pub rows: &'a [f64],
}

/// Length of a row with `free` varied parameters, a multiple of the widest vector.
pub fn width(free: usize) -> usize {
    (free + INITIAL + 1).div_ceil(BLOCK) * BLOCK
}

/// Simulates the recording around a point and hands over the rows stretch by stretch. Returns false once `stop` says so.
pub fn rows(
    track: &Track,
    kernel: Kernel,
    around: Around<'_>,
    stop: &dyn Fn() -> bool,
    mut sink: impl FnMut(Rows<'_>),
) -> bool {
    let varied = around.free.len() + INITIAL;
    // The last column of the first half is the point itself.
    let width = width(around.free.len());
    let mut blocks = Block::room(2 * width);
    let mut rows = vec![0.0; STRETCH * 3 * width];
    let (mut counts, mut scale) = (vec![1.0; width], vec![0.0; width]);
    (counts[width - 1], scale[width - 1]) = (0.0, 1.0);
    for (number, segment) in track.segments.iter().enumerate() {
        for column in 0..2 * width {
            let (slot, sign) = (column % width, if column < width { 1.0 } else { -1.0 });
            let (mut p, mut start) = (*around.p, around.starts[number]);
            if let Some(entry) = around.free.get(slot) {
                p[*entry] += sign * NUDGE * around.sizes[*entry];
                scale[slot] = 0.5 / (NUDGE * around.sizes[*entry]);
            } else if slot < varied {
                let x = slot - around.free.len();
                start[x] += sign * NUDGE * around.initial_sizes[x];
                scale[slot] = 0.5 / (NUDGE * around.initial_sizes[x]);
            }
            block::place(&mut blocks, column, &segment.scale, &p, start);
        }
        for (part, samples) in segment.samples().chunks(STRETCH).enumerate() {
            if stop() {
                return false;
            }
            let stretch =
                Stretch { samples, pieces: segment.pieces, show_w: segment.show_w, has_load: track.has_load };
            let rows = &mut rows[..samples.len() * 3 * width];
            let differences = Differences { counts: &counts, scale: &scale, rows };
            block::subtract(kernel, &mut blocks, stretch, differences);
            let first = segment.range.start + part * STRETCH;
            sink(Rows { segment: number, first, rows });
        }
    }
    true
}

/// Adds to `sums` (width × width, one row after the other) the products of all pairs of columns: the normal equations of
/// parameters, initial values and error.
pub fn accumulate(kernel: Kernel, rows: &[f64], width: usize, sums: &mut [f64]) {
    lanes::run(kernel.path, kernel.rounding, Products { rows, width, sums });
}

struct Products<'a> {
    rows: &'a [f64],
    width: usize,
    sums: &'a mut [f64],
}

impl Job for Products<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(self) {
        let Self { rows, width, sums } = self;
        // Eight by one vector at a time: that many sums fit into the registers of the widest path.
        for from in (0..width).step_by(BLOCK) {
            for at in (0..width).step_by(V::WIDTH) {
                let mut part = [V::zero(); BLOCK];
                for n in 0..BLOCK {
                    part[n] = V::load(&sums[(from + n) * width + at..]);
                }
                for row in 0..rows.len() / width {
                    let right = V::load(&rows[row * width + at..]);
                    let left = &rows[row * width + from..][..BLOCK];
                    for n in 0..BLOCK {
                        part[n] = V::constant(left[n]).mul_add(right, part[n]);
                    }
                }
                for n in 0..BLOCK {
                    part[n].store(&mut sums[(from + n) * width + at..]);
                }
            }
        }
    }
}
