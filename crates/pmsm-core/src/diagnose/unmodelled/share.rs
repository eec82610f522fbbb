//! The share of the excess that a map explains, by the model and the figures of the answer.

use super::Side;
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::per_recording;
use crate::diagnose::transfer::transfer;
use crate::error::Result;
use crate::experiment::Channel;
use crate::experiment::floor::Floor;
use crate::monitor::Monitor;

/// Shares of the squares above the floors that a map takes away.
pub struct Taken {
    /// Over all channels.
    pub whole: f64,
    /// Over the channels of each of the sides that were asked about.
    pub sides: Vec<f64>,
}

/// What `after` takes away of what `before` leaves: on the validation run, or on the recording itself without one.
///
/// # Errors
/// Those of the least-squares fits.
pub fn taken_away(
    data: &Data,
    validation: Option<&Data>,
    (before, after): (&Hypothesis, &Hypothesis),
    sides: &[Side],
    monitor: &dyn Monitor,
) -> Result<Taken> {
    let (more, less) = match validation {
        Some(run) => {
            let on = |model: &Hypothesis| Ok(excesses(run, &data.floors, &transfer(run, model, monitor)?));
            let (more, less): (Result<Excesses>, Result<Excesses>) = rayon::join(|| on(before), || on(after));
            (more?, less?)
        }
        None => (excesses(data, &data.floors, before), excesses(data, &data.floors, after)),
    };
    let share = |shown: &dyn Fn(Channel) -> bool| {
        let of = |all: &Excesses| all.iter().filter(|(c, _)| shown(*c)).map(|(_, x)| x).sum::<f64>();
        if of(&more) > 0.0 { 1.0 - of(&less) / of(&more) } else { 0.0 }
    };
    let sides = sides.iter().map(|side| share(&|channel| side.shows(channel))).collect();
    Ok(Taken { whole: share(&|_| true), sides })
}

type Excesses = Vec<(Channel, f64)>;

/// Squares of measured minus predicted, as the answer's table of the fit has them, over those of the `floors` that the answer states, and
/// beyond one, of each channel.
fn excesses(data: &Data, floors: &[Floor], model: &Hypothesis) -> Excesses {
    let experiment = data.whole(model);
    let predicted = experiment.predict(&model.parameters);
    let square = |(channel, predicted): (&Channel, &Vec<f64>)| {
        let floor = floors.iter().find(|f| f.channel == *channel).map_or(f64::INFINITY, Floor::total);
        let rms = per_recording::rms(&experiment.measured(*channel), predicted);
        (*channel, ((rms / floor).powi(2) - 1.0).max(0.0))
    };
    experiment.channels().iter().zip(&predicted).map(square).collect()
}

#[cfg(test)]
mod tests {
    use super::super::explain;
    use super::*;
    use crate::diagnose::testing::{choice, data, setup, speeds};
    use crate::machine::BaseParameter;
    use crate::monitor::Silent;

    #[test]
    fn a_voltage_that_makes_the_currents_worse_does_not_hide_behind_a_torque() {
        let mut pulsating = choice("load_torque_pulsation", "a", 0.4);
        pulsating.parameters.insert("order_mech".into(), 1.0);
        let manoeuvre = speeds(2.0, &[(0.2, 60.0), (0.6, 100.0), (1.0, -40.0), (1.4, -90.0), (1.8, 70.0)]);
        let (data, base) = data(&setup(manoeuvre, vec![pulsating]));
        let mut fitted = explain(&data, None, &base, &Silent).unwrap().0;
        fitted.parameters[BaseParameter::RS.index()] *= 1.02;
        let sides = [Side::Electrical, Side::Mechanical];
        let taken = taken_away(&data, None, (&base, &fitted), &sides, &Silent).unwrap();
        assert!(taken.sides[0] <= 0.0 && taken.sides[1] > 0.9, "{:?}", taken.sides);
    }
}
