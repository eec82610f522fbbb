//! Which questions a recording can answer, from the columns that it holds.

use super::{Load, column_error};
use crate::error::Result;
use serde::Serialize;
use std::collections::BTreeMap;

/// Sample period from which a recording is a list of operating points rather than a waveform, s.
pub const OPERATING_POINT_PERIOD: f64 = 0.05;

/// Which questions a recording can answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Voltages, currents and speed: electrical and mechanical questions.
    Full,
    /// Voltages, currents and speed with the rotor held, or with an angle that was taken from the voltages.
    Electrical,
    /// Torque (or currents) and speed.
    Mechanical,
    /// Steady operating points, sampled far slower than any transient.
    OperatingPoints,
    /// Voltages induced in open terminals by a rotor that is turned from outside.
    OpenCircuit,
}

/// The kind that these columns make, sampled this often (s).
///
/// # Errors
/// [`crate::error::Error::Column`] where nothing can be learnt from them.
pub(super) fn of(columns: &BTreeMap<&'static str, Vec<f64>>, period: f64, load: Load) -> Result<Kind> {
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

/// Whether the voltages of both axes are zero throughout while currents flow.
pub(super) fn is_shorted(columns: &BTreeMap<&'static str, Vec<f64>>) -> bool {
    let dead = |name: &str| columns.get(name).is_some_and(|x| x.iter().all(|v| *v == 0.0));
    let alive = |name: &str| columns.get(name).is_some_and(|x| x.iter().any(|v| *v != 0.0));
    dead("v_d") && dead("v_q") && alive("i_d") && alive("i_q")
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
    use crate::recording::Recording;

    /// 20 rows of a sampled recording, a line in each column.
    fn ramps(names: &[&str], dt: f64) -> Vec<(String, Vec<f64>)> {
        names.iter().map(|n| ((*n).to_string(), (0..20).map(|k| f64::from(k) * dt).collect())).collect()
    }

    #[test]
    fn zero_currents_beside_voltages_say_that_the_terminals_are_open() {
        let mut given = ramps(&["t", "v_d", "v_q", "i_d", "i_q", "omega_e"], 1e-4);
        given[3].1.fill(0.0);
        given[4].1.fill(0.0);
        assert_eq!(Recording::new(given.clone(), None).unwrap().kind(), Kind::OpenCircuit);
        given[1].1.fill(0.0);
        given[2].1.fill(0.0);
        assert_eq!(Recording::new(given, None).unwrap().kind(), Kind::Full);
    }

    #[test]
    fn the_kind_follows_from_the_columns() {
        let pick = |names: &[&str], dt: f64, load| Recording::new(ramps(names, dt), load).map(|r| r.kind());
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
