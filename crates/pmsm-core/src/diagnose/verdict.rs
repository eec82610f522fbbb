//! What a fitted hypothesis leaves on the recordings, and when that is a mismatch, an explanation or a refutation.

use super::hypothesis::Hypothesis;
use crate::effect::Site;
use crate::experiment::Channel;

/// A further effect must bring the excess that is left below this share of what it was.
pub const PROGRESS: f64 = 0.6;
/// What may remain of a channel's excess mean square: this share of it, and this much of the floor's.
pub const UNEXPLAINED: (f64, f64) = (0.25, 0.12);
/// The same on a recording that was not used for fitting.
pub const UNEXPLAINED_HELD_OUT: (f64, f64) = (0.3, 0.2);
/// Share of the motion's excess that may remain, on any recording, where all effects are mechanical: friction and torques have exact
/// forms, and what they leave is another torque.
const UNEXPLAINED_MOTION: f64 = 0.15;
/// Of more effects than this together a smaller share may remain, by the square of their number: so many bend to much that they do not
/// cause.
const FEW: f64 = 2.0;
/// A mean square beyond this multiple of the bare machine's, and this much more, refutes a model.
const REFUTES: (f64, f64) = (2.0, 1.0);
/// Excess mean square from which a channel is called mismatched; below it nothing is looked for.
pub const MISMATCH: f64 = 0.3;
/// The same on a recording that was not used for fitting.
pub const MISMATCH_HELD_OUT: f64 = 1.0;

/// A hypothesis with what it leaves on a recording that was not used for fitting.
#[derive(Debug, Clone)]
pub struct Judged {
    /// Fitted on the recording.
    pub fitted: Hypothesis,
    /// The same model on recordings that were not used for fitting.
    pub held_out: Vec<Hypothesis>,
    /// Whether it predicts another recording so much worse than the bare machine that, as it is, it cannot be right.
    pub refuted: bool,
}

impl Judged {
    /// Excess mean squares on the held-out recordings (on the recording where there are none), summed over channels.
    pub fn held_out_squares(&self) -> f64 {
        if self.held_out.is_empty() { excess(&self.fitted) } else { self.held_out.iter().map(excess).sum() }
    }

    /// Excess mean squares on all recordings, summed over channels.
    pub fn all_squares(&self) -> f64 {
        excess(&self.fitted) + self.held_out.iter().map(excess).sum::<f64>()
    }

    /// Largest share of a channel's excess that `self` leaves of what `base` leaves, beyond the tolerance: at most one
    /// where everything is explained.
    pub fn unexplained(&self, base: &Judged) -> f64 {
        let effects = self.fitted.effects();
        let mechanical = !effects.is_empty() && effects.iter().all(|e| e.info().site == Site::Mechanical);
        let strict = (FEW / (effects.len() as f64).max(FEW)).powi(2);
        let unexplained = |model: &Hypothesis, base: &Hypothesis, (share, floor): (f64, f64)| {
            let mut worst = 0.0f64;
            for (at, (channel, left)) in model.squares.iter().enumerate() {
                if mechanical && channel.is_electrical() && base.squares[at].1 <= 1.0 + MISMATCH {
                    // Friction has nothing to explain there, and there is nothing to be looked for.
                    continue;
                }
                let exact = mechanical && *channel == Channel::OmegaE;
                let share = strict * if exact { share.min(UNEXPLAINED_MOTION) } else { share };
                let allowed = share * (base.squares[at].1 - 1.0).max(0.0) + floor + model.chance[at];
                worst = worst.max((left - 1.0) / allowed);
            }
            worst
        };
        let on_recording = unexplained(&self.fitted, &base.fitted, UNEXPLAINED);
        self.held_out
            .iter()
            .zip(&base.held_out)
            .map(|(a, b)| unexplained(a, b, UNEXPLAINED_HELD_OUT))
            .fold(on_recording, f64::max)
    }

    /// Largest excess mean square of any channel on the held-out recordings, beyond chance; zero without any.
    pub fn held_out_excess(&self) -> f64 {
        self.held_out.iter().map(largest_excess).fold(0.0, f64::max)
    }

