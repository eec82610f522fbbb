//! A recording as it came from the bench: named columns in SI units, checked once, and what is known of the load.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;

/// Canonical column names with their SI units, as in the file contract.
pub const COLUMNS: [(&str, &str); 20] = [
    ("t", "s"),
    ("v_d", "V"),
    ("v_q", "V"),
    ("v_a", "V"),
    ("v_b", "V"),
    ("v_c", "V"),
    ("i_a", "A"),
    ("i_b", "A"),
    ("i_c", "A"),
    ("i_d", "A"),
    ("i_q", "A"),
    ("theta_e", "rad"),
    ("theta_m", "rad"),
    ("omega_e", "rad/s"),
    ("omega_m", "rad/s"),
    ("tau_m", "N m"),
    ("tau_e", "N m"),
    ("v_dc", "V"),
    ("temperature", "degC"),
    ("temperature_magnet", "degC"),
];

/// Sample period from which a recording is a list of operating points rather than a waveform, s.
const OPERATING_POINT_PERIOD: f64 = 0.05;
/// Fewest samples from which anything can be said.
pub const FEWEST_SAMPLES: usize = 16;
/// A step in time longer than this many median periods is a gap: the models restart behind it. A voltage that was not
/// logged cannot be made up; torque and speed in between can, for a few samples.
pub const GAP: f64 = 1.5;
const GAP_MECHANICAL: f64 = 6.0;
/// Largest magnitude of any value; larger ones are overflow marks of a logger, not physics.
pub const LARGEST: f64 = 1e12;

/// What is known of the load torque, which opposes positive speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Load {
    /// No load but the machine's own losses.
    None,
    /// A constant of known value, N·m.
    KnownConstant(f64),
    /// Measured in column `tau_m`.
    Measured,
    /// Constant, value unknown.
    UnknownConstant,
    /// Constant between unknown instants.
    UnknownPiecewise,
    /// The rotor is held.
    Locked,
}

impl Load {
    /// From the contract's `kind` and `value`.
    ///
    /// # Errors
    /// [`Error::Unknown`] for an unknown kind, [`Error::Unusable`] for a `known_constant` without a finite value.
    pub fn parse(kind: &str, value: Option<f64>) -> Result<Self> {
        Ok(match kind {
            "none" => Self::None,
            "known_constant" => match value.filter(|x| x.is_finite()) {
                Some(x) => Self::KnownConstant(x),
                None => {
                    return Err(Error::unusable(
                        "a known constant load needs its value",
                        "add value = ... (N m) to [load]",
                    ));
                }
            },
            "measured" => Self::Measured,
            "unknown_constant" => Self::UnknownConstant,
            "unknown_piecewise" => Self::UnknownPiecewise,
            "locked" => Self::Locked,
            other => {
                return Err(Error::Unknown {
                    kind: "load",
                    name: other.into(),
                    known: "none, known_constant, measured, unknown_constant, unknown_piecewise, locked"
                        .into(),
                });
            }
        })
    }

    /// The contract's name of this kind.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::None => "none",
            Self::KnownConstant(_) => "known_constant",
            Self::Measured => "measured",
            Self::UnknownConstant => "unknown_constant",
            Self::UnknownPiecewise => "unknown_piecewise",
            Self::Locked => "locked",
        }
    }
}

/// Which questions a recording can answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Voltages, currents and speed: electrical and mechanical questions.
    Full,
    /// Voltages, currents and speed with the rotor held or the mechanics unknown.
    Electrical,
    /// Torque (or currents) and speed.
    Mechanical,
    /// Steady operating points, sampled far slower than any transient.
    OperatingPoints,
    /// Voltages induced in open terminals by a rotor that is turned from outside.
    OpenCircuit,
}

/// A checked recording.
#[derive(Debug, Clone)]
pub struct Recording {
    columns: BTreeMap<&'static str, Vec<f64>>,
    load: Load,
    period: f64,
    segments: Vec<Range<usize>>,
    kind: Kind,
}

