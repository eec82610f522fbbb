//! How fitted hypotheses are compared: what each leaves counts in nats, and each parameter has its price.
//!
//! Every channel counts by the logarithm of its mean square over the floor's, times half the number of independent samples
//! behind it. That number is taken from how the energy of the best model's residual varies from block to block, and never
//! above [`MOST_WORTH`]: what decides between hypotheses on a good log is the models' imperfection, not the sensors'
//! noise. Recordings that were not used for fitting count like the one that was. On a good log one nat is about
//! half a per cent of the floor in one channel.

use super::hypothesis::Hypothesis;
use super::verdict::{Judged, MISMATCH};
use crate::simulate::mechanical::Nuisance;

/// Most independent samples that one channel is worth.
pub const MOST_WORTH: f64 = 200.0;
/// Fewest independent samples that one channel is worth.
const LEAST_WORTH: f64 = 10.0;
/// Price of one parameter, nats.
pub const PRICE: f64 = 0.5;
/// Price of one step of an unknown load on any recording: its instant and height, and that it may come whenever it likes.
const STEP_PRICE: f64 = 4.0;
/// An effect must gain this many nats beyond its price.
pub const LEAST_GAIN: f64 = 3.0;
/// An effect that contains a simpler one as a special case must gain this many over it: its further parameters bend to whatever
/// is left at the same place.
pub const NESTED_GAIN: f64 = 7.0;
/// Nats, with every independent sample at its full worth, beyond which the recordings themselves ask for the further parameters, if
/// the model otherwise reaches the noise.
const ASKED_FOR: f64 = 50.0;
/// Mean square, in units of the floor's, that the special case must leave more of in some channel for that: the floors are not known
/// better.
const FLOOR_ERROR: f64 = 0.015;
/// An effect must also gain this many nats on recordings that were not used for fitting.
pub const LEAST_HELD_OUT: f64 = 1.5;
/// What loses by this many nats is no rival, whatever its parameters cost and the load behind it.
const LOST: f64 = 30.0;
/// Rivals within this many nats cannot be told apart.
pub const INDISTINGUISHABLE: f64 = 3.0;
/// The same on a recording that does not pin the base parameters down, so that they lean on the nameplate.
pub const INDISTINGUISHABLE_POOR: f64 = 12.0;

/// What each channel's evidence is worth, on the fitted and on the held-out recordings.
#[derive(Debug, Clone)]
pub struct Scale {
    fitted: Vec<f64>,
    held_out: Vec<Vec<f64>>,
}

