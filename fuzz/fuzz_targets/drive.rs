//! A drive as JSON text: its parts are refused, or a short run of it ends.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pmsm_core::drive::{Choice, DriveSettings, Manoeuvre, Setup, simulate};
use pmsm_core::machine::{BaseParameter, Machine};
use pmsm_core::monitor::Monitor;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Asks of the simulation, thousands of steps apart, after which a run has shown enough.
const MOST: usize = 4;

#[derive(Default)]
struct Few(AtomicUsize);

impl Monitor for Few {
    fn cancelled(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) >= MOST
    }
}

fn machine() -> Machine {
    let values = [0.8, 4e-3, 6e-3, 0.1, 1e-3, 1e-4];
    let mut machine = Machine::new(3).expect("three pole pairs");
    for (parameter, value) in BaseParameter::ALL.into_iter().zip(values) {
        machine = machine.with(parameter, value).expect("an ordinary machine");
    }
    machine.with_drive(Some(300.0), Some(8.0), Some(1e4)).expect("an ordinary drive")
}

fuzz_target!(|data: (&str, &str, &str)| {
    let (manoeuvre, drive, effects) = data;
    let manoeuvre = serde_json::from_str::<Manoeuvre>(manoeuvre).unwrap_or_else(|_| Manoeuvre::new(0.02));
    let mut setup = Setup::new(machine(), manoeuvre);
    if let Ok(drive) = serde_json::from_str::<DriveSettings>(drive) {
        setup.drive = drive;
    }
    if let Ok(effects) = serde_json::from_str::<Vec<Choice>>(effects) {
        setup.effects = effects;
    }
    if let Ok(simulation) = simulate(&setup, &Few::default()) {
        assert!(simulation.recording.t().iter().all(|t| t.is_finite()));
    }
});
