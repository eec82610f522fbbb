//! What to record next: the safe manoeuvre that would tell rivals apart, or pin down what the recording leaves open, found by
//! trying manoeuvres on simulated benches.

mod bench;
mod manoeuvres;
mod rivalry;

use super::answer::Verdict;
use super::data::Data;
use super::decide::Ranked;
use super::hypothesis::Hypothesis;
use super::remaining::Remaining;
use super::select::Outcome;
use super::wording::{enumerated, times};
use crate::error::Result;
use crate::machine::BaseParameter;
use crate::monitor::Monitor;
use crate::recording::Kind;
use bench::Bench;
use manoeuvres::{Candidate, digits};
use rayon::prelude::*;
use rivalry::{Rival, Separation};

/// Rivals compared at most.
const RIVALS: usize = 3;
/// A rival that loses less than this many times a decisive gain against what was named is worth an experiment.
const CLOSE: f64 = 2.0;
/// Least-squares steps with which a rival adjusts itself to a manoeuvre: when manoeuvres are compared, and for the words on the best.
const STEPS: (usize, usize) = (1, 5);
/// Manoeuvres looked at closely.
const FINALISTS: usize = 2;

/// One or two sentences on what to record next, if anything is open. Something that remains is asked about over its own variables.
///
/// # Errors
/// Those of the least-squares fits.
pub fn next_experiment(
    data: &Data,
    ranked: &[Ranked],
    outcome: &Outcome,
    (verdict, remaining): (Verdict, &[Remaining]),
    weak: &[String],
    monitor: &dyn Monitor,
) -> Result<Option<String>> {
    let rich = "reversals through standstill, two levels of i_q, steps of i_d, a coast-down";
    if data.signals.kind == Kind::OperatingPoints {
        let open =
            matches!(verdict, Verdict::Ambiguous | Verdict::Unknown | Verdict::Partial) || !weak.is_empty();
        let points = "points at other speeds, both directions, several levels of i_d and i_q, cold and warm";
        return Ok(open.then(|| format!("Record {points}.")));
    }
    let mut sentences = Vec::new();
    if matches!(verdict, Verdict::Unknown | Verdict::Partial) {
        let over = what_it_depends_on(remaining);
        let everywhere = || {
            format!(
                "Repeat the recording at the located place and around it, with {rich}, to see on what the rest depends."
            )
        };
        if over.is_empty() { sentences.push(everywhere()) } else { sentences.extend(over) }
    }
    let pair = rivals(ranked, outcome, verdict);
    let computed = || -> Result<Vec<String>> {
        let mut out = Vec::new();
        if let Some((name, others)) = &pair {
            out.extend(tell_apart(data, (*name, &outcome.best.fitted), others, monitor)?);
        }
        if !weak.is_empty() {
            out.extend(pin_down(data, &outcome.best.fitted, weak, monitor)?);
        }
        Ok(out)
    };
    sentences.extend(computed()?);
    if sentences.is_empty() && (verdict == Verdict::Ambiguous || !weak.is_empty()) {
        sentences.push(format!("Record {rich}."));
    }
    Ok((!sentences.is_empty()).then(|| sentences.join(" ")))
}

/// What to record to see on what the rest of the equations depends, by the variables over which it lies: a sentence for those that
/// need the same.
fn what_it_depends_on(remaining: &[Remaining]) -> Vec<String> {
    let mut told: Vec<(Vec<&str>, Vec<String>)> = Vec::new();
    for entry in remaining {
        let (what, sweeps) = sweeps_of(entry);
        match told.iter_mut().find(|(known, _)| *known == sweeps) {
            Some((_, whats)) => whats.push(what),
            None if sweeps.is_empty() => {}
            None => told.push((sweeps, vec![what])),
        }
    }
    let sentence = |(sweeps, whats): &(Vec<&str>, Vec<String>)| {
        format!("To see on what the rest {} depends, record {}.", enumerated(whats), sweeps.join(", and "))
    };
    told.iter().map(sentence).collect()
}

