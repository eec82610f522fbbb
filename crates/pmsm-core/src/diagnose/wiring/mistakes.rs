//! What may have been mistaken when a log was made, and what undoes it.

use crate::diagnose::nameplate::{self, Scaled};
use crate::figures::figure;
use crate::recording::Recording;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Columns by name.
pub(super) type Columns = BTreeMap<&'static str, Vec<f64>>;
type Undo = Box<dyn Fn(&mut Columns) -> bool + Send + Sync>;

/// A mistake in words ("the log reads as if …"), and what undoes it; false where it cannot have been made.
pub(super) struct Mistake {
    pub(super) words: String,
    /// Whether it shifts columns in time, which delays and lags resemble.
    pub(super) of_time: bool,
    /// Whether it shows in the motion alone.
    pub(super) of_motion: bool,
    undo: Undo,
}

impl Mistake {
    fn new(words: impl Into<String>, undo: impl Fn(&mut Columns) -> bool + Send + Sync + 'static) -> Self {
        Self { words: words.into(), of_time: false, of_motion: false, undo: Box::new(undo) }
    }

    /// One that moves these columns down by `rows`.
    fn shifting(words: String, names: &'static [&'static str], rows: isize) -> Self {
        Self { of_time: true, ..Self::new(words, move |c| shift(c, names, rows)) }
    }

    /// The recording without it.
    pub(super) fn undone(&self, recording: &Recording) -> Option<Recording> {
        let mut columns: Columns = recording
            .names()
            .into_iter()
            .filter_map(|name| Some((name, recording.column(name)?.to_vec())))
            .collect();
        let made = (self.undo)(&mut columns);
        let columns = columns.into_iter().map(|(name, x)| (name.to_string(), x)).collect();
        if made { Recording::new(columns, Some(recording.load())).ok() } else { None }
    }
}

/// Most rows by which voltages and currents may have been logged apart.
const APART: isize = 5;
const I: [&str; 5] = ["i_a", "i_b", "i_c", "i_d", "i_q"];
const V: [&str; 5] = ["v_a", "v_b", "v_c", "v_d", "v_q"];

/// Voltages that were logged so many rows late, and so act before they are there, which no effect does.
pub(super) fn voltages_late() -> Vec<Mistake> {
    let late = |rows| {
        let by = rows_in_words(rows);
        let words = format!("the voltages were logged {by} late, or the currents {by} early");
        Mistake::shifting(words, &V, -rows)
    };
    (1..=APART).map(late).collect()
}

/// Voltages that were logged so many rows early, which a delay of the inverter resembles.
pub(super) fn voltages_early() -> Vec<Mistake> {
    let early =
        |rows| Mistake::shifting(format!("the voltages were logged {} early", rows_in_words(rows)), &V, rows);
    (1..=APART).map(early).collect()
}

/// Currents that were logged so many rows late, which a lag of the sensors resembles.
pub(super) fn currents_late() -> Vec<Mistake> {
    let late =
        |rows| Mistake::shifting(format!("the currents were logged {} late", rows_in_words(rows)), &I, -rows);
    (1..=APART).map(late).collect()
}

fn rows_in_words(rows: isize) -> String {
    if rows == 1 { "one row".into() } else { format!("{rows} rows") }
}

/// The mistake of currents, voltages or both that were logged `factor` times too large, or of so many times too many pole pairs, of which
/// the machine file states `n_p`. `link` is the voltage of the DC link where it is stated, V.
pub(super) fn scaled(what: Scaled, factor: f64, n_p: u32, link: Option<f64>) -> Mistake {
    let (logged, [i, v]) = match what {
        Scaled::Voltages => ("the voltages were", [false, true]),
        Scaled::Currents => ("the currents were", [true, false]),
        Scaled::Both => ("currents and voltages were", [true, true]),
        Scaled::PolePairs => ("", [false, false]),
    };
    let words = if what == Scaled::PolePairs {
        format!("n_p was {} and not {n_p}", f64::from(n_p) / factor)
    } else if factor > 1.0 {
        format!("{logged} {} times too large", factor_in_words(factor))
    } else {
        let of_link = link.filter(|_| what == Scaled::Voltages).and_then(|v| nameplate::of_link(factor, v));
        let share = of_link.map_or(String::new(), |share| format!(" ({share})"));
        format!("{logged} {} times too small{share}", factor_in_words(1.0 / factor))
    };
    Mistake::new(words, move |c| {
        let currents = !i || scale(c, &I, 1.0 / factor);
        currents && (!v || scale(c, &V, 1.0 / factor))
    })
}

