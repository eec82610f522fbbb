//! The coupled model with any effects for several parameter sets at once: every equation of the catalogue runs on vectors, as
//! they are numbers like any other ([`crate::numerics::lanes::Lane`]).

use super::{Objective, PHASES};
use crate::numerics::lanes::{self, Job, Lane, Path};
use crate::simulate::coupled::{self, Watch};

/// Parameter sets per vector at most.
pub const GROUP: usize = 8;

impl Objective<'_> {
    /// Writes the fitness of each point, infinite where it passes its bound, where this processor has vectors. At most
    /// [`GROUP`] points.
    pub(super) fn side_by_side(&self, points: &[f64], bounds: &[f64], costs: &mut [f64]) -> bool {
        let width = match Path::best() {
            Path::Avx512 => 8,
            Path::Avx2 => 4,
            _ => return false,
        };
        let parts = points.chunks(width * self.len()).zip(bounds.chunks(width)).zip(costs.chunks_mut(width));
        for ((points, bounds), costs) in parts {
            let together = Together { objective: self, points, bounds, costs };
            if width == 8 { lanes::avx512(together) } else { lanes::avx2(together) }
        }
        true
    }
}

/// As many parameter sets as a vector holds, or fewer.
struct Together<'a> {
    objective: &'a Objective<'a>,
    points: &'a [f64],
    bounds: &'a [f64],
    costs: &'a mut [f64],
}

impl Job for Together<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(self) {
        let (e, len) = (&self.objective.experiment, self.objective.len());
        let (Some([d, q]), omega) = (&e.signals.i, &e.signals.omega_e) else { return };
        let mut p = Vec::with_capacity(len);
        for entry in 0..len {
            let mut column = [0.0; GROUP];
            for (lane, x) in column.iter_mut().enumerate() {
                // Places left over hold the last set again.
                *x = self.points[lane.min(self.costs.len() - 1) * len + entry];
            }
            p.push(V::load(&column));
        }
        let mut limits = [f64::NEG_INFINITY; GROUP];
        limits[..self.bounds.len()].copy_from_slice(self.bounds);
        let weight = 1.0 / e.channels[2].1;
        let mut sum = Sum { d, q, omega, weight, sum: V::zero(), limits: V::load(&limits) };
        let own = e.model.parameter_count();
        let start = |_: usize, measured: [f64; 3]| measured.map(V::constant);
        coupled::watch(e.model, e.signals, 0..e.signals.len(), &p[..own], p[own], start, &mut sum);
        let mut sums = [0.0; GROUP];
        sum.sum.store(&mut sums);
        for ((cost, sum), bound) in self.costs.iter_mut().zip(sums).zip(self.bounds) {
            *cost = if sum <= *bound && sum.is_finite() { sum } else { f64::INFINITY };
        }
    }
}

/// The sums of squares while the simulation runs.
struct Sum<'a, V> {
    d: &'a [f64],
    q: &'a [f64],
    omega: &'a [f64],
    weight: f64,
    sum: V,
    limits: V,
}

impl<V: Lane> Watch<V> for Sum<'_, V> {
    #[inline(always)]
    fn see(&mut self, k: usize, [i_d, i_q, w]: [V; 3]) -> bool {
        let (e_d, e_q, e_w) = (i_d - self.d[k], i_q - self.q[k], (w - self.omega[k]) * self.weight);
        self.sum += (e_d * e_d + e_q * e_q) * PHASES + e_w * e_w;
        self.sum.any_within(self.limits)
    }
}
