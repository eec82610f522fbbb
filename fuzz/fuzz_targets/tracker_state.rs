//! Text in place of the state of a tracker: refused, or one that writes itself as it was read and takes samples.
//! Its checksum is not compared here, as no damage that a fuzzer does would come past it.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pmsm_core::monitor::Silent;
use pmsm_core::track::Tracker;

fuzz_target!(|text: &str| {
    let Ok(mut tracker) = Tracker::restore(text) else { return };
    let state = tracker.state().expect("what was read can be written");
    assert_eq!(Tracker::restore(&state).expect("what was written can be read").state(), Ok(state));
    let t = [1.0, 1.1, 1.2];
    let _ = tracker.update(&[("t", &t), ("i_d", &t), ("i_q", &t), ("v_d", &t), ("v_q", &t)], &Silent);
});
