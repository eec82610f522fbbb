//! What a user gives, and whether it is complete.

use super::{Text, inspected};
use crate::effect::Site;
use crate::effects::ALL;
use crate::error::{Error, Result};
use crate::numerics::dimension::Dimension;
use crate::numerics::expression::{Fault, Function, LONGEST, nearest};
use serde::{Deserialize, Serialize};

/// Letters of a name at most.
const LONGEST_NAME: usize = 40;
/// Letters of a title or a meaning at most.
const LONGEST_WORDS: usize = 200;
/// Parameters at most.
const MOST_PARAMETERS: usize = 12;
/// Values of a parameter that is chosen among them at most.
const MOST_VALUES: usize = 64;

/// Where a formula acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// Torque against positive rotation, N·m.
    Torque,
    /// Voltage d, q that is lost between command and winding, V.
    Voltage,
    /// Flux d, q that the magnet has besides, V·s.
    Flux,
    /// Field energy per 3/2 over the flux linkage above the magnet's, V·A·s.
    Energy,
    /// Measured minus true electrical angle, rad.
    Angle,
    /// Measured minus true current of the phases a, b, c, A.
    Current,
}

impl Side {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Torque => "torque",
            Self::Voltage => "voltage",
            Self::Flux => "flux",
            Self::Energy => "energy",
            Self::Angle => "angle",
            Self::Current => "current",
        }
    }
    /// Names of its terms.
    pub fn terms(self) -> &'static [&'static str] {
        match self {
            Self::Voltage | Self::Flux => &["d", "q"],
            Self::Current => &["a", "b", "c"],
            _ => &[""],
        }
    }
    /// The unit of its terms.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Torque => "N m",
            Self::Voltage => "V",
            Self::Flux => "V s",
            Self::Energy => "J",
            Self::Angle => "rad",
            Self::Current => "A",
        }
    }
    /// The part of the model in which it is.
    pub fn site(self) -> Site {
        match self {
            Self::Torque => Site::Mechanical,
            Self::Voltage | Self::Flux | Self::Energy => Site::Electrical,
            Self::Angle | Self::Current => Site::Sensor,
        }
    }
}

/// A parameter of a formula.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quantity {
    /// Its name.
    pub name: String,
    /// Its SI unit.
    pub unit: String,
    /// Lowest value.
    pub low: f64,
    /// Highest value.
    pub high: f64,
    /// Usual value: where a search starts, and the strength that a power is told for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub typical: Option<f64>,
    /// The values among which it is chosen, for an order or another whole number, which is then not fitted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub values: Vec<f64>,
    /// What it means, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub meaning: Option<String>,
}

/// An effect as its user gives it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// Its identifier in files and answers.
    pub name: String,
    /// Where it acts.
    pub side: Side,
    /// Its formulas, one per term of its side.
    pub terms: Vec<String>,
    /// Its parameters, in the order in which they are reported.
    pub parameters: Vec<Quantity>,
    /// A short title; the name without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub title: Option<String>,
    /// Effects of the catalogue in whose place it is asked about.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub replaces: Vec<String>,
}

impl Definition {
    /// Reads and checks it.
    ///
    /// # Errors
    /// [`Error::Formula`] for what is wrong with a formula, [`Error::Unusable`] for the rest.
    pub(super) fn text(&self) -> Result<Text> {
        self.check_names()?;
        inspected::text(self)
    }

    /// The equation in words: its formulas behind the names of what they are.
    pub fn equation(&self) -> String {
        let terms = self.side.terms().iter().zip(&self.terms);
        let named = |(term, text): (&&'static str, &String)| match *term {
            "" => format!("{} = {text}", self.side.name()),
            term => format!("{}_{term} = {text}", self.side.name()),
        };
        terms.map(named).collect::<Vec<_>>().join(", ")
    }

    pub(super) fn fault(&self, term: usize, fault: Fault) -> Error {
        let name = self.side.terms()[term];
        let term = if name.is_empty() { String::new() } else { format!("_{name}") };
        Error::Formula {
            effect: self.name.clone(),
            term: format!("{}{term}", self.side.name()),
            position: fault.at,
            problem: fault.problem,
            fix: fault.fix,
        }
    }

