//! Own systems for Python: the search of the core on residuals that a Python function computes.

use crate::errors::{InternalError, UsageError, to_python};
use crate::run::settings;
use crate::supervise::guarded;
use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray3};
use pmsm_core::error::Error;
use pmsm_core::monitor::Monitor;
use pmsm_core::system::{Differences, Errors, Request, fit};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use serde_json::json;
use std::sync::{Mutex, PoisonError};

/// Finds the parameters with which `errors` are smallest; the answer is JSON text.
///
/// `errors` maps points of shape (points, parameters) to weighted errors of shape (points, outputs, samples), zero where
/// nothing was measured. It is called on the calling thread. On Ctrl-C the best so far is returned.
#[pyfunction]
#[pyo3(signature = (errors, names, bounds, *, outputs, samples, start, method, swarm, seed, progress))]
pub fn identify_system(
    py: Python<'_>,
    errors: Py<PyAny>,
    names: Vec<String>,
    bounds: Vec<(f64, f64)>,
    outputs: usize,
    samples: usize,
    start: Option<Vec<f64>>,
    method: &str,
    swarm: &str,
    seed: u64,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let refused = |error: Error| match error {
        Error::Quantity { .. } | Error::Unusable { .. } => UsageError::new_err(error.to_string()),
        other => to_python(py, &other),
    };
    let request =
        Request { method: method.parse().map_err(refused)?, swarm: settings(py, swarm)?, seed, start };
    let called = Called { errors, progress, outputs, samples, count: bounds.len(), failed: Mutex::new(None) };
    let residuals = Differences { model: &called, bounds: &bounds };
    let labels: Vec<&str> = names.iter().map(String::as_str).collect();
    let outcome = guarded(|| fit(&residuals, &labels, &bounds, &request, &called))?;
    if let Some(error) = called.failed.lock().unwrap_or_else(PoisonError::into_inner).take()
        && !error.is_instance_of::<PyKeyboardInterrupt>(py)
    {
        return Err(error);
    }
    let fault = |error: serde_json::Error| InternalError::new_err(error.to_string());
    let mut value = serde_json::to_value(outcome.map_err(refused)?).map_err(fault)?;
    value["version"] = json!(env!("CARGO_PKG_VERSION"));
    serde_json::to_string(&value).map_err(fault)
}

/// A Python function as residuals and, through its exceptions, as the monitor of the search.
struct Called {
    errors: Py<PyAny>,
    progress: Option<Py<PyAny>>,
    outputs: usize,
    samples: usize,
    /// Number of parameters.
    count: usize,
    failed: Mutex<Option<PyErr>>,
}

impl Called {
    /// Keeps the first exception and gives what stands in for a result.
    fn keep<T>(&self, outcome: PyResult<T>, otherwise: T) -> T {
        outcome.unwrap_or_else(|error| {
            self.failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
            otherwise
        })
    }

    /// Errors of several points, each a run of outputs × samples.
    fn evaluate(&self, points: &[f64]) -> PyResult<Vec<f64>> {
        if self.cancelled() {
            return Ok(Vec::new());
        }
        let (count, dim) = (points.len() / self.count, self.count);
        Python::attach(|py| {
            py.check_signals()?;
            let array = PyArray2::zeros(py, [count, dim], false);
            array.readwrite().as_slice_mut()?.copy_from_slice(points);
            let found = self.errors.bind(py).call1((array,))?;
            let found: PyReadonlyArray3<'_, f64> = found.extract()?;
            let shape = [count, self.outputs, self.samples];
            if found.as_array().shape() != shape {
                let got = found.as_array().shape().to_vec();
                return Err(InternalError::new_err(format!("errors of shape {got:?} in place of {shape:?}")));
            }
            Ok(found.as_slice()?.to_vec())
        })
    }
}

impl Monitor for Called {
    fn cancelled(&self) -> bool {
        self.failed.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    fn report(&self, stage: &str, fraction: f64) {
        if let Some(progress) = &self.progress {
            let told = Python::attach(|py| progress.call1(py, (stage, fraction)).map(drop));
            self.keep(told, ());
        }
    }
}

impl Errors for Called {
    fn outputs(&self) -> usize {
        self.outputs
    }

    fn samples(&self) -> usize {
        self.samples
    }

    fn errors(&self, points: &[f64]) -> Vec<f64> {
        self.keep(self.evaluate(points), Vec::new())
    }
}
