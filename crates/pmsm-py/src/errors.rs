//! Errors of the core as Python exceptions, in this one place.

use pmsm_core::error::Error;
use pyo3::exceptions::{PyException, PyKeyboardInterrupt};
use pyo3::prelude::*;

pyo3::create_exception!(pmsm_rs._core, PmsmError, PyException, "Whatever this package refuses or fails at.");
pyo3::create_exception!(
    pmsm_rs._core,
    DataError,
    PmsmError,
    "A recording that cannot be used; attributes row, column, problem and fix where they apply."
);
pyo3::create_exception!(
    pmsm_rs._core,
    MachineError,
    PmsmError,
    "A nameplate or machine file that makes no sense."
);
pyo3::create_exception!(
    pmsm_rs._core,
    UsageError,
    PmsmError,
    "A call that asks for something that does not exist."
);
pyo3::create_exception!(
    pmsm_rs._core,
    NotIdentifiableError,
    PmsmError,
    "The recording does not determine what is asked for."
);
pyo3::create_exception!(pmsm_rs._core, InternalError, PmsmError, "A fault of this package, not of the data.");

/// The Python exception for what a user gave as an effect: a `UsageError` with the attributes problem and fix, and for a fault in a formula
/// term and position.
pub fn to_usage(py: Python<'_>, error: &Error) -> PyErr {
    let raised = UsageError::new_err(error.to_string());
    let facts = raised.value(py);
    let set = match error {
        Error::Formula { term, position, problem, fix, .. } => facts
            .setattr("term", term)
            .and_then(|()| facts.setattr("position", *position))
            .and_then(|()| facts.setattr("problem", problem))
            .and_then(|()| facts.setattr("fix", fix)),
        Error::Unusable { problem, fix } => {
            facts.setattr("problem", problem).and_then(|()| facts.setattr("fix", fix))
        }
        _ => Ok(()),
    };
    match set {
        Ok(()) => raised,
        Err(other) => other,
    }
}

/// The Python exception for an error of the core. What cannot be done with a recording is a matter of what the
/// recording determines, unless it is about columns or names.
pub fn to_python(py: Python<'_>, error: &Error) -> PyErr {
    let text = error.to_string();
    if let Error::InRecording { number, source } = error {
        // The refusal of one recording, with its number.
        let raised = to_python(py, source);
        let value = raised.value(py);
        return match value.setattr("args", (text,)).and_then(|()| value.setattr("recording", *number)) {
            Ok(()) => raised,
            Err(other) => other,
        };
    }
    if let Error::InValidation { source } = error {
        let raised = to_python(py, source);
        let value = raised.value(py);
        return match value.setattr("args", (text,)).and_then(|()| value.setattr("recording", "validation")) {
            Ok(()) => raised,
            Err(other) => other,
        };
    }
    let (raised, row, column, problem, fix) = match error {
        Error::Quantity { .. } => return MachineError::new_err(text),
        Error::Unknown { kind, .. } if *kind == "column" || *kind == "load" => {
            return DataError::new_err(text);
        }
        Error::Unknown { .. } => return UsageError::new_err(text),
        Error::Formula { .. } => return to_usage(py, error),
        Error::Interrupted => return PyKeyboardInterrupt::new_err(text),
        Error::Sample { column, row, problem, fix } => {
            (DataError::new_err(text), Some(*row), Some(column), problem, fix)
        }
        Error::Column { column, problem, fix } => {
            (DataError::new_err(text), None, Some(column), problem, fix)
        }
        Error::Unusable { problem, fix } => (NotIdentifiableError::new_err(text), None, None, problem, fix),
        _ => return InternalError::new_err(text),
    };
    let facts = raised.value(py);
    let set = facts
        .setattr("row", row)
        .and_then(|()| facts.setattr("column", column))
        .and_then(|()| facts.setattr("problem", problem))
        .and_then(|()| facts.setattr("fix", fix));
    match set {
        Ok(()) => raised,
        Err(other) => other,
    }
}
