//! One parameter set on a long recording: pieces of time side by side.
//!
//! The recording is cut into sixteen pieces that run together, each from the measured state some way before its
//! beginning. A motor under a given voltage forgets where it started, so on arrival a piece should be in the very state
//! in which the piece before it ends. This is checked at every seam; where it fails, the whole recording is run in a row.

use super::block::{self, Block, Stretch};
use super::step::{COEFFICIENTS, Coefficients, STAGES, Sample, coefficients, fields, state};
use super::track::{Segment, Track};
use super::{Kernel, POINT};
use crate::numerics::lanes::{self, Job, Lane};

/// Pieces of a recording, the same on every path, so that sums have the same bits.
const LANES: usize = 16;
/// Vectors of pieces that are advanced together.
const VECTORS: usize = 2;
/// Samples by which reading is ahead: more streams run side by side than some processors foresee, and what they bring must stay in the
/// first-level cache until it is used.
const AHEAD: usize = 8;
/// Run-in in units of the motor's slowest memory: until a difference has fallen below the last bit.
const RUN_IN: f64 = 42.0;
/// Longest run-in that pays, as a share of a piece.
const LONGEST: f64 = 0.5;
/// Shortest segment that is cut, in samples.
pub const SHORTEST: usize = 100_000;
/// Largest difference of the states at a seam over their size: a few roundings.
const SEAM: f64 = 1e-13;
/// Samples between two looks at the stop flag.
const STRETCH: usize = 4096;

/// How the pieces of a long recording met.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seams {
    /// Number of seams.
    pub count: usize,
    /// Seams at which the states agree to the last bit.
    pub exact: usize,
    /// Segments that had to be run in a row.
    pub fallbacks: usize,
}

/// The fitness of one point (see [`POINT`]) and how the seams fared; `None` once `stop` says so. Segments too short to be cut
/// are run in a row.
pub fn cost(
    track: &Track,
    kernel: Kernel,
    point: &[f64; POINT],
    stop: &(dyn Fn() -> bool + Sync),
) -> Option<(f64, Seams)> {
    let mut seams = Seams { count: 0, exact: 0, fallbacks: 0 };
    let mut sum = 0.0;
    for segment in &track.segments {
        let run_in =
            (RUN_IN * memory(segment, point) / (2.0 * segment.scale.g * segment.pieces as f64)).ceil();
        let n = segment.range.len();
        let mut cut = None;
        if n >= SHORTEST && run_in <= LONGEST * (n / LANES) as f64 && !kernel.increments {
            let pieces = in_pieces(track, segment, kernel, point, run_in as usize, stop)?;
            seams.count += LANES - 1;
            seams.exact += pieces.exact;
            seams.fallbacks += usize::from(pieces.sum.is_none());
            cut = pieces.sum;
        }
        sum += match cut {
            Some(sum) => sum,
            None => in_a_row(track, segment, kernel, 0, point, None, stop)?,
        };
    }
    Some((sum, seams))
}

/// Slowest time constant of the equations at standstill, s: of the d axis, and of the q axis together with the rotor,
/// s² + (r_s/l_q + b/j)·s + (r_s·b + 3/2·n_p²·psi_m²)/(l_q·j) = 0. Only a guess: the seams are checked.
fn memory(segment: &Segment, point: &[f64; POINT]) -> f64 {
    let [r_s, l_d, l_q, psi_m, j, b, _] = *point;
    let half = 0.5 * (r_s / l_q + b / j);
    let product = (r_s * b + 1.5 * (segment.scale.n_p * psi_m).powi(2)) / (l_q * j);
    let rest = half * half - product;
    let slowest = if rest > 0.0 { product / (half + rest.sqrt()) } else { half };
    1.0 / slowest.min(r_s / l_d)
}

/// What came of running the pieces of a segment side by side.
struct Pieces {
    /// The sum of squares, unless a seam failed.
    sum: Option<f64>,
    exact: usize,
}

fn in_pieces(
    track: &Track,
    segment: &Segment,
    kernel: Kernel,
    point: &[f64; POINT],
    run_in: usize,
    stop: &(dyn Fn() -> bool + Sync),
) -> Option<Pieces> {
    let length = (segment.range.len() - run_in) / LANES;
    // The first piece has no run-in and is longer by it.
    let mut begin = [0; LANES];
    let mut y = [[0.0; LANES]; 3];
    for lane in 0..LANES {
        begin[lane] = lane * length;
        let first = if lane == 0 { segment.first } else { segment.measured(begin[lane]) };
        let at = state(&segment.scale, point, [first[0], first[1]], first[2]);
        for n in 0..3 {
            y[n][lane] = at[n];
        }
    }
    let mut run = Run { y, sum: [0.0; LANES] };
    let through = |from: usize, to: usize, run: &mut Run| {
        for start in (from..to).step_by(STRETCH) {
            if stop() {
                return false;
            }
            let records = segment.records();
            let stretch = Together {
                run,
                records,
                begin: begin.map(|b| b + start),
                count: STRETCH.min(to - start),
                with: coefficients(&segment.scale, point),
                pieces: segment.pieces,
                show_w: segment.show_w,
            };
            if track.has_load {
                lanes::run(kernel.path, kernel.rounding, WithLoad::<true>(stretch));
            } else {
                lanes::run(kernel.path, kernel.rounding, WithLoad::<false>(stretch));
            }
        }
        true
    };
    if !through(0, run_in, &mut run) {
        return None;
    }
    let arrived = run.y;
    run.sum[1..].fill(0.0);
    if !through(run_in, run_in + length, &mut run) {
        return None;
    }
    let (mut exact, mut met) = (0, true);
    for lane in 1..LANES {
        let off = |n: usize| (arrived[n][lane] - run.y[n][lane - 1]).abs();
        exact += usize::from((0..3).all(|n| off(n) == 0.0));
        met &= (0..3).all(|n| off(n) <= SEAM * run.y[n].iter().fold(0.0f64, |most, y| most.max(y.abs())));
    }
    if !met {
        return Some(Pieces { sum: None, exact });
    }
    let mut sum: f64 = run.sum.iter().fold(0.0, |sum, part| sum + part);
    let done = (LANES - 1) * length + run_in + length;
    let last = [0, 1, 2].map(|n| run.y[n][LANES - 1]);
    sum += in_a_row(track, segment, kernel, done, point, Some(last), stop)?;
    Some(Pieces { sum: Some(sum), exact })
}

