//! Computations on the calling thread.

use super::{LOOK, Latest, finish, lock, tell};
use pmsm_core::error::Result as CoreResult;
use pmsm_core::monitor::Monitor;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, ThreadId};
use std::time::Instant;

thread_local! {
    /// This thread as a pool of its own, so that whatever the core would do in parallel happens here.
    static ALONE: Option<ThreadPool> = ThreadPoolBuilder::new().num_threads(1).use_current_thread().build().ok();
}

/// Whether this thread can be a pool of its own: not if it works for another one.
pub fn possible() -> bool {
    ALONE.with(Option::is_some)
}

/// The monitor that the computation sees. Asked by its own thread, it looks for signals and tells of the progress from time to
/// time.
struct Lookout {
    owner: ThreadId,
    began: Instant,
    /// Time of the next look in nanoseconds since the beginning.
    due: AtomicU64,
    stop: AtomicBool,
    interrupted: AtomicBool,
    trouble: Mutex<Option<PyErr>>,
    progress: Option<Py<PyAny>>,
    latest: Mutex<Latest>,
}

impl Lookout {
    fn look(&self) {
        Python::attach(|py| {
            let progress = self.progress.as_ref().map(|callback| callback.bind(py));
            let progress = progress.filter(|_| !self.stop.load(Ordering::Relaxed));
            let Err(error) = py.check_signals().and_then(|()| tell(&self.latest, progress)) else { return };
            self.stop.store(true, Ordering::Relaxed);
            if error.is_instance_of::<PyKeyboardInterrupt>(py) {
                self.interrupted.store(true, Ordering::Relaxed);
            } else {
                lock(&self.trouble).get_or_insert(error);
            }
        });
    }

    fn now(&self) -> u64 {
        self.began.elapsed().as_nanos() as u64
    }
}

impl Monitor for Lookout {
    fn cancelled(&self) -> bool {
        if self.now() >= self.due.load(Ordering::Relaxed) && thread::current().id() == self.owner {
            self.look();
            self.due.store(self.now() + LOOK.as_nanos() as u64, Ordering::Relaxed);
        }
        self.stop.load(Ordering::Relaxed)
    }
    fn report(&self, stage: &str, fraction: f64) {
        if self.progress.is_some() {
            *lock(&self.latest) = Some((stage.to_owned(), fraction));
        }
    }
}

/// [`super::run`] on this thread, where that is [`possible`].
pub fn run<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    job: impl FnOnce(&dyn Monitor) -> CoreResult<T> + Send,
) -> PyResult<(T, bool)> {
    let lookout = Lookout {
        owner: thread::current().id(),
        began: Instant::now(),
        due: AtomicU64::new(LOOK.as_nanos() as u64),
        stop: AtomicBool::new(false),
        interrupted: AtomicBool::new(false),
        trouble: Mutex::new(None),
        progress: progress.map(|callback| callback.clone().unbind()),
        latest: Mutex::new(None),
    };
    let outcome = py.detach(|| {
        let job = || catch_unwind(AssertUnwindSafe(|| job(&lookout)));
        ALONE.with(|pool| match pool {
            Some(pool) => pool.install(job),
            None => job(),
        })
    });
    // What came since the last look of a long computation came during it.
    lookout.cancelled();
    let interrupted = lookout.interrupted.load(Ordering::Relaxed);
    let trouble = lock(&lookout.trouble).take();
    finish(py, outcome, interrupted, trouble)
}