impl Recording {
    /// Checks columns (canonical name, values in SI) and what is known of the load; without `load` it is
    /// [`Load::Measured`] when a column `tau_m` is there and [`Load::UnknownConstant`] when not.
    ///
    /// # Errors
    /// [`Error::Unknown`] for a column that is not in [`COLUMNS`]; [`Error::Column`] for lengths that differ, too few
    /// samples or a set of columns from which nothing can be learnt; [`Error::Sample`] for values that are not
    /// finite, absurdly large, or a time that does not increase.
    pub fn new(given: Vec<(String, Vec<f64>)>, load: Option<Load>) -> Result<Self> {
        let mut columns = BTreeMap::new();
        for (name, values) in given {
            let Some((canonical, _)) = COLUMNS.iter().find(|(known, _)| *known == name) else {
                let known = COLUMNS.map(|(n, _)| n).join(", ");
                return Err(Error::Unknown { kind: "column", name, known });
            };
            check_values(canonical, &values)?;
            if columns.insert(*canonical, values).is_some() {
                return Err(column_error(canonical, "is given twice", "keep one of the two"));
            }
        }
        let Some(t) = columns.get("t") else {
            return Err(column_error("t", "is missing", "give the sample time in s, or a period"));
        };
        let n = t.len();
        if n < FEWEST_SAMPLES {
            let problem = format!("has {n} samples");
            return Err(column_error("t", &problem, &format!("at least {FEWEST_SAMPLES} are needed")));
        }
        if let Some((name, values)) = columns.iter().find(|(_, values)| values.len() != n) {
            let problem = format!("has {} rows while t has {n}", values.len());
            return Err(column_error(name, &problem, "give every column the same number of rows"));
        }
        let voltages = ["v_d", "v_q", "v_a"].iter().any(|name| columns.contains_key(name));
        let (period, segments) = check_time(t, if voltages { GAP } else { GAP_MECHANICAL })?;
        let load = load.unwrap_or(if columns.contains_key("tau_m") {
            Load::Measured
        } else {
            Load::UnknownConstant
        });
        if load == Load::Measured && !columns.contains_key("tau_m") {
            let fix = "add the measured load torque in N m, or change [load] kind";
            return Err(column_error("tau_m", "is missing although the load is said to be measured", fix));
        }
        let kind = kind_of(&columns, period, load)?;
        Ok(Self { columns, load, period, segments, kind })
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.columns["t"].len()
    }

    /// Never true: a recording has at least a handful of samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The values of a column, SI, one per sample; `None` if it was not recorded.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.get(name).map(Vec::as_slice)
    }

    /// Names of the recorded columns.
    pub fn names(&self) -> Vec<&'static str> {
        self.columns.keys().copied().collect()
    }

    /// Sample times, s.
    pub fn t(&self) -> &[f64] {
        &self.columns["t"]
    }

    /// Median sample period, s.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// Time from the first to the last sample, s.
    pub fn duration(&self) -> f64 {
        self.t()[self.len() - 1] - self.t()[0]
    }

    /// Runs of samples without a gap in time.
    pub fn segments(&self) -> &[Range<usize>] {
        &self.segments
    }

    /// What is known of the load.
    pub fn load(&self) -> Load {
        self.load
    }

    /// Which questions it can answer.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// True if all of these columns were recorded.
    pub fn has(&self, names: &[&str]) -> bool {
        names.iter().all(|name| self.columns.contains_key(name))
    }
}

fn column_error(column: &str, problem: &str, fix: &str) -> Error {
    Error::Column { column: column.into(), problem: problem.into(), fix: fix.into() }
}

fn check_values(column: &str, values: &[f64]) -> Result<()> {
    match values.iter().position(|x| x.is_nan() || x.abs() > LARGEST) {
        None => Ok(()),
        Some(row) => Err(Error::Sample {
            column: column.into(),
            row,
            problem: format!("the value is {}", values[row]),
            fix: "drop this row (gaps in time are understood) or repair the log".into(),
        }),
    }
}

