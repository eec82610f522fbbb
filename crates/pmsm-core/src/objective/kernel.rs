//! The objective on the kernels of [`crate::bare`], where they know the model and the sampling: many points at once, and
//! normal equations from perturbed copies.

use super::{Drive, Objective, side_by_side};
use crate::bare::copies::{self, Around, INITIAL};
use crate::bare::{self, Kernel, POINT, chunks};
use crate::experiment::Linearisation;
use crate::least_squares::Normal;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Fewer points than fill the vectors: a long recording is then cut into pieces instead.
const FEW: usize = 4;
/// Points that a thread must have for another one to pay.
const PER_THREAD: usize = 250;
/// Smallest scale of a load torque or a friction torque at top speed, as a share of the largest torque.
const LEAST_TORQUE: f64 = 0.05;
/// Smallest scale of the magnet's flux, as a share of the largest flux linkage.
const LEAST_FLUX: f64 = 1e-3;

/// Initial i_d, i_q (A), ω_e (rad/s) of each gap-free segment.
pub type Starts = Vec<[f64; INITIAL]>;

/// Products of all pairs of columns of one segment: free parameters, initial values, error.
struct Sums {
    free: usize,
    width: usize,
    values: Vec<f64>,
}

impl Sums {
    fn get(&self, a: usize, b: usize) -> f64 {
        self.values[a * self.width + b]
    }

    /// Regression of column `of` (a free parameter, or the error as `None`) on the initial values; nothing where they
    /// cannot be told apart.
    fn explained(&self, of: Option<usize>) -> Vector3<f64> {
        let x = |k: usize| self.free + k;
        let normal = Matrix3::from_fn(|a, b| self.get(x(a), x(b)));
        let right = Vector3::from_fn(|a, _| self.get(x(a), of.unwrap_or(self.width - 1)));
        let solved = normal.cholesky().map(|factor| factor.solve(&right));
        solved.filter(|share| share.iter().all(|s| s.is_finite())).unwrap_or_default()
    }
}

