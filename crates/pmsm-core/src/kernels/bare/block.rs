//! Eight parameter sets side by side, and their way through a stretch of samples.

use super::Kernel;
use super::step::{
    COEFFICIENTS, Coefficients, INCREMENTS, K_1, ROUND, STAGES, Sample, Scale, coefficients, state,
};
use crate::numerics::lanes::{self, Job, Lane};

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
    /// The samples one after the other, see [`super::step::Sample`].
    pub samples: &'a [f64],
    /// Steps per sample.
    pub pieces: usize,
    /// Weight of ω_e over g.
    pub show_w: f64,
    /// Whether the load torque of the samples counts.
    pub has_load: bool,
}

/// Takes the first `count` parameter sets, and perhaps some behind them, through the stretch and adds their weighted squared errors to
/// their sums.
pub fn run(kernel: Kernel, blocks: &mut [Block], count: usize, stretch: Stretch<'_>) {
    let (path, rounding) = (kernel.path, kernel.rounding);
    let round = (0..count).all(|column| get(blocks, column, K_1) == 0.0);
    match (kernel.increments, round, stretch.has_load) {
        (false, false, false) => {
            lanes::run(path, rounding, Run::<STAGES, false, 5> { blocks, count, stretch })
        }
        (false, false, true) => lanes::run(path, rounding, Run::<STAGES, true, 6> { blocks, count, stretch }),
        (false, true, false) => lanes::run(path, rounding, Run::<ROUND, false, 5> { blocks, count, stretch }),
        (false, true, true) => lanes::run(path, rounding, Run::<ROUND, true, 6> { blocks, count, stretch }),
        (true, _, false) => {
            lanes::run(path, rounding, Run::<INCREMENTS, false, 5> { blocks, count, stretch })
        }
        (true, _, true) => lanes::run(path, rounding, Run::<INCREMENTS, true, 6> { blocks, count, stretch }),
    }
}

/// Where the differences between each column and the last one go: one row per sample and channel (i_d, i_q, ω_e), one number per column:
/// (error of the column − `counts`·error of the last one)·`scale`.
#[derive(Debug)]
pub struct Differences<'a> {
    /// How often the last column counts, per column: once or not at all.
    pub counts: &'a [f64],
    /// Factor per column.
    pub scale: &'a [f64],
    /// The rows.
    pub rows: &'a mut [f64],
}

/// Takes all blocks through the stretch and writes the differences to their last column.
pub fn subtract(kernel: Kernel, blocks: &mut [Block], stretch: Stretch<'_>, to: Differences<'_>) {
    let (path, rounding) = (kernel.path, kernel.rounding);
    match (kernel.increments, stretch.has_load) {
        (false, false) => lanes::run(path, rounding, Subtract::<STAGES, false, 5> { blocks, stretch, to }),
        (false, true) => lanes::run(path, rounding, Subtract::<STAGES, true, 6> { blocks, stretch, to }),
        (true, false) => lanes::run(path, rounding, Subtract::<INCREMENTS, false, 5> { blocks, stretch, to }),
        (true, true) => lanes::run(path, rounding, Subtract::<INCREMENTS, true, 6> { blocks, stretch, to }),
    }
}

struct Run<'a, const FORM: u8, const LOAD: bool, const N: usize> {
    blocks: &'a mut [Block],
    count: usize,
    stretch: Stretch<'a>,
}

