//! The colour of a residual: an autoregression that turns it into white noise.
//!
//! > w_k = √(v_p/v_m)·(x_k − Σ_j a_m,j·x_{k−j}),  j = 1 … m,  m = min(k, p).
//!
//! The coefficients a_m of all orders m up to p, and the variances v_m that they leave, follow from the autocovariance by the
//! Levinson–Durbin recursion. The first p samples of a run are predicted by the lower orders and scaled to the variance of the
//! others, which whitens a stationary series exactly. The order is that of the smallest Bayesian information criterion: one
//! suffices for torque errors that add up in a speed, two and more for what swings. The autocovariance of short runs blunts a
//! resonance that outlasts them, so that some of its colour stays. Source: Brockwell & Davis, "Time series:
//! theory and methods", 2nd ed. (1991), sections 5.2 and 9.3.

use std::ops::Range;

/// Highest order, and the share of a run that it may reach back over.
const HIGHEST: usize = 30;
const REACH: usize = 8;

/// An autoregression by its predictors of all orders.
#[derive(Debug, Clone, PartialEq)]
pub struct Colour {
    /// Predictor of each order 0, 1, …, p: weights of the last, the last but one, … sample.
    predictors: Vec<Vec<f64>>,
    /// √(v_p/v_m) of each order m, v_m being the variance that its predictor leaves.
    scale: Vec<f64>,
}

impl Colour {
    /// The colour of `x` over `runs` of samples; `None` if it is not stationary enough to have one.
    pub fn of(x: &[f64], runs: &[Range<usize>]) -> Option<Self> {
        let shortest = runs.iter().map(Range::len).min()?;
        let highest = HIGHEST.min(shortest / REACH);
        let covariance = |lag: usize| -> f64 {
            runs.iter().flat_map(|r| (r.start + lag..r.end).map(|k| x[k] * x[k - lag])).sum()
        };
        let covariances: Vec<f64> = (0..=highest).map(covariance).collect();
        let count = runs.iter().map(Range::len).sum::<usize>() as f64;
        let (predictors, variances) = levinson(&covariances)?;
        let cost = |order: &usize| count * variances[*order].ln() + *order as f64 * count.ln();
        let order = (0..variances.len()).min_by(|a, b| cost(a).total_cmp(&cost(b)))?;
        let scale = variances[..=order].iter().map(|v| (variances[order] / v).sqrt()).collect();
        Some(Self { predictors: predictors[..=order].to_vec(), scale })
    }

    /// Correlation of neighbouring samples.
    pub fn lag_one(&self) -> f64 {
        self.predictors.get(1).map_or(0.0, |first| first[0])
    }

    /// Turns a run into white noise of the variance that the predictor of the highest order leaves.
    pub fn whiten(&self, x: &mut [f64]) {
        let order = self.predictors.len() - 1;
        for k in (0..x.len()).rev() {
            let own = k.min(order);
            let expected: f64 = self.predictors[own].iter().enumerate().map(|(m, a)| a * x[k - 1 - m]).sum();
            x[k] = (x[k] - expected) * self.scale[own];
        }
    }
}

/// Predictors of the orders 0, 1, … and the variances they leave, until nothing is left to predict.
fn levinson(covariances: &[f64]) -> Option<(Vec<Vec<f64>>, Vec<f64>)> {
    let whole = *covariances.first().filter(|c| c.is_finite() && **c > 0.0)?;
    let (mut predictors, mut variances) = (vec![Vec::new()], vec![whole]);
    for order in 1..covariances.len() {
        let (last, variance) = (&predictors[order - 1], variances[order - 1]);
        let known: f64 = last.iter().enumerate().map(|(m, a)| a * covariances[order - 1 - m]).sum();
        let reflection = (covariances[order] - known) / variance;
        let left = variance * (1.0 - reflection * reflection);
        if !(left.is_finite() && left > 1e-12 * whole) {
            break;
        }
        let mut next: Vec<f64> = (0..order - 1).map(|m| last[m] - reflection * last[order - 2 - m]).collect();
        next.push(reflection);
        predictors.push(next);
        variances.push(left);
    }
    Some((predictors, variances))
}

