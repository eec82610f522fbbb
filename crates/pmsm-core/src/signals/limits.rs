//! What a log cannot hold, read from the data: rounding, holds, a speed that had to be derived, and rows too far apart for a voltage. It is
//! part of the noise, and no physics.

use super::{Finding, Signals, derived};
use crate::figures::short;
use crate::numerics::differences::white_noise;
use crate::numerics::extent::peak;
use crate::numerics::steps::{held_rows, quantum, rounding};
use crate::numerics::transforms::SQRT3;
use crate::recording::{Kind, Recording};
use std::f64::consts::SQRT_2;
use std::ops::Range;

/// Electrical time constants in a row from which the voltages of a log tell nothing of the currents between its rows: by then a current has
/// gone two fifths of its way to where the voltage leads, and a current controller has long moved that voltage.
const COARSE: f64 = 0.5;
/// Share of a current's noise from which what an angle in steps adds to it is seen.
const SEEN: f64 = 0.3;
/// How far a log period may be from the drive's own for both to be one, share of it.
const SAME_PERIOD: f64 = 0.05;

/// Noise of a sensor, as it was seen.
#[derive(Debug, Clone)]
pub struct SensorNoise {
    /// Its values, in the unit of the sensor, one per sample.
    pub series: Vec<f64>,
    /// Root mean square.
    pub rms: f64,
    /// Two standard errors of the mean square, share of it.
    pub unsure: f64,
}

impl SensorNoise {
    /// That of every `factor`th sample.
    #[must_use]
    pub fn decimated_by(&self, factor: usize) -> Self {
        Self { series: self.series.iter().step_by(factor).copied().collect(), ..self.clone() }
    }
}

/// What a log adds to the noise of its sensors.
#[derive(Debug, Clone, Default)]
pub struct Limits {
    /// How far a speed that was derived, held or rounded may be off, rad/s, sample by sample; empty where it stands as it was measured.
    pub speed: Vec<f64>,
    /// Whether that error is no white noise: of a speed that was derived or held.
    pub lasting: bool,
    /// Step of the angle where that is seen in the currents, rad (electrical); zero where it is not.
    pub angle_step: f64,
    /// How far an angle in such steps, or one that was taken from the voltages, may be off, rad (electrical), sample by sample; empty where
    /// it is none of both.
    pub angle: Vec<f64>,
    /// Standard deviation of the rounding of a rotor-frame current, A.
    pub current: f64,
    /// Why the voltages are left out, where the rows are too far apart for them.
    pub coarse: Option<Finding>,
    /// Noise of the currents, A per axis, where it lasts from row to row.
    pub current_noise: Option<SensorNoise>,
    /// The same of the speed, rad/s (electrical).
    pub speed_noise: Option<SensorNoise>,
    /// What else the log cannot hold, as it was found.
    pub found: Vec<Finding>,
}

impl Limits {
    /// Whether the noise of the speed's model is bounded rather than measured.
    pub fn bounded(&self) -> bool {
        self.lasting || self.coarse.is_some()
    }

    /// The first of all that the log cannot hold.
    pub fn first(&self) -> Option<&Finding> {
        self.coarse.iter().chain(&self.found).next()
    }

    /// Root mean square error of the speed, rad/s.
    pub fn speed_error(&self) -> f64 {
        (self.speed.iter().map(|x| x * x).sum::<f64>() / self.speed.len().max(1) as f64).sqrt()
    }
}

/// Speed and angle as far as a log holds them.
pub(super) struct Motion {
    pub omega: Vec<f64>,
    pub error: Vec<f64>,
    pub finding: Option<Finding>,
    /// Whether the speed is still the logged one.
    pub logged: bool,
}

