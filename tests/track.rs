//! Online identification on data made by an independent integration of the textbook equations, with noise, and on logs
//! with everything that goes wrong with logs.

mod plant;

use plant::Plant;
use pmsm_core::error::Error;
use pmsm_core::identify::Method;
use pmsm_core::monitor::{Silent, StopFlag};
use pmsm_core::recording::Load;
use pmsm_core::track::{Cause, Settings, Status, Tracker, Window};

const PERIOD: f64 = 1e-4;
const SAMPLES: usize = 330;
const NAMES: [&str; 6] = ["t", "v_d", "v_q", "i_d", "i_q", "omega_e"];

/// A log by column.
#[derive(Clone)]
struct Log(Vec<Vec<f64>>);

impl Log {
    /// `windows` windows of a lively run of the machine of Table 1, which `change` alters before each.
    fn of(windows: usize, noise: [f64; 2], change: impl Fn(usize, &mut Plant)) -> Self {
        let mut plant = Plant::liu();
        let (mut x, v) = plant.steady([0.0, 6.0], 60.0);
        let mut log = vec![Vec::new(); NAMES.len()];
        for k in 0..windows {
            change(k, &mut plant);
            let begin = (k * SAMPLES) as f64 * PERIOD;
            let run = plant.run(SAMPLES, PERIOD, x, |t| {
                let t = t + begin;
                [v[0] + 2.0 * (300.0 * t).sin(), v[1] + 8.0 * (150.0 * t).sin() + 5.0 * (37.0 * t).cos()]
            });
            x = plant.advance(run.x.last().unwrap(), *run.v.last().unwrap(), PERIOD);
            let recording = run.log(noise, 0.0, k as u64 + 1, Load::UnknownConstant);
            for (column, name) in log.iter_mut().zip(NAMES) {
                let shift = if name == "t" { begin } else { 0.0 };
                column.extend(recording.column(name).unwrap().iter().map(|x| x + shift));
            }
        }
        Self(log)
    }

    fn len(&self) -> usize {
        self.0[0].len()
    }

    fn rows(&self, from: usize, to: usize) -> Vec<(&'static str, &[f64])> {
        NAMES.iter().zip(&self.0).map(|(name, column)| (*name, &column[from..to])).collect()
    }

    fn without(&self, rows: std::ops::Range<usize>) -> Self {
        let keep = |column: &Vec<f64>| [&column[..rows.start], &column[rows.end..]].concat();
        Self(self.0.iter().map(keep).collect())
    }
}

fn tracker(method: Method) -> Tracker {
    let nameplate = Plant::liu().nameplate([1.1, 1.0, 1.0, 1.0, 1.0, 1.0]);
    Tracker::new(nameplate, Settings { method, ..Settings::default() }).unwrap()
}

fn follow(mut tracker: Tracker, log: &Log) -> Vec<Window> {
    let mut windows = tracker.update(&log.rows(0, log.len()), &Silent).unwrap();
    windows.extend(tracker.finish(&Silent).unwrap());
    windows
}

fn value(window: &Window, name: &str) -> f64 {
    window.get(name).and_then(|e| e.value).unwrap_or_else(|| panic!("{window:?}"))
}

fn told(window: &Window, words: &str) -> bool {
    window.notes.iter().any(|note| note.finding.contains(words))
}

const QUIET: [f64; 2] = [0.02, 0.2];

fn heating(k: usize) -> f64 {
    0.17 * (1.0 + 0.01 * k as f64)
}

