//! The nameplate for Python.

use crate::errors::{MachineError, to_python};
use pmsm_core::machine::{BaseParameter, Machine};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

/// Nameplate of a motor and its drive in SI units; what is unknown is None.
///
/// Parameters
/// ----------
/// n_p : int
///     Number of pole pairs, 1 to 200.
/// r_s : float or None, default None
///     Stator resistance, ohm.
/// l_d, l_q : float or None, default None
///     Inductances of the d and q axes, H.
/// psi_m : float or None, default None
///     Flux linkage of the magnet, V s (peak per phase).
/// j : float or None, default None
///     Inertia of everything that turns, kg m^2.
/// b : float or None, default None
///     Viscous friction, N m s per mechanical rad/s.
/// v_dc : float or None, default None
///     Voltage of the DC link, V.
/// i_rated : float or None, default None
///     Rated current, A (peak).
/// f_sample : float or None, default None
///     Frequency of the control, Hz.
///
/// Raises
/// ------
/// MachineError
///     On values that make no physical sense.
///
/// Examples
/// --------
/// >>> import pmsm_rs as pm
/// >>> pm.Machine(n_p=4, r_s=0.17, l_d=1.9e-3, l_q=1.9e-3, psi_m=0.27).n_p
/// 4
#[pyclass(name = "Machine", module = "pmsm_rs._core", frozen, eq, from_py_object)]
#[derive(Debug, Clone, PartialEq)]
pub struct PyMachine(pub Machine);

#[pymethods]
impl PyMachine {
    #[new]
    #[pyo3(signature = (*, n_p, r_s=None, l_d=None, l_q=None, psi_m=None, j=None, b=None, v_dc=None, i_rated=None, f_sample=None))]
    fn new(
        py: Python<'_>,
        n_p: i64,
        r_s: Option<f64>,
        l_d: Option<f64>,
        l_q: Option<f64>,
        psi_m: Option<f64>,
        j: Option<f64>,
        b: Option<f64>,
        v_dc: Option<f64>,
        i_rated: Option<f64>,
        f_sample: Option<f64>,
    ) -> PyResult<Self> {
        let pairs = u32::try_from(n_p)
            .map_err(|_| MachineError::new_err(format!("n_p is {n_p} pole pairs; give 1 to 200")))?;
        let build = || {
            let mut machine = Machine::new(pairs)?;
            for (parameter, value) in BaseParameter::ALL.into_iter().zip([r_s, l_d, l_q, psi_m, j, b]) {
                if let Some(value) = value {
                    machine = machine.with(parameter, value)?;
                }
            }
            machine.with_drive(v_dc, i_rated, f_sample)
        };
        build().map(Self).map_err(|error| to_python(py, &error))
    }

    #[getter]
    fn n_p(&self) -> u32 {
        self.0.n_p
    }
    #[getter]
    fn r_s(&self) -> Option<f64> {
        self.0.get(BaseParameter::RS)
    }
    #[getter]
    fn l_d(&self) -> Option<f64> {
        self.0.get(BaseParameter::LD)
    }
    #[getter]
    fn l_q(&self) -> Option<f64> {
        self.0.get(BaseParameter::LQ)
    }
    #[getter]
    fn psi_m(&self) -> Option<f64> {
        self.0.get(BaseParameter::PsiM)
    }
    #[getter]
    fn j(&self) -> Option<f64> {
        self.0.get(BaseParameter::J)
    }
    #[getter]
    fn b(&self) -> Option<f64> {
        self.0.get(BaseParameter::B)
    }
    #[getter]
    fn v_dc(&self) -> Option<f64> {
        self.0.v_dc
    }
    #[getter]
    fn i_rated(&self) -> Option<f64> {
        self.0.i_rated
    }
    #[getter]
    fn f_sample(&self) -> Option<f64> {
        self.0.f_sample
    }

    fn __hash__(&self) -> u64 {
        // FNV-1a over what distinguishes machines; equal machines hash alike since -0.0 cannot pass validation.
        self.values().iter().fold(0xcbf2_9ce4_8422_2325 ^ u64::from(self.0.n_p), |hash, (_, value)| {
            (hash ^ value.map_or(1, f64::to_bits)).wrapping_mul(0x0000_0100_0000_01b3)
        })
    }

    fn __repr__(&self) -> String {
        let known =
            self.values().into_iter().filter_map(|(name, value)| Some(format!(", {name}={}", value?)));
        format!("Machine(n_p={}{})", self.0.n_p, known.collect::<String>())
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let keywords = PyDict::new(py);
        keywords.set_item("n_p", self.0.n_p)?;
        for (name, value) in self.values() {
            keywords.set_item(name, value)?;
        }
        Ok((PyTuple::empty(py), keywords))
    }
}

impl PyMachine {
    fn values(&self) -> Vec<(&'static str, Option<f64>)> {
        let base = BaseParameter::ALL.into_iter().map(|parameter| (parameter.name(), self.0.get(parameter)));
        let drive = [("v_dc", self.0.v_dc), ("i_rated", self.0.i_rated), ("f_sample", self.0.f_sample)];
        base.chain(drive).collect()
    }
}
