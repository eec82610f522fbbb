//! A quantity given over time: a constant, straight lines between points, or steps.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// What lies between two points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// A straight line.
    #[default]
    Linear,
    /// The value of the point before.
    Steps,
}

/// Points (t in s, value) with times that increase; before the first and after the last the value stays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Raw", into = "Raw")]
pub struct Schedule {
    points: Vec<(f64, f64)>,
    shape: Shape,
}

impl Schedule {
    /// The same value always.
    ///
    /// # Errors
    /// [`Error::Quantity`] if it is not finite.
    pub fn constant(value: f64) -> Result<Self> {
        Self::new(vec![(0.0, value)], Shape::Linear)
    }

    /// Through these points.
    ///
    /// # Errors
    /// [`Error::Unusable`] without points or where the times do not increase; [`Error::Quantity`] for a number that is
    /// not finite.
    pub fn new(points: Vec<(f64, f64)>, shape: Shape) -> Result<Self> {
        if points.is_empty() {
            return Err(Error::unusable("a schedule has no points", "give at least one time and value"));
        }
        for (t, value) in &points {
            for (name, x, unit) in [("t of a schedule", *t, "s"), ("value of a schedule", *value, "")] {
                if !x.is_finite() {
                    return Err(Error::quantity(name, x, unit, "give a finite number"));
                }
            }
        }
        if let Some(pair) = points.windows(2).find(|w| w[1].0 <= w[0].0) {
            return Err(Error::unusable(
                format!("the times of a schedule go from {} s to {} s", pair[0].0, pair[1].0),
                "give times that increase; a jump between straight lines is two points close together",
            ));
        }
        Ok(Self { points, shape })
    }

    /// Value at time `t` (s).
    pub fn at(&self, t: f64) -> f64 {
        let next = self.points.partition_point(|p| p.0 <= t);
        let before = self.points[next.saturating_sub(1)];
        match (self.shape, self.points.get(next)) {
            (Shape::Linear, Some(after)) if next > 0 => {
                before.1 + (after.1 - before.1) * ((t - before.0) / (after.0 - before.0))
            }
            _ => before.1,
        }
    }

    /// The points.
    pub fn points(&self) -> &[(f64, f64)] {
        &self.points
    }

    /// What lies between them.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// Largest magnitude.
    pub fn peak(&self) -> f64 {
        self.points.iter().fold(0.0, |peak: f64, p| peak.max(p.1.abs()))
    }

    /// The value if it never changes.
    pub fn single(&self) -> Option<f64> {
        let first = self.points[0].1;
        self.points.iter().all(|p| p.1 == first).then_some(first)
    }
}

/// As it is written: a number, or a table of times and values.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Raw {
    Constant(f64),
    Points {
        t: Vec<f64>,
        value: Vec<f64>,
        #[serde(default)]
        shape: Shape,
    },
}

impl TryFrom<Raw> for Schedule {
    type Error = Error;

    fn try_from(raw: Raw) -> Result<Self> {
        match raw {
            Raw::Constant(value) => Self::constant(value),
            Raw::Points { t, value, .. } if t.len() != value.len() => Err(Error::unusable(
                format!("a schedule has {} times and {} values", t.len(), value.len()),
                "give one value per time",
            )),
            Raw::Points { t, value, shape } => Self::new(t.into_iter().zip(value).collect(), shape),
        }
    }
}

impl From<Schedule> for Raw {
    fn from(schedule: Schedule) -> Self {
        match schedule.single() {
            Some(value) => Self::Constant(value),
            None => {
                let (t, value) = schedule.points.into_iter().unzip();
                Self::Points { t, value, shape: schedule.shape }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_steps_and_ends() {
        let points = vec![(1.0, 10.0), (2.0, 20.0), (4.0, -20.0)];
        let line = Schedule::new(points.clone(), Shape::Linear).unwrap();
        let step = Schedule::new(points, Shape::Steps).unwrap();
        for (t, linear, steps) in [
            (-5.0, 10.0, 10.0),
            (1.0, 10.0, 10.0),
            (1.5, 15.0, 10.0),
            (2.0, 20.0, 20.0),
            (3.0, 0.0, 20.0),
            (4.0, -20.0, -20.0),
            (9.0, -20.0, -20.0),
        ] {
            assert_eq!((line.at(t), step.at(t)), (linear, steps), "{t}");
        }
        assert_eq!((line.peak(), line.single()), (20.0, None));
        assert_eq!(Schedule::constant(3.0).unwrap().at(7.0), 3.0);
    }

    #[test]
    fn nonsense_is_refused() {
        assert!(Schedule::new(vec![], Shape::Steps).is_err());
        assert!(Schedule::constant(f64::NAN).is_err());
        assert!(Schedule::new(vec![(1.0, 0.0), (1.0, 2.0)], Shape::Linear).is_err());
        for text in [r#"{"t":[0,1],"value":[1]}"#, r#"{"t":[1,0],"value":[1,2]}"#, r#""fast""#] {
            assert!(serde_json::from_str::<Schedule>(text).is_err(), "{text}");
        }
    }

    #[test]
    fn it_is_written_as_a_number_or_a_table() {
        for text in ["2.5", r#"{"t":[0.0,1.0],"value":[3.0,4.0],"shape":"steps"}"#] {
            let schedule: Schedule = serde_json::from_str(text).unwrap();
            assert_eq!(serde_json::to_string(&schedule).unwrap(), text);
        }
    }
}
