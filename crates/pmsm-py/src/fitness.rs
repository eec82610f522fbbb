//! The fitness for Python's own optimisers.

use crate::errors::{UsageError, to_python};
use crate::machine::PyMachine;
use crate::recording::PyRecording;
use crate::supervise;
use numpy::{PyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pmsm_core::identify::{Fitness, Target};
use pyo3::prelude::*;

/// Fitness (9) of Liu, Liu & Cartes (2008), for optimisers of one's own.
///
/// Calling it with points of shape (points, parameters), SI units, gives costs of shape (points,): the sum of squared errors
/// of the phase currents and of the weighted speed, infinite where the model cannot be evaluated.
///
/// Parameters
/// ----------
/// recording : Recording
///     The run.
/// machine : Machine
///     The nameplate; parameters that are not in `fit` stay there.
/// fit : list of str
///     Names of the parameters of a point, in order.
/// threads : int or None, default None
///     None uses every processor.
///
/// Raises
/// ------
/// NotIdentifiableError
///     Where the recording does not show a parameter.
/// UsageError
///     For unknown names.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> import pmsm_rs as pm
/// >>> from pmsm_rs.config.machine_file import read_machine
/// >>> from pmsm_rs.support.demo import recording_files
/// >>> run, other, machine = recording_files()
/// >>> cost = pm.Fitness(pm.load(run, machine), read_machine(machine).machine, ["r_s"])
/// >>> cost(np.array([[1.0], [2.0]])).shape
/// (2,)
#[pyclass(name = "Fitness", module = "pmsm_rs._core", frozen)]
#[derive(Debug)]
pub struct PyFitness {
    inner: Fitness,
    threads: Option<usize>,
}

#[pymethods]
impl PyFitness {
    #[new]
    #[pyo3(signature = (recording, machine, fit, *, threads=None))]
    fn new(
        py: Python<'_>,
        recording: PyRef<'_, PyRecording>,
        machine: PyRef<'_, PyMachine>,
        fit: Vec<String>,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let (recording, machine) = (&recording.0, &machine.0);
        let build = || {
            let fit = fit.iter().map(|name| name.parse()).collect::<Result<Vec<Target>, _>>()?;
            Fitness::new(recording, machine, &fit)
        };
        py.detach(build).map(|inner| Self { inner, threads }).map_err(|error| to_python(py, &error))
    }

    fn __call__<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let [count, dim] = [points.shape()[0], points.shape()[1]];
        if dim != self.inner.dim() {
            let own = self.inner.dim();
            return Err(UsageError::new_err(format!("points have {dim} values; give {own} per point")));
        }
        let values = points
            .as_slice()
            .map_err(|_| UsageError::new_err("points are not contiguous; use numpy.ascontiguousarray"))?;
        let (costs, _) = supervise::run(py, self.threads, None, |monitor| {
            let mut costs = vec![0.0; count];
            self.inner.evaluate(values, &mut costs, monitor).map(|()| costs)
        })?;
        Ok(PyArray1::from_vec(py, costs))
    }
}