    pub(super) fn wrong(&self, problem: impl Into<String>, fix: impl Into<String>) -> Error {
        let name: String = self.name.chars().take(LONGEST_NAME).collect();
        Error::unusable(format!("effect '{name}': {}", problem.into()), fix)
    }

    fn check_names(&self) -> Result<()> {
        let plain = |name: &str| {
            let mut letters = name.chars();
            letters.next().is_some_and(|c| c.is_ascii_alphabetic())
                && letters.all(|c| c.is_ascii_alphanumeric() || c == '_')
                && name.len() <= LONGEST_NAME
        };
        if !plain(&self.name) || self.name.chars().any(|c| c.is_ascii_uppercase()) {
            return Err(
                self.wrong("its name is not plain", "write small letters, digits and _, such as my_brake")
            );
        }
        if ALL.iter().any(|effect| effect.id() == self.name) {
            return Err(self.wrong("the catalogue has an effect of this name", "give it another name"));
        }
        let known: Vec<&str> = ALL.iter().map(|effect| effect.id()).collect();
        if let Some(name) = self.replaces.iter().find(|name| !known.contains(&name.as_str())) {
            let name: String = name.chars().take(LONGEST_NAME).collect();
            return Err(
                self.wrong(format!("it replaces '{name}', which is no effect"), nearest(&name, &known))
            );
        }
        let expected = self.side.terms();
        if self.terms.len() != expected.len() {
            let which = if expected.len() == 1 { "one formula".into() } else { expected.join(", ") };
            return Err(self.wrong(
                format!("{} formulas are given for {}", self.terms.len(), self.side.name()),
                format!("give {which}"),
            ));
        }
        let words = self.parameters.iter().filter_map(|p| p.meaning.as_ref()).chain(&self.title);
        if words
            .into_iter()
            .any(|text| text.chars().count() > LONGEST_WORDS || text.chars().any(char::is_control))
        {
            return Err(
                self.wrong("a title or a meaning is too long", format!("{LONGEST_WORDS} letters are enough"))
            );
        }
        if self.parameters.is_empty() || self.parameters.len() > MOST_PARAMETERS {
            let count = self.parameters.len();
            return Err(
                self.wrong(format!("it has {count} parameters"), format!("give 1 to {MOST_PARAMETERS}"))
            );
        }
        if self.terms.iter().map(String::len).sum::<usize>() > 8 * LONGEST {
            return Err(self.wrong("its formulas are too long", format!("{LONGEST} characters are the most")));
        }
        for (k, p) in self.parameters.iter().enumerate() {
            let shown: String = p.name.chars().take(LONGEST_NAME).collect();
            let wrong =
                |problem: &str, fix: &str| Err(self.wrong(format!("parameter '{shown}' {problem}"), fix));
            if !plain(&p.name) {
                return wrong("has no plain name", "write letters, digits and _, such as w_0");
            }
            if self.parameters[..k].iter().any(|other| other.name == p.name) {
                return wrong("stands there twice", "give each its own name");
            }
            let taken = super::quantities::ALL.iter().any(|(name, ..)| *name == p.name)
                || Function::ALL.iter().any(|(name, _)| *name == p.name)
                || ["pi", "pow"].contains(&p.name.as_str());
            if taken || p.name.ends_with("_samples") {
                return wrong("has the name of something else", "give it another name, such as k");
            }
            if let Err((problem, fix)) = Dimension::parse(&p.unit) {
                return Err(self.wrong(format!("parameter '{shown}': {problem}"), fix));
            }
            let constant = p.low == p.high && !p.values.is_empty();
            if !(p.low.is_finite() && p.high.is_finite() && (p.low < p.high || constant)) {
                return wrong("has no range", "give two finite bounds, the lower one first");
            }
            if p.typical.is_some_and(|x| !(p.low..=p.high).contains(&x)) {
                return wrong("is usually out of its range", "give a usual value between the bounds");
            }
            if p.values.len() > MOST_VALUES || p.values.iter().any(|x| !(p.low..=p.high).contains(x)) {
                return wrong("has values out of its range", "give at most 64 values between the bounds");
            }
        }
        Ok(())
    }
}
