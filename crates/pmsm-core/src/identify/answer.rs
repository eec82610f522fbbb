//! From the best point of a search to the answer: standard errors, what is not shown, and how well the model fits.

use super::found::Found;
use super::plan::{self, Plan};
use super::{Identification, Request, Target};
use crate::error::Result;
use crate::kernels::objective::Objective;
use crate::machine::{BaseParameter, Machine};
use crate::optimise::uncertainty::{self, Estimate, NotShown};
use crate::signals::Signals;

/// The answer at the best point of a search.
///
/// # Errors
/// Those of [`uncertainty::not_shown`].
pub fn assemble(
    objective: &Objective,
    plan: &Plan,
    signals: &Signals,
    machine: &Machine,
    request: &Request,
    mut found: Found,
) -> Result<Identification> {
    let point = plan.point(&found.values);
    let Told { mut parameters, rms, cannot_show } = if request.uncertainties {
        told(objective, plan, signals, &point, &mut found)?
    } else {
        let bare = |(target, value): (&Target, &f64)| {
            let why = "uncertainties were not asked for";
            (target.name(), Estimate::bare(Some(*value), target.unit(), why))
        };
        let parameters = plan.targets.iter().zip(&found.values).map(bare).collect();
        Told { parameters, rms: Vec::new(), cannot_show: plan.refused.clone() }
    };
    for refused in &plan.refused {
        for target in Target::ALL.iter().filter(|t| refused.parameters == [t.name()]) {
            if !plan.targets.contains(target) {
                parameters.push((target.name(), Estimate::bare(None, target.unit(), refused.why.clone())));
            }
        }
    }
    Ok(Identification {
        parameters,
        cost: found.cost,
        history: found.history,
        method: request.method,
        drive: plan.drive,
        evaluations: found.evaluations,
        converged: found.converged,
        interrupted: found.interrupted,
        rms,
        cannot_show,
        disturbed_load_torque: disturbed_load(plan, signals, machine, &point),
        seed: request.seed,
    })
}

/// What is told of the best point beside its values.
struct Told {
    parameters: Vec<(&'static str, Estimate)>,
    rms: Vec<(&'static str, f64)>,
    cannot_show: Vec<NotShown>,
}

fn told(
    objective: &Objective,
    plan: &Plan,
    signals: &Signals,
    point: &[f64],
    found: &mut Found,
) -> Result<Told> {
    let at = || match &found.starts {
        Some(starts) => objective.linearise(point, &plan.free(), Some(starts)),
        None => objective.linearise_nearby(point, &plan.free()),
    };
    let whole = found.linear.take().unwrap_or_else(at);
    let mut cannot_show = plan.refused.clone();
    let mut spread = uncertainty::spread(&whole.jacobian, &whole.residual, signals.len());
    if spread.is_finite() {
        let names: Vec<&str> = plan.targets.iter().map(|t| t.name()).collect();
        let sizes: Vec<f64> =
            plan.targets.iter().zip(&found.values).map(|(t, x)| plan::size(*t, *x, signals)).collect();
        cannot_show.extend(uncertainty::not_shown(&names, &sizes, &spread, plan::advice)?);
    }
    let on_bound = |k: usize| found.values[k] <= plan.bounds[k].0 || found.values[k] >= plan.bounds[k].1;
    let inside: Vec<usize> = (0..found.values.len()).filter(|k| !on_bound(*k)).collect();
    if inside.len() < found.values.len() {
        spread = uncertainty::spread(&whole.jacobian.select_columns(&inside), &whole.residual, signals.len());
    }
    let judge = uncertainty::Judge::new(spread);
    let mut parameters = Vec::new();
    for (k, target) in plan.targets.iter().enumerate() {
        let (value, unit) = (found.values[k], target.unit());
        let estimate = match inside.iter().position(|x| *x == k) {
            None => {
                let hidden = cannot_show.iter().any(|x| x.parameters == [target.name()]);
                Estimate::on_bound(value, unit, !hidden)
            }
            Some(at) => judge.estimate(at, value, unit),
        };
        parameters.push((target.name(), estimate));
    }
    let rms = objective.rms(&whole.residual).into_iter().map(|(c, x)| (c.name(), x)).collect();
    Ok(Told { parameters, rms, cannot_show })
}

/// Equation (4): T_L + ΔJ·dω_m/dt + ΔB·ω_m, mean over the recording.
fn disturbed_load(plan: &Plan, signals: &Signals, machine: &Machine, point: &[f64]) -> Option<f64> {
    if !plan.targets.contains(&Target::TauLoad) {
        return None;
    }
    let (j, b) = (machine.get(BaseParameter::J)?, machine.get(BaseParameter::B)?);
    let (mut turned, mut gained, mut time) = (0.0, 0.0, 0.0);
    for segment in &signals.segments {
        let (first, last) = (segment.start, segment.end - 1);
        gained += (signals.omega_e[last] - signals.omega_e[first]) / signals.n_p;
        time += signals.t[last] - signals.t[first];
        for k in first..last {
            let speed = 0.5 * (signals.omega_e[k] + signals.omega_e[k + 1]);
            turned += speed * (signals.t[k + 1] - signals.t[k]);
        }
    }
    turned /= signals.n_p;
    let inertia = point[BaseParameter::J.index()] - j;
    let friction = point[BaseParameter::B.index()] - b;
    (time > 0.0).then(|| point[plan::LOAD] + (inertia * gained + friction * turned) / time)
}
