//! What a log does to a column: it rounds values to whole steps, and holds them for several rows. Both are read from the values alone.

/// Share of a column's range below which values are the same: single precision, with room for a scale applied to it.
const SAME: f64 = 1e-6;
/// Steps must exceed that by this factor, or they are rounding of the numbers themselves.
const COARSE: f64 = 8.0;
/// How far a difference of values may be from a whole number of steps, share of a step.
const WHOLE: f64 = 0.1;
/// Longest hold that is looked for, rows.
const LONGEST: usize = 1000;
/// Fewest changes of a value from which a hold is read, and the share of them that must come at the same row of each hold.
const CHANGES: usize = 32;
const REGULAR: f64 = 0.98;

/// The step of which all differences of the values `x` are whole multiples, in their unit; `None` where there is none, as values lie
/// anywhere.
pub fn quantum(x: &[f64]) -> Option<f64> {
    let mut sorted = x.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let (low, high) = (*sorted.first()?, *sorted.last()?);
    let same = SAME * (high - low).max(low.abs()).max(high.abs());
    let mut levels = vec![low];
    for value in sorted {
        if value - levels[levels.len() - 1] > same {
            levels.push(value);
        }
    }
    let differences = || levels.windows(2).map(|w| w[1] - w[0]);
    let least = differences().fold(f64::INFINITY, f64::min);
    if levels.len() < 3 || least <= COARSE * same {
        return None;
    }
    // The mean over many steps is sharper than the smallest one.
    let (mut sum, mut count) = (0.0, 0.0);
    for difference in differences().filter(|d| *d < 1.5 * least) {
        (sum, count) = (sum + difference, count + 1.0);
    }
    let step = sum / count;
    let whole = |d: f64| (d / step - (d / step).round()).abs() < WHOLE;
    differences().all(whole).then_some(step)
}

/// Standard deviation of the error of values that were rounded to steps of `quantum`.
pub fn rounding(quantum: f64) -> f64 {
    quantum / 12f64.sqrt()
}

/// Rows for which the values of columns of one length are held together, and the first row with a new value. It is one where every row has
/// its own. Time grows with the number of rows alone: a longer hold has as many fewer changes.
pub fn held_rows(columns: &[&[f64]]) -> (usize, usize) {
    let count = columns.first().map_or(0, |x| x.len());
    let changes: Vec<usize> = (1..count).filter(|k| columns.iter().any(|x| x[*k] != x[*k - 1])).collect();
    if changes.len() < CHANGES {
        return (1, 0);
    }
    let first = |rows: usize| {
        let mut counts = vec![0; rows];
        changes.iter().for_each(|k| counts[k % rows] += 1);
        let (first, most) = counts.into_iter().enumerate().max_by_key(|(_, count)| *count)?;
        (most as f64 >= REGULAR * changes.len() as f64).then_some((rows, first))
    };
    let longest = (count as f64 / (REGULAR * changes.len() as f64)) as usize + 1;
    (2..=longest.min(LONGEST)).rev().find_map(first).unwrap_or((1, 0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::normal_pair;

    #[test]
    fn steps_and_holds_are_read_from_the_values() {
        let moving = |k: usize| 100.0 * (1e-3 * k as f64).sin() + 0.3 * normal_pair(5, [k as u32, 0, 0, 0]).0;
        let x: Vec<f64> = (0..5000).map(moving).collect();
        assert!(quantum(&x).is_none() && held_rows(&[&x]) == (1, 0));
        let steps: Vec<f64> = x.iter().map(|x| f64::from((0.25 * (x / 0.25).round()) as f32) + 3.0).collect();
        assert!((quantum(&steps).unwrap() - 0.25).abs() < 1e-4);
        let held: Vec<f64> = (0..5000).map(|k| x[(k + 3) / 7 * 7]).collect();
        assert_eq!(held_rows(&[&held]), (7, 4));
        // One that changes in between holds no row back.
        assert_eq!(held_rows(&[&held, &x]), (1, 0));
        // A value that hardly changes is not held.
        let still: Vec<f64> = (0..5000).map(|k| f64::from(k > 700)).collect();
        assert!(held_rows(&[&still]) == (1, 0) && quantum(&vec![2.0; 50]).is_none());
    }
}
