//! Diagnosis: what does the model of this machine leave out?
//!
//! The bare machine is fitted, what it leaves is located, every effect of the catalogue is scored on it, the most promising
//! ones are refitted by simulation, alone and together, and judged on samples that were not used for fitting. What
//! explains everything down to the noise is named; what several effects explain is ambiguous; what none explains is
//! unknown, and still located.

mod able;
mod agree;
pub mod answer;
mod bare;
mod conclude;
pub mod data;
mod decide;
mod each;
mod fault;
mod fitting;
mod hold;
pub mod hypothesis;
pub mod join;
pub mod locate;
mod motion;
mod outputs;
mod plausible;
mod power;
mod prescribe;
mod reach;
mod reversals;
pub mod scale;
pub mod search;
pub mod shortlist;
#[cfg(test)]
mod testing;
mod ties;
mod torque_noise;
mod transfer;
mod turns;
pub mod unmodelled;
pub mod verdict;
mod wiring;

use crate::effect::Site;
use crate::error::{Error, Result};
use crate::machine::Machine;
use crate::monitor::Monitor;
use crate::recording::Recording;
use crate::signals::Signals;
use answer::{Answer, Verdict};
use data::Data;
use hold::Held;
use hypothesis::Hypothesis;
use search::{Outcome, Search};
use transfer::transfer;
use verdict::Judged;

/// What shows nearly everything.
const RICH: &str = "Record a rich manoeuvre: reversals, two levels of i_q, steps of i_d.";
/// Share of the voltages' noise, as the bare machine sees it, below which a better model must bring it to be believed.
const QUIETER: f64 = 0.93;

/// Diagnoses a machine from `recordings`, all of which are fitted together, and an optional `validation` run on which nothing is
/// estimated but initial values and an unknown load.
///
/// # Errors
/// [`Error::Unusable`] if the validation run is one of the recordings; those of [`join::prepare`] and [`Signals::new`],
/// [`crate::start::values`] and the least-squares fits. An interruption through `monitor` is no error: the answer then rests on what had
/// been tried.
pub fn diagnose(
    recordings: &[&Recording],
    machine: &Machine,
    validation: Option<&Recording>,
    monitor: &dyn Monitor,
) -> Result<Answer> {
    monitor.report("bare machine", 0.0);
    if validation.is_some_and(|run| recordings.iter().any(|recording| recording.same_samples(run))) {
        return Err(Error::unusable(
            "the validation run is the recording itself: it judges nothing",
            "give another run of the same machine, or none",
        ));
    }
    let mut whole = join::prepare(recordings, machine)?;
    if let Some(finding) = bare::silent(&whole) {
        return Ok(conclude::undetermined(&whole, finding, Some(RICH)));
    }
    let mut base = bare::fit(&mut whole, monitor)?;
    if let Some(finding) = bare::diverged(&base) {
        let mut answer = conclude::undetermined(&whole, finding, None);
        answer.data_quality.extend(wiring::suspected(recordings, machine, &base, monitor)?);
        return Ok(answer);
    }
    let mut others = Vec::new();
    if let Some(recording) = validation {
        others.push(Data::new(Signals::new(recording, machine)?, machine)?);
    }
    let mut settled = None;
    match hold::settle(&mut whole, &mut others, &base, &[], monitor)? {
        Held::InStator(held) => base = *held,
        Held::InRotor(theirs) => settled = Some(theirs),
        Held::Unasked => {}
    }
    if turns::settle(&mut whole, &base, monitor) {
        base = fitting::refit(&whole, &base, monitor)?;
        settled = None;
    }
    let weak = bare::weak_parameters(&whole, &base);
    whole.poor = !weak.is_empty() || reach::stays_at_one_point(&whole.signals);
    if let Some(settled) = settled {
        others = settled;
    } else {
        for data in &mut others {
            let transferred = transfer(data, &base, monitor)?;
            data.settle_floors(&transferred);
        }
    }
    if whole.poor && verdict::largest_excess(&base) > verdict::MISMATCH {
        base = fitting::refit(&whole, &base, monitor)?;
    }
    monitor.report("bare machine", 0.1);
    let mut outcome = search(&mut whole, &mut others, &mut base, monitor)?;
    let Judged { fitted: found, held_out, .. } = &outcome.best;
    let known = if held_out.len() == others.len() { &held_out[..] } else { &[] };
    let anew = settled_anew(&mut whole, &mut others, &outcome.base, &outcome.best)
        || !found.effects().is_empty()
            && matches!(hold::settle(&mut whole, &mut others, found, known, monitor)?, Held::InStator(_))
        || hold::in_place_of_one(&mut whole, &mut others, &outcome, monitor)?;
    if anew && !monitor.cancelled() {
        base = fitting::refit(&whole, &base, monitor)?;
        outcome = search(&mut whole, &mut others, &mut base, monitor)?;
    } else if let Some(finer) = judged_finer(&whole, &others, &outcome, monitor)? {
        (whole, others, outcome) = finer;
    }
    monitor.report("answer", 0.97);
    let judge = others.last().filter(|_| validation.is_some());
    let first = outcome.base.fitted.clone();
    let mut answer = conclude::conclude(&whole, judge, outcome, &weak, monitor)?;
    if answer.verdict != Verdict::Named
        && let Some(finding) = wiring::suspected(recordings, machine, &first, monitor)?
    {
        answer.data_quality.insert(0, finding);
    }
    Ok(answer)
}

