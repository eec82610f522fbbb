//! Columns of any names and values: a recording is refused in words, or is one whose signals can be worked out.

#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use pmsm_core::machine::Machine;
use pmsm_core::recording::{COLUMNS, Load, Recording};
use pmsm_core::signals::Signals;

#[derive(Debug, Arbitrary)]
struct Given {
    columns: Vec<(u8, Vec<f64>)>,
    /// Steps of the time in place of times, so that some of them increase.
    steps: Vec<u8>,
    unit: u8,
    load: Option<u8>,
    n_p: u8,
}

fuzz_target!(|given: Given| {
    let unit = [1e-6, 1e-4, 1e-3, 0.1, 1.0][usize::from(given.unit) % 5];
    let mut t = 0.0;
    let times: Vec<f64> = given
        .steps
        .iter()
        .map(|step| {
            t += unit * f64::from(*step);
            t
        })
        .collect();
    let mut columns: Vec<(String, Vec<f64>)> = Vec::new();
    for (name, mut values) in given.columns {
        // Mostly a column as long as the time.
        if name < 128 && !values.is_empty() {
            values = values.iter().copied().cycle().take(times.len()).collect();
        }
        columns.push((COLUMNS[usize::from(name) % COLUMNS.len()].0.to_string(), values));
    }
    columns.push(("t".into(), times));
    let load = given.load.map(|kind| match kind % 4 {
        0 => Load::None,
        1 => Load::UnknownConstant,
        2 => Load::UnknownPiecewise,
        _ => Load::Locked,
    });
    let Ok(recording) = Recording::new(columns, load) else { return };
    assert!(recording.period() > 0.0 && recording.duration() >= 0.0);
    assert!(recording.segments().iter().all(|s| s.start < s.end && s.end <= recording.len()));
    let Ok(machine) = Machine::new(u32::from(given.n_p)) else { return };
    let _ = Signals::new(&recording, &machine);
});