/// Effective number of independent samples of a coloured series: n/(1 + 2Σρ), summed up to the first ρ < 0.05.
pub fn effective_samples(x: &[f64]) -> f64 {
    let n = x.len();
    let energy: f64 = x.iter().map(|v| v * v).sum();
    if energy <= 0.0 {
        return n as f64;
    }
    let correlation = |lag: usize| (0..n - lag).map(|k| x[k] * x[k + lag]).sum::<f64>() / energy;
    // Every lag at first; then ever longer strides, the correlation being smooth by then.
    let (mut colour, mut lag, mut last) = (1.0, 1, 1.0);
    let mut before = 0;
    while lag < n / 2 {
        let rho = correlation(lag);
        if rho < 0.05 {
            break;
        }
        let stride = (lag - before) as f64;
        colour += 2.0 * (rho + (stride - 1.0) * 0.5 * (last + rho));
        (before, last) = (lag, rho);
        lag += 1 + lag / 16;
    }
    (n as f64 / colour).max(2.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::normal_pair;

    /// x_k = 1.5·x_{k−1} − 0.75·x_{k−2} + e_k swings; runs of 400 samples.
    fn swinging() -> (Vec<f64>, Vec<Range<usize>>) {
        let n = 20_000;
        let mut x = vec![0.0; n];
        for k in 2..n {
            x[k] = 1.5 * x[k - 1] - 0.75 * x[k - 2] + normal_pair(3, [k as u32, 0, 0, 0]).0;
        }
        (x, (0..n / 400).map(|r| 400 * r..400 * (r + 1)).collect())
    }

    #[test]
    fn an_autoregression_is_recovered_and_whitened_from_the_first_sample_on() {
        let (mut x, runs) = swinging();
        let colour = Colour::of(&x, &runs).unwrap();
        let found = &colour.predictors[2];
        assert!((found[0] - 1.5).abs() < 0.05 && (found[1] + 0.75).abs() < 0.05, "{found:?}");
        runs.iter().for_each(|r| colour.whiten(&mut x[r.clone()]));
        let mean = |pick: &dyn Fn(usize) -> f64| {
            let all: Vec<f64> = runs
                .iter()
                .flat_map(|r| r.clone().map(|k| (k, r.start)))
                .filter(|(k, s)| k > s)
                .map(|(k, _)| pick(k))
                .collect();
            all.iter().sum::<f64>() / all.len() as f64
        };
        assert!((mean(&|k| x[k] * x[k]) - 1.0).abs() < 0.1);
        assert!(mean(&|k| x[k] * x[k - 1]).abs() < 0.1);
        let opening: f64 =
            runs[1..].iter().flat_map(|r| x[r.start..r.start + 2].to_vec()).map(|w| w * w).sum();
        assert!((opening / (2 * (runs.len() - 1)) as f64 - 1.0).abs() < 0.4);
    }

    #[test]
    fn white_noise_stays_as_it_is() {
        let x: Vec<f64> = (0..5000).map(|k| normal_pair(5, [k, 0, 0, 0]).0).collect();
        let colour = Colour::of(&x, &[0..2500, 2500..5000]).unwrap();
        let mut white = x.clone();
        colour.whiten(&mut white);
        assert_eq!(white, x);
        assert!(Colour::of(&[0.0; 100], &[0..50, 50..100]).is_none());
    }

    #[test]
    fn coloured_series_are_worth_fewer_samples() {
        let white: Vec<f64> = (0..2000).map(|k| normal_pair(3, [k, 0, 0, 0]).0).collect();
        let slow: Vec<f64> = (0..2000).map(|k| (f64::from(k) / 50.0).sin()).collect();
        assert!(effective_samples(&white) > 1500.0);
        assert!(effective_samples(&slow) < 60.0);
    }
}
