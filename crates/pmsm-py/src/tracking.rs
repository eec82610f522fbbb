//! Online identification for Python.

use crate::errors::{DataError, InternalError, UsageError, to_python};
use crate::machine::PyMachine;
use crate::recording::PyRecording;
use crate::supervise;
use pmsm_core::error::{Error, Result as CoreResult};
use pmsm_core::monitor::Monitor;
use pmsm_core::recording::Load;
use pmsm_core::track::{Settings, Tracker, Window};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Follows parameters through a stream of samples, window by window.
#[pyclass(name = "Tracker", module = "pmsm_rs._core", frozen)]
#[derive(Debug)]
pub struct PyTracker(Mutex<Tracker>);

#[pymethods]
impl PyTracker {
    #[new]
    #[pyo3(signature = (machine, *, fit, window, method, swarm, search, seed, load, load_value))]
    fn new(
        py: Python<'_>,
        machine: PyRef<'_, PyMachine>,
        fit: BTreeMap<String, Option<(f64, f64)>>,
        window: f64,
        method: &str,
        swarm: &str,
        search: f64,
        seed: u64,
        load: Option<&str>,
        load_value: Option<f64>,
    ) -> PyResult<Self> {
        let swarm = crate::run::settings(py, swarm)?;
        let build = || {
            let fit = fit.into_iter().map(|(name, bounds)| Ok((name.parse()?, bounds)));
            let fit = fit.collect::<CoreResult<_>>()?;
            let load = load.map(|kind| Load::parse(kind, load_value)).transpose()?;
            let settings = Settings { fit, window, method: method.parse()?, swarm, search, seed, load };
            Tracker::new(machine.0.clone(), settings)
        };
        let tracker = build().map_err(|error: Error| UsageError::new_err(error.to_string()))?;
        Ok(Self(Mutex::new(tracker)))
    }

    /// Takes in columns of shape (samples,) by canonical name, SI; returns the windows that they complete, JSON text each.
    #[pyo3(signature = (columns, *, threads))]
    fn update(
        &self,
        py: Python<'_>,
        columns: &Bound<'_, PyDict>,
        threads: Option<usize>,
    ) -> PyResult<Vec<String>> {
        let given = crate::recording::copied(columns)?;
        self.work(py, threads, |tracker, monitor| {
            let batch: Vec<(&str, &[f64])> = given.iter().map(|(n, v)| (n.as_str(), v.as_slice())).collect();
            tracker.update(&batch, monitor)
        })
    }

    /// Takes in the rows from `first` on and before `end` of a recording, as `update` does; no copy of them is made before.
    #[pyo3(signature = (recording, first, end, *, threads))]
    fn follow(
        &self,
        py: Python<'_>,
        recording: &Bound<'_, PyRecording>,
        first: usize,
        end: usize,
        threads: Option<usize>,
    ) -> PyResult<Vec<String>> {
        let recording = recording.get().0.clone();
        let end = end.min(recording.len());
        let rows = first.min(end)..end;
        self.work(py, threads, |tracker, monitor| {
            let column = |name| Some((name, &recording.column(name)?[rows.clone()]));
            let batch: Vec<(&str, &[f64])> = recording.names().into_iter().filter_map(column).collect();
            tracker.update(&batch, monitor)
        })
    }

    /// Ends the window under way; returns it as JSON text.
    #[pyo3(signature = (*, threads))]
    fn finish(&self, py: Python<'_>, threads: Option<usize>) -> PyResult<Vec<String>> {
        self.work(py, threads, |tracker, monitor| tracker.finish(monitor))
    }

    /// Everything it knows, as JSON text.
    fn state(&self, py: Python<'_>) -> PyResult<String> {
        py.detach(|| self.lock().state()).map_err(|error| InternalError::new_err(error.to_string()))
    }

    /// The tracker whose state this is. Raises DataError for any other text.
    #[staticmethod]
    fn restore(py: Python<'_>, state: &str) -> PyResult<Self> {
        let restored = py.detach(|| Tracker::restore(state));
        restored
            .map(|tracker| Self(Mutex::new(tracker)))
            .map_err(|error| DataError::new_err(error.to_string()))
    }

    /// The nameplate.
    #[getter]
    fn machine(&self, py: Python<'_>) -> PyMachine {
        PyMachine(py.detach(|| self.lock().machine().clone()))
    }

    /// Length of a window, s.
    #[getter]
    fn window(&self, py: Python<'_>) -> f64 {
        py.detach(|| self.lock().settings().window)
    }

    /// Names of the parameters that are fitted.
    #[getter]
    fn fit(&self, py: Python<'_>) -> Vec<&'static str> {
        py.detach(|| self.lock().settings().fit.iter().map(|(target, _)| target.name()).collect())
    }
}

impl PyTracker {
    fn lock(&self) -> MutexGuard<'_, Tracker> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn work(
        &self,
        py: Python<'_>,
        threads: Option<usize>,
        job: impl FnOnce(&mut Tracker, &dyn Monitor) -> CoreResult<Vec<Window>> + Send,
    ) -> PyResult<Vec<String>> {
        let before = py.detach(|| self.lock().clone());
        let (windows, interrupted) =
            supervise::run(py, threads, None, |monitor| job(&mut self.lock(), monitor))?;
        if interrupted {
            // The batch was done when Ctrl-C was seen: as with any other interruption none of it was taken in.
            py.detach(|| *self.lock() = before);
            return Err(to_python(py, &Error::Interrupted));
        }
        let texts = windows.iter().map(serde_json::to_string).collect::<Result<_, _>>();
        texts.map_err(|error| InternalError::new_err(error.to_string()))
    }
}
