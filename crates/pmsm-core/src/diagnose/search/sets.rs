//! Sets of effects beside each other: what a larger one takes away, and the way from one to the next.

use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::scale::Scale;
use crate::diagnose::verdict::{Judged, MISMATCH, MISMATCH_HELD_OUT, PROGRESS, UNEXPLAINED, beyond_chance};
use crate::effects::EffectId;

/// A set takes away at least this share of what the best smaller one leaves in some channel, or none is grown from it: of two things that
/// are missing, one shows without the other.
const FOOTHOLD: f64 = 0.1;

/// Beside other effects, one that scores less than this share of the worst channel's excess is not refitted, unless it is the best of its
/// site: it has to take away a good part of it to be taken up.
const LEAST_SHARE: f64 = 0.1;

/// None is grown from a set that leaves this many times what the best of its size leaves: hardly one more effect makes up for that. Less
/// is enough once a larger set that explains the recordings has been found.
const HOPELESS: f64 = 30.0;
const BEHIND: f64 = 2.0;

/// Whether larger sets can be grown from `larger`: it takes away a part of what `smaller`, the best with one effect less, leaves in some
/// channel of some recording.
pub(super) fn foothold(larger: &Judged, smaller: &Judged) -> bool {
    let all = |j: &Judged| -> Vec<f64> {
        let runs = std::iter::once(&j.fitted).chain(&j.held_out);
        runs.flat_map(|h| h.squares.iter().map(|(_, square)| *square)).collect()
    };
    let mut both = all(smaller).into_iter().zip(all(larger));
    both.any(|(before, after)| is_part(before, after))
}

/// Whether what is left of a mean square `before` is so much less `after` that a part of it is explained.
fn is_part(before: f64, after: f64) -> bool {
    before - after >= FOOTHOLD * before.max(1.0)
}

/// Whether `larger` takes away no such part of what the currents leave of `smaller`, in any channel of the fitted recordings.
pub(super) fn spares_currents(larger: &Hypothesis, smaller: &Hypothesis) -> bool {
    let mut both = smaller.squares.iter().zip(&larger.squares);
    !both.any(|((channel, before), (_, after))| channel.is_electrical() && is_part(*before, *after))
}

/// Score from which an effect is worth a refit beside those of `parent`; none without any.
pub(super) fn least_beside(parent: &Judged) -> f64 {
    let bare = parent.fitted.effects().is_empty();
    if bare { 0.0 } else { LEAST_SHARE * parent.excess() / (1.0 + parent.excess()) }
}

/// Whether a set leaves so much more than the `best` of its size that none is grown from it; `done` says that one which explains the
/// recordings has been found.
pub(super) fn hopeless(judged: &Judged, best: &Judged, done: bool) -> bool {
    judged.excess() > best.excess().max(MISMATCH) * if done { BEHIND } else { HOPELESS }
}

/// Whether the currents alone leave so much more than the `best` set of the same size that none is grown from what leaves it.
pub(super) fn hopeless_currents(fitted: &Hypothesis, best: &Judged) -> bool {
    currents_excess(fitted) > HOPELESS * best.excess().max(MISMATCH)
}

/// Whether the currents alone leave so much more than the `best` set as is hopeless once that explains the recordings.
pub(super) fn far_behind(fitted: &Hypothesis, best: &Judged) -> bool {
    currents_excess(fitted) > BEHIND * best.excess().max(MISMATCH)
}

/// Largest excess mean square of a current, beyond chance.
fn currents_excess(fitted: &Hypothesis) -> f64 {
    let beyond = fitted.squares.iter().zip(beyond_chance(fitted));
    let currents = beyond.filter(|((channel, _), _)| channel.is_electrical()).map(|(_, excess)| excess);
    currents.fold(0.0, f64::max)
}

/// Whether a set is the `best` of its size but for effects that contain those of that one, and so no better for what they have beyond
/// them: what grows from it grows from the best, too.
pub(super) fn widened(judged: &Judged, best: &Judged) -> bool {
    let (wide, narrow) = (judged.fitted.effects(), best.fitted.effects());
    let beyond = |own: &[EffectId], other: &[EffectId]| -> Vec<EffectId> {
        own.iter().copied().filter(|e| !other.contains(e)).collect()
    };
    let (wide, narrow) = (beyond(&wide, &narrow), beyond(&narrow, &wide));
    !wide.is_empty()
        && wide.len() == narrow.len()
        && wide.iter().all(|wide| narrow.iter().any(|narrow| wide.contains(*narrow)))
}

/// Mean square that `larger` takes away, in units of what `smaller` leaves in each channel, summed over the channels: what a score
/// promises.
pub(super) fn explained(smaller: &Hypothesis, larger: &Hypothesis) -> f64 {
    let both = smaller.squares.iter().zip(&larger.squares);
    both.map(|((_, before), (_, after))| (before - after) / before.max(1.0)).sum()
}

