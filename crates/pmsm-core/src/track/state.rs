//! A tracker as text and back. Floating-point numbers are written with as many digits as it takes to read the same bits.

use super::{Progress, Settings, Tracker};
use crate::error::{Error, Result};
use crate::identify::{Method, Target};
use crate::machine::{BaseParameter, Machine};
use crate::optimise::swarm::SwarmSettings;
use crate::recording::Load;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Name and version of the format.
const SCHEMA: &str = "pmsm-rs.tracker/1";
/// Longest text that is read, bytes.
const LONGEST: usize = 256 << 20;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Envelope {
    schema: String,
    /// FNV-1a of the text of `tracker`.
    check: String,
    tracker: Inner,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Inner {
    machine: Machine,
    fit: Vec<(Target, Option<(f64, f64)>)>,
    window: f64,
    method: Method,
    swarm: SwarmSettings,
    search: f64,
    seed: u64,
    load: Option<Load>,
    progress: Progress,
}

/// The state of a tracker as JSON.
///
/// # Errors
/// [`Error::Unusable`] if it cannot be written.
pub fn write(tracker: &Tracker) -> Result<String> {
    let s = tracker.settings.clone();
    let inner = Inner {
        machine: tracker.machine.clone(),
        fit: s.fit,
        window: s.window,
        method: s.method,
        swarm: s.swarm,
        search: s.search,
        seed: s.seed,
        load: s.load,
        progress: Progress::clone(&tracker.progress),
    };
    let check = check(&inner)?;
    serde_json::to_string(&Envelope { schema: SCHEMA.into(), check, tracker: inner }).map_err(|e| fault(&e))
}

/// The tracker of a state.
///
/// # Errors
/// [`Error::Unusable`].
pub fn read(text: &str) -> Result<Tracker> {
    let refuse =
        |problem: String| Err(Error::unusable(problem, "give the text that state() returned, unchanged"));
    if text.len() > LONGEST {
        return refuse(format!("the state of a tracker has {} bytes, more than any tracker's", text.len()));
    }
    #[derive(Deserialize)]
    struct Label {
        schema: String,
    }
    match serde_json::from_str::<Label>(text) {
        Ok(label) if label.schema != SCHEMA => {
            let shown: String = label.schema.chars().take(60).collect();
            return refuse(format!("the state of a tracker is of schema '{shown}', not '{SCHEMA}'"));
        }
        Ok(_) => {}
        Err(error) => return refuse(format!("this is no state of a tracker ({error})")),
    }
    let envelope: Envelope = match serde_json::from_str(text) {
        Ok(envelope) => envelope,
        Err(error) => return refuse(format!("the state of a tracker cannot be read ({error})")),
    };
    let inner = envelope.tracker;
    // A fuzzer never comes past a checksum.
    if !cfg!(fuzzing) && check(&inner)? != envelope.check {
        return refuse("the state of a tracker is damaged: its checksum does not fit".into());
    }
    let settings = Settings {
        fit: inner.fit,
        window: inner.window,
        method: inner.method,
        swarm: inner.swarm,
        search: inner.search,
        seed: inner.seed,
        load: inner.load,
    };
    let progress = inner.progress;
    let sound = progress.intake.is_sound()
        && progress.intake.window() == settings.window
        && progress.history.is_sound()
        && progress.warm.len() <= Target::ALL.len()
        && progress.warm.iter().all(|(_, value)| value.is_finite());
    if !sound {
        return refuse("the state of a tracker holds values that no tracker has".into());
    }
    settings.validate()?;
    Ok(Tracker { machine: checked(&inner.machine)?, settings, progress: Arc::new(progress) })
}

/// The machine once more through its own checks.
fn checked(given: &Machine) -> Result<Machine> {
    let mut machine = Machine::new(given.n_p)?;
    for parameter in BaseParameter::ALL {
        if let Some(value) = given.get(parameter) {
            machine = machine.with(parameter, value)?;
        }
    }
    machine.with_drive(given.v_dc, given.i_rated, given.f_sample)
}

fn check(inner: &Inner) -> Result<String> {
    let text = serde_json::to_string(inner).map_err(|e| fault(&e))?;
    let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    Ok(format!("{hash:016x}"))
}

fn fault(error: &serde_json::Error) -> Error {
    Error::unusable(format!("the state of a tracker cannot be written ({error})"), "report this as a fault")
}
