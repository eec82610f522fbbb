//! The answer: what was found, where, what else it could be, and what it is worth.

mod ruling;

use super::answer::{
    Answer, Candidate, Covariance, Estimate, FitTable, FoundModel, SCHEMA, Step, Traces, Verdict,
};
use super::budget::Ends;
use super::data::Data;
use super::decide::{self, Ranked};
use super::hypothesis::Hypothesis;
use super::outputs::Outputs;
use super::select::Outcome;
use super::transfer::transfer;
use super::verdict::Validated;
use super::{
    attribution, budget, coverage, data_quality, experiment_design, log_limits, nameplate, per_recording,
    power, stated_load, traces, unmodelled, verdict,
};
use crate::error::Result;
use crate::machine::BaseParameter;
use crate::monitor::Monitor;
use crate::signals::Finding;
use crate::specification::{Reading, Specification};
use rayon::prelude::*;
use ruling::{Ruling, Runs};
use std::collections::BTreeMap;

/// The answer where nothing can be said of recordings that were read, and why.
pub fn undetermined(data: &Data, finding: Finding, next: Option<&str>) -> Answer {
    let mut answer = Answer {
        next_experiment: next.map(str::to_string),
        noise_floor: floors(data),
        recording_kind: Some(data.signals.kind),
        options: data.options,
        ..Answer::undetermined(finding)
    };
    answer.data_quality.extend(data.signals.findings.iter().cloned());
    answer
}

/// The answer where the dq-model is no model of the recordings, by the `finding` that says so: a `mistake` that explains it comes first.
pub fn without_model(data: &Data, mistake: Option<Finding>, finding: Finding) -> Answer {
    let Some(mistake) = mistake else { return undetermined(data, finding, None) };
    let mut answer = undetermined(data, mistake, None);
    answer.data_quality.push(finding);
    answer
}

fn floors(data: &Data) -> BTreeMap<String, f64> {
    data.floors.iter().map(|f| (f.channel.name().to_string(), f.total())).collect()
}

/// Writes the answer. The search calls for a verdict, which a remaining residual and doubtful strengths may change. What stays unknown is
/// described by a map.
pub fn conclude(
    data: &Data,
    validation: Option<&Data>,
    outcome: Outcome,
    weak: &[String],
    monitor: &dyn Monitor,
) -> Result<Answer> {
    let mut ruling = Ruling::new(Runs { data, validation, monitor }, outcome)?;
    ruling.weigh_model()?;
    ruling.weigh_remainder()?;
    ruling.weigh_against_map()?;
    ruling.weigh_strengths();
    monitor.go_on()?;
    let located = attribution::located(data, validation, &ruling.outcome, ruling.verdict);
    ruling.settle();
    let Ruling {
        outcome, mut ranked, mut verdict, mut reason, before, mut after, remaining, described, ..
    } = ruling;
    let best = &outcome.best;
    // Of the named effects, without the map that describes the rest.
    let predicted = before.as_ref().zip(after.as_ref()).filter(|_| verdict != Verdict::Unknown);
    let predicted = predicted.map(|(before, after)| (verdict::excess(before), verdict::excess(after)));
    // A map describes what has no name, so that the model predicts.
    let described = match verdict {
        Verdict::Partial if described.is_some() => described,
        Verdict::Unknown | Verdict::Partial => {
            Some(unmodelled::explain(data, validation, &best.fitted, monitor)?)
        }
        _ => None,
    };
    let by_the_log = described.as_ref().filter(|_| verdict == Verdict::Unknown);
    if let Some(why) = by_the_log.and_then(|(_, rest)| log_limits::may_have_caused(data, &best.fitted, rest))
    {
        (verdict, reason) = (Verdict::Undetermined, Some(why));
    }
    if let Some((fitted, _)) = &described {
        after = validation.map(|run| transfer(run, fitted, monitor)).transpose()?;
    }
    let settled = described.as_ref().map_or(&best.fitted, |(fitted, _)| fitted);
    monitor.go_on()?;
    let estimated = unmodelled::estimated(data, &best.fitted, settled, monitor)?;
    let outputs = Outputs::new(data, &estimated);
    let (mut base, mut covariance) = (outputs.base(), outputs.covariance());
    if estimated.effects().is_empty() && settled.model.map() != estimated.model.map() {
        better_known(&Outputs::new(data, settled).base(), &mut base, &mut covariance);
    }
    let validated = validation.zip(before).zip(after).map(|((run, before), after)| (run, before, after));
    let (bare, left) = validated.as_ref().map(|(_, before, after)| (before, after)).unzip();
    let ends = Ends { base: (&outcome.base.fitted, bare), set: &best.fitted, told: (settled, left) };
    let budget = budget::budgets(data, validation, &ends, monitor)?;
    monitor.go_on()?;
    let mut traces =
        Traces { recording: traces::columns(data, &outcome.base.fitted, settled), ..Traces::default() };
    let mut fit = FitTable { recording: traces::table(&traces.recording, data), ..FitTable::default() };
    if let Some((run, before, after)) = &validated {
        traces.validation = traces::columns(run, before, after);
        fit.validation = traces::table(&traces.validation, run);
    }
    let others = validated.iter().filter(|_| data.poor && !ruling.refuted);
    let limit = data.options.mismatch_held_out;
    let unpredicted: Vec<Finding> =
        others.filter_map(|(_, _, after)| data_quality::not_predicted(after, limit)).collect();
    if !unpredicted.is_empty() {
        decide::doubt(&mut ranked, data.options.ceiling_doubtful);
    }
    let gains = (&ruling.searched, predicted);
    let candidate = |r: &Ranked| {
        monitor.go_on()?;
        Ok(candidate(data, &outcome, r, &outputs, gains))
    };
    let ranking = ranked.par_iter().map(candidate).collect::<Result<_>>()?;
    let next_experiment =
        experiment_design::next_experiment(data, &ranked, &outcome, (verdict, &remaining), weak, monitor)?;
    let mut data_quality = data_quality::findings(data, weak, &ruling.ties, ruling.refuted);
    data_quality.extend(ruling.few_currents);
    let [r_s, psi_m] = [BaseParameter::RS, BaseParameter::PsiM].map(|p| best.fitted.own()[p.index()]);
    data_quality.extend(data.runs().iter().find_map(|run| run.signals.of_clock(r_s, psi_m)));
    data_quality.extend(nameplate::contradicts(data, &base));
    data_quality.extend(stated_load::may_be_off(data, &ruling.asymmetric_friction));
    data_quality.extend(data_quality::link_assumed(data, &best.fitted));
    data_quality.extend(ruling.contradiction.map(|c| c.finding));
    data_quality.splice(0..0, ruling.lack_of_fit);
    data_quality.extend(validation.and_then(|run| coverage::validates_the_motion_alone(data, run)));
    data_quality.extend(unpredicted);
    let step = |set: &Validated| {
        monitor.go_on()?;
        Ok(step(data, &set.fitted))
    };
    let path = outcome.path.par_iter().map(step).collect::<Result<_>>()?;
    // A residual on the validation run may be extrapolation beyond the recording.
    let extrapolated = validated.iter().filter(|(_, _, after)| {
        let more = verdict == Verdict::Unknown || !settled.effects().is_empty();
        !data.poor && more && verdict::largest_excess(after) > data.options.mismatch
    });
    data_quality.extend(extrapolated.filter_map(|(run, ..)| coverage::beyond(&data.signals, &run.signals)));
    Ok(Answer {
        schema: SCHEMA,
        verdict,
        data_quality,
        options: data.options,
        located,
        remaining,
        budget,
        reason,
        ranking,
        model: FoundModel {
            effects: outcome.order().iter().map(|e| e.id().to_string()).collect(),
            base,
            specification: Some(specified(data, settled)),
            covariance: Some(covariance),
            unmodelled: described.as_ref().map(|(_, unmodelled)| unmodelled.clone()),
        },
        path,
        cannot_see: power::cannot_see(&outcome),
        next_experiment,
        noise_floor: floors(data),
        fit,
        recording_kind: Some(data.signals.kind),
        recordings: per_recording::recordings(data, &traces.recording),
        traces,
    })
}

