//! The objective of the coupled model by the equations as the catalogue has them, with the initial values of each gap-free segment
//! estimated along.

use super::initial::{Search, Slope};
use super::{AT_REST, INITIAL, Objective, PHASES, Starts};
use crate::experiment::{Channel, Linearisation};
use crate::numerics::dual::Dual;
use crate::numerics::real::Real;
use crate::simulate::coupled;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Most runs on the way to the best initial values.
const ROUNDS: usize = 100;
/// Derivatives carried in one pass.
const SLOTS: usize = 8;

impl Objective<'_> {
    pub(super) fn coupled_fitness(&self, p: &[f64], bound: f64) -> f64 {
        let e = &self.experiment;
        let (Some([d, q]), omega) = (&e.signals.i, &e.signals.omega_e) else { return f64::INFINITY };
        let weight = 1.0 / e.channels[2].1;
        let (own, load) = (e.model.parameter_count(), p[e.model.parameter_count()]);
        let mut sum = 0.0;
        coupled::run(e.model, e.signals, 0..e.signals.len(), &p[..own], load, |k, [i_d, i_q, w]| {
            let (e_d, e_q, e_w) = (i_d - d[k], i_q - q[k], (w - omega[k]) * weight);
            sum += PHASES * (e_d * e_d + e_q * e_q) + e_w * e_w;
            // False for NaN, too.
            sum <= bound
        });
        sum
    }

    /// Estimates the initial values of each segment, then takes derivatives there and projects out what the initial
    /// values can still do.
    pub(super) fn coupled_linear(&self, p: &[f64], free: &[usize], starts: Option<&Starts>) -> Linearisation {
        if let Some(linear) = self.kernel_linear(p, free, starts) {
            return linear;
        }
        let starts = starts.cloned().unwrap_or_else(|| self.initial_values(p));
        let signals = self.experiment.signals;
        let (mut linear, mut initial) = self.coupled_pass(p, free, &starts);
        for segment in &signals.segments {
            project(&stacked(segment, signals.len()), &mut initial, &mut linear);
        }
        linear
    }

    /// What the sum of squares of each segment tells of its initial values, on a run from `starts`.
    pub(super) fn slopes(&self, p: &[f64], starts: &Starts) -> Vec<Slope> {
        let signals = self.experiment.signals;
        let (seen, initial) = self.coupled_pass(p, &[], starts);
        let of = |segment: &Range<usize>| {
            let rows = stacked(segment, signals.len());
            let slope = DMatrix::from_fn(rows.len(), INITIAL, |r, c| initial[(rows[r], c)]);
            let error = DVector::from_fn(rows.len(), |r, _| seen.residual[rows[r]]);
            Slope {
                cost: error.norm_squared(),
                gram: slope.tr_mul(&slope).fixed_view::<INITIAL, INITIAL>(0, 0).into_owned(),
                gradient: slope.tr_mul(&error).fixed_rows::<INITIAL>(0).into_owned(),
            }
        };
        signals.segments.iter().map(of).collect()
    }

    /// The best initial values: those at which a Gauss–Newton step is within [`AT_REST`], from the measured ones on. `look` runs the
    /// model from some initial values. `None` where that ends early.
    pub(super) fn settle(&self, mut look: impl FnMut(&Starts) -> Option<Vec<Slope>>) -> Option<Starts> {
        let mut starts = self.measured_starts();
        let mut searches: Vec<Search> =
            look(&starts)?.into_iter().zip(&starts).map(|(slope, at)| Search::new(slope, *at)).collect();
        for _ in 0..ROUNDS {
            let mut resting = true;
            for (search, start) in searches.iter_mut().zip(&mut starts) {
                let rests = self.within(AT_REST, &[search.at], &[search.better()]);
                *start = if rests { search.at } else { search.next() };
                resting &= rests;
            }
            if resting {
                break;
            }
            for (search, (slope, start)) in searches.iter_mut().zip(look(&starts)?.into_iter().zip(&starts)) {
                search.seen(slope, *start);
            }
        }
        Some(searches.iter().map(|search| search.at).collect())
    }

    /// Whether initial values differ by no more than this `share` of the largest current and speed.
    pub(super) fn within(&self, share: f64, a: &[[f64; INITIAL]], b: &[[f64; INITIAL]]) -> bool {
        let cx = &self.experiment.signals.context;
        let sizes = [cx.i_max, cx.i_max, cx.omega_e_max];
        let both = a.iter().zip(b);
        both.flat_map(|(a, b)| (0..INITIAL).map(|k| (a[k] - b[k]).abs() / sizes[k])).all(|x| x <= share)
    }

    /// Residuals and derivatives from the initial values `starts` of each segment, and the derivatives with respect to
    /// those. Dual numbers with [`SLOTS`] slots: the last three for the initial values, the others for parameters.
    fn coupled_pass(&self, p: &[f64], free: &[usize], starts: &[[f64; 3]]) -> (Linearisation, DMatrix<f64>) {
        let e = &self.experiment;
        let (n, own, lanes) = (e.signals.len(), e.model.parameter_count(), SLOTS - INITIAL);
        let measured = [Channel::ID, Channel::IQ, Channel::OmegaE].map(|c| e.measured(c));
        let weight = [0, 1, 2].map(|c| 1.0 / e.channels[c].1);
        let mut residual = DVector::zeros(3 * n);
        let mut jacobian = DMatrix::zeros(3 * n, free.len());
        let mut initial = DMatrix::zeros(3 * n, INITIAL);
        for first in (0..free.len().max(1)).step_by(lanes.max(1)) {
            let columns = first..(first + lanes).min(free.len());
            let mut seeded: Vec<Dual<SLOTS>> = p.iter().map(|x| Dual::constant(*x)).collect();
            for (slot, column) in columns.clone().enumerate() {
                seeded[free[column]] = Dual::variable(p[free[column]], slot);
            }
            let start = |k: usize, measured: [f64; 3]| {
                let known = e.signals.segments.iter().position(|s| s.start == k);
                let x = known.map_or(measured, |s| starts[s]);
                [0, 1, 2].map(|c| Dual::variable(x[c], lanes + c))
            };
            let (load, all) = (seeded[own], 0..n);
            coupled::run_from(e.model, e.signals, all, &seeded[..own], load, start, |k, now| {
                for c in 0..3 {
                    let row = c * n + k;
                    residual[row] = (now[c].re - measured[c][k]) * weight[c];
                    for (slot, column) in columns.clone().enumerate() {
                        jacobian[(row, column)] = now[c].eps[slot] * weight[c];
                    }
                    for x in 0..INITIAL {
                        initial[(row, x)] = now[c].eps[lanes + x] * weight[c];
                    }
                }
                true
            });
        }
        (Linearisation { residual, jacobian }, initial)
    }
}

