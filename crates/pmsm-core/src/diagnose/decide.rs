//! From the selected set to a verdict, with rivals and posterior probabilities.

use super::answer::Verdict;
use super::evidence::DECISIVE;
use super::select::Outcome;
use super::verdict::{Judged, MISMATCH, MISMATCH_HELD_OUT};
use crate::effects::EffectId;

/// Probability that is kept for physics outside the catalogue when a set reaches the noise.
pub const UNKNOWN: f64 = 0.02;
/// Highest probability of any name when the verdict is "unknown", or when the validation run refutes it.
pub const CEILING_UNKNOWN: f64 = 0.4;
/// Highest probability of any name by a poor recording whose model does not foresee the validation run: an even chance, as what fails may be
/// a parameter that the recording does not pin down, or the effect.
pub const CEILING_UNFORESEEN: f64 = 0.5;
/// Candidates less probable than this are not listed.
const LEAST_LISTED: f64 = 0.001;

/// A judged candidate.
#[derive(Debug, Clone)]
pub struct Ranked {
    /// The effect.
    pub effect: EffectId,
    /// Its probability.
    pub probability: f64,
    /// Effects that cannot be told from it here.
    pub equivalent: Vec<EffectId>,
    /// The model in which it stands.
    pub judged: Judged,
}

/// Verdict and candidates, those of the model first, then by probability.
///
/// The posterior of an effect is the sum over the sets that hold it, each weighed by exp(−cost): the best set, those without one of its
/// effects, and those with another in its place.
pub fn decide(outcome: &Outcome, poor: bool) -> (Verdict, Vec<Ranked>) {
    let effects = outcome.order();
    let known = if outcome.best.refuted { CEILING_UNKNOWN } else { 1.0 - UNKNOWN };
    let least = outcome.evidence.cost(&outcome.best);
    let weight = |judged: &Judged| (least - outcome.evidence.cost(judged)).min(50.0).exp();
    let total = 1.0 + outcome.swaps.iter().map(|s| weight(&s.judged)).sum::<f64>();
    let mut ranked: Vec<Ranked> = Vec::new();
    for &effect in &effects {
        let others = || outcome.swaps.iter().filter(|s| s.replaced == effect);
        let without: f64 = others().map(|s| weight(&s.judged)).sum();
        let close = |s: &&super::select::Swap| outcome.evidence.cost(&s.judged) < least + DECISIVE;
        let equivalent = others().filter(close).filter_map(|s| s.by).collect();
        let probability = known * (1.0 - without / total);
        ranked.push(Ranked { effect, probability, equivalent, judged: outcome.best.clone() });
    }
    for swap in &outcome.swaps {
        let Some(rival) = swap.by.filter(|by| !effects.contains(by)) else { continue };
        let probability = known * weight(&swap.judged) / total;
        match ranked.iter_mut().find(|r| r.effect == rival) {
            Some(known) => known.probability += probability,
            None if probability > LEAST_LISTED => {
                let judged = swap.judged.clone();
                ranked.push(Ranked { effect: rival, probability, equivalent: Vec::new(), judged });
            }
            None => {}
        }
    }
    if effects.is_empty() {
        ranked = unlikely(outcome);
    }
    let verdict = if effects.is_empty() {
        let elsewhere = outcome.base.held_out_excess() > MISMATCH_HELD_OUT;
        if outcome.base.excess() > MISMATCH || elsewhere { Verdict::Unknown } else { Verdict::NoMismatch }
    } else if poor || ranked.iter().any(|r| effects.contains(&r.effect) && !r.equivalent.is_empty()) {
        // A poor recording cannot tell physics outside the catalogue from physics within.
        Verdict::Ambiguous
    } else {
        Verdict::Named
    };
    order(&mut ranked, &effects);
    (verdict, ranked)
}

/// Nothing is more probable than that.
pub fn doubt(ranked: &mut [Ranked], ceiling: f64) {
    for candidate in ranked {
        candidate.probability = candidate.probability.min(ceiling);
    }
}

/// Candidates in the order in which they are told: the `effects` of the model as it took them up, then the others by probability.
fn order(ranked: &mut [Ranked], effects: &[EffectId]) {
    ranked.sort_by(|a, b| {
        // What refines another effect of the model comes before it, unless it is one of several that might; twice the position leaves
        // room for that.
        let place = |r: &Ranked| {
            let at = |id: &str| effects.iter().position(|e| e.id() == id);
            let own = at(r.effect.id()).map_or(usize::MAX, |k| 2 * k + 1);
            let certain = own != usize::MAX && r.equivalent.is_empty();
            r.effect.refines().and_then(at).filter(|_| certain).map_or(own, |k| (2 * k).min(own))
        };
        place(a).cmp(&place(b)).then(b.probability.total_cmp(&a.probability))
    });
}

/// The best singles where none was worth being taken into the model.
fn unlikely(outcome: &Outcome) -> Vec<Ranked> {
    outcome
        .singles
        .iter()
        .filter_map(|(prospect, judged)| {
            let judged = judged.as_ref()?;
            let odds = (outcome.evidence.cost_on_recording(&outcome.base.fitted)
                - outcome.evidence.cost_on_recording(&judged.fitted))
            .min(0.0)
            .exp();
            let probability = 0.2 * odds;
            (probability > LEAST_LISTED).then(|| Ranked {
                effect: prospect.effect,
                probability,
                equivalent: Vec::new(),
                judged: judged.clone(),
            })
        })
        .collect()
}
