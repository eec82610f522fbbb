//! Mistakes of scale and time as rivals of the effects that explain a log.
//!
//! A wrong scale or number of pole pairs shows against a load that is known, and there it looks like friction that differs by direction.
//! Voltages that are logged late act before they are there, which some effects of the currents resemble. Each is undone, and the set is
//! fitted to what is then read, without those of its effects that vanish. Evidence decides, the nameplate's included.

use super::mistakes::{Mistake, currents_late, scaled, voltages_early, voltages_late};
use super::{BETTER, misfit, told};
use crate::diagnose::data::Data;
use crate::diagnose::evidence::Evidence;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::incumbent::Incumbent;
use crate::diagnose::nameplate::{self, Scaled};
use crate::diagnose::options::DiagnosisOptions;
use crate::diagnose::outputs::Outputs;
use crate::diagnose::select::reduced;
use crate::diagnose::wording::enumerated;
use crate::diagnose::{baseline, fitting, join, search, stated_load, verdict};
use crate::effects::EffectId;
use crate::error::Result;
use crate::machine::{BaseParameter, Machine};
use crate::monitor::Monitor;
use crate::recording::Recording;
use crate::signals::Finding;

/// What a mistake in place of effects means.
const CONSEQUENCE: &str =
    "effects make up for that in the log as it is; what is said of it does not hold for the motor";

/// Logarithm of the ratio of two scales of the torque up to which they count as the same. True friction is that by chance only.
const SAME: f64 = 0.01;

/// A mistake that explains the `recordings`, read as `data`, better than the effects of `best` do, if one does.
///
/// # Errors
/// Those of the least-squares fits. A log that cannot be read with a mistake undone was not made by it.
pub fn in_place_of_effects(
    recordings: &[&Recording],
    machine: &Machine,
    (data, best): (&Data, &Hypothesis),
    monitor: &dyn Monitor,
) -> Result<Option<Finding>> {
    let unexplained = verdict::largest_excess(best) > data.options.mismatch;
    if data.poor || best.effects().is_empty() && !unexplained {
        return Ok(None);
    }
    let as_it_is = Weighed::new(data, best.clone());
    let shift = shift(recordings[0], machine, unexplained, data.options.mismatch);
    let mut asked: Vec<(Mistake, Machine, Compared)> = shift
        .into_iter()
        .map(|(shift, most)| (shift, machine.clone(), Compared::Residuals { most }))
        .collect();
    for (what, factor) in scales(data, &as_it_is) {
        let corrected = with_pole_pairs(machine, what, factor);
        asked.extend(
            corrected.map(|m| (scaled(what, factor, machine.n_p, data.link()), m, Compared::OverNoise)),
        );
    }
    let price = data.options.effect_cost + data.options.decisive;
    let mut paying: Vec<(f64, Mistake, Hypothesis)> = Vec::new();
    for (mistake, machine, compared) in asked {
        monitor.go_on()?;
        let undone: Option<Vec<Recording>> = recordings.iter().map(|r| mistake.undone(r)).collect();
        let Some(undone) = undone else { continue };
        let undone: Vec<&Recording> = undone.iter().collect();
        let Ok(mut read) = join::prepare(&undone, &machine, &data.options) else { continue };
        let base = baseline::fit(&mut read, monitor)?;
        let set = without_vanished(&read, &base, best, monitor)?;
        let (base, set) = (Weighed::new(&read, base), Weighed::new(&read, set));
        let better = if set.cost(compared) < base.cost(compared) { &set } else { &base };
        let gain = as_it_is.cost(compared) - better.cost(compared);
        let allowed = match compared {
            Compared::Residuals { most } => verdict::largest_excess(&better.set) <= most,
            // Load and friction may be what they are by chance: the nameplate must tell as well.
            Compared::OverNoise => as_it_is.off_nameplate - better.off_nameplate >= data.options.decisive,
        };
        // A mistake is as rare as an effect.
        if !allowed || gain < price {
            continue;
        }
        // Whatever the mistake does not explain may be the cause of all.
        let mut set = better.set.clone();
        if is_unexplained(&set, &data.options) {
            set = explained(&read, &base.set, monitor)?;
            if is_unexplained(&set, &data.options) {
                continue;
            }
        }
        paying.push((gain, mistake, set));
    }
    // What is as likely for this log is told together.
    paying.sort_by(|a, b| b.0.total_cmp(&a.0));
    let Some((most, _, better)) = paying.first() else { return Ok(None) };
    let alike = paying.iter().take_while(|(gain, ..)| most - gain < data.options.decisive);
    let words: Vec<&str> = alike.map(|(_, mistake, _)| mistake.words.as_str()).collect();
    let left = 1.0 + verdict::largest_excess(better).max(0.0);
    Ok(Some(told(&words.join(", or "), left, &beside(best, better), CONSEQUENCE)))
}

