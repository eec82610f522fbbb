//! The best point of a search: by the swarm, by least squares from where the swarm ended, or by least squares alone.

use super::Request;
use super::plan::Plan;
use super::search::{self, Descent};
use crate::error::{Error, Result};
use crate::experiment::Linearisation;
use crate::kernels::objective::{Objective, Starts};
use crate::monitor::Monitor;
use crate::optimise::least_squares::{Settings, Status};

/// The best point of a search and how it was reached.
pub struct Found {
    /// One value per fitted parameter.
    pub values: Vec<f64>,
    /// The fitness there.
    pub cost: f64,
    /// Best cost after each generation of the swarm, then after each step of least squares.
    pub history: Vec<f64>,
    /// Number of evaluations of the fitness.
    pub evaluations: usize,
    /// Whether the search came to rest.
    pub converged: bool,
    /// Whether the monitor stopped it.
    pub interrupted: bool,
    /// The initial values that least squares found along with them.
    pub starts: Option<Starts>,
    /// Residual and derivatives there.
    pub linear: Option<Linearisation>,
}

impl From<Descent> for Found {
    fn from(descent: Descent) -> Self {
        let Descent { fit, starts, linear, history, evaluations } = descent;
        Self {
            values: fit.parameters,
            cost: fit.cost,
            history,
            evaluations,
            converged: fit.status == Status::Converged,
            interrupted: fit.status == Status::Interrupted,
            starts,
            linear,
        }
    }
}

/// The swarm; `warm` puts a particle on the starting point of the plan.
///
/// # Errors
/// Those of [`search::swarm`]; [`Error::Unusable`] if the model cannot be simulated at all.
pub fn by_swarm(
    objective: &Objective,
    plan: &Plan,
    request: &Request,
    warm: bool,
    monitor: &dyn Monitor,
) -> Result<Found> {
    let result = search::swarm(objective, plan, &request.swarm, request.seed, warm, monitor)?;
    let mut found = Found {
        converged: result.settled(),
        values: result.parameters,
        cost: result.cost,
        history: result.history,
        evaluations: result.evaluations,
        interrupted: result.interrupted,
        starts: None,
        linear: None,
    };
    if !found.cost.is_finite() {
        // No particle could be simulated, or none was: the nameplate is the best there is.
        found.values = plan.first();
        found.cost = objective.fitness(&plan.start, f64::INFINITY);
        found.evaluations += 1;
        found.converged = false;
        if found.cost.is_infinite() {
            return Err(Error::unusable(
                "the model cannot be simulated anywhere within the bounds",
                "check the nameplate and the units of the recording, or give narrower bounds",
            ));
        }
    }
    Ok(found)
}

/// Least squares from the best point of a swarm, unless that was interrupted.
///
/// # Errors
/// Those of [`search::descend`].
pub fn refined(
    objective: &Objective,
    plan: &Plan,
    first: Found,
    settings: &Settings,
    monitor: &dyn Monitor,
) -> Result<Found> {
    if first.interrupted {
        return Ok(first);
    }
    let second = Found::from(search::descend(objective, plan, &first.values, settings, monitor)?);
    let evaluations = first.evaluations + second.evaluations;
    if !second.cost.is_finite() {
        return Ok(Found { evaluations, ..first });
    }
    let history = first.history.into_iter().chain(second.history).collect();
    Ok(Found { evaluations, history, ..second })
}

/// Least squares from the first start; where that does not converge within the bounds, from the other as well.
///
/// # Errors
/// Those of [`search::descend`]; [`Error::Unusable`] if the model can be simulated from neither.
pub fn from_starts(
    objective: &Objective,
    plan: &Plan,
    starts: [&dyn Fn() -> Vec<f64>; 2],
    settings: &Settings,
    monitor: &dyn Monitor,
) -> Result<Found> {
    let mut best: Option<Found> = None;
    for start in starts {
        let descent = search::descend(objective, plan, &start(), settings, monitor)?;
        let inside = !descent.fit.at_bound.contains(&true);
        let found = Found::from(descent);
        let done = (found.converged && inside) || found.interrupted;
        best = Some(match best {
            Some(before) => better(before, found),
            None => found,
        });
        if done {
            break;
        }
    }
    best.filter(|b| b.cost.is_finite()).ok_or_else(|| {
        Error::unusable(
            "the model can be simulated from no starting point: regression, nameplate or the stretch before",
            "check the nameplate and the units of the recording, or use method pso+lm",
        )
    })
}

/// The better of two descents, with the evaluations of both. It has not come to rest if the second one was stopped.
fn better(before: Found, after: Found) -> Found {
    let evaluations = before.evaluations + after.evaluations;
    let interrupted = after.interrupted;
    // Also true where the first one led nowhere.
    let lower = after.cost < before.cost || before.cost.is_nan();
    let kept = if lower { after } else { before };
    Found { evaluations, interrupted, converged: kept.converged && !interrupted, ..kept }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(cost: f64, converged: bool) -> Found {
        Found {
            values: vec![cost],
            cost,
            history: Vec::new(),
            evaluations: 3,
            converged,
            interrupted: !converged,
            starts: None,
            linear: None,
        }
    }

    #[test]
    fn the_lower_of_two_descents_is_kept_with_the_evaluations_of_both() {
        for (first, second, kept) in
            [(2.0, 1.0, 1.0), (1.0, 2.0, 1.0), (f64::NAN, 2.0, 2.0), (1.0, f64::NAN, 1.0)]
        {
            let best = better(found(first, true), found(second, true));
            assert_eq!((best.values, best.evaluations), (vec![kept], 6), "{first} {second}");
            assert!(best.converged && !best.interrupted);
        }
    }

    #[test]
    fn what_is_stopped_before_the_second_descent_ends_has_not_come_to_rest() {
        let best = better(found(1.0, true), found(2.0, false));
        assert_eq!((best.cost, best.converged, best.interrupted), (1.0, false, true));
    }
}
