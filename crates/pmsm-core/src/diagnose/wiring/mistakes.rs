//! What may have been mistaken when a log was made, and what undoes it.

use crate::recording::Recording;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Columns by name.
pub(super) type Columns = BTreeMap<&'static str, Vec<f64>>;
type Undo = Box<dyn Fn(&mut Columns) -> bool + Send + Sync>;

/// A mistake in words ("the log reads as if …"), and what undoes it; false where it cannot have been made.
pub(super) struct Mistake {
    pub(super) words: String,
    undo: Undo,
}

impl Mistake {
    fn new(words: impl Into<String>, undo: impl Fn(&mut Columns) -> bool + Send + Sync + 'static) -> Self {
        Self { words: words.into(), undo: Box::new(undo) }
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

/// All mistakes that are looked for in the log of a machine with `n_p` pole pairs.
pub(super) fn mistakes(n_p: u32) -> Vec<Mistake> {
    const I: [&str; 5] = ["i_a", "i_b", "i_c", "i_d", "i_q"];
    const V: [&str; 5] = ["v_a", "v_b", "v_c", "v_d", "v_q"];
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
        Mistake::new("the voltages were logged one row early", |c| shift(c, &V, 1)),
        Mistake::new("the currents were logged one row late", |c| shift(c, &I, -1)),
        Mistake::new("the angle was logged one row late", |c| {
            phases(c) && shift(c, &["theta_e", "theta_m"], -1)
        }),
        Mistake::new("the angle was logged one row early", |c| {
            phases(c) && shift(c, &["theta_e", "theta_m"], 1)
        }),
    ];
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

/// Moves columns down by `rows`; the row that is not told keeps its neighbour's value.
fn shift(c: &mut Columns, names: &[&'static str], rows: isize) -> bool {
    let mut any = false;
    for name in names {
        let Some(x) = c.get_mut(name) else { continue };
        if rows > 0 {
            x.rotate_right(1);
            x[0] = x[1];
        } else {
            x.rotate_left(1);
            let n = x.len();
            x[n - 1] = x[n - 2];
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