impl<const FORM: u8, const LOAD: bool, const N: usize> Job for Run<'_, FORM, LOAD, N> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(mut self) {
        // What does not fill a vector, nor half of one, is half the work in half of one.
        let halves = V::Half::WIDTH < V::WIDTH;
        let rest = self.count % V::WIDTH;
        let half = halves && rest > 0 && rest <= V::Half::WIDTH;
        let vectors = if half { self.count / V::WIDTH } else { self.count.div_ceil(V::WIDTH) };
        let mut first = 0;
        // Four vectors at a time keep the arithmetic busy while each waits for its own results.
        if const { FORM != INCREMENTS } {
            while first + 4 <= vectors {
                self.advance::<V, 4, false, false>(first);
                first += 4;
            }
        }
        // Of what need not be fast there is little machine code: the reference of accuracy, and what narrow vectors leave over.
        if const { FORM == INCREMENTS || V::WIDTH < 4 } {
            while first * V::WIDTH < self.count {
                self.advance::<V, 1, false, false>(first);
                first += 1;
            }
            return;
        }
        // Few vectors wait for themselves least where nothing but the step of a sample stands in the loop.
        let once = self.stretch.pieces == 1;
        match (vectors - first, half, once) {
            (3, true, _) => self.advance::<V, 3, true, false>(first),
            (3, false, _) => self.advance::<V, 3, false, false>(first),
            (2, true, _) => self.advance::<V, 2, true, false>(first),
            (2, false, true) => self.advance::<V, 2, false, true>(first),
            (2, false, false) => self.advance::<V, 2, false, false>(first),
            (1, true, true) => self.advance::<V, 1, true, true>(first),
            (1, true, false) => self.advance::<V, 1, true, false>(first),
            (1, false, true) => self.advance::<V, 1, false, true>(first),
            (1, false, false) => self.advance::<V, 1, false, false>(first),
            (_, true, true) => self.advance::<V, 0, true, true>(first),
            (_, true, false) => self.advance::<V, 0, true, false>(first),
            _ => {}
        }
    }
}

impl<const FORM: u8, const LOAD: bool, const N: usize> Run<'_, FORM, LOAD, N> {
    /// Takes `R` vectors, from number `first` on, and with `HALF` half a one behind them through the samples, with `ONCE` in one step per
    /// sample.
    #[inline(always)]
    fn advance<V: Lane, const R: usize, const HALF: bool, const ONCE: bool>(&mut self, first: usize) {
        let Self { blocks, stretch, .. } = self;
        let behind = (first + R) * V::WIDTH / V::Half::WIDTH;
        let mut columns = [Columns::<V>::load(blocks, if R > 0 { first } else { 0 }); R];
        for r in 1..R {
            columns[r] = Columns::load(blocks, first + r);
        }
        let mut rest = Columns::<V::Half>::load(blocks, if HALF { behind } else { 0 });
        let more = if ONCE { 0 } else { stretch.pieces - 1 };
        for sample in stretch.samples.as_chunks::<N>().0 {
            let (now, half_now) = (spread(sample), spread(sample));
            for r in 0..R {
                columns[r].count::<FORM, LOAD>(&now, stretch.show_w);
            }
            if HALF {
                rest.count::<FORM, LOAD>(&half_now, stretch.show_w);
            }
            for _ in 0..more {
                for r in 0..R {
                    columns[r].step::<FORM, LOAD>(&now);
                }
                if HALF {
                    rest.step::<FORM, LOAD>(&half_now);
                }
            }
        }
        for r in 0..R {
            columns[r].store(blocks, first + r);
        }
        if HALF {
            rest.store(blocks, behind);
        }
    }
}

struct Subtract<'a, const FORM: u8, const LOAD: bool, const N: usize> {
    blocks: &'a mut [Block],
    stretch: Stretch<'a>,
    to: Differences<'a>,
}

impl<const FORM: u8, const LOAD: bool, const N: usize> Job for Subtract<'_, FORM, LOAD, N> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(mut self) {
        let vectors = self.blocks.len() * BLOCK / V::WIDTH;
        let once = self.stretch.pieces == 1;
        if const { FORM == INCREMENTS || V::WIDTH < 4 } {
            for first in 0..vectors {
                self.advance::<V, 1, false>(first);
            }
        } else {
            for first in (0..vectors).step_by(2) {
                match (vectors - first, once) {
                    (1, true) => self.advance::<V, 1, true>(first),
                    (1, false) => self.advance::<V, 1, false>(first),
                    (_, true) => self.advance::<V, 2, true>(first),
                    (_, false) => self.advance::<V, 2, false>(first),
                }
            }
        }
        self.compare::<V>();
    }
}

