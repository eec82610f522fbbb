//! A speed that wanders: what noise of the currents does to a simulated rotor, and the filter that takes it out of what is left.
//!
//! Noise of the torque adds up in the speed. What a perfect model leaves within a window is
//!
//! > x_{k+1} = x_k + w_k,  e_k = x_k + n_k,
//!
//! w of variance q, n of variance r. The Kalman filter of that, as it is once it has settled, turns e into white innovations
//!
//! > ε_k = e_k − x̂_k,  x̂_{k+1} = x̂_k + K·ε_k,  K = P/(P + r),  P = q/2 + √(q²/4 + q·r),
//!
//! of variance P + r. Where x begins is left to the one who fits it: the filter is linear. Source: Anderson & Moore, "Optimal filtering"
//! (1979), chapters 4 and 9.
//!
//! The share κ = K/(2 − K) of the innovations' variance is noise of the torque, which a larger inertia lets through less. Over n samples
//! that is worth 2·n·κ·δ to an inertia larger by the share δ, against I·δ² that it costs, with the information I on ln j: it comes out too
//! large by n·κ/I, of which [`Wander::bias`] is the ratio to its standard error, I^(−1/2).

use std::ops::Range;

/// How a simulated speed wanders, and the filter that turns what is left of it into innovations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wander {
    /// K, the share of what is new that stays.
    gain: f64,
    /// Standard deviation of the innovations, rad/s.
    deviation: f64,
}

impl Wander {
    /// For a sensor whose noise has the standard deviation `sensor`, and a rotor that noise moves from one sample to the next by steps of
    /// standard deviation `step`, both rad/s.
    pub fn new(sensor: f64, step: f64) -> Self {
        let (r, q) = (sensor * sensor, step * step);
        let p = 0.5 * q + (0.25 * q * q + q * r).sqrt();
        Self { gain: p / (p + r), deviation: (p + r).sqrt() }
    }

    /// Turns a signal into its innovations, as large in units of their standard deviation as it was in units of `floor`, rad/s.
    pub fn whiten(&self, floor: f64, x: &mut [f64]) {
        let (mut expected, scale) = (0.0, floor / self.deviation);
        for x in x {
            let new = *x - expected;
            expected += self.gain * new;
            *x = scale * new;
        }
    }

    /// Largest bias of an inertia fitted to innovations, in its standard errors, if torque alone moved the rotor along its measured speed
    /// (rad/s) within the windows.
    pub fn bias(&self, omega_e: &[f64], windows: &[Range<usize>]) -> f64 {
        let (mut information, mut samples) = (0.0, 0.0);
        for window in windows.iter().filter(|w| !w.is_empty()) {
            let own = &omega_e[window.clone()];
            let mut moved: Vec<f64> = own.iter().map(|w| w - own[0]).collect();
            self.whiten(1.0, &mut moved);
            information += moved.iter().map(|x| x * x).sum::<f64>();
            samples += moved.len() as f64;
        }
        let driven = samples * self.gain / (2.0 - self.gain);
        // The sensor's own noise, the rest of the innovations' variance, tells nothing.
        driven / (information - (samples - driven)).max(1.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::normal_pair;

    fn wandering(n: u32, sensor: f64, step: f64) -> Vec<f64> {
        let mut x = 3.0;
        let sample = |k| {
            let (own, moved) = normal_pair(11, [k, 0, 0, 0]);
            x += step * moved;
            x + sensor * own
        };
        (0..n).map(sample).collect()
    }

    #[test]
    fn innovations_are_white_and_as_large_as_they_say() {
        for (sensor, step) in [(0.3, 0.01), (0.3, 0.2), (1e-6, 0.5)] {
            let mut x = wandering(40_000, sensor, step);
            Wander::new(sensor, step).whiten(1.0, &mut x);
            // Behind the first samples, which tell where it began.
            let settled = &x[1000..];
            let mean = |lag: usize| {
                let products = settled.iter().zip(&settled[lag..]).map(|(a, b)| a * b);
                products.sum::<f64>() / (settled.len() - lag) as f64
            };
            assert!((mean(0) - 1.0).abs() < 0.03, "{step}: {}", mean(0));
            assert!([1, 2, 30].into_iter().all(|lag| mean(lag).abs() < 0.02), "{step}");
            // Sums over many samples grow as those of white noise do.
            let sums = settled.chunks_exact(500).map(|c| c.iter().sum::<f64>().powi(2) / 500.0);
            let slow = sums.sum::<f64>() / (settled.len() / 500) as f64;
            assert!((slow - 1.0).abs() < 0.5, "{step}: {slow}");
        }
    }

    #[test]
    fn what_does_not_wander_stays_as_it_is() {
        let x = wandering(100, 0.3, 0.0);
        let mut same = x.clone();
        Wander::new(0.5, 0.0).whiten(0.5, &mut same);
        assert_eq!(same, x);
    }

    #[test]
    fn an_inertia_is_misjudged_by_as_much_as_is_said() {
        // Speed from a noisy torque that swings, and the inertia by least squares on its innovations: e = ω·j₀/j − measured.
        let (n, sensor, step) = (4000, 0.3, 0.06);
        let wander = Wander::new(sensor, step);
        let (mut off, mut said) = (0.0, 0.0);
        for draw in 0..40 {
            let (mut moved, mut true_speed, mut measured) = (vec![0.0; n], 0.0, vec![0.0; n]);
            let mut simulated = 0.0;
            for k in 0..n {
                let (own, push) = normal_pair(13, [k as u32, draw, 0, 0]);
                let torque = 0.2 * (2e-3 * k as f64).sin();
                simulated += torque + step * push;
                true_speed += torque;
                (moved[k], measured[k]) = (simulated, true_speed + sensor * own);
            }
            said += wander.bias(&measured, std::slice::from_ref(&(0..n))) / 40.0;
            let whitened = |x: &[f64]| {
                let mut x = x.to_vec();
                wander.whiten(1.0, &mut x);
                x
            };
            let (a, b) = (whitened(&moved), whitened(&measured));
            let square: f64 = a.iter().map(|x| x * x).sum();
            let share = a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>() / square;
            off += (1.0 / share - 1.0) * square.sqrt() / 40.0;
        }
        assert!(said > 1.0 && (off / said - 1.0).abs() < 0.3, "{off} {said}");
    }
}
