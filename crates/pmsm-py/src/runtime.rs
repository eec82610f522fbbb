//! What the core runs on, for Python.

use pmsm_core::numerics::lanes::Path;
use pyo3::prelude::*;

/// The widest instructions of this processor, which the core uses: "avx512", "avx2", "sse2" or "portable". Behind it stand how many numbers
/// one of them takes, and how many threads a computation has by default.
#[pyfunction]
pub fn runtime() -> (&'static str, usize, usize) {
    let path = Path::best();
    let name = match path {
        Path::Portable => "portable",
        Path::Sse2 => "sse2",
        Path::Avx2 => "avx2",
        Path::Avx512 => "avx512",
    };
    (name, path.width(), rayon::current_num_threads())
}