impl<const FORM: u8, const LOAD: bool, const N: usize> Subtract<'_, FORM, LOAD, N> {
    /// Takes `R` vectors, from number `first` on, through the samples, with `ONCE` in one step per sample, and writes their errors.
    #[inline(always)]
    fn advance<V: Lane, const R: usize, const ONCE: bool>(&mut self, first: usize) {
        let Self { blocks, stretch, to } = self;
        let width = blocks.len() * BLOCK;
        let show_w = V::constant(stretch.show_w);
        let mut columns = [Columns::<V>::load(blocks, first); R];
        for r in 1..R {
            columns[r] = Columns::load(blocks, first + r);
        }
        let rows = to.rows.chunks_exact_mut(3 * width);
        for (sample, rows) in stretch.samples.as_chunks::<N>().0.iter().zip(rows) {
            let now = spread(sample);
            for r in 0..R {
                let before = columns[r].step::<FORM, LOAD>(&now);
                let errors = columns[r].with.errors(before, &now, show_w);
                for c in 0..3 {
                    errors[c].store(&mut rows[c * width + (first + r) * V::WIDTH..]);
                }
            }
            for _ in 1..if ONCE { 1 } else { stretch.pieces } {
                for r in 0..R {
                    columns[r].step::<FORM, LOAD>(&now);
                }
            }
        }
        for r in 0..R {
            columns[r].store(blocks, first + r);
        }
    }

    /// Makes differences of the errors, while they are in the cache. The last column stays as it is.
    #[inline(always)]
    fn compare<V: Lane>(self) {
        let Differences { counts, scale, rows } = self.to;
        let width = self.blocks.len() * BLOCK;
        for at in (0..width).step_by(V::WIDTH) {
            let (counts, scale) = (V::load(&counts[at..]), V::load(&scale[at..]));
            for row in rows.chunks_exact_mut(width) {
                let last = V::constant(row[width - 1]);
                let difference = last.neg_mul_add(counts, V::load(&row[at..])) * scale;
                difference.store(&mut row[at..]);
            }
        }
    }
}

/// A vector of columns under way.
#[derive(Clone, Copy)]
struct Columns<V> {
    with: Coefficients<V>,
    y: [V; 3],
    sum: V,
}

impl<V: Lane> Columns<V> {
    #[inline(always)]
    fn load(blocks: &[Block], vector: usize) -> Self {
        let (block, at) = locate::<V>(vector);
        let rows = &blocks[block].0;
        let mut y = [V::zero(); 3];
        for n in 0..3 {
            y[n] = V::load(&rows[(STATE + n) * BLOCK + at..]);
        }
        Self { with: Coefficients::load(rows, BLOCK, at), y, sum: V::load(&rows[SUM * BLOCK + at..]) }
    }

    /// One step; returns the state before it.
    #[inline(always)]
    fn step<const FORM: u8, const LOAD: bool>(&mut self, now: &Sample<V>) -> [V; 3] {
        let before = self.y;
        self.y = self.with.step::<FORM, LOAD>(before, now);
        before
    }

    /// One step; the errors of the state before it are added to the sum. The step comes first: nothing waits for the errors.
    #[inline(always)]
    fn count<const FORM: u8, const LOAD: bool>(&mut self, now: &Sample<V>, show_w: f64) {
        let before = self.step::<FORM, LOAD>(now);
        let e = self.with.errors(before, now, V::constant(show_w));
        self.sum += e[2].mul_add(e[2], e[1].mul_add(e[1], e[0] * e[0]));
    }

    #[inline(always)]
    fn store(&self, blocks: &mut [Block], vector: usize) {
        let (block, at) = locate::<V>(vector);
        let rows = &mut blocks[block].0;
        for n in 0..3 {
            self.y[n].store(&mut rows[(STATE + n) * BLOCK + at..]);
        }
        self.sum.store(&mut rows[SUM * BLOCK + at..]);
    }
}

/// A sample for every column.
#[inline(always)]
fn spread<V: Lane, const N: usize>(sample: &[f64; N]) -> Sample<V> {
    let mut now = [V::zero(); 6];
    for n in 0..N {
        now[n] = V::constant(sample[n]);
    }
    now
}

/// Block and first column therein of a vector.
#[inline(always)]
fn locate<V: Lane>(vector: usize) -> (usize, usize) {
    let per_block = BLOCK / V::WIDTH;
    (vector / per_block, vector % per_block * V::WIDTH)
}
