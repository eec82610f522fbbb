//! Thread pools between two calls: starting threads would cost a short call more than its work.
//!
//! Every call has a pool to itself, so that calls from several Python threads run side by side. Idle threads sleep.

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use std::process;
use std::sync::Mutex;

/// Pools kept at most.
const MOST: usize = 4;

static IDLE: Mutex<Vec<Idle>> = Mutex::new(Vec::new());

/// A pool that waits for its next call.
struct Idle {
    /// The process whose threads these are: a fork has the pool without them.
    process: u32,
    threads: Option<usize>,
    pool: ThreadPool,
}

/// A pool of `threads` threads, of as many as there are processors when `None`, that nobody else uses.
pub fn take(threads: Option<usize>) -> Result<ThreadPool, ThreadPoolBuildError> {
    // Not waited for: in a fork the lock may be held by a thread that is no more.
    if let Ok(mut idle) = IDLE.try_lock() {
        let own = process::id();
        while let Some(at) = idle.iter().position(|pool| pool.process != own) {
            // Its threads cannot be told to end, as they are not here.
            std::mem::forget(idle.swap_remove(at));
        }
        if let Some(at) = idle.iter().position(|pool| pool.threads == threads) {
            return Ok(idle.swap_remove(at).pool);
        }
    }
    ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build()
}

/// Keeps a pool from [`take`] for the next call with as many threads.
pub fn give_back(threads: Option<usize>, pool: ThreadPool) {
    let pool = Idle { process: process::id(), threads, pool };
    if let Ok(mut idle) = IDLE.try_lock() {
        if idle.len() == MOST {
            idle.remove(0);
        }
        idle.push(pool);
    }
}
