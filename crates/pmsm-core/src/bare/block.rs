//! Eight parameter sets side by side, and their way through a stretch of samples.

use super::Kernel;
use super::step::{COEFFICIENTS, Coefficients, INCREMENTS, STAGES, Scale, coefficients, state};
use crate::lanes::{self, Job, Lane};

/// Parameter sets per block: the widest vector.
pub const BLOCK: usize = 8;
/// Rows of a block: coefficients, three states, the sum of squares.
const STATE: usize = COEFFICIENTS;
pub const SUM: usize = STATE + 3;
pub const ROWS: usize = SUM + 1;

/// Eight parameter sets: one row per coefficient and state.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub struct Block([f64; ROWS * BLOCK]);

impl Block {
    /// Room for `count` parameter sets.
    pub fn room(count: usize) -> Vec<Self> {
        vec![Self([0.0; ROWS * BLOCK]); count.div_ceil(BLOCK)]
    }
}

/// One number of one parameter set.
pub fn get(blocks: &[Block], column: usize, row: usize) -> f64 {
    blocks[column / BLOCK].0[row * BLOCK + column % BLOCK]
}

/// Writes one number of one parameter set.
pub fn set(blocks: &mut [Block], column: usize, row: usize, value: f64) {
    blocks[column / BLOCK].0[row * BLOCK + column % BLOCK] = value;
}

/// Puts the parameter set `p` in place, at i_d, i_q (A) and ω_e (rad/s). The sum stays as it is.
pub fn place(blocks: &mut [Block], column: usize, scale: &Scale, p: &[f64], [i_d, i_q, omega]: [f64; 3]) {
    let rows = coefficients(scale, p).into_iter().chain(state(scale, p, [i_d, i_q], omega));
    for (row, value) in rows.enumerate() {
        set(blocks, column, row, value);
    }
}

/// A stretch of samples.
#[derive(Debug, Clone, Copy)]
pub struct Stretch<'a> {
    /// The samples, see [`super::step::Sample`].
    pub samples: &'a [[f64; 6]],
    /// Steps per sample.
    pub pieces: usize,
    /// Weight of ω_e over g.
    pub show_w: f64,
    /// Whether the load torque of the samples counts.
    pub has_load: bool,
}

/// Takes all blocks through the stretch. Their weighted squared errors are added to their sums; where `errors` has room, the
/// errors themselves are written there instead: per sample and channel (i_d, i_q, ω_e) one number per column.
pub fn run(kernel: Kernel, blocks: &mut [Block], stretch: Stretch<'_>, errors: &mut [f64]) {
    let (path, rounding) = (kernel.path, kernel.rounding);
    match (kernel.increments, stretch.has_load, errors.is_empty()) {
        (false, false, true) => {
            lanes::run(path, rounding, Run::<STAGES, false, false> { blocks, stretch, errors })
        }
        (false, true, true) => {
            lanes::run(path, rounding, Run::<STAGES, true, false> { blocks, stretch, errors })
        }
        (false, _, false) => {
            lanes::run(path, rounding, Run::<STAGES, true, true> { blocks, stretch, errors })
        }
        (true, _, true) => {
            lanes::run(path, rounding, Run::<INCREMENTS, true, false> { blocks, stretch, errors })
        }
        (true, _, false) => {
            lanes::run(path, rounding, Run::<INCREMENTS, true, true> { blocks, stretch, errors })
        }
    }
}

struct Run<'a, const FORM: bool, const LOAD: bool, const RECORD: bool> {
    blocks: &'a mut [Block],
    stretch: Stretch<'a>,
    errors: &'a mut [f64],
}

impl<const FORM: bool, const LOAD: bool, const RECORD: bool> Job for Run<'_, FORM, LOAD, RECORD> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(mut self) {
        let vectors = self.blocks.len() * BLOCK / V::WIDTH;
        // Two vectors at a time keep the arithmetic busy while each waits for its own results.
        for first in (0..vectors / 2 * 2).step_by(2) {
            self.advance::<V, 2>(first);
        }
        if vectors % 2 == 1 {
            self.advance::<V, 1>(vectors - 1);
        }
    }
}

impl<const FORM: bool, const LOAD: bool, const RECORD: bool> Run<'_, FORM, LOAD, RECORD> {
    /// Takes `R` vectors, from number `first` on, through the samples.
    #[inline(always)]
    fn advance<V: Lane, const R: usize>(&mut self, first: usize) {
        let columns = self.blocks.len() * BLOCK;
        let mut with = [Coefficients::<V>::load(&self.blocks[0].0, BLOCK, 0); R];
        let mut y = [[V::zero(); 3]; R];
        let mut sum = [V::zero(); R];
        for r in 0..R {
            let (block, at) = locate::<V>(first + r);
            let rows = &self.blocks[block].0;
            with[r] = Coefficients::load(rows, BLOCK, at);
            for n in 0..3 {
                y[r][n] = V::load(&rows[(STATE + n) * BLOCK + at..]);
            }
            sum[r] = V::load(&rows[SUM * BLOCK + at..]);
        }
        let show_w = V::constant(self.stretch.show_w);
        for (k, sample) in self.stretch.samples.iter().enumerate() {
            let mut now = [V::zero(); 6];
            for n in 0..6 {
                now[n] = V::constant(sample[n]);
            }
            for r in 0..R {
                let e = with[r].errors(y[r], &now, show_w);
                if RECORD {
                    for c in 0..3 {
                        e[c].store(&mut self.errors[(3 * k + c) * columns + (first + r) * V::WIDTH..]);
                    }
                } else {
                    sum[r] = e[2].mul_add(e[2], e[1].mul_add(e[1], e[0].mul_add(e[0], sum[r])));
                }
            }
            for _ in 0..self.stretch.pieces {
                for r in 0..R {
                    y[r] = with[r].step::<FORM, LOAD>(y[r], &now);
                }
            }
        }
        for r in 0..R {
            let (block, at) = locate::<V>(first + r);
            let rows = &mut self.blocks[block].0;
            for n in 0..3 {
                y[r][n].store(&mut rows[(STATE + n) * BLOCK + at..]);
            }
            sum[r].store(&mut rows[SUM * BLOCK + at..]);
        }
    }
}

/// Block and first column therein of a vector.
#[inline(always)]
fn locate<V: Lane>(vector: usize) -> (usize, usize) {
    let per_block = BLOCK / V::WIDTH;
    (vector / per_block, vector % per_block * V::WIDTH)
}
