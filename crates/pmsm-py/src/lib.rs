//! Python bindings of pmsm-core: arrays in, results out, errors mapped in one place.

mod catalogue;
mod diagnosis;
mod errors;
mod fitness;
mod machine;
mod model;
mod pools;
mod recording;
mod run;
mod runtime;
mod simulation;
mod supervise;
mod system;
mod tracking;

use pyo3::prelude::*;

/// Keeps what a call gives back for the next one. The allocator of the C library returns it to the operating system, and
/// faulting it in again would take a third of a short call.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// The Rust core of pmsm_rs.
#[pymodule]
mod _core {
    #[pymodule_export]
    use super::catalogue::{effect_of_text, effects};
    #[pymodule_export]
    use super::diagnosis::{diagnose, diagnosis_options, refusal};
    #[pymodule_export]
    use super::errors::{
        DataError, InternalError, MachineError, NotIdentifiableError, PmsmError, UsageError,
    };
    #[pymodule_export]
    use super::fitness::PyFitness;
    #[pymodule_export]
    use super::machine::PyMachine;
    #[pymodule_export]
    use super::model::{equations, predict, respond};
    #[pymodule_export]
    use super::recording::PyRecording;
    #[pymodule_export]
    use super::run::identify;
    #[pymodule_export]
    use super::runtime::runtime;
    #[pymodule_export]
    use super::simulation::simulate;
    #[pymodule_export]
    use super::system::identify_system;
    #[pymodule_export]
    use super::tracking::PyTracker;
    use super::{Bound, PyModule, PyModuleMethods, PyResult, supervise};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        supervise::remember_panics();
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
