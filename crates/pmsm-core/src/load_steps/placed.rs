//! Steps with their place, and what others would explain in their stead.

use super::behind::Behind;
use super::grid::Grid;
use crate::monitor::Monitor;
use crate::noise::colour::effective_samples;
use crate::numerics::basis::{self, DEPENDENT};
use nalgebra::{DMatrix, DVector};

/// Instants tried in the first scan.
const SCAN: usize = 240;

/// Steps closer than this many times the closest distance may be two halves of one between them, too close for either to reach it.
const HALVES: f64 = 3.0;
/// Instants tried in its stead.
const BETWEEN: usize = 60;

/// Least-squares fit of y(t) by the columns of a grid and the hinges of some steps.
#[derive(Clone)]
pub struct Placed<'a> {
    grid: &'a Grid,
    /// Closest distance of two steps, s.
    closest: f64,
    /// Times of the steps from the grid's first sample, s.
    pub steps: Vec<f64>,
    /// Orthonormal basis of what the hinges add to the grid's columns.
    own: DMatrix<f64>,
    /// y(t) in that basis, and what is left of it.
    inside: DVector<f64>,
    residual: DVector<f64>,
    /// Products of the basis and of what is left with hinges.
    along: Behind,
    left: Behind,
    /// The hinge of each step in that basis.
    hinges: DMatrix<f64>,
}

impl<'a> Placed<'a> {
    /// No step yet.
    pub fn none(grid: &'a Grid, closest: f64) -> Self {
        let own = DMatrix::zeros(grid.t.len(), 0);
        let [along, left] = [&own, &own].map(|x| Behind::new(&grid.t, x));
        let (inside, residual, hinges) = (DVector::zeros(0), grid.y.clone(), DMatrix::zeros(0, 0));
        let mut placed =
            Self { grid, closest, steps: Vec::new(), own, inside, residual, along, left, hinges };
        placed.fit();
        placed
    }

    /// Fits by the basis as it is now.
    fn fit(&mut self) {
        let grid = self.grid;
        self.inside = self.own.tr_mul(&grid.y);
        self.residual = &grid.y - &self.own * &self.inside;
        self.along = Behind::new(&grid.t, &self.own);
        self.left = Behind::new(&grid.t, &DMatrix::from_columns(&[self.residual.column(0)]));
        self.hinges = DMatrix::zeros(self.own.ncols(), self.steps.len());
        for (k, step) in self.steps.iter().enumerate() {
            self.hinges.set_column(k, &grid.along(&self.along, *step));
        }
    }

    /// Adds a step where one explains most; not, if there is no room for one.
    pub fn add(&mut self) -> bool {
        let (start, end) = (self.grid.t[0], self.grid.t[self.grid.t.len() - 1]);
        let tried = (1..SCAN).map(|k| start + (end - start) * k as f64 / SCAN as f64);
        let Some(step) = self.best_of(tried, &self.steps, None) else { return false };
        self.insert(self.steps.len(), step);
        self.fit();
        true
    }

    /// Moves each step to where it explains most, in ever finer strides, given in units of the first scan's.
    pub fn move_each(&mut self, strides: &[f64], monitor: &dyn Monitor) {
        let end = self.grid.t[self.grid.t.len() - 1];
        for stride in strides.iter().map(|s| s / SCAN as f64 * end) {
            for at in (0..self.steps.len()).take_while(|_| !monitor.cancelled()) {
                let mut others = self.steps.clone();
                let here = others.remove(at);
                let alone = self.alone(at);
                let tried = (-4..=4).map(|k| here + f64::from(k) * stride);
                match self.best_of(tried, &others, alone.as_ref()) {
                    Some(best) if best != here => {
                        self.remove(at, alone.as_ref());
                        self.insert(at, best);
                        self.fit();
                    }
                    _ => {}
                }
            }
        }
        self.steps.sort_by(f64::total_cmp);
        self.fit();
    }