/// The sum of squares over the samples from number `first` on one after the other, from a scaled state or the measured one at
/// the beginning.
fn in_a_row(
    track: &Track,
    segment: &Segment,
    kernel: Kernel,
    first: usize,
    point: &[f64; POINT],
    from: Option<[f64; 3]>,
    stop: &(dyn Fn() -> bool + Sync),
) -> Option<f64> {
    let mut blocks = Block::room(1);
    for column in 0..block::BLOCK {
        block::place(&mut blocks, column, &segment.scale, point, segment.first);
        for (n, y) in from.into_iter().flatten().enumerate() {
            block::set(&mut blocks, column, COEFFICIENTS + n, y);
        }
    }
    let fields = fields(track.has_load);
    for samples in segment.samples()[first * fields..].chunks(STRETCH * fields) {
        if stop() {
            return None;
        }
        let (pieces, show_w, has_load) = (segment.pieces, segment.show_w, track.has_load);
        block::run(kernel, &mut blocks, 1, Stretch { samples, pieces, show_w, has_load });
    }
    Some(block::get(&blocks, 0, block::SUM))
}

/// Scaled states and sums of the pieces.
struct Run {
    y: [[f64; LANES]; 3],
    sum: [f64; LANES],
}

/// A stretch of all pieces.
struct Together<'a> {
    run: &'a mut Run,
    /// The segment's samples, flat.
    records: &'a [f64],
    begin: [usize; LANES],
    count: usize,
    with: [f64; COEFFICIENTS],
    pieces: usize,
    show_w: f64,
}

struct WithLoad<'a, const LOAD: bool>(Together<'a>);

impl<const LOAD: bool> Job for WithLoad<'_, LOAD> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(mut self) {
        for first in (0..LANES).step_by(VECTORS * V::WIDTH) {
            match self.0.pieces {
                1 => self.advance::<V, true>(first),
                _ => self.advance::<V, false>(first),
            }
        }
    }
}

impl<const LOAD: bool> WithLoad<'_, LOAD> {
    /// The samples of a vector of pieces whose records begin at `begin`, `at` numbers further on.
    #[inline(always)]
    fn samples<V: Lane>(records: &[f64], begin: &[usize], at: usize) -> Sample<V> {
        if LOAD {
            return V::columns::<6>(records, begin, 1, at);
        }
        let [v_d, v_q, i_d, i_q, omega] = V::columns::<5>(records, begin, 1, at);
        [v_d, v_q, i_d, i_q, omega, V::zero()]
    }

    /// Takes [`VECTORS`] vectors of pieces through the stretch, with `ONCE` in one step per sample.
    #[inline(always)]
    fn advance<V: Lane, const ONCE: bool>(&mut self, first: usize) {
        let Together { run, records, begin, count, with, pieces, show_w } = &mut self.0;
        let mut rows = [0.0; COEFFICIENTS * block::BLOCK];
        for (row, value) in rows.chunks_exact_mut(block::BLOCK).zip(with.iter()) {
            row.fill(*value);
        }
        let with = Coefficients::<V>::load(&rows, block::BLOCK, 0);
        let show_w = V::constant(*show_w);
        let mut y = [[V::zero(); 3]; VECTORS];
        let mut sum = [V::zero(); VECTORS];
        for r in 0..VECTORS {
            let at = first + r * V::WIDTH;
            for n in 0..3 {
                y[r][n] = V::load(&run.y[n][at..]);
            }
            sum[r] = V::load(&run.sum[at..]);
        }
        let fields = fields(LOAD);
        let begin = begin.map(|sample| sample * fields);
        for k in 0..*count {
            for lane in first..first + VECTORS * V::WIDTH {
                lanes::prefetch(records, begin[lane] + (k + AHEAD) * fields);
            }
            for r in 0..VECTORS {
                let now = Self::samples::<V>(records, &begin[first + r * V::WIDTH..], k * fields);
                let e = with.errors(y[r], &now, show_w);
                sum[r] = e[2].mul_add(e[2], e[1].mul_add(e[1], e[0].mul_add(e[0], sum[r])));
                for _ in 0..if ONCE { 1 } else { *pieces } {
                    y[r] = with.step::<STAGES, LOAD>(y[r], &now);
                }
            }
        }
        for r in 0..VECTORS {
            let at = first + r * V::WIDTH;
            for n in 0..3 {
                y[r][n].store(&mut run.y[n][at..]);
            }
            sum[r].store(&mut run.sum[at..]);
        }
    }
}