#[test]
fn a_drifting_resistance_and_a_load_are_followed_within_their_uncertainty() {
    let load = |k: usize| if k < 6 { 3.0 } else { 4.0 };
    let log = Log::of(10, QUIET, |k, plant| (plant.r_s, plant.tau_load) = (heating(k), load(k)));
    for method in [Method::LeastSquares, Method::Both] {
        let windows = follow(tracker(method), &log);
        assert_eq!(windows.len(), 10);
        for (k, window) in windows.iter().enumerate() {
            assert_eq!(
                (window.window, window.status, window.samples),
                (k as u64, Status::Estimated, SAMPLES)
            );
            assert!((window.t_start - 0.033 * k as f64).abs() < 1e-9 && window.converged);
            for (name, truth) in [("r_s", heating(k)), ("tau_load", load(k))] {
                let estimate = window.get(name).unwrap();
                let error = value(window, name) - truth;
                assert!(
                    error.abs() < 4.5 * estimate.stderr.unwrap(),
                    "{k} {name}: {estimate:?}, truly {truth}"
                );
            }
            let disturbed = window.disturbed_load_torque.unwrap();
            assert!((disturbed - value(window, "tau_load")).abs() < 1e-12, "J and B are the nameplate's");
        }
        let looks = |k: usize| windows[k].drift.looks_like.clone().unwrap();
        assert_eq!(looks(1), [], "two windows are no trend: {}", windows[1].drift.sentence);
        assert_eq!(looks(5), [Cause::Thermal], "{}", windows[5].drift.sentence);
        assert!(looks(6).contains(&Cause::Load), "{}", windows[6].drift.sentence);
        assert!(windows.iter().all(|w| !w.drift.looks_like.as_ref().unwrap().contains(&Cause::Mismatch)));
    }
}

#[test]
fn the_paper_s_swarm_follows_from_the_first_window_on() {
    let log = Log::of(8, QUIET, |k, plant| plant.r_s = heating(k));
    let windows = follow(tracker(Method::Swarm), &log);
    for (k, window) in windows.iter().enumerate() {
        assert_eq!((window.evaluations, window.history.len()), (310, 31));
        assert!(window.history.windows(2).all(|pair| pair[1] <= pair[0]));
        assert!((value(window, "r_s") / heating(k) - 1.0).abs() < 0.02, "{k}: {window:?}");
        assert!((value(window, "tau_load") / 3.0 - 1.0).abs() < 0.01, "{k}: {window:?}");
    }
}

#[test]
fn with_bounds_the_swarm_knows_nothing_else_and_without_it_begins_on_a_regression() {
    let log = Log::of(1, QUIET, |_, _| ());
    let first = |bounds: [Option<(f64, f64)>; 2]| {
        let nameplate = Plant::liu().nameplate([1.1, 1.0, 1.0, 1.0, 1.0, 1.0]);
        let fit = ["r_s", "tau_load"].map(|name| name.parse().unwrap()).into_iter().zip(bounds).collect();
        let settings = Settings { method: Method::Swarm, fit, ..Settings::default() };
        let window = follow(Tracker::new(nameplate, settings).unwrap(), &log).remove(0);
        (window.cost_first.unwrap(), window.cost.unwrap())
    };
    let (open, bounded) = (first([None; 2]), first([Some((0.034, 0.85)), Some((-200.0, 200.0))]));
    assert!(open.0 < 2.0 * open.1, "a regression is near the minimum: {open:?}");
    assert!(bounded.0 > 10.0 * open.0, "{bounded:?} {open:?}");
}

#[test]
fn inertia_and_friction_that_drift_show_as_a_disturbed_load() {
    let log = Log::of(6, QUIET, |k, plant| plant.b = 1.15e-3 * (1.0 + k as f64));
    let windows = follow(tracker(Method::LeastSquares), &log);
    for (k, window) in windows.iter().enumerate() {
        let rows = k * SAMPLES..(k + 1) * SAMPLES;
        let speed = log.0[5][rows].iter().sum::<f64>() / (4.0 * SAMPLES as f64);
        let truth = 3.0 + 1.15e-3 * k as f64 * speed;
        let found = window.disturbed_load_torque.unwrap();
        assert!((found / truth - 1.0).abs() < 0.01, "{k}: {found}, truly {truth}");
    }
}

#[test]
fn batches_of_any_size_and_a_restored_tracker_give_the_same_bits() {
    let log = Log::of(5, QUIET, |k, plant| plant.r_s = heating(k));
    for method in [Method::LeastSquares, Method::Swarm] {
        let whole = follow(tracker(method), &log);
        let mut running = tracker(method);
        let mut windows = Vec::new();
        let (mut from, mut size) = (0, 1);
        while from < log.len() {
            let to = (from + size).min(log.len());
            windows.extend(running.update(&log.rows(from, to), &Silent).unwrap());
            // Killed and restored after every batch.
            running = Tracker::restore(&running.state().unwrap()).unwrap();
            (from, size) = (to, size * 3 % 401 + 1);
        }
        windows.extend(running.finish(&Silent).unwrap());
        assert_eq!(windows, whole);
    }
}

