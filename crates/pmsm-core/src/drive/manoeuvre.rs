//! What the drive is made to do: references, load, temperatures, start.

use super::schedule::Schedule;
use crate::error::{Error, Result};
use crate::recording::Load;
use serde::{Deserialize, Serialize};

/// What the drive is made to do. References are read at each sample; load and temperatures in the middle of the period that
/// follows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manoeuvre {
    /// Length of the recording, s.
    pub duration: f64,
    /// Time that passes before the recording starts, with every schedule at its value for t = 0, s.
    #[serde(default)]
    pub settle: f64,
    /// Speed reference, mechanical rad/s. Without one the currents are controlled alone.
    #[serde(default)]
    pub omega_m: Option<Schedule>,
    /// Reference of i_d, A.
    #[serde(default)]
    pub i_d: Option<Schedule>,
    /// Reference of i_q where no speed is controlled, else added to the speed controller's, A.
    #[serde(default)]
    pub i_q: Option<Schedule>,
    /// Load torque, which opposes positive speed, N·m.
    #[serde(default)]
    pub tau_load: Option<Schedule>,
    /// What the recording knows of the load; see [`Manoeuvre::load`].
    #[serde(default)]
    pub load_kind: Option<String>,
    /// Winding temperature, °C; logged.
    #[serde(default)]
    pub temperature: Option<Schedule>,
    /// Magnet temperature, °C; logged.
    #[serde(default)]
    pub temperature_magnet: Option<Schedule>,
    /// Electrical angle at the start, rad.
    #[serde(default)]
    pub start_theta_e: f64,
    /// Mechanical speed at the start, rad/s.
    #[serde(default)]
    pub start_omega_m: f64,
}

impl Manoeuvre {
    /// Standstill without load for `duration` seconds.
    pub fn new(duration: f64) -> Self {
        Self {
            duration,
            settle: 0.0,
            omega_m: None,
            i_d: None,
            i_q: None,
            tau_load: None,
            load_kind: None,
            temperature: None,
            temperature_magnet: None,
            start_theta_e: 0.0,
            start_omega_m: 0.0,
        }
    }

    /// What the recording knows of the load: `load_kind` by its name in a machine file; left out, it is none without
    /// `tau_load`, and else unknown: constant, or piecewise where it changes.
    ///
    /// # Errors
    /// [`Error::Unknown`] for a name that does not exist; [`Error::Unusable`] where it contradicts `tau_load`.
    pub fn load(&self) -> Result<Load> {
        let single = self.tau_load.as_ref().map_or(Some(0.0), Schedule::single);
        let Some(kind) = &self.load_kind else {
            return Ok(match (&self.tau_load, single) {
                (None, _) => Load::None,
                (_, Some(_)) => Load::UnknownConstant,
                _ => Load::UnknownPiecewise,
            });
        };
        let contradiction = |problem: &str, fix: &str| Err(Error::unusable(problem, fix));
        match Load::parse(kind, single.or(Some(0.0)))? {
            Load::None if single != Some(0.0) => {
                contradiction("there is a load torque although the load is said to be none", "leave one out")
            }
            Load::KnownConstant(_) | Load::UnknownConstant if single.is_none() => contradiction(
                "the load torque changes although it is said to be constant",
                "say unknown_piecewise or measured",
            ),
            Load::Locked if self.omega_m.is_some() || self.start_omega_m != 0.0 => {
                contradiction("a locked rotor has no speed to control", "give references of i_d and i_q")
            }
            load => Ok(load),
        }
    }
}
