//! The ways into a job on vectors.

use crate::numerics::lanes::{Job, Path};

pub use eight::avx512;
pub use four::avx2;

/// A line of the cache on the stack. In a function that holds one the compiler aligns all vectors that it must keep on the stack; those
/// that cross a line are far slower.
#[repr(align(64))]
struct Line {
    _bytes: [u8; 64],
}

// What is entered from different modules is compiled side by side.
mod eight {
    use super::super::Avx512;
    use super::{Job, Line, Path};
    use std::hint::black_box;

    /// Runs a job on vectors of eight.
    ///
    /// # Panics
    /// If the processor has no AVX-512F or no VL.
    pub fn avx512<J: Job, const FUSED: bool>(job: J) -> J::Output {
        #[target_feature(enable = "avx512f,avx512vl")]
        fn enter<J: Job, const FUSED: bool>(job: J) -> J::Output {
            black_box(&Line { _bytes: [0; 64] });
            job.run::<Avx512<FUSED>>()
        }
        assert!(Path::Avx512.available(), "this processor has no AVX-512F with VL");
        // SAFETY: the instructions that `enter` enables were found on this processor one line above.
        unsafe { enter::<J, FUSED>(job) }
    }
}

mod four {
    use super::super::Avx2;
    use super::{Job, Line, Path};
    use std::hint::black_box;

    /// Runs a job on vectors of four.
    ///
    /// # Panics
    /// If the processor has no AVX2 or no FMA.
    pub fn avx2<J: Job, const FUSED: bool>(job: J) -> J::Output {
        #[target_feature(enable = "avx2,fma")]
        fn enter<J: Job, const FUSED: bool>(job: J) -> J::Output {
            black_box(&Line { _bytes: [0; 64] });
            job.run::<Avx2<FUSED>>()
        }
        assert!(Path::Avx2.available(), "this processor has no AVX2 with FMA");
        // SAFETY: the instructions that `enter` enables were found on this processor one line above.
        unsafe { enter::<J, FUSED>(job) }
    }
}
