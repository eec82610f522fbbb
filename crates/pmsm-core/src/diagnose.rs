//! Diagnosis: what does the model of this machine leave out?
//!
//! The bare machine is fitted, what it leaves is located, every effect of the catalogue is scored on it, the most promising
//! ones are refitted by simulation, alone and together, and judged on samples that were not used for fitting. What
//! explains everything down to the noise is named; what several effects explain is ambiguous; what none explains is
//! unknown, and still located.

mod able;
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
mod reversals;
pub mod search;
pub mod shortlist;
#[cfg(test)]
mod testing;
mod ties;
mod turns;
pub mod unmodelled;
pub mod verdict;

use crate::error::Result;
use crate::experiment::Channel;
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
/// Rounds in which the bare machine and the noise of its voltages are estimated from one another, and how far (ln) its inductances may
/// be from those that the noise was estimated with.
const SETTLING: usize = 5;
const AWAY: f64 = 0.005;
/// Share of the speed's excess that may be left where voltages held in the stator's frame explain it, and that down to the noise: it has no
/// free parameter.
const STATOR_HELD: f64 = 0.25;
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
    base = settle_hold(&mut whole, base, monitor)?;
    if turns::settle(&mut whole, &base) {
        base = refit(&whole, &base, monitor)?;
    }
    let mut others = Vec::new();
    if let Some(recording) = validation {
        let mut data = Data::new(Signals::new(recording, machine)?, machine)?;
        if whole.signals.stator_held {
            data.hold_in_stator();
        }
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
    let mut found = hypothesis::fit(data, &model, &start, false, monitor)?;
    for _ in 0..SETTLING {
        data.settle_floors(&found);
        found = hypothesis::fit(data, &model, found.own(), false, monitor)?;
        if data.away(&found) < AWAY || monitor.cancelled() {
            break;
        }
    }
    Ok(found)
}