/// The rest of an equation in words, and what to record for the variables over which it lies.
fn sweeps_of(remaining: &Remaining) -> (String, Vec<&'static str>) {
    let sweep = |variable: &String| match variable.as_str() {
        "omega_e" => Some("slow ramps of the speed through standstill over its whole range, i_d at zero"),
        "theta_e" | "theta_m" => {
            Some("some turns at a slow constant speed in each direction, the angle logged")
        }
        "i_d" => Some("steps of i_d at two speeds"),
        "i_q" | "tau_e" => Some("steps of i_q in both directions at two speeds"),
        "t" => Some("the same manoeuvre for twice as long, cold and warm"),
        _ => None,
    };
    let mut sweeps: Vec<&'static str> = remaining.over.iter().filter_map(sweep).collect();
    sweeps.dedup();
    let what = match remaining.equation.as_str() {
        "mechanical" => "of the motion".to_string(),
        axis => format!("of the {axis}-axis voltage"),
    };
    (what, sweeps)
}

type Named<'a> = (&'static str, &'a Hypothesis);

/// The effect in question and the fitted sets in which something else stands in its place.
fn rivals<'a>(
    ranked: &[Ranked],
    outcome: &'a Outcome,
    verdict: Verdict,
) -> Option<(&'static str, Vec<Named<'a>>)> {
    let loss = |validated| outcome.evidence.cost(validated);
    let floor = loss(&outcome.best);
    let close_by = CLOSE * outcome.evidence.options().decisive;
    let of = |first: &Ranked| -> Vec<Named<'a>> {
        let mut swaps: Vec<_> = outcome.swaps.iter().filter(|s| s.replaced == first.effect).collect();
        swaps.sort_by(|a, b| loss(&a.validated).total_cmp(&loss(&b.validated)));
        let close = swaps.into_iter().filter_map(|s| {
            let by = s.by?;
            let asked = if verdict == Verdict::Ambiguous {
                first.equivalent.contains(&by)
            } else {
                loss(&s.validated) < floor + close_by && !by.contains(first.effect)
            };
            asked.then(|| (by.id(), &s.validated.fitted))
        });
        close.take(RIVALS).collect()
    };
    let found = outcome.best.fitted.effects();
    let mut asked = ranked.iter().filter(|r| found.contains(&r.effect)).map(|r| (r.effect.id(), of(r)));
    asked.find(|(_, rivals)| !rivals.is_empty())
}

/// A manoeuvre with what it shows of the rival that it separates worst: its place among the rivals.
struct Tried<'a> {
    candidate: &'a Candidate,
    worst: usize,
    separation: Separation,
}

/// One hypothesis against its rivals on a bench.
struct Contest<'a> {
    bench: Bench<'a>,
    best: &'a Hypothesis,
    rivals: Vec<Rival<'a>>,
    monitor: &'a dyn Monitor,
}

impl Contest<'_> {
    fn attempt<'c>(&self, candidate: &'c Candidate, steps: usize) -> Result<Option<Tried<'c>>> {
        let Some(trial) = self.bench.run(self.best, candidate, self.monitor)? else { return Ok(None) };
        let mut tried: Option<Tried> = None;
        for (worst, rival) in self.rivals.iter().enumerate() {
            let separation = rival.separation(&trial, self.best, steps, self.monitor)?;
            if tried.as_ref().is_none_or(|t| separation.nats < t.separation.nats) {
                tried = Some(Tried { candidate, worst, separation });
            }
        }
        Ok(tried)
    }

    /// All that the bench can do, best first.
    fn compare<'c>(&self, candidates: Vec<&'c Candidate>, steps: usize) -> Result<Vec<Tried<'c>>> {
        let all: Result<Vec<Option<Tried>>> =
            candidates.into_par_iter().map(|c| self.attempt(c, steps)).collect();
        let mut tried: Vec<Tried> = all?.into_iter().flatten().collect();
        tried.sort_by(|a, b| b.separation.nats.total_cmp(&a.separation.nats));
        Ok(tried)
    }
}

