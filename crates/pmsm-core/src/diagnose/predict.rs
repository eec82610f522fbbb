//! What a model that was found says of another recording.

use super::answer::Columns;
use super::data::Data;
use super::hypothesis::Hypothesis;
use super::join;
use super::options::DiagnosisOptions;
use super::transfer::transfer;
use crate::error::{Error, Result};
use crate::machine::Machine;
use crate::monitor::Monitor;
use crate::recording::{Kind, Recording};
use crate::signals::Signals;
use crate::specification::Specification;

/// How far a prediction looks ahead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Horizon {
    /// Free run: currents over the whole recording from their first values, the speed over windows of 0.25 s from one estimated value.
    FreeRun,
    /// From each sample to the next.
    OneStep,
}

/// Predicts a recording: `t`, and for each channel that the recording shows and the model holds for `NAME_measured` and `NAME_model`. Nothing is
/// estimated but initial values, an unknown load, and the turn in which the recording begins. `machine` tells how the recording is read.
///
/// One step ahead the speed goes on from the measured one by what the model's free run gains.
///
/// # Errors
/// Those of [`Specification::model`] and [`Signals::new`]; [`Error::Unusable`] where the recording shows nothing that the model holds for.
pub fn predict(
    recording: &Recording,
    machine: &Machine,
    specification: &Specification,
    horizon: Horizon,
    monitor: &dyn Monitor,
) -> Result<Columns> {
    let (model, p) = specification.model()?;
    if f64::from(machine.n_p) != model.context().n_p {
        return Err(Error::unusable(
            format!(
                "the model has {} pole pairs and the recording's machine {}",
                model.context().n_p,
                machine.n_p
            ),
            "read the recording with the machine of the model",
        ));
    }
    let new = recording.rows_with_new_values();
    let mut signals = join::read(new.as_ref().unwrap_or(recording), machine, None)?;
    let reading = specification.reading;
    match (signals.kind, reading.electrical, reading.mechanical) {
        (Kind::Full, false, true) => signals.kind = Kind::Mechanical,
        (Kind::Full, true, false) => signals.kind = Kind::Electrical,
        _ => {}
    }
    let shown = match signals.kind {
        Kind::Mechanical => reading.mechanical,
        Kind::Full => reading.electrical || reading.mechanical,
        Kind::Electrical | Kind::OperatingPoints | Kind::OpenCircuit => reading.electrical,
    };
    if !shown {
        return Err(Error::unusable(
            "this recording shows nothing that the model holds for",
            "give one with the columns of the recording that it was found on",
        ));
    }
    if reading.middle_of_steps {
        signals.to_middle_of_steps();
    }
    signals.read_as(reading.voltages_drawn, reading.current_filter);
    let start = specification.machine()?;
    let mut data = Data::new(signals, &start, &DiagnosisOptions::default())?;
    if let Some(logged) = reading.stator_held {
        data.hold_in_stator(logged);
    }
    let found = Hypothesis::unfitted(model, p);
    let near = transfer(&data, &found, monitor)?;
    data.settle_floors(&near);
    let there = transfer(&data, &found, monitor)?;
    let mut columns = seen(&data, &there);
    if horizon == Horizon::OneStep {
        one_step(&data, &there, &mut columns);
    }
    Ok(columns)
}

fn seen(data: &Data, there: &Hypothesis) -> Columns {
    let whole = data.whole(there);
    let model = whole.predict(&there.parameters);
    let mut columns = Columns::from([("t".into(), data.signals.t.clone())]);
    for (channel, x) in whole.channels().iter().zip(model) {
        columns.insert(format!("{}_measured", channel.name()), whole.measured(*channel));
        columns.insert(format!("{}_model", channel.name()), x);
    }
    columns
}

/// Puts predictions from each sample to the next in place of the free run.
fn one_step(data: &Data, there: &Hypothesis, columns: &mut Columns) {
    if data.is_steady() {
        // Each point is a prediction of its own.
        return;
    }
    let currents = ["i_d_model", "i_q_model"];
    for odd in [1, 0] {
        let mut pairs = data.clone();
        cut(&mut pairs.signals, odd);
        let again = seen(&pairs, there);
        for name in currents {
            let (Some(model), Some(ahead)) = (columns.get_mut(name), again.get(name)) else { continue };
            for k in pairs.signals.segments.iter().flat_map(|segment| segment.clone().skip(1)) {
                model[k] = ahead[k];
            }
        }
    }
    for (name, measured) in currents.into_iter().zip(["i_d_measured", "i_q_measured"]) {
        let Some(measured) = columns.get(measured).cloned() else { continue };
        if let Some(model) = columns.get_mut(name) {
            data.signals.segments.iter().for_each(|segment| model[segment.start] = measured[segment.start]);
        }
    }
    if let Some(free) = columns.get("omega_e_model").cloned() {
        let measured = columns["omega_e_measured"].clone();
        let model = columns.get_mut("omega_e_model").expect("the channel is there");
        for window in &data.windows {
            model[window.start] = measured[window.start];
            for k in window.clone().skip(1) {
                model[k] = measured[k - 1] + (free[k] - free[k - 1]);
            }
        }
    }
}

/// Cuts each segment into pairs of samples, beginning with its first sample or with its second.
fn cut(signals: &mut Signals, odd: usize) {
    let pairs = |s: &std::ops::Range<usize>| {
        let end = s.end;
        (s.start + odd..end.saturating_sub(1)).step_by(2).map(|k| k..k + 2).collect::<Vec<_>>()
    };
    signals.segments = signals.segments.iter().flat_map(pairs).collect();
}