/// A factor as a whole number, or as the root of a multiple of a half, such as √3.
fn factor_in_words(factor: f64) -> String {
    let halves = (2.0 * factor * factor).round();
    let root = (0.5 * halves).sqrt();
    if root.fract() != 0.0 && (root - factor).abs() < 1e-9 {
        format!("√{}", 0.5 * halves)
    } else {
        figure(factor, 3)
    }
}

/// All mistakes that are looked for in the log of a machine with `n_p` pole pairs.
pub(super) fn mistakes(n_p: u32) -> Vec<Mistake> {
    const TURN: [&str; 4] = ["theta_e", "theta_m", "omega_e", "omega_m"];
    let mut out = vec![
        Mistake::new("all currents had the opposite sign", |c| negate(c, &I)),
        Mistake::new("all voltages had the opposite sign", |c| negate(c, &V)),
        Mistake::new("the speed had the opposite sign", |c| !angle(c) && negate(c, &TURN)),
        Mistake::new("the angle and the speed had the opposite sign", |c| angle(c) && negate(c, &TURN)),
        // Beside an angle the speed is held against its change.
        Mistake::new("the speed was in rpm and not in rad/s", |c| !angle(c) && scale(c, &TURN, TAU / 60.0)),
        Mistake::new(format!("omega_e was the mechanical speed and not {n_p} times that"), move |c| {
            n_p > 1 && !angle(c) && scale(c, &["omega_e"], f64::from(n_p))
        }),
        Mistake::new(format!("omega_m was the electrical speed, {n_p} times the mechanical one"), move |c| {
            n_p > 1 && !angle(c) && scale(c, &["omega_m"], 1.0 / f64::from(n_p))
        }),
        Mistake::new("i_d and i_q were interchanged", |c| interchange(c, "i_d", "i_q")),
        Mistake::new("v_d and v_q were interchanged", |c| interchange(c, "v_d", "v_q")),
        Mistake::new("d and q were interchanged", |c| {
            interchange(c, "i_d", "i_q") && interchange(c, "v_d", "v_q")
        }),
        Mistake::new("i_q and v_q had the opposite sign", |c| negate(c, &["i_q"]) && negate(c, &["v_q"])),
        Mistake::new("i_d and v_d had the opposite sign", |c| negate(c, &["i_d"]) && negate(c, &["v_d"])),
        Mistake::new("v_a, v_b and v_c were voltages between the lines a–b, b–c and c–a", |c| {
            let [Some(ab), Some(bc), Some(ca)] = ["v_a", "v_b", "v_c"].map(|name| c.get(name).cloned())
            else {
                return false;
            };
            for (name, (x, y)) in [("v_a", (&ab, &ca)), ("v_b", (&bc, &ab)), ("v_c", (&ca, &bc))] {
                c.insert(name, x.iter().zip(y).map(|(x, y)| (x - y) / 3.0).collect());
            }
            true
        }),
    ];
    let of_load = Mistake::new("tau_m had the opposite sign", |c| negate(c, &["tau_m"]));
    out.push(Mistake { of_motion: true, ..of_load });
    for (words, rows) in [("late", -1), ("early", 1)] {
        let of_angle = move |c: &mut Columns| phases(c) && shift(c, &["theta_e", "theta_m"], rows);
        let mistake = Mistake::new(format!("the angle was logged one row {words}"), of_angle);
        out.push(Mistake { of_time: true, ..mistake });
    }
    out.extend(voltages_late());
    out.extend(voltages_early());
    out.extend(currents_late());
    for name in ["i_a", "i_b", "i_c", "i_d", "i_q", "v_a", "v_b", "v_c", "v_d", "v_q"] {
        out.push(Mistake::new(format!("{name} had the opposite sign"), move |c| negate(c, &[name])));
    }
    for (one, other) in [(0, 1), (1, 2), (0, 2)] {
        let (i, v) = ([I[one], I[other]], [V[one], V[other]]);
        let words = format!("{} and {} were interchanged", v[0], v[1]);
        out.push(Mistake::new(words, move |c| interchange(c, v[0], v[1])));
        let words = format!("{} and {} were interchanged", i[0], i[1]);
        out.push(Mistake::new(words, move |c| interchange(c, i[0], i[1])));
        let words = format!("the phases {} and {} were interchanged", &i[0][2..], &i[1][2..]);
        out.push(Mistake::new(words, move |c| interchange(c, i[0], i[1]) && interchange(c, v[0], v[1])));
    }
    for (quantity, names) in [("currents", I), ("voltages", V)] {
        for (words, order) in [("b, c, a", [2, 0, 1]), ("c, a, b", [1, 2, 0])] {
            let words = format!("the {quantity} of the phases {words} were in the columns of a, b, c");
            out.push(Mistake::new(words, move |c| reorder(c, [names[0], names[1], names[2]], order)));
        }
    }
    for twelfths in (-5..=6).filter(|k| *k != 0) {
        let degrees = 30 * i32::abs(twelfths);
        let (size, place) = if twelfths > 0 { ("large", "ahead of") } else { ("small", "behind") };
        let angle = TAU * f64::from(twelfths) / 12.0;
        let words = format!("theta_e was {degrees}° too {size}");
        out.push(Mistake::new(words, move |c| phases(c) && turn_angle(c, angle, f64::from(n_p))));
        if degrees % 90 == 0 {
            let words = format!("d and q were those of an axis {degrees}° {place} the magnet");
            out.push(Mistake::new(words, move |c| turn_frame(c, angle)));
        }
    }
    out
}

