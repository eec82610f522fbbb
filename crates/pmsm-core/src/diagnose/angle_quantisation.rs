//! Which place of its step an angle in steps stands for: its lower end, as a counter tells it, or its middle. Half a step is an angle error
//! that no encoder has.

use super::baseline;
use super::data::Data;
use super::hypothesis::Hypothesis;
use super::verdict;
use crate::error::Result;
use crate::monitor::Monitor;

/// Takes the angle for the lower end of its steps where the bare machine leaves less of the currents then, and fits it so. Says whether it
/// does.
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

/// Takes the angle of all recordings for the lower end of its steps.
pub fn to_middle(data: &mut Data) {
    data.signals.to_middle_of_steps();
    data.parts.iter_mut().for_each(|part| part.signals.to_middle_of_steps());
}
