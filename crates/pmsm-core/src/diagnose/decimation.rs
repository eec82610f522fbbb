//! Decimation: where the motor is slow compared with the sampling rate, the search for a set uses one sample in several.
//!
//! The residual of a sample, in units of the noise, does not depend on the number of samples. The comparison of sets counts one
//! independent sample in a hundred; see [`super::evidence`]. The set that was found is fitted to every sample.

use super::data::Data;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::select::Outcome;
use super::transfer::transfer;
use super::verdict::Validated;
use crate::error::Result;
use crate::experiment::floor::Floor;
use crate::monitor::Monitor;
use crate::recording::Kind;
use rayon::prelude::*;
use std::ops::Range;

/// Fewest samples of a decimated recording, or of each half of one that is split: 100 independent ones at one in a hundred rows.
const ENOUGH: usize = 10_000;
/// Fewest samples of a decimated window.
const SHORTEST: usize = 100;
/// Largest product of the sampling period and the fastest rate of the dq-model. A period of a sixth harmonic then keeps five samples.
const FASTEST: f64 = 0.2;
/// Largest share of driven noise in the square of a current's floor. Driven noise grows with the decimation factor, and beyond a half it
/// would be the larger part.
const DRIVEN: f64 = 0.5;

/// The recording and the others decimated, if they allow for it.
pub fn decimated(whole: &Data, others: &[Data]) -> Option<(Data, Vec<Data>)> {
    let halves = if others.is_empty() { 2 } else { 1 };
    let all = || others.iter().chain([whole]);
    let slowest = whole.signals.len() / (halves * ENOUGH);
    let factor = all().map(Data::largest_factor).fold(slowest, usize::min);
    let quiet = |factor: usize| {
        let mut currents = all().flat_map(|data| data.floors.iter().filter(|f| f.channel.is_electrical()));
        currents.all(|floor| floor.share() * factor as f64 <= DRIVEN)
    };
    let factor = (2..=factor).rev().find(|factor| quiet(*factor))?;
    Some((whole.decimated_by(factor), others.iter().map(|data| data.decimated_by(factor)).collect()))
}

impl Data {
    /// Largest factor by which it may be decimated.
    fn largest_factor(&self) -> usize {
        let signals = &self.signals;
        let alone = self.parts.is_empty() && self.held_out.is_none() && signals.segments.len() == 1;
        let wanders = self.wander().is_some() || self.wanders_unfiltered();
        let quiet = self.input.is_none() && self.whitening.is_none() && !wanders;
        if !alone || !quiet || self.poor || signals.kind != Kind::Full || signals.decimation() > 1 {
            return 1;
        }
        let rate = signals.context.omega_e_max + signals.context.electrical_rate;
        let factor = (FASTEST / (rate * signals.period)).min(signals.len() as f64 / 2.0) as usize;
        let shortest = self.windows.iter().map(Range::len).min().unwrap_or(0);
        factor.min(shortest / SHORTEST).max(1)
    }

    /// The same recording decimated by the factor `factor`.
    fn decimated_by(&self, factor: usize) -> Self {
        let of = |k: usize| k.div_ceil(factor);
        let times = factor as f64;
        // The mean of the currents drives the rotor, as before. Noise of angle and speed adds up in larger steps.
        let floor = |floor: &Floor| match floor.channel.is_electrical() {
            true => Floor { driven: floor.driven * times.sqrt(), swing: floor.swing * times, ..*floor },
            false => *floor,
        };
        Self {
            signals: self.signals.decimated_by(factor),
            windows: self.windows.iter().map(|w| of(w.start)..of(w.end)).collect(),
            floors: self.floors.iter().map(floor).collect(),
            ..self.clone()
        }
    }
}

