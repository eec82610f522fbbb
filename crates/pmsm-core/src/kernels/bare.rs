//! The bare machine (1)–(3) on vectors: the fitness (9) of many parameter sets at once, their weighted errors sample by
//! sample, and one parameter set on a long recording.
//!
//! The same equations as [`crate::simulate::coupled`] without effects, in the scaled flux states of [`step`]. What
//! makes it fast: no division in a step, vectors chosen at run time ([`crate::numerics::lanes`]), parameter sets side by side in
//! blocks of eight that are read in one go, stretches of the recording short enough to stay in the cache, and early
//! abandonment: a sum of squares only grows, so a set whose sum has passed its bound is dropped and the others close
//! ranks. Dropping changes no bit of the others.
//!
//! [`Rounding::Fused`] is the default: a quarter faster, and the same bits on every processor with fused multiply-add, be its
//! vectors four or eight wide, which is every x86-64 since 2013. As a swarm follows comparisons of costs, one different last
//! bit sends it elsewhere; where older processors must give the same answer, [`Rounding::Reproducible`] does.

mod block;
pub mod chunks;
pub mod copies;
mod pool;
pub mod step;
mod track;

pub use pool::costs;
pub use track::Track;

use crate::numerics::lanes::{Path, Rounding};

/// A point: r_s, l_d, l_q, psi_m, j, b and the load torque on top of what the recording tells of it.
pub const POINT: usize = 7;

/// How the kernels compute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kernel {
    /// Vectors.
    pub path: Path,
    /// Rounding of products and sums.
    pub rounding: Rounding,
    /// Whether the step adds increments ([`step::INCREMENTS`]) in place of stage values ([`step::STAGES`]).
    pub increments: bool,
}

impl Default for Kernel {
    /// The widest vectors of this processor, fused, in stage values.
    fn default() -> Self {
        Self { path: Path::best(), rounding: Rounding::Fused, increments: false }
    }
}