impl Scale {
    /// From the whitest residual that any of the hypotheses leaves in each channel.
    pub fn new<'a>(hypotheses: impl Iterator<Item = &'a Judged> + Clone) -> Self {
        let widest = |pick: &dyn Fn(&Judged) -> Option<Vec<f64>>| -> Vec<f64> {
            let mut most: Vec<f64> = Vec::new();
            for samples in hypotheses.clone().filter_map(pick) {
                most.resize(samples.len(), LEAST_WORTH);
                for (m, s) in most.iter_mut().zip(samples) {
                    *m = m.max(s.min(MOST_WORTH));
                }
            }
            most
        };
        let count = hypotheses.clone().map(|j| j.held_out.len()).max().unwrap_or(0);
        Self {
            fitted: widest(&|j| Some(j.fitted.samples.clone())),
            held_out: (0..count).map(|k| widest(&|j| j.held_out.get(k).map(|h| h.samples.clone()))).collect(),
        }
    }

    /// Independent samples that each channel of the fitted recording is worth.
    pub fn worth(&self) -> &[f64] {
        &self.fitted
    }

    /// Loss of a hypothesis in nats; differences are log odds.
    pub fn loss(&self, judged: &Judged) -> f64 {
        let fitted = &judged.fitted;
        let count = fitted.free.iter().filter(|k| **k < fitted.model.parameter_count()).count();
        let wrong = if judged.refuted { INDISTINGUISHABLE_POOR } else { 0.0 };
        let all = misfit(fitted, &self.fitted) + self.others(judged) + wrong;
        all / (1 + judged.held_out.len()) as f64 + PRICE * count as f64
    }

    /// Misfit on the recording, nats.
    pub fn fitted_misfit(&self, judged: &Judged) -> f64 {
        misfit(&judged.fitted, &self.fitted)
    }

    /// Misfit on the held-out recordings (on the recording where there are none), nats; only load steps have a price there.
    pub fn held_out_misfit(&self, judged: &Judged) -> f64 {
        if judged.held_out.is_empty() {
            misfit(&judged.fitted, &self.fitted)
        } else {
            self.others(judged) / judged.held_out.len() as f64
        }
    }

    fn others(&self, judged: &Judged) -> f64 {
        judged.held_out.iter().zip(&self.held_out).map(|(h, worth)| misfit(h, worth)).sum()
    }

    /// Whether `wide`, which contains `narrow` as a special case, is worth its further parameters.
    pub fn widens(&self, wide: &Judged, narrow: &Judged) -> bool {
        let least = if asks_for(wide, narrow) { LEAST_GAIN } else { NESTED_GAIN };
        self.loss(narrow) >= self.loss(wide) + least
    }

    /// Whether `a` is worth its parameters over `b`: on all recordings together, and not only on the fitted one, if others show at all
    /// what it is worth.
    pub fn beats(&self, a: &Judged, b: &Judged) -> bool {
        self.loss(a) < self.loss(b) - LEAST_GAIN
            && (self.held_out_misfit(a) < self.held_out_misfit(b) - LEAST_HELD_OUT
                || !self.shown_elsewhere(a, b)
                || self.silent_elsewhere(a, b))
    }

    /// Whether the held-out recordings have nothing to say where `a` plainly explains what `b` leaves on the fitted one: `b` leaves no more
    /// than chance there, steps of an unknown load included, and `a` does no worse.
    fn silent_elsewhere(&self, a: &Judged, b: &Judged) -> bool {
        a.excess() < MISMATCH
            && b.excess() > MISMATCH
            && b.held_out_excess() < FLOOR_ERROR
            && self.held_out_misfit(a) <= self.held_out_misfit(b)
            && misfit(&a.fitted, &self.fitted) < misfit(&b.fitted, &self.fitted) - INDISTINGUISHABLE_POOR
    }

    /// Whether the held-out recordings hold the channels in which `a` leaves less than `b` on the fitted one, for the most part.
    fn shown_elsewhere(&self, a: &Judged, b: &Judged) -> bool {
        let (mut all, mut shown) = (0.0, 0.0);
        for (at, (channel, square)) in a.fitted.squares.iter().enumerate() {
            let nats = |square: f64| 0.5 * self.fitted[at] * log_square(square, a.fitted.chance[at]);
            let gain = (nats(b.fitted.squares[at].1) - nats(*square)).max(0.0);
            all += gain;
            if a.held_out.iter().any(|run| run.squares.iter().any(|(c, _)| c == channel)) {
                shown += gain;
            }
        }
        a.held_out.is_empty() || shown > 0.5 * all
    }
}

/// Whether `fitted` loses against `best` by more than a few nats could make up for, however well it did on the other recordings, or in what
/// is not a current if only these are compared.
pub fn loses(fitted: &Hypothesis, currents: bool, best: &Judged) -> bool {
    let floor = |chance: f64| log_square(0.0, chance);
    // At most what the best set leaves can be gained elsewhere, and its load steps.
    let nats = |best: &Hypothesis, left: &dyn Fn(usize) -> Option<f64>| -> f64 {
        let channels = best.squares.iter().zip(&best.chance).zip(&best.samples).enumerate();
        let all: f64 = channels
            .map(|(at, (((_, square), chance), samples))| {
                let worth = samples.clamp(LEAST_WORTH, MOST_WORTH);
                let left = left(at).map_or(floor(*chance), |left| log_square(left, *chance));
                0.5 * worth * (left - log_square(*square, *chance))
            })
            .sum();
        (all - price_of_steps(best)) / best.runs() as f64
    };
    let squares = &fitted.squares;
    let shown = |at: usize| (!currents || squares[at].0.is_electrical()).then_some(squares[at].1);
    let here = nats(&best.fitted, &shown);
    let elsewhere: f64 = best.held_out.iter().map(|run| nats(run, &|_| None)).sum();
    (here + elsewhere) / (1 + best.held_out.len()) as f64 > LOST
}