    /// Takes away the step that is worth least if that is less than `least`: by n_eff·ln(square without it / square with it), n_eff from the
    /// colour of what is left.
    pub fn prune(&mut self, least: f64) -> bool {
        let (square, colour) = (self.residual.norm_squared(), effective_samples(self.residual.as_slice()));
        let worth = |at: usize| {
            let more = self.alone(at).map_or(0.0, |alone| alone.dot(&self.inside).powi(2));
            if square > 0.0 { colour * (1.0 + more / square).ln() } else { 0.0 }
        };
        let worths = (0..self.steps.len()).map(|at| (at, worth(at)));
        match worths.min_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((at, worth)) if worth < least => {
                let alone = self.alone(at);
                self.remove(at, alone.as_ref());
                self.fit();
                true
            }
            _ => false,
        }
    }

    /// Puts one step in the place of two that stand close to each other if that costs less than `least`.
    pub fn merge(&mut self, least: f64) -> bool {
        let (square, colour) = (self.residual.norm_squared(), effective_samples(self.residual.as_slice()));
        for at in 1..self.steps.len() {
            let [one, other] = [self.steps[at - 1], self.steps[at]];
            if other - one > HALVES * self.closest {
                continue;
            }
            let mut merged = self.clone();
            for at in [at, at - 1] {
                let alone = merged.alone(at);
                merged.remove(at, alone.as_ref());
                merged.fit();
            }
            let tried = (0..=BETWEEN).map(|k| one + (other - one) * k as f64 / BETWEEN as f64);
            let Some(best) = merged.best_of(tried, &merged.steps, None) else { continue };
            merged.insert(at - 1, best);
            merged.fit();
            if colour * (merged.residual.norm_squared() / square).ln() < least {
                *self = merged;
                return true;
            }
        }
        false
    }

    /// The direction of the basis in which a step's hinge stands alone, all others being orthogonal to it; `None` where they do all it does.
    fn alone(&self, at: usize) -> Option<DVector<f64>> {
        let others = basis::orthonormal(&self.hinges.clone().remove_column(at));
        let hinge = DMatrix::from_columns(&[self.hinges.column(at)]);
        let alone = basis::freed(&others, &hinge).column(0).into_owned();
        let rest = alone.norm();
        (rest > DEPENDENT.powi(2) * hinge.norm()).then(|| alone / rest)
    }

    /// Takes a step out of the basis, turned until the direction in which it stands alone is the last.
    fn remove(&mut self, at: usize, alone: Option<&DVector<f64>>) {
        self.steps.remove(at);
        let Some(alone) = alone else { return };
        let last = alone.len() - 1;
        // Householder's reflection of that direction onto the last.
        let mut v = alone.clone();
        v[last] += 1f64.copysign(v[last]);
        let along = &self.own * &v;
        self.own.ger(-2.0 / v.norm_squared(), &along, &v, 1.0);
        self.own = std::mem::replace(&mut self.own, DMatrix::zeros(0, 0)).remove_column(last);
    }

    /// Puts a step into the basis, as the one of number `at`.
    fn insert(&mut self, at: usize, step: f64) {
        self.steps.insert(at, step);
        let hinge = DMatrix::from_columns(&[self.grid.hinge(step)]);
        let mut free = hinge.clone();
        for known in [&self.grid.basis, &self.own, &self.grid.basis, &self.own] {
            let along = known.tr_mul(&free);
            free.gemm(-1.0, known, &along, 1.0);
        }
        let rest = free.norm();
        if rest > DEPENDENT * hinge.norm() {
            let count = self.own.ncols();
            self.own = std::mem::replace(&mut self.own, DMatrix::zeros(0, 0)).insert_column(count, 0.0);
            self.own.set_column(count, &(free.column(0) / rest));
        }
    }

    /// The instant out of `tried` at which one more step would explain most, far enough from `others` and from both ends; without the
    /// direction `alone` of the basis.
    fn best_of(
        &self,
        tried: impl Iterator<Item = f64>,
        others: &[f64],
        alone: Option<&DVector<f64>>,
    ) -> Option<f64> {
        let grid = self.grid;
        let (start, end) = (grid.t[0] + self.closest, grid.t[grid.t.len() - 1] - self.closest);
        let apart = |s: &f64| others.iter().all(|o| (o - s).abs() > self.closest);
        let tried = tried.filter(|s| *s > start && *s < end && apart(s));
        let gains = tried.map(|s| (s, self.gain(s, alone)));
        gains.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(s, _)| s)
    }

    /// By how much one more step lowers the square of what is left, once the direction `alone` has been given up.
    fn gain(&self, step: f64, alone: Option<&DVector<f64>>) -> f64 {
        let grid = self.grid;
        let length =
            (grid.corner(step).start..grid.t.len()).map(|row| grid.hinge_at(row, step).powi(2)).sum::<f64>();
        let along = grid.along(&self.along, step);
        let mut square = length - grid.along(&grid.known, step).norm_squared() - along.norm_squared();
        let mut product = grid.along(&self.left, step)[0];
        if let Some(alone) = alone {
            let back = alone.dot(&along);
            square += back * back;
            product += alone.dot(&self.inside) * back;
        }
        if square > DEPENDENT.powi(2) * length { product * product / square } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::monitor::Silent;
    use crate::numerics::random::normal_pair;

    const CLOSEST: f64 = 0.01;

    /// Points of 5 ms under noise, with hinges of `steps`, a gap after the hundredth, and a straight line that is anybody's.
    fn grid(steps: &[(f64, f64)]) -> Grid {
        let t: Vec<f64> = (0..400).map(|k| 5e-3 * f64::from(k) + if k > 100 { 0.04 } else { 0.0 }).collect();
        let columns = DMatrix::from_fn(400, 2, |row, c| if c == 0 { 1.0 } else { t[row] });
        let bare = Grid::of(t.clone(), vec![2.5e-3; 400], DVector::zeros(400), &columns);
        let mut y = DVector::from_fn(400, |k, _| 3.0 - t[k] + 2e-4 * normal_pair(5, [k as u32, 0, 0, 0]).0);
        for (step, height) in steps {
            y.axpy(*height, &bare.hinge(*step), 1.0);
        }
        Grid::of(t, vec![2.5e-3; 400], y, &columns)
    }

    /// What is left by a fit from nothing.
    fn left(grid: &Grid, steps: &[f64]) -> DVector<f64> {
        let hinges: Vec<_> = steps.iter().map(|s| grid.hinge(*s)).collect();
        let own = basis::orthonormal_beside(&grid.basis, &DMatrix::from_columns(&hinges));
        &grid.y - &own * own.tr_mul(&grid.y)
    }

    #[test]
    fn steps_that_came_moved_and_went_leave_what_a_fresh_fit_of_the_rest_leaves() {
        let grid = grid(&[(0.3, 1.0), (0.9, -2.0), (1.5, 0.7)]);
        let mut placed = Placed::none(&grid, CLOSEST);
        for _ in 0..8 {
            assert!(placed.add());
            placed.move_each(&[0.5, 0.1], &Silent);
            assert!((&placed.residual - left(&grid, &placed.steps)).norm() < 1e-9 * grid.y.norm());
        }
        while placed.merge(30.0) || placed.prune(30.0) {
            placed.move_each(&[0.1, 0.01], &Silent);
            assert!((&placed.residual - left(&grid, &placed.steps)).norm() < 1e-9 * grid.y.norm());
        }
        let found = &placed.steps;
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found.iter().zip([0.3, 0.9, 1.5]).all(|(f, s)| (f - s).abs() < 1e-3), "{found:?}");
    }

    #[test]
    fn a_gain_is_what_a_step_takes_from_the_square_of_what_is_left() {
        let grid = grid(&[(0.3, 1.0), (0.9, -2.0)]);
        let mut placed = Placed::none(&grid, CLOSEST);
        let square = |steps: &[f64]| left(&grid, steps).norm_squared();
        for (at, step) in [0.31, 0.7, 1.2].into_iter().enumerate() {
            placed.insert(at, step);
        }
        placed.fit();
        for step in [0.1, 0.52, 0.9003, 1.9] {
            let more = square(&placed.steps) - square(&[&placed.steps[..], &[step]].concat());
            let moved = square(&[0.31, 1.2]) - square(&[0.31, step, 1.2]);
            let gains = [placed.gain(step, None), placed.gain(step, placed.alone(1).as_ref())];
            for (gain, true_gain) in gains.into_iter().zip([more, moved]) {
                assert!((gain - true_gain).abs() < 1e-7 * square(&[0.31, 1.2]), "{step}: {gain} {true_gain}");
            }
        }
    }

    #[test]
    fn two_halves_of_a_step_become_one_and_two_steps_do_not() {
        let halved = |steps: &[(f64, f64)]| {
            let grid = grid(steps);
            let mut placed = Placed::none(&grid, CLOSEST);
            for (at, step) in [0.788, 0.812].into_iter().enumerate() {
                placed.insert(at, step);
            }
            placed.fit();
            placed.merge(30.0).then(|| placed.steps.clone())
        };
        let merged = halved(&[(0.8, 1.0)]).unwrap();
        assert!(merged.len() == 1 && (merged[0] - 0.8).abs() < 5e-4, "{merged:?}");
        assert_eq!(halved(&[(0.788, 1.0), (0.812, -1.0)]), None);
    }
}
