//! The windows within which the speed runs free: short, and none over what the log does not tell.

use crate::signals::Signals;
use std::ops::Range;

/// Length of a window, s.
pub const WINDOW: f64 = 0.25;
/// A window shorter than this share of [`WINDOW`] joins the one before.
const SHORTEST: f64 = 0.2;
/// A measured load jumps if it changes by this many times its usual change, and by this share of its range.
const JUMP: (f64, f64) = (12.0, 0.1);
/// A load that jumps more often than once in so many samples varies in its own way.
const RARE: usize = 100;
/// Samples that a window next to a jump holds at least.
const FEWEST: usize = 8;

/// The windows of a recording: each gap-free segment cut into runs of [`WINDOW`] seconds, and where a measured load jumps from one sample
/// to the next, as the log does not tell when between them it did.
pub fn windows(signals: &Signals) -> Vec<Range<usize>> {
    let jumps = signals.tau_m.as_ref().map_or_else(Vec::new, |tau_m| jumps(tau_m));
    let mut out: Vec<Range<usize>> = Vec::new();
    for segment in &signals.segments {
        let first = out.len();
        let mut start = segment.start;
        // Ends a window before sample k; a short rest may join the window before, unless that ended at a jump.
        let mut end = |start: usize, k: usize, joins: bool| {
            let short = signals.t[k - 1] - signals.t[start] < SHORTEST * WINDOW;
            match out[first..].last_mut().filter(|_| joins && short) {
                Some(before) => before.end = k,
                None => out.push(start..k),
            }
        };
        let mut fresh = false;
        for k in segment.clone() {
            let room = k >= start + FEWEST && k + FEWEST <= segment.end;
            let jumps = room && jumps.binary_search(&k).is_ok();
            let full = k > start && signals.t[k] - signals.t[start] >= WINDOW - 0.5 * signals.period;
            if jumps || full {
                end(start, k, !full && !fresh);
                (start, fresh) = (k, jumps);
            }
        }
        end(start, segment.end, !fresh);
    }
    out
}

/// Samples before which a measured load jumps: rarely, by far more than it usually changes, and by a good part of its range.
fn jumps(tau_m: &[f64]) -> Vec<usize> {
    let changes: Vec<f64> = tau_m.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    let mut sorted = changes.clone();
    sorted.sort_by(f64::total_cmp);
    let Some(usual) = sorted.get(sorted.len() / 2) else { return Vec::new() };
    let (low, high) =
        tau_m.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)));
    let least = (JUMP.0 * usual).max(JUMP.1 * (high - low));
    let found: Vec<usize> = (1..tau_m.len()).filter(|k| changes[k - 1] > least).collect();
    if found.len() * RARE > tau_m.len() { Vec::new() } else { found }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Machine;
    use crate::recording::Recording;

    fn recorded(tau_m: Vec<f64>) -> Signals {
        let t: Vec<f64> = (0..tau_m.len()).map(|k| 1e-3 * k as f64).collect();
        let omega = t.iter().map(|t| 50.0 + 10.0 * t).collect();
        let columns = vec![
            ("t".into(), t.clone()),
            ("omega_m".into(), omega),
            ("tau_e".into(), vec![1.0; t.len()]),
            ("tau_m".into(), tau_m),
        ];
        Signals::new(&Recording::new(columns, None).unwrap(), &Machine::new(2).unwrap()).unwrap()
    }

    #[test]
    fn a_window_ends_where_a_measured_load_jumps() {
        let noise = |k: usize| 1e-3 * (7.0 * k as f64).sin();
        let at = |steps: &[usize], n: usize| {
            let load = |k: usize| steps.iter().filter(|s| k >= **s).count() as f64 + noise(k);
            windows(&recorded((0..n).map(load).collect()))
        };
        assert_eq!(at(&[], 600), [0..250, 250..500, 500..600]);
        assert_eq!(at(&[400], 600), [0..250, 250..400, 400..600]);
        // Soon after a window has begun, what is before the jump joins the window before.
        assert_eq!(at(&[260], 600), [0..260, 260..510, 510..600]);
        // At the very edges there is no room, and a load that jumps all the time is its own.
        assert_eq!(at(&[3, 597], 600), [0..250, 250..500, 500..600]);
        let square = |k: usize| (k / 20 % 2) as f64;
        assert_eq!(windows(&recorded((0..600).map(square).collect())), [0..250, 250..500, 500..600]);
        let swing = |k: usize| (0.05 * k as f64).sin() + noise(k);
        assert_eq!(windows(&recorded((0..600).map(swing).collect())), [0..250, 250..500, 500..600]);
        assert!(windows(&recorded(vec![0.3; 600])).len() == 3);
        // Steady points that lie further apart than a window is long.
        let mut sparse = recorded(vec![0.3; 16]);
        sparse.t.iter_mut().for_each(|t| *t *= 1e3);
        sparse.period *= 1e3;
        let each: Vec<Range<usize>> = (0..14).map(|k| k..k + 1).chain(std::iter::once(14..16)).collect();
        assert_eq!(windows(&sparse), each);
    }
}
