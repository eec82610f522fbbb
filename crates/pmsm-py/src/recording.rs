//! Recordings for Python: contiguous float64 arrays in, copies out.

use crate::errors::{DataError, UsageError, to_python};
use numpy::{PyArray1, PyReadonlyArray1};
use pmsm_core::recording::{Load, Recording};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping};
use std::sync::Arc;

/// Copies of columns by name. Raises DataError for one that is no contiguous float64 array of one dimension.
pub fn copied(columns: &Bound<'_, PyDict>) -> PyResult<Vec<(String, Vec<f64>)>> {
    let one = |(name, values): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        let name: String = name.extract()?;
        let array: PyReadonlyArray1<'_, f64> = values.extract().map_err(|_| {
            DataError::new_err(format!(
                "column '{name}' is no array of float64 with one dimension; convert it with numpy"
            ))
        })?;
        let values = array.as_slice().map_err(|_| {
            DataError::new_err(format!("column '{name}' is not contiguous; use numpy.ascontiguousarray"))
        })?;
        Ok((name, values.to_vec()))
    };
    columns.iter().map(one).collect()
}

/// Checked columns of one run, each of shape (samples,), SI units.
#[pyclass(name = "Recording", module = "pmsm_rs._core", frozen, subclass)]
#[derive(Debug)]
pub struct PyRecording(pub Arc<Recording>);

#[pymethods]
impl PyRecording {
    #[new]
    #[pyo3(signature = (columns, *, load=None, load_value=None, angle_error=None))]
    fn new(
        py: Python<'_>,
        columns: &Bound<'_, PyAny>,
        load: Option<&str>,
        load_value: Option<f64>,
        angle_error: Option<f64>,
    ) -> PyResult<Self> {
        let columns = match columns.cast::<PyDict>() {
            Ok(dict) => dict.clone(),
            Err(_) => {
                let copy = PyDict::new(py);
                copy.update(columns.cast::<PyMapping>()?)?;
                copy
            }
        };
        let given = copied(&columns)?;
        let load = load
            .map(|kind| Load::parse(kind, load_value))
            .transpose()
            .map_err(|error| DataError::new_err(error.to_string()))?;
        let checked = py.detach(|| {
            let measured = Recording::new(given, load)?;
            match angle_error {
                Some(error) => measured.with_derived_angle(error),
                None => Ok(measured),
            }
        });
        checked.map(|recording| Self(Arc::new(recording))).map_err(|error| to_python(py, &error))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    /// Names of the columns.
    #[getter]
    fn names(&self) -> Vec<&'static str> {
        self.0.names()
    }

    /// A copy of a column, shape (samples,), SI unit. Raises UsageError where there is none of that name.
    fn column<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let values = self.0.column(name).ok_or_else(|| {
            UsageError::new_err(format!(
                "there is no column '{name}'; recorded: {}",
                self.0.names().join(", ")
            ))
        })?;
        Ok(PyArray1::from_slice(py, values))
    }

    /// Time from the first to the last sample, s.
    #[getter]
    fn duration(&self) -> f64 {
        self.0.duration()
    }

    /// Which questions it can answer: full, electrical, mechanical, operating_points or open_circuit.
    #[getter]
    fn kind(&self) -> PyResult<String> {
        let text = serde_json::to_value(self.0.kind())
            .map_err(|error| crate::errors::InternalError::new_err(error.to_string()))?;
        Ok(text.as_str().unwrap_or_default().to_owned())
    }

    /// What is known of the load torque.
    #[getter]
    fn load(&self) -> &'static str {
        self.0.load().kind()
    }

    /// How far an angle may be off that was taken from the voltages, rad (electrical), else None.
    #[getter]
    fn angle_error(&self) -> Option<f64> {
        self.0.angle_error()
    }

    /// The known constant load, N m, else None.
    #[getter]
    fn load_value(&self) -> Option<f64> {
        match self.0.load() {
            Load::KnownConstant(value) => Some(value),
            _ => None,
        }
    }
}