/// The shift in time with which the voltage equations leave least in a regression without effects, and the excess that may remain with it.
/// Delays and lags are physics, too: where they explain all they are no mistake, and a shift must explain all to be one.
fn shift(recording: &Recording, machine: &Machine, unexplained: bool, most: f64) -> Option<(Mistake, f64)> {
    let as_it_is = misfit(recording, machine).unwrap_or(1.0);
    // What remains falls until as many rows are undone as were shifted.
    let nearest = |rows: Vec<Mistake>| {
        let mut found: Option<(f64, Mistake)> = None;
        for mistake in rows {
            let least = found.as_ref().map_or(BETTER * as_it_is, |(least, _)| *least);
            match mistake.undone(recording).and_then(|undone| misfit(&undone, machine)) {
                Some(left) if left < least => found = Some((left, mistake)),
                _ => break,
            }
        }
        found
    };
    let late = nearest(voltages_late()).map(|(left, mistake)| (left, mistake, f64::INFINITY));
    let delayed = if unexplained { vec![voltages_early(), currents_late()] } else { Vec::new() };
    let delayed = delayed.into_iter().filter_map(nearest).map(|(left, mistake)| (left, mistake, most));
    let least = late.into_iter().chain(delayed).min_by(|a, b| a.0.total_cmp(&b.0));
    // A strong effect hides a shift from such a regression.
    let hidden = || voltages_late().into_iter().next().filter(|_| unexplained);
    least.map(|(_, mistake, most)| (mistake, most)).or_else(|| Some((hidden()?, f64::INFINITY)))
}

/// The best set of effects for a log with a mistake undone. What was found in the log as it is made up for the mistake, too.
fn explained(read: &Data, base: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    if !is_unexplained(base, &read.options) {
        return Ok(base.clone());
    }
    let outcome = search::search(read, &[], base, None, (monitor, &Incumbent::default()))?;
    Ok(outcome.best.fitted)
}

/// Whether more than noise and the error of forms remains: missing physics may then be the cause of all, and look like a shift in time.
fn is_unexplained(set: &Hypothesis, options: &DiagnosisOptions) -> bool {
    verdict::largest_excess(set) > options.form_error()
}

/// Scales in which the log may be wrong: that which brings the parameters near to the nameplate, and those by which the torque is off from a
/// load that is known.
fn scales(data: &Data, as_it_is: &Weighed) -> Vec<(Scaled, f64)> {
    let (ratios, link) = (&as_it_is.ratios, data.link());
    let by_nameplate = nameplate::scale(ratios, link).filter(|_| nameplate::contradict(ratios));
    let mut found: Vec<(Scaled, f64)> =
        by_nameplate.map(|(what, factor, _)| (what, factor)).into_iter().collect();
    let load = stated_load::mean(data).filter(|load| *load != 0.0);
    if let Some((lost, load)) = as_it_is.lost_torque.zip(load) {
        let torque = 1.0 + lost / load;
        let as_much = |factor: &f64| (factor / torque).ln().abs() < SAME;
        let fits = nameplate::torque_scales(link).into_iter().filter(|(.., of_torque)| as_much(of_torque));
        for (what, factor, _) in fits {
            if !found.contains(&(what, factor)) {
                found.push((what, factor));
            }
        }
    }
    found
}

/// The machine with another number of pole pairs, if they are what is scaled; nothing where that is no whole number.
fn with_pole_pairs(machine: &Machine, what: Scaled, factor: f64) -> Option<Machine> {
    if what != Scaled::PolePairs {
        return Some(machine.clone());
    }
    let n_p = f64::from(machine.n_p) / factor;
    (n_p.fract() == 0.0 && n_p >= 1.0).then(|| Machine { n_p: n_p as u32, ..machine.clone() })
}

/// The effects of `best` fitted to a log with a mistake undone, but for those that vanish there.
fn without_vanished(
    data: &Data,
    base: &Hypothesis,
    best: &Hypothesis,
    monitor: &dyn Monitor,
) -> Result<Hypothesis> {
    let first = crate::base::BASE;
    let start = [&base.own()[..first], &best.own()[first..]].concat();
    let mut set = fitting::fit(data, &best.model, &start, false, monitor)?;
    loop {
        let outputs = Outputs::new(data, &set);
        let gone = set.effects().into_iter().find(|e| set.vanishes(*e) || outputs.may_be_absent(*e));
        let Some(effect) = gone else { return Ok(set) };
        let (model, start) = reduced(&set, effect);
        set = fitting::fit(data, &model, &start, false, monitor)?;
    }
}

/// How residuals of a log as it is and with a mistake undone are compared.
#[derive(Clone, Copy, PartialEq)]
enum Compared {
    /// As they are: what is undone may change how much of them passes for noise. No more than this excess may remain.
    Residuals { most: f64 },
    /// Over the noise, which scales with the log.
    OverNoise,
}

/// A set on a log with all that it is compared by.
struct Weighed {
    set: Hypothesis,
    /// Parameters over the nameplate's, and what it says against them, nats.
    ratios: Vec<(BaseParameter, f64)>,
    off_nameplate: f64,
    /// Cost of the set, and what the size of the noise adds to it, nats.
    over_noise: f64,
    noise: f64,
    /// Torque of friction that differs by direction, N·m, where the set has such.
    lost_torque: Option<f64>,
}

