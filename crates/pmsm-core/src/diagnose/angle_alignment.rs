//! Alignment of the mechanical angles of several recordings: the electrical turn of the revolution in which each begins.
//!
//! Without a logged mechanical angle this turn is unknown, and effects that repeat once per revolution would be out of phase between
//! recordings. That turn is taken in which such an effect explains most of the residual of all recordings. Without such an effect
//! every turn is as good.

use super::data::Data;
use super::hypothesis::Hypothesis;
use super::score::Scorer;
use crate::effect::Site;
use crate::effects::{self, EffectId};
use crate::error::Result;
use crate::monitor::Monitor;
use std::f64::consts::TAU;

/// Another turn must raise the score by this factor to be taken.
const BETTER: f64 = 1.02;

/// Shifts the mechanical angle of the recordings by whole electrical turns so that they agree, and says whether any was shifted.
///
/// # Errors
/// [`Error::Interrupted`](crate::error::Error::Interrupted).
pub fn align(data: &mut Data, base: &Hypothesis, monitor: &dyn Monitor) -> Result<bool> {
    let turns = data.signals.n_p as usize;
    let known = data.parts.iter().position(|p| p.signals.turn_known);
    let reference = known.unwrap_or(0);
    let mut shifted = false;
    for run in (0..data.parts.len()).filter(|run| *run != reference) {
        let signals = &data.parts[run].signals;
        if signals.turn_known || !signals.angle_known || turns < 2 {
            continue;
        }
        let step = TAU / data.signals.n_p;
        let mut best = (0, score(data, base, monitor)?);
        let mut on = 0;
        for turn in 1..turns {
            turn_on(data, run, step);
            on = turn;
            let score = score(data, base, monitor)?;
            if score > BETTER * best.1 {
                best = (turn, score);
            }
        }
        turn_on(data, run, step * (best.0 as f64 - on as f64));
        shifted |= best.0 > 0;
    }
    Ok(shifted)
}

/// The largest score of an effect that tells the turns of a revolution apart.
fn score(data: &Data, base: &Hypothesis, monitor: &dyn Monitor) -> Result<f64> {
    monitor.go_on()?;
    let scorer = Scorer::new(data, base);
    let context = base.model.context();
    let tells = |effect: &EffectId| {
        let mut probe = effect.probes(context).into_iter().next().unwrap_or_default();
        let shown = match effect.info().site {
            Site::Mechanical => data.has_mechanical(),
            Site::Electrical | Site::Sensor => data.has_electrical(),
        };
        effect.turned(&mut probe, 1.0) && shown
    };
    let mut most = 0.0f64;
    for effect in effects::ALL.iter().filter(|effect| tells(effect)) {
        most = most.max(scorer.score(*effect, monitor)?.score);
    }
    Ok(most)
}

/// Moves the mechanical angle of one recording by `angle`, rad.
fn turn_on(data: &mut Data, run: usize, angle: f64) {
    let samples = data.samples_of(run);
    let own = data.parts[run].signals.theta_m.iter_mut();
    for theta in own.chain(&mut data.signals.theta_m[samples]) {
        *theta += angle;
    }
}
