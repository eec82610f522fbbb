//! Diagnosis: what does the model of this machine leave out?
//!
//! 1. `join`: the recordings are read, with their noise floors and priors.
//! 2. `baseline`: the dq-model without effects is fitted; `adequacy`, `wiring` and `torque_sign` check that it is a model of the log.
//!    `between_rows`, `current_filter` and `voltage_frame` ask what the log did to voltages and currents.
//! 3. `search`, `select`: sets of effects are grown, exchanged and pruned by `evidence`. Each is refitted by simulation and validated on
//!    samples that it was not fitted to. `torque_balance` gives the search another start where the motion stays unexplained.
//! 4. `noise_update`, `voltage_frame`: noise and voltage are read anew with the best set, and the search repeated if that changes them.
//! 5. `conclude`: verdict, estimates with their uncertainty, map of the rest, power and next experiment.
//!
//! Where several sets do as well, the answer is ambiguous. Where none reaches the noise, effects that a smooth map cannot replace are named
//! beside one; else the answer is unknown.

mod adequacy;
mod adjusted_likelihood;
mod angle_alignment;
mod angle_quantisation;
pub mod answer;
mod attribution;
mod baseline;
mod between_rows;
pub mod budget;
mod collinearity;
mod conclude;
mod consistency;
mod coverage;
mod current_filter;
mod data;
mod data_quality;
mod decide;
mod decimation;
mod evidence;
mod experiment_design;
mod fitting;
mod hypothesis;
mod identifiability;
mod incumbent;
mod join;
pub mod locate;
mod log_limits;
mod motion;
mod multimodal;
mod nameplate;
mod noise_update;
mod options;
mod outputs;
mod parameters_alone;
mod per_recording;
mod power;
mod predict;
pub mod remaining;
mod score;
mod search;
mod select;
mod short_circuit;
mod stated_load;
#[cfg(test)]
mod testing;
mod torque_balance;
mod torque_noise;
mod torque_points;
mod torque_sign;
mod traces;
mod transfer;
pub mod unmodelled;
mod verdict;
mod voltage_frame;
mod wiring;
mod wording;

use crate::error::{Error, Result};
use crate::machine::Machine;
use crate::monitor::Monitor;
use crate::recording::Recording;
use answer::Answer;
use between_rows::Voltages;
use data::Data;
use incumbent::Incumbent;
pub use options::DiagnosisOptions;
pub use predict::{Horizon, predict};
use transfer::transfer;
use verdict::Validated;
use voltage_frame::Frame;

/// The manoeuvre that shows nearly every effect.
const RICH: &str = "Record a rich manoeuvre: reversals, two levels of i_q, steps of i_d.";

/// Most effects looked for in a log that a mistake in it explains.
const IN_DOUBT: usize = 2;

/// Diagnoses a machine from `recordings`, all of which are fitted together, and an optional `validation` run on which nothing is
/// estimated but initial values and an unknown load. `options` are the constants on which the verdict rests.
///
/// # Errors
/// [`Error::Unusable`] if the validation run is one of the recordings; those of [`DiagnosisOptions::check`], [`crate::signals::Signals::new`],
/// [`crate::start::values`], of recordings that cannot be combined, and the least-squares fits. An interruption through `monitor` is no error: the answer is then
/// `undetermined`, and holds the best model so far.
pub fn diagnose(
    recordings: &[&Recording],
    machine: &Machine,
    validation: Option<&Recording>,
    options: &DiagnosisOptions,
    monitor: &dyn Monitor,
) -> Result<Answer> {
    options.check()?;
    monitor.report("dq-model", 0.0);
    if validation.is_some_and(|run| recordings.iter().any(|recording| recording.same_samples(run))) {
        return Err(Error::unusable(
            "the validation run is the recording itself: it checks nothing",
            "give another run of the same machine, or none",
        ));
    }
    let new: Vec<Option<Recording>> = recordings.iter().map(|r| r.rows_with_new_values()).collect();
    let recordings: Vec<&Recording> =
        new.iter().zip(recordings).map(|(new, whole)| new.as_ref().unwrap_or(whole)).collect();
    let recordings = &recordings[..];
    let validated = validation.and_then(Recording::rows_with_new_values);
    let validation = validated.as_ref().or(validation);
    if let [points] = recordings {
        if let Some(answer) = short_circuit::answer(points, machine, options)? {
            return Ok(answer);
        }
        if torque_points::are(points) {
            return torque_points::answer(points, machine, options);
        }
    }
    let mut whole = join::prepare(recordings, machine, options)?;
    let incumbent = Incumbent::default();
    match in_stages(&mut whole, (recordings, machine, validation, options), (monitor, &incumbent)) {
        Err(Error::Interrupted) => Ok(incumbent.answer(&whole)),
        ended => ended,
    }
}