/// The speed of a log: derived from the unwrapped electrical angle `theta` (rad) where none was logged, or one that was held over rows; drawn
/// straight through its new values where it was held and there is no angle. `speed` is the logged one, rad/s.
pub(super) fn motion(
    t: &[f64],
    theta: Option<&[f64]>,
    speed: Option<&[f64]>,
    segments: &[Range<usize>],
) -> Option<Motion> {
    let rows = speed.map_or(1, |x| held_rows(&[x]).0);
    let step = speed.and_then(quantum);
    let told = |fix: &str, consequence: &str| {
        let steps = step.map_or(String::new(), |q| format!(", in steps of {q:.3} rad/s (electrical)"));
        Finding {
            finding: format!("the logged speed is held over {rows} rows{steps}"),
            consequence: consequence.into(),
            fix: fix.into(),
        }
    };
    match (speed, theta) {
        (Some(_), Some(theta)) if rows > 1 => {
            let derived = derived::derive(t, theta, segments);
            let consequence = "the speed is taken from the angle, and its error counts as noise";
            Some(Motion {
                omega: derived.omega,
                error: derived.error,
                finding: Some(told("log the speed in every row, or the angle alone", consequence)),
                logged: false,
            })
        }
        (Some(speed), None) if rows > 1 => {
            let (omega, error) = drawn_through(t, speed, rows, step.unwrap_or(0.0));
            let consequence =
                "it is drawn straight from one new value to the next, and its error counts as noise";
            Some(Motion {
                omega,
                error,
                finding: Some(told("log the speed in every row, or the angle", consequence)),
                logged: true,
            })
        }
        (Some(speed), _) => {
            // The rounding of a value that moves by many steps is noise like any other, and is seen as such.
            let error = step.map_or(Vec::new(), |q| vec![rounding(q); speed.len()]);
            Some(Motion { omega: speed.to_vec(), error, finding: None, logged: true })
        }
        (None, Some(theta)) => {
            let derived = derived::derive(t, theta, segments);
            Some(Motion { omega: derived.omega, error: derived.error, finding: None, logged: false })
        }
        (None, None) => None,
    }
}

/// A held speed drawn straight through the rows in which it changes, and how far that may be off: by its steps, and by its curvature.
fn drawn_through(t: &[f64], speed: &[f64], rows: usize, step: f64) -> (Vec<f64>, Vec<f64>) {
    let mut counts = vec![0; rows];
    (1..speed.len()).filter(|k| speed[*k] != speed[*k - 1]).for_each(|k| counts[k % rows] += 1);
    let first = (0..rows).max_by_key(|r| counts[*r]).unwrap_or(0);
    let new: Vec<usize> = (first..speed.len()).step_by(rows).collect();
    let values: Vec<f64> = new.iter().map(|k| speed[*k]).collect();
    // Noise of a value lasts until the next one.
    let noise = white_noise(&values).max(rounding(step));
    let (mut omega, mut error) = (speed.to_vec(), vec![noise; speed.len()]);
    for (at, pair) in new.windows(2).enumerate() {
        let (a, b) = (pair[0], pair[1]);
        let after = new.get(at + 2).map_or(speed[b], |c| speed[*c]);
        // Half of what the slope changes by over a piece is as far as its middle may lie off the line, four times over.
        let bend = (after - 2.0 * speed[b] + speed[a]) / 8.0;
        for k in a..b {
            let share = (t[k] - t[a]) / (t[b] - t[a]);
            omega[k] = speed[a] + share * (speed[b] - speed[a]);
            error[k] = noise.hypot(bend);
        }
    }
    (omega, error)
}

/// An unwrapped angle `theta` (rad), which comes in steps, drawn through them by lines of half the width `half`.
pub(super) fn through_steps(t: &[f64], theta: &mut Vec<f64>, segments: &[Range<usize>], half: usize) {
    if half > 1 {
        *theta = super::angle::smoothed(t, theta, segments, half);
    }
}

/// What is to be said of a log whose columns are all held together over `rows` rows.
pub(super) fn held_together(rows: usize) -> Finding {
    Finding {
        finding: format!("all columns are held over {rows} rows of the log"),
        consequence: "the rows with new values are used, and what happened between them is unknown".into(),
        fix: "log every period of the drive".into(),
    }
}

/// An angle in steps.
pub(super) struct AngleSteps {
    /// The step, rad (electrical).
    pub step: f64,
    /// What to say of it.
    pub finding: Finding,
    /// Whether it adds as much to the largest current as the sensors' noise.
    pub loud: bool,
}

