//! A closed-loop drive around a machine with any effects: Fig. 4 of Liu, Liu & Cartes (2008). It makes recordings whose
//! truth is known, and tries out manoeuvres before a bench does.
//!
//! Once per sampling period the sensors are read, a PI speed controller and two PI current controllers compute a
//! voltage, and an inverter with a DC-link limit applies it one period later ([`cycle`]). The machine is the project's
//! own [`crate::model`], integrated by Runge–Kutta steps within each period or between switching edges.
//!
//! [`simulate`] does everything from a [`Setup`]; [`record`] takes a model that is already there, with its parameter
//! vector, and returns the recording alone.
//!
//! ```
//! use pmsm_core::drive::{Manoeuvre, Schedule, Setup, simulate};
//! use pmsm_core::machine::Machine;
//! use pmsm_core::monitor::Silent;
//!
//! let mut setup = Setup::new(Machine::liu_2008(), Manoeuvre::new(0.2));
//! setup.manoeuvre.omega_m = Some(Schedule::constant(50.0)?);
//! setup.manoeuvre.tau_load = Some(Schedule::constant(3.0)?);
//! let simulation = simulate(&setup, &Silent)?;
//! let speed = simulation.recording.column("omega_e").unwrap();
//! assert!((speed.last().unwrap() / 4.0 - 50.0).abs() < 0.5);
//! # Ok::<(), pmsm_core::error::Error>(())
//! ```

mod choice;
mod control;
pub mod cycle;
mod inverter;
mod manoeuvre;
mod plant;
mod schedule;
mod sensors;
mod settings;
mod truth;

pub use choice::Choice;
pub use control::{Control, Measured};
pub use cycle::{Drift, Motor, Sample, State, run};
pub use manoeuvre::Manoeuvre;
pub use schedule::{Schedule, Shape};
pub use settings::{DriveSettings, Hold, Inverter, Sensors, SpeedSensor};
pub use truth::{EffectTruth, Truth, Value};

use crate::base::BASE;
use crate::effect::Context;
use crate::error::{Error, Result};
use crate::machine::{BaseParameter, Machine};
use crate::model::Model;
use crate::monitor::Monitor;
use crate::recording::{Load, Recording};
use crate::signals::electrical_rate;
use crate::specification::{MapPart, laid};
use settings::Resolved;
use std::f64::consts::TAU;

/// A whole simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// The true machine; all base parameters must be known.
    pub machine: Machine,
    /// What the drive believes of the machine; its v_dc, i_rated and f_sample are the drive's where that names none.
    pub nameplate: Machine,
    /// Effects of the machine and its sensors.
    pub effects: Vec<Choice>,
    /// Missing voltage or torque without a name.
    pub map: Vec<MapPart>,
    /// The scales at which the effects' parameters are meant, where they are not those of this drive.
    pub scales: Option<Context>,
    /// Base parameters that change in time.
    pub drift: Drift,
    /// The drive.
    pub drive: DriveSettings,
    /// What it does.
    pub manoeuvre: Manoeuvre,
    /// Seed of the noise.
    pub seed: u64,
}

impl Setup {
    /// A drive of default settings that knows its machine, without effects.
    pub fn new(machine: Machine, manoeuvre: Manoeuvre) -> Self {
        Self {
            nameplate: machine.clone(),
            machine,
            effects: Vec::new(),
            map: Vec::new(),
            scales: None,
            drift: std::array::from_fn(|_| None),
            drive: DriveSettings::default(),
            manoeuvre,
            seed: 1,
        }
    }
}

/// A recording with its truth.
#[derive(Debug, Clone)]
pub struct Simulation {
    /// What a bench would have logged.
    pub recording: Recording,
    /// What was so.
    pub truth: Truth,
}

/// Simulates a whole setup.
///
/// # Errors
/// Those of [`run`]; [`Error::Unusable`] where the machine is not fully known; [`Error::Unknown`] and [`Error::Quantity`] for
/// effects and parameters that do not exist or have no meaning.
pub fn simulate(setup: &Setup, monitor: &dyn Monitor) -> Result<Simulation> {
    let base = known(&setup.machine)?;
    let drift_names = BaseParameter::ALL.into_iter().zip(&setup.drift);
    for (parameter, schedule) in drift_names.filter_map(|(p, s)| Some((p, s.as_ref()?))) {
        for (_, value) in schedule.points() {
            setup.machine.clone().with(parameter, *value)?;
        }
    }
    let scales = match setup.scales {
        Some(scales) => Context { n_p: f64::from(setup.machine.n_p), ..scales },
        None => scales(setup, &base)?,
    };
    let mut p = base.to_vec();
    let mut effects = Vec::with_capacity(setup.effects.len());
    for choice in &setup.effects {
        let (effect, values) = choice.resolve(&scales)?;
        if effects.contains(&effect) {
            return Err(Error::unusable(
                format!("the effect {} is named twice", choice.effect),
                "name it once",
            ));
        }
        effects.push(effect);
        p.extend(values);
    }
    let model = laid(Model::new(scales, &effects), &setup.map, &mut p)?;
    let motor = Motor { model: &model, p: &p, drift: &setup.drift };
    let mut truth = Truth::new(&motor);
    let mut log = Log::default();
    run(&motor, &setup.nameplate, &setup.drive, &setup.manoeuvre, setup.seed, monitor, &mut |sample| {
        log.push(sample);
        truth.push(&motor, sample);
        true
    })?;
    let recording = log.finish(&setup.drive, &setup.manoeuvre)?;
    truth.finish(&motor, &setup.nameplate, recording.period());
    Ok(Simulation { recording, truth })
}

