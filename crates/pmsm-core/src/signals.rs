//! A recording in the form in which the models are driven by it: rotor-frame voltages and currents, unwrapped angles,
//! electrical speed, and the scales of the run.

mod angle;
mod clock;
mod decimation;
mod derived;
mod held;
pub mod join;
mod lag;
mod limits;
mod low_pass;
mod mend;
mod one_axis;
mod open_circuit;
mod phases;
mod scales;
mod steady_points;
mod turned;

use crate::effect::Context;
use crate::error::{Error, Result};
use crate::machine::Machine;
use crate::recording::{Kind, Load, Recording};
use angle::{check_sense, integrate, unwrap};
pub use decimation::Within;
pub use held::Logged;
pub use limits::{Limits, SensorNoise};
use mend::mend;
use phases::Currents;
pub(crate) use scales::electrical_rate;
use serde::Serialize;
use std::ops::Range;

/// Temperature to which r_s and psi_m refer where temperatures are logged, °C; the same for all recordings of a machine.
pub const REFERENCE_TEMPERATURE: f64 = 20.0;

/// Something about the data that a user should know, what follows from it and how to record better.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// What was found.
    pub finding: String,
    /// What it does to the answer.
    pub consequence: String,
    /// What to do about it.
    pub fix: String,
}

impl Finding {
    /// As the reason of a verdict: what was found, and what to do about it.
    pub fn reason(&self) -> String {
        format!("{}; {}", self.finding, self.fix)
    }
}

/// Time signals of one recording; all vectors have one entry per sample.
#[derive(Debug, Clone)]
pub struct Signals {
    /// Sample times, s, from zero.
    pub t: Vec<f64>,
    /// Runs of samples without a gap.
    pub segments: Vec<Range<usize>>,
    /// Median sample period, s.
    pub period: f64,
    /// Period of the drive's control, s, where the machine file tells it.
    pub control_period: Option<f64>,
    /// Rotor-frame voltage acting from each sample to the next, V; zero on an axis that was not logged.
    pub v: Option<[Vec<f64>; 2]>,
    /// Rows of the log whose mean each sample is, where steady points were taken from a waveform; one elsewhere.
    pub averaged: usize,
    /// What drives the motor within each sample, where that stands for several of the log.
    pub within: Option<Within>,
    /// Where the voltage is held in the stator's frame over a control period, as inverters do, and not in the rotor's: what of it is logged.
    pub stator_held: Option<Logged>,
    /// Whether the voltage of a row was taken for that of its instant, and drawn straight from row to row.
    pub voltages_drawn: bool,
    /// Time constant of a low pass that was taken out of the currents, s.
    pub current_filter: Option<f64>,
    /// Whether the link voltage was stated or logged; else it is the least that makes the largest voltage.
    pub link_stated: bool,
    /// Whether an angle in steps was taken for the lower end of its step, and moved to the middle.
    pub middle_of_steps: bool,
    /// Whether the voltages were logged as those of the phases, in place of a command seen from the rotor.
    pub phase_voltages: bool,
    /// Whether the voltage of the d and of the q axis was logged.
    pub axes: [bool; 2],
    /// Whether the currents were logged as those of the phases, which the angle turns into the rotor's frame.
    pub phase_currents: bool,
    /// Rotor-frame current in the logged frame, A.
    pub i: Option<[Vec<f64>; 2]>,
    /// Phase currents as logged (a missing third completed to zero sum), A.
    pub phases: Option<[Vec<f64>; 3]>,
    /// Electrical angle, rad, unwrapped; integrated from the speed if `angle_known` is false.
    pub theta_e: Vec<f64>,
    /// Mechanical angle, rad, unwrapped; up to whole electrical turns unless the mechanical angle is logged.
    pub theta_m: Vec<f64>,
    /// Whether an angle was logged.
    pub angle_known: bool,
    /// Whether the angle was taken from the voltages, here or before; `angle_known` is true then.
    pub angle_from_voltages: bool,
    /// Whether the mechanical angle was logged, so that runs agree on whole electrical turns.
    pub turn_known: bool,
    /// Whether three phase currents were logged.
    pub three_currents: bool,
    /// Electrical speed, rad/s.
    pub omega_e: Vec<f64>,
    /// Whether the speed is the logged one (else that of the angle).
    pub speed_known: bool,
    /// What the log adds to the noise of its sensors.
    pub limits: Limits,
    /// Motor torque where it was recorded, N·m.
    pub tau_e: Option<Vec<f64>>,
    /// Measured load torque, N·m.
    pub tau_m: Option<Vec<f64>>,
    /// Winding temperature above [`REFERENCE_TEMPERATURE`], K.
    pub heating: Option<Vec<f64>>,
    /// Magnet temperature above [`REFERENCE_TEMPERATURE`], K.
    pub magnet_heating: Option<Vec<f64>>,
    /// What is known of the load.
    pub load: Load,
    /// Which questions the recording can answer.
    pub kind: Kind,
    /// Pole pairs.
    pub n_p: f64,
    /// Scales of the run.
    pub context: Context,
    /// What the user should know of the data.
    pub findings: Vec<Finding>,
}

