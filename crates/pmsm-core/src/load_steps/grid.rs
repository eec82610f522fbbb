//! The integral over the measured speed in which load steps are hinges, on a coarse grid.

use super::behind::Behind;
use crate::base::Base;
use crate::effect::Site;
use crate::effects::EffectId;
use crate::model::Model;
use crate::numerics::basis;
use crate::numerics::dual::Dual;
use crate::numerics::real::Real;
use crate::signals::Signals;
use crate::simulate::environment::measured_env;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Points of the grid on which y(t) is looked at.
const POINTS: usize = 1200;
/// Mechanical parameters of the model that may be corrected at once.
const LANES: usize = 8;

/// y(t), and the columns that may take part of it, on a coarse grid.
pub struct Grid {
    /// Time of each point from the first sample, s.
    pub t: Vec<f64>,
    /// Half the time over which each point is an average, s, and the longest of them.
    half: Vec<f64>,
    reach: f64,
    /// y(t) without what the columns can do.
    pub y: DVector<f64>,
    /// Orthonormal basis of the columns.
    pub basis: DMatrix<f64>,
    /// Its products with hinges.
    pub known: Behind,
}

impl Grid {
    /// Of the samples `rows`, given the motor torque per sample `tau_e` and the mechanical parameters `free` that may still be wrong.
    pub fn new(
        model: &Model,
        signals: &Signals,
        p: &[f64],
        tau_e: &[f64],
        free: &[usize],
        rows: Range<usize>,
    ) -> Self {
        let rigid: Vec<EffectId> =
            model.effects().into_iter().filter(|e| e.mechanical_state_count() == 0).collect();
        let mut kept = Model::new(*model.context(), &rigid);
        if let Some(map) = model.map() {
            kept = kept.with_map(map.clone());
        }
        let (values, places) = restrict(model, &kept, p);
        let seeds: Vec<usize> =
            free.iter().filter_map(|k| places.get(*k).copied().flatten()).take(LANES).collect();
        let mut seeded: Vec<Dual<LANES>> = values.iter().map(|x| Dual::constant(*x)).collect();
        for (slot, place) in seeds.iter().enumerate() {
            seeded[*place] = Dual::variable(values[*place], slot);
        }
        let base = Base::new(&seeded);
        let (first, n) = (rows.start, rows.len());
        let block = n.div_ceil(POINTS).max(1);
        let count = n.div_ceil(block);
        let (mut t, mut y) = (Vec::with_capacity(count), DVector::zeros(count));
        let mut half = Vec::with_capacity(count);
        // What the motor did in a gap is unknown.
        let point = (signals.t[rows.end - 1] - signals.t[first]) / count as f64;
        let gap = |k: &usize| *k > first && *k < rows.end && signals.t[*k] - signals.t[*k - 1] > point;
        let behind_gaps: Vec<usize> = signals.segments.iter().map(|s| s.start).filter(gap).collect();
        let mut columns = DMatrix::zeros(count, 2 + seeds.len() + behind_gaps.len());
        let n_p = signals.n_p;
        let acceleration = |k: usize| -> Dual<LANES> {
            let env = measured_env(signals, k);
            let tau = Dual::constant(tau_e[k]);
            let load = known_load(signals, k);
            kept.mechanical_rhs(&seeded, &base, &[env.omega_e * (1.0 / n_p)], tau, Dual::constant(load), &env)
                [0]
                * base.j
        };
        let mut sum = Dual::<LANES>::zero();
        let mut last = acceleration(first);
        for k in rows.clone() {
            if k > first {
                let now = acceleration(k);
                sum += (last + now) * (0.5 * (signals.t[k] - signals.t[k - 1]));
                last = now;
            }
            let row = (k - first) / block;
            let weight = 1.0 / (block.min(n - row * block)) as f64;
            if (k - first) % block == 0 {
                t.push(0.0);
                let last = (k + block).min(rows.end) - 1;
                half.push(0.5 * (signals.t[last] - signals.t[k]));
            }
            t[row] += (signals.t[k] - signals.t[first]) * weight;
            let rest = sum - base.j * ((signals.omega_e[k] - signals.omega_e[first]) / n_p);
            y[row] += rest.re * weight;
            for slot in 0..seeds.len() {
                columns[(row, 2 + slot)] += rest.eps[slot] * weight;
            }
            for (at, _) in behind_gaps.iter().enumerate().filter(|(_, behind)| k >= **behind) {
                columns[(row, 2 + seeds.len() + at)] += weight;
            }
        }
        for row in 0..count {
            columns[(row, 0)] = 1.0;
            columns[(row, 1)] = t[row];
        }
        for slot in model.slots() {
            let f = slot.effect.ringing(&p[slot.parameters.clone()]);
            if f > 0.0 {
                let step = (t[count - 1] - t[0]) / (count - 1) as f64;
                let half = (0.5 / (f * step)).round() as usize;
                smooth(y.as_mut_slice(), half);
                columns.column_iter_mut().for_each(|mut column| smooth(column.as_mut_slice(), half));
            }
        }
        Self::of(t, half, y, &columns)
    }

