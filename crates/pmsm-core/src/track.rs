//! Online identification as in Liu, Liu & Cartes (2008), section V: a stream of samples is cut into windows, each
//! window is identified from the last one's result, and what moved between them is read as heat, load, or a model that
//! leaves something out.
//!
//! ```
//! use pmsm_core::{machine::Machine, monitor::Silent, track::{Settings, Tracker}};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut tracker = Tracker::new(Machine::liu_2008(), Settings::default())?;
//! # let (t, zero) = (vec![0.0, 1e-5], vec![0.0; 2]);
//! let batch = [("t", &t[..]), ("v_d", &zero[..]), ("v_q", &zero[..]), ("i_d", &zero[..]), ("i_q", &zero[..]), ("omega_e", &zero[..])];
//! for window in tracker.update(&batch, &Silent)? {
//!     println!("{:.3} s: {}", window.t_end, window.drift.sentence);
//! }
//! let tracker = Tracker::restore(&tracker.state()?)?; // goes on bit for bit
//! # Ok(())
//! # }
//! ```
//!
//! Memory does not grow with time: one window of samples and a few dozen past results are kept. How the stream is cut
//! into batches changes nothing.

mod drift;
mod intake;
mod noise;
mod state;
mod window;

pub use drift::{Cause, Drift};
pub use window::{Status, Window};

use crate::error::{Error, Result};
use crate::identify::{Method, Target};
use crate::machine::{BaseParameter, Machine};
use crate::monitor::Monitor;
use crate::optimise::swarm::SwarmSettings;
use crate::recording::Load;
use drift::History;
use intake::Intake;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Longest window, s.
const LONGEST: f64 = 3600.0;

/// What a [`Tracker`] does.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Parameters to fit, each with its bounds in SI units or `None` for a wide range around the nameplate. An unknown
    /// load is fitted along with anything that acts on the speed.
    pub fit: Vec<(Target, Option<(f64, f64)>)>,
    /// Length of a window, s; the paper's is 0.033.
    pub window: f64,
    /// The paper's swarm, or warm least squares, which is faster and closer.
    pub method: Method,
    /// Settings of the swarm.
    pub swarm: SwarmSettings,
    /// The swarm seeks within this share of the last result to either side, and farther if its best lies on the edge.
    /// The paper leaves it open.
    pub search: f64,
    /// Seed of the first window's swarm; window k has this plus k.
    pub seed: u64,
    /// What is known of the load; `None` as in [`crate::recording::Recording::new`].
    pub load: Option<Load>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            fit: vec![(Target::Base(BaseParameter::RS), None), (Target::TauLoad, None)],
            window: 0.033,
            method: Method::LeastSquares,
            swarm: SwarmSettings::default(),
            search: 0.2,
            seed: 1,
            load: None,
        }
    }
}

