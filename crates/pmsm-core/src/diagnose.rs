//! Diagnosis: what does the model of this machine leave out?
//!
//! The bare machine is fitted, what it leaves is located, every effect of the catalogue is scored on it, the most promising
//! ones are refitted by simulation, alone and together, and judged on samples that were not used for fitting. What
//! explains everything down to the noise is named; what several effects explain is ambiguous; what none explains is
//! unknown, and still located.

mod agree;
pub mod answer;
mod conclude;
pub mod data;
mod decide;
mod each;
pub mod hypothesis;
pub mod join;
pub mod locate;
mod motion;
mod outputs;
mod power;
mod prescribe;
pub mod search;
pub mod shortlist;
#[cfg(test)]
mod testing;
mod turns;
pub mod unmodelled;
pub mod verdict;

use crate::error::Result;
use crate::least_squares;
use crate::machine::Machine;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::recording::Recording;
use crate::signals::{Finding, Signals};
use answer::Answer;
use data::Data;
use hypothesis::Hypothesis;
use search::{Outcome, Search};

/// Fewest mechanical windows from which every other one is held out where no validation run is given.
const FEWEST_WINDOWS: usize = 4;
/// Share of the voltages' noise, as the bare machine sees it, below which a better model must bring it to be believed.
const QUIETER: f64 = 0.93;
/// Signals must exceed their noise by this factor for anything to be said.
const LEAST_SIGNAL: f64 = 5.0;
/// Relative standard error of an electrical base parameter, from the sensors' noise alone, from which the recording is
/// called poor.
const POOR: f64 = 0.01;

/// Diagnoses a machine from `recordings`, all of which are fitted together, and an optional `validation` run on which nothing is
/// estimated but initial values and an unknown load.
///
/// # Errors
/// Those of [`join::prepare`] and [`Signals::new`], [`crate::start::values`] and the least-squares fits. An interruption through `monitor` is no error: the
/// answer then rests on what had been tried.
pub fn diagnose(
    recordings: &[&Recording],
    machine: &Machine,
    validation: Option<&Recording>,
    monitor: &dyn Monitor,
) -> Result<Answer> {
    monitor.report("bare machine", 0.0);
    let mut whole = join::prepare(recordings, machine)?;
    if let Some(finding) = silent(&whole) {
        return Ok(conclude::undetermined(&whole, finding));
    }
    let mut base = fit_base(&mut whole, monitor)?;
    if turns::settle(&mut whole, &base) {
        base = refit(&whole, &base, monitor)?;
    }
    let mut others = Vec::new();
    if let Some(recording) = validation {
        let mut data = Data::new(Signals::new(recording, machine)?, machine)?;
        let transferred = hypothesis::transfer(&data, &base, monitor)?;
        data.settle_floors(&transferred);
        others.push(data);
    }
    let weak = weak_parameters(&whole, &base);
    monitor.report("bare machine", 0.1);
    let mut outcome = search(&whole, &others, &base, weak.is_empty(), monitor)?;
    if settled_anew(&mut whole, &mut others, &outcome) && !monitor.cancelled() {
        base = refit(&whole, &base, monitor)?;
        outcome = search(&whole, &others, &base, weak.is_empty(), monitor)?;
    }
    monitor.report("answer", 0.97);
    let judge = others.last().filter(|_| validation.is_some());
    conclude::conclude(&whole, judge, outcome, &weak, monitor)
}

/// Searches for the effects, held against the other recordings or against every other window of this one.
fn search(
    whole: &Data,
    others: &[Data],
    base: &Hypothesis,
    rich: bool,
    monitor: &dyn Monitor,
) -> Result<Outcome> {
    // Half a recording may not pin down what the whole does: where the bare machine fits the whole, nothing is wrong with it.
    let split = others.is_empty() && rich && verdict::largest_excess(base) > verdict::MISMATCH;
    let split = split.then(|| halves(whole)).flatten();
    if let Some((fitted, held_out)) = &split {
        let start = refit(fitted, base, monitor)?;
        let searched = Search {
            data: fitted,
            held_out: vec![held_out],
            refuting: Vec::new(),
            most: search::MOST,
            monitor,
        }
        .run(start)?;
        return on_whole(whole, searched, base, monitor);
    }
    if rich {
        let held_out = others.iter().collect();
        return Search { data: whole, held_out, refuting: Vec::new(), most: search::MOST, monitor }
            .run(base.clone());
    }
    // What a poor recording leaves open a second one must not be held against it, unless it makes nonsense of that one.
    let bare = |data| Ok((data, hypothesis::transfer(data, base, monitor)?));
    let refuting = others.iter().map(bare).collect::<Result<Vec<_>>>()?;
    Search { data: whole, held_out: Vec::new(), refuting, most: 1, monitor }.run(base.clone())
}

