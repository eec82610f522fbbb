//! The verdict of a selected set, with rivals and posterior probabilities, and that of the effects named beside a discrepancy.

use super::answer::Verdict;
use super::select::{Outcome, Swap};
use super::unmodelled::{Alternative, Supported};
use super::verdict::Validated;
use crate::effects::EffectId;

/// Largest logarithm of a set's weight over that of the best one. It only keeps the exponential finite: such odds are certain.
const LARGEST_LOG_WEIGHT: f64 = 50.0;
/// Probability of an effect whose set has as much evidence as the dq-model, where neither is named. Below it the effect is only told as not
/// excluded; by definition one in five.
const AS_GOOD_AS_NONE: f64 = 0.2;
/// Candidates less probable than this are not listed.
const LEAST_LISTED: f64 = 0.001;

/// A candidate with its posterior probability.
#[derive(Debug, Clone)]
pub struct Ranked {
    /// The effect.
    pub effect: EffectId,
    /// Its probability.
    pub probability: f64,
    /// Effects that cannot be told from it here.
    pub equivalent: Vec<EffectId>,
    /// The model in which it stands.
    pub validated: Validated,
}

/// Verdict and candidates, those of the model first, then by probability.
///
/// The posterior of an effect is the sum over the sets that hold it, each weighed by exp(−cost): the best set, those without one of its
/// effects, and those with another in its place.
pub fn decide(outcome: &Outcome, poor: bool) -> (Verdict, Vec<Ranked>) {
    let effects = outcome.order();
    let options = outcome.evidence.options();
    let known = if outcome.best.refuted { options.ceiling_unknown } else { 1.0 - options.unknown };
    let least = outcome.evidence.cost(&outcome.best);
    let weight =
        |validated: &Validated| (least - outcome.evidence.cost(validated)).min(LARGEST_LOG_WEIGHT).exp();
    // What holds an effect as a special case and explains no more says the same of it.
    let says_the_same = |s: &&Swap| {
        let holds = s.by.is_some_and(|by| by.contains(s.replaced));
        holds && outcome.evidence.cost(&s.validated) >= least
    };
    let rivals: Vec<&Swap> = outcome.swaps.iter().filter(|s| !says_the_same(s)).collect();
    let total = 1.0 + rivals.iter().map(|s| weight(&s.validated)).sum::<f64>();
    let mut ranked: Vec<Ranked> = Vec::new();
    for &effect in &effects {
        let others = || rivals.iter().copied().filter(|s| s.replaced == effect);
        let without: f64 = others().map(|s| weight(&s.validated)).sum();
        let close = |s: &&Swap| outcome.evidence.cost(&s.validated) < least + options.decisive;
        let equivalent = others().filter(close).filter_map(|s| s.by).collect();
        let probability = known * (1.0 - without / total);
        ranked.push(Ranked { effect, probability, equivalent, validated: outcome.best.clone() });
    }
    for swap in &rivals {
        let Some(rival) = swap.by.filter(|by| !effects.contains(by)) else { continue };
        let probability = known * weight(&swap.validated) / total;
        match ranked.iter_mut().find(|r| r.effect == rival) {
            Some(known) => known.probability += probability,
            None if probability > LEAST_LISTED => {
                let validated = swap.validated.clone();
                ranked.push(Ranked { effect: rival, probability, equivalent: Vec::new(), validated });
            }
            None => {}
        }
    }
    if effects.is_empty() {
        ranked = unlikely(outcome);
    }
    let verdict = if effects.is_empty() {
        let elsewhere = outcome.base.held_out_excess() > options.mismatch_held_out;
        if outcome.base.excess() > options.mismatch || elsewhere {
            Verdict::Unknown
        } else {
            Verdict::NoMismatch
        }
    } else if poor || ranked.iter().any(|r| effects.contains(&r.effect) && !r.equivalent.is_empty()) {
        // A poor recording cannot tell physics outside the catalogue from physics within.
        Verdict::Ambiguous
    } else {
        Verdict::Named
    };
    order(&mut ranked, &effects);
    (verdict, ranked)
}