/// Takes those base parameters that are better known `beside` a map, as it does nothing that they do. Where no effect is named, what is missing
/// biases them without it. Beside effects all are those of one fit, as these depend on each other.
fn better_known(
    beside: &BTreeMap<String, Estimate>,
    base: &mut BTreeMap<String, Estimate>,
    covariance: &mut Covariance,
) {
    for parameter in BaseParameter::ALL {
        let (Some(mapped), Some(own)) = (beside.get(parameter.name()), base.get_mut(parameter.name())) else {
            continue;
        };
        let (Some(value), Some(error)) = (mapped.value, mapped.stderr) else { continue };
        if own.stderr.is_none_or(|own| error < own) {
            *own = mapped.clone();
            covariance.known_by_itself(parameter.name(), value, error);
        }
    }
}

/// A set with all that is needed to simulate it again.
fn specified(data: &Data, set: &Hypothesis) -> Specification {
    let signals = &data.leading().signals;
    let reading = Reading {
        electrical: data.has_electrical(),
        mechanical: data.has_mechanical(),
        stator_held: signals.stator_held,
        middle_of_steps: signals.middle_of_steps,
        voltages_drawn: signals.voltages_drawn,
        current_filter: signals.current_filter,
    };
    Specification { reading, ..Specification::of(&set.model, &set.parameters) }
}

/// A set with its values and what it leaves of each channel.
fn step(data: &Data, hypothesis: &Hypothesis) -> Step {
    let outputs = Outputs::new(data, hypothesis);
    let effects = hypothesis.effects();
    Step {
        effects: effects.iter().map(|e| e.id().to_string()).collect(),
        base: outputs.base(),
        parameters: effects.iter().map(|e| (e.id().to_string(), outputs.effect(*e))).collect(),
        rms: traces::residual_rms(data, hypothesis),
    }
}

fn candidate(
    data: &Data,
    outcome: &Outcome,
    ranked: &Ranked,
    model: &Outputs,
    (searched, predicted): (&Validated, Option<(f64, f64)>),
) -> Candidate {
    let info = ranked.effect.info();
    let in_model = outcome.best.fitted.effects().contains(&ranked.effect);
    let parameters = if in_model {
        model.effect(ranked.effect)
    } else {
        Outputs::new(data, &ranked.validated.fitted).effect(ranked.effect)
    };
    let compared = || {
        let alike = if ranked.validated.held_out.is_empty() {
            |set: &Validated| verdict::excess(&set.fitted)
        } else {
            Validated::held_out_squares
        };
        (alike(searched), alike(&ranked.validated))
    };
    let (before, after) = predicted.filter(|_| in_model).unwrap_or_else(compared);
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