/// Searches for the effects, held against the other recordings or against every other window of this one.
fn search(
    whole: &mut Data,
    others: &mut [Data],
    base: &mut Hypothesis,
    monitor: &dyn Monitor,
) -> Result<Outcome> {
    // Half a recording may not pin down what the whole does: where the bare machine fits the whole, nothing is wrong with it.
    let split = others.is_empty() && !whole.poor && verdict::largest_excess(base) > verdict::MISMATCH;
    let split = split.then(|| whole.halves()).flatten();
    if let Some((fitted, held_out)) = &split {
        let start = fitting::refit(fitted, base, monitor)?;
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
    if !whole.poor {
        let begun = open(whole, others, monitor).singles(base.clone())?;
        let anew = begun.explain_most() && settled_anew(whole, others, &begun.base, &begun.best);
        if !anew || monitor.cancelled() {
            return open(whole, others, monitor).finish(begun);
        }
        *base = fitting::refit(whole, base, monitor)?;
        return open(whole, others, monitor).run(base.clone());
    }
    // What a poor recording leaves open a second one must not be held against it, unless it makes nonsense of that one.
    let bare = |data| Ok((data, transfer(data, base, monitor)?));
    let refuting = others.iter().map(bare).collect::<Result<Vec<_>>>()?;
    Search { data: whole, held_out: Vec::new(), refuting, most: 1, monitor }.run(base.clone())
}

/// A search for as many effects as there may be, held against all of the other recordings.
fn open<'a>(data: &'a Data, others: &'a [Data], monitor: &'a dyn Monitor) -> Search<'a> {
    let held_out = others.iter().collect();
    Search { data, held_out, refuting: Vec::new(), most: search::MOST, monitor }
}

/// Measures the noise once more with the help of what was found, and says whether part of that on the voltages was physics, or hidden by
/// it, or whether the bare machine was too far from a speed that wanders for it to be judged as such.
fn settled_anew(whole: &mut Data, others: &mut [Data], base: &Judged, best: &Judged) -> bool {
    let noisy = whole.input.voltage > 0.0;
    // What is explained down to the floors hides no noise, and what is found on a poor recording that the bare machine explains is none.
    // What is left of the motion tells of torques alone where those that were found have exact forms.
    let exact = best.fitted.effects().iter().all(|e| e.info().site == Site::Mechanical);
    let far = exact && others.iter().chain([&*whole]).any(|data| unfiltered(data) > 0);
    let hides = noisy || best.excess() > verdict::MISMATCH || far;
    let real = !whole.poor || base.excess() > verdict::MISMATCH;
    if best.fitted.effects().is_empty() || !hides || !real {
        return false;
    }
    let again = settled(whole, &best.fitted);
    let (before, now) = (whole.input.voltage, again.input.voltage);
    let physics = if noisy { now <= QUIETER * before } else { now > 0.0 };
    if !physics && !far {
        return false;
    }
    let theirs: Vec<Data> = others.iter().zip(&best.held_out).map(|(d, found)| settled(d, found)).collect();
    let filtered = |before: &Data, now: &Data| unfiltered(now) < unfiltered(before);
    if !physics && !filtered(whole, &again) && !others.iter().zip(&theirs).any(|(a, b)| filtered(a, b)) {
        return false;
    }
    *whole = again;
    for (data, again) in others.iter_mut().zip(theirs) {
        *data = again;
    }
    true
}

/// Recordings with the noise measured once more with the help of what was found.
fn settled(data: &Data, found: &Hypothesis) -> Data {
    let mut again = data.clone();
    again.settle_floors(found);
    again
}

/// Recordings that show a speed which wanders, and is not judged as such.
fn unfiltered(data: &Data) -> usize {
    data.runs().iter().filter(|run| run.wanders_unfiltered()).count()
}

