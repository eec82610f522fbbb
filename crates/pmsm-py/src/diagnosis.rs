//! The diagnosis for Python.

use crate::errors::InternalError;
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
/// and of the validation run as dicts of arrays of shape (samples,).
#[pyfunction]
#[pyo3(signature = (recordings, machine, validation, *, seed, threads, progress))]
pub fn diagnose<'py>(
    py: Python<'py>,
    recordings: Vec<PyRef<'py, PyRecording>>,
    machine: PyRef<'py, PyMachine>,
    validation: Option<PyRef<'py, PyRecording>>,
    seed: u64,
    threads: Option<usize>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<(String, Bound<'py, PyDict>)> {
    let runs: Vec<Arc<Recording>> = recordings.iter().map(|r| Arc::clone(&r.0)).collect();
    let other = validation.map(|r| Arc::clone(&r.0));
    let machine = machine.0.clone();
    let (answer, interrupted) = supervise::run(py, threads, progress.as_ref(), |monitor| {
        let runs: Vec<&Recording> = runs.iter().map(Arc::as_ref).collect();
        core::diagnose(&runs, &machine, other.as_deref(), monitor)
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