impl Settings {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Quantity`] naming the first one out of range; [`Error::Unusable`] for no parameter or one named twice.
    pub fn validate(&self) -> Result<()> {
        if !(self.window > 0.0 && self.window <= LONGEST) {
            let expected = "give the length of a window, above 0 and at most 3600";
            return Err(Error::quantity("window", self.window, "s", expected));
        }
        if !(self.search > 0.0 && self.search <= 10.0) {
            let expected = "give a share of the last result, above 0 and at most 10";
            return Err(Error::quantity("search", self.search, "", expected));
        }
        if self.fit.is_empty() {
            return Err(Error::unusable("no parameter to fit was named", "name r_s, tau_load or others"));
        }
        for (k, (target, bounds)) in self.fit.iter().enumerate() {
            if self.fit[..k].iter().any(|(t, _)| t == target) {
                return Err(Error::unusable(format!("{} is named twice", target.name()), "name it once"));
            }
            if let Some((low, high)) = bounds.filter(|(low, high)| !(low < high && (high - low).is_finite()))
            {
                let at = if low.is_finite() { high } else { low };
                let expected = "give two finite bounds, the lower one first";
                return Err(Error::quantity(
                    &format!("bound of {}", target.name()),
                    at,
                    target.unit(),
                    expected,
                ));
            }
        }
        if let Some(Load::KnownConstant(value)) =
            self.load.filter(|l| matches!(l, Load::KnownConstant(x) if !x.is_finite()))
        {
            return Err(Error::quantity("value of [load]", value, "N m", "give a finite torque"));
        }
        self.swarm.validate()
    }
}

/// What changes from window to window.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Progress {
    intake: Intake,
    /// The last result.
    warm: Vec<(Target, f64)>,
    history: History,
}

/// Follows parameters through a stream of samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Tracker {
    machine: Machine,
    settings: Settings,
    /// Shared with clones until one of them goes on.
    progress: Arc<Progress>,
}

impl Tracker {
    /// A tracker that has seen nothing yet.
    ///
    /// # Errors
    /// Those of [`Settings::validate`].
    pub fn new(machine: Machine, settings: Settings) -> Result<Self> {
        settings.validate()?;
        let progress =
            Progress { intake: Intake::new(settings.window), warm: Vec::new(), history: History::default() };
        Ok(Self { machine, settings, progress: Arc::new(progress) })
    }

    /// What it was told to do.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The nameplate.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Takes in samples, columns by canonical name in SI units and all of one length, and returns the windows that they
    /// complete. Rows with a value that is not finite are left out and counted; so are rows whose time repeats or runs a
    /// little back. Where time runs far back the log was restarted: a window ends there, and another begins.
    ///
    /// An error, the monitor's stop ([`Error::Interrupted`]) included, leaves the tracker as it was: nothing of the batch was
    /// taken in, and the same batch can be given again.
    ///
    /// # Errors
    /// [`Error::Unknown`] for a column that is none; [`Error::Column`] for columns of different length, other columns
    /// than before, or a set of columns from which nothing can be learnt; [`Error::Unusable`] for a window of more samples
    /// than are kept. What goes wrong within one window is said in that [`Window`] instead.
    pub fn update(&mut self, batch: &[(&str, &[f64])], monitor: &dyn Monitor) -> Result<Vec<Window>> {
        self.transact(|progress, windows, judge| {
            let columns = progress.intake.columns(batch)?;
            let mut row = progress.intake.keep(&columns, 0);
            while row < columns.len() {
                for cut in progress.intake.push(&columns, row)? {
                    windows.push(judge(cut, &mut progress.warm, &mut progress.history, monitor)?);
                }
                row += 1;
                row += progress.intake.keep(&columns, row);
            }
            Ok(())
        })
    }

    /// Ends the window that is under way: the stream is over. Further samples begin a window of their own.
    ///
    /// # Errors
    /// As [`Tracker::update`].
    pub fn finish(&mut self, monitor: &dyn Monitor) -> Result<Vec<Window>> {
        self.transact(|progress, windows, judge| {
            if let Some(cut) = progress.intake.finish() {
                windows.push(judge(cut, &mut progress.warm, &mut progress.history, monitor)?);
            }
            Ok(())
        })
    }

    fn transact(
        &mut self,
        work: impl FnOnce(&mut Progress, &mut Vec<Window>, &Judge) -> Result<()>,
    ) -> Result<Vec<Window>> {
        let mut progress = Progress::clone(&self.progress);
        let mut windows = Vec::new();
        let judge = |cut, warm: &mut _, history: &mut _, monitor: &dyn Monitor| {
            window::judge(cut, &self.machine, &self.settings, warm, history, monitor)
        };
        work(&mut progress, &mut windows, &judge)?;
        self.progress = Arc::new(progress);
        Ok(windows)
    }

    /// Everything it knows as JSON text, schema `pmsm-rs.tracker/1`. [`Tracker::restore`] goes on bit for bit.
    ///
    /// # Errors
    /// [`Error::Unusable`] if the state cannot be written, which only a fault of this crate could cause.
    pub fn state(&self) -> Result<String> {
        state::write(self)
    }

    /// The tracker whose state this is.
    ///
    /// # Errors
    /// [`Error::Unusable`] if the text is too long, of another schema, damaged, or holds values that no tracker has.
    pub fn restore(text: &str) -> Result<Self> {
        state::read(text)
    }
}

type Judge<'a> =
    dyn Fn(intake::Cut, &mut Vec<(Target, f64)>, &mut History, &dyn Monitor) -> Result<Window> + 'a;
