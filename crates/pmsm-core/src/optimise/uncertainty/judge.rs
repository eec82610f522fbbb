//! From covariances to what is said of each estimate.

use super::{Estimate, Spread, quantile};

/// An estimate farther than this many standard errors from the minimum has no standard error.
const STOPPED_SHORT: f64 = 10.0;

/// What residuals and derivatives at the best point say of the parameters that are free there.
#[derive(Debug)]
pub struct Judge(Spread);

impl Judge {
    /// From the spread of these parameters.
    pub fn new(spread: Spread) -> Self {
        Self(spread)
    }

    /// The estimate of column `at`, whose best value is `value`.
    pub fn estimate(&self, at: usize, value: f64, unit: &'static str) -> Estimate {
        let variance = self.0.covariance[(at, at)];
        if !variance.is_finite() {
            return Estimate::bare(None, unit, "the recording does not show it");
        }
        if !self.0.settled {
            return Estimate::bare(
                Some(value),
                unit,
                "the residual swings so slowly that the recording holds only a few independent samples; record longer, or \
                 find what the model leaves out",
            );
        }
        let short = (self.0.naive.row(at) * &self.0.gradient)[0];
        if short.abs() > STOPPED_SHORT * variance.sqrt() {
            let why = "the search stopped short of the minimum; give it more iterations or use pso+lm";
            return Estimate::bare(Some(value), unit, why);
        }
        Estimate::known(value, variance.sqrt().hypot(short), quantile(self.0.blocks), unit)
    }
}

impl Estimate {
    /// A best value that lies on its bound, of which the recording says something (`shown`) or nothing.
    pub fn on_bound(value: f64, unit: &'static str, shown: bool) -> Self {
        if !shown {
            return Self::bare(None, unit, "the recording does not show it");
        }
        let why = format!(
            "the best value lies on its bound, {}; give wider bounds",
            format!("{value} {unit}").trim()
        );
        Self::bare(Some(value), unit, why)
    }
}
