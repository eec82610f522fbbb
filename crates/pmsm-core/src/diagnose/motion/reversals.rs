//! Steps of an unknown load where the rotor reverses: a friction whose torque jumps there does the same.

use super::state::{State, states_of};
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::load_steps;

/// What was found, under a load without those steps at which the speed changes its sign, and the friction (N·m) that does what they did; `None`
/// where no step is there, or where they would drive the rotor.
pub fn without_reversals(data: &Data, found: &Hypothesis) -> Option<(Hypothesis, f64)> {
    let mut states = states_of(&found.nuisances, &found.parameters[found.own().len()..]);
    let mut heights = Vec::new();
    for (state, part) in states.iter_mut().zip(data.runs()) {
        let duration = part.signals.context.duration;
        let near = load_steps::closest(duration);
        let (t, omega) = (&part.signals.t, &part.signals.omega_e);
        let speed = |time: f64| omega[t.partition_point(|x| *x < time).min(t.len() - 1)];
        let mut keep = Vec::new();
        for (at, step) in state.steps.iter().enumerate() {
            let (before, behind) = (speed(step - near), speed(step + near));
            if before * behind < 0.0 {
                heights.push(0.5 * (state.levels[at + 1] - state.levels[at]) * behind.signum());
            } else {
                keep.push(at);
            }
        }
        *state = state.clone().with_steps(&keep, duration);
    }
    let height = heights.iter().sum::<f64>() / heights.len() as f64;
    // Not a number where there are none.
    if height.is_nan() || height <= 0.0 {
        return None;
    }
    let mut parameters = found.own().to_vec();
    parameters.extend(states.iter().flat_map(State::values));
    let nuisances = states.iter().map(State::nuisance).collect();
    Some((Hypothesis { parameters, nuisances, ..found.clone() }, height))
}
