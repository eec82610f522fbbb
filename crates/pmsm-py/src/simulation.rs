//! The simulated drive for Python.

use crate::errors::{InternalError, UsageError, to_python};
use crate::machine::PyMachine;
use crate::recording::PyRecording;
use crate::supervise;
use numpy::PyArray1;
use pmsm_core::drive::{Choice, Drift, DriveSettings, Manoeuvre, Schedule, Setup, simulate as core};
use pmsm_core::effect::Context;
use pmsm_core::error::Error;
use pmsm_core::machine::BaseParameter;
use pmsm_core::specification::MapPart;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What comes as JSON text.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {
    manoeuvre: Manoeuvre,
    #[serde(default)]
    drive: DriveSettings,
    #[serde(default)]
    drift: BTreeMap<String, Schedule>,
    #[serde(default)]
    effects: Vec<Choice>,
    #[serde(default)]
    map: Vec<MapPart>,
    #[serde(default)]
    scales: Option<Context>,
}

/// Simulates a drive: the recording, its truth as JSON text, and true signals as a dict of arrays of shape (samples,).
/// `settings` is JSON text with the tables manoeuvre, drive, drift and effects of the core.
#[pyfunction]
#[pyo3(signature = (machine, nameplate, settings, *, seed, progress))]
pub fn simulate<'py>(
    py: Python<'py>,
    machine: PyRef<'py, PyMachine>,
    nameplate: PyRef<'py, PyMachine>,
    settings: &str,
    seed: u64,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<(PyRecording, String, Bound<'py, PyDict>)> {
    let given: Settings = serde_json::from_str(settings)
        .map_err(|error| UsageError::new_err(format!("these settings cannot be used: {error}")))?;
    let setup = Setup {
        machine: machine.0.clone(),
        nameplate: nameplate.0.clone(),
        effects: given.effects,
        map: given.map,
        scales: given.scales,
        drift: drift(given.drift).map_err(|error| to_python(py, &error))?,
        drive: given.drive,
        manoeuvre: given.manoeuvre,
        seed,
    };
    let (simulation, _) = supervise::run(py, Some(1), progress.as_ref(), |monitor| core(&setup, monitor))?;
    let traces = PyDict::new(py);
    for (name, values) in &simulation.truth.traces {
        traces.set_item(name, PyArray1::from_slice(py, values))?;
    }
    let truth = serde_json::to_string(&simulation.truth)
        .map_err(|error| InternalError::new_err(error.to_string()))?;
    Ok((PyRecording(Arc::new(simulation.recording)), truth, traces))
}

fn drift(given: BTreeMap<String, Schedule>) -> Result<Drift, Error> {
    let mut drift: Drift = std::array::from_fn(|_| None);
    for (name, schedule) in given {
        let parameter = BaseParameter::ALL.into_iter().find(|p| p.name() == name);
        let parameter = parameter.ok_or_else(|| Error::Unknown {
            kind: "parameter",
            name,
            known: BaseParameter::ALL.map(BaseParameter::name).join(", "),
        })?;
        drift[parameter.index()] = Some(schedule);
    }
    Ok(drift)
}
