//! The bench on which manoeuvres are tried before anybody runs them: the closed-loop drive around a fitted machine, within
//! the speed, current and voltage of the recording, with its log and its noise.

use super::manoeuvres::{Candidate, Limits};
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::drive::{self, Drift, DriveSettings, Motor, Schedule, Sensors};
use crate::error::{Error, Result};
use crate::experiment::split;
use crate::machine::{BaseParameter, Machine};
use crate::monitor::Monitor;
use crate::recording::{Kind, Load, Recording};
use crate::signals::Signals;
use crate::simulate::mechanical;
use std::f64::consts::TAU;

/// Shortest and longest manoeuvre, s, and most samples.
const DURATION: (f64, f64) = (0.5, 2.0);
const MOST_SAMPLES: f64 = 1e4;
/// A manoeuvre lasts this many times as long as standstill to full speed takes.
const RISES: f64 = 12.0;
/// Speed and current may exceed the recorded ones by this factor for a moment.
const OVERSHOOT: f64 = 1.15;
/// Sampling frequency over the current loop's bandwidth of a drive whose electrical side was not recorded.
const SLOWNESS: f64 = 100.0;

/// The bench.
pub struct Bench<'a> {
    data: &'a Data,
    nameplate: Machine,
    drive: DriveSettings,
    /// r_s, l_d, l_q, psi_m where the recording has no voltages: any drive that can follow.
    stand_in: Option<[f64; 4]>,
    /// What it bears.
    pub limits: Limits,
}

impl<'a> Bench<'a> {
    /// The bench of a recording (of the leading one of several), its drive set for the fitted machine.
    ///
    /// # Errors
    /// [`Error::Quantity`] for base parameters outside their physical range.
    pub fn new(data: &'a Data, fitted: &Hypothesis) -> Result<Self> {
        let data = data.leading();
        let (s, cx) = (&data.signals, &data.signals.context);
        let period = s.control_period.unwrap_or(s.period);
        let mut base = fitted.own()[..crate::base::BASE].to_vec();
        let psi_m = base[BaseParameter::PsiM.index()].max(1e-9);
        let torque = 1.5 * s.n_p * psi_m;
        let electrical = s.v.is_some();
        let current = if s.i.is_some() { cx.i_max } else { cx.tau_max / torque };
        let (mut v_dc, mut stand_in) = (3f64.sqrt() * cx.v_max, None);
        if !electrical {
            // Time constant and voltage are such that the current loop follows at this sampling rate.
            let l = 0.3 * psi_m / current;
            let r_s = l / (SLOWNESS * period);
            stand_in = Some([r_s, l, l, psi_m]);
            base[..4].copy_from_slice(&[r_s, l, l, psi_m]);
            v_dc = 10.0 * (psi_m * cx.omega_e_max + current * (r_s + l * cx.omega_e_max + l / period));
        }
        let mut nameplate = Machine::new(s.n_p as u32)?;
        for parameter in BaseParameter::ALL {
            let (low, high) = parameter.physical_range();
            nameplate = nameplate.with(parameter, base[parameter.index()].clamp(low.max(1e-12), high))?;
        }
        nameplate = nameplate.with_drive(Some(cx.v_dc), None, Some(1.0 / period))?;
        let agility = torque / base[BaseParameter::J.index()].max(1e-12);
        let omega_m = cx.omega_m_max();
        let rise = RISES * omega_m / (agility * current);
        let duration = rise.clamp(DURATION.0, DURATION.1).min(MOST_SAMPLES * period);
        let locked = s.load == Load::Locked;
        let drive = DriveSettings {
            v_dc: Some(v_dc),
            i_limit: Some(current),
            sensors: Sensors { log_theta_m: s.turn_known, ..Sensors::default() },
            ..DriveSettings::default()
        };
        let limits = Limits { omega_m, current, agility, locked, electrical, duration };
        Ok(Self { data, nameplate, drive, stand_in, limits })
    }

    /// What the load is during the manoeuvre, in words.
    pub fn load_words(&self) -> String {
        match self.data.signals.load {
            Load::None | Load::Measured => " at no load".into(),
            Load::KnownConstant(x) => format!(" at the known load of {} N m", super::digits(x)),
            Load::UnknownConstant | Load::UnknownPiecewise => " at a constant load".into(),
            Load::Locked => String::new(),
        }
    }

