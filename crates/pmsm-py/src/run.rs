//! Identification for Python.

use crate::errors::{InternalError, UsageError, to_python};
use crate::machine::PyMachine;
use crate::recording::PyRecording;
use crate::supervise;
use pmsm_core::error::Error;
use pmsm_core::identify as core;
use pmsm_core::optimise::swarm::SwarmSettings;
use pyo3::prelude::*;
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Settings of a swarm from their JSON text.
pub fn settings(py: Python<'_>, text: &str) -> PyResult<SwarmSettings> {
    let swarm: SwarmSettings = serde_json::from_str(text).map_err(|error| {
        UsageError::new_err(format!("these settings of the swarm cannot be used: {error}"))
    })?;
    swarm.validate().map_err(|error| match error {
        Error::Quantity { .. } => UsageError::new_err(error.to_string()),
        other => to_python(py, &other),
    })?;
    Ok(swarm)
}

/// Estimates parameters; the answer is JSON text. `fit` maps names to bounds in SI units, or to None for a wide range
/// around the nameplate; empty means whatever the recording can show. `swarm` is JSON text.
#[pyfunction]
#[pyo3(signature = (recording, machine, *, fit, method, swarm, seed, uncertainties, threads, progress))]
pub fn identify(
    py: Python<'_>,
    recording: PyRef<'_, PyRecording>,
    machine: PyRef<'_, PyMachine>,
    fit: BTreeMap<String, Option<(f64, f64)>>,
    method: &str,
    swarm: &str,
    seed: u64,
    uncertainties: bool,
    threads: Option<usize>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<String> {
    let (run, machine) = (Arc::clone(&recording.0), machine.0.clone());
    let refused = |error| to_python(py, &error);
    let fit: Vec<_> = fit
        .into_iter()
        .map(|(name, bounds)| name.parse().map(|target| (target, bounds)))
        .collect::<Result<_, _>>()
        .map_err(refused)?;
    let swarm = settings(py, swarm)?;
    let request = core::Request { fit, method: method.parse().map_err(refused)?, swarm, seed, uncertainties };
    let (answer, interrupted) = supervise::run(py, threads, progress.as_ref(), |monitor| {
        core::identify(&run, &machine, &request, monitor)
    })?;
    let fault = |error: serde_json::Error| InternalError::new_err(error.to_string());
    let mut value = serde_json::to_value(&answer).map_err(fault)?;
    value["interrupted"] = json!(interrupted || answer.interrupted);
    value["version"] = json!(env!("CARGO_PKG_VERSION"));
    serde_json::to_string(&value).map_err(fault)
}