impl Weighed {
    fn new(data: &Data, set: Hypothesis) -> Self {
        let outputs = Outputs::new(data, &set);
        let ratios = nameplate::ratios(data, &outputs.base());
        let lost_torque = outputs.effect(EffectId::AsymmetricFriction).get("tau_a").and_then(|e| e.value);
        let evidence = Evidence::new(data, &[]);
        let floors = data.runs().iter().flat_map(|run| &run.floors).zip(evidence.samples());
        Self {
            off_nameplate: nameplate::misfit(&ratios, &data.options),
            ratios,
            over_noise: evidence.cost_on_recording(&set),
            noise: floors.map(|(floor, n)| n * floor.total().ln()).sum(),
            lost_torque,
            set,
        }
    }

    fn cost(&self, compared: Compared) -> f64 {
        let noise = if compared == Compared::OverNoise { 0.0 } else { self.noise };
        noise + self.over_noise + self.off_nameplate
    }
}

/// Which effects there are with a mistake undone, and which are gone.
fn beside(as_it_is: &Hypothesis, undone: &Hypothesis) -> String {
    let kept = undone.effects();
    let gone: Vec<EffectId> = as_it_is.effects().into_iter().filter(|e| !kept.contains(e)).collect();
    let words = |before: &str, effects: &[EffectId]| match effects {
        [] => String::new(),
        _ => format!("{before}{}", enumerated(&effects.iter().map(|e| e.id()).collect::<Vec<_>>())),
    };
    words(" beside ", &kept) + &words(", without ", &gone)
}

#[cfg(test)]
mod tests {
    use super::super::mistakes::{Columns, scale};
    use super::super::testing::recorded;
    use crate::diagnose::answer::{Answer, Verdict};
    use crate::diagnose::diagnose;
    use crate::diagnose::testing::choice;
    use crate::drive::Choice;
    use crate::machine::Machine;
    use crate::monitor::Silent;

    /// Of a machine against a load of 3 N·m that the log states, with a mistake that `make` has made.
    fn told(effects: Vec<Choice>, n_p: impl Fn(u32) -> u32, make: impl Fn(&mut Columns)) -> Answer {
        let (recording, nameplate) = recorded(effects, Some(3.0), make);
        let machine = Machine { n_p: n_p(nameplate.n_p), ..nameplate };
        diagnose(&[&recording], &machine, None, &Default::default(), &Silent).unwrap()
    }

    fn said(answer: &Answer, words: &str) -> bool {
        answer.verdict == Verdict::Undetermined && answer.data_quality[0].finding.contains(words)
    }

    #[test]
    fn a_wrong_scale_against_a_known_load_is_no_friction() {
        let answer = told(Vec::new(), |n| n, |c| assert!(scale(c, &["v_d", "v_q"], 3f64.sqrt())));
        assert!(said(&answer, "the voltages were √3 times too large"), "{:?}", answer.data_quality);
        assert!(said(&answer, "without asymmetric_friction"), "{:?}", answer.data_quality);
        let answer = told(Vec::new(), |n| 2 * n, |_| ());
        assert!(said(&answer, "n_p was 4 and not 8"), "{:?}", answer.data_quality);
    }

    #[test]
    fn voltages_that_act_before_they_are_logged_are_told_beside_effects() {
        let late = |c: &mut Columns| {
            for name in ["v_d", "v_q"] {
                let x = c.get_mut(name).unwrap();
                x.rotate_right(1);
                x[0] = x[1];
            }
        };
        for effects in [Vec::new(), vec![choice("dead_time", "v_err", 6.0)]] {
            let answer = told(effects, |n| n, late);
            assert!(
                said(&answer, "the voltages were logged one row late"),
                "{:?} {:?} {:?}",
                answer.verdict,
                answer.model.effects,
                answer.data_quality
            );
        }
    }

    #[test]
    fn voltages_that_a_filter_delays_by_part_of_a_row_are_no_shift_by_a_row() {
        let smeared = |c: &mut Columns| {
            for name in ["v_d", "v_q"] {
                let x = c.get_mut(name).unwrap();
                let last: Vec<f64> = std::iter::once(x[0]).chain(x.iter().copied()).collect();
                x.iter_mut().zip(last).for_each(|(x, last)| *x = 0.3 * *x + 0.7 * last);
            }
        };
        let answer = told(Vec::new(), |n| n, smeared);
        assert_ne!(answer.verdict, Verdict::NoMismatch);
        let shifted = answer.data_quality.iter().any(|f| f.finding.contains("logged one row"));
        assert!(!shifted, "{:?} {:?}", answer.verdict, answer.data_quality);
    }

    #[test]
    fn friction_that_a_wrong_scale_would_look_like_stays_friction_where_the_nameplate_holds() {
        // Half the load: currents and voltages that are both √1.5 too large would look the same.
        let answer = told(vec![choice("asymmetric_friction", "tau_a", 1.5)], |n| n, |_| ());
        assert_eq!(answer.model.effects, ["asymmetric_friction"], "{:?}", answer.data_quality);
        let answer = told(vec![choice("dead_time", "v_err", 6.0)], |n| n, |_| ());
        assert_eq!(answer.model.effects, ["dead_time"], "{:?}", answer.data_quality);
    }
}
