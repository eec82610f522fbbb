//! The one error type of the core. Every message carries the quantity, its value and its unit,
//! and says what would be right.

/// What the core refuses, and why.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A physical quantity is outside the range in which it makes sense.
    #[error("{quantity} is {value} {unit}; {expected}")]
    Quantity {
        /// Symbol of the quantity, for example `r_s`.
        quantity: String,
        /// The offending value in `unit`.
        value: f64,
        /// SI unit symbol.
        unit: &'static str,
        /// What would be accepted, as a clause.
        expected: String,
    },
    /// A sample of a recording cannot be used.
    #[error("column '{column}', row {row}: {problem}; {fix}")]
    Sample {
        /// Canonical column name.
        column: String,
        /// Zero-based row of the recording.
        row: usize,
        /// What is wrong there.
        problem: String,
        /// What to do about it.
        fix: String,
    },
    /// A recording as a whole cannot be used.
    #[error("column '{column}': {problem}; {fix}")]
    Column {
        /// Canonical column name.
        column: String,
        /// What is wrong with it.
        problem: String,
        /// What to do about it.
        fix: String,
    },
    /// A name that is not in the catalogue or the parameter list.
    #[error("there is no {kind} '{name}'; known: {known}")]
    Unknown {
        /// Kind of thing asked for, for example "effect".
        kind: &'static str,
        /// The name that was asked for.
        name: String,
        /// Comma-separated list of what exists.
        known: String,
    },
    /// The call asks for something that the recording or the settings cannot give.
    #[error("{problem}; {fix}")]
    Unusable {
        /// Why it cannot be done.
        problem: String,
        /// What to do about it.
        fix: String,
    },
    /// A formula of an effect given as text cannot be used.
    #[error("effect '{effect}', {term}, character {position}: {problem}; {fix}")]
    Formula {
        /// Name of the effect.
        effect: String,
        /// Which of its formulas.
        term: String,
        /// Number of the character, from one.
        position: usize,
        /// What is wrong there.
        problem: String,
        /// What to do about it.
        fix: String,
    },
    /// One of several recordings cannot be used.
    #[error("recording {number}: {source}")]
    InRecording {
        /// Which, counted from one in the order in which they were given.
        number: usize,
        /// What is wrong with it.
        source: Box<Error>,
    },
    /// The run on which a prediction is checked cannot be used.
    #[error("validation run: {source}")]
    InValidation {
        /// What is wrong with it.
        source: Box<Error>,
    },
    /// The caller asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// Result with the core's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// A quantity that must satisfy `expected`.
    pub fn quantity(quantity: &str, value: f64, unit: &'static str, expected: &str) -> Self {
        Self::Quantity { quantity: quantity.into(), value, unit, expected: expected.into() }
    }

    /// Something that cannot be done, with the way out.
    pub fn unusable(problem: impl Into<String>, fix: impl Into<String>) -> Self {
        Self::Unusable { problem: problem.into(), fix: fix.into() }
    }
}
