//! Many parameter sets on one recording: early abandonment, survivors closing ranks.

use super::block::{self, BLOCK, Block, ROWS, SUM, Stretch};
use super::track::{Segment, Track};
use super::{Kernel, POINT};

/// Samples between two looks at who has passed his bound. They and a few blocks fit into the first-level cache.
const STRETCH: usize = 128;

/// Steps of a parameter set between two looks at the stop flag, some microseconds.
const LOOK: usize = 1 << 14;

/// Parameter sets under way.
struct Pool<'a> {
    blocks: Vec<Block>,
    /// Whose costs the columns hold.
    who: Vec<usize>,
    points: &'a [f64],
    bounds: &'a [f64],
}

/// Writes to `costs` the fitness of each of the `points` (row-major, [`POINT`] numbers each); infinite where the sum passes
/// the entry of `bounds` or is not finite. Returns false, with `costs` unfinished, once `stop` says so.
///
/// # Panics
/// If the lengths of `points`, `bounds` and `costs` do not agree.
pub fn costs(
    track: &Track,
    kernel: Kernel,
    points: &[f64],
    bounds: &[f64],
    costs: &mut [f64],
    stop: &(dyn Fn() -> bool + Sync),
) -> bool {
    assert!(
        points.len() == POINT * costs.len() && bounds.len() == costs.len(),
        "one point and bound per cost"
    );
    costs.fill(f64::INFINITY);
    let mut unseen = LOOK;
    let mut pool = Pool { blocks: Block::room(costs.len()), who: (0..costs.len()).collect(), points, bounds };
    for segment in &track.segments {
        pool.restart(segment);
        for samples in segment.stretches(STRETCH) {
            unseen += STRETCH * pool.who.len();
            if unseen >= LOOK {
                if stop() {
                    return false;
                }
                unseen = 0;
            }
            let stretch =
                Stretch { samples, pieces: segment.pieces, show_w: segment.show_w, has_load: track.has_load };
            block::run(kernel, &mut pool.blocks, pool.who.len(), stretch);
            pool.close_ranks();
            if pool.who.is_empty() {
                return true;
            }
        }
    }
    for (column, who) in pool.who.iter().enumerate() {
        let sum = block::get(&pool.blocks, column, SUM);
        if sum.is_finite() {
            costs[*who] = sum;
        }
    }
    true
}

impl Pool<'_> {
    /// Puts every set to the measured values at the beginning of a segment. The last one fills up its vector, or half of one: a place
    /// without a motor would fall to numbers too small to be computed at full speed.
    fn restart(&mut self, segment: &Segment) {
        for column in 0..self.who.len().next_multiple_of(BLOCK / 2) {
            let who = self.who[column.min(self.who.len() - 1)];
            let p = &self.points[POINT * who..][..POINT];
            block::place(&mut self.blocks, column, &segment.scale, p, segment.first);
        }
    }

    /// Drops the sets whose sum has passed its bound and fills their places from the end.
    fn close_ranks(&mut self) {
        let mut column = 0;
        while column < self.who.len() {
            // False for NaN, too.
            if block::get(&self.blocks, column, SUM) <= self.bounds[self.who[column]] {
                column += 1;
                continue;
            }
            let last = self.who.len() - 1;
            for row in 0..ROWS {
                let value = block::get(&self.blocks, last, row);
                block::set(&mut self.blocks, column, row, value);
            }
            self.who.swap_remove(column);
        }
    }
}
