//! What is known of the load of a recording.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

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
    /// From `kind` and `value` of a machine file.
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

    /// The name of this kind in a machine file.
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