/// The diagnosis of recordings that were read, one stage after the other. What the stages learn of the `whole` stays in it.
fn in_stages(
    whole: &mut Data,
    (recordings, machine, validation, options): (
        &[&Recording],
        &Machine,
        Option<&Recording>,
        &DiagnosisOptions,
    ),
    (monitor, incumbent): (&dyn Monitor, &Incumbent),
) -> Result<Answer> {
    if let Some(finding) = baseline::silent(whole) {
        return Ok(conclude::undetermined(whole, finding, Some(RICH)));
    }
    let mut base = baseline::fit(whole, monitor)?;
    incumbent.note(&base);
    if let Some(finding) = baseline::diverged(&base) {
        let mistake = wiring::suspected(recordings, machine, &base, options, monitor)?;
        return Ok(conclude::without_model(whole, mistake, finding));
    }
    let counted = angle_quantisation::select(whole, &mut base, monitor)?;
    match between_rows::select(whole, &base, monitor)? {
        Voltages::Held => {}
        Voltages::Drawn(read) => (*whole, base) = *read,
        Voltages::Unknown(why) => {
            if let Some(mistake) = wiring::suspected(recordings, machine, &base, options, monitor)? {
                return Ok(conclude::undetermined(whole, mistake, None));
            }
            *whole = join::motion_alone(recordings, machine, &why, options)?;
            if counted {
                angle_quantisation::to_middle(whole);
            }
            base = baseline::fit(whole, monitor)?;
        }
    }
    if let Some(finding) = torque_sign::opposite(whole, &base, monitor)?
        && wiring::suspected(recordings, machine, &base, options, monitor)?.is_none()
    {
        return Ok(conclude::undetermined(whole, finding, None));
    }
    let mut from = None;
    if let Some(finding) = adequacy::lack_of_fit(whole, &base) {
        let mistake = wiring::suspected(recordings, machine, &base, options, monitor)?;
        from = match mistake {
            None => torque_balance::adequate(whole, &mut base, monitor)?,
            Some(_) => None,
        };
        if from.is_none() {
            return Ok(conclude::without_model(whole, mistake, finding));
        }
    }
    current_filter::take_out(whole, &mut base, monitor)?;
    let mut others = Vec::new();
    if let Some(recording) = validation {
        let read = join::read(recording, machine, whole.signals.limits.coarse.as_ref()).map(|mut signals| {
            signals.read_as(whole.signals.voltages_drawn, whole.signals.current_filter);
            signals
        });
        let data = read.and_then(|signals| Data::new(signals, machine, options));
        let mut data = data.map_err(|error| Error::InValidation { source: Box::new(error) })?;
        if counted {
            angle_quantisation::to_middle(&mut data);
        }
        others.push(data);
    }
    let mut settled = None;
    match voltage_frame::select(whole, &mut others, &base, &[], monitor)? {
        Frame::Stator(held) => base = *held,
        Frame::Rotor(theirs) => settled = Some(theirs),
        Frame::Untested => {}
    }
    if angle_alignment::align(whole, &base, monitor)? {
        base = fitting::refit(whole, &base, monitor)?;
        settled = None;
    }
    let weak = baseline::weak_parameters(whole, &base);
    whole.poor = baseline::is_poor(whole, &weak);
    if let Some(settled) = settled {
        others = settled;
    } else {
        for data in &mut others {
            let transferred = transfer(data, &base, monitor)?;
            data.settle_floors(&transferred);
        }
    }
    if whole.poor && verdict::largest_excess(&base) > options.mismatch {
        base = fitting::refit(whole, &base, monitor)?;
    }
    monitor.report("dq-model", 0.1);
    let watch = (monitor, incumbent);
    // One effect, or two, may look like a mistake of the log and then explain it down to the noise. More are not looked for.
    let mistaken = wiring::suspected(recordings, machine, &base, options, monitor)?.is_some();
    let mut outcome = if mistaken {
        let few = DiagnosisOptions { most_effects: IN_DOUBT.min(options.most_effects), ..*options };
        search::search(&Data { options: few, ..whole.clone() }, &others, &base, None, watch)?
    } else {
        let found = search::search(whole, &others, &base, from.as_ref(), watch)?;
        let found = search::with_torque_balance(whole, &others, found, watch)?;
        search::with_multimodal(whole, &others, found, watch)?
    };
    let (bare, best) = outcome.ends();
    let Validated { fitted: found, held_out, .. } = best;
    let known = if held_out.len() == others.len() { &held_out[..] } else { &[] };
    let again = noise_update::update(whole, &mut others, bare, best)
        || !found.effects().is_empty()
            && matches!(voltage_frame::select(whole, &mut others, found, known, monitor)?, Frame::Stator(_))
        || voltage_frame::in_place_of_one(whole, &mut others, &outcome, monitor)?;
    incumbent.note(found);
    if again {
        base = fitting::refit(whole, &base, monitor)?;
        let earlier = outcome;
        outcome = search::search(whole, &others, &base, Some(&earlier.best.fitted), watch)?;
        outcome.path = search::with_steps_of(&earlier.path, outcome.path, whole, monitor)?;
    } else if let Some(finer) = search::with_updated_noise(whole, &others, &outcome, watch)? {
        (*whole, others, outcome) = finer;
    }
    incumbent.note(&outcome.ends().1.fitted);
    monitor.report("answer", 0.97);
    let validation = others.last().filter(|_| validation.is_some());
    // A log that was wired or written wrong says nothing of what the model leaves out.
    let (bare, best) = outcome.ends();
    let mistake = match outcome.best.excess() > options.mismatch {
        true => wiring::suspected(recordings, machine, &bare.fitted, options, monitor)?,
        false => None,
    };
    let mistake = match mistake {
        None => wiring::in_place_of_effects(recordings, machine, (whole, &best.fitted), monitor)?,
        found => found,
    };
    if let Some(mistake) = mistake {
        return Ok(conclude::undetermined(whole, mistake, None));
    }
    conclude::conclude(whole, validation, outcome, &weak, monitor)
}