/// The manoeuvre that separates `best` from all of `others`.
fn tell_apart(data: &Data, best: Named, others: &[Named], monitor: &dyn Monitor) -> Result<Option<String>> {
    let rivals = others.iter().map(|(_, fitted)| Rival::new(data, fitted)).collect();
    let contest = Contest { bench: Bench::new(data, best.1)?, best: best.1, rivals, monitor };
    let bench = &contest.bench;
    let candidates = bench.limits.candidates()?;
    let first = contest.compare(candidates.iter().collect(), STEPS.0)?;
    let close = contest.compare(first.iter().take(FINALISTS).map(|t| t.candidate).collect(), STEPS.1)?;
    let Some(chosen) = close.first() else { return Ok(None) };
    let (name, rival) = (best.0, others[chosen.worst]);
    let (words, load) = (&chosen.candidate.words, bench.load_words());
    let Separation { nats, channel, left } = chosen.separation;
    if nats < data.options.decisive {
        return Ok(Some(format!(
            "No manoeuvre within the recorded speed, current and voltage would tell {name} from {}. The best of {} tried \
             ({words}{load}) would give the rival a residual of {} times the noise. Go beyond the recorded range where it is safe.",
            rival.0,
            first.len(),
            times(left),
        )));
    }
    // The same manoeuvre if the other one is true.
    let other = match bench.run(rival.1, chosen.candidate, monitor)? {
        Some(trial) => Some(Rival::new(data, best.1).separation(&trial, rival.1, STEPS.1, monitor)?),
        None => None,
    };
    let reverse = other.map_or(String::new(), |s| {
        format!(
            " If it is {}, {name} has a residual of {} times the noise in {}.",
            rival.0,
            times(s.left),
            s.channel.name()
        )
    });
    Ok(Some(format!(
        "To tell {name} from {}, {words}{load}. If it is {name}, {} has a residual of {} times the noise in {}, however \
         it is refitted.{reverse} Give both recordings to the diagnosis.",
        rival.0,
        rival.0,
        times(left),
        channel.name(),
    )))
}

