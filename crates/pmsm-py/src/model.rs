//! The model of an answer for Python: its predictions, its response to voltages and load, and its equations.

use crate::errors::{InternalError, UsageError, to_python};
use crate::machine::PyMachine;
use crate::recording::PyRecording;
use crate::supervise;
use numpy::{PyArray1, PyReadonlyArray1};
use pmsm_core::diagnose::{self, Horizon};
use pmsm_core::equations::Equations;
use pmsm_core::simulate::response::{self, Begin, Heating, Inputs};
use pmsm_core::specification::Specification;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

fn read(text: &str) -> PyResult<Specification> {
    serde_json::from_str(text)
        .map_err(|error| UsageError::new_err(format!("this model cannot be used: {error}")))
}

/// What the model `specification` (JSON text) says of a recording: a dict of arrays of shape (samples,), `t`, `NAME_measured` and `NAME_model`.
/// `one_step` predicts each sample from the one before, in place of a free run.
#[pyfunction]
#[pyo3(signature = (recording, machine, specification, *, one_step, threads, progress))]
pub fn predict<'py>(
    py: Python<'py>,
    recording: PyRef<'py, PyRecording>,
    machine: PyRef<'py, PyMachine>,
    specification: &str,
    one_step: bool,
    threads: Option<usize>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let (run, machine, model) = (Arc::clone(&recording.0), machine.0.clone(), read(specification)?);
    let horizon = if one_step { Horizon::OneStep } else { Horizon::FreeRun };
    let (columns, _) = supervise::run(py, threads, progress.as_ref(), |monitor| {
        diagnose::predict(&run, &machine, &model, horizon, monitor)
    })?;
    let out = PyDict::new(py);
    for (name, values) in &columns {
        out.set_item(name, PyArray1::from_slice(py, values))?;
    }
    Ok(out)
}

/// The open-loop response of the model `specification` (JSON text) to voltages and a load torque, all of shape (instants,): a dict of arrays `i_d`, `i_q`,
/// `tau_e`, `omega_m`, `theta_m`, and the number of Runge-Kutta steps in each interval. `begin` is i_d, i_q, omega_m, theta_m; `heating` is that of winding
/// and magnets above 20 degC, K.
#[pyfunction]
#[pyo3(signature = (specification, t, v_d, v_q, tau_load, *, begin, heating, steps))]
pub fn respond<'py>(
    py: Python<'py>,
    specification: &str,
    t: PyReadonlyArray1<'py, f64>,
    v_d: PyReadonlyArray1<'py, f64>,
    v_q: PyReadonlyArray1<'py, f64>,
    tau_load: PyReadonlyArray1<'py, f64>,
    begin: [f64; 4],
    heating: [f64; 2],
    steps: Option<usize>,
) -> PyResult<(Bound<'py, PyDict>, usize)> {
    let (model, p) = read(specification)?.model().map_err(|error| to_python(py, &error))?;
    let columns = [t, v_d, v_q, tau_load].map(|x| x.as_array().to_vec());
    let [t, v_d, v_q, tau_load] = columns;
    let period = t.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    let steps = steps.unwrap_or_else(|| response::steps(&model, &p, period));
    let begin = Begin { i: [begin[0], begin[1]], omega_m: begin[2], theta_m: begin[3] };
    let heating = Heating { winding: heating[0], magnet: heating[1] };
    let (out, _) = supervise::run(py, Some(1), None, |monitor| {
        let inputs = Inputs { t: &t, v: [&v_d, &v_q], tau_load: &tau_load };
        response::respond(&model, &p, inputs, begin, heating, steps, monitor)
    })?;
    let dict = PyDict::new(py);
    for (name, values) in &out {
        dict.set_item(*name, PyArray1::from_slice(py, values))?;
    }
    Ok((dict, steps))
}

/// The equations of the model `specification` (JSON text) as lists of elementary operations, as JSON text; at these temperatures of winding and magnets above
/// 20 degC, K.
#[pyfunction]
#[pyo3(signature = (specification, *, heating))]
pub fn equations(py: Python<'_>, specification: &str, heating: [f64; 2]) -> PyResult<String> {
    let (model, p) = read(specification)?.model().map_err(|error| to_python(py, &error))?;
    let equations = Equations::of(&model, &p, Heating { winding: heating[0], magnet: heating[1] });
    serde_json::to_string(&equations).map_err(|error| InternalError::new_err(error.to_string()))
}
