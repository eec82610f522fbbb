//! Recordings and experiments for the tests of the speed's derivatives.

use super::{Channel, Experiment};
use crate::machine::Machine;
use crate::model::Model;
use crate::recording::{Load, Recording};
use crate::signals::Signals;
use crate::simulate::mechanical::Nuisance;
use std::borrow::Cow;
use std::ops::Range;

/// A rotor that reverses, sampled every `h` seconds but in the `gap`, s.
pub fn reversing(h: f64, gap: &Range<f64>) -> Signals {
    let t: Vec<f64> = (0..(0.8 / h) as usize).map(|k| k as f64 * h).filter(|t| !gap.contains(t)).collect();
    let column = |f: fn(f64) -> f64| t.iter().map(|t| f(*t)).collect::<Vec<f64>>();
    let columns = [
        ("t", column(|t| t)),
        ("omega_e", column(|t| 400.0 * (9.0 * t).cos())),
        ("theta_e", column(|t| 400.0 / 9.0 * (9.0 * t).sin())),
        ("v_d", column(|t| -5.0 * (20.0 * t).sin())),
        ("v_q", column(|t| 40.0 * (9.0 * t).cos())),
        ("i_d", column(|t| -2.0 + (30.0 * t).sin())),
        ("i_q", column(|t| 4.0 * (14.0 * t).cos())),
    ];
    let columns = columns.map(|(name, x)| (name.to_owned(), x)).to_vec();
    let recording = Recording::new(columns, Some(Load::UnknownPiecewise)).unwrap();
    Signals::new(&recording, &Machine::new(4).unwrap()).unwrap()
}

/// The speed alone compared, from the measured one at the beginning of each of the `windows`.
pub fn of_speed<'a>(
    model: &'a Model,
    signals: &'a Signals,
    nuisance: Nuisance,
    windows: &'a [Range<usize>],
) -> Experiment<'a> {
    Experiment {
        model,
        signals,
        nuisance,
        windows,
        channels: vec![(Channel::OmegaE, 0.1)],
        torque: None,
        starts: Some(Cow::Owned(windows.iter().map(|w| signals.omega_e[w.start]).collect())),
        whitening: None,
        wander: None,
        colour: None,
        held_out: None,
        prior: &[],
    }
}
