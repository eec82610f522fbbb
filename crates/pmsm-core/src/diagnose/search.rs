//! Which search for the set of effects suits the recordings: on all samples, on decimated ones or on every other window; for many effects
//! or for one. The search is repeated where its result changes the measured noise.

use super::data::Data;
use super::decimation;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::incumbent::Incumbent;
use super::multimodal;
use super::noise_update::{unfiltered, updated};
use super::select::{Outcome, Search};
use super::torque_balance;
use super::transfer::transfer;
use super::verdict::{self, Validated};
use crate::effect::Site;
use crate::error::Result;
use crate::monitor::Monitor;

/// The monitor of the call, and the best set so far.
type Watch<'a> = (&'a dyn Monitor, &'a Incumbent);

/// Searches for the effects, decimated where possible, and validates them on the other recordings or on every other window of this one.
/// It begins with the set `from`, if there is one.
pub fn search(
    whole: &Data,
    others: &[Data],
    base: &Hypothesis,
    from: Option<&Hypothesis>,
    (monitor, incumbent): Watch,
) -> Result<Outcome> {
    if let Some(found) = decimated(whole, others, base, from, (monitor, incumbent))? {
        return Ok(found);
    }
    if let Some(found) = in_halves(whole, others, base, from, (monitor, incumbent))? {
        return Ok(found);
    }
    if !whole.poor {
        return open(whole, others, from, (monitor, incumbent)).run(base.clone());
    }
    // A poor recording determines some parameters badly: another one refutes its sets only where they predict far worse than the dq-model.
    let bare = |data| Ok((data, transfer(data, base, monitor)?));
    let refuting = others.iter().map(bare).collect::<Result<Vec<_>>>()?;
    Search { data: whole, held_out: Vec::new(), refuting, most: 1, from: None, monitor, incumbent }
        .run(base.clone())
}

/// The search on decimated recordings, if they allow for it; its result is fitted to every sample.
fn decimated(
    whole: &Data,
    others: &[Data],
    base: &Hypothesis,
    from: Option<&Hypothesis>,
    (monitor, incumbent): Watch,
) -> Result<Option<Outcome>> {
    let Some((fewer, theirs)) = decimation::decimated(whole, others) else { return Ok(None) };
    let start = fitting::carried_over(&fewer, base, monitor)?;
    let found = match in_halves(&fewer, &theirs, &start, from, (monitor, incumbent))? {
        Some(found) => found,
        None => open(&fewer, &theirs, from, (monitor, incumbent)).run(start)?,
    };
    decimation::on_every_sample(whole, others, found, base, monitor).map(Some)
}

/// The search without another recording where something is missing: on every other window, validated on the rest.
fn in_halves(
    whole: &Data,
    others: &[Data],
    base: &Hypothesis,
    from: Option<&Hypothesis>,
    (monitor, incumbent): Watch,
) -> Result<Option<Outcome>> {
    // Half a recording may not determine all parameters. Where the dq-model fits the whole, no split is needed.
    let split = others.is_empty() && !whole.poor && verdict::largest_excess(base) > whole.options.mismatch;
    let Some((fitted, held_out)) = split.then(|| whole.halves()).flatten() else { return Ok(None) };
    let start = fitting::refit(&fitted, base, monitor)?;
    let held_out = vec![&held_out];
    let search = Search {
        data: &fitted,
        held_out,
        refuting: Vec::new(),
        most: whole.options.most_effects,
        from: from.cloned(),
        monitor,
        incumbent,
    };
    on_whole(whole, search.run(start)?, base, monitor).map(Some)
}

/// A search for as many effects as there may be, validated on all of the other recordings.
fn open<'a>(
    data: &'a Data,
    others: &'a [Data],
    from: Option<&Hypothesis>,
    (monitor, incumbent): Watch<'a>,
) -> Search<'a> {
    let held_out = others.iter().collect();
    Search {
        data,
        held_out,
        refuting: Vec::new(),
        most: data.options.most_effects,
        from: from.cloned(),
        monitor,
        incumbent,
    }
}

/// The search repeated from the set that the balance of torques shows, where it is better than the one found and the motion is not
/// explained.
pub fn with_torque_balance(whole: &Data, others: &[Data], outcome: Outcome, watch: Watch) -> Result<Outcome> {
    from_another(whole, others, outcome, watch, torque_balance::grown)
}

