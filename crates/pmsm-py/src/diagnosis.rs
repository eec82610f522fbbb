//! The diagnosis for Python.

use crate::errors::{InternalError, UsageError};
use crate::machine::PyMachine;
use crate::recording::PyRecording;
use crate::supervise;
use numpy::PyArray1;
use pmsm_core::diagnose as core;
use pmsm_core::recording::Recording;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::json;
use std::sync::Arc;

/// Diagnoses recordings of one machine: the answer as JSON text, and the traces of the recordings, end to end,
/// and of the validation run as dicts of arrays of shape (samples,). `options` are the core's `DiagnosisOptions` as JSON text.
#[pyfunction]
#[pyo3(signature = (recordings, machine, validation, *, options, seed, threads, progress))]
pub fn diagnose<'py>(
    py: Python<'py>,
    recordings: Vec<PyRef<'py, PyRecording>>,
    machine: PyRef<'py, PyMachine>,
    validation: Option<PyRef<'py, PyRecording>>,
    options: &str,
    seed: u64,
    threads: Option<usize>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<(String, Bound<'py, PyDict>)> {
    let runs: Vec<Arc<Recording>> = recordings.iter().map(|r| Arc::clone(&r.0)).collect();
    let other = validation.map(|r| Arc::clone(&r.0));
    let machine = machine.0.clone();
    let options = read(options)?;
    let (answer, interrupted) = supervise::run(py, threads, progress.as_ref(), |monitor| {
        let runs: Vec<&Recording> = runs.iter().map(Arc::as_ref).collect();
        core::diagnose(&runs, &machine, other.as_deref(), &options, monitor)
    })?;
    let traces = PyDict::new(py);
    for (name, columns) in
        [("recording", &answer.traces.recording), ("validation", &answer.traces.validation)]
    {
        let arrays = PyDict::new(py);
        for (column, values) in columns {
            arrays.set_item(column, PyArray1::from_slice(py, values))?;
        }
        traces.set_item(name, arrays)?;
    }
    Ok((text(&answer, seed, interrupted)?, traces))
}

/// The constants on which a verdict rests, as JSON text.
#[pyfunction]
pub fn diagnosis_options() -> PyResult<String> {
    let fault = |error: serde_json::Error| InternalError::new_err(error.to_string());
    serde_json::to_string(&core::DiagnosisOptions::default()).map_err(fault)
}

fn read(options: &str) -> PyResult<core::DiagnosisOptions> {
    let wrong = |error: String| {
        UsageError::new_err(format!("these options of the diagnosis cannot be used: {error}"))
    };
    let options: core::DiagnosisOptions = serde_json::from_str(options).map_err(|e| wrong(e.to_string()))?;
    options.check().map_err(|e| wrong(e.to_string()))?;
    Ok(options)
}

/// The answer, as JSON text, where recordings cannot be diagnosed at all: their problem and what to do about it.
#[pyfunction]
#[pyo3(signature = (problem, fix, *, seed))]
pub fn refusal(problem: String, fix: String, seed: u64) -> PyResult<String> {
    text(&core::answer::Answer::refusal(problem, fix), seed, false)
}

fn text(answer: &core::answer::Answer, seed: u64, interrupted: bool) -> PyResult<String> {
    let fault = |error: serde_json::Error| InternalError::new_err(error.to_string());
    let mut value = serde_json::to_value(answer).map_err(fault)?;
    value["interrupted"] = json!(interrupted);
    value["seed"] = json!(seed);
    value["version"] = json!(env!("CARGO_PKG_VERSION"));
    serde_json::to_string(&value).map_err(fault)
}
