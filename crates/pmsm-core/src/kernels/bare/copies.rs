//! Errors and their derivatives from perturbed copies: one for each parameter in a group of vectors beside the point itself, so that
//! derivatives cost hardly more than the run.

use super::block::{self, BLOCK, Block, Differences, Stretch};
use super::step::fields;
use super::track::Track;
use super::{Kernel, POINT};
use crate::numerics::lanes::{self, Job, Lane};

/// Relative size of a perturbation: truncation, about as large, and the rounding of a run, about 1e-12 over it, both are some millionths
/// of a derivative. They are some hundred-thousandths where a parameter hardly shows, and more where a light rotor swings for long and
/// derivatives change faster than parameters. A share δ of a derivative moves the minimum over n samples by δ·√n standard errors at most.
pub const NUDGE: f64 = 1e-6;
/// Samples simulated before their errors are used, while they are in the cache.
const STRETCH: usize = 64;
/// Stretches between two looks at the stop flag, some ten microseconds.
const LOOK: usize = 16;
/// Columns whose products are summed in one go: that many sums fit into the registers of the widest path.
const GROUP: usize = 6;
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
    /// The rows, [`width`] numbers each, per sample one for i_d, i_q and ω_e.
    pub rows: &'a [f64],
}

/// Length of a row with `free` varied parameters, a multiple of the widest vector.
pub fn width(free: usize) -> usize {
    (free + INITIAL + 1).div_ceil(BLOCK) * BLOCK
}

/// Simulates the recording around a point and hands over the rows stretch by stretch, while they are in the cache. Returns false once
/// `stop` says so.
pub fn rows(
    track: &Track,
    kernel: Kernel,
    around: Around<'_>,
    stop: &dyn Fn() -> bool,
    mut sink: impl FnMut(Rows<'_>),
) -> bool {
    let varied = around.free.len() + INITIAL;
    // The last column is the point itself.
    let width = width(around.free.len());
    let mut blocks = Block::room(width);
    let mut room = vec![0.0; STRETCH * 3 * width];
    let (mut counts, mut scale) = (vec![1.0; width], vec![0.0; width]);
    (counts[width - 1], scale[width - 1]) = (0.0, 1.0);
    for (number, segment) in track.segments.iter().enumerate() {
        for column in 0..width {
            let (mut p, mut start) = (*around.p, around.starts[number]);
            if let Some(entry) = around.free.get(column) {
                p[*entry] += NUDGE * around.sizes[*entry];
                scale[column] = 1.0 / (p[*entry] - around.p[*entry]);
            } else if column < varied {
                let x = column - around.free.len();
                start[x] += NUDGE * around.initial_sizes[x];
                scale[column] = 1.0 / (start[x] - around.starts[number][x]);
            }
            block::place(&mut blocks, column, &segment.scale, &p, start);
        }
        for (part, samples) in segment.stretches(STRETCH).enumerate() {
            if part % LOOK == 0 && stop() {
                return false;
            }
            let stretch =
                Stretch { samples, pieces: segment.pieces, show_w: segment.show_w, has_load: track.has_load };
            let rows = &mut room[..samples.len() / fields(track.has_load) * 3 * width];
            let differences = Differences { counts: &counts, scale: &scale, rows };
            block::subtract(kernel, &mut blocks, stretch, differences);
            sink(Rows { segment: number, rows });
        }
    }
    true
}

/// Adds to `sums` ([`width`] × [`width`], one row after the other) the products of all pairs of columns: the normal equations of
/// `free` parameters, initial values and error. Rows of the columns of zeros stay as they are, and so does what lies above the
/// diagonal, but for the vectors that cross it.
pub fn accumulate(kernel: Kernel, rows: &[f64], free: usize, sums: &mut [f64]) {
    lanes::run(kernel.path, kernel.rounding, Products { rows, free, sums });
}

struct Products<'a> {
    rows: &'a [f64],
    free: usize,
    sums: &'a mut [f64],
}

impl Job for Products<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(mut self) {
        let (used, last) = (self.free + INITIAL, width(self.free) - 1);
        for at in (0..=last).step_by(V::WIDTH) {
            let mut from = at.min(used);
            while from + GROUP <= used {
                self.add::<V, GROUP>(at, std::array::from_fn(|n| from + n));
                from += GROUP;
            }
            // The rest, and the error.
            match used - from {
                0 => self.add::<V, 1>(at, [last]),
                1 => self.add::<V, 2>(at, [from, last]),
                2 => self.add::<V, 3>(at, [from, from + 1, last]),
                3 => self.add::<V, 4>(at, [from, from + 1, from + 2, last]),
                4 => self.add::<V, 5>(at, [from, from + 1, from + 2, from + 3, last]),
                _ => self.add::<V, 6>(at, [from, from + 1, from + 2, from + 3, from + 4, last]),
            }
        }
    }
}

impl Products<'_> {
    /// Adds the products of `N` columns with those of the vector at `at`.
    #[inline(always)]
    fn add<V: Lane, const N: usize>(&mut self, at: usize, columns: [usize; N]) {
        let width = width(self.free);
        // Two rows at a time: sums of one row alone would wait for each other.
        let mut parts = [[V::zero(); N]; 2];
        for n in 0..N {
            parts[0][n] = V::load(&self.sums[columns[n] * width + at..]);
        }
        let pairs = self.rows.chunks_exact(2 * width);
        let rest = pairs.remainder();
        for pair in pairs {
            add_row(&mut parts[0], &pair[..width], columns, at);
            add_row(&mut parts[1], &pair[width..], columns, at);
        }
        if !rest.is_empty() {
            add_row(&mut parts[0], rest, columns, at);
        }
        for n in 0..N {
            (parts[0][n] + parts[1][n]).store(&mut self.sums[columns[n] * width + at..]);
        }
    }
}

/// Adds to `sums` the products of these columns of a row with those of the vector at `at`.
#[inline(always)]
fn add_row<V: Lane, const N: usize>(sums: &mut [V; N], row: &[f64], columns: [usize; N], at: usize) {
    let right = V::load(&row[at..]);
    for n in 0..N {
        sums[n] = V::constant(row[columns[n]]).mul_add(right, sums[n]);
    }
}
