//! How a long computation tells of its progress and learns that it should stop.

use crate::error::{Error, Result};
use std::sync::atomic::{AtomicBool, Ordering};

/// Watches a computation. Shared between threads; whatever takes longer than some milliseconds asks before it begins, and in each
/// round of a loop. No work begins once the answer was yes.
pub trait Monitor: Sync {
    /// True once the caller wants the best result so far.
    fn cancelled(&self) -> bool {
        false
    }
    /// The same question where a stop ends the computation as an error.
    ///
    /// # Errors
    /// [`Error::Interrupted`] once the caller wants it to stop.
    fn go_on(&self) -> Result<()> {
        if self.cancelled() { Err(Error::Interrupted) } else { Ok(()) }
    }
    /// `fraction` (0 to 1) of the whole is done; `stage` says in a few words what is being done.
    fn report(&self, stage: &str, fraction: f64) {
        let _ = (stage, fraction);
    }
}

/// A monitor that never stops anything and says nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Monitor for Silent {}

/// A flag that another thread raises to stop a computation.
#[derive(Debug, Default)]
pub struct StopFlag(AtomicBool);

impl StopFlag {
    /// Asks the computation to stop.
    pub fn stop(&self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Monitor for StopFlag {
    fn cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_raised_flag_stays_raised() {
        let flag = StopFlag::default();
        assert!(!flag.cancelled() && !Silent.cancelled());
        flag.stop();
        assert!(flag.cancelled() && flag.cancelled());
        assert_eq!((Silent.go_on(), flag.go_on()), (Ok(()), Err(Error::Interrupted)));
    }
}