/// Median period and the runs between gaps; time must increase strictly.
fn check_time(t: &[f64], gap: f64) -> Result<(f64, Vec<Range<usize>>)> {
    let steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    if let Some(row) = steps.iter().position(|s| *s <= 0.0) {
        let (a, b) = (t[row], t[row + 1]);
        let problem = if a == b {
            format!("time stands still at {a} s")
        } else {
            format!("time runs back from {a} s to {b} s")
        };
        return Err(Error::Sample {
            column: "t".into(),
            row: row + 1,
            problem,
            fix: "sort the rows by time and drop repeated ones".into(),
        });
    }
    let mut ranked = steps.clone();
    let middle = ranked.len() / 2;
    let period = *ranked.select_nth_unstable_by(middle, f64::total_cmp).1;
    let mut segments = Vec::new();
    let mut start = 0;
    for (row, step) in steps.iter().enumerate() {
        if *step > gap * period {
            segments.push(start..row + 1);
            start = row + 1;
        }
    }
    segments.push(start..t.len());
    Ok((period, segments))
}

fn kind_of(columns: &BTreeMap<&'static str, Vec<f64>>, period: f64, load: Load) -> Result<Kind> {
    let has = |names: &[&str]| names.iter().all(|name| columns.contains_key(name));
    let angle = has(&["theta_e"]) || has(&["theta_m"]);
    let speed = has(&["omega_e"]) || has(&["omega_m"]);
    let voltages = has(&["v_d", "v_q"]) || (angle && has(&["v_a", "v_b", "v_c"]));
    let two = [["i_a", "i_b"], ["i_b", "i_c"], ["i_a", "i_c"]].iter().any(|pair| has(pair));
    let currents = has(&["i_d", "i_q"]) || (angle && two);
    let turning = speed || angle;
    let operating_points = period > OPERATING_POINT_PERIOD;
    if turning && !operating_points && is_open_circuit(columns) {
        return Ok(Kind::OpenCircuit);
    }
    // Each axis of a steady point has an equation of its own.
    if operating_points && turning && has(&["i_d", "i_q"]) && (has(&["v_d"]) || has(&["v_q"])) {
        return Ok(Kind::OperatingPoints);
    }
    if voltages && currents && turning {
        if operating_points {
            return Ok(Kind::OperatingPoints);
        }
        return Ok(if load == Load::Locked { Kind::Electrical } else { Kind::Full });
    }
    if turning && (currents || has(&["tau_e"])) {
        return Ok(Kind::Mechanical);
    }
    let missing = if !turning {
        ("omega_e", "give omega_e (or omega_m, theta_e, theta_m)")
    } else {
        (
            "i_q",
            "give the currents i_d, i_q or i_a, i_b, i_c with theta_e, or the motor torque tau_e; i_d and i_q of zero \
             say that the terminals were open",
        )
    };
    Err(column_error(
        missing.0,
        "is missing, so that neither the electrical nor the mechanical equation can be tested",
        missing.1,
    ))
}

