//! What a map takes away, of the model that is in the answer and by the figures that the answer gives.

use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::transfer::transfer;
use crate::error::Result;
use crate::monitor::Monitor;

/// Share of the squares above the floors, over all channels, that `after` takes away of what `before` leaves: on the validation run, or on
/// the recording itself without one.
///
/// # Errors
/// Those of the least-squares fits.
pub fn taken_away(
    data: &Data,
    judge: Option<&Data>,
    before: &Hypothesis,
    after: &Hypothesis,
    monitor: &dyn Monitor,
) -> Result<f64> {
    let (more, less) = match judge {
        Some(judge) => {
            let on = |model: &Hypothesis| Ok(excess(judge, &transfer(judge, model, monitor)?));
            let (more, less): (Result<f64>, Result<f64>) = rayon::join(|| on(before), || on(after));
            (more?, less?)
        }
        None => (excess(data, before), excess(data, after)),
    };
    Ok(if more > 0.0 { 1.0 - less / more } else { 0.0 })
}

/// Squares of the residual as it is, over the floor's and beyond one, summed over channels.
fn excess(data: &Data, model: &Hypothesis) -> f64 {
    let experiment = data.whole(model).plain();
    let rms = experiment.relative_rms(&experiment.residual(&model.parameters));
    rms.into_iter().map(|rms| (rms * rms - 1.0).max(0.0)).sum()
}