/// The rows of a segment in three stacked channels of `n` samples.
fn stacked(segment: &Range<usize>, n: usize) -> Vec<usize> {
    (0..3).flat_map(|c| segment.clone().map(move |k| c * n + k)).collect()
}

/// Takes the columns of `initial`, restricted to `rows`, out of the residual and of the derivatives (Gram–Schmidt).
fn project(rows: &[usize], initial: &mut DMatrix<f64>, linear: &mut Linearisation) {
    let remove = |direction: &[f64], x: &mut [f64]| {
        let share: f64 = rows.iter().zip(direction).map(|(r, d)| x[*r] * d).sum();
        for (r, d) in rows.iter().zip(direction) {
            x[*r] -= share * d;
        }
    };
    for column in 0..initial.ncols() {
        let direction: Vec<f64> = rows.iter().map(|r| initial[(*r, column)]).collect();
        let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
        if !(length > 0.0 && length.is_finite()) {
            continue;
        }
        let direction: Vec<f64> = direction.iter().map(|d| d / length).collect();
        for mut later in initial.column_iter_mut().skip(column + 1) {
            remove(&direction, later.as_mut_slice());
        }
        remove(&direction, linear.residual.as_mut_slice());
        for mut derivative in linear.jacobian.column_iter_mut() {
            remove(&direction, derivative.as_mut_slice());
        }
    }
}
