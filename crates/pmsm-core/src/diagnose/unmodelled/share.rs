//! What a map takes away, of the model that is in the answer and by the figures that the answer gives.

use crate::diagnose::data::Data;
use crate::diagnose::each;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::transfer::transfer;
use crate::error::Result;
use crate::experiment::Channel;
use crate::experiment::floor::Floor;
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

/// Squares of measured minus predicted, as the answer's table of the fit has them, over the floor's and beyond one, summed over channels.
fn excess(data: &Data, model: &Hypothesis) -> f64 {
    let experiment = data.whole(model);
    let predicted = experiment.predict(&model.parameters);
    let square = |(channel, predicted): (&Channel, &Vec<f64>)| {
        let floor = data.floors.iter().find(|f| f.channel == *channel).map_or(f64::INFINITY, Floor::total);
        let rms = each::rms(&experiment.measured(*channel), predicted);
        ((rms / floor).powi(2) - 1.0).max(0.0)
    };
    experiment.channels().iter().zip(&predicted).map(square).sum()
}
