//! Long computations: in a pool of their own, watched by the calling thread for signals. With one thread they run on the calling
//! thread itself, which then looks for signals whenever the computation asks whether to stop: handing a short call to another
//! thread and back would take a tenth of it.

mod here;

use crate::errors::{InternalError, UsageError, to_python};
use crate::pools;
use pmsm_core::error::Result as CoreResult;
use pmsm_core::monitor::Monitor;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How often the calling thread looks for signals and progress.
const LOOK: Duration = Duration::from_millis(10);

/// Where the last panic of this library happened; panics are reported as exceptions, not on standard error.
static LAST_PANIC: Mutex<Option<String>> = Mutex::new(None);

/// Keeps the place of a panic for the exception that reports it.
pub fn remember_panics() {
    std::panic::set_hook(Box::new(|info| *lock(&LAST_PANIC) = info.location().map(ToString::to_string)));
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Stage and share that were reported last.
type Latest = Option<(String, f64)>;

/// The monitor that a computation sees, and the calling thread's side of it.
#[derive(Debug, Default)]
struct Watch {
    stop: AtomicBool,
    latest: Mutex<Latest>,
    done: Mutex<bool>,
    finished: Condvar,
}

impl Monitor for Watch {
    fn cancelled(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
    fn report(&self, stage: &str, fraction: f64) {
        *lock(&self.latest) = Some((stage.to_owned(), fraction));
    }
}

impl Watch {
    /// Waits until the computation is done, at most [`LOOK`]; true once it is.
    fn wait(&self) -> bool {
        let guard = lock(&self.done);
        let (done, _) = self
            .finished
            .wait_timeout_while(guard, LOOK, |done| !*done)
            .unwrap_or_else(PoisonError::into_inner);
        *done
    }
}

/// Runs `job` and returns its result and whether Ctrl-C cut it short.
///
/// The job runs detached from Python in a pool of `threads` threads (all processors when `None`); this thread forwards
/// progress to `progress(stage, fraction)` and handles signals. A signal or an exception from the callback raises the stop
/// flag; the job then returns its best so far.
pub fn run<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    progress: Option<&Bound<'_, PyAny>>,
    job: impl FnOnce(&dyn Monitor) -> CoreResult<T> + Send,
) -> PyResult<(T, bool)> {
    if threads == Some(0) {
        return Err(UsageError::new_err("threads is 0; give at least 1, or None for all processors"));
    }
    if threads == Some(1) && here::possible() {
        return here::run(py, progress, job);
    }
    let pool = pools::take(threads)
        .map_err(|error| InternalError::new_err(format!("no threads could be started: {error}")))?;
    let watch = Watch::default();
    let mut interrupted = false;
    let mut trouble = None;
    let mut outcome = None;
    pool.in_place_scope(|scope| {
        scope.spawn(|_| {
            outcome = Some(catch_unwind(AssertUnwindSafe(|| job(&watch))));
            *lock(&watch.done) = true;
            watch.finished.notify_all();
        });
        while !py.detach(|| watch.wait()) {
            let progress = progress.filter(|_| !watch.cancelled());
            let told = py.check_signals().and_then(|()| tell(&watch.latest, progress));
            if let Err(error) = told {
                watch.stop.store(true, Ordering::Relaxed);
                if error.is_instance_of::<PyKeyboardInterrupt>(py) {
                    interrupted = true;
                } else {
                    trouble = trouble.take().or(Some(error));
                }
            }
        }
    });
    pools::give_back(threads, pool);
    match outcome {
        Some(outcome) => finish(py, outcome, interrupted, trouble),
        None => Err(InternalError::new_err("the computation was lost; please report it")),
    }
}

/// What a computation left, as Python sees it.
fn finish<T>(
    py: Python<'_>,
    outcome: std::thread::Result<CoreResult<T>>,
    interrupted: bool,
    trouble: Option<PyErr>,
) -> PyResult<(T, bool)> {
    match (trouble, outcome) {
        (Some(error), _) => Err(error),
        (None, Ok(result)) => result.map(|value| (value, interrupted)).map_err(|error| to_python(py, &error)),
        (None, Err(payload)) => Err(internal(payload.as_ref())),
    }
}

/// Tells the callback how far the computation is, again if that is where it was: whoever wants to stop it says so there.
fn tell(latest: &Mutex<Latest>, progress: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
    let latest = progress.and_then(|_| lock(latest).clone());
    match (latest, progress) {
        (Some((stage, fraction)), Some(callback)) => callback.call1((stage, fraction)).map(drop),
        _ => Ok(()),
    }
}

fn internal(payload: &(dyn Any + Send)) -> PyErr {
    let what = payload
        .downcast_ref::<&str>()
        .map(ToString::to_string)
        .or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "a panic without a message".to_owned());
    let place = lock(&LAST_PANIC).take().map(|place| format!(" at {place}")).unwrap_or_default();
    InternalError::new_err(format!("{what}{place}; please report it with the recording"))
}

/// Runs `job` here and now; a panic becomes an exception.
pub fn guarded<T>(job: impl FnOnce() -> T) -> PyResult<T> {
    catch_unwind(AssertUnwindSafe(job)).map_err(|payload| internal(payload.as_ref()))
}
