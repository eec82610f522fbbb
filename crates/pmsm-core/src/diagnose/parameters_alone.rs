//! Steady points that show parameters of the machine and nothing of what its model leaves out: the answer holds the parameters, and says so.

use super::answer::{Answer, Estimate};
use super::options::DiagnosisOptions;
use crate::machine::{BaseParameter, Machine};
use crate::recording::Kind;
use crate::signals::Finding;

/// Normal quantile of a 95 % interval.
const Z95: f64 = 1.959_964;
/// Standard errors beyond which a value and the nameplate's differ.
const DIFFERS: f64 = 3.0;

/// A base parameter with its standard error, in its unit.
pub type Shown = (BaseParameter, f64, f64);

/// The answer that names no effect, for the reason `why`, and holds what was `shown` of the machine.
pub fn answer(
    (why, kind): (Finding, Kind),
    shown: &[Shown],
    machine: &Machine,
    findings: Vec<Finding>,
    options: &DiagnosisOptions,
) -> Answer {
    let mut answer = Answer { recording_kind: Some(kind), options: *options, ..Answer::undetermined(why) };
    for &(parameter, value, error) in shown {
        let certain = error.is_finite() && error > 0.0;
        let estimate = Estimate {
            value: Some(value),
            stderr: certain.then_some(error),
            ci95: certain.then_some([value - Z95 * error, value + Z95 * error]),
            unit: parameter.unit().into(),
            why_none: (!certain).then(|| "it was taken from the nameplate".into()),
        };
        answer.model.base.insert(parameter.name().into(), estimate);
        answer.data_quality.extend(against_nameplate(machine, (parameter, value, error), options));
    }
    answer.data_quality.extend(findings);
    answer
}

/// A finding where a value lies farther from that on the nameplate than a nameplate is off.
fn against_nameplate(
    machine: &Machine,
    (parameter, value, error): Shown,
    options: &DiagnosisOptions,
) -> Option<Finding> {
    let stated = machine.get(parameter).filter(|stated| *stated > 0.0 && parameter != BaseParameter::B)?;
    let far =
        (value / stated).ln().abs() > options.nameplate_spread && (value - stated).abs() > DIFFERS * error;
    (value <= 0.0 || far).then(|| Finding {
        finding: format!(
            "{} is {value:.3e} {} by these points, the nameplate states {stated:.3e}",
            parameter.name(),
            parameter.unit()
        ),
        consequence: "one of the two is not that of this machine, or not in this state".into(),
        fix: "check the nameplate, n_p, and units and scale of the columns".into(),
    })
}
