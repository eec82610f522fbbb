//! A recording as it came from the bench: named columns in SI units, checked once, and what is known of the load.

mod held;
mod kind;
mod load;

pub use kind::{Kind, OPERATING_POINT_PERIOD};
pub use load::Load;

use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::ops::Range;

/// Canonical column names with their SI units.
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

/// Fewest samples from which anything can be said, and fewest points of shorted terminals, of which three ratios are asked.
pub const FEWEST_SAMPLES: usize = 16;
const FEWEST_SHORTED: usize = 5;
/// A step in time longer than this many median periods is a gap: the models restart behind it. A voltage that was not
/// logged cannot be made up; torque and speed in between can, for a few samples.
pub const GAP: f64 = 1.5;
const GAP_MECHANICAL: f64 = 6.0;
/// Largest magnitude of any value; larger ones are overflow marks of a logger, not physics.
pub const LARGEST: f64 = 1e12;

/// A checked recording.
#[derive(Debug, Clone)]
pub struct Recording {
    columns: BTreeMap<&'static str, Vec<f64>>,
    load: Load,
    period: f64,
    segments: Vec<Range<usize>>,
    kind: Kind,
    angle_error: Option<f64>,
    held: usize,
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
        let apart = n > 1 && t[n - 1] - t[0] > OPERATING_POINT_PERIOD * (n - 1) as f64;
        let shorted = apart && kind::is_shorted(&columns);
        let fewest = if shorted { FEWEST_SHORTED } else { FEWEST_SAMPLES };
        if n < fewest {
            let problem = format!("has {n} samples");
            return Err(column_error("t", &problem, &format!("at least {fewest} are needed")));
        }
        if let Some((name, values)) = columns.iter().find(|(_, values)| values.len() != n) {
            let problem = format!("has {} rows while t has {n}", values.len());
            return Err(column_error(name, &problem, "give every column the same number of rows"));
        }
        let gap = if has_voltages(&columns) { GAP } else { GAP_MECHANICAL };
        let (period, segments) = check_time(t, gap)?;
        let load = load.unwrap_or(if columns.contains_key("tau_m") {
            Load::Measured
        } else {
            Load::UnknownConstant
        });
        if load == Load::Measured && !columns.contains_key("tau_m") {
            let fix = "add the measured load torque in N m, or change [load] kind";
            return Err(column_error("tau_m", "is missing although the load is said to be measured", fix));
        }
        let kind = kind::of(&columns, period, load)?;
        Ok(Self { columns, load, period, segments, kind, angle_error: None, held: 1 })
    }

    /// The same where angle and speed were not measured but taken from the voltages, to within `angle_error` (rad, electrical). The motion is
    /// not asked about then: its speed is as smooth as it was made.
    ///
    /// # Errors
    /// [`Error::Column`] if the error is no finite number from zero up.
    pub fn with_derived_angle(mut self, angle_error: f64) -> Result<Self> {
        if !(0.0..=LARGEST).contains(&angle_error) {
            let problem = format!("is said to be off by {angle_error} rad");
            return Err(column_error("theta_e", &problem, "give a finite number from zero up"));
        }
        self.angle_error = Some(angle_error);
        if self.kind == Kind::Full {
            self.kind = Kind::Electrical;
        }
        Ok(self)
    }

    /// Rows of the log for each of these, where only those with new values were kept.
    pub(crate) fn held(&self) -> usize {
        self.held
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

    /// How far an angle may be off that was taken from the voltages, rad (electrical); `None` where it was measured or there is none.
    pub fn angle_error(&self) -> Option<f64> {
        self.angle_error
    }

    /// Whether v_q was logged without v_d beside both currents of a waveform: it holds the q equation alone.
    pub fn has_q_alone(&self) -> bool {
        self.kind == Kind::Mechanical && self.has(&["v_q", "i_d", "i_q"]) && !self.has(&["v_d"])
    }

    /// Whether these are steady points of shorted terminals: both voltages are zero throughout, and currents flow.
    pub fn is_shorted(&self) -> bool {
        self.kind == Kind::OperatingPoints && kind::is_shorted(&self.columns)
    }

    /// Whether `other` holds the very same columns and samples.
    pub fn same_samples(&self, other: &Self) -> bool {
        self.columns == other.columns
    }

    /// True if all of these columns were recorded.
    pub fn has(&self, names: &[&str]) -> bool {
        names.iter().all(|name| self.columns.contains_key(name))
    }
}

fn has_voltages(columns: &BTreeMap<&'static str, Vec<f64>>) -> bool {
    ["v_d", "v_q", "v_a"].iter().any(|name| columns.contains_key(name))
}

fn column_error(column: &str, problem: &str, fix: &str) -> Error {
    Error::Column { column: column.into(), problem: problem.into(), fix: fix.into() }
}

/// Whether a value can be used; NaN cannot.
pub(crate) fn sound(x: f64) -> bool {
    x.abs() <= LARGEST
}

/// Place of the first value that cannot be used.
pub(crate) fn first_unsound(values: &[f64]) -> Option<usize> {
    // Without a way out in between a chunk is looked through several values at a time.
    const CHUNK: usize = 128;
    let good = |chunk: &[f64]| chunk.iter().fold(true, |all, x| all & sound(*x));
    let at = CHUNK * values.chunks(CHUNK).position(|chunk| !good(chunk))?;
    values[at..].iter().position(|x| !sound(*x)).map(|k| at + k)
}

fn check_values(column: &str, values: &[f64]) -> Result<()> {
    match first_unsound(values) {
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
        // A clock that begins anew is that of another recording, whose rows must not be sorted in among these.
        let anew = b < t[0] + steps[0].abs() && t.get(row + 2).is_some_and(|next| (b..a).contains(next));
        let fix = if anew {
            "a second recording begins there: give each a file of its own"
        } else {
            "sort the rows by time and drop repeated ones"
        };
        return Err(Error::Sample { column: "t".into(), row: row + 1, problem, fix: fix.into() });
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
    fn a_derived_angle_says_nothing_of_the_motion() {
        let derived = |error| Recording::new(columns(20), None).unwrap().with_derived_angle(error);
        let found = derived(0.02).unwrap();
        assert_eq!((found.kind(), found.angle_error()), (Kind::Electrical, Some(0.02)));
        assert!(derived(-0.1).is_err() && derived(f64::NAN).is_err());
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
        assert!(text.contains("'t', row 9") && text.contains("runs back") && text.contains("sort"), "{text}");
        let mut given = columns(20);
        (9..20).for_each(|k| given[0].1[k] = given[0].1[k - 9]);
        let text = Recording::new(given, None).unwrap_err().to_string();
        assert!(text.contains("'t', row 9") && text.contains("a second recording begins there"), "{text}");

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
    fn the_first_value_that_cannot_be_used_is_found_wherever_it_lies() {
        let sound = vec![-LARGEST; 300];
        assert_eq!(first_unsound(&sound), None);
        assert_eq!(first_unsound(&[]), None);
        for at in [0, 1, 127, 128, 255, 256, 299] {
            for bad in [f64::NAN, f64::INFINITY, -2.0 * LARGEST] {
                let mut values = sound.clone();
                (values[at], values[299]) = (bad, f64::NAN);
                assert_eq!(first_unsound(&values), Some(at));
            }
        }
    }
}