/// The same from the set with an effect whose fit has many minima.
pub fn with_multimodal(whole: &Data, others: &[Data], outcome: Outcome, watch: Watch) -> Result<Outcome> {
    from_another(whole, others, outcome, watch, multimodal::grown)
}

/// Another set to begin with, from the best one.
type Another = fn(&Data, &Hypothesis, &dyn Monitor) -> Result<Option<Hypothesis>>;

/// The search repeated from another set, where that is better than the one found and the motion is not explained. The currents must be:
/// what is missing there moves the rotor, too.
fn from_another(
    whole: &Data,
    others: &[Data],
    outcome: Outcome,
    (monitor, incumbent): Watch,
    another: Another,
) -> Result<Outcome> {
    let best = &outcome.best;
    let left = |electrical: bool| {
        let runs = std::iter::once(&best.fitted).chain(&best.held_out);
        let each = runs.flat_map(|run| run.squares.iter().zip(verdict::beyond_chance(run)));
        let side = each.filter(|((channel, _), _)| channel.is_electrical() == electrical);
        side.map(|(_, excess)| excess).fold(0.0, f64::max)
    };
    let (options, currents_explained) = (&whole.options, left(true) <= whole.options.form_error());
    if whole.poor || !currents_explained || left(false) <= options.mismatch {
        return Ok(outcome);
    }
    let Some(set) = another(whole, &best.fitted, monitor)? else { return Ok(outcome) };
    let set = fitting::carried_over(whole, &set, monitor)?;
    let cost = |set: &Hypothesis| outcome.evidence.cost_on_recording(set);
    if cost(&set) >= cost(&best.fitted) {
        return Ok(outcome);
    }
    let mut anew = search(whole, others, &outcome.base.fitted, Some(&set), (monitor, incumbent))?;
    if outcome.evidence.cost(&anew.best) >= outcome.evidence.cost(best) {
        return Ok(outcome);
    }
    anew.path = with_steps_of(&outcome.path, anew.path, whole, monitor)?;
    Ok(anew)
}

/// The search repeated with the noise as the best set shows it, if that needs fewer effects.
///
/// It is asked where the speed has driven noise that the residual of the dq-model hid. A friction found beside an effect of the currents
/// may be no more than that noise. More effects are not taken: they may correct torques of the currents whose form is inexact.
pub fn with_updated_noise(
    whole: &Data,
    others: &[Data],
    outcome: &Outcome,
    (monitor, incumbent): Watch,
) -> Result<Option<(Data, Vec<Data>, Outcome)>> {
    let best = &outcome.best;
    let effects = best.fitted.effects();
    let moving = effects.iter().filter(|e| e.info().site == Site::Mechanical).count();
    let wanders = others.iter().chain([whole]).any(|data| unfiltered(data) > 0);
    // An unexplained residual is no noise.
    let explained = best.excess() <= whole.options.mismatch;
    if moving == 0 || moving == effects.len() || !wanders || !explained {
        return Ok(None);
    }
    let again = updated(whole, &best.fitted);
    let theirs: Vec<Data> = others.iter().zip(&best.held_out).map(|(d, found)| updated(d, found)).collect();
    if theirs.len() < others.len() {
        return Ok(None);
    }
    let base = fitting::refit(&again, &outcome.base.fitted, monitor)?;
    let anew = search(&again, &theirs, &base, Some(&best.fitted), (monitor, incumbent))?;
    let fewer = anew.best.fitted.effects().len() < effects.len();
    Ok(fewer.then_some((again, theirs, anew)))
}

/// The way of a search that began with the best set of an `earlier` one, with that one's steps where it has none of its own.
pub fn with_steps_of(
    earlier: &[Validated],
    mut path: Vec<Validated>,
    data: &Data,
    monitor: &dyn Monitor,
) -> Result<Vec<Validated>> {
    let within = |small: &Validated, large: &Validated| {
        let (small, large) = (small.fitted.effects(), large.fitted.effects());
        small.len() < large.len() && small.iter().all(|e| large.contains(e))
    };
    for step in earlier {
        let place = (1..path.len()).find(|k| within(&path[*k - 1], step) && within(step, &path[*k]));
        if let Some(place) = place {
            let fitted = fitting::on_from(data, &step.fitted, monitor)?;
            path.insert(place, Validated { fitted, ..step.clone() });
        }
    }
    Ok(path)
}

