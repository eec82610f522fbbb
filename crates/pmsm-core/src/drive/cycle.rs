//! The cycle of the drive: measure, control, apply, advance; once per sampling period.

use super::control::Measured;
use super::control::{Controller, Reference};
use super::inverter::{self, Applied};
use super::manoeuvre::Manoeuvre;
use super::plant::Plant;
use super::schedule::Schedule;
use super::sensors::SensorBox;
use super::settings::{DriveSettings, Hold, Resolved};
use crate::base::{BASE, Base};
use crate::effect::Env;
use crate::effects::{ELECTRICAL_STATES, MECHANICAL_STATES, STATES};
use crate::error::{Error, Result};
use crate::machine::Machine;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::numerics::real::Real;
use crate::numerics::transforms::rotate;
use crate::recording::Load;
use crate::signals::REFERENCE_TEMPERATURE;

/// Samples between two looks at the monitor.
const LOOK: usize = 1024;

/// Base parameters that change in time, in the order of [`crate::machine::BaseParameter::ALL`]; a schedule replaces the
/// constant value. A changing inertia enters equation (2) as it stands, without a torque of its own.
pub type Drift = [Option<Schedule>; BASE];

/// The machine that is driven.
#[derive(Debug, Clone, Copy)]
pub struct Motor<'a> {
    /// Equations.
    pub model: &'a Model,
    /// Its parameter vector.
    pub p: &'a [f64],
    /// What changes in time.
    pub drift: &'a Drift,
}

/// The true state at a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Terminal current d, q in the true rotor frame, A.
    pub i: [f64; 2],
    /// Mechanical angle, rad, unwrapped.
    pub theta_m: f64,
    /// Mechanical speed, rad/s.
    pub omega_m: f64,
    /// Motor torque, N·m.
    pub tau_e: f64,
    /// Load torque, N·m.
    pub tau_load: f64,
    /// Base parameters.
    pub base: [f64; BASE],
}

/// One sample of the log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time, s, from the first sample of the recording.
    pub t: f64,
    /// Commanded mean voltage d, q that acts until the next sample, as the drive sees it, V.
    pub v: [f64; 2],
    /// What the sensors show.
    pub measured: Measured,
    /// The load torque as a transducer would show it, N·m.
    pub tau_m: f64,
    /// Winding and magnet temperature, °C, where they are given.
    pub temperature: [Option<f64>; 2],
    /// What is so.
    pub truth: State,
}

/// Simulates the drive and hands each sample of the recording to `sink`, until that returns false.
///
/// # Errors
/// Settings that make no sense ([`Error::Quantity`], [`Error::Unusable`], [`Error::Unknown`]); [`Error::Unusable`] where the
/// simulation diverges; [`Error::Interrupted`].
pub fn run(
    motor: &Motor,
    nameplate: &Machine,
    drive: &DriveSettings,
    manoeuvre: &Manoeuvre,
    seed: u64,
    monitor: &dyn Monitor,
    sink: &mut dyn FnMut(&Sample) -> bool,
) -> Result<()> {
    let cycle = Cycle { motor, nameplate, set: Resolved::new(drive, nameplate, manoeuvre)?, manoeuvre, seed };
    match (motor.model.electrical_states(), motor.model.mechanical_states()) {
        (0, 0) => cycle.run::<2, 1, 4>(monitor, sink),
        (0..=2, 0..=2) => cycle.run::<4, 3, 8>(monitor, sink),
        _ => cycle.run::<ELECTRICAL_STATES, MECHANICAL_STATES, STATES>(monitor, sink),
    }
}

struct Cycle<'a> {
    motor: &'a Motor<'a>,
    nameplate: &'a Machine,
    set: Resolved,
    manoeuvre: &'a Manoeuvre,
    seed: u64,
}

/// A command and the angle that the drive expects in the middle of its period.
#[derive(Debug, Clone, Copy)]
struct Command {
    v: [f64; 2],
    middle: f64,
    /// Half the angle turned during the period.
    half: f64,
}

impl Command {
    /// `periods` from the sample to the middle of the period in which it acts.
    fn new(v: [f64; 2], seen: &Measured, period: f64, periods: f64) -> Self {
        Self { v, middle: seen.theta_e + periods * period * seen.omega_e, half: 0.5 * period * seen.omega_e }
    }

    /// What of the command the rotor sees on average.
    fn logged(&self, hold: Hold) -> [f64; 2] {
        let share = if hold == Hold::Rotor || self.half == 0.0 { 1.0 } else { self.half.sin() / self.half };
        self.v.map(|x| x * share)
    }
}

