//! Noise of a signal from the differences of its samples.

/// Samples of a stretch over which noise is compared: short beside a transient.
const STRETCH: usize = 64;
/// Ratio of the mean square of all differences to that of the median stretch up to which both are noise alone. Transients exceed it.
const LOUD: f64 = 1.2;

/// Standard deviation of white noise on a smooth signal, from third differences (binomial weights 1, 3, 3, 1: the
/// variance of the difference is 20 times that of the noise). A cubic drops out entirely; where transients that do not drop out make
/// some stretches much louder, the quieter ones count.
pub fn white_noise(x: &[f64]) -> f64 {
    if x.len() < 4 {
        return 0.0;
    }
    let squares: Vec<f64> = x.windows(4).map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).powi(2)).collect();
    let mean = |s: &[f64]| s.iter().sum::<f64>() / s.len() as f64;
    let whole = mean(&squares);
    let mut stretches: Vec<f64> = squares.chunks_exact(STRETCH).map(mean).collect();
    let square = if stretches.is_empty() {
        whole
    } else {
        let middle = stretches.len() / 2;
        let median = *stretches.select_nth_unstable_by(middle, f64::total_cmp).1;
        if whole > LOUD * median && median > 0.0 { median } else { whole }
    };
    (square / 20.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::normal;

    #[test]
    fn third_differences_see_the_noise_and_not_the_signal() {
        let x: Vec<f64> = (0..20_000)
            .map(|k| {
                let t = f64::from(k) * 1e-3;
                100.0 * (0.5 * t).sin() + 3.0 * t * t + 0.2 * normal(7, [k, 0, 0, 0])
            })
            .collect();
        assert!((white_noise(&x) / 0.2 - 1.0).abs() < 0.03, "{}", white_noise(&x));
        assert!(white_noise(&(0..100).map(f64::from).collect::<Vec<_>>()) < 1e-12);
    }
}
