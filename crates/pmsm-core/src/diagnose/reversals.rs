//! Load steps that fall on reversals. An unknown load that changes in steps can do what friction does, if it steps whenever
//! the speed changes its sign: the bare machine fits then, with a load that nobody applied.

use super::data::Data;
use super::hypothesis::Hypothesis;
use crate::experiment::{Channel, split};
use crate::signals::Signals;
use std::ops::RangeInclusive;

/// The speed is beyond zero from this many times its noise.
const BEYOND: f64 = 10.0;
/// A step this close to a reversal falls on it, share of the duration.
const NEAR: f64 = 0.005;

/// Whether a step of the load fitted to any of the recordings falls on a reversal.
pub fn meets_step(data: &Data, hypothesis: &Hypothesis) -> bool {
    let own = &hypothesis.parameters[hypothesis.model.parameter_count()..];
    data.runs().iter().zip(split(&hypothesis.nuisances, own)).any(|(run, (nuisance, values))| {
        let steps = &values[nuisance.levels..][..nuisance.steps()];
        let noise = run.floors.iter().find(|f| f.channel == Channel::OmegaE).map(|f| f.sensor);
        let (Some(noise), false) = (noise, steps.is_empty()) else { return false };
        let found = reversals(&run.signals, BEYOND * noise);
        let near = NEAR * run.signals.context.duration;
        steps.iter().any(|s| found.iter().any(|r| *s > r.start() - near && *s < r.end() + near))
    })
}

/// When the speed goes from beyond one side of zero to beyond the other, s from the first sample.
fn reversals(signals: &Signals, beyond: f64) -> Vec<RangeInclusive<f64>> {
    let mut out = Vec::new();
    let mut last: Option<(f64, f64)> = None;
    for (t, omega) in signals.t.iter().zip(&signals.omega_e).filter(|(_, w)| w.abs() > beyond) {
        if let Some((before, side)) = last
            && side != omega.signum()
        {
            out.push(before - signals.t[0]..=t - signals.t[0]);
        }
        last = Some((*t, omega.signum()));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Machine;
    use crate::recording::Recording;

    #[test]
    fn a_reversal_counts_once_and_only_beyond_the_noise() {
        let mut omega = vec![5.0, 20.0, 8.0, -3.0, 4.0, -30.0, -8.0, 9.0, -25.0];
        omega.resize(20, 15.0);
        let t: Vec<f64> = (0..20).map(|k| 2.0 + 0.1 * f64::from(k)).collect();
        let columns = vec![("t".into(), t), ("omega_m".into(), omega), ("tau_e".into(), vec![1.0; 20])];
        let recording = Recording::new(columns, None).unwrap();
        let signals = Signals::new(&recording, &Machine::new(1).unwrap()).unwrap();
        let found = reversals(&signals, 10.0);
        let expected = [(0.1, 0.5), (0.8, 0.9)];
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (range, (start, end)) in found.iter().zip(expected) {
            assert!((range.start() - start).abs() < 1e-9 && (range.end() - end).abs() < 1e-9, "{range:?}");
        }
    }
}