/// Whether the recordings together would not have left so much more to `narrow` than to `wide`, which contains it and reaches the noise,
/// by chance. That this is the further physics, and not the next thing that either leaves out, it does not say.
pub fn asks_for(wide: &Judged, narrow: &Judged) -> bool {
    let likelier = |wide: &Hypothesis, narrow: &Hypothesis| -> f64 {
        let samples = wide.samples.iter().zip(&narrow.samples).map(|(a, b)| a.min(*b));
        let ratios = wide.squares.iter().zip(&narrow.squares).map(|((_, a), (_, b))| (b / a).ln());
        samples.zip(ratios).map(|(n, ratio)| 0.5 * n * ratio).sum()
    };
    let runs = || {
        let others = wide.held_out.iter().zip(&narrow.held_out);
        std::iter::once((&wide.fitted, &narrow.fitted)).chain(others)
    };
    let more = |(wide, narrow): (&Hypothesis, &Hypothesis)| {
        let channels = wide.squares.iter().zip(&narrow.squares);
        channels.map(|((_, a), (_, b))| b - a).fold(0.0, f64::max)
    };
    wide.excess() < MISMATCH
        && runs().map(more).fold(0.0, f64::max) > FLOOR_ERROR
        && runs().map(|(wide, narrow)| likelier(wide, narrow)).sum::<f64>() > ASKED_FOR
}

/// Misfit on one recording with what its load steps cost, nats; the mean over those that were fitted together.
fn misfit(hypothesis: &Hypothesis, worth: &[f64]) -> f64 {
    let channels = hypothesis.squares.iter().zip(&hypothesis.chance).zip(worth);
    let all: f64 = channels.map(|(((_, s), chance), w)| 0.5 * w * log_square(*s, *chance)).sum();
    (all + price_of_steps(hypothesis)) / hypothesis.runs() as f64
}

fn price_of_steps(hypothesis: &Hypothesis) -> f64 {
    let steps: usize = hypothesis.nuisances.iter().map(Nuisance::steps).sum();
    STEP_PRICE * steps as f64
}