/// Fits what a search on half the samples found to all of them.
fn on_whole(data: &Data, found: Outcome, base: &Hypothesis, monitor: &dyn Monitor) -> Result<Outcome> {
    let mut best = found.best;
    if !best.fitted.effects().is_empty() {
        best.fitted = fitting::refit(data, &best.fitted, monitor)?;
    }
    let bare = best.fitted.effects().is_empty();
    if bare {
        // The fit beside an effect that was dropped may have found a better minimum of the dq-model.
        let there = best.fitted.seen_again(data);
        let better = verdict::largest_excess(&there) < verdict::largest_excess(base);
        best.fitted = if better { there } else { base.clone() };
    }
    let mut whole = found.base;
    whole.fitted = if bare { best.fitted.clone() } else { base.clone() };
    let mut path = found.path;
    let last = path.len() - 1;
    for validated in &mut path[1..last.max(1)] {
        validated.fitted = fitting::refit(data, &validated.fitted, monitor)?;
    }
    // An effect that contains the other as a special case is compared with it on all samples.
    let mut swaps = found.swaps;
    for swap in &mut swaps {
        if swap.by.is_some_and(|wide| wide.contains(swap.replaced)) {
            swap.validated.fitted = fitting::refit(data, &swap.validated.fitted, monitor)?;
        }
    }
    path[0] = whole.clone();
    path[last] = if last == 0 { whole.clone() } else { best.clone() };
    Ok(Outcome { base: whole, best, path, swaps, ..found })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::noise_update;
    use crate::diagnose::testing::{self, choice, setup, speeds};
    use crate::diagnose::verdict::Validated;
    use crate::effects;
    use crate::model::Model;
    use crate::monitor::Silent;

    #[test]
    fn driven_noise_of_the_speed_is_filtered_once_what_hid_it_is_found() {
        let path: Vec<(f64, f64)> =
            (0..8).map(|k| (0.1 + 0.25 * f64::from(k), [90.0, -70.0][k as usize % 2])).collect();
        let mut setup = setup(speeds(2.0, &path), vec![choice("coulomb_friction", "tau_c", 1.0)]);
        setup.drive.sensors.noise_i = 0.3;
        let ((mut data, base), (other, _)) = (testing::data(&setup), testing::data(&setup));
        let mut others = [other];
        assert!(data.wanders_unfiltered() && verdict::largest_excess(&base) > 30.0);
        let outcome = search(&data, &others, &base, None, (&Silent, &Incumbent::default())).unwrap();
        assert_eq!(outcome.best.fitted.effects(), [effects::EffectId::CoulombFriction]);
        let (bare, best) = outcome.ends();
        assert!(noise_update::update(&mut data, &mut others, bare, best));
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
            search(&data, std::slice::from_ref(&other), &base, None, (&Silent, &Incumbent::default()))
                .unwrap();
        let others = [other];
        let mut finer = |found: &[effects::EffectId]| {
            let model = Model::new(data.signals.context, found);
            let typical = found.iter().flat_map(|e| e.info().parameters);
            let start = base.own().iter().copied().chain(typical.map(|p| (p.typical)(&data.signals.context)));
            let start: Vec<f64> = start.collect();
            let fitted = fitting::fit(&data, &model, &start, false, &Silent).unwrap();
            let held_out = vec![transfer(&others[0], &fitted, &Silent).unwrap()];
            outcome.best = Validated { fitted, held_out, refuted: false };
            let finer =
                with_updated_noise(&data, &others, &outcome, (&Silent, &Incumbent::default())).unwrap();
            finer.map(|(.., outcome)| outcome.best.fitted.effects())
        };
        assert_eq!(
            finer(&[DeadTime, CoulombFriction, TimeVaryingLoad]),
            Some(vec![DeadTime, CoulombFriction])
        );
        // With effects of the motion alone nothing is repeated.
        assert_eq!(finer(&[CoulombFriction, TimeVaryingLoad]), None);
    }
}