impl Signals {
    /// Puts a recording of `machine` in this form.
    ///
    /// # Errors
    /// Those of [`Signals::in_rotor_frame`].
    pub fn new(recording: &Recording, machine: &Machine) -> Result<Self> {
        let mut signals = Self::in_rotor_frame(recording, machine)?;
        signals.complete();
        let rate = scales::stated_rate(machine);
        if let Some(rate) = rate.filter(|rate| signals.kind == Kind::Full && signals.is_coarse(*rate)) {
            let why = signals.too_coarse(rate, "");
            signals.leave_voltages_out(why);
        }
        Ok(signals)
    }

    /// The same without phase currents where only rotor-frame ones were logged: the model without effects needs none.
    ///
    /// # Errors
    /// [`Error::Column`] if angle and speed contradict each other (mechanical taken for electrical, opposite sense), if
    /// the angle turns too far between samples to be unwrapped, if all phase currents but one are zero, or if two phases are interchanged.
    pub fn in_rotor_frame(recording: &Recording, machine: &Machine) -> Result<Self> {
        let n_p = f64::from(machine.n_p);
        let n = recording.len();
        let start = recording.t()[0];
        let mut t: Vec<f64> = recording.t().iter().map(|x| x - start).collect();
        let segments = recording.segments().to_vec();
        let scaled = |name: &str, factor: f64| {
            recording.column(name).map(|x| x.iter().map(|v| v * factor).collect::<Vec<f64>>())
        };
        let logged_speed = scaled("omega_e", 1.0).or_else(|| scaled("omega_m", n_p));
        let mut mechanical = recording.column("theta_m").map(unwrap);
        let mut logged_angle = recording
            .column("theta_e")
            .map(unwrap)
            .or_else(|| mechanical.as_ref().map(|m| m.iter().map(|x| x * n_p).collect()));
        let angle_known = logged_angle.is_some();
        let operating_points = recording.kind() == Kind::OperatingPoints;
        let open = recording.kind() == Kind::OpenCircuit;
        let in_time = !operating_points && !open;
        let mut findings = Vec::new();
        let as_logged = |name: &str| recording.column(name);
        let angle = as_logged("theta_e").map(|x| (x, 1.0)).or(as_logged("theta_m").map(|x| (x, n_p)));
        let steps = angle.filter(|_| in_time).and_then(|(x, turns)| limits::angle_steps(recording, x, turns));
        let held = limits::motion(&t, logged_angle.as_deref(), logged_speed.as_deref(), &segments);
        let Some(held) = held else {
            return Err(Error::unusable("there is neither a speed nor an angle", "record one of them"));
        };
        if let (Some(angle), Some(speed), false) = (&logged_angle, &logged_speed, operating_points) {
            check_sense(&t, angle, speed, &segments, machine.n_p)?;
        }
        let (mut omega_e, mut speed_error, speed_known) = match logged_speed {
            Some(speed) if !in_time => (speed, Vec::new(), true),
            _ => (held.omega, held.error, held.logged),
        };
        let lasting = in_time && (!speed_known || held.finding.is_some());
        if recording.held() > 1 {
            findings.push(limits::held_together(recording.held()));
        }
        findings.extend(held.finding.filter(|_| in_time));
        let mut angle_error = Vec::new();
        if let (Some(limits::AngleSteps { step, .. }), Some(angle)) = (&steps, &logged_angle) {
            let half = derived::derive(&t, angle, &segments).half;
            let (of_angle, of_speed) = derived::rounded_anew(&t, angle, &segments, half, *step);
            if !speed_known {
                speed_error = of_speed;
            }
            angle_error = of_angle;
            for angle in logged_angle.iter_mut().chain(&mut mechanical) {
                limits::through_steps(&t, angle, &segments, half);
            }
        }
        // So far all of them are of what the log cannot hold.
        let mut limited = findings.clone();
        limited.extend(steps.iter().filter(|s| s.loud || lasting).map(|s| s.finding.clone()));
        findings.extend(steps.iter().map(|s| s.finding.clone()));
        let mut theta_e = logged_angle.unwrap_or_else(|| integrate(&t, &omega_e));

        if angle_known && mechanical.is_none() && !operating_points {
            findings.extend(angle::bridge(&t, &mut theta_e, &omega_e, &segments));
        }
        if recording.load() == Load::Locked {
            findings.extend(angle::hold(&theta_e, &mut omega_e));
        }
        let induced = match phases::logged_voltages(recording).filter(|_| open) {
            Some(abc) => {
                let calibration = open_circuit::calibrate(abc, &omega_e, &theta_e, angle_known)?;
                findings.extend(calibration.findings(angle_known));
                if !angle_known {
                    omega_e.iter_mut().for_each(|w| *w *= calibration.speed);
                    theta_e.iter_mut().for_each(|x| *x = calibration.angle + *x * calibration.speed);
                }
                Some(phases::induced_voltages(abc, &calibration, &theta_e))
            }
            None => None,
        };
        if let Some(error) = recording.angle_error().filter(|_| !open) {
            angle_error = vec![error; n];
        }
        let theta_m = mechanical.unwrap_or_else(|| theta_e.iter().map(|x| x / n_p).collect());
        if angle_known && speed_known && !operating_points {
            let found = mend(&mut t, &mut omega_e, &theta_e, &segments);
            limited.extend(found.iter().cloned());
            findings.extend(found);
        }
        let currents = if open {
            let none = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
            Currents { phases: Some(none), ..Currents::default() }
        } else {
            phases::currents(recording, &mut findings)
        };
        if let (Some(abc), true, false) = (&currents.phases, angle_known, operating_points || open) {
            phases::check_order(abc, &theta_e)?;
        }
        let i = match (recording.column("i_d"), recording.column("i_q")) {
            (Some(d), Some(q)) => Some([d.to_vec(), q.to_vec()]),
            _ => currents.phases.as_ref().map(|abc| turned::to_rotor([&abc[0], &abc[1], &abc[2]], &theta_e)),
        };
        if i.is_none() && (recording.kind() != Kind::Mechanical || recording.column("tau_e").is_none()) {
            return Err(phases::too_few(recording));
        }
        let (v_d, v_q) = (recording.column("v_d"), recording.column("v_q"));
        let (v, axes) = match (v_d, v_q) {
            (Some(d), Some(q)) => (Some([d.to_vec(), q.to_vec()]), [true; 2]),
            (Some(d), None) if operating_points => (Some([d.to_vec(), vec![0.0; n]]), [true, false]),
            (None, Some(q)) if operating_points => (Some([vec![0.0; n], q.to_vec()]), [false, true]),
            _ => {
                let v =
                    induced.or_else(|| phases::held_voltages(recording, &t, &theta_e, &omega_e, angle_known));
                (v, [true; 2])
            }
        };
        if v.is_none() && !recording.has_q_alone() {
            findings.extend(phases::incomplete_voltage(recording));
        }
        let above = |name: &str| {
            let column = recording.column(name);
            column.map(|x| x.iter().map(|v| v - REFERENCE_TEMPERATURE).collect::<Vec<f64>>())
        };
        let (heating, magnet_heating) = (above("temperature"), above("temperature_magnet"));
        let tau_e = scaled("tau_e", 1.0);
        let link = machine.v_dc.or_else(|| recording.column("v_dc").and_then(middle));
        if segments.len() > 1 {
            findings.push(Finding {
                finding: match segments.len() - 1 {
                    1 => "the log has one gap in time".into(),
                    gaps => format!("the log has {gaps} gaps in time"),
                },
                consequence: "the models restart from the measurement behind each gap".into(),
                fix: "record without interruption".into(),
            });
        }
        let mut signals = Self {
            t,
            segments,
            period: recording.period(),
            control_period: machine.f_sample.map(|f| 1.0 / f),
            averaged: 1,
            within: None,
            stator_held: None,
            voltages_drawn: false,
            current_filter: None,
            link_stated: link.is_some(),
            middle_of_steps: false,
            phase_voltages: v_d.is_none() || v_q.is_none(),
            v,
            axes,
            i,
            phases: currents.phases,
            theta_e,
            theta_m,
            angle_known: angle_known || open,
            angle_from_voltages: (open && !angle_known) || recording.angle_error().is_some(),
            turn_known: recording.has(&["theta_m"]),
            three_currents: currents.three,
            omega_e,
            speed_known,
            limits: Limits {
                speed: speed_error,
                lasting,
                angle: angle_error,
                angle_step: steps.as_ref().map_or(0.0, |s| s.step),
                current: limits::current_rounding(recording, currents.three),
                found: limited,
                ..Limits::default()
            },
            phase_currents: !recording.has(&["i_d", "i_q"]),
            tau_e,
            tau_m: scaled("tau_m", 1.0),
            heating,
            magnet_heating,
            load: recording.load(),
            kind: recording.kind(),
            n_p,
            context: Context {
                n_p,
                i_max: 0.0,
                v_max: 0.0,
                omega_e_max: 0.0,
                tau_max: 0.0,
                psi_max: 0.0,
                swing: 0.0,
                duration: recording.duration(),
                period: recording.period(),
                v_dc: link.unwrap_or(0.0),
                electrical_rate: electrical_rate(machine),
                zero_sequence: 0.0,
                completed_phase: currents.completed,
                load_known: match recording.load() {
                    Load::Measured => true,
                    Load::KnownConstant(value) => value != 0.0,
                    _ => false,
                },
                steady: operating_points,
                has_temperature: recording.has(&["temperature"]),
                has_magnet_temperature: recording.has(&["temperature_magnet"]),
            },
            findings,
        };
        signals.set_scales(machine, n);
        Ok(signals)
    }

