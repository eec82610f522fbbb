//! A log that was written more often than its signals were read: each row repeats the one before until all of them are read anew.

use super::{GAP, GAP_MECHANICAL, Recording, check_time, has_voltages, kind};
use crate::numerics::steps::held_rows;
use std::collections::BTreeMap;

impl Recording {
    /// The rows in which the values are new, where every column is held together with the others for several rows; `None` where they are not,
    /// or where so few rows stay that they are no recording of the same kind.
    pub(crate) fn rows_with_new_values(&self) -> Option<Self> {
        let signals: Vec<&[f64]> =
            self.columns.iter().filter(|(name, _)| **name != "t").map(|(_, x)| x.as_slice()).collect();
        let (rows, first) = held_rows(&signals);
        if rows == 1 {
            return None;
        }
        let picked = |x: &Vec<f64>| x.iter().skip(first).step_by(rows).copied().collect();
        let columns: BTreeMap<&'static str, Vec<f64>> =
            self.columns.iter().map(|(name, x)| (*name, picked(x))).collect();
        let gap = if has_voltages(&self.columns) { GAP } else { GAP_MECHANICAL };
        let (period, segments) = check_time(&columns["t"], gap).ok()?;
        let same = kind::of(&columns, period, self.load).is_ok_and(|kind| kind == self.kind);
        let Self { load, kind, angle_error, .. } = *self;
        same.then_some(Self { columns, load, period, segments, kind, angle_error, held: rows })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_whose_columns_are_held_together_is_read_at_its_new_values() {
        let n = 4000;
        let column = |name: &str, held: usize, f: fn(f64) -> f64| {
            let x = (0..n).map(|k| f(1e-4 * ((k + 2) / held * held) as f64)).collect();
            (name.to_string(), x)
        };
        let log = |held: usize, speed: usize| {
            let columns = vec![
                column("t", 1, |t| t),
                column("i_d", held, |t| (31.0 * t).sin()),
                column("i_q", held, |t| (57.0 * t).cos()),
                column("omega_e", speed, |t| 90.0 * (19.0 * t).sin()),
            ];
            Recording::new(columns, None).unwrap()
        };
        let new = log(8, 8).rows_with_new_values().unwrap();
        assert!((new.period() / 8e-4 - 1.0).abs() < 1e-9 && new.held() == 8, "{}", new.period());
        // Each value stands where it was read.
        let at = |k: usize| 90.0 * (19.0 * new.t()[k]).sin();
        assert!((0..new.len()).all(|k| (new.column("omega_e").unwrap()[k] - at(k)).abs() < 1e-9));
        assert!(log(8, 1).rows_with_new_values().is_none() && log(1, 1).rows_with_new_values().is_none());
    }
}
