//! The excess of a fitted hypothesis on the recordings: the comparisons by which it is a mismatch, an explanation or a refutation.

use super::hypothesis::Hypothesis;
use super::options::DiagnosisOptions;

/// A hypothesis with its validation on recordings that were not used for fitting.
#[derive(Debug, Clone)]
pub struct Validated {
    /// Fitted on the recording.
    pub fitted: Hypothesis,
    /// The same model on recordings that were not used for fitting.
    pub held_out: Vec<Hypothesis>,
    /// Whether it predicts another recording so much worse than the dq-model that it cannot be right.
    pub refuted: bool,
}

impl Validated {
    /// Excess mean squares on the held-out recordings (on the recording where there are none), summed over channels.
    pub fn held_out_squares(&self) -> f64 {
        if self.held_out.is_empty() { excess(&self.fitted) } else { self.held_out.iter().map(excess).sum() }
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

/// Whether the residual of a model exceeds that of the dq-model on a recording so far that it cannot be right.
pub fn refutes(model: &Hypothesis, bare: &Hypothesis, options: &DiagnosisOptions) -> bool {
    let (times, more) = (options.refuted_times, options.refuted_by);
    // Written with `<=`, so that a NaN refutes, too.
    !model.squares.iter().zip(&bare.squares).all(|((_, s), (_, bare))| *s <= times * bare + more)
}

/// Whether a channel of the voltage equations is mismatched.
pub fn mismatched_currents(hypothesis: &Hypothesis, options: &DiagnosisOptions) -> bool {
    let each = beyond_chance(hypothesis).zip(&hypothesis.squares);
    each.filter(|(_, (channel, _))| channel.is_electrical()).any(|(excess, _)| excess > options.mismatch)
}

/// Excess mean square of each channel, beyond chance.
pub fn beyond_chance(hypothesis: &Hypothesis) -> impl Iterator<Item = f64> {
    hypothesis.squares.iter().zip(&hypothesis.chance).map(|((_, s), chance)| s - 1.0 - chance)
}

#[cfg(test)]
mod tests {
    use super::super::testing::validated;
    use super::*;

    #[test]
    fn a_model_that_predicts_worse_than_the_dq_model_is_refuted() {
        let base = validated(60.0, 1.0, 60.0, 4);
        let refuted = |model: Validated| refutes(&model.fitted, &base.fitted, &DiagnosisOptions::default());
        assert!(refuted(validated(130.0, 1.0, 1.0, 5)));
        assert!(refuted(validated(f64::NAN, 1.0, 1.0, 5)));
        assert!(!refuted(validated(90.0, 2.5, 1.0, 5)));
    }
}