/// The noise measured with the help of what was found, and what comes of a search there, where the bare machine was too far from a speed that
/// wanders for it to be judged as such, if that needs fewer effects: a friction found beside an effect of the currents may be what noise does
/// to the rotor. A torque of these that has only nearly the right form would be judged too finely, and need more.
fn judged_finer(
    whole: &Data,
    others: &[Data],
    outcome: &Outcome,
    monitor: &dyn Monitor,
) -> Result<Option<(Data, Vec<Data>, Outcome)>> {
    let best = &outcome.best;
    let effects = best.fitted.effects();
    let moving = effects.iter().filter(|e| e.info().site == Site::Mechanical).count();
    let wanders = others.iter().chain([whole]).any(|data| unfiltered(data) > 0);
    // What is left unexplained is no noise.
    let explained = best.excess() <= verdict::MISMATCH;
    if moving == 0 || moving == effects.len() || !wanders || !explained || monitor.cancelled() {
        return Ok(None);
    }
    let mut again = settled(whole, &best.fitted);
    let mut theirs: Vec<Data> =
        others.iter().zip(&best.held_out).map(|(d, found)| settled(d, found)).collect();
    if theirs.len() < others.len() {
        return Ok(None);
    }
    let mut base = fitting::refit(&again, &outcome.base.fitted, monitor)?;
    let anew = search(&mut again, &mut theirs, &mut base, monitor)?;
    let fewer = anew.best.fitted.effects().len() < effects.len() && !monitor.cancelled();
    Ok(fewer.then_some((again, theirs, anew)))
}

/// Fits what a search on half the samples found to all of them.
fn on_whole(data: &Data, found: Outcome, base: &Hypothesis, monitor: &dyn Monitor) -> Result<Outcome> {
    let mut best = found.best;
    if !best.fitted.effects().is_empty() {
        best.fitted = fitting::refit(data, &best.fitted, monitor)?;
    }
    let bare = best.fitted.effects().is_empty();
    if bare {
        // Fitted together with an effect that turned out needless, the bare machine may do better than by itself.
        let there = best.fitted.seen_again(data);
        let better = verdict::largest_excess(&there) < verdict::largest_excess(base);
        best.fitted = if better { there } else { base.clone() };
    }
    let mut whole = found.base;
    whole.fitted = if bare { best.fitted.clone() } else { base.clone() };
    let mut path = found.path;
    let last = path.len() - 1;
    for judged in &mut path[1..last.max(1)] {
        judged.fitted = fitting::refit(data, &judged.fitted, monitor)?;
    }
    // What only generalises an effect is compared with it closely, sample for sample.
    let mut swaps = found.swaps;
    for swap in &mut swaps {
        if swap.by.is_some_and(|wide| wide.contains(swap.replaced)) {
            swap.judged.fitted = fitting::refit(data, &swap.judged.fitted, monitor)?;
        }
    }
    path[0] = whole.clone();
    path[last] = if last == 0 { whole.clone() } else { best.clone() };
    Ok(Outcome { base: whole, best, path, swaps, ..found })
}

#[cfg(test)]
mod tests {
    use super::testing::{choice, setup, speeds};
    use super::*;
    use crate::drive::{Choice, Schedule, Shape, simulate};
    use crate::effects;
    use crate::model::Model;
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
    fn friction_below_a_mismatch_under_a_speed_that_wanders_is_asked_about_and_a_clean_machine_not_accused() {
        let answer = |effects| {
            let path: Vec<(f64, f64)> =
                (0..8).map(|k| (0.1 + 0.25 * f64::from(k), [90.0, -70.0][k as usize % 2])).collect();
            let mut manoeuvre = speeds(2.0, &path);
            manoeuvre.i_d =
                Some(Schedule::new(vec![(0.0, 0.0), (0.3, -4.0), (1.4, 2.0)], Shape::Steps).unwrap());
            let mut setup = setup(manoeuvre, effects);
            setup.drive.sensors.noise_i = 0.3;
            let recording = simulate(&setup, &Silent).unwrap().recording;
            diagnose(&[&recording], &setup.nameplate, None, &Silent).unwrap()
        };
        let found = answer(vec![choice("coulomb_friction", "tau_c", 0.05)]);
        assert_ne!(found.verdict, Verdict::NoMismatch);
        assert!(found.ranking.iter().any(|c| c.effect == "coulomb_friction"), "{:?}", found.ranking);
        assert_eq!(answer(Vec::new()).verdict, Verdict::NoMismatch);
    }

