//! Logs with a mistake, for the tests of what is told of them.

use super::mistakes::Columns;
use crate::diagnose::testing::{setup, speeds};
use crate::drive::{Choice, Schedule, Shape, simulate};
use crate::machine::Machine;
use crate::monitor::Silent;
use crate::recording::Recording;

/// A recording with its nameplate, in which `make` has made a mistake; against a `load` (N·m) that the log states, if one is given.
pub(super) fn recorded(
    effects: Vec<Choice>,
    load: Option<f64>,
    make: impl Fn(&mut Columns),
) -> (Recording, Machine) {
    let mut manoeuvre = speeds(0.8, &[(0.1, 80.0), (0.3, -60.0), (0.5, 90.0), (0.7, -80.0)]);
    let steps = (0..8).map(|k| (0.1 * f64::from(k), [-4.0, 3.0][k as usize % 2])).collect();
    manoeuvre.i_d = Some(Schedule::new(steps, Shape::Steps).unwrap());
    if let Some(load) = load {
        manoeuvre.tau_load = Some(Schedule::constant(load).unwrap());
        manoeuvre.load_kind = Some("known_constant".into());
    }
    let setup = setup(manoeuvre, effects);
    let whole = simulate(&setup, &Silent).unwrap().recording;
    let names = ["t", "v_d", "v_q", "i_a", "i_b", "i_c", "theta_e", "omega_e"];
    let mut columns: Columns =
        names.into_iter().filter_map(|name| Some((name, whole.column(name)?.to_vec()))).collect();
    make(&mut columns);
    let columns = columns.into_iter().map(|(name, x)| (name.to_string(), x)).collect();
    (Recording::new(columns, Some(whole.load())).unwrap(), setup.nameplate)
}