#[test]
fn what_goes_wrong_in_a_log_is_told_in_its_window() {
    let mut log = Log::of(6, QUIET, |_, _| ());
    for row in 400..410 {
        log.0[4][row] = f64::NAN;
    }
    log.0[0][800] = log.0[0][799];
    log.0[0][850] = f64::INFINITY;
    log.0[0].swap(900, 901);
    let log = log.without(1400..1420);
    let windows = follow(tracker(Method::LeastSquares), &log);
    assert_eq!(windows.len(), 6);
    assert!(windows.iter().all(|w| w.status == Status::Estimated));
    assert!(windows[0].notes.is_empty() && windows[5].notes.is_empty());
    assert!(
        told(&windows[1], "10 rows without a usable value, the first in column 'i_q'"),
        "{:?}",
        windows[1].notes
    );
    assert_eq!(windows[1].samples, SAMPLES - 10);
    for words in
        ["1 row with the time of the row before", "1 row without a usable time", "1 row out of order"]
    {
        assert!(told(&windows[2], words), "{words}: {:?}", windows[2].notes);
    }
    assert!(told(&windows[4], "one gap in time"), "{:?}", windows[4].notes);
    for window in &windows {
        let r_s = window.get("r_s").unwrap();
        assert!((r_s.value.unwrap() - 0.17).abs() < 4.5 * r_s.stderr.unwrap(), "{window:?}");
    }
}

#[test]
fn windows_without_enough_samples_are_skipped_and_say_so() {
    let log = Log::of(8, QUIET, |_, _| ());
    // Most of window 1 is missing, all of 3 and 4, and the log ends early in 7.
    let cut = log.without(SAMPLES + 20..2 * SAMPLES).without(2 * SAMPLES + 20..4 * SAMPLES + 20);
    let short = cut.len() - SAMPLES + 30;
    let cut = cut.without(short..cut.len());
    let windows = follow(tracker(Method::LeastSquares), &cut);
    let of: Vec<(u64, Status)> = windows.iter().map(|w| (w.window, w.status)).collect();
    let (yes, no) = (Status::Estimated, Status::Skipped);
    assert_eq!(of, [(0, yes), (1, no), (2, yes), (3, no), (4, yes), (5, yes), (6, no)]);
    assert!(
        windows[1].why.as_ref().unwrap().contains("only 20 usable samples of 330"),
        "{:?}",
        windows[1].why
    );
    assert!(told(&windows[3], "the length of 2 windows"), "{:?}", windows[3].notes);
    assert!((windows[4].t_start - 0.165).abs() < 1e-9);
    assert!(windows[6].why.as_ref().unwrap().contains("only 30 usable samples"));
    assert_eq!((&windows[6].drift.looks_like, windows[6].parameters.len()), (&None, 0));
}

#[test]
fn a_log_that_begins_again_is_followed_on() {
    let log = Log::of(4, QUIET, |_, _| ());
    let mut again = log.clone();
    for (column, more) in again.0.iter_mut().zip(&log.0) {
        column.truncate(2 * SAMPLES + 200);
        column.extend_from_slice(more);
    }
    let windows = follow(tracker(Method::LeastSquares), &again);
    assert_eq!(windows.len(), 7);
    assert!(windows.iter().all(|w| w.status == Status::Estimated));
    assert!(
        told(&windows[2], "time ran back") && told(&windows[2], "61 % of its samples"),
        "{:?}",
        windows[2].notes
    );
    assert!(told(&windows[3], "began again"), "{:?}", windows[3].notes);
    assert_eq!((windows[3].t_start, windows[3].window), (0.0, 3));
}