    /// Runs a manoeuvre with the machine of a hypothesis; `None` where the drive cannot do it or would leave the limits.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn run(
        &self,
        truth: &Hypothesis,
        candidate: &Candidate,
        monitor: &dyn Monitor,
    ) -> Result<Option<Data>> {
        match self.log(truth, candidate, monitor) {
            Ok(trial) => Ok(Some(trial).filter(|t| self.is_safe(t))),
            Err(Error::Interrupted) => Err(Error::Interrupted),
            // What this drive cannot do with this machine is no manoeuvre to propose.
            Err(_) => Ok(None),
        }
    }

    fn log(&self, truth: &Hypothesis, candidate: &Candidate, monitor: &dyn Monitor) -> Result<Data> {
        let mut p = truth.own().to_vec();
        if let Some(electrical) = &self.stand_in {
            p[..4].copy_from_slice(electrical);
        }
        let mut manoeuvre = candidate.manoeuvre.clone();
        let load = self.data.signals.load;
        let level = match load {
            Load::KnownConstant(x) => x,
            _ => level(truth),
        };
        if !matches!(load, Load::None | Load::Measured | Load::Locked) {
            manoeuvre.tau_load = Some(Schedule::constant(level)?);
        }
        manoeuvre.load_kind = Some(
            match load {
                Load::None | Load::Measured => "none",
                Load::UnknownConstant | Load::UnknownPiecewise => "unknown_constant",
                Load::KnownConstant(_) | Load::Locked => load.kind(),
            }
            .into(),
        );
        let cx = truth.model.context();
        let cold = Schedule::constant(crate::signals::REFERENCE_TEMPERATURE)?;
        manoeuvre.temperature = cx.has_temperature.then(|| cold.clone());
        manoeuvre.temperature_magnet = cx.has_magnet_temperature.then_some(cold);
        let drift: Drift = std::array::from_fn(|_| None);
        let motor = Motor { model: &truth.model, p: &p, drift: &drift };
        let recording = drive::record(&motor, &self.nameplate, &self.drive, &manoeuvre, 1, monitor)?;
        let signals = Signals::new(&self.as_logged(recording, truth, &p)?, &self.nameplate)?;
        let mut trial = Data::new(signals, &self.nameplate, &self.data.options)?;
        for floor in &mut trial.floors {
            if let Some(known) = self.data.floors.iter().find(|f| f.channel == floor.channel) {
                *floor = *known;
            }
        }
        Ok(trial)
    }

    /// The columns that this bench logs.
    fn as_logged(&self, recording: Recording, truth: &Hypothesis, p: &[f64]) -> Result<Recording> {
        let known = &self.data.signals;
        let mut names = vec!["t", "omega_e", "theta_e", "temperature", "temperature_magnet"];
        if known.turn_known {
            names.push("theta_m");
        }
        if known.v.is_some() {
            names.extend(["v_d", "v_q"]);
        }
        let mut columns: Vec<(String, Vec<f64>)> = Vec::new();
        match (&known.tau_e, &known.i, &known.phases) {
            (None, Some(_), Some(_)) => {
                let measured = (0..3).filter(|x| known.context.completed_phase != Some(*x));
                names.extend(measured.map(|x| ["i_a", "i_b", "i_c"][x]));
            }
            (tau_e, ..) => {
                let seen = Signals::new(&recording, &self.nameplate)?;
                if tau_e.is_some() {
                    columns.push(("tau_e".into(), mechanical::torque(&truth.model, &seen, p)));
                }
                if let (Some([d, q]), Some(_)) = (seen.i, &known.i) {
                    columns.extend([("i_d".into(), d), ("i_q".into(), q)]);
                }
            }
        }
        let taken = names.into_iter().filter_map(|n| Some((n.to_string(), recording.column(n)?.to_vec())));
        columns.extend(taken);
        Recording::new(columns, Some(recording.load()))
    }

    fn is_safe(&self, trial: &Data) -> bool {
        let (reached, allowed) = (&trial.signals.context, &self.limits);
        let currents = match trial.signals.kind {
            Kind::Mechanical => true,
            _ => reached.i_max <= OVERSHOOT * allowed.current,
        };
        currents && reached.omega_m_max() <= OVERSHOOT * allowed.omega_m.max(1e-6 * TAU)
    }
}

/// Mean of the unknown load's levels, N·m; zero without any.
pub fn level(hypothesis: &Hypothesis) -> f64 {
    let left_open = &hypothesis.parameters[hypothesis.own().len()..];
    let levels = split(&hypothesis.nuisances, left_open).flat_map(|(n, own)| &own[..n.levels]);
    let count = hypothesis.nuisances.iter().map(|n| n.levels).sum::<usize>();
    levels.sum::<f64>() / count.max(1) as f64
}