    /// Adds phase currents where only rotor-frame ones were logged.
    pub(crate) fn complete(&mut self) {
        let (None, Some([d, q])) = (&self.phases, &self.i) else { return };
        self.phases = Some(turned::to_phases([d, q], &self.theta_e));
    }

    /// The slope of the angle, and how far it may be off.
    pub(crate) fn slope_of_angle(&self) -> derived::Derived {
        derived::derive(&self.t, &self.theta_e, &self.segments)
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Samples of the log for each sample: one, or the factor by which the recording was decimated.
    pub fn decimation(&self) -> usize {
        self.within.as_ref().map_or(1, |within| within.factor)
    }

    /// Never true for a checked recording.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }
}

/// The median of a voltage of the DC link that was logged, V; none where it is no voltage that a motor runs from.
fn middle(logged: &[f64]) -> Option<f64> {
    let mut sorted = logged.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().filter(|v_dc| v_dc.is_finite() && *v_dc > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn turning(n: usize, speed: f64, angle_factor: f64) -> Recording {
        let t: Vec<f64> = (0..n).map(|k| k as f64 * 1e-4).collect();
        let wrapped = t.iter().map(|t| (speed * t * angle_factor).rem_euclid(TAU)).collect();
        let constant = |x: f64| vec![x; n];
        Recording::new(
            vec![
                ("theta_e".into(), wrapped),
                ("omega_e".into(), constant(speed)),
                ("v_d".into(), constant(1.0)),
                ("v_q".into(), constant(2.0)),
                ("i_d".into(), constant(3.0)),
                ("i_q".into(), constant(4.0)),
                ("t".into(), t),
            ],
            None,
        )
        .unwrap()
    }

    #[test]
    fn a_link_that_was_logged_is_known_and_one_on_the_nameplate_goes_first() {
        let logged = |v_dc: f64| {
            let mut columns: Vec<(String, Vec<f64>)> =
                ["t", "theta_e", "omega_e", "v_d", "v_q", "i_d", "i_q"]
                    .map(|name| (name.to_string(), turning(2000, 300.0, 1.0).column(name).unwrap().to_vec()))
                    .into();
            columns.push((
                "v_dc".into(),
                (0..2000).map(|k| v_dc + if k % 2 == 0 { 0.5 } else { 0.0 }).collect(),
            ));
            Recording::new(columns, None).unwrap()
        };
        let machine = Machine::new(4).unwrap();
        let known = |v_dc: f64, machine: &Machine| {
            let signals = Signals::new(&logged(v_dc), machine).unwrap();
            (signals.link_stated, signals.context.v_dc)
        };
        assert_eq!(known(48.0, &machine), (true, 48.5));
        let stated = machine.clone().with_drive(Some(50.0), None, None).unwrap();
        assert_eq!(known(48.0, &stated), (true, 50.0));
        assert!(!known(-1.0, &machine).0);
    }

    #[test]
    fn wrapped_angles_are_unwrapped_and_scales_found() {
        let signals = Signals::new(&turning(2000, 300.0, 1.0), &Machine::new(4).unwrap()).unwrap();
        let last = signals.len() - 1;
        assert!((signals.theta_e[last] - 300.0 * signals.t[last]).abs() < 1e-9);
        assert!((signals.theta_m[last] - 75.0 * signals.t[last]).abs() < 1e-9);
        assert_eq!(signals.context.i_max, 5.0);
        assert_eq!(signals.context.omega_e_max, 300.0);
    }

    #[test]
    fn a_winding_is_as_warm_as_was_logged_from_the_first_sample_on() {
        let cold = turning(2000, 300.0, 1.0);
        let columns = ["t", "theta_e", "omega_e", "v_d", "v_q", "i_d", "i_q"]
            .map(|name| (name.to_string(), cold.column(name).unwrap().to_vec()));
        let warm = columns.into_iter().chain([("temperature".to_string(), vec![80.0; 2000])]).collect();
        let signals = Signals::new(&Recording::new(warm, None).unwrap(), &Machine::new(4).unwrap()).unwrap();
        assert_eq!(signals.heating.unwrap()[0], 60.0);
    }

    #[test]
    fn one_current_clamp_is_too_few() {
        let whole = turning(2000, 300.0, 1.0);
        let current = |name: &str, f: fn(f64) -> f64| {
            (name.to_string(), whole.t().iter().map(|t| f(300.0 * t)).collect::<Vec<f64>>())
        };
        let columns = ["t", "theta_e", "omega_e", "v_d", "v_q"]
            .map(|name| (name.to_string(), whole.column(name).unwrap().to_vec()));
        let currents = [current("i_a", f64::sin), current("i_b", |_| 0.0), current("i_c", |_| 0.0)];
        let recording = Recording::new(columns.into_iter().chain(currents).collect(), None).unwrap();
        let error = Signals::new(&recording, &Machine::new(4).unwrap()).unwrap_err().to_string();
        assert!(error.contains("i_b") && error.contains("two phase currents"), "{error}");
    }

    #[test]
    fn a_voltage_of_the_d_axis_alone_is_said_to_be_of_no_use() {
        let whole = turning(2000, 300.0, 1.0);
        let columns = ["t", "theta_e", "omega_e", "v_d", "i_d", "i_q"]
            .map(|name| (name.to_string(), whole.column(name).unwrap().to_vec()));
        let recording = Recording::new(columns.into(), None).unwrap();
        let findings = Signals::new(&recording, &Machine::new(4).unwrap()).unwrap().findings;
        assert!(findings.iter().any(|f| f.finding.starts_with("v_d alone")), "{findings:?}");
        let whole = Signals::new(&whole, &Machine::new(4).unwrap()).unwrap();
        assert!(whole.findings.iter().all(|f| !f.finding.contains("alone")));
    }

    #[test]
    fn a_mechanical_angle_in_place_of_an_electrical_one_is_refused() {
        let machine = Machine::new(4).unwrap();
        let error = Signals::new(&turning(4000, 300.0, 0.25), &machine).unwrap_err().to_string();
        assert!(error.contains("1/n_p") && error.contains("theta_m"), "{error}");
        assert!(Signals::new(&turning(4000, 300.0, 4.0), &machine).is_err());
        assert!(Signals::new(&turning(4000, 300.0, -1.0), &machine).is_err());
    }

    #[test]
    fn speed_follows_from_the_angle_where_it_is_not_logged() {
        let t: Vec<f64> = (0..100).map(|k| f64::from(k) * 1e-3).collect();
        let angle = t.iter().map(|t| 20.0 * t).collect();
        let torque = vec![1.0; 100];
        let given = vec![("t".into(), t), ("theta_m".into(), angle), ("tau_e".into(), torque)];
        let recording = Recording::new(given, None).unwrap();
        let signals = Signals::new(&recording, &Machine::new(3).unwrap()).unwrap();
        assert!(signals.omega_e.iter().all(|w| (w - 60.0).abs() < 1e-9));
    }
}
