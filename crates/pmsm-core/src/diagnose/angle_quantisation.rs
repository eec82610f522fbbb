//! Quantisation of the rotor angle: whether a logged step is its lower end, as a counter counts, or its middle. Taking the wrong one is
//! an angle error of half a step.

use super::baseline;
use super::data::Data;
use super::hypothesis::Hypothesis;
use super::verdict;
use crate::error::Result;
use crate::monitor::Monitor;

/// Takes the angle as the lower end of its steps, and fits the dq-model so, if that lowers the excess. Says whether it does.
///
/// # Errors
/// Those of the least-squares fits.
pub fn select(data: &mut Data, base: &mut Hypothesis, monitor: &dyn Monitor) -> Result<bool> {
    let stepped = |run: &Data| {
        run.has_electrical() && run.signals.phase_currents && run.signals.limits.angle_step > 0.0
    };
    if !data.runs().iter().any(stepped) {
        return Ok(false);
    }
    let mut counted = data.clone();
    to_middle(&mut counted);
    let found = baseline::fit(&mut counted, monitor)?;
    let better = verdict::excess(&found) < verdict::excess(base);
    if better {
        (*data, *base) = (counted, found);
    }
    Ok(better)
}

/// Moves the angle of all recordings from the lower end of its steps to the middle.
pub fn to_middle(data: &mut Data) {
    data.signals.to_middle_of_steps();
    data.parts.iter_mut().for_each(|part| part.signals.to_middle_of_steps());
}