    /// Largest excess mean square of any channel on the recording, beyond chance.
    pub fn excess(&self) -> f64 {
        largest_excess(&self.fitted)
    }
}

/// Largest excess mean square of any channel, beyond chance.
pub fn largest_excess(hypothesis: &Hypothesis) -> f64 {
    beyond_chance(hypothesis).fold(0.0, f64::max)
}

/// Excess mean squares, summed over channels.
pub fn excess(hypothesis: &Hypothesis) -> f64 {
    hypothesis.squares.iter().map(|(_, s)| (s - 1.0).max(0.0)).sum()
}

/// Whether a model leaves so much more than the bare machine on a recording that it cannot be right.
pub fn refutes(model: &Hypothesis, bare: &Hypothesis) -> bool {
    let (times, more) = REFUTES;
    // Not "greater": what is not a number refutes, too.
    !model.squares.iter().zip(&bare.squares).all(|((_, s), (_, bare))| *s <= times * bare + more)
}

/// Excess mean square of each channel, beyond chance.
pub fn beyond_chance(hypothesis: &Hypothesis) -> impl Iterator<Item = f64> {
    hypothesis.squares.iter().zip(&hypothesis.chance).map(|((_, s), chance)| s - 1.0 - chance)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{hypothesis, judged};
    use super::*;
    use crate::effects::EffectId;
    use crate::model::Model;

    #[test]
    fn a_weak_channel_must_be_explained_as_well_as_a_strong_one() {
        let base = judged(60.0, 4.0, 60.0, 4);
        assert!(judged(1.0, 4.0, 1.0, 5).unexplained(&base) > 1.0);
        assert!(judged(1.0, 1.1, 1.0, 5).unexplained(&base) <= 1.0);
        // 0.2 of the excess.
        assert!(judged(1.0, 1.6, 1.0, 5).unexplained(&base) <= 1.0);
    }

    #[test]
    fn friction_must_explain_the_motion_better_than_a_saturation_does() {
        let base = judged(1.0, 20.0, 1.0, 4);
        let with = |effect: EffectId| {
            let mut model = judged(1.0, 5.0, 1.0, 6);
            model.fitted.model = Model::new(*model.fitted.model.context(), &[effect]);
            model.unexplained(&base)
        };
        assert!(with(EffectId::SaturationQ) <= 1.0 && with(EffectId::CoulombFriction) > 1.0);
    }

    #[test]
    fn friction_need_not_explain_what_is_no_mismatch_of_the_currents() {
        let with = |effect: EffectId, currents: f64| {
            let base = judged(currents, 20.0, currents, 4);
            let mut model = judged(currents, 1.0, currents, 5);
            model.fitted.model = Model::new(*model.fitted.model.context(), &[effect]);
            model.held_out = vec![hypothesis(currents, 1.0, 5)];
            model.unexplained(&base)
        };
        let faint = 1.0 + 0.9 * MISMATCH;
        assert!(with(EffectId::QuadraticDrag, faint) <= 1.0 && with(EffectId::SaturationQ, faint) > 1.0);
        assert!(with(EffectId::QuadraticDrag, 1.0 + 2.0 * MISMATCH) > 1.0);
    }

    #[test]
    fn many_effects_must_leave_less() {
        let base = judged(60.0, 1.0, 60.0, 4);
        let mut model = judged(13.0, 1.0, 13.0, 9);
        assert!(model.unexplained(&base) <= 1.0);
        let context = *model.fitted.model.context();
        model.fitted.model =
            Model::new(context, &[EffectId::CoulombFriction, EffectId::CoggingTorque, EffectId::DeadTime]);
        assert!(model.unexplained(&base) > 1.0);
    }

    #[test]
    fn a_model_that_predicts_worse_than_the_bare_machine_is_refuted() {
        let base = judged(60.0, 1.0, 60.0, 4);
        assert!(refutes(&judged(130.0, 1.0, 1.0, 5).fitted, &base.fitted));
        assert!(refutes(&judged(f64::NAN, 1.0, 1.0, 5).fitted, &base.fitted));
        assert!(!refutes(&judged(90.0, 2.5, 1.0, 5).fitted, &base.fitted));
    }
}
