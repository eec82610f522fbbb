//! From what the search found to a verdict, with rivals and probabilities.

use super::answer::Verdict;
use super::power::EVEN;
use super::scale::{self, INDISTINGUISHABLE, INDISTINGUISHABLE_POOR, NESTED_GAIN};
use super::search::Outcome;
use super::verdict::{Judged, MISMATCH, MISMATCH_HELD_OUT};
use crate::effects::EffectId;

/// Probability that is left for unknown physics when an effect explains everything, and what is added when it explains
/// just enough.
const UNKNOWN: (f64, f64) = (0.02, 0.4);
/// Highest probability of any name when the verdict is "unknown", or when the validation run refutes it.
pub const CEILING_UNKNOWN: f64 = 0.4;
/// Highest probability of any name by a poor recording whose model does not foresee the validation run: an even chance, as what fails may be
/// a parameter that the recording does not pin down, or the effect.
pub const CEILING_UNFORESEEN: f64 = 0.5;
/// A rival that is so many times as likely as the effect found cannot be kept from its name, whatever it has to do with it.
const AS_LIKELY: f64 = 0.75;
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
pub fn decide(outcome: &Outcome, poor: bool) -> (Verdict, Vec<Ranked>) {
    let effects = outcome.order();
    let left = outcome.best.unexplained(&outcome.base);
    let unexplained = left > 1.0 || outcome.only_together();
    let unknown = if unexplained || outcome.best.refuted {
        1.0 - CEILING_UNKNOWN / left.max(1.0)
    } else {
        UNKNOWN.0 + UNKNOWN.1 * left * left
    };
    let loss = |judged: &Judged| outcome.scale.loss(judged);
    let floor = loss(&outcome.best);
    let to_the_noise = outcome.best.excess() < MISMATCH;
    let mut ranked: Vec<Ranked> = Vec::new();
    for &effect in &effects {
        let rivals: Vec<(EffectId, &Judged)> = outcome
            .swaps
            .iter()
            .filter(|swap| swap.replaced == effect)
            .filter_map(|swap| Some((swap.by?, &swap.judged)))
            .collect();
        let removed =
            outcome.swaps.iter().find(|s| s.replaced == effect && s.by.is_none()).map(|s| &s.judged);
        let odds = |judged: &Judged| (floor - loss(judged)).min(50.0).exp();
        let none = odds(removed.unwrap_or(&outcome.base));
        let shown = |wide: EffectId| outcome.shown.iter().find(|s| s.effect == wide);
        // A rival that only generalises the effect competes with what its extra freedom deserves, not as another cause; unless that
        // freedom earned nothing and the recording would not have shown it in any of its forms. Where the model leaves more than noise,
        // it is what it leaves, and not the recording, that would hide it.
        let hidden = |wide: EffectId| {
            let earned = rivals.iter().any(|(e, j)| *e == wide && loss(j) < floor);
            let at_best = shown(wide).map(|s| s.at_best);
            at_best.filter(|power| to_the_noise && wide.contains(effect) && !earned && *power < EVEN)
        };
        // Or unless the recording asks for that freedom, only not by enough to be sure of what it stands for.
        let asked_for = |wide: EffectId, judged: &Judged| {
            to_the_noise && wide.contains(effect) && scale::asks_for(judged, &outcome.best)
        };
        // That freedom may be there all the same, as far as the recording would have missed it.
        let missed = |wide: EffectId| shown(wide).map_or(0.0, |s| 1.0 - s.power);
        let weight = |rival: EffectId, judged: &Judged| match hidden(rival) {
            Some(power) => 1.0 - power,
            None if asked_for(rival, judged) => 1.0,
            None if rival.contains(effect) => missed(rival).max((-NESTED_GAIN).exp()),
            None => 1.0,
        };
        let open = |rival: EffectId| outcome.open.contains(&(effect, rival));
        // What keeps up with the set where both are fitted to all runs is as likely at least.
        let against = |rival: EffectId, judged: &Judged| {
            let odds = weight(rival, judged) * odds(judged);
            if open(rival) { odds.max(1.0) } else { odds }
        };
        let sum = 1.0 + none + rivals.iter().map(|(e, j)| against(*e, j)).sum::<f64>();
        let share = (1.0 - unknown) / sum;
        let as_likely = |rival: EffectId, judged: &Judged| weight(rival, judged) * odds(judged) > AS_LIKELY;
        let near = if poor { INDISTINGUISHABLE_POOR } else { INDISTINGUISHABLE };
        let mut equivalent: Vec<EffectId> = rivals
            .iter()
            .filter(|(e, j)| !e.contains(effect) || asked_for(*e, j) || as_likely(*e, j))
            .filter(|(e, j)| loss(j) < floor + near || open(*e))
            .map(|(e, _)| *e)
            .collect();
        equivalent.extend(outcome.shown.iter().map(|s| s.effect).filter(|e| hidden(*e).is_some()));
        ranked.push(Ranked { effect, probability: share, equivalent, judged: outcome.best.clone() });
        for (rival, judged) in rivals.iter().copied() {
            let probability = share * against(rival, judged);
            let known = effects.contains(&rival) || ranked.iter().any(|r| r.effect == rival);
            if probability > LEAST_LISTED && !known {
                ranked.push(Ranked {
                    effect: rival,
                    probability,
                    equivalent: Vec::new(),
                    judged: judged.clone(),
                });
            }
        }
    }
    if effects.is_empty() {
        ranked = unlikely(outcome);
    }
    let verdict = if effects.is_empty() {
        let elsewhere = outcome.base.held_out_excess() > MISMATCH_HELD_OUT;
        if outcome.base.excess() > MISMATCH || elsewhere { Verdict::Unknown } else { Verdict::NoMismatch }
    } else if poor
        || ranked.iter().any(|r| effects.contains(&r.effect) && !r.equivalent.is_empty()) && !unexplained
    {
        // A poor recording cannot tell physics outside the catalogue from physics within.
        Verdict::Ambiguous
    } else if unexplained {
        Verdict::Unknown
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
            let left = judged.unexplained(&outcome.base).max(1.0);
            let odds = (outcome.scale.loss(&outcome.base) - outcome.scale.loss(judged)).min(0.0).exp();
            let probability = 0.2 * odds / left;
            (probability > LEAST_LISTED).then(|| Ranked {
                effect: prospect.effect,
                probability,
                equivalent: Vec::new(),
                judged: judged.clone(),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::hypothesis::Hypothesis;
    use super::super::power::Shown;
    use super::super::scale::Scale;
    use super::super::search::Swap;
    use super::*;
    use crate::effects::testing::CX;
    use crate::experiment::Channel;
    use crate::model::Model;

    /// A set of effects that leaves this mean square of the speed.
    fn judged(effects: &[EffectId], square: f64) -> Judged {
        let mut fitted = Hypothesis::bare(Model::new(CX, effects), Vec::new());
        (fitted.squares, fitted.samples) = (vec![(Channel::OmegaE, square)], vec![200.0]);
        fitted.chance = vec![0.0];
        Judged { fitted, held_out: Vec::new(), refuted: false }
    }

    fn outcome(base: Judged, best: Judged, swaps: Vec<Swap>, shown: Vec<Shown>) -> Outcome {
        let all = [&base, &best].into_iter().chain(swaps.iter().map(|s| &s.judged));
        let (scale, path) = (Scale::new(all), vec![base.clone(), best.clone()]);
        let open = Vec::new();
        Outcome { base, singles: Vec::new(), best, swaps, unfit: Vec::new(), shown, open, scale, path }
    }

    #[test]
    fn a_name_that_the_validation_run_refutes_is_unlikely_even_without_a_rival() {
        let probability = |refuted: bool| {
            let (base, mut best) = (judged(&[], 9.0), judged(&[EffectId::CurrentGainImbalance], 1.0));
            best.refuted = refuted;
            let (verdict, ranked) = decide(&outcome(base, best, Vec::new(), Vec::new()), true);
            assert_eq!((verdict, ranked.len()), (Verdict::Ambiguous, 1));
            ranked[0].probability
        };
        assert!(probability(false) > 0.9 && probability(true) <= CEILING_UNKNOWN);
    }

    #[test]
    fn a_rival_that_keeps_up_where_both_are_fitted_to_all_runs_is_left_open() {
        let (dry, drag) = (EffectId::CoulombFriction, EffectId::QuadraticDrag);
        let told = |open: Vec<(EffectId, EffectId)>| {
            let (base, best, rival) = (judged(&[], 9.0), judged(&[dry], 1.0), judged(&[drag], 3.0));
            let swap = Swap { replaced: dry, by: Some(drag), judged: rival };
            let outcome = Outcome { open, ..outcome(base, best, vec![swap], Vec::new()) };
            let (verdict, ranked) = decide(&outcome, false);
            (verdict, ranked[0].equivalent.clone(), ranked.iter().map(|r| r.probability).collect::<Vec<_>>())
        };
        let (verdict, equivalent, probabilities) = told(vec![(dry, drag)]);
        assert_eq!((verdict, equivalent), (Verdict::Ambiguous, vec![drag]));
        assert!((probabilities[0] / probabilities[1] - 1.0).abs() < 1e-12, "{probabilities:?}");
        assert_eq!(told(Vec::new()).0, Verdict::Named);
    }

    #[test]
    fn effects_none_of_which_shows_by_itself_are_not_named() {
        let (delay, short) = (EffectId::VoltageDelay, EffectId::InterTurnShort);
        let told = |first: f64| {
            let (base, alone, best) =
                (judged(&[], 7.0), judged(&[delay], first), judged(&[delay, short], 1.0));
            let path = vec![base.clone(), alone, best.clone()];
            let outcome = Outcome { path, ..outcome(base, best, Vec::new(), Vec::new()) };
            let (verdict, ranked) = decide(&outcome, false);
            (verdict, ranked.iter().all(|r| r.probability > CEILING_UNKNOWN))
        };
        assert_eq!(told(6.9), (Verdict::Unknown, false));
        assert_eq!(told(5.0), (Verdict::Named, true));
    }

    #[test]
    fn a_refinement_comes_first_unless_it_is_in_doubt() {
        let fitted = Hypothesis::bare(Model::new(CX, &[]), Vec::new());
        let judged = Judged { fitted, held_out: Vec::new(), refuted: false };
        let (coulomb, directional, swing) =
            (EffectId::CoulombFriction, EffectId::AsymmetricFriction, EffectId::TimeVaryingLoad);
        let told = |equivalent: Vec<EffectId>| {
            let candidate = |effect, probability, equivalent| Ranked {
                effect,
                probability,
                equivalent,
                judged: judged.clone(),
            };
            let mut ranked = vec![
                candidate(swing, 0.9, Vec::new()),
                candidate(coulomb, 0.75, Vec::new()),
                candidate(directional, 0.46, equivalent),
            ];
            order(&mut ranked, &[coulomb, directional]);
            ranked.iter().map(|r| r.effect).collect::<Vec<_>>()
        };
        assert_eq!(told(Vec::new()), [directional, coulomb, swing]);
        assert_eq!(told(vec![swing]), [coulomb, directional, swing]);
    }

    #[test]
    fn a_wider_effect_that_is_as_likely_as_the_one_found_is_listed_with_it() {
        let (coulomb, stribeck) = (EffectId::CoulombFriction, EffectId::StribeckFriction);
        let verdict = |missed: f64, left: f64| {
            let (base, best, wide) = (judged(&[], 3.0), judged(&[coulomb], 1.12), judged(&[stribeck], left));
            let swap = |by, judged: &Judged| Swap { replaced: coulomb, by, judged: judged.clone() };
            let shown = Shown {
                effect: stribeck,
                power: 1.0 - missed,
                at_best: 1.0,
                size: (1.0, 1.0),
                least: 1.0,
                channel: Channel::OmegaE,
                absorbed_by: Vec::new(),
                likeness: Vec::new(),
            };
            let swaps = vec![swap(None, &base), swap(Some(stribeck), &wide)];
            let outcome = outcome(base, best, swaps, vec![shown]);
            let (verdict, ranked) = decide(&outcome, false);
            (verdict, ranked[0].equivalent.clone(), ranked[0].probability)
        };
        let (said, equivalent, probability) = verdict(0.5, 1.055);
        assert_eq!((said, equivalent), (Verdict::Ambiguous, vec![stribeck]));
        assert!(probability < 0.1, "{probability}");
        // Neither fits better, and of one that is there the recording would have missed nine of ten, or a half.
        assert_eq!(verdict(0.9, 1.12).0, Verdict::Ambiguous);
        assert_eq!(verdict(0.5, 1.12).0, Verdict::Named);
        let (said, equivalent, probability) = verdict(1e-3, 1.055);
        assert_eq!((said, equivalent), (Verdict::Named, Vec::new()));
        assert!(probability > 0.5, "{probability}");
    }
}