/// Whether nothing worth a further effect is left, seen against the bare machine.
pub(super) fn explains(judged: &Judged, base: &Judged) -> bool {
    judged.excess() < MISMATCH && judged.unexplained(base) <= 1.0
}

/// Whether `share` of what the floor's own error may be is left, and more.
pub(super) fn mismatched_by(judged: &Judged, share: f64) -> bool {
    judged.excess() > share * MISMATCH || judged.held_out_excess() > share * MISMATCH_HELD_OUT
}

/// Whether a set leaves no mismatch of the speed on any recording.
pub(super) fn moves_as_measured(judged: &Judged) -> bool {
    let moves = |h: &Hypothesis, mismatch: f64| {
        let mut beyond = h.squares.iter().zip(beyond_chance(h));
        beyond.all(|((channel, _), excess)| channel.is_electrical() || excess <= mismatch)
    };
    moves(&judged.fitted, MISMATCH) && judged.held_out.iter().all(|h| moves(h, MISMATCH_HELD_OUT))
}

/// Whether an unknown load steps on any recording.
pub(super) fn steps(judged: &Judged) -> bool {
    let all = std::iter::once(&judged.fitted).chain(&judged.held_out);
    all.flat_map(|h| &h.nuisances).any(|n| n.steps() > 0)
}

/// From the bare machine to the best set through the best subsets that were tried.
pub(super) fn path(base: &Judged, best: &Judged, seen: &[Judged], scale: &Scale) -> Vec<Judged> {
    let goal = best.fitted.effects();
    let mut path = vec![base.clone()];
    for size in 1..goal.len() {
        let sofar = path[path.len() - 1].fitted.effects();
        let step = seen
            .iter()
            .filter(|j| {
                let effects = j.fitted.effects();
                effects.len() == size
                    && effects.iter().all(|e| goal.contains(e))
                    && sofar.iter().all(|e| effects.contains(e))
            })
            .min_by(|a, b| scale.loss(a).total_cmp(&scale.loss(b)));
        path.extend(step.cloned());
    }
    if !goal.is_empty() {
        path.push(best.clone());
    }
    path
}

/// Hypotheses by loss, best first.
pub(super) fn sorted(hypotheses: &[Judged], scale: &Scale) -> Vec<Judged> {
    let mut sorted = hypotheses.to_vec();
    sorted.sort_by(|a, b| scale.loss(a).total_cmp(&scale.loss(b)));
    sorted
}

/// Whether a larger set takes away a good part of what the smaller one leaves.
pub(super) fn progress(larger: &Judged, smaller: &Judged) -> bool {
    smaller.fitted.effects().is_empty() || larger.all_squares() < PROGRESS * smaller.all_squares()
}

/// Whether a larger set takes away most of what the smaller one leaves on the recording, whatever it does to others.
pub(super) fn explains_more(larger: &Judged, smaller: &Judged) -> bool {
    larger.excess() < UNEXPLAINED.0 * smaller.excess()
}

/// Whether `set` is `parent` with `added`.
pub(super) fn same(set: &[EffectId], parent: &[EffectId], added: EffectId) -> bool {
    set.len() == parent.len() + 1 && set.contains(&added) && parent.iter().all(|e| set.contains(e))
}

/// Whether both hold the same effects.
pub(super) fn is_set(a: &[EffectId], b: &[EffectId]) -> bool {
    a.len() == b.len() && a.iter().all(|e| b.contains(e))
}

