//! Errors with the heavy tails of Student's t: a fit by maximum likelihood with them is a weighted one in which outliers hardly count
//! (Lange, Little & Taylor, "Robust statistical modeling using the t distribution", 1989).

/// Degrees of freedom: four, as that paper proposes where they are not estimated.
const FREEDOM: f64 = 4.0;

/// The weight of an error that is `z` scales large.
pub fn weight(z: f64) -> f64 {
    (FREEDOM + 1.0) / (FREEDOM + z * z)
}

/// One step of the EM algorithm from `scale` towards the scale of these errors.
pub fn next_scale(errors: &[f64], scale: f64) -> f64 {
    let sum: f64 = errors.iter().map(|e| weight(e / scale) * e * e).sum();
    (sum / errors.len().max(1) as f64).sqrt()
}

/// The chance of an error of `z` scales or more, to either side.
pub fn two_sided(z: f64) -> f64 {
    let squared = z * z / FREEDOM;
    let x = z.abs() / (FREEDOM * (1.0 + squared)).sqrt();
    // The distribution function for four degrees of freedom is 1/2 + 3/4·x − x³/4 with x = t/√(t² + 4). What is left of one,
    // (1 − x)²·(2 + x)/2, loses no digits where 1 − x² is 1/(1 + t²/4).
    let short = 1.0 / ((1.0 + squared) * (1.0 + x));
    0.5 * short * short * (2.0 + x)
}

/// By how much larger a variance is than that of normal errors of the same scale and weights.
pub fn of_variance() -> f64 {
    (FREEDOM + 3.0) / (FREEDOM + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tail_is_that_of_the_tables() {
        for (t, chance) in [(0.0, 1.0), (2.776_445, 0.05), (4.604_095, 0.01), (8.610_302, 0.001)] {
            assert!((two_sided(t) / chance - 1.0).abs() < 1e-5, "{t}: {}", two_sided(t));
            assert_eq!(two_sided(-t), two_sided(t));
        }
    }

    #[test]
    fn an_outlier_hardly_widens_the_scale() {
        let normal: Vec<f64> =
            (0..400).map(|k| crate::numerics::random::normal_pair(3, [k, 0, 0, 0]).0).collect();
        let scale = |errors: &[f64]| (0..200).fold(1.0, |scale, _| next_scale(errors, scale));
        let mut with = normal.clone();
        with.push(1e3);
        // Student's t of four degrees fits normal errors with a scale of 0.84.
        assert!((scale(&normal) - 0.84).abs() < 0.06, "{}", scale(&normal));
        assert!((scale(&with) / scale(&normal) - 1.0).abs() < 0.02);
    }
}