/// Logarithm of a mean square; what falls below the floor or within chance of it earns nothing, what is not a number costs
/// all.
fn log_square(square: f64, chance: f64) -> f64 {
    if square.is_finite() { square.max(0.9 + chance).ln() } else { 1e6 }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{hypothesis, judged};
    use super::*;

    #[test]
    fn a_gain_on_the_fitted_recording_alone_is_not_enough() {
        let (base, lucky) = (judged(1.3, 1.0, 1.3, 4), judged(1.0, 1.0, 1.3, 5));
        let right = judged(1.0, 1.0, 1.0, 5);
        let scale = Scale::new([&base, &lucky, &right].into_iter());
        assert!(!scale.beats(&lucky, &base));
        assert!(scale.beats(&right, &base));
    }

    #[test]
    fn what_has_lost_loses_whatever_it_does_elsewhere() {
        let mut lost = [0, 0];
        for (best_left, left) in
            [1.0, 1.2, 4.0].into_iter().flat_map(|b| [1.1, 2.0, 5.0, 60.0].map(|l| (b, l)))
        {
            for samples in [5.0, 40.0, 1e4] {
                let with = |mut judged: Judged| {
                    judged.fitted.samples = vec![samples; 2];
                    judged.held_out[0].samples = vec![samples; 2];
                    judged
                };
                let best = with(judged(best_left, 1.1, best_left, 6));
                // All that it does not show is as if nothing were left there, and it has fewer parameters.
                let rival = with(judged(left, 0.5, 0.5, 2));
                let scale = Scale::new([&best, &rival].into_iter());
                let gone = loses(&rival.fitted, true, &best);
                lost[usize::from(gone)] += 1;
                assert!(!gone || scale.loss(&rival) > scale.loss(&best) + LOST - 4.0 * PRICE - 1e-9);
                assert!(gone || loses(&judged(left, 60.0, 0.5, 2).fitted, false, &best) || samples < 1e3);
            }
        }
        assert!(lost.iter().all(|count| *count > 3), "{lost:?}");
    }

    #[test]
    fn a_run_that_needs_no_effect_does_not_speak_against_a_plain_gain() {
        let with_speed = |on_recording: f64, held_out: f64, free: usize| {
            let held_out = vec![hypothesis(1.0, held_out, free)];
            Judged { fitted: hypothesis(1.0, on_recording, free), held_out, refuted: false }
        };
        let (base, plain) = (with_speed(1.8, 1.0, 4), with_speed(1.0, 1.0, 5));
        let scale = Scale::new([&base, &plain].into_iter());
        assert!(scale.beats(&plain, &base));
        // Unless the run does need something, or the effect does it harm, or leaves a mismatch itself, or there was none.
        let more = with_speed(1.8, 1.05, 4);
        assert!(!scale.beats(&with_speed(1.0, 1.05, 5), &more));
        assert!(!scale.beats(&with_speed(1.0, 1.2, 5), &base));
        assert!(!scale.beats(&with_speed(1.4, 1.0, 5), &base));
        assert!(!scale.beats(&plain, &with_speed(1.25, 1.0, 4)));
    }

    #[test]
    fn a_run_without_the_channel_cannot_speak_against_a_gain_in_it() {
        let of_motion = |d: f64| {
            let mut judged = judged(d, 1.0, 1.0, 4);
            judged.held_out[0].squares.remove(0);
            judged.held_out[0].samples.remove(0);
            judged.held_out[0].chance.remove(0);
            judged
        };
        let (base, right) = (of_motion(9.0), of_motion(1.0));
        let scale = Scale::new([&base, &right].into_iter());
        assert!(scale.beats(&right, &base) && !scale.beats(&base, &right));
    }

    #[test]
    fn parameters_have_their_price() {
        let (lean, rich) = (judged(1.0, 1.0, 1.0, 4), judged(1.0, 1.0, 1.0, 6));
        let scale = Scale::new([&lean, &rich].into_iter());
        assert!((scale.loss(&rich) - scale.loss(&lean) - 2.0 * PRICE).abs() < 1e-12);
    }

    #[test]
    fn what_driven_noise_may_do_by_chance_decides_nothing() {
        let (mut base, mut other) = (judged(1.0, 1.3, 1.0, 4), judged(1.0, 1.0, 1.0, 5));
        let scale = Scale::new([&base, &other].into_iter());
        assert!(scale.loss(&other) < scale.loss(&base));
        for j in [&mut base, &mut other] {
            j.fitted.chance[1] = 0.5;
            j.held_out[0].chance[1] = 0.5;
        }
        assert!(scale.loss(&other) > scale.loss(&base));
        assert_eq!((base.excess(), base.held_out_excess()), (0.0, 0.0));
        assert!(judged(1.0, 3.0, 1.0, 4).excess() > 1.9);
    }

    #[test]
    fn what_a_run_refutes_gives_way_to_a_rival_that_it_does_not() {
        let (base, mut good) = (judged(60.0, 1.0, 60.0, 4), judged(1.0, 1.0, 1.0, 5));
        let mut rival = judged(1.05, 1.0, 1.0, 5);
        let scale = Scale::new([&base, &good, &rival].into_iter());
        assert!(scale.loss(&good) < scale.loss(&rival));
        good.refuted = true;
        assert!(scale.loss(&good) > scale.loss(&rival) && scale.beats(&good, &base));
        rival.refuted = true;
        assert!(scale.loss(&good) < scale.loss(&rival));
    }

    #[test]
    fn a_special_case_stands_unless_the_recordings_ask_for_more() {
        let narrow = judged(1.0, 1.05, 1.0, 5);
        let wide = judged(1.0, 1.0, 1.0, 6);
        let scale = Scale::new([&narrow, &wide].into_iter());
        assert!(asks_for(&wide, &narrow) && !asks_for(&narrow, &wide));
        assert!(scale.widens(&wide, &narrow));
        // Where the wider model leaves more than noise, it may bend to what neither describes.
        let (narrow, wide) = (judged(2.0, 1.05, 2.0, 5), judged(2.0, 1.0, 2.0, 6));
        assert!(!asks_for(&wide, &narrow) && !scale.widens(&wide, &narrow));
        let slight = judged(1.0, 1.012, 1.0, 5);
        assert!(!asks_for(&judged(1.0, 1.0, 1.0, 6), &slight));
    }

    #[test]
    fn load_steps_have_their_price_on_every_recording() {
        let (bare, mut stepping) = (judged(1.0, 1.0, 1.0, 4), judged(1.0, 1.0, 1.0, 4));
        stepping.fitted.nuisances = vec![Nuisance::unknown(3, 0)];
        stepping.held_out[0].nuisances = vec![Nuisance::unknown(1, 0)];
        let scale = Scale::new([&bare, &stepping].into_iter());
        assert!((scale.loss(&stepping) - scale.loss(&bare) - 2.0 * STEP_PRICE).abs() < 1e-12);
        assert!((scale.held_out_misfit(&stepping) - STEP_PRICE).abs() < 1e-12);
    }

    #[test]
    fn what_is_not_a_number_never_wins() {
        let (base, broken) = (judged(5.0, 1.0, 5.0, 4), judged(f64::NAN, 1.0, 1.0, 4));
        let scale = Scale::new([&base, &broken].into_iter());
        assert!(!scale.beats(&broken, &base));
    }
}