#[cfg(test)]
mod tests {
    use super::answer::Verdict;
    use super::testing::{choice, setup, speeds};
    use super::*;
    use crate::drive::{Choice, Schedule, Shape, simulate};
    use crate::effects;
    use crate::monitor::Silent;

    #[test]
    fn short_clean_recordings_without_validation_accuse_nobody() {
        for seed in 1..=5 {
            let mut setup = setup(speeds(1.1, &[(0.1, 80.0), (0.5, -60.0), (0.9, 90.0)]), Vec::new());
            setup.seed = seed;
            let recording = simulate(&setup, &Silent).unwrap().recording;
            let answer =
                diagnose(&[&recording], &setup.nameplate, None, &Default::default(), &Silent).unwrap();
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
        diagnose(&[&recording], &setup.nameplate, None, &Default::default(), &Silent).unwrap()
    }

    fn steps(answer: &Answer) -> usize {
        answer.model.base.keys().filter(|k| k.starts_with("t_load")).count()
    }

    #[test]
    fn friction_is_not_taken_for_a_load_that_steps_at_every_reversal() {
        let answer = stepping(vec![choice("coulomb_friction", "tau_c", 0.15)]);
        assert_eq!(answer.verdict, Verdict::Named, "{:?}", answer.ranking);
        assert_eq!(answer.model.effects, ["coulomb_friction"]);
        // One step there is; of a weak one more the noise may persuade, of three more at the reversals not.
        assert!(steps(&answer) <= 2, "{:?}", answer.model.base);
        assert_eq!(answer.located[0].equation, "mechanical");
        assert!(answer.fit.recording.before["omega_e"] > 2.0 * answer.fit.recording.after["omega_e"]);
    }

    #[test]
    fn friction_that_load_steps_hide_down_to_the_noise_is_still_asked_about() {
        // With a step at each reversal the dq-model leaves nothing.
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
            diagnose(&[&recording], &setup.nameplate, None, &Default::default(), &Silent).unwrap()
        };
        let found = answer(vec![choice("coulomb_friction", "tau_c", 0.05)]);
        assert_ne!(found.verdict, Verdict::NoMismatch);
        assert!(found.ranking.iter().any(|c| c.effect == "coulomb_friction"), "{:?}", found.ranking);
        assert_eq!(answer(Vec::new()).verdict, Verdict::NoMismatch);
    }

    #[test]
    fn a_load_that_steps_is_not_taken_for_friction() {
        let answer = stepping(Vec::new());
        assert_eq!(answer.verdict, Verdict::NoMismatch, "{:?}", answer.model);
    }

    #[test]
    fn a_name_by_a_poor_recording_that_does_not_foresee_the_validation_run_is_an_even_chance_at_most() {
        let run = |seed: u64, gain: f64| {
            let mut one_speed = speeds(0.8, &[(0.0, 60.0)]);
            one_speed.tau_load = Some(Schedule::new(vec![(0.0, 4.0)], Shape::Steps).unwrap());
            let mut setup = setup(one_speed, vec![choice("current_gain_imbalance", "g_alpha", gain)]);
            setup.seed = seed;
            (simulate(&setup, &Silent).unwrap().recording, setup.nameplate)
        };
        let told = |validated: f64| {
            let ((recording, nameplate), (validation, _)) = (run(1, 0.2), run(2, validated));
            let answer =
                diagnose(&[&recording], &nameplate, Some(&validation), &Default::default(), &Silent).unwrap();
            assert_eq!(answer.verdict, Verdict::Ambiguous, "{:?} {:?}", answer.reason, answer.ranking);
            assert_eq!(answer.ranking[0].effect, "current_gain_imbalance");
            let said = answer.data_quality.iter().any(|f| f.finding.starts_with("on the validation run"));
            (said, answer.ranking[0].probability)
        };
        let (said, probability) = told(0.15);
        assert!(said && probability <= 0.5, "{said} {probability}");
        let (said, probability) = told(0.2);
        assert!(!said && probability > 0.8, "{said} {probability}");
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
        let answer = diagnose(&[&recording], &machine, None, &Default::default(), &Silent).unwrap();
        assert_eq!(answer.verdict, Verdict::Undetermined, "{:?}", answer.model);
        let said = answer.data_quality.last().unwrap();
        assert!(said.finding.contains("stays finite"), "{}", said.finding);
        assert_eq!(answer.cannot_see.len(), effects::ALL.len());
    }
}