/// Simulates a model that is already there and returns the recording alone.
///
/// # Errors
/// Those of [`run`], and those of [`Recording::new`].
pub fn record(
    motor: &Motor,
    nameplate: &Machine,
    drive: &DriveSettings,
    manoeuvre: &Manoeuvre,
    seed: u64,
    monitor: &dyn Monitor,
) -> Result<Recording> {
    let mut log = Log::default();
    run(motor, nameplate, drive, manoeuvre, seed, monitor, &mut |sample| {
        log.push(sample);
        true
    })?;
    log.finish(drive, manoeuvre)
}

fn known(machine: &Machine) -> Result<[f64; BASE]> {
    let mut base = [0.0; BASE];
    for p in BaseParameter::ALL {
        base[p.index()] = machine.get(p).ok_or_else(|| {
            Error::unusable(
                format!("the machine's {} is not known", p.name()),
                "a simulation needs r_s, l_d, l_q, psi_m, j and b",
            )
        })?;
    }
    Ok(base)
}

/// The scales at which effects are meant: limits of the drive, the fastest reference, the flux at the current limit.
fn scales(setup: &Setup, base: &[f64; BASE]) -> Result<Context> {
    let set = Resolved::new(&setup.drive, &setup.nameplate, &setup.manoeuvre)?;
    let n_p = f64::from(setup.machine.n_p);
    let [_, _, l_q, psi_m, _, _] = *base;
    let v_max = inverter::longest(set.v_dc);
    let fastest = setup.manoeuvre.omega_m.as_ref().map_or(0.0, Schedule::peak);
    let omega_e_max = match n_p * fastest.max(setup.manoeuvre.start_omega_m.abs()) {
        0.0 => v_max / psi_m.max(1e-9),
        omega => omega,
    };
    let psi_max = psi_m.hypot(l_q * set.i_limit);
    Ok(Context {
        n_p,
        i_max: set.i_limit,
        v_max,
        omega_e_max,
        tau_max: 1.5 * n_p * psi_max * set.i_limit,
        psi_max,
        swing: TAU,
        duration: setup.manoeuvre.duration,
        period: set.period,
        v_dc: set.v_dc,
        electrical_rate: electrical_rate(&setup.machine),
        zero_sequence: 0.0,
        completed_phase: None,
        load_known: false,
        steady: false,
        has_temperature: setup.manoeuvre.temperature.is_some(),
        has_magnet_temperature: setup.manoeuvre.temperature_magnet.is_some(),
    })
}

/// Columns of the recording as they fill.
#[derive(Debug, Default)]
struct Log {
    columns: [Vec<f64>; 8],
    theta_m: Vec<f64>,
    tau_m: Vec<f64>,
    temperatures: [Vec<f64>; 2],
}

impl Log {
    const NAMES: [&'static str; 8] = ["t", "v_d", "v_q", "i_a", "i_b", "i_c", "theta_e", "omega_e"];

    fn push(&mut self, sample: &Sample) {
        let Measured { abc: [a, b, c], theta_e, theta_m, omega_e, .. } = sample.measured;
        let wrapped = |x: f64| x - TAU * (x / TAU).round();
        let row = [sample.t, sample.v[0], sample.v[1], a, b, c, wrapped(theta_e), omega_e];
        for (column, x) in self.columns.iter_mut().zip(row) {
            column.push(x);
        }
        self.theta_m.push(wrapped(theta_m));
        self.tau_m.push(sample.tau_m);
        for (column, x) in self.temperatures.iter_mut().zip(sample.temperature) {
            column.extend(x);
        }
    }

    fn finish(self, drive: &DriveSettings, manoeuvre: &Manoeuvre) -> Result<Recording> {
        let load = manoeuvre.load()?;
        let mut columns: Vec<(String, Vec<f64>)> =
            Self::NAMES.into_iter().map(String::from).zip(self.columns).collect();
        if drive.sensors.log_theta_m {
            columns.push(("theta_m".into(), self.theta_m));
        }
        if load == Load::Measured {
            columns.push(("tau_m".into(), self.tau_m));
        }
        for (name, values) in ["temperature", "temperature_magnet"].into_iter().zip(self.temperatures) {
            if !values.is_empty() {
                columns.push((name.into(), values));
            }
        }
        Recording::new(columns, Some(load))
    }
}