impl Objective<'_> {
    /// The fitness (see [`Objective::fitness`]) of each of the `points` (row-major, [`Objective::len`] numbers each) with
    /// its own bound, in parallel where that pays. Returns how many were evaluated: all, unless `stop` said so.
    pub fn fitnesses(
        &self,
        points: &[f64],
        bounds: &[f64],
        costs: &mut [f64],
        stop: &(dyn Fn() -> bool + Sync),
    ) -> usize {
        let evaluated = AtomicUsize::new(0);
        if let Some(track) = &self.track {
            if costs.len() <= FEW && track.len() >= chunks::SHORTEST {
                points.par_chunks(POINT).zip(bounds).zip(costs).for_each(|((point, bound), cost)| {
                    *cost = f64::INFINITY;
                    let point = point.try_into().expect("as long as a point");
                    if let Some((sum, _)) = chunks::cost(track, Kernel::default(), point, stop) {
                        evaluated.fetch_add(1, Ordering::Relaxed);
                        // False for NaN, too.
                        if sum <= *bound && sum.is_finite() {
                            *cost = sum;
                        }
                    }
                });
                return evaluated.into_inner();
            }
            let share = costs.len().div_ceil(rayon::current_num_threads()).max(PER_THREAD);
            let evaluate = |((points, bounds), costs): ((&[f64], &[f64]), &mut [f64])| {
                if bare::costs(track, Kernel::default(), points, bounds, costs, stop) {
                    evaluated.fetch_add(costs.len(), Ordering::Relaxed);
                } else {
                    costs.fill(f64::INFINITY);
                }
            };
            if share >= costs.len() {
                evaluate(((points, bounds), costs));
            } else {
                let parts = points.par_chunks(share * POINT).zip(bounds.par_chunks(share));
                parts.zip(costs.par_chunks_mut(share)).for_each(evaluate);
            }
        } else {
            // What the kernels do not know runs on vectors of parameter sets all the same, the coupled model at least.
            let group = if self.drive == Drive::Coupled { side_by_side::GROUP } else { 1 };
            let parts = points.par_chunks(group * self.len()).zip(bounds.par_chunks(group));
            parts.zip(costs.par_chunks_mut(group)).for_each(|((points, bounds), costs)| {
                costs.fill(f64::INFINITY);
                if stop() {
                    return;
                }
                if self.drive != Drive::Coupled || !self.side_by_side(points, bounds, costs) {
                    for ((point, bound), cost) in points.chunks_exact(self.len()).zip(bounds).zip(&mut *costs)
                    {
                        *cost = self.fitness(point, *bound);
                    }
                }
                evaluated.fetch_add(costs.len(), Ordering::Relaxed);
            });
        }
        evaluated.into_inner()
    }

    /// Whether the kernels know the model and the sampling.
    pub fn has_kernels(&self) -> bool {
        self.track.is_some()
    }

    /// The measured initial values of each segment.
    pub fn measured_starts(&self) -> Starts {
        let signals = self.experiment.signals;
        let Some([d, q]) = &signals.i else { return Starts::new() };
        signals.segments.iter().map(|s| [d[s.start], q[s.start], signals.omega_e[s.start]]).collect()
    }

    /// Normal equations at `p` with respect to the entries `free`, the initial values taken out after one run from
    /// `starts`; and the initial values that this calls for. `None` where the kernels do not apply; not finite once `stop`
    /// says so.
    pub fn normal(
        &self,
        p: &[f64],
        free: &[usize],
        starts: &Starts,
        stop: &dyn Fn() -> bool,
    ) -> Option<(Normal, Starts)> {
        let all = self.sums(p, free, starts, stop, |_| ())?;
        let mut normal = Normal {
            cost: 0.0,
            jtj: DMatrix::zeros(free.len(), free.len()),
            jtr: DVector::zeros(free.len()),
        };
        let mut next = starts.clone();
        for (sums, start) in all.iter().zip(&mut next) {
            let initial = |of: usize| Vector3::from_fn(|k, _| sums.get(free.len() + k, of));
            let (last, error) = (sums.width - 1, sums.explained(None));
            normal.cost += sums.get(last, last) - initial(last).dot(&error);
            for a in 0..free.len() {
                let own = sums.explained(Some(a));
                normal.jtr[a] += sums.get(a, last) - initial(last).dot(&own);
                for b in 0..=a {
                    normal.jtj[(a, b)] += sums.get(a, b) - initial(b).dot(&own);
                }
            }
            for k in 0..INITIAL {
                start[k] -= error[k];
            }
        }
        normal.jtj.fill_upper_triangle_with_lower_triangle();
        Some((normal, next))
    }

    /// The best initial values at `p` to first order around `starts`; `None` where the kernels do not apply.
    pub fn settled_starts(&self, p: &[f64], starts: Starts) -> Option<Starts> {
        self.normal(p, &[], &starts, &|| false).map(|(_, next)| next)
    }

    /// [`Objective::linearise`] on the kernels.
    pub(super) fn kernel_linear(&self, p: &[f64], free: &[usize]) -> Option<Linearisation> {
        let go = || false;
        let starts = self.settled_starts(p, self.measured_starts())?;
        let n = self.experiment.signals.len();
        let mut linear =
            Linearisation { residual: DVector::zeros(3 * n), jacobian: DMatrix::zeros(3 * n, free.len()) };
        let mut initial = vec![[0.0; INITIAL]; 3 * n];
        let width = copies::width(free.len());
        let sums = self.sums(p, free, &starts, &go, |rows| {
            for (at, row) in rows.rows.chunks_exact(width).enumerate() {
                let place = at % 3 * n + rows.first + at / 3;
                linear.residual[place] = row[width - 1];
                for a in 0..free.len() {
                    linear.jacobian[(place, a)] = row[a];
                }
                initial[place].copy_from_slice(&row[free.len()..free.len() + INITIAL]);
            }
        })?;
        // What the initial values can still do is taken out.
        for (sums, segment) in sums.iter().zip(&self.experiment.signals.segments) {
            let targets = (0..free.len()).map(Some).chain([None]);
            for of in targets {
                let share = sums.explained(of);
                let column = match of {
                    Some(a) => linear.jacobian.column_mut(a).data.into_slice_mut(),
                    None => linear.residual.as_mut_slice(),
                };
                for channel in 0..3 {
                    let rows = channel * n + segment.start..channel * n + segment.end;
                    for (x, initial) in column[rows.clone()].iter_mut().zip(&initial[rows]) {
                        *x -= initial[0] * share[0] + initial[1] * share[1] + initial[2] * share[2];
                    }
                }
            }
        }
        Some(linear)
    }

    /// Products of columns, segment by segment.
    fn sums(
        &self,
        p: &[f64],
        free: &[usize],
        starts: &Starts,
        stop: &dyn Fn() -> bool,
        mut see: impl FnMut(&copies::Rows<'_>),
    ) -> Option<Vec<Sums>> {
        let track = self.track.as_ref().filter(|_| self.drive == Drive::Coupled)?;
        let p: &[f64; POINT] = p.try_into().ok()?;
        let cx = &self.experiment.signals.context;
        let mut sizes = p.map(f64::abs);
        sizes[3] = sizes[3].max(LEAST_FLUX * cx.psi_max);
        sizes[5] = sizes[5].max(LEAST_TORQUE * cx.tau_max / cx.omega_m_max());
        sizes[6] = sizes[6].max(LEAST_TORQUE * cx.tau_max);
        let initial_sizes = [cx.i_max, cx.i_max, cx.omega_e_max];
        let (free_count, width) = (free.len(), copies::width(free.len()));
        let empty = || Sums { free: free_count, width, values: vec![0.0; width * width] };
        let mut all: Vec<Sums> = starts.iter().map(|_| empty()).collect();
        let around = Around { p, free, sizes: &sizes, initial_sizes, starts };
        let kernel = Kernel::default();
        let done = copies::rows(track, kernel, around, stop, |rows| {
            copies::accumulate(kernel, rows.rows, width, &mut all[rows.segment].values);
            see(&rows);
        });
        if !done {
            // Unfinished sums must not be taken for an answer.
            all.iter_mut().for_each(|sums| sums.values.fill(f64::NAN));
        }
        Some(all)
    }
}