/// Whether currents or voltages were logged by phase, so that the angle says where the rotor sees them.
fn phases(c: &Columns) -> bool {
    c.contains_key("i_a") || c.contains_key("v_a")
}

/// Whether an angle was logged.
fn angle(c: &Columns) -> bool {
    c.contains_key("theta_e") || c.contains_key("theta_m")
}

pub(super) fn negate(c: &mut Columns, names: &[&'static str]) -> bool {
    scale(c, names, -1.0)
}

pub(super) fn scale(c: &mut Columns, names: &[&'static str], factor: f64) -> bool {
    let mut any = false;
    for name in names {
        let Some(x) = c.get_mut(name) else { continue };
        x.iter_mut().for_each(|x| *x *= factor);
        any = true;
    }
    any
}

pub(super) fn interchange(c: &mut Columns, one: &'static str, other: &'static str) -> bool {
    let (Some(x), Some(y)) = (c.remove(one), c.remove(other)) else { return false };
    c.insert(one, y);
    c.insert(other, x);
    true
}

/// Puts into column k what is in column `order[k]`.
fn reorder(c: &mut Columns, names: [&'static str; 3], order: [usize; 3]) -> bool {
    let [Some(x), Some(y), Some(z)] = names.map(|name| c.get(name).cloned()) else { return false };
    let given = [x, y, z];
    for k in 0..3 {
        c.insert(names[k], given[order[k]].clone());
    }
    true
}

/// Moves columns down by `rows`; the rows that are not told keep their neighbour's value.
fn shift(c: &mut Columns, names: &[&'static str], rows: isize) -> bool {
    let by = rows.unsigned_abs();
    let mut any = false;
    for name in names {
        let Some(x) = c.get_mut(name).filter(|x| x.len() > by) else { continue };
        let n = x.len();
        if rows > 0 {
            x.rotate_right(by);
            let first = x[by];
            x[..by].fill(first);
        } else {
            x.rotate_left(by);
            let last = x[n - 1 - by];
            x[n - by..].fill(last);
        }
        any = true;
    }
    any
}

pub(super) fn turn_angle(c: &mut Columns, by: f64, n_p: f64) -> bool {
    let mut any = false;
    for (name, by) in [("theta_e", by), ("theta_m", by / n_p)] {
        let Some(x) = c.get_mut(name) else { continue };
        x.iter_mut().for_each(|x| *x -= by);
        any = true;
    }
    any
}

pub(super) fn turn_frame(c: &mut Columns, by: f64) -> bool {
    let (sin, cos) = by.sin_cos();
    for (d, q) in [("i_d", "i_q"), ("v_d", "v_q")] {
        let (Some(x), Some(y)) = (c.get(d).cloned(), c.get(q).cloned()) else { return false };
        c.insert(d, x.iter().zip(&y).map(|(x, y)| x * cos - y * sin).collect());
        c.insert(q, x.iter().zip(&y).map(|(x, y)| x * sin + y * cos).collect());
    }
    true
}
