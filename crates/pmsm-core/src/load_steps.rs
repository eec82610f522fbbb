//! Finds when an unknown, piecewise constant load torque changes.
//!
//! The equation of motion is integrated at the *measured* speed,
//!
//! > y(t) = ∫J·a dt − J·(ω_m(t) − ω_m(0)),  a = acceleration of the model without load,
//!
//! in which a load step at s is a hinge Δτ·max(0, t − s) under little noise. In this form a wrong inertia adds the speed
//! itself, which no load resembles; behind a gap of the log y(t) begins anew. Steps are added where a hinge explains
//! most, together with corrections of the model's own mechanical parameters, moved, and pruned again; how much a step
//! must explain follows from the effective number of independent samples in what is left.

mod behind;
mod grid;
mod placed;

use crate::model::Model;
use crate::monitor::Monitor;
use crate::signals::Signals;
use grid::Grid;
use placed::Placed;

/// What a step must gain in the log-likelihood-like n_eff·ln(SSE ratio): two parameters and the freedom to choose.
const GAIN: f64 = 30.0;
/// Steps allowed per second, and at least.
const RATE: (f64, usize) = (4.0, 4);
/// Rows of the log for each step: fewer do not tell its instant and its level from noise.
const ROWS: usize = 50;
/// Closest distance of two steps, share of the duration, and of no more than this many seconds: longer recordings are searched in pieces,
/// because the cost of a search grows faster than the number of its steps.
const CLOSEST: f64 = 0.004;
const LONGEST: f64 = 8.0;
/// Share of a piece that is looked at on either side of it, too, and samples that a piece must have.
const MARGIN: f64 = 0.1;
const FEWEST: usize = 16;
/// Strides in which steps are moved, one after the other, in units of the first scan's: down to where the noise would leave them, lest
/// a second step be needed to put the first one right.
const STRIDES: [f64; 4] = [0.5, 0.12, 0.03, 0.007];

/// Instants (s from the first sample, ascending) at which the load changes, given the motor torque per sample
/// `tau_e` and the mechanical parameters `free` that may still be wrong. Effects with states of their own are
/// taken as rigid here. Once `monitor` says stop, those that have been found by then.
pub fn find(
    model: &Model,
    signals: &Signals,
    p: &[f64],
    tau_e: &[f64],
    free: &[usize],
    monitor: &dyn Monitor,
) -> Vec<f64> {
    let (duration, count) = (signals.context.duration, pieces(signals.context.duration));
    let (piece, apart) = (duration / count as f64, closest(duration));
    let margin = if count == 1 { 0.0 } else { MARGIN * piece };
    let allowed = (RATE.0 * (piece + 2.0 * margin)) as usize;
    let mut found: Vec<f64> = Vec::new();
    for k in (0..count).take_while(|_| !monitor.cancelled()) {
        let [start, end] = [k, k + 1].map(|k| k as f64 * piece);
        let seen = |t: f64| signals.t.partition_point(|x| *x < t);
        let rows = if count == 1 { 0..signals.len() } else { seen(start - margin)..seen(end + margin) };
        if rows.len() < FEWEST {
            continue;
        }
        let most = RATE.1.max(allowed.min(rows.len() / ROWS));
        let first = signals.t[rows.start];
        let grid = Grid::new(model, signals, p, tau_e, free, rows);
        let steps = search(Placed::none(&grid, apart), most, monitor).into_iter().map(|s| first + s);
        // A step at a seam may be found from both sides.
        let own = |s: &f64| (k == 0 || *s > start - apart) && (k + 1 == count || *s < end + apart);
        for step in steps.filter(own) {
            if found.last().is_none_or(|last| k == 0 || step > last + apart) {
                found.push(step);
            }
        }
    }
    found
}

/// Instants of the steps that pay, ascending, out of so many at `most`.
fn search(mut placed: Placed, most: usize, monitor: &dyn Monitor) -> Vec<f64> {
    // Steps are added without asking what they are worth, because with some of them missing what is left is too
    // coloured to tell; those that do not pay in the end are pruned.
    while placed.steps.len() < most && !monitor.cancelled() && placed.add() {
        placed.move_each(&STRIDES[..2], monitor);
    }
    placed.move_each(&STRIDES, monitor);
    while !monitor.cancelled() && (placed.merge(GAIN) || placed.prune(GAIN)) {
        placed.move_each(&STRIDES, monitor);
    }
    placed.steps
}

/// Pieces in which a recording of this duration, s, is searched.
fn pieces(duration: f64) -> usize {
    (duration / LONGEST).ceil().max(1.0) as usize
}