/// Fits the bare machine once more with voltages held in the stator's frame, and stays with it if that alone explains the motion.
fn settle_hold(data: &mut Data, found: Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let before = found.square(Channel::OmegaE) - 1.0;
    // Without a speed or without voltages there is nothing to compare; false for NaN, too.
    let open = before > verdict::UNEXPLAINED.1 && data.has(true) && !monitor.cancelled();
    if !open || data.runs().iter().any(|run| run.signals.v.is_none()) {
        return Ok(found);
    }
    let mut tried = data.clone();
    tried.hold_in_stator();
    let held = hypothesis::fit(&tried, &found.model, found.own(), false, monitor)?;
    let left = held.square(Channel::OmegaE) - 1.0;
    if left > (STATOR_HELD * before).min(verdict::UNEXPLAINED.1) {
        return Ok(found);
    }
    tried.signals.findings.push(Finding {
        finding: "the voltages act as if they were held in the stator's frame over each control period"
            .into(),
        consequence: "the mean current, and so the torque, between two samples is corrected for it".into(),
        fix: "nothing is wrong; log mean currents, or sample faster, to be free of it".into(),
    });
    tried.settle_floors(&held);
    *data = tried;
    refit(data, &held, monitor)
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
    // What only generalises an effect is compared with it closely, sample for sample.
    let mut swaps = found.swaps;
    for swap in &mut swaps {
        if swap.by.is_some_and(|wide| decide::generalises(wide, swap.replaced)) {
            swap.judged.fitted = refit(data, &swap.judged.fitted, monitor)?;
        }
    }
    path[0] = whole.clone();
    path[last] = if last == 0 { whole.clone() } else { best.clone() };
    Ok(Outcome { base: whole, best, path, swaps, ..found })
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
    use super::testing::{choice, setup, speeds};
    use super::*;
    use crate::drive::{Choice, Schedule, Shape, simulate};
    use crate::machine::BaseParameter;
    use crate::monitor::Silent;
    use crate::random::normal_pair;
    use crate::whitening::Whitening;

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

    /// Three reversals under a load that steps at 0.55 s.
    fn stepping(effects: Vec<Choice>) -> Answer {
        let mut manoeuvre =
            speeds(2.0, &[(0.1, 60.0), (0.5, -60.0), (1.0, -40.0), (1.3, 70.0), (1.7, -50.0)]);
        let steps = vec![(0.0, 0.4), (0.55, 1.2)];
        manoeuvre.i_d = Some(Schedule::new(vec![(0.0, 0.0), (0.3, -4.0), (1.4, 2.0)], Shape::Steps).unwrap());
        manoeuvre.tau_load = Some(Schedule::new(steps, Shape::Steps).unwrap());
        let setup = setup(manoeuvre, effects);
        let recording = simulate(&setup, &Silent).unwrap().recording;
        diagnose(&[&recording], &setup.nameplate, None, &Silent).unwrap()
    }

    fn steps(answer: &Answer) -> usize {
        answer.model.base.keys().filter(|k| k.starts_with("t_load")).count()
    }

    #[test]
    fn friction_is_not_taken_for_a_load_that_steps_at_every_reversal() {
        let answer = stepping(vec![choice("coulomb_friction", "tau_c", 0.15)]);
        assert_eq!(answer.verdict, Verdict::Named, "{:?}", answer.model);
        assert_eq!(answer.model.effects, ["coulomb_friction"]);
        // One step there is; of a weak one more the noise may persuade, of three more at the reversals not.
        assert!(steps(&answer) <= 2, "{:?}", answer.model.base);
        assert_eq!(answer.located[0].equation, "mechanical");
        assert!(answer.fit.recording.before["omega_e"] > 2.0 * answer.fit.recording.after["omega_e"]);
    }

    #[test]
    fn friction_that_load_steps_hide_down_to_the_noise_is_still_asked_about() {
        // With a step at each reversal the bare machine leaves nothing.
        let answer = stepping(vec![choice("coulomb_friction", "tau_c", 0.02)]);
        assert_eq!(answer.model.effects, ["coulomb_friction"], "{:?}", answer.verdict);
    }

    #[test]
    fn a_load_that_steps_is_not_taken_for_friction() {
        let answer = stepping(Vec::new());
        assert_eq!(answer.verdict, Verdict::NoMismatch, "{:?}", answer.model);
    }

    #[test]
    fn noise_of_the_voltages_does_not_bend_the_inductances() {
        // A quarter of a per cent of the link voltage, with which plain least squares make l_q a tenth too large.
        const NOISE: f64 = 1.4;
        let mut manoeuvre = speeds(1.1, &[(0.1, 80.0), (0.5, -60.0), (0.9, 90.0)]);
        let steps = (0..10).map(|k| (0.1 * f64::from(k), [-4.0, 3.0][k as usize % 2])).collect();
        manoeuvre.i_d = Some(Schedule::new(steps, Shape::Steps).unwrap());
        let setup = setup(manoeuvre, Vec::new());
        let recording = simulate(&setup, &Silent).unwrap().recording;
        let mut signals = Signals::new(&recording, &setup.nameplate).unwrap();
        let noise = |k: usize| normal_pair(3, [k as u32, 0, 0, 0]);
        let [v_d, v_q] = signals.v.as_mut().unwrap();
        for k in 0..v_d.len() {
            v_d[k] += NOISE * noise(k).0;
            v_q[k] += NOISE * noise(k).1;
        }
        let mut data = Data::new(signals, &setup.nameplate).unwrap();
        let base = fit_base(&mut data, &Silent).unwrap();
        assert!((data.input.voltage / NOISE - 1.0).abs() < 0.05, "{}", data.input.voltage);
        for l in [BaseParameter::LD, BaseParameter::LQ] {
            let ratio = base.own()[l.index()] / setup.nameplate.get(l).unwrap();
            assert!((ratio - 1.0).abs() < 0.05, "{} {ratio}", l.name());
        }
        assert!(verdict::largest_excess(&base) < verdict::MISMATCH);
    }

    #[test]
    fn the_noise_of_a_torque_sensor_is_no_mismatch() {
        const NOISE: f64 = 0.2;
        let mut manoeuvre = speeds(1.1, &[(0.1, 80.0), (0.5, -60.0), (0.9, 90.0)]);
        manoeuvre.tau_load = Some(Schedule::new(vec![(0.0, 0.5)], Shape::Steps).unwrap());
        manoeuvre.load_kind = Some("measured".into());
        let setup = setup(manoeuvre, Vec::new());
        let recording = simulate(&setup, &Silent).unwrap().recording;
        let mut signals = Signals::new(&recording, &setup.nameplate).unwrap();
        for (k, load) in signals.tau_m.as_mut().unwrap().iter_mut().enumerate() {
            *load += NOISE * normal_pair(7, [k as u32, 0, 0, 0]).0;
        }
        let mut data = Data::new(signals, &setup.nameplate).unwrap();
        let base = fit_base(&mut data, &Silent).unwrap();
        let speed = data.floors.iter().find(|f| f.channel == Channel::OmegaE).unwrap();
        assert!(speed.driven > 0.5 * speed.sensor, "{speed:?}");
        let square = base.square(speed.channel);
        assert!((square - 1.0).abs() < verdict::MISMATCH, "{square}");
    }

    #[test]
    fn derivatives_follow_the_filter_that_whitens() {
        let setup = setup(speeds(0.6, &[(0.1, 80.0), (0.5, -60.0)]), Vec::new());
        let (mut data, base) = testing::data(&setup);
        data.input.voltage = 6.0;
        let l = [BaseParameter::LD, BaseParameter::LQ].map(|l| base.own()[l.index()]);
        data.whitening = Some(Whitening::new(&data.signals, base.own()[0], l, [0.05; 2], &data.input));
        let experiment = data.whole(&base);
        let free = [BaseParameter::LD.index(), BaseParameter::LQ.index()];
        let linear = experiment.linearise(&base.parameters, &free);
        for (column, index) in free.into_iter().enumerate() {
            let at = |x: f64| {
                let mut p = base.parameters.clone();
                p[index] *= x;
                experiment.residual(&p)
            };
            let step = 1e-4;
            let secant = (at(1.0 + step) - at(1.0 - step)) / (2.0 * step * base.parameters[index]);
            let off = (&secant - linear.jacobian.column(column)).norm() / secant.norm();
            assert!(off < 0.01, "{index}: {off}");
        }
    }
}
