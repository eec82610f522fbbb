//! Robust linear regression: from least absolute deviations to Tukey's biweight, under which outliers have no weight at all.

use nalgebra::{DMatrix, DVector};

/// Scatters beyond which a row has no weight: 95 % as efficient as least squares under normal noise.
const BEYOND: f64 = 4.685;
/// Median distance of normal noise from zero, over its standard deviation, inverted.
const OF_MEDIAN: f64 = 1.4826;
/// Rounds of each of both ways of weighting.
const ROUNDS: usize = 40;
/// Share of the largest value below which no scatter is believed.
const ROUNDING: f64 = 1e-9;

/// What a regression found.
#[derive(Debug, Clone)]
pub struct Line {
    /// The coefficients.
    pub found: Vec<f64>,
    /// Their standard errors.
    pub error: Vec<f64>,
    /// What each row is off.
    pub off: Vec<f64>,
    /// Outliers: rows without weight.
    pub outliers: Vec<usize>,
    /// Root mean square of what the other rows are off.
    pub scatter: f64,
}

/// The coefficients of `terms`, one column each, that make up `values`; `None` where they cannot be told apart or are not fewer than the rows.
pub fn line(terms: &[Vec<f64>], values: &[f64]) -> Option<Line> {
    let (rows, count) = (values.len(), terms.len());
    let largest = |x: &[f64]| x.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let scale: Vec<f64> = terms.iter().map(|x| largest(x)).collect();
    if rows <= count || count == 0 || scale.contains(&0.0) {
        return None;
    }
    let a = DMatrix::from_fn(rows, count, |r, c| terms[c][r] / scale[c]);
    let y = DVector::from_column_slice(values);
    let least = (ROUNDING * largest(values)).max(f64::MIN_POSITIVE);
    let normal = |weight: &[f64]| {
        let weighted = DMatrix::from_fn(rows, count, |r, c| weight[r] * a[(r, c)]);
        let inverse = weighted.tr_mul(&a).try_inverse().filter(|x| x.iter().all(|x| x.is_finite()))?;
        let found = &inverse * weighted.tr_mul(&y);
        let off = &y - &a * &found;
        Some((found, off, inverse))
    };
    let median = |off: &DVector<f64>| {
        let mut size: Vec<f64> = off.iter().map(|x| x.abs()).collect();
        size.sort_by(f64::total_cmp);
        size[rows / 2]
    };
    let mut weight = vec![1.0; rows];
    let mut fit = normal(&weight)?;
    for _ in 0..ROUNDS {
        weight = fit.1.iter().map(|x| 1.0 / x.abs().max(least)).collect();
        fit = normal(&weight)?;
    }
    for _ in 0..ROUNDS {
        let limit = BEYOND * (OF_MEDIAN * median(&fit.1)).max(least);
        weight = fit.1.iter().map(|x| (1.0 - (x / limit).powi(2)).max(0.0).powi(2)).collect();
        fit = normal(&weight)?;
    }
    let (found, off, inverse) = fit;
    let kept = weight.iter().filter(|w| **w > 0.0).count();
    let square: f64 = (0..rows).filter(|r| weight[*r] > 0.0).map(|r| off[r] * off[r]).sum();
    let variance = square / kept.saturating_sub(count).max(1) as f64;
    Some(Line {
        found: (0..count).map(|c| found[c] / scale[c]).collect(),
        error: (0..count).map(|c| (variance * inverse[(c, c)]).sqrt() / scale[c]).collect(),
        outliers: (0..rows).filter(|r| weight[*r] == 0.0).collect(),
        scatter: (square / kept.max(1) as f64).sqrt(),
        off: off.iter().copied().collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::normal_pair;

    #[test]
    fn outliers_do_not_change_the_line() {
        let x: Vec<f64> = (0..60).map(|k| 0.1 * f64::from(k) - 3.0).collect();
        let noise = |k: usize| 0.01 * normal_pair(1, [k as u32, 0, 0, 0]).0;
        let mut y: Vec<f64> = x.iter().enumerate().map(|(k, x)| 2.0 * x - 0.5 + noise(k)).collect();
        for k in [3, 58, 59] {
            y[k] = -40.0;
        }
        let line = line(&[x.clone(), vec![1.0; 60]], &y).unwrap();
        assert!((line.found[0] - 2.0).abs() < 0.005 && (line.found[1] + 0.5).abs() < 0.01, "{line:?}");
        assert!(line.outliers.starts_with(&[3]) && line.outliers.ends_with(&[58, 59]), "{:?}", line.outliers);
        assert!((line.scatter / 0.01 - 1.0).abs() < 0.3 && line.error[0] < 0.002, "{line:?}");
        assert!(super::line(&[x.clone(), x], &y).is_none(), "one term twice");
    }
}