/// Measures noise on the voltages once more with the help of what was found, and says whether part of it was physics.
fn settled_anew(whole: &mut Data, others: &mut [Data], outcome: &Outcome) -> bool {
    let best = &outcome.best;
    if whole.input.voltage == 0.0 || best.fitted.effects().is_empty() {
        return false;
    }
    let mut again = whole.clone();
    again.settle_floors(&best.fitted);
    if again.input.voltage > QUIETER * whole.input.voltage {
        return false;
    }
    *whole = again;
    for (data, found) in others.iter_mut().zip(&best.held_out) {
        data.settle_floors(found);
    }
    true
}

/// Fits the bare machine and settles the noise floors with its help.
fn fit_base(data: &mut Data, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let model = Model::new(data.signals.context, &[]);
    let start = data.start.to_vec();
    let rough = hypothesis::fit(data, &model, &start, false, monitor)?;
    data.settle_floors(&rough);
    hypothesis::fit(data, &model, rough.own(), false, monitor)
}

fn refit(data: &Data, from: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    hypothesis::fit(data, &from.model, from.own(), false, monitor)
}

/// The recording split into windows of which every other one is held out, and the complement.
fn halves(data: &Data) -> Option<(Data, Data)> {
    if data.windows.len() < FEWEST_WINDOWS {
        return None;
    }
    let mut odd = vec![false; data.signals.len()];
    for run in 0..data.runs().len() {
        let samples = data.samples_of(run);
        let own = data.windows.iter().filter(|w| samples.contains(&w.start));
        for window in own.skip(1).step_by(2) {
            odd[window.clone()].fill(true);
        }
    }
    let even = odd.iter().map(|x| !x).collect();
    Some((data.masked(odd), data.masked(even)))
}

/// Fits what a search on half the samples found to all of them.
fn on_whole(data: &Data, found: Outcome, base: &Hypothesis, monitor: &dyn Monitor) -> Result<Outcome> {
    let mut best = found.best;
    if !best.fitted.effects().is_empty() {
        best.fitted = refit(data, &best.fitted, monitor)?;
    }
    let bare = best.fitted.effects().is_empty();
    if bare {
        best.fitted = base.clone();
    }
    let mut whole = found.base;
    whole.fitted = base.clone();
    let mut path = found.path;
    let last = path.len() - 1;
    for judged in &mut path[1..last.max(1)] {
        judged.fitted = refit(data, &judged.fitted, monitor)?;
    }
    path[0] = whole.clone();
    path[last] = if last == 0 { whole.clone() } else { best.clone() };
    Ok(Outcome { base: whole, best, path, ..found })
}

/// A finding if currents, voltages or speed hardly leave their noise in any recording.
fn silent(data: &Data) -> Option<Finding> {
    (!data.runs().iter().any(is_alive)).then(|| Finding {
        finding: "no recorded signal leaves its own noise".into(),
        consequence: "nothing can be said about the machine".into(),
        fix: "record a manoeuvre: reversals, two levels of i_q, steps of i_d".into(),
    })
}

fn is_alive(data: &Data) -> bool {
    let spread = |x: &[f64]| {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let square = x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64;
        square.sqrt().max((square - mean * mean).max(0.0).sqrt())
    };
    let model = Model::new(data.signals.context, &[]);
    let hypothesis = Hypothesis::bare(model, data.start.to_vec());
    let experiment = data.whole(&hypothesis);
    data.floors.iter().any(|f| spread(&experiment.measured(f.channel)) > LEAST_SIGNAL * f.sensor)
}

/// Electrical base parameters that the recording does not pin down although its equations contain them.
fn weak_parameters(data: &Data, base: &Hypothesis) -> Vec<String> {
    let experiment = data.whole(base);
    let free: Vec<usize> = base.free.iter().copied().filter(|k| *k < 4).collect();
    if free.is_empty() {
        return Vec::new();
    }
    let linear = experiment.linearise(&base.parameters, &free);
    let information = linear.jacobian.tr_mul(&linear.jacobian);
    let covariance = least_squares::covariance(&information, None, &vec![true; free.len()]);
    let names = crate::machine::BaseParameter::ALL;
    free.iter()
        .enumerate()
        .filter(|(column, index)| {
            let value = base.parameters[**index].abs();
            // A parameter that changes nothing at all (a magnet at standstill) is no lack of the manoeuvre.
            let matters = linear.jacobian.column(*column).norm() * value > 3.0;
            matters && covariance[(*column, *column)].sqrt() > POOR * value
        })
        .map(|(_, index)| names[*index].name().to_string())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::answer::Verdict;
    use super::testing::{setup, speeds};
    use super::*;
    use crate::drive::simulate;
    use crate::monitor::Silent;

    #[test]
    fn short_clean_recordings_without_validation_accuse_nobody() {
        for seed in 1..=5 {
            let mut setup = setup(speeds(1.1, &[(0.1, 80.0), (0.5, -60.0), (0.9, 90.0)]), Vec::new());
            setup.seed = seed;
            let recording = simulate(&setup, &Silent).unwrap().recording;
            let answer = diagnose(&[&recording], &setup.nameplate, None, &Silent).unwrap();
            assert_eq!(answer.verdict, Verdict::NoMismatch, "seed {seed}: {:?}", answer.model);
        }
    }
}