/// The steps of a logged angle where they show in the currents seen from the rotor: `angle` as it was logged, `turns` the electrical radians of
/// one of its units.
pub(super) fn angle_steps(recording: &Recording, angle: &[f64], turns: f64) -> Option<AngleSteps> {
    let step = quantum(angle)?;
    let currents =
        ["i_a", "i_b", "i_c", "i_d", "i_q", "tau_e"].iter().filter_map(|name| recording.column(name));
    // Noise of the currents, share of the largest: an angle that is off by less turns nothing into another axis that would be seen.
    let seen =
        currents.map(|i| white_noise(i) / peak(i).max(f64::MIN_POSITIVE)).fold(f64::INFINITY, f64::min);
    let told = || Finding {
        finding: format!("the angle comes in steps of {:.2} mrad (electrical)", 1e3 * step * turns),
        consequence: "angle and speed are drawn through the steps, and their error counts as noise".into(),
        fix: "log the angle with more digits, or the speed along with it".into(),
    };
    let error = rounding(step * turns);
    (error > SEEN * seen).then(|| AngleSteps { step: step * turns, finding: told(), loud: error > seen })
}

/// Standard deviation of the rounding of rotor-frame currents, A, where `three` phases were measured, or two.
pub(super) fn current_rounding(recording: &Recording, three: bool) -> f64 {
    let of = |names: &[&str]| {
        let steps = names.iter().filter_map(|name| recording.column(name)).filter_map(quantum);
        steps.fold(0.0, f64::max)
    };
    let (axes, phases) = (of(&["i_d", "i_q"]), of(&["i_a", "i_b", "i_c"]));
    // Three phases, each rounded by itself, make √(2/3) of that in each axis. Two make √(4/3) in the mean over a turn, as the third is their sum.
    let of_phases = if three { SQRT_2 / SQRT3 } else { 2.0 / SQRT3 };
    rounding(if axes > 0.0 { axes } else { phases * of_phases })
}

impl Signals {
    /// Says what the log cannot hold.
    pub fn limited_by(&mut self, found: Finding) {
        self.limits.found.push(found.clone());
        self.findings.push(found);
    }

    /// Takes an angle that comes in steps for the lower end of its step, as a counter tells it, and goes to the middle.
    pub fn to_middle_of_steps(&mut self) {
        let by = 0.5 * self.limits.angle_step;
        self.middle_of_steps = true;
        self.theta_e.iter_mut().for_each(|x| *x += by);
        self.theta_m.iter_mut().for_each(|x| *x += by / self.n_p);
        if let (Some([a, b, c]), true) = (&self.phases, self.phase_currents) {
            self.i = Some(super::turned::to_rotor([a, b, c], &self.theta_e));
        }
    }

    /// Whether rows lie so far apart, against currents that settle at this `rate` (r_s/l, 1/s), that the voltage of a row does not tell where they go; not
    /// where the log is known to hold every period of the drive.
    pub fn is_coarse(&self, rate: f64) -> bool {
        matches!(self.kind, Kind::Full | Kind::Electrical)
            && !self.holds_every_period()
            && self.period * rate > COARSE
    }

    /// Whether the machine file tells that each row is one period of the drive, over which its voltage was held.
    pub fn holds_every_period(&self) -> bool {
        self.control_period.is_some_and(|own| self.period < (1.0 + SAME_PERIOD) * own)
    }

    /// Leaves the voltages out, as the rows are too far apart for them, and says `why`. What is left tells of the motion alone.
    pub fn leave_voltages_out(&mut self, why: Finding) {
        (self.v, self.kind) = (None, Kind::Mechanical);
        self.findings.insert(0, why.clone());
        self.limits.coarse = Some(why);
    }

    /// What is to be said of rows as far apart as these where currents settle at this `rate`, 1/s; `known` says how else that shows.
    pub fn too_coarse(&self, rate: f64, known: &str) -> Finding {
        Finding {
            finding: format!(
                "the rows lie {} ms apart, {} of the electrical time constant of {} ms{known}",
                short(1e3 * self.period, 4),
                short(self.period * rate, 3),
                short(1e3 / rate, 3)
            ),
            consequence: "the voltage of a row is not the one that acted up to the next, so nothing was asked of the voltage equations".into(),
            fix: "log every period of the drive, with f_sample under [drive], or steady points at least 0.05 s apart".into(),
        }
    }
}
