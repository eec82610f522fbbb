//! Diagnosis: what does the model of this machine leave out?
//!
//! The bare machine is fitted, what it leaves is located, every effect of the catalogue is scored on it, the most promising
//! ones are refitted by simulation, alone and together, and judged on samples that were not used for fitting. What
//! explains everything down to the noise is named; what several effects explain is ambiguous; what none explains is
//! unknown, and still located.

mod agree;
pub mod answer;
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

use crate::effect::Site;
use crate::error::Result;
use crate::least_squares;
use crate::machine::Machine;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::recording::{Kind, Recording};
use crate::signals::{self, Finding, Signals};
use answer::{Answer, BeforeAfter, Candidate, Columns, FitTable, FoundModel, Step, Traces, Verdict};
use data::Data;
use decide::Ranked;
use hypothesis::Hypothesis;
use locate::Located;
use outputs::{Inseparable, Outputs};
use search::{Outcome, Search};
use std::collections::BTreeMap;

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
        return Ok(undetermined(&whole, finding));
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
    conclude(&whole, judge, outcome, &weak, monitor)
}

/// Searches for the effects, held against the other recordings or against every other window of this one.
fn search(
    whole: &Data,
    others: &[Data],
    base: &Hypothesis,
    rich: bool,
    monitor: &dyn Monitor,
) -> Result<Outcome> {
    let split = (others.is_empty() && rich).then(|| halves(whole)).flatten();
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

fn undetermined(data: &Data, finding: Finding) -> Answer {
    let mut data_quality = data.signals.findings.clone();
    data_quality.push(finding);
    Answer {
        schema: "pmsm-rs.diagnosis/1",
        verdict: Verdict::Undetermined,
        data_quality,
        located: Vec::new(),
        ranking: Vec::new(),
        model: FoundModel { effects: Vec::new(), base: BTreeMap::new(), unmodelled: None },
        path: Vec::new(),
        cannot_see: Vec::new(),
        next_experiment: Some("Record a rich manoeuvre: reversals, two levels of i_q, steps of i_d.".into()),
        noise_floor: floors(data),
        fit: FitTable::default(),
        recording_kind: data.signals.kind,
        recordings: Vec::new(),
        traces: Traces::default(),
    }
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

fn floors(data: &Data) -> BTreeMap<String, f64> {
    data.floors.iter().map(|f| (f.channel.name().to_string(), f.total())).collect()
}

/// Writes the answer.
fn conclude(
    data: &Data,
    judge: Option<&Data>,
    mut outcome: Outcome,
    weak: &[String],
    monitor: &dyn Monitor,
) -> Result<Answer> {
    if !weak.is_empty() && outcome.base.excess() <= verdict::MISMATCH {
        // On a poor recording a small gain of one effect is no evidence against the bare machine.
        outcome.best = outcome.base.clone();
        outcome.path.truncate(1);
        outcome.swaps.clear();
        let asked: Vec<_> = outcome.singles.iter().map(|(p, _)| p.effect).collect();
        let worth = outcome.scale.worth();
        outcome.shown = power::survey(data, &outcome.base.fitted, &asked, worth, true, monitor);
    }
    let (mut verdict, mut ranked) = decide::decide(&outcome, !weak.is_empty());
    let refuted = outcome.best.refuted;
    if refuted {
        // It stays a candidate, but is no model to predict with.
        outcome.best = outcome.base.clone();
        outcome.path.truncate(1);
    }
    let last = outcome.path.len() - 1;
    for judged in &mut outcome.path {
        judged.fitted = hypothesis::efficient(data, &judged.fitted, monitor)?;
    }
    let (first, end) = (outcome.path[0].clone(), outcome.path[last].clone());
    (outcome.base, outcome.best) = (first, end);
    let best = &outcome.best;
    let located = located(data, &outcome, verdict);
    // What stays unknown is at least described, so that the model predicts.
    let contradiction = agree::contradiction(data, &best.fitted, monitor)?;
    if contradiction.as_ref().is_some_and(|c| c.concerns(&best.fitted.effects())) {
        verdict = Verdict::Undetermined;
        ranked.iter_mut().for_each(|r| r.probability = r.probability.min(agree::CEILING));
    }
    let described = if verdict == Verdict::Unknown && !monitor.cancelled() {
        Some(unmodelled::explain(data, judge, &best.fitted, monitor)?)
    } else {
        None
    };
    let settled = described.as_ref().map_or(&best.fitted, |(fitted, _)| fitted);
    let model_outputs = Outputs::new(data, settled);
    // Steady points have no dynamics to tell an effect from the base parameters that it is entangled with.
    let steady = data.signals.kind == Kind::OperatingPoints;
    let ties = if steady { model_outputs.inseparable() } else { Vec::new() };
    if verdict == Verdict::Named && !ties.is_empty() {
        verdict = Verdict::Ambiguous;
    }
    let validation = match judge {
        Some(judge) => Some((
            judge,
            hypothesis::transfer(judge, &outcome.base.fitted, monitor)?,
            hypothesis::transfer(judge, settled, monitor)?,
        )),
        None => None,
    };
    let mut traces = Traces { recording: traces(data, &outcome.base.fitted, settled), ..Traces::default() };
    let mut fit = FitTable { recording: table(&traces.recording, data), ..FitTable::default() };
    if let Some((judge, before, after)) = &validation {
        traces.validation = self::traces(judge, before, after);
        fit.validation = table(&traces.validation, judge);
    }
    let ranking = ranked.iter().map(|r| candidate(data, &outcome, r, &model_outputs)).collect();
    let next_experiment = prescribe::next_experiment(data, &ranked, &outcome, verdict, weak, monitor)?;
    let mut data_quality = quality(data, weak, &ties, refuted);
    data_quality.extend(contradiction.map(|c| c.finding));
    Ok(Answer {
        schema: "pmsm-rs.diagnosis/1",
        verdict,
        data_quality,
        located,
        ranking,
        model: FoundModel {
            effects: outcome.order().iter().map(|e| e.id().to_string()).collect(),
            base: model_outputs.base(),
            unmodelled: described.map(|(_, unmodelled)| unmodelled),
        },
        path: outcome.path.iter().map(|judged| step(data, &judged.fitted)).collect(),
        cannot_see: power::cannot_see(&outcome),
        next_experiment,
        noise_floor: floors(data),
        fit,
        recording_kind: data.signals.kind,
        recordings: each::recordings(data, &traces.recording),
        traces,
    })
}

fn step(data: &Data, hypothesis: &Hypothesis) -> Step {
    let outputs = Outputs::new(data, hypothesis);
    let effects = hypothesis.effects();
    Step {
        effects: effects.iter().map(|e| e.id().to_string()).collect(),
        base: outputs.base(),
        parameters: effects.iter().map(|e| (e.id().to_string(), outputs.effect(*e))).collect(),
        rms: residual_rms(data, hypothesis),
    }
}

/// Root mean square of the residual by channel, over all recordings that hold it.
fn residual_rms(data: &Data, hypothesis: &Hypothesis) -> BTreeMap<String, f64> {
    let mut sums: BTreeMap<String, Vec<(f64, usize)>> = BTreeMap::new();
    let floors = data.runs().iter().flat_map(|run| run.floors.iter().map(|f| (f, run.signals.len())));
    for ((floor, samples), (channel, square)) in floors.zip(&hypothesis.squares) {
        let rms = square.sqrt() * floor.total();
        sums.entry(channel.name().to_string()).or_default().push((rms, samples));
    }
    let root = |parts: Vec<(f64, usize)>| match parts[..] {
        [(rms, _)] => rms,
        _ => {
            let samples: usize = parts.iter().map(|(_, n)| n).sum();
            (parts.iter().map(|(rms, n)| rms * rms * *n as f64).sum::<f64>() / samples as f64).sqrt()
        }
    };
    sums.into_iter().map(|(name, parts)| (name, root(parts))).collect()
}

fn candidate(data: &Data, outcome: &Outcome, ranked: &Ranked, model: &Outputs) -> Candidate {
    let info = ranked.effect.info();
    let in_model = outcome.best.fitted.effects().contains(&ranked.effect);
    let parameters = if in_model {
        model.effect(ranked.effect)
    } else {
        Outputs::new(data, &ranked.judged.fitted).effect(ranked.effect)
    };
    let (before, after) = (outcome.base.held_out_squares(), ranked.judged.held_out_squares());
    Candidate {
        effect: info.id.into(),
        probability: ranked.probability,
        sentence: info.sentence.into(),
        equation: info.equation.into(),
        parameters,
        equivalent_to: ranked.equivalent.iter().map(|e| e.id().to_string()).collect(),
        gain_held_out: if before > 0.0 { ((before - after) / before).clamp(-1.0, 1.0) } else { 0.0 },
    }
}

/// Where it sits. What a named sensor or electrical effect explains of the other equations is its own.
fn located(data: &Data, outcome: &Outcome, verdict: Verdict) -> Vec<Located> {
    let mut located = locate::locate(data, &outcome.base.fitted);
    if !matches!(verdict, Verdict::Named | Verdict::Ambiguous) {
        return located;
    }
    let sites: Vec<Site> = outcome.best.fitted.effects().iter().map(|e| e.info().site).collect();
    if sites.first() == Some(&Site::Sensor) {
        if let Some(strongest) = located.first().cloned() {
            let sentence = format!(
                "The measurement is wrong, not the motor. {} A single sensor error explains it in all equations.",
                strongest.sentence
            );
            let share = located.iter().map(|l| l.share).sum();
            located.insert(0, Located { equation: "sensor".into(), share, sentence, ..strongest });
        }
    } else if sites.contains(&Site::Electrical) && !sites.contains(&Site::Mechanical) {
        located.sort_by_key(|l| l.equation == "mechanical");
    }
    located
}

fn quality(data: &Data, weak: &[String], found: &[Inseparable], refuted: bool) -> Vec<Finding> {
    let mut findings = data.signals.findings.clone();
    let noise: Vec<Vec<Finding>> = data.runs().iter().map(|run| run.input.findings(&run.signals)).collect();
    findings.extend(signals::join::findings(noise.iter().map(Vec::as_slice)));
    for tie in found {
        let (others, effect) = (tie.others.join(", "), tie.effect.id());
        findings.push(Finding {
            finding: format!(
                "{} of {effect} is hardly separable from {others} here (correlation {:.2})",
                tie.parameter, tie.correlation
            ),
            consequence: "each can stand in for the others, so that no value of them is worth much by itself"
                .into(),
            fix: "record at other speeds, currents and directions as well".into(),
        });
    }
    if data.signals.kind == Kind::OperatingPoints {
        findings.push(Finding {
            finding: "the samples are far apart compared with the electrical time constants".into(),
            consequence: "they are taken as steady operating points; nothing is said about transients or ripple".into(),
            fix: "sample at the switching frequency for those questions".into(),
        });
    }
    if !weak.is_empty() {
        findings.push(Finding {
            finding: format!("the manoeuvre does not pin down {}", weak.join(", ")),
            consequence: "effects that resemble a change of these parameters cannot be told from it".into(),
            fix: "add reversals, a second level of i_q and steps of i_d".into(),
        });
    }
    if refuted {
        findings.push(Finding {
            finding: "what fits this recording predicts the validation run worse than the bare machine"
                .into(),
            consequence: "the candidates are listed, but none is put into the model".into(),
            fix: "diagnose a manoeuvre with reversals, two levels of i_q and steps of i_d".into(),
        });
    }
    findings
}

/// Measured, before and after, with the operating point.
fn traces(data: &Data, before: &Hypothesis, after: &Hypothesis) -> Columns {
    let mut columns = Columns::new();
    let s = &data.signals;
    columns.insert("t".into(), s.t.clone());
    if let Some(number) = each::numbers(data) {
        columns.insert("recording".into(), number);
    }
    let first = data.whole(before);
    let (x, y) = (first.predict(&before.parameters), data.whole(after).predict(&after.parameters));
    for (at, channel) in first.channels().iter().enumerate() {
        let name = channel.name();
        columns.insert(format!("{name}_measured"), first.measured(*channel));
        columns.insert(format!("{name}_before"), x[at].clone());
        columns.insert(format!("{name}_after"), y[at].clone());
    }
    columns.insert("op_omega_e".into(), s.omega_e.clone());
    if let Some([d, q]) = &s.i {
        columns.insert("op_i_d".into(), d.clone());
        columns.insert("op_i_q".into(), q.clone());
    }
    if s.angle_known && s.kind != Kind::OperatingPoints {
        columns.insert("op_theta_e".into(), s.theta_e.clone());
        columns.insert("op_theta_m".into(), s.theta_m.clone());
    }
    columns
}

fn table(columns: &Columns, data: &Data) -> BeforeAfter {
    let rms = |when: &str| -> BTreeMap<String, f64> {
        data.floors
            .iter()
            .filter_map(|f| {
                let name = f.channel.name();
                let (measured, model) =
                    (columns.get(&format!("{name}_measured"))?, columns.get(&format!("{name}_{when}"))?);
                Some((name.to_string(), each::rms(measured, model)))
            })
            .collect()
    };
    BeforeAfter { before: rms("before"), after: rms("after") }
}
