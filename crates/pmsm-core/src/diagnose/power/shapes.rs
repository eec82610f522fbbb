//! Some shapes of an absent effect, looked at together, and what all looks at it come to.

use super::Survey;
use crate::effects::EffectId;
use nalgebra::DVector;

/// The strengths of an effect.
pub(super) struct Strengths {
    /// Their typical values.
    pub(super) typical: DVector<f64>,
    /// Their physical bounds.
    pub(super) bounds: Vec<(f64, f64)>,
    /// Share of them that is expected beside what was found.
    pub(super) share: f64,
}

/// The shape that shows most.
pub(super) struct Strongest {
    /// Number of the channel, recording by recording.
    pub(super) at: usize,
    /// Mean square that a typical strength adds there, before and after the fitted parameters absorb what they can.
    pub(super) before: f64,
    pub(super) after: f64,
    /// What it adds to the residual, as far as it lies in the basis of what the fitted parameters can do.
    pub(super) along: DVector<f64>,
}

/// What shapes of one effect show, in their order.
pub(super) struct Look {
    /// The power of each, at the share of the strength that is expected.
    pub(super) powers: Vec<f64>,
    /// The largest at full strength.
    pub(super) at_best: f64,
    /// Root mean square of the one that shows least.
    pub(super) least: f64,
    /// The one that shows most, if any shows anything.
    pub(super) strongest: Option<Strongest>,
    /// For each found effect: the cosine of the one that resembles it most, and by how many nats it would still lose.
    pub(super) likeness: Vec<(f64, f64)>,
}

impl Look {
    /// Before anything was looked at, beside so many `found` effects.
    pub(super) fn nothing(found: usize) -> Self {
        let (powers, likeness) = (Vec::new(), vec![(0.0, f64::INFINITY); found]);
        Self { powers, at_best: 0.0, least: f64::INFINITY, strongest: None, likeness }
    }

    /// This look and the `next` one.
    pub(super) fn and(mut self, next: Self) -> Self {
        self.powers.extend(next.powers);
        self.at_best = self.at_best.max(next.at_best);
        self.least = self.least.min(next.least);
        let more =
            |old: &Option<Strongest>, new: &Strongest| old.as_ref().is_none_or(|o| new.after > o.after);
        if next.strongest.as_ref().is_some_and(|new| more(&self.strongest, new)) {
            self.strongest = next.strongest;
        }
        for (best, new) in self.likeness.iter_mut().zip(next.likeness) {
            if new.0 > best.0 {
                *best = new;
            }
        }
        self
    }
}

impl Survey<'_> {
    /// What some `shapes` of an effect show; `None` if nothing is compared.
    pub(super) fn look(&self, effect: EffectId, strengths: &Strengths, shapes: &[Vec<f64>]) -> Option<Look> {
        let Strengths { typical, bounds, share } = strengths;
        let count = typical.len();
        let mut look = Look::nothing(self.found.len());
        let seen = self.scorer.sensitivity(effect, shapes);
        for products in self.known.beside(&seen, shapes.len(), count).into_iter().flatten() {
            let whole = products.others(typical);
            let (before, after) = (products.squares(&whole), products.squares(&products.freed(&whole)));
            let beside: Vec<f64> = after.iter().map(|square| share * share * square).collect();
            let most =
                |squares: &[f64]| (0..squares.len()).max_by(|a, b| squares[*a].total_cmp(&squares[*b]));
            let (largest, loudest) = (most(&after)?, most(&before)?);
            let at = if after[largest] > 0.01 * before[loudest] { largest } else { loudest };
            look = look.and(Look {
                powers: vec![self.power(&beside, count)],
                at_best: self.power(&after, count),
                least: after[at].sqrt(),
                strongest: Some(Strongest {
                    at,
                    before: before[at],
                    after: after[at],
                    along: products.along_basis(&whole),
                }),
                likeness: self.found.iter().map(|f| self.likeness(f, &products, bounds)).collect(),
            });
        }
        Some(look)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_come_to_the_same_in_whatever_parts_they_are_taken() {
        let look = |power: f64, after: f64, cosine: f64| Look {
            powers: vec![power],
            at_best: power,
            least: after.sqrt(),
            strongest: Some(Strongest { at: 0, before: 9.0, after, along: DVector::from_element(1, power) }),
            likeness: vec![(cosine, power)],
        };
        let all = || [look(0.1, 1.0, 0.5), look(0.3, 4.0, 0.9), look(0.2, 4.0, 0.9)].into_iter();
        let one_by_one = all().fold(Look::nothing(1), Look::and);
        let mut rest = all();
        let first = Look::nothing(1).and(rest.next().unwrap());
        let in_parts = first.and(rest.fold(Look::nothing(1), Look::and));
        for look in [one_by_one, in_parts] {
            assert_eq!((look.powers, look.at_best, look.least), (vec![0.1, 0.3, 0.2], 0.3, 1.0));
            // Of equals the first one stays.
            let strongest = look.strongest.unwrap();
            assert_eq!((strongest.after, strongest.along[0], look.likeness[0]), (4.0, 0.3, (0.9, 0.3)));
        }
    }
}
