//! The fit of any subset of an experiment's parameters.

use super::{Experiment, Joint, Prior};
use crate::error::{Error, Result};
use crate::monitor::Monitor;
use crate::numerics::tall;
use crate::optimise::least_squares::{self, Fit, Normal, Problem, Settings, Status};
use nalgebra::DVector;
use std::borrow::Cow;

/// Rounds of a fit after each of which the initial speeds are estimated anew.
const STARTS: usize = 3;
/// Relative change of the cost by new initial speeds that calls for another round.
const STALE: f64 = 1e-3;

impl Experiment<'_> {
    /// Physical bounds of parameter `index`, load levels included.
    pub fn bounds(&self, index: usize) -> (f64, f64) {
        if index < self.model.parameter_count() {
            self.model.bounds(index)
        } else if index < self.model.parameter_count() + self.nuisance.levels {
            let reach = 10.0 * self.model.context().tau_max;
            (-reach, reach)
        } else if index < self.model.parameter_count() + self.nuisance.levels + self.nuisance.steps() {
            (0.0, self.signals.context.duration)
        } else {
            (f64::NEG_INFINITY, f64::INFINITY)
        }
    }
}

impl Joint<'_> {
    /// Fits the parameters `free`, starting from `start` (whole vector).
    ///
    /// # Errors
    /// Those of [`least_squares::minimise`]; [`Error::Interrupted`] once the monitor says stop.
    pub fn fit(
        &self,
        start: &[f64],
        free: &[usize],
        settings: &Settings,
        monitor: &dyn Monitor,
    ) -> Result<Fitted> {
        monitor.go_on()?;
        let bounds: Vec<(f64, f64)> = free.iter().map(|k| self.bounds(*k)).collect();
        let mut start = start.to_vec();
        let counted = self.blocks().iter().map(|block| block.counted).sum();
        let mut seen = self.with_estimated_starts(&start);
        let mut round = 0;
        loop {
            let problem = Fitting { experiment: &seen, start: &start, free, counted };
            let at: Vec<f64> = free.iter().map(|k| start[*k]).collect();
            let fit = least_squares::minimise(&problem, &at, &bounds, settings, monitor)?;
            if fit.status == Status::Interrupted {
                return Err(Error::Interrupted);
            }
            let parameters = problem.whole(&fit.parameters);
            let free = free.to_vec();
            round += 1;
            if !seen.has_starts() || round == STARTS {
                return Ok(Fitted { parameters, free, fit, left: None });
            }
            monitor.go_on()?;
            // Initial speeds that were estimated at the start may be too far off for the solution.
            let again = self.with_estimated_starts(&parameters);
            let left = again.residual(&parameters);
            let cost = left.norm_squared() + problem.surprise(&parameters);
            let stale = (cost - fit.cost).abs() > STALE * fit.cost;
            if !stale {
                return Ok(Fitted { parameters, free, fit, left: Some(left) });
            }
            (start, seen) = (parameters, again);
        }
    }
}

/// A fitted parameter vector.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The whole parameter vector.
    pub parameters: Vec<f64>,
    /// Which of its entries were fitted.
    pub free: Vec<usize>,
    /// How the fit ended.
    pub fit: Fit,
    /// The residual that is left, where the fit has looked at it.
    left: Option<DVector<f64>>,
}

impl Fitted {
    /// Weighted residual that is left of the `experiment` that was fitted.
    pub fn residual(&self, experiment: &Joint) -> Cow<'_, DVector<f64>> {
        match &self.left {
            Some(left) => Cow::Borrowed(left),
            None => Cow::Owned(experiment.residual(&self.parameters)),
        }
    }
}

struct Fitting<'a> {
    experiment: &'a Joint<'a>,
    start: &'a [f64],
    free: &'a [usize],
    counted: usize,
}

impl Fitting<'_> {
    /// Prior knowledge of the free parameters, each with its position among them.
    fn known(&self) -> impl Iterator<Item = (usize, &Prior)> + '_ {
        let place = |index: usize| self.free.iter().position(|f| *f == index);
        self.experiment.prior().iter().filter_map(move |prior| Some((place(prior.index)?, prior)))
    }

    /// How far the parameters are from what was known of them, as a sum of squares.
    fn surprise(&self, whole: &[f64]) -> f64 {
        self.known().map(|(k, prior)| prior.off(whole[self.free[k]]).0.powi(2)).sum()
    }

    fn whole(&self, point: &[f64]) -> Vec<f64> {
        let mut p = self.start.to_vec();
        for (index, value) in self.free.iter().zip(point) {
            p[*index] = *value;
        }
        p
    }
}

impl Problem for Fitting<'_> {
    fn dim(&self) -> usize {
        self.free.len()
    }

    fn residuals(&self) -> Option<usize> {
        Some(self.counted)
    }

    fn cost(&self, point: &[f64]) -> f64 {
        let whole = self.whole(point);
        self.experiment.residual(&whole).norm_squared() + self.surprise(&whole)
    }

    fn normal(&self, point: &[f64]) -> Normal {
        let whole = self.whole(point);
        let linear = self.experiment.linearise(&whole, self.free);
        let mut normal = Normal {
            cost: linear.residual.norm_squared(),
            jtj: tall::gram(&linear.jacobian),
            jtr: tall::tr_mul_vector(&linear.jacobian, &linear.residual),
        };
        for (k, prior) in self.known() {
            let (off, slope) = prior.off(whole[self.free[k]]);
            normal.cost += off * off;
            normal.jtj[(k, k)] += slope * slope;
            normal.jtr[k] += off * slope;
        }
        normal
    }

    /// One run with derivatives costs less than one without and one with.
    fn trial(&self, point: &[f64], first: bool) -> (f64, Option<Normal>) {
        if !first {
            return (self.cost(point), None);
        }
        let normal = self.normal(point);
        (normal.cost, Some(normal))
    }
}
