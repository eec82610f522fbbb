//! Identification of one stretch of a longer run, from the result of the stretch before.

use super::found::{Found, by_swarm, from_starts, refined};
use super::plan::Plan;
use super::{Identification, Method, Request, Target, answer, search};
use crate::error::Result;
use crate::kernels::objective::{Drive, Objective};
use crate::machine::Machine;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::signals::Signals;
use crate::start;

/// Where an identification goes on from: the last result on another stretch of the same run.
#[derive(Debug, Clone, Copy)]
pub struct Warm<'a> {
    /// First values in place of the nameplate's.
    pub values: &'a [(Target, f64)],
    /// The swarm seeks within this share of each value to either side (of the smallest change that matters, where the
    /// value is near zero), and beyond it only if its best point lies on the edge.
    pub share: f64,
}

/// As [`super::identify`] on one stretch of a longer run, from the result of the last stretch. The swarm has a particle on
/// that result, or on what a regression tells where neither it nor bounds are known: a few particles find little in a wide range. Its
/// free run starts from the measured values freed of most of their noise (see [`start::settle`]). True beside the answer if the
/// swarm had to look farther than `warm` says.
///
/// # Errors
/// Those of [`super::identify`].
pub fn identify_warm(
    mut signals: Signals,
    machine: &Machine,
    request: &Request,
    warm: Warm,
    monitor: &dyn Monitor,
) -> Result<(Identification, bool)> {
    let mut wide = Plan::new(&mut signals, machine, &request.fit)?;
    wide.begin(warm.values);
    let windows = wide.drive.windows(&signals);
    let model = Model::new(signals.context, &[]);
    if wide.drive == Drive::Coupled && request.method != Method::LeastSquares {
        start::settle(&mut signals, &model, &wide.start);
    }
    let objective = Objective::new(wide.drive, &model, &signals, &windows);
    let mut widened = false;
    let found = if request.method == Method::LeastSquares {
        let starts = [&|| wide.first(), &|| wide.regressed(&signals)] as [&dyn Fn() -> Vec<f64>; 2];
        from_starts(&objective, &wide, starts, &search::WARM, monitor)?
    } else {
        wide.begin_unknown(warm, &request.fit, &signals, |point| objective.fitness(point, f64::INFINITY));
        let narrow = wide.narrowed(warm, &signals);
        let mut first = by_swarm(&objective, &narrow, request, true, monitor)?;
        widened = !first.interrupted && narrow.on_edge(&first.values, &wide);
        if widened {
            let values: Vec<_> = wide.targets.iter().copied().zip(first.values.iter().copied()).collect();
            wide.begin(&values);
            let again = by_swarm(&objective, &wide, request, true, monitor)?;
            first.evaluations += again.evaluations;
            first.history.extend(&again.history);
            first = Found { evaluations: first.evaluations, history: first.history, ..again };
        }
        match request.method {
            Method::Both => refined(&objective, &wide, first, &search::WARM, monitor)?,
            _ => first,
        }
    };
    let answer = answer::assemble(&objective, &wide, &signals, machine, request, found)?;
    Ok((answer, widened))
}