/// The manoeuvre after which the least known of the `weak` base parameters is known best.
fn pin_down(
    data: &Data,
    fitted: &Hypothesis,
    weak: &[String],
    monitor: &dyn Monitor,
) -> Result<Option<String>> {
    let asked: Vec<BaseParameter> =
        BaseParameter::ALL.into_iter().filter(|p| weak.iter().any(|w| w == p.name())).collect();
    let indices: Vec<usize> = asked.iter().map(|p| p.index()).collect();
    let bench = Bench::new(data, fitted)?;
    let candidates = bench.limits.candidates()?;
    let known = Rival::new(data, fitted);
    let tried: Result<Vec<Option<_>>> = candidates
        .par_iter()
        .map(|candidate| {
            let Some(trial) = bench.run(fitted, candidate, monitor)? else { return Ok(None) };
            monitor.go_on()?;
            let spreads = known.spreads(&trial, &indices);
            let known = spreads.iter().all(|(_, after)| after.is_finite());
            let worst = spreads.iter().map(|(_, after)| *after).fold(0.0, f64::max);
            Ok(known.then_some((candidate, spreads, worst)))
        })
        .collect();
    let best = tried?.into_iter().flatten().min_by(|a, b| a.2.total_cmp(&b.2));
    let Some((candidate, spreads, _)) = best else { return Ok(None) };
    let percent =
        |x: f64| if x < 9.995 { format!("to {} %", digits(100.0 * x)) } else { "not at all".into() };
    let words: Vec<String> = asked
        .iter()
        .zip(&spreads)
        .map(|(p, (before, after))| {
            format!("{}, known {} here, would be known {}", p.name(), percent(*before), percent(*after))
        })
        .collect();
    let these = if data.parts.is_empty() { "This recording does" } else { "These recordings do" };
    Ok(Some(format!(
        "{these} not pin down {}: {}{}, and {}.",
        weak.join(", "),
        candidate.words,
        bench.load_words(),
        words.join("; ")
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, narrow, setup};
    use crate::diagnose::transfer::transfer;
    use crate::drive::Setup;
    use crate::effects::EffectId;
    use crate::error::Error;
    use crate::monitor::{Silent, StopFlag};

    fn coulomb() -> (Setup, Data, Hypothesis, Hypothesis) {
        let setup = setup(narrow(), vec![choice("coulomb_friction", "tau_c", 1.0)]);
        let (data, base) = data(&setup);
        let right = fitted(&data, &base, EffectId::CoulombFriction);
        let wrong = fitted(&data, &base, EffectId::AsymmetricFriction);
        (setup, data, right, wrong)
    }

    #[test]
    fn the_prescribed_manoeuvre_tells_what_the_recording_could_not() {
        let (_, data, right, wrong) = coulomb();
        assert!(
            (wrong.squares[2].1 - right.squares[2].1).abs() < 0.02,
            "{:?} {:?}",
            wrong.squares,
            right.squares
        );
        let contest = Contest {
            bench: Bench::new(&data, &right).unwrap(),
            best: &right,
            rivals: vec![Rival::new(&data, &wrong)],
            monitor: &Silent,
        };
        let candidates = contest.bench.limits.candidates().unwrap();
        let tried = contest.compare(candidates.iter().collect(), STEPS.1).unwrap();
        assert!(tried[0].separation.nats > CLOSE * data.options.decisive, "{:?}", tried[0].separation);
        assert!(tried[0].candidate.words.contains("reverse"), "{}", tried[0].candidate.words);
        // On that manoeuvre the rival fails as foretold, and the right one does not.
        let trial = contest.bench.run(&right, tried[0].candidate, &Silent).unwrap().unwrap();
        let square =
            |h: &Hypothesis| transfer(&trial, h, &Silent).unwrap().square(tried[0].separation.channel);
        assert!(square(&right) < 0.1, "{}", square(&right));
        let left = (1.0 + square(&wrong)).sqrt();
        assert!(left > 0.95 * tried[0].separation.left, "{left} {}", tried[0].separation.left);
    }

    #[test]
    fn the_advice_names_both_rivals_and_what_each_would_show() {
        let (_, data, right, wrong) = coulomb();
        let others = [("asymmetric_friction", &wrong)];
        let text = tell_apart(&data, ("coulomb_friction", &right), &others, &Silent).unwrap().unwrap();
        for part in
            ["coulomb_friction", "asymmetric_friction", "rad/s", "times the noise in omega_e", "at no load"]
        {
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn what_nothing_can_separate_is_said_to_be_so() {
        let (_, data, right, _) = coulomb();
        let twin = right.clone();
        let others = [("its twin", &twin)];
        let text = tell_apart(&data, ("coulomb_friction", &right), &others, &Silent).unwrap().unwrap();
        assert!(text.starts_with("No manoeuvre within the recorded"), "{text}");
    }

    #[test]
    fn parameters_that_a_recording_leaves_open_get_a_manoeuvre_of_their_own() {
        let (_, data, right, _) = coulomb();
        let text = pin_down(&data, &right, &["l_d".into()], &Silent).unwrap().unwrap();
        assert!(text.contains("i_d") && text.contains("l_d, known"), "{text}");
    }

    #[test]
    fn an_interruption_ends_the_trials() {
        let (_, data, right, wrong) = coulomb();
        let flag = StopFlag::default();
        flag.stop();
        let others = [("asymmetric_friction", &wrong)];
        let ended = tell_apart(&data, ("coulomb_friction", &right), &others, &flag);
        assert!(matches!(ended, Err(Error::Interrupted)));
    }
}