impl Cycle<'_> {
    fn run<const E: usize, const M: usize, const N: usize>(
        &self,
        monitor: &dyn Monitor,
        sink: &mut dyn FnMut(&Sample) -> bool,
    ) -> Result<()> {
        let (set, model, n_p) = (&self.set, self.motor.model, self.motor.model.context().n_p);
        let (before, recorded) = set.samples;
        let h = set.period;
        let limit = inverter::longest(set.v_dc);
        let mut controller = Controller::new(set.gains, f64::from(self.nameplate.n_p), set.i_limit, limit, h);
        let mut sensors = SensorBox::new(&set.sensors, model, self.motor.p, self.seed, h);
        let start = Env {
            omega_e: self.manoeuvre.start_omega_m * n_p,
            theta_e: self.manoeuvre.start_theta_e,
            theta_m: self.manoeuvre.start_theta_e / n_p,
            ..self.around(0.0)
        };
        let locked = set.load == Load::Locked;
        let mut plant =
            Plant::<E, M, N>::new(model, self.motor.p, &start, self.load(0.0), locked, set.substeps);
        let mut pending: Option<Command> = None;
        let mut past = [[0.0; 2]; 2];
        let mut pieces = Vec::new();
        for number in 0..before + recorded {
            let t = (number as f64 - before as f64) * h;
            if number % LOOK == 0 {
                if monitor.cancelled() {
                    return Err(Error::Interrupted);
                }
                monitor.report("simulating", number as f64 / (before + recorded) as f64);
            }
            let around = self.around(t);
            let (base, values) = self.base(t);
            let env = plant.env(&around);
            let now = plant.magnetic(&base, &env);
            let (seen, angle_error) = sensors.measure(number, now.i, &env);
            let reference = self.reference(t);
            let command = if set.delay {
                pending.unwrap_or_else(|| Command::new(controller.first(seen.omega_e), &seen, h, 0.5))
            } else {
                Command::new(controller.step(&seen, &reference), &seen, h, 0.5)
            };
            if number == 0 {
                past = [command.v; 2];
            }
            if number >= before {
                let truth = State {
                    i: now.i,
                    theta_m: env.theta_m,
                    omega_m: env.omega_e / n_p,
                    tau_e: now.tau_e,
                    tau_load: self.load(t),
                    base: values,
                };
                let sample = Sample {
                    t,
                    v: command.logged(set.hold),
                    measured: seen,
                    tau_m: sensors.torque(number, truth.tau_load),
                    temperature: [&self.manoeuvre.temperature, &self.manoeuvre.temperature_magnet]
                        .map(|x| x.as_ref().map(|x| x.at(t))),
                    truth,
                };
                if !sink(&sample) {
                    return Ok(());
                }
            }
            let acting = model.command(self.motor.p, &[command.v, past[0], past[1]], env.omega_e * h);
            past = [command.v, past[0]];
            let middle = Env { t, ..self.around(t + 0.5 * h) };
            let tau_load = self.load(t + 0.5 * h);
            let base = self.base(t + 0.5 * h).0;
            if let Some(carriers) = set.carriers {
                let v = in_stator(acting, command.middle);
                inverter::switch(v, set.v_dc, h, carriers, number, &mut pieces);
                let mut at = middle;
                for (length, applied) in &pieces {
                    plant.advance(&base, &at, *length, *applied, tau_load);
                    at.t += length;
                }
            } else {
                let applied = match set.hold {
                    Hold::Stator => Applied::Stator(in_stator(acting, command.middle)),
                    // The drive turns its command with the angle that it sees.
                    Hold::Rotor => Applied::Rotor(rotate(acting, angle_error.cos(), angle_error.sin())),
                };
                plant.advance(&base, &middle, h, applied, tau_load);
            }
            if set.delay {
                pending = Some(Command::new(controller.step(&seen, &reference), &seen, h, 1.5));
            }
            if !plant.is_finite() {
                return Err(Error::unusable(
                    format!("the simulation diverges at t = {:.6} s", t + h),
                    "lower the bandwidths, raise f_sample or substeps, or check the parameters",
                ));
            }
        }
        Ok(())
    }

    /// Time and temperatures at `t`; where the machine is comes from its state.
    fn around(&self, t: f64) -> Env<f64> {
        let above = |x: &Option<Schedule>| x.as_ref().map_or(0.0, |x| x.at(t) - REFERENCE_TEMPERATURE);
        Env {
            t,
            omega_e: 0.0,
            theta_e: 0.0,
            theta_m: 0.0,
            heating: above(&self.manoeuvre.temperature),
            magnet_heating: above(&self.manoeuvre.temperature_magnet),
        }
    }

    fn load(&self, t: f64) -> f64 {
        self.manoeuvre.tau_load.as_ref().map_or(0.0, |x| x.at(t))
    }

    fn base(&self, t: f64) -> (Base<f64>, [f64; BASE]) {
        let values =
            std::array::from_fn(|k| self.motor.drift[k].as_ref().map_or(self.motor.p[k], |x| x.at(t)));
        (Base::new(&values), values)
    }

    fn reference(&self, t: f64) -> Reference {
        let at = |x: &Option<Schedule>| x.as_ref().map(|x| x.at(t));
        Reference {
            omega_m: at(&self.manoeuvre.omega_m),
            i: [&self.manoeuvre.i_d, &self.manoeuvre.i_q].map(|x| at(x).unwrap_or(0.0)),
        }
    }
}

/// A rotor-frame vector as it stands in the stator at this angle.
fn in_stator(v: [f64; 2], angle: f64) -> [f64; 2] {
    let (sin, cos) = Real::sin_cos(angle);
    rotate(v, cos, sin)
}