#[test]
fn a_model_that_leaves_something_out_is_called_a_mismatch() {
    let log = Log::of(4, QUIET, |_, plant| plant.shaft = Some([0.6, 60.0, 0.01]));
    let windows = follow(tracker(Method::LeastSquares), &log);
    for window in &windows[1..] {
        assert_eq!(window.drift.looks_like, Some(vec![Cause::Mismatch]), "{}", window.drift.sentence);
        assert!(window.drift.sentence.contains("times its noise"));
    }
}

#[test]
fn an_interrupted_update_takes_nothing_in() {
    let log = Log::of(3, QUIET, |_, _| ());
    let whole = follow(tracker(Method::Swarm), &log);
    let mut tracker = tracker(Method::Swarm);
    let stop = StopFlag::default();
    stop.stop();
    let before = tracker.clone();
    assert_eq!(tracker.update(&log.rows(0, log.len()), &stop), Err(Error::Interrupted));
    assert_eq!(tracker, before);
    assert_eq!(follow(tracker, &log), whole);
}

#[test]
fn state_does_not_grow_with_time() {
    let log = Log::of(1, QUIET, |_, _| ());
    let mut running = tracker(Method::LeastSquares);
    let mut sizes = Vec::new();
    for round in 0..400 {
        let mut now = log.clone();
        now.0[0].iter_mut().for_each(|t| *t += 0.033 * f64::from(round));
        running.update(&now.rows(0, now.len()), &Silent).unwrap();
        if round >= 99 && (round + 1) % 100 == 0 {
            sizes.push(running.state().unwrap().len());
        }
    }
    let (least, most) = (sizes.iter().min().unwrap(), sizes.iter().max().unwrap());
    assert!(most - least < 8_000, "{sizes:?}");
}

#[test]
fn what_is_no_state_is_refused() {
    let log = Log::of(2, QUIET, |_, _| ());
    let mut running = tracker(Method::LeastSquares);
    running.update(&log.rows(0, 500), &Silent).unwrap();
    let state = running.state().unwrap();
    assert_eq!(Tracker::restore(&state).unwrap(), running);
    let refused = |text: &str| Tracker::restore(text).unwrap_err().to_string();
    assert!(refused("").contains("no state"));
    assert!(refused(&state[..state.len() / 2]).contains("no state"));
    assert!(refused(&state.replace("tracker/1", "tracker/9")).contains("schema"));
    assert!(refused(&state.replace("0.033", "0.034")).contains("checksum"));
    assert!(refused(&state.replacen("\"seed\":1", "\"seed\":2", 1)).contains("checksum"));
    assert!(refused(&state.replacen("\"seed\"", "\"sead\"", 1)).contains("cannot be read"));
    assert!(refused(&"[".repeat(100_000)).contains("no state"));
}

#[test]
fn streams_that_cannot_be_used_are_refused_at_once() {
    let log = Log::of(1, QUIET, |_, _| ());
    let all = log.rows(0, 100);
    let mut running = tracker(Method::LeastSquares);
    assert!(matches!(running.update(&all[1..], &Silent), Err(Error::Column { .. })), "no time");
    let odd = [("t", all[0].1), ("speed", all[1].1)];
    assert!(matches!(running.update(&odd, &Silent), Err(Error::Unknown { .. })));
    let uneven = [("t", all[0].1), ("i_d", &all[1].1[1..])];
    assert!(matches!(running.update(&uneven, &Silent), Err(Error::Column { .. })));
    running.update(&all, &Silent).unwrap();
    let error = running.update(&all[..5], &Silent).unwrap_err();
    assert!(error.to_string().contains("omega_e"), "{error}");
    for wrong in [f64::NAN, 0.0, -1.0, 1e9] {
        let settings = Settings { window: wrong, ..Settings::default() };
        assert!(Tracker::new(Plant::liu().nameplate([1.0; 6]), settings).is_err());
    }
    let useless = [("t", all[0].1), ("v_d", all[1].1), ("v_q", all[2].1)];
    let mut blind = tracker(Method::LeastSquares);
    blind.update(&useless, &Silent).unwrap();
    let error = blind.finish(&Silent).unwrap_err();
    assert!(error.to_string().contains("omega_e"), "{error}");
}