/// The verdict where a set has more than noise left: the effects that explain what a map cannot are named beside it, and make up the set
/// from then on.
pub fn beside_discrepancy(outcome: &mut Outcome, ranked: &mut Vec<Ranked>, supported: Supported) -> Verdict {
    let options = *outcome.evidence.options();
    let kept = supported.set.effects();
    if kept.is_empty() {
        doubt(ranked, options.ceiling_unknown);
        return Verdict::Unknown;
    }
    let set = Validated { fitted: supported.set, held_out: Vec::new(), refuted: false };
    for &effect in &kept {
        if ranked.iter().all(|candidate| candidate.effect != effect) {
            ranked.push(Ranked { effect, probability: 0.0, equivalent: Vec::new(), validated: set.clone() });
        }
    }
    for candidate in ranked.iter_mut() {
        match supported.probabilities.iter().find(|(effect, _)| *effect == candidate.effect) {
            Some((_, probability)) => {
                candidate.probability = (1.0 - options.unknown) * probability;
                candidate.validated = set.clone();
            }
            None => candidate.probability = candidate.probability.min(options.ceiling_unknown),
        }
    }
    // What a smooth curve adds to its special case, a smooth term describes as well.
    for candidate in ranked.iter_mut().filter(|candidate| kept.contains(&candidate.effect)) {
        let effect = candidate.effect;
        candidate.equivalent.retain(|by| !(by.is_smooth() && by.contains(effect)));
    }
    for Alternative { present, absent, share } in supported.alternatives {
        let of_both = ranked.iter().find(|c| c.effect == present).map_or(0.0, |c| c.probability);
        // A decisively less probable alternative is not equivalent.
        let close = (1.0 / share - 1.0).ln() < options.decisive;
        for candidate in ranked.iter_mut() {
            if candidate.effect == absent {
                candidate.probability = of_both * share;
            } else if candidate.effect == present {
                candidate.probability = of_both * (1.0 - share);
                candidate.equivalent.extend(close.then_some(absent));
            }
        }
    }
    ranked.sort_by_key(|candidate| !kept.contains(&candidate.effect));
    let sure = |c: &Ranked| c.equivalent.is_empty() && c.probability >= options.named;
    let mut of_set = ranked.iter().filter(|candidate| kept.contains(&candidate.effect));
    let verdict = if of_set.all(sure) { Verdict::Partial } else { Verdict::Ambiguous };
    if verdict == Verdict::Ambiguous {
        // A name that is certain stays so, although another one is in doubt.
        for candidate in ranked.iter_mut().filter(|c| !sure(c)) {
            candidate.probability = candidate.probability.min(options.ceiling_doubtful);
        }
    }
    let goes = |step: &Validated| step.fitted.effects().iter().all(|e| kept.contains(e));
    outcome.path.retain(|step| goes(step) && step.fitted.effects().len() < kept.len());
    outcome.path.push(set.clone());
    outcome.best = set;
    verdict
}

/// Limits all probabilities to the `ceiling`.
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

