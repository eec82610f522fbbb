//! Steady points that show parameters of the machine and nothing of what its model leaves out: the answer holds the parameters, and says so.

use super::answer::{Answer, Estimate, Z95};
use super::nameplate;
use super::options::DiagnosisOptions;
use crate::machine::{BaseParameter, Machine};
use crate::recording::Kind;
use crate::signals::Finding;

/// A base parameter with its standard error, in its unit.
pub type Shown = (BaseParameter, f64, f64);

/// Most outliers that a sentence names.
const NAMED: usize = 6;

/// That the other points contradict some, each told by its number and `what` else; `None` where there are none.
pub fn contradicted(told: &[String], what: &str, consequence: &str, fix: &str) -> Option<Finding> {
    let count = told.len();
    let named = told[..count.min(NAMED)].join(", ");
    let more = if count > NAMED { format!(" and {} more", count - NAMED) } else { String::new() };
    (count > 0).then(|| Finding {
        finding: format!(
            "the other points contradict {count} of them, by their number and {what}: {named}{more}"
        ),
        consequence: consequence.into(),
        fix: fix.into(),
    })
}

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
        answer.data_quality.extend(nameplate::contradicts_value(machine, (parameter, value, error), options));
    }
    answer.data_quality.extend(findings);
    answer
}