    /// Of points at the times `t`, averages over `half` to either side.
    pub fn of(t: Vec<f64>, half: Vec<f64>, mut y: DVector<f64>, columns: &DMatrix<f64>) -> Self {
        let basis = basis::orthonormal(columns);
        y -= &basis * basis.tr_mul(&y);
        let known = Behind::new(&t, &basis);
        let reach = half.iter().copied().fold(0.0, f64::max);
        Self { t, half, reach, y, basis, known }
    }

    /// All points of the hinge of a step at the time `step`.
    pub fn hinge(&self, step: f64) -> DVector<f64> {
        DVector::from_fn(self.t.len(), |row, _| self.hinge_at(row, step))
    }

    /// The same in one point.
    pub fn hinge_at(&self, row: usize, step: f64) -> f64 {
        let (behind, half) = (self.t[row] - step, self.half[row]);
        if behind.abs() < half { (behind + half).powi(2) / (4.0 * half) } else { behind.max(0.0) }
    }

    /// The product of each of some columns with that hinge.
    pub fn along(&self, columns: &Behind, step: f64) -> DVector<f64> {
        columns.along(self.corner(step), step, |row| self.hinge_at(row, step))
    }

    /// The points that may be averages over the time `step`: the hinge is zero before them, and its straight part behind them.
    pub fn corner(&self, step: f64) -> Range<usize> {
        self.t.partition_point(|t| *t <= step - self.reach)
            ..self.t.partition_point(|t| *t < step + self.reach)
    }
}

/// Takes a ringing out by averaging over its period, twice `half` points; a hinge stays a hinge but for its corner.
fn smooth(x: &mut [f64], half: usize) {
    let n = x.len();
    if half == 0 || 4 * half > n {
        return;
    }
    let mut sums = vec![0.0; n + 1];
    for k in 0..n {
        sums[k + 1] = sums[k] + x[k];
    }
    for (k, x) in x.iter_mut().enumerate() {
        // Symmetric everywhere, so that a straight line stays one at the ends.
        let reach = half.min(k).min(n - 1 - k);
        *x = (sums[k + reach + 1] - sums[k - reach]) / (2 * reach + 1) as f64;
    }
}

/// The load as far as it is known, N·m.
fn known_load(signals: &Signals, k: usize) -> f64 {
    match signals.load {
        crate::recording::Load::KnownConstant(value) => value,
        crate::recording::Load::Measured => signals.tau_m.as_ref().map_or(0.0, |tau| tau[k]),
        _ => 0.0,
    }
}

/// The parameters of `kept` out of those of `model`, and where each of the latter went.
fn restrict(model: &Model, kept: &Model, p: &[f64]) -> (Vec<f64>, Vec<Option<usize>>) {
    let mut values = p[..crate::base::BASE].to_vec();
    let mut places: Vec<Option<usize>> = (0..crate::base::BASE).map(Some).collect();
    for slot in model.slots() {
        let stays = kept.slots().iter().any(|s| s.effect == slot.effect);
        let mechanical = slot.effect.info().site == Site::Mechanical;
        for k in slot.parameters.clone() {
            if stays {
                places.push(mechanical.then_some(values.len()));
                values.push(p[k]);
            } else {
                places.push(None);
            }
        }
    }
    for k in model.map_parameters() {
        places.push(Some(values.len()));
        values.push(p[k]);
    }
    (values, places)
}