/// Puts a better fit of a set in the place of the one that was tried.
pub(super) fn replace(seen: &mut [Judged], better: &Judged) {
    let effects = better.fitted.effects();
    seen.iter_mut().filter(|j| is_set(&j.fitted.effects(), &effects)).for_each(|j| *j = better.clone());
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::BASE;
    use crate::effects::testing::CX;
    use crate::experiment::Channel;
    use crate::model::Model;

    /// A set that leaves these mean squares of i_q and ω_e on the recording and on a held-out one.
    fn leaving(recording: [f64; 2], held_out: [f64; 2]) -> Judged {
        let with = |[i_q, omega_e]: [f64; 2]| Hypothesis {
            squares: vec![(Channel::IQ, i_q), (Channel::OmegaE, omega_e)],
            ..Hypothesis::bare(Model::new(CX, &[]), vec![1.0; BASE])
        };
        Judged { fitted: with(recording), held_out: vec![with(held_out)], refuted: false }
    }

    #[test]
    fn a_set_grows_if_it_takes_a_part_away_anywhere() {
        let smaller = leaving([300.0, 5.0], [250.0, 7.0]);
        assert!(!foothold(&smaller, &smaller));
        assert!(!foothold(&leaving([299.0, 4.7], [260.0, 6.8]), &smaller));
        // The lesser of two mismatches, whatever the set does to the other channel.
        assert!(foothold(&leaving([310.0, 1.4], [250.0, 7.0]), &smaller));
        assert!(foothold(&leaving([300.0, 5.0], [250.0, 2.0]), &smaller));
        // What only wanders within the floor is none.
        assert!(!foothold(&leaving([1.0, 0.95], [1.0, 1.0]), &leaving([1.0, 1.03], [1.0, 1.0])));
        assert!(!foothold(&leaving([f64::NAN, 5.0], [250.0, 7.0]), &smaller));
    }

    #[test]
    fn currents_are_spared_by_what_takes_no_part_away_in_any_channel() {
        let of = |i_q: f64, omega_e: f64| leaving([i_q, omega_e], [1.0, 1.0]).fitted;
        assert!(
            spares_currents(&of(280.0, 1.0), &of(300.0, 9.0))
                && spares_currents(&of(320.0, 1.0), &of(300.0, 1.0))
        );
        assert!(!spares_currents(&of(260.0, 9.0), &of(300.0, 9.0)));
        // What only wanders within the floor is none.
        assert!(
            spares_currents(&of(0.4, 1.0), &of(0.45, 1.0)) && !spares_currents(&of(1.0, 1.0), &of(1.2, 1.0))
        );
    }

    #[test]
    fn a_part_of_what_is_missing_explains_more_whatever_it_does_elsewhere() {
        let of = |left: f64, elsewhere: f64| {
            let mut judged = leaving([left, 1.0], [elsewhere, 1.0]);
            judged.fitted.chance = vec![0.0; 2];
            judged
        };
        assert!(explains_more(&of(10.0, 245.0), &of(61.0, 70.0)));
        assert!(
            !explains_more(&of(45.0, 20.0), &of(61.0, 70.0)) && !explains_more(&of(1.0, 1.0), &of(1.0, 1.0))
        );
    }

    #[test]
    fn a_set_moves_as_measured_whatever_it_leaves_of_the_currents() {
        let chance = |judged: Judged| {
            let none = |h: Hypothesis| Hypothesis { chance: vec![0.0; 2], ..h };
            Judged {
                fitted: none(judged.fitted),
                held_out: judged.held_out.into_iter().map(none).collect(),
                ..judged
            }
        };
        assert!(moves_as_measured(&chance(leaving([90.0, 1.2], [80.0, 1.9]))));
        assert!(!moves_as_measured(&chance(leaving([1.0, 1.4], [1.0, 1.0]))));
        assert!(!moves_as_measured(&chance(leaving([1.0, 1.0], [1.0, 2.1]))));
        assert!(!moves_as_measured(&chance(leaving([1.0, f64::NAN], [1.0, 1.0]))));
    }

    #[test]
    fn a_wider_form_of_the_best_set_is_no_other_root() {
        let set = |effects: &[EffectId]| {
            let fitted = Hypothesis::bare(Model::new(CX, effects), Vec::new());
            Judged { fitted, held_out: Vec::new(), refuted: false }
        };
        let (coulomb, stribeck) = (EffectId::CoulombFriction, EffectId::StribeckFriction);
        assert!(widened(&set(&[stribeck]), &set(&[coulomb])));
        assert!(widened(&set(&[EffectId::DeadTime, stribeck]), &set(&[coulomb, EffectId::DeadTime])));
        for (set_of, best) in [
            (vec![coulomb], vec![stribeck]),
            (vec![coulomb], vec![coulomb]),
            (vec![EffectId::QuadraticDrag], vec![coulomb]),
            (vec![EffectId::IronLoss, stribeck], vec![coulomb, EffectId::DeadTime]),
        ] {
            assert!(!widened(&set(&set_of), &set(&best)), "{set_of:?} {best:?}");
        }
    }

    #[test]
    fn a_set_far_behind_the_best_is_hopeless_sooner_once_another_explains() {
        let chance = |judged: Judged| {
            let fitted = Hypothesis { chance: vec![0.0; 2], ..judged.fitted.clone() };
            Judged { fitted, ..judged }
        };
        let best = chance(leaving([5.0, 1.0], [5.0, 1.0]));
        for (left, hopeless_yet, hopeless_then) in
            [(5.0, false, false), (8.0, false, false), (12.0, false, true), (130.0, true, true)]
        {
            let judged = chance(leaving([left, 1.0], [left, 1.0]));
            assert_eq!(hopeless(&judged, &best, false), hopeless_yet, "{left}");
            assert_eq!(hopeless(&judged, &best, true), hopeless_then, "{left}");
        }
        // That of the motion says nothing of the currents.
        let far = chance(leaving([130.0, 1.0], [130.0, 1.0])).fitted;
        assert!(hopeless_currents(&far, &best));
        assert!(!hopeless_currents(&chance(leaving([12.0, 130.0], [12.0, 130.0])).fitted, &best));
        assert!(far_behind(&chance(leaving([12.0, 130.0], [12.0, 130.0])).fitted, &best));
        assert!(!far_behind(&chance(leaving([8.0, 130.0], [8.0, 130.0])).fitted, &best));
        // Below a mismatch nothing is far apart.
        let (little, none) = (leaving([1.5, 1.0], [1.0, 1.0]), leaving([1.0, 1.0], [1.0, 1.0]));
        assert!(!hopeless(&chance(little), &chance(none), true));
    }
}