/// The first effects that were refitted beside the dq-model, where none was worth being taken into the model.
fn unlikely(outcome: &Outcome) -> Vec<Ranked> {
    outcome
        .singles
        .iter()
        .filter_map(|(prospect, validated)| {
            let validated = validated.as_ref()?;
            let odds = (outcome.evidence.cost_on_recording(&outcome.base.fitted)
                - outcome.evidence.cost_on_recording(&validated.fitted))
            .min(0.0)
            .exp();
            let probability = AS_GOOD_AS_NONE * odds;
            (probability > LEAST_LISTED).then(|| Ranked {
                effect: prospect.effect,
                probability,
                equivalent: Vec::new(),
                validated: validated.clone(),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::evidence::Evidence;
    use super::super::hypothesis::Hypothesis;
    use super::super::options::DiagnosisOptions;
    use super::super::select::Swap;
    use super::*;
    use crate::effects::testing::CX;
    use crate::experiment::Channel;
    use crate::model::Model;

    /// A set of effects that leaves this mean square of the speed.
    fn validated(effects: &[EffectId], square: f64) -> Validated {
        let mut fitted = Hypothesis::unfitted(Model::new(CX, effects), Vec::new());
        (fitted.squares, fitted.samples) = (vec![(Channel::OmegaE, square)], vec![200.0]);
        fitted.chance = vec![0.0];
        Validated { fitted, held_out: Vec::new(), refuted: false }
    }

    fn outcome(base: Validated, best: Validated, swaps: Vec<Swap>) -> Outcome {
        let mut path = vec![base.clone()];
        path.extend((!best.fitted.effects().is_empty()).then(|| best.clone()));
        let evidence = Evidence::counting(vec![50.0], vec![vec![50.0]]);
        let (singles, unidentifiable, shown) = (Vec::new(), Vec::new(), Vec::new());
        Outcome { base, singles, best, swaps, unidentifiable, shown, evidence, path }
    }

    #[test]
    fn a_name_that_the_validation_run_refutes_is_unlikely_even_without_a_rival() {
        let probability = |refuted: bool| {
            let (base, mut best) = (validated(&[], 9.0), validated(&[EffectId::CurrentGainImbalance], 1.0));
            best.refuted = refuted;
            let (verdict, ranked) = decide(&outcome(base, best, Vec::new()), true);
            assert_eq!((verdict, ranked.len()), (Verdict::Ambiguous, 1));
            ranked[0].probability
        };
        assert!(probability(false) > 0.9 && probability(true) <= DiagnosisOptions::default().ceiling_unknown);
    }

    #[test]
    fn the_posterior_of_all_sets_sums_to_what_is_not_kept_for_the_unknown() {
        let (dry, drag) = (EffectId::CoulombFriction, EffectId::QuadraticDrag);
        let told = |rival: f64, without: f64| {
            let swap = |by, validated| Swap { replaced: dry, by, validated };
            let swaps =
                vec![swap(None, validated(&[], without)), swap(Some(drag), validated(&[drag], rival))];
            let (verdict, ranked) =
                decide(&outcome(validated(&[], 9.0), validated(&[dry], 1.0), swaps), false);
            let probability =
                |e: EffectId| ranked.iter().find(|r| r.effect == e).map_or(0.0, |r| r.probability);
            (verdict, ranked[0].equivalent.clone(), probability(dry), probability(drag))
        };
        let (verdict, equivalent, dry_is, drag_is) = told(1.0, 9.0);
        assert_eq!((verdict, equivalent), (Verdict::Ambiguous, vec![drag]));
        assert!(
            (dry_is - drag_is).abs() < 1e-9
                && (dry_is + drag_is - (1.0 - DiagnosisOptions::default().unknown)).abs() < 1e-3
        );
        let (verdict, equivalent, dry_is, drag_is) = told(3.0, 9.0);
        assert_eq!((verdict, equivalent), (Verdict::Named, Vec::new()));
        assert!(
            (dry_is + drag_is - (1.0 - DiagnosisOptions::default().unknown)).abs() < 1e-3 && drag_is < 1e-6
        );
        // The set without the effect takes its share, too.
        let (.., dry_is, drag_is) = told(3.0, 1.4);
        let without = 1.0 - DiagnosisOptions::default().unknown - dry_is - drag_is;
        assert!(without > 0.001 && without < dry_is, "{dry_is} {drag_is}");
    }

    #[test]
    fn a_wider_effect_that_explains_no_more_is_no_rivalry() {
        let (dry, wide) = (EffectId::CoulombFriction, EffectId::PreslidingFriction);
        let told = |rival: f64| {
            let swap = |by, validated| Swap { replaced: dry, by, validated };
            let swaps = vec![swap(None, validated(&[], 9.0)), swap(Some(wide), validated(&[wide], rival))];
            let outcome = outcome(validated(&[], 9.0), validated(&[dry], 1.2), swaps);
            let (verdict, ranked) = decide(&outcome, false);
            (verdict, ranked.len(), ranked[0].probability)
        };
        let (verdict, listed, probability) = told(1.2);
        assert_eq!((verdict, listed), (Verdict::Named, 1));
        assert!((probability - (1.0 - DiagnosisOptions::default().unknown)).abs() < 1e-3);
        // One that explains more is one.
        let (verdict, listed, probability) = told(1.17);
        assert_eq!((verdict, listed), (Verdict::Ambiguous, 2));
        assert!(probability < 0.5);
    }

    #[test]
    fn a_special_case_beside_a_discrepancy_shares_its_probability_with_the_wider_effect() {
        let (dry, wide, other) =
            (EffectId::CoulombFriction, EffectId::StribeckFriction, EffectId::VoltageDelay);
        let told = |share: f64| {
            let mut outcome = outcome(validated(&[], 9.0), validated(&[wide, other], 3.0), Vec::new());
            let mut ranked = decide(&outcome, false).1;
            let supported = Supported {
                set: validated(&[dry, other], 3.0).fitted,
                probabilities: vec![(dry, 0.99), (other, 0.99)],
                alternatives: vec![Alternative { present: dry, absent: wide, share }],
                nearest: None,
            };
            let verdict = beside_discrepancy(&mut outcome, &mut ranked, supported);
            let of = |e: EffectId| ranked.iter().find(|r| r.effect == e).unwrap();
            let probabilities = [dry, wide, other].map(|e| of(e).probability);
            (verdict, probabilities, of(dry).equivalent.clone())
        };
        let (verdict, [dry_is, wide_is, other_is], equivalent) = told(0.01);
        assert_eq!((verdict, equivalent), (Verdict::Partial, Vec::new()));
        assert!(dry_is > 0.9 && wide_is < 0.02 && other_is > 0.9);
        // Another name in doubt says nothing of what is sure by itself.
        let (verdict, [dry_is, wide_is, other_is], equivalent) = told(0.4);
        assert_eq!((verdict, equivalent), (Verdict::Ambiguous, vec![wide]));
        assert!(dry_is <= 0.5 && wide_is > 0.3 && wide_is < dry_is && other_is > 0.9);
    }

    #[test]
    fn beside_a_discrepancy_a_smooth_curve_is_no_rival_of_its_special_case() {
        let dry = EffectId::CoulombFriction;
        let told = |wide: EffectId| {
            let swap = Swap { replaced: dry, by: Some(wide), validated: validated(&[wide], 2.99) };
            let mut outcome = outcome(validated(&[], 9.0), validated(&[dry], 3.0), vec![swap]);
            let mut ranked = decide(&outcome, false).1;
            assert_eq!(ranked[0].equivalent, [wide]);
            let set = validated(&[dry], 3.0).fitted;
            let probabilities = vec![(dry, 0.99)];
            let supported = Supported { set, probabilities, alternatives: Vec::new(), nearest: None };
            beside_discrepancy(&mut outcome, &mut ranked, supported)
        };
        assert_eq!(told(EffectId::ConcaveFriction), Verdict::Partial);
        // A curve with a jump or a hump at standstill is one.
        assert_eq!(told(EffectId::PreslidingFriction), Verdict::Ambiguous);
    }

    #[test]
    fn a_dq_model_at_the_noise_on_every_recording_is_no_mismatch() {
        let told = |here: f64, elsewhere: f64| {
            let mut base = validated(&[], here);
            base.held_out = vec![validated(&[], elsewhere).fitted];
            decide(&outcome(base.clone(), base, Vec::new()), false).0
        };
        assert_eq!(told(1.0, 1.0), Verdict::NoMismatch);
        assert_eq!(told(2.0, 1.0), Verdict::Unknown);
        assert_eq!(told(1.0, 3.0), Verdict::Unknown);
    }

    #[test]
    fn a_refinement_comes_first_unless_it_is_in_doubt() {
        let (coulomb, directional, swing) =
            (EffectId::CoulombFriction, EffectId::AsymmetricFriction, EffectId::TimeVaryingLoad);
        let told = |equivalent: Vec<EffectId>| {
            let candidate = |effect, probability, equivalent| Ranked {
                effect,
                probability,
                equivalent,
                validated: validated(&[], 1.0),
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
}
