//! One window: identified from the last one's result, or why it could not be.

use super::Settings;
use super::drift::{Drift, History, Past};
use super::intake::Cut;
use super::noise::noise;
use crate::error::{Error, Result};
use crate::identify::{self, Identification, Request, Target, Warm};
use crate::machine::Machine;
use crate::monitor::Monitor;
use crate::optimise::uncertainty::{Estimate, NotShown};
use crate::pairs;
use crate::recording::{FEWEST_SAMPLES, Load, Recording};
use crate::signals::{Finding, Signals};
use serde::Serialize;

/// A window with less than this share of its samples is not identified.
const LEAST_SHARE: f64 = 0.25;
/// A window with less than this share of its samples is called short.
const FULL: f64 = 0.9;

/// What became of a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// It was identified.
    Estimated,
    /// It was not; [`Window::why`] says why.
    Skipped,
}

/// The result of one window; serialises to the object that is written to files.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Window {
    /// Its number, from 0.
    pub window: u64,
    /// Its beginning, s of the log's own time.
    pub t_start: f64,
    /// Its end, s of the log's own time.
    pub t_end: f64,
    /// Samples that were used.
    pub samples: usize,
    /// What became of it.
    pub status: Status,
    /// Why it was skipped.
    pub why: Option<String>,
    /// What happened to the log in it: gaps, lost rows, a restart, an early end.
    pub notes: Vec<Finding>,
    /// Estimates by name.
    #[serde(serialize_with = "pairs::as_map")]
    pub parameters: Vec<(&'static str, Estimate)>,
    /// Disturbed load torque (4), N·m, mean over the window: what the load seems to be with the nameplate's J and B.
    pub disturbed_load_torque: Option<f64>,
    /// The fitness (9) at the start, of generation 0 with the swarm, and at the end.
    pub cost_first: Option<f64>,
    /// The fitness (9) at the answer.
    pub cost: Option<f64>,
    /// Best cost after each generation of the swarm, then after each step of least squares.
    pub history: Vec<f64>,
    /// Number of evaluations of the fitness.
    pub evaluations: usize,
    /// Whether the search came to rest.
    pub converged: bool,
    /// Whether the swarm had to look farther than [`Settings::search`].
    pub widened: bool,
    /// Parameters, or combinations of them, that this window does not show.
    pub cannot_show: Vec<NotShown>,
    /// Root mean square of measured minus model per channel, in the channel's SI unit.
    #[serde(serialize_with = "pairs::as_map")]
    pub rms: Vec<(&'static str, f64)>,
    /// White noise of the measurement per channel, in the channel's SI unit.
    #[serde(serialize_with = "pairs::as_map")]
    pub noise: Vec<(&'static str, f64)>,
    /// What moved since earlier windows, and what that looks like.
    pub drift: Drift,
}

impl Window {
    /// The estimate of a parameter.
    pub fn get(&self, name: &str) -> Option<&Estimate> {
        self.parameters.iter().find(|(n, _)| *n == name).map(|(_, e)| e)
    }

    fn skipped(cut: Cut, samples: usize, why: String) -> Self {
        let drift = Drift::unknown();
        Self {
            window: cut.number,
            t_start: cut.span[0],
            t_end: cut.span[1],
            samples,
            status: Status::Skipped,
            why: Some(why),
            notes: cut.notes,
            parameters: Vec::new(),
            disturbed_load_torque: None,
            cost_first: None,
            cost: None,
            history: Vec::new(),
            evaluations: 0,
            converged: false,
            widened: false,
            cannot_show: Vec::new(),
            rms: Vec::new(),
            noise: Vec::new(),
            drift,
        }
    }
}

/// Identifies a window and notes its result. A window that cannot be identified is returned as skipped and moves nothing.
///
/// # Errors
/// [`Error::Interrupted`] once the monitor says stop; errors of the stream as a whole: columns from which nothing can be
/// learnt, bounds outside the physical range.
pub fn judge(
    mut cut: Cut,
    machine: &Machine,
    settings: &Settings,
    warm: &mut Vec<(Target, f64)>,
    history: &mut History,
    monitor: &dyn Monitor,
) -> Result<Window> {
    let samples = cut.columns.first().map_or(0, |(_, t)| t.len());
    if samples < FEWEST_SAMPLES || (samples as f64) < LEAST_SHARE * cut.expected {
        let why = match samples {
            0 => "it has no usable sample".into(),
            _ => format!("it has only {samples} usable samples of {:.0}", cut.expected.max(samples as f64)),
        };
        return Ok(Window::skipped(cut, samples, why));
    }
    if (samples as f64) < FULL * cut.expected {
        let share = 100.0 * samples as f64 / cut.expected;
        cut.notes.push(Finding {
            finding: format!("the window has {share:.0} % of its samples"),
            consequence: "its estimates are less certain".into(),
            fix: "none needed at the end of a log".into(),
        });
    }
    // Steps of the load are what windows are for: within one it is taken as constant.
    let load = match settings.load {
        Some(Load::UnknownPiecewise) => Some(Load::UnknownConstant),
        other => other,
    };
    let recording = Recording::new(std::mem::take(&mut cut.columns), load)?;
    let signals = match Signals::in_rotor_frame(&recording, machine) {
        Ok(signals) => signals,
        Err(error) => return Ok(Window::skipped(cut, samples, error.to_string())),
    };
    let of_gaps =
        |f: &&Finding| ["one gap in time", "gaps in time"].iter().any(|told| f.finding.contains(told));
    cut.notes.extend(signals.findings.iter().filter(of_gaps).cloned());
    let (noise, heat, n) = (noise(&signals), heat(&signals), signals.len());
    let seed = settings.seed.wrapping_add(cut.number);
    let mut fit = settings.fit.clone();
    // A load that was fitted along is fitted from its last value.
    fit.extend(
        warm.iter().filter(|(t, _)| !settings.fit.iter().any(|(f, _)| f == t)).map(|(t, _)| (*t, None)),
    );
    let request = Request { fit, method: settings.method, swarm: settings.swarm, seed, uncertainties: true };
    let begin = Warm { values: warm, share: settings.search };
    let (found, widened) = match identify::identify_warm(signals, machine, &request, begin, monitor) {
        _ if monitor.cancelled() => return Err(Error::Interrupted),
        Ok(found) => found,
        Err(error @ (Error::Quantity { .. } | Error::Interrupted)) => return Err(error),
        Err(error) => return Ok(Window::skipped(cut, samples, error.to_string())),
    };
    remember(warm, &found);
    let drift = history.read(&past(&cut, &found, heat), &found.rms, &noise, n);
    Ok(Window {
        window: cut.number,
        t_start: cut.span[0],
        t_end: cut.span[1],
        samples,
        status: Status::Estimated,
        why: None,
        notes: cut.notes,
        cost_first: found.history.first().copied().filter(|x| x.is_finite()),
        cost: Some(found.cost).filter(|x| x.is_finite()),
        parameters: found.parameters,
        disturbed_load_torque: found.disturbed_load_torque,
        history: found.history.into_iter().filter(|x| x.is_finite()).collect(),
        evaluations: found.evaluations,
        converged: found.converged,
        widened,
        cannot_show: found.cannot_show,
        rms: found.rms,
        noise: noise.into_iter().map(|n| (n.channel, n.sigma)).collect(),
        drift,
    })
}

/// What this window has shown is where the next one begins, uncertain or not: the paper's swarm seldom comes to rest.
fn remember(warm: &mut Vec<(Target, f64)>, found: &Identification) {
    for target in Target::ALL {
        let value = found.get(target.name()).and_then(|e| e.value).filter(|x| x.is_finite());
        let Some(value) = value.filter(|_| !hidden(found, target)) else { continue };
        match warm.iter_mut().find(|(t, _)| *t == target) {
            Some((_, last)) => *last = value,
            None => warm.push((target, value)),
        }
    }
}

/// Whether the window does not show a parameter, or only along with others.
fn hidden(found: &Identification, target: Target) -> bool {
    found.cannot_show.iter().any(|x| x.parameters.iter().any(|name| name == target.name()))
}

/// Value and standard error of a parameter that the window shows.
fn shown(found: &Identification, target: Target) -> Option<(f64, f64)> {
    let estimate = found.get(target.name())?;
    let (value, stderr) = (estimate.value?, estimate.stderr?);
    (!hidden(found, target) && value.is_finite() && stderr.is_finite() && stderr > 0.0)
        .then_some((value, stderr))
}

fn past(cut: &Cut, found: &Identification, heat: Option<f64>) -> Past {
    let t = 0.5 * (cut.span[0] + cut.span[1]);
    let values = Target::ALL
        .into_iter()
        .filter_map(|target| shown(found, target).map(|(x, s)| (target, x, s)))
        .collect();
    Past { t, heat, values }
}

/// Mean square of the current vector, A²: what heats the winding.
fn heat(signals: &Signals) -> Option<f64> {
    let [d, q] = signals.i.as_ref()?;
    Some(d.iter().zip(q).map(|(d, q)| d * d + q * q).sum::<f64>() / d.len() as f64)
}