    #[test]
    fn a_speed_that_wanders_is_judged_as_such_once_what_hid_it_is_found() {
        let path: Vec<(f64, f64)> =
            (0..8).map(|k| (0.1 + 0.25 * f64::from(k), [90.0, -70.0][k as usize % 2])).collect();
        let mut setup = setup(speeds(2.0, &path), vec![choice("coulomb_friction", "tau_c", 1.0)]);
        setup.drive.sensors.noise_i = 0.3;
        let ((mut data, mut base), (other, _)) = (testing::data(&setup), testing::data(&setup));
        assert!(data.wanders_unfiltered() && verdict::largest_excess(&base) > 30.0);
        let outcome = search(&mut data, &mut [other], &mut base, &Silent).unwrap();
        assert_eq!(outcome.best.fitted.effects(), [effects::EffectId::CoulombFriction]);
        assert!(data.wander().is_some() && !data.wanders_unfiltered());
    }

    #[test]
    fn what_noise_does_to_a_rotor_is_no_load_beside_an_effect_of_the_currents() {
        use effects::EffectId::{CoulombFriction, DeadTime, TimeVaryingLoad};
        let path: Vec<(f64, f64)> =
            (0..8).map(|k| (0.1 + 0.25 * f64::from(k), [90.0, -70.0][k as usize % 2])).collect();
        let real = vec![choice("dead_time", "v_err", 6.0), choice("coulomb_friction", "tau_c", 1.0)];
        let mut setup = setup(speeds(2.0, &path), real);
        setup.drive.sensors.noise_i = 0.3;
        let ((data, base), (other, _)) = (testing::data(&setup), testing::data(&setup));
        assert!(data.wanders_unfiltered(), "{:?}", base.squares);
        let mut outcome =
            search(&mut data.clone(), &mut [other.clone()], &mut base.clone(), &Silent).unwrap();
        let others = [other];
        let mut finer = |found: &[effects::EffectId]| {
            let model = Model::new(data.signals.context, found);
            let typical = found.iter().flat_map(|e| e.info().parameters);
            let start = base.own().iter().copied().chain(typical.map(|p| (p.typical)(&data.signals.context)));
            let start: Vec<f64> = start.collect();
            let fitted = fitting::fit(&data, &model, &start, false, &Silent).unwrap();
            let held_out = vec![transfer(&others[0], &fitted, &Silent).unwrap()];
            outcome.best = Judged { fitted, held_out, refuted: false };
            let finer = judged_finer(&data, &others, &outcome, &Silent).unwrap();
            finer.map(|(.., outcome)| outcome.best.fitted.effects())
        };
        assert_eq!(
            finer(&[DeadTime, CoulombFriction, TimeVaryingLoad]),
            Some(vec![DeadTime, CoulombFriction])
        );
        // What moves alone is judged so as it is found.
        assert_eq!(finer(&[CoulombFriction, TimeVaryingLoad]), None);
    }

    #[test]
    fn a_load_that_steps_is_not_taken_for_friction() {
        let answer = stepping(Vec::new());
        assert_eq!(answer.verdict, Verdict::NoMismatch, "{:?}", answer.model);
    }

    #[test]
    fn a_machine_that_runs_away_is_no_mismatch() {
        // What no motor does: the regression for what is not on the nameplate finds inductances below zero.
        let t: Vec<f64> = (0..400).map(|k| 1e-3 * f64::from(k)).collect();
        let of = |f: fn(f64) -> f64| t.iter().map(|t| f(*t)).collect::<Vec<_>>();
        let columns = [
            ("v_d", of(|t| 1.0 + (9.0 * t).cos())),
            ("v_q", of(|t| 12.0 + (5.0 * t).sin())),
            ("i_d", of(|t| (8.0 * t).sin() - 1.0)),
            ("i_q", of(|t| 2.0 + (7.0 * t).cos())),
            ("omega_e", of(|t| 60.0 + 20.0 * (6.0 * t).sin())),
            ("theta_e", of(|t| 60.0 * t + 20.0 / 6.0 * (1.0 - (6.0 * t).cos()))),
        ];
        let columns = std::iter::once(("t".to_string(), t.clone()))
            .chain(columns.into_iter().map(|(name, x)| (name.to_string(), x)));
        let recording = Recording::new(columns.collect(), None).unwrap();
        let machine = Machine::new(3).unwrap();
        let answer = diagnose(&[&recording], &machine, None, &Silent).unwrap();
        assert_eq!(answer.verdict, Verdict::Undetermined, "{:?}", answer.model);
        let said = answer.data_quality.last().unwrap();
        assert!(said.finding.contains("stays finite"), "{}", said.finding);
        assert_eq!(answer.cannot_see.len(), effects::ALL.len());
    }
}