/// The path to the best set of a decimated search, fitted to every sample. Sets are still compared by their decimated residuals.
///
/// # Errors
/// Those of the least-squares fits.
pub fn on_every_sample(
    whole: &Data,
    others: &[Data],
    found: Outcome,
    base: &Hypothesis,
    monitor: &dyn Monitor,
) -> Result<Outcome> {
    let last = found.path.len() - 1;
    let anew = |(at, validated): (usize, &Validated)| -> Result<Validated> {
        let fitted = match last {
            0 => base.clone(),
            _ => fitting::carried_over(whole, &validated.fitted, monitor)?,
        };
        let mut held_out = validated.held_out.clone();
        if !others.is_empty() && (at == 0 || at == last) {
            held_out = others.iter().map(|data| transfer(data, &fitted, monitor)).collect::<Result<_>>()?;
        }
        Ok(Validated { fitted, held_out, ..validated.clone() })
    };
    let path: Result<Vec<Validated>> = found.path.par_iter().enumerate().map(anew).collect();
    Ok(Outcome { path: path?, ..found })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::incumbent::Incumbent;
    use crate::diagnose::search;
    use crate::diagnose::testing::{self, choice, setup, speeds};
    use crate::drive::{Choice, Setup};
    use crate::effects::EffectId;
    use crate::machine::Machine;
    use crate::monitor::Silent;

    /// A servo motor at 20 kHz.
    fn fast_clock(duration: f64, effects: Vec<Choice>) -> Setup {
        let path: Vec<(f64, f64)> =
            (0..6).map(|k| (0.05 + 0.2 * f64::from(k), [90.0, -70.0][k as usize % 2])).collect();
        let mut setup = setup(speeds(duration, &path), effects);
        setup.nameplate = Machine::liu_2008().with_drive(Some(560.0), Some(20.0), Some(2e4)).unwrap();
        setup.machine = setup.nameplate.clone();
        setup
    }

    #[test]
    fn a_long_log_of_a_slow_motor_is_decimated_and_leaves_as_much() {
        let (data, base) = testing::data(&fast_clock(1.1, Vec::new()));
        assert!(decimated(&data, &[]).is_none(), "its halves would be too short");
        let (slow, others) = decimated(&data, std::slice::from_ref(&data)).unwrap();
        assert_eq!(
            (slow.signals.decimation(), slow.signals.len(), others.len()),
            (2, data.signals.len() / 2, 1)
        );
        assert_eq!(slow.windows.len(), data.windows.len());
        let there = fitting::carried_over(&slow, &base, &Silent).unwrap();
        for (a, b) in base.squares.iter().zip(&there.squares) {
            assert!((a.1 - b.1).abs() < 0.05, "{:?} {:?}", base.squares, there.squares);
        }
        let poor = Data { poor: true, ..data.clone() };
        assert!(decimated(&poor, std::slice::from_ref(&data)).is_none());
        let (short, _) = testing::data(&fast_clock(0.9, Vec::new()));
        assert!(decimated(&short, std::slice::from_ref(&data)).is_none());
    }

    #[test]
    fn the_set_of_a_decimated_search_is_fitted_to_every_sample() {
        let present = || vec![choice("dead_time", "v_err", 3.0)];
        let ((data, base), (other, _)) =
            (testing::data(&fast_clock(1.1, present())), testing::data(&fast_clock(1.05, present())));
        assert!(decimated(&data, std::slice::from_ref(&other)).is_some());
        let outcome = search::search(&data, &[other], &base, None, (&Silent, &Incumbent::default())).unwrap();
        assert_eq!(outcome.best.fitted.effects(), [EffectId::DeadTime]);
        let (bare, best) = outcome.ends();
        assert_eq!(best.fitted.effects(), [EffectId::DeadTime]);
        let again = best.fitted.clone().seen_again(&data);
        assert_eq!(best.fitted.squares, again.squares);
        assert_eq!(bare.held_out.len(), 1);
        assert!(
            largest(&best.fitted) < 1.1 && largest(&best.held_out[0]) < 1.1 && largest(&bare.fitted) > 2.0
        );
    }

    fn largest(hypothesis: &Hypothesis) -> f64 {
        hypothesis.squares.iter().map(|(_, square)| *square).fold(0.0, f64::max)
    }
}
