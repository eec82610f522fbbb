//! The objective on the kernels of [`crate::kernels::bare`], where they know the model and the sampling: many points at once, and
//! normal equations from perturbed copies.

use super::initial::Slope;
use super::recorded::Recorded;
use super::{AT_REST, Drive, Objective, side_by_side};
use crate::experiment::Linearisation;
use crate::kernels::bare::copies::{self, Around, INITIAL};
use crate::kernels::bare::{self, Kernel, POINT, chunks};
use crate::optimise::least_squares::Normal;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Fewer points than fill the vectors: a long recording is then cut into pieces instead.
const FEW: usize = 4;
/// Points that a thread must have for another one to pay.
const PER_THREAD: usize = 250;
/// Part of a thread's share that another thread may take over.
const SMALL: usize = 5;
/// Smallest scale of a load torque or a friction torque at top speed, as a share of the largest torque.
const LEAST_TORQUE: f64 = 0.05;
/// Smallest scale of the magnet's flux, as a share of the largest flux linkage.
const LEAST_FLUX: f64 = 1e-3;

/// Share of the largest current and speed by which measured initial values may be off for derivatives around them to do for an
/// uncertainty.
const NEAR: f64 = 0.005;

/// Initial i_d, i_q (A), ω_e (rad/s) of each gap-free segment.
pub type Starts = Vec<[f64; INITIAL]>;

/// How the best initial values follow the free parameters near the point of a run, to first order.
#[derive(Debug, Clone)]
pub struct Course {
    /// The best initial values at the point itself.
    best: Starts,
    /// Their derivatives, segment by segment, one entry per free parameter.
    slopes: Vec<Vec<Vector3<f64>>>,
}

impl Course {
    /// The best initial values where the free parameters are `moves` away from the point.
    pub fn at(&self, moves: &[f64]) -> Starts {
        let mut starts = self.best.clone();
        for (start, slopes) in starts.iter_mut().zip(&self.slopes) {
            for (slope, moved) in slopes.iter().zip(moves) {
                for k in 0..INITIAL {
                    start[k] += slope[k] * moved;
                }
            }
        }
        starts
    }

    /// The best initial values at the point itself.
    pub fn best(&self) -> &Starts {
        &self.best
    }
}

/// Products of all pairs of columns of one segment: free parameters, initial values, error.
struct Sums {
    free: usize,
    width: usize,
    values: Vec<f64>,
}