/// Whether voltages were measured at terminals through which no current flows: the logged currents are zero throughout, or
/// phase voltages stand alone. A rotor-frame voltage without currents is more likely a drive whose currents were not logged.
fn is_open_circuit(columns: &BTreeMap<&'static str, Vec<f64>>) -> bool {
    let alive = |name: &&str| columns.get(*name).is_some_and(|x| x.iter().any(|v| *v != 0.0));
    let logged = |name: &&str| columns.contains_key(*name);
    let currents = ["i_a", "i_b", "i_c", "i_d", "i_q"];
    let phases = ["v_a", "v_b", "v_c"];
    let rotor_frame = ["v_d", "v_q"];
    if columns.contains_key("tau_e") || currents.iter().any(alive) {
        return false;
    }
    let measured = |names: &[&str]| names.iter().all(logged) && names.iter().any(alive);
    let told = currents.iter().filter(|name| logged(name)).count() >= 2;
    measured(&phases) || (told && measured(&rotor_frame))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(n: usize) -> Vec<(String, Vec<f64>)> {
        ["t", "v_d", "v_q", "i_d", "i_q", "omega_e"]
            .iter()
            .map(|name| ((*name).to_string(), (0..n).map(|k| k as f64 * 1e-4).collect()))
            .collect()
    }

    #[test]
    fn gaps_split_a_recording_into_segments() {
        let mut given = columns(40);
        for x in &mut given[0].1[25..] {
            *x += 0.01;
        }
        let recording = Recording::new(given, None).unwrap();
        assert_eq!(recording.segments(), &[0..25, 25..40]);
        assert_eq!(recording.kind(), Kind::Full);
        assert_eq!(recording.load(), Load::UnknownConstant);
    }

    #[test]
    fn bad_columns_are_named_with_row_and_fix() {
        let mut given = columns(20);
        given[3].1[7] = f64::NAN;
        let text = Recording::new(given, None).unwrap_err().to_string();
        assert!(text.contains("'i_d', row 7") && text.contains("drop this row"), "{text}");

        let mut given = columns(20);
        given[0].1[9] = 0.0;
        let text = Recording::new(given, None).unwrap_err().to_string();
        assert!(text.contains("'t', row 9") && text.contains("runs back"), "{text}");

        let mut given = columns(20);
        given[1].1.pop();
        assert!(matches!(Recording::new(given, None), Err(Error::Column { .. })));
        assert!(Recording::new(columns(3), None).is_err());
        assert!(Recording::new(columns(20), Some(Load::Measured)).is_err());
        let mut given = columns(20);
        given[2].0 = "speed".into();
        assert!(matches!(Recording::new(given, None), Err(Error::Unknown { .. })));
    }

    #[test]
    fn zero_currents_beside_voltages_say_that_the_terminals_are_open() {
        let mut given = columns(20);
        given[3].1.fill(0.0);
        given[4].1.fill(0.0);
        assert_eq!(Recording::new(given.clone(), None).unwrap().kind(), Kind::OpenCircuit);
        given[1].1.fill(0.0);
        given[2].1.fill(0.0);
        assert_eq!(Recording::new(given, None).unwrap().kind(), Kind::Full);
    }

    #[test]
    fn the_kind_follows_from_the_columns() {
        let pick = |names: &[&str], dt: f64, load| {
            let given = names
                .iter()
                .map(|n| ((*n).to_string(), (0..20).map(|k| f64::from(k) * dt).collect()))
                .collect();
            Recording::new(given, load).map(|r| r.kind())
        };
        assert_eq!(pick(&["t", "omega_m", "tau_e"], 1e-3, None), Ok(Kind::Mechanical));
        assert_eq!(pick(&["t", "v_d", "v_q", "i_d", "i_q", "omega_m"], 2.5, None), Ok(Kind::OperatingPoints));
        let abc = ["t", "v_d", "v_q", "i_a", "i_b", "theta_e", "omega_e"];
        assert_eq!(pick(&abc, 1e-4, Some(Load::Locked)), Ok(Kind::Electrical));
        assert_eq!(pick(&["t", "v_q", "i_d", "i_q", "omega_m"], 2.5, None), Ok(Kind::OperatingPoints));
        assert!(
            pick(&["t", "v_q", "i_d", "i_q", "omega_m"], 1e-4, None).is_ok_and(|k| k == Kind::Mechanical)
        );
        assert_eq!(pick(&["t", "v_a", "v_b", "v_c", "omega_m"], 1e-4, None), Ok(Kind::OpenCircuit));
        assert!(pick(&["t", "v_d", "v_q", "omega_m"], 1e-4, None).is_err());
        assert!(pick(&["t", "v_d", "v_q", "i_d", "i_q"], 1e-4, None).is_err());
        assert!(pick(&["t", "omega_m"], 1e-4, None).is_err());
    }
}
