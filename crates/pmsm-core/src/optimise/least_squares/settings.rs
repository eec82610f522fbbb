//! When a fit by least squares ends.

use crate::error::{Error, Result};

/// When to stop, and how carefully to begin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Most accepted or abandoned steps, at least 1.
    pub max_iterations: usize,
    /// Converged once the undamped step promises to lower the cost by no more than this share of it, ≥ 0. The promise
    /// is the squared distance to the minimum in standard errors, divided by the degrees of freedom.
    pub cost_tolerance: f64,
    /// Converged once the undamped step is no longer than this share of the parameters, both measured in the norm
    /// that weights each parameter with its column of J, ≥ 0.
    pub step_tolerance: f64,
    /// First μ, ≥ 0; 0 begins with a Gauss–Newton step.
    pub initial_damping: f64,
    /// Whether the last step is left to the caller, who takes it without an evaluation, see [`Fit::go_on`](super::Fit::go_on). Converged is then also where
    /// the step behind it would promise no more than `cost_tolerance` allows, if it falls behind it as that one fell behind the one before.
    pub leaves_rest: bool,
    /// Converged also where three steps in a row lower the cost less and less, each by no more than this share of it, ≥ 0. The share is
    /// multiplied by the mean square of the residuals where that is known and above one. A parameter that the data hardly shows would
    /// else run away.
    pub stall_tolerance: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            max_iterations: 100,
            cost_tolerance: 1e-14,
            step_tolerance: 1e-10,
            initial_damping: 1e-3,
            leaves_rest: false,
            stall_tolerance: 0.0,
        }
    }
}

impl Settings {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Quantity`] naming the first setting that is out of range.
    pub fn validate(&self) -> Result<()> {
        if self.max_iterations == 0 {
            return Err(Error::quantity("max_iterations", 0.0, "", "it must be at least 1"));
        }
        for (name, value) in [
            ("cost_tolerance", self.cost_tolerance),
            ("step_tolerance", self.step_tolerance),
            ("stall_tolerance", self.stall_tolerance),
            ("initial_damping", self.initial_damping),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(Error::quantity(name, value, "", "it must be finite and not negative"));
            }
        }
        Ok(())
    }
}