impl Sums {
    fn get(&self, a: usize, b: usize) -> f64 {
        self.values[a.max(b) * self.width + a.min(b)]
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

/// What one run of the kernels tells of a point.
#[derive(Debug, Clone)]
pub struct Nearby {
    /// Normal equations without the initial values.
    pub normal: Normal,
    /// The initial values that the run calls for, there and nearby.
    pub course: Course,
    /// Residual and derivatives without what the initial values can still do, where they were asked for.
    pub linear: Option<Linearisation>,
}

/// Points, their bounds, and where their costs go.
type Part<'a> = ((&'a [f64], &'a [f64]), &'a mut [f64]);

/// Points, bounds and costs cut into shares of `share` points, each share into a large and a small part: whoever is done with
/// his own takes over a small part of another's. Only large ones keep the vectors full while sets are abandoned.
fn parts<'a>(
    mut points: &'a [f64],
    mut bounds: &'a [f64],
    mut costs: &'a mut [f64],
    share: usize,
) -> Vec<Part<'a>> {
    let small = (share / SMALL).max(1);
    let mut parts = Vec::with_capacity(2 * costs.len().div_ceil(share));
    for size in [share - small, small].into_iter().cycle() {
        let size = size.min(costs.len());
        let (own, rest) = std::mem::take(&mut costs).split_at_mut(size);
        parts.push(((&points[..size * POINT], &bounds[..size]), own));
        (points, bounds, costs) = (&points[size * POINT..], &bounds[size..], rest);
        if costs.is_empty() {
            break;
        }
    }
    parts
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
        if let Some(track) = &self.prepared.track {
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
            let evaluate = |((points, bounds), costs): Part<'_>| {
                if bare::costs(track, Kernel::default(), points, bounds, costs, stop) {
                    evaluated.fetch_add(costs.len(), Ordering::Relaxed);
                } else {
                    costs.fill(f64::INFINITY);
                }
            };
            if share >= costs.len() {
                evaluate(((points, bounds), costs));
            } else {
                parts(points, bounds, costs, share).into_par_iter().with_max_len(1).for_each(evaluate);
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
        self.prepared.track.is_some()
    }

    /// The measured initial values of each segment.
    pub fn measured_starts(&self) -> Starts {
        let signals = self.experiment.signals;
        let Some([d, q]) = &signals.i else { return Starts::new() };
        signals.segments.iter().map(|s| [d[s.start], q[s.start], signals.omega_e[s.start]]).collect()
    }

    /// Normal equations at `p` with respect to the entries `free`, the initial values taken out after one run from
    /// `starts`; with `record` the residual and its derivatives themselves, too. `None` where the kernels do not apply; not
    /// finite once `stop` says so.
    pub fn normal(
        &self,
        p: &[f64],
        free: &[usize],
        starts: &Starts,
        record: bool,
        stop: &dyn Fn() -> bool,
    ) -> Option<Nearby> {
        let mut recorded = record.then(|| Recorded::room(self.experiment.signals.len(), free.len()));
        let all = self.sums(p, free, starts, stop, recorded.as_mut())?;
        let mut recorded = recorded.filter(Recorded::is_complete);
        let mut normal = Normal {
            cost: 0.0,
            jtj: DMatrix::zeros(free.len(), free.len()),
            jtr: DVector::zeros(free.len()),
        };
        let mut course = Course { best: starts.clone(), slopes: Vec::with_capacity(starts.len()) };
        for (number, (sums, start)) in all.iter().zip(&mut course.best).enumerate() {
            let initial = |of: usize| Vector3::from_fn(|k, _| sums.get(free.len() + k, of));
            let (last, error) = (sums.width - 1, sums.explained(None));
            normal.cost += sums.get(last, last) - initial(last).dot(&error);
            let mut slopes = Vec::with_capacity(free.len());
            for a in 0..free.len() {
                let own = sums.explained(Some(a));
                normal.jtr[a] += sums.get(a, last) - initial(last).dot(&own);
                for b in 0..=a {
                    normal.jtj[(a, b)] += sums.get(a, b) - initial(b).dot(&own);
                }
                slopes.push(-own);
            }
            if let Some(recorded) = &mut recorded {
                let segment = &self.experiment.signals.segments[number];
                recorded.project(Kernel::default(), segment, &slopes, &error);
            }
            for k in 0..INITIAL {
                start[k] -= error[k];
            }
            course.slopes.push(slopes);
        }
        normal.jtj.fill_upper_triangle_with_lower_triangle();
        Some(Nearby { normal, course, linear: recorded.map(Recorded::linear) })
    }

    /// [`Objective::linearise`] as an uncertainty needs it: around the measured initial values, if the best ones are within half a per cent of the
    /// largest current and speed. The residual is then off by what such a change is off its first order, derivatives by as much of
    /// themselves as they change over it.
    pub fn linearise_nearby(&self, p: &[f64], free: &[usize]) -> Linearisation {
        let measured = self.measured_starts();
        let around = self.normal(p, free, &measured, true, &|| false);
        let linear = around.and_then(|Nearby { linear, course, .. }| {
            let near = self.within(NEAR, &measured, course.best());
            linear.filter(|_| near).or_else(|| self.linear_from(p, free, course.best()))
        });
        linear.unwrap_or_else(|| self.linearise(p, free, None))
    }

    /// [`Objective::linearise`] on the kernels, around the initial values `starts`; without them around the best ones.
    pub(super) fn kernel_linear(
        &self,
        p: &[f64],
        free: &[usize],
        starts: Option<&Starts>,
    ) -> Option<Linearisation> {
        match starts {
            Some(starts) => self.normal(p, free, starts, true, &|| false)?.linear,
            None => {
                let measured = self.normal(p, &[], &self.measured_starts(), false, &|| false)?;
                self.linear_from(p, free, measured.course.best())
            }
        }
    }

    /// The same around the best initial values. Mostly the first step of a search leads there, the run from the measured ones to `goal`,
    /// which the run around that tells.
    fn linear_from(&self, p: &[f64], free: &[usize], goal: &Starts) -> Option<Linearisation> {
        let around = |starts: &Starts| self.normal(p, free, starts, true, &|| false);
        let there = around(goal)?;
        if self.within(AT_REST, goal, there.course.best()) {
            return there.linear;
        }
        around(&self.initial_values(p))?.linear
    }

    /// What the sum of squares of each segment tells of its initial values, on a run from `starts`.
    pub(super) fn slopes_on_kernels(&self, p: &[f64], starts: &Starts) -> Option<Vec<Slope>> {
        let of = |sums: Sums| Slope {
            cost: sums.get(sums.width - 1, sums.width - 1),
            gram: Matrix3::from_fn(|a, b| sums.get(a, b)),
            gradient: Vector3::from_fn(|a, _| sums.get(a, sums.width - 1)),
        };
        Some(self.sums(p, &[], starts, &|| false, None)?.into_iter().map(of).collect())
    }

    /// Products of columns, segment by segment; `record` takes the rows.
    fn sums(
        &self,
        p: &[f64],
        free: &[usize],
        starts: &Starts,
        stop: &dyn Fn() -> bool,
        mut record: Option<&mut Recorded>,
    ) -> Option<Vec<Sums>> {
        let track = self.prepared.track.as_ref().filter(|_| self.drive == Drive::Coupled)?;
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
            copies::accumulate(kernel, rows.rows, free_count, &mut all[rows.segment].values);
            if let Some(record) = &mut record {
                record.take(kernel, rows.rows);
            }
        });
        if !done {
            // Unfinished sums must not be taken for an answer.
            all.iter_mut().for_each(|sums| sums.values.fill(f64::NAN));
        }
        Some(all)
    }
}