/// Closest distance of two steps in a recording of this duration, s.
pub fn closest(duration: f64) -> f64 {
    CLOSEST * (duration / pieces(duration) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::{BaseParameter, Machine};
    use crate::monitor::{Silent, StopFlag};
    use crate::recording::{Load, Recording};

    const J: f64 = 0.01;
    const B: f64 = 0.002;

    /// A deterministic stand-in for white noise between −1 and 1.
    fn noise(k: i32) -> f64 {
        let x = (f64::from(k) * 12.9898).sin() * 43_758.545_3;
        2.0 * (x - x.floor()) - 1.0
    }

    /// Speed and torque of a rigid machine that swings while its load changes at `steps`, integrated in fine steps.
    fn run(levels: &[f64], steps: &[f64], n: i32, h: f64) -> (Recording, Machine) {
        let (mut t, mut speed, mut torque) = (Vec::new(), Vec::new(), Vec::new());
        let mut omega = 0.0;
        for k in 0..n {
            let now = f64::from(k) * h;
            let drive = |time: f64| 2.0 * (8.0 * time).sin() + 1.0;
            t.push(now);
            speed.push(omega + 0.05 * noise(k));
            torque.push(drive(now));
            for fine in 0..20 {
                let time = now + (f64::from(fine) + 0.5) * h / 20.0;
                let load = levels[steps.iter().filter(|s| **s <= time).count()];
                omega += (drive(time) - B * omega - load) / J * h / 20.0;
            }
        }
        let columns = vec![("t".into(), t), ("omega_m".into(), speed), ("tau_e".into(), torque)];
        let recording = Recording::new(columns, Some(Load::UnknownPiecewise)).unwrap();
        // The nameplate is off, as nameplates are.
        let machine = Machine::new(1).unwrap().with(BaseParameter::J, 0.012).unwrap();
        (recording, machine.with(BaseParameter::B, 0.0025).unwrap())
    }

    fn found(levels: &[f64], steps: &[f64], n: i32, h: f64) -> Vec<f64> {
        let (recording, machine) = run(levels, steps, n, h);
        found_in(&recording, &machine)
    }

    fn found_in(recording: &Recording, machine: &Machine) -> Vec<f64> {
        let signals = Signals::new(recording, machine).unwrap();
        let model = Model::new(signals.context, &[]);
        let torque = signals.tau_e.clone().unwrap();
        let p = [1.0, 1e-3, 1e-3, 0.1, 0.012, 0.0025];
        find(&model, &signals, &p, &torque, &[4, 5], &Silent)
    }

    #[test]
    fn steps_are_found_in_spite_of_a_wrong_nameplate() {
        let steps = [0.4, 0.9, 1.45];
        let found = found(&[0.8, 1.6, 0.5, 1.2], &steps, 8000, 2.5e-4);
        assert_eq!(found.len(), steps.len(), "{found:?}");
        for (found, step) in found.iter().zip(steps) {
            assert!((found - step).abs() < 0.001, "{step}: {found}");
        }
    }

    #[test]
    fn a_long_recording_is_searched_in_pieces_without_a_seam() {
        // Two pieces of 7.5 s: a step in each, one right at the seam, one within the margin of the other.
        let steps = [3.2, 7.1, 7.505, 12.9];
        let found = found(&[0.8, 1.6, 0.5, 1.2, 0.3], &steps, 15_000, 1e-3);
        assert_eq!(found.len(), steps.len(), "{found:?}");
        for (found, step) in found.iter().zip(steps) {
            assert!((found - step).abs() < 0.004, "{step}: {found}");
        }
        assert_eq!([pieces(8.0), pieces(8.001), pieces(60.0)], [1, 2, 8]);
        assert!((closest(60.0) / closest(7.5) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn what_happens_in_a_gap_is_no_load_step() {
        let (recording, machine) = run(&[0.8, 1.6], &[0.9], 8000, 2.5e-4);
        let logged: Vec<usize> = (0..8000).filter(|k| !(4800..5200).contains(k)).collect();
        // A jerk that nobody logged, and what the friction leaves of it.
        let jerk = |t: f64| if t > 1.25 { 5.0 * (-B / J * (t - 1.25)).exp() } else { 0.0 };
        let column = |name: &str| -> Vec<f64> {
            let (t, x) = (recording.t(), recording.column(name).unwrap());
            logged.iter().map(|k| x[*k] + if name == "omega_m" { jerk(t[*k]) } else { 0.0 }).collect()
        };
        let t = logged.iter().map(|k| recording.t()[*k]).collect();
        let columns =
            vec![("t".into(), t), ("omega_m".into(), column("omega_m")), ("tau_e".into(), column("tau_e"))];
        let gapped = Recording::new(columns, Some(Load::UnknownPiecewise)).unwrap();
        assert_eq!(gapped.segments().len(), 2);
        let found = found_in(&gapped, &machine);
        assert!(found.len() == 1 && (found[0] - 0.9).abs() < 0.001, "{found:?}");
    }

    #[test]
    fn nothing_is_sought_once_it_is_to_stop() {
        let (recording, machine) = run(&[0.8, 1.6], &[0.9], 8000, 2.5e-4);
        let signals = Signals::new(&recording, &machine).unwrap();
        let stop = StopFlag::default();
        stop.stop();
        let (model, torque) = (Model::new(signals.context, &[]), signals.tau_e.clone().unwrap());
        let p = [1.0, 1e-3, 1e-3, 0.1, 0.012, 0.0025];
        assert!(find(&model, &signals, &p, &torque, &[4, 5], &stop).is_empty());
    }

    #[test]
    fn a_constant_load_has_no_steps() {
        assert_eq!(found(&[0.8], &[], 8000, 2.5e-4), Vec::<f64>::new());
    }
}
