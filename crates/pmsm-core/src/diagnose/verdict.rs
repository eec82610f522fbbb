//! How fitted hypotheses are compared, and when an effect is named.
//!
//! Every channel counts by the logarithm of its mean square over the floor's, worth [`WORTH`] independent samples: far fewer than
//! the recording has, because what decides between hypotheses is the models' imperfection and the residual's colour,
//! not the sensors' noise. A recording that was not used for fitting counts like the one that was. One nat of this
//! measure is about half a per cent of the floor in one channel of both.

use super::hypothesis::Hypothesis;
use crate::experiment::Channel;

/// Independent samples that one channel is worth.
pub const WORTH: f64 = 200.0;
/// Price of one parameter, nats.
pub const PRICE: f64 = 0.5;
/// An effect must gain this many nats beyond its price.
pub const LEAST_GAIN: f64 = 3.0;
/// And this many on recordings that were not used for fitting.
pub const LEAST_HELD_OUT: f64 = 1.5;
/// A further effect must bring what is unexplained below this share of what it was.
pub const PROGRESS: f64 = 0.6;
/// Rivals within this many nats cannot be told apart.
pub const INDISTINGUISHABLE: f64 = 3.0;
/// What may remain of a channel's excess mean square: this share of it, and this much of the floor's.
pub const UNEXPLAINED: (f64, f64) = (0.12, 0.12);
/// The same on a recording that was not used for fitting.
pub const UNEXPLAINED_HELD_OUT: (f64, f64) = (0.25, 0.2);
/// Excess mean square from which a channel is called mismatched although nothing explains it.
pub const MISMATCH: f64 = 0.3;

/// A hypothesis with what it leaves on a recording that was not used for fitting.
#[derive(Debug, Clone)]
pub struct Judged {
    /// Fitted on the recording.
    pub fitted: Hypothesis,
    /// The same model on recordings that were not used for fitting.
    pub held_out: Vec<Hypothesis>,
}

impl Judged {
    /// Loss in nats; differences between hypotheses are log odds.
    pub fn loss(&self) -> f64 {
        let count = self.fitted.free.iter().filter(|k| **k < self.fitted.model.parameter_count()).count();
        let price = PRICE * (count + 2 * self.fitted.nuisance.steps()) as f64;
        let others: f64 = self.held_out.iter().map(misfit).sum();
        (misfit(&self.fitted) + others) / (1 + self.held_out.len()) as f64 + price
    }

    /// Misfit on the held-out recordings (on the recording where there are none), nats, without any price.
    pub fn held_out_misfit(&self) -> f64 {
        let others: f64 = self.held_out.iter().map(misfit).sum();
        if self.held_out.is_empty() { misfit(&self.fitted) } else { others / self.held_out.len() as f64 }
    }

    /// Excess mean squares on the held-out recordings (on the recording where there are none), summed over channels.
    pub fn held_out_squares(&self) -> f64 {
        let excess = |h: &Hypothesis| h.squares.iter().map(|(_, s)| (s - 1.0).max(0.0)).sum::<f64>();
        if self.held_out.is_empty() { excess(&self.fitted) } else { self.held_out.iter().map(excess).sum() }
    }

    /// Largest share of a channel's excess that `self` leaves of what `base` leaves, beyond the tolerance: at most one
    /// where everything is explained.
    pub fn unexplained(&self, base: &Judged) -> f64 {
        let on_recording = unexplained(&self.fitted, &base.fitted, UNEXPLAINED);
        self.held_out
            .iter()
            .zip(&base.held_out)
            .map(|(a, b)| unexplained(a, b, UNEXPLAINED_HELD_OUT))
            .fold(on_recording, f64::max)
    }

    /// Whether `self` is worth its parameters over `other`: on all recordings together, and not only on the fitted one.
    pub fn beats(&self, other: &Judged) -> bool {
        self.loss() < other.loss() - LEAST_GAIN && self.held_out_misfit() < other.held_out_misfit() - LEAST_HELD_OUT
    }

    /// Largest excess mean square of any channel on the recording.
    pub fn excess(&self) -> f64 {
        self.fitted.squares.iter().map(|(_, s)| s - 1.0).fold(0.0, f64::max)
    }
}

fn misfit(hypothesis: &Hypothesis) -> f64 {
    let sum: f64 = hypothesis.squares.iter().map(|(_, s)| log_square(*s)).sum();
    0.5 * WORTH * sum
}

/// Logarithm of a mean square; what falls below the floor is chance and earns nothing, what is not a number costs all.
fn log_square(square: f64) -> f64 {
    if square.is_finite() { square.max(0.9).ln() } else { 1e6 }
}

fn unexplained(hypothesis: &Hypothesis, base: &Hypothesis, (share, floor): (f64, f64)) -> f64 {
    let worst = |channel: Channel| {
        let allowed = share * (base.square(channel) - 1.0).max(0.0) + floor;
        (hypothesis.square(channel) - 1.0) / allowed
    };
    hypothesis.squares.iter().map(|(c, _)| worst(*c)).fold(0.0, f64::max)
}
