//! The answer: what was found, where, what else it could be, and what it is worth.

use super::answer::{Answer, Candidate, FitTable, FoundModel, SCHEMA, Step, Traces, Verdict};
use super::budget::Ends;
use super::data::Data;
use super::decide::{self, Ranked};
use super::fitting;
use super::hypothesis::Hypothesis;
use super::outputs::Outputs;
use super::select::Outcome;
use super::transfer::transfer;
use super::unmodelled::Supported;
use super::verdict::Validated;
use super::{
    adequacy, attribution, budget, consistency, coverage, data_quality, experiment_design, identifiability,
    nameplate, per_recording, power, remaining, stated_load, traces, unmodelled, verdict,
};
use crate::effect::Site;
use crate::effects::EffectId;
use crate::error::Result;
use crate::machine::BaseParameter;
use crate::monitor::Monitor;
use crate::signals::Finding;
use crate::specification::{Reading, Specification};
use rayon::prelude::*;
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

fn floors(data: &Data) -> BTreeMap<String, f64> {
    data.floors.iter().map(|f| (f.channel.name().to_string(), f.total())).collect()
}

/// Writes the answer.
pub fn conclude(
    data: &Data,
    validation: Option<&Data>,
    mut outcome: Outcome,
    weak: &[String],
    monitor: &dyn Monitor,
) -> Result<Answer> {
    if data.poor && outcome.base.excess() <= data.options.mismatch {
        // On a poor recording a small gain of one effect is no evidence against the dq-model.
        outcome.names_nothing();
        let asked = identifiability::identifiable(data).0;
        let worth = outcome.evidence.samples();
        let traces = power::Traces::new(data, &outcome.base.fitted);
        outcome.shown = traces.survey(&asked, worth, true, monitor)?;
    }
    let (mut verdict, mut ranked) = decide::decide(&outcome, cannot_tell(data, &outcome.best.fitted));
    let refuted = outcome.best.refuted;
    if refuted {
        // It stays a candidate, but is no model to predict with.
        outcome.best = outcome.base.clone();
        outcome.path.truncate(1);
    }
    let last = outcome.path.len() - 1;
    outcome.path.par_iter_mut().try_for_each(|set| {
        monitor.go_on()?;
        set.fitted = final_estimate(data, &set.fitted, monitor)?;
        Ok(())
    })?;
    let (first, end) = (outcome.path[0].clone(), outcome.path[last].clone());
    // Rivals were compared by what they left to the search, which may have left samples out.
    let searched = std::mem::replace(&mut outcome.base, first);
    outcome.best = end;
    let contradiction = consistency::contradiction(data, &outcome.best.fitted, monitor)?;
    let mut reason = contradiction
        .as_ref()
        .filter(|c| c.concerns(&outcome.best.fitted.effects()))
        .map(|c| c.finding.reason());
    let ran_away = adequacy::lack_of_fit(data, &outcome.base.fitted);
    reason = ran_away.as_ref().map(Finding::reason).or(reason);
    if reason.is_some() {
        verdict = Verdict::Undetermined;
        decide::doubt(&mut ranked, data.options.ceiling_unknown);
    }
    if let Some(why) = data.signals.limits.coarse.as_ref().filter(|_| verdict == Verdict::NoMismatch) {
        // The motion is explained; the voltages were left out, so that `no_mismatch` would claim too much.
        (verdict, reason) = (Verdict::Undetermined, Some(why.reason()));
    }
    monitor.go_on()?;
    let own = Outputs::new(data, &outcome.best.fitted);
    if verdict == Verdict::Named && outcome.best.fitted.effects().iter().any(|e| own.moves_nothing(*e)) {
        verdict = Verdict::Unknown;
        decide::doubt(&mut ranked, data.options.ceiling_unknown);
    }
    // Steady points have no dynamics, and base parameters may replace an effect of any strength.
    let steady = data.is_steady();
    let ties = if steady { own.ties() } else { Vec::new() };
    let asymmetric = own.effect(EffectId::AsymmetricFriction);
    if verdict == Verdict::Named && ties.iter().any(|tie| tie.doubtful && !outcome.needs(tie.effect)) {
        verdict = Verdict::Ambiguous;
    }
    let on_validation =
        |fitted: &Hypothesis| validation.map(|run| Ok((run, transfer(run, fitted, monitor)?))).transpose();
    let (before, found) =
        rayon::join(|| on_validation(&outcome.base.fitted), || on_validation(&outcome.best.fitted));
    let (before, mut after): (Option<(&Data, Hypothesis)>, _) = (before?, found?);
    let predicted = after.as_ref().map(|(run, found)| (*run, found));
    let mut remaining = remaining::beside(data, &outcome.best.fitted, predicted);
    if data.poor && verdict == Verdict::Ambiguous && !remaining.is_empty() {
        // Beside another cause no name is sure, however much of the mismatch it explains.
        decide::doubt(&mut ranked, data.options.ceiling_doubtful);
    }
    // What a set leaves on the validation run, and of each equation.
    let left_by = |set: &Hypothesis| -> Result<_> {
        let after = on_validation(set)?;
        let predicted = after.as_ref().map(|(run, found)| (*run, found));
        let remaining = remaining::beside(data, set, predicted);
        Ok((after, remaining))
    };
    let found = !outcome.best.fitted.effects().is_empty() && !cannot_tell(data, &outcome.best.fitted);
    let open = match verdict {
        Verdict::Named | Verdict::Ambiguous => !remaining.is_empty(),
        _ => verdict == Verdict::Unknown,
    };
    if found && open {
        let mut supported = unmodelled::supported(data, validation, &outcome.best.fitted, monitor)?;
        supported.set = final_estimate(data, &supported.set, monitor)?;
        let nearest = supported.nearest.as_ref().map(|set| step(data, set));
        verdict = decide::beside_discrepancy(&mut outcome, &mut ranked, supported);
        if verdict != Verdict::Unknown {
            (after, remaining) = left_by(&outcome.best.fitted)?;
        }
        if let Some(motion) = remaining.iter_mut().find(|r| r.equation == "mechanical") {
            motion.set_nearest(nearest);
        }
    }
    if matches!(verdict, Verdict::Named | Verdict::Partial)
        && unmodelled::rival(data, validation, &outcome.best.fitted, monitor)?.is_some()
    {
        // Of the motion nothing is named; what acts in the voltage equations stays.
        let set = unmodelled::without_motion(data, &outcome.best.fitted, monitor)?;
        let known = |c: &&Ranked| set.effects().contains(&c.effect);
        let share = 1.0 - data.options.unknown;
        let probabilities =
            ranked.iter().filter(known).map(|c| (c.effect, (c.probability / share).min(1.0))).collect();
        verdict = decide::beside_discrepancy(
            &mut outcome,
            &mut ranked,
            Supported { set, probabilities, alternatives: Vec::new(), nearest: None },
        );
        if verdict != Verdict::Unknown {
            (after, remaining) = left_by(&outcome.best.fitted)?;
        }
    }
    if matches!(verdict, Verdict::Named | Verdict::Partial | Verdict::Ambiguous) {
        let outputs = Outputs::new(data, &outcome.best.fitted);
        let doubtful = |c: &&mut Ranked| {
            outcome.best.fitted.effects().contains(&c.effect) && outputs.may_be_absent(c.effect)
        };
        for candidate in ranked.iter_mut().filter(doubtful) {
            candidate.probability = candidate.probability.min(data.options.ceiling_doubtful);
            verdict = Verdict::Ambiguous;
        }
    }
    monitor.go_on()?;
    let located = attribution::located(data, validation, &outcome, verdict);
    if verdict == Verdict::Unknown {
        // No effect has enough evidence for a name: it stays a candidate, and is no part of the model.
        outcome.best = outcome.base.clone();
        outcome.path.truncate(1);
        after = before.clone();
    }
    let few = coverage::held_at_few_currents(data);
    if few.is_some() && verdict == Verdict::Unknown {
        // Any two parameters explain two levels of current.
        verdict = Verdict::Undetermined;
    }
    let best = &outcome.best;
    // Of the named effects, without the map that describes the rest.
    let predicted = before.as_ref().zip(after.as_ref()).filter(|_| verdict != Verdict::Unknown);
    let predicted =
        predicted.map(|((_, before), (_, after))| (verdict::excess(before), verdict::excess(after)));
    // A map describes what has no name, so that the model predicts.
    let described = match verdict {
        Verdict::Unknown | Verdict::Partial => {
            Some(unmodelled::explain(data, validation, &best.fitted, monitor)?)
        }
        _ => None,
    };
    if let Some((fitted, _)) = &described {
        after = on_validation(fitted)?;
    }
    let settled = described.as_ref().map_or(&best.fitted, |(fitted, _)| fitted);
    monitor.go_on()?;
    let told = Outputs::new(data, settled);
    let model_outputs = &told;
    let specification = specified(data, settled);
    let validated = before.zip(after).map(|((run, before), (_, after))| (run, before, after));
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
    let others = validated.iter().filter(|_| data.poor && !refuted);
    let limit = data.options.mismatch_held_out;
    let unpredicted: Vec<Finding> =
        others.filter_map(|(_, _, after)| data_quality::not_predicted(after, limit)).collect();
    if !unpredicted.is_empty() {
        decide::doubt(&mut ranked, data.options.ceiling_doubtful);
    }
    let gains = (&searched, predicted);
    let candidate = |r: &Ranked| {
        monitor.go_on()?;
        Ok(candidate(data, &outcome, r, model_outputs, gains))
    };
    let ranking = ranked.par_iter().map(candidate).collect::<Result<_>>()?;
    let next_experiment =
        experiment_design::next_experiment(data, &ranked, &outcome, (verdict, &remaining), weak, monitor)?;
    let mut data_quality = data_quality::findings(data, weak, &ties, refuted);
    data_quality.extend(few);
    let [r_s, psi_m] = [BaseParameter::RS, BaseParameter::PsiM].map(|p| best.fitted.own()[p.index()]);
    data_quality.extend(data.runs().iter().find_map(|run| run.signals.of_clock(r_s, psi_m)));
    data_quality.extend(nameplate::contradicts(data, &model_outputs.base()));
    data_quality.extend(stated_load::may_be_off(data, &asymmetric));
    data_quality.extend(contradiction.map(|c| c.finding));
    data_quality.splice(0..0, ran_away);
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
            base: model_outputs.base(),
            specification: Some(specification),
            covariance: Some(model_outputs.covariance()),
            unmodelled: described.map(|(_, unmodelled)| unmodelled),
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

/// A set with all that is needed to simulate it again.
fn specified(data: &Data, set: &Hypothesis) -> Specification {
    let signals = &data.leading().signals;
    let reading = Reading {
        electrical: data.has_electrical(),
        mechanical: data.has_mechanical(),
        stator_held: signals.stator_held,
        middle_of_steps: signals.middle_of_steps,
    };
    Specification { reading, ..Specification::of(&set.model, &set.parameters) }
}

/// The final estimate of a set, weighted by the colour of its residual. Where that fit no longer describes the recording, the weights are
/// left out: they assume a model without mismatch.
fn final_estimate(data: &Data, set: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let weighted = fitting::efficient(data, set, monitor)?;
    Ok(if adequacy::lack_of_fit(data, &weighted).is_none() { weighted } else { set.clone() })
}

/// Whether a recording is too poor to tell the effects of a set from physics outside the catalogue. That holds for electrical effects on a
/// poor recording, and for all effects at a single operating point.
fn cannot_tell(data: &Data, set: &Hypothesis) -> bool {
    let electrical = set.effects().iter().any(|e| e.info().site != Site::Mechanical);
    data.poor && (electrical || coverage::stays_at_one_point(&data.signals))
}

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
