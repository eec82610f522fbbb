//! Periodic parts of what a model leaves: the order that repeats with the angle, the frequency that swings in time.

use crate::diagnose::data::Data;
use crate::noise::colour::effective_samples;
use crate::numerics::real::Real;
use crate::signals::Signals;
use std::f64::consts::TAU;

/// Share of a residual's squares that a periodic part must hold to be named, and its largest chance probability.
const LINE: (f64, f64) = (0.1, 1e-3);
/// Points to which residuals are averaged before spectra are taken.
const SPECTRUM: usize = 4096;

/// Mechanical order of the strongest line over the angle, if one stands out.
pub(super) fn order(data: &Data, residual: &[f64]) -> Option<f64> {
    strongest(order_lines(&data.signals, residual), residual)
}

/// Mechanical orders, and the share of the squares that each takes.
fn order_lines(s: &Signals, residual: &[f64]) -> Vec<(f64, f64)> {
    let turned = (s.theta_m[s.len() - 1] - s.theta_m[0]).abs().max(
        s.theta_m.iter().fold(f64::NEG_INFINITY, |m, x| m.max(*x))
            - s.theta_m.iter().fold(f64::INFINITY, |m, x| m.min(*x)),
    );
    let mut orders: Vec<f64> = (1..=24).map(|k| f64::from(k) * s.n_p).collect();
    if turned > TAU {
        orders.extend((1..=4).map(f64::from).filter(|k| (k / s.n_p).fract() != 0.0));
    }
    // A slow change must not be taken for an order.
    let mean = residual.iter().sum::<f64>() / residual.len() as f64;
    let total: f64 = residual.iter().map(|r| (r - mean).powi(2)).sum();
    // Sums over the samples for each order: r·cos, r·sin, cos², sin².
    let mut sums = vec![[0.0; 4]; orders.len()];
    let (electrical, mechanical): (Vec<usize>, Vec<usize>) =
        (0..orders.len()).partition(|k| (orders[*k] / s.n_p).fract() == 0.0);
    for (theta, r) in s.theta_m.iter().zip(residual) {
        for (own, first) in [(&electrical, s.n_p), (&mechanical, 1.0)] {
            if own.is_empty() {
                continue;
            }
            // The angle of each order is that of the one before turned by the first one's.
            let (sin, cos) = Real::sin_cos(first * theta);
            let (mut at, mut turned) = (1.0, (sin, cos));
            for k in own {
                while at < orders[*k] / first {
                    turned = (turned.0 * cos + turned.1 * sin, turned.1 * cos - turned.0 * sin);
                    at += 1.0;
                }
                let (sin, cos) = turned;
                let r = r - mean;
                for (sum, x) in sums[*k].iter_mut().zip([r * cos, r * sin, cos * cos, sin * sin]) {
                    *sum += x;
                }
            }
        }
    }
    let line = |(order, [c, q, cc, qq]): (&f64, &[f64; 4])| {
        (*order, (c * c / cc.max(1e-9) + q * q / qq.max(1e-9)) / total.max(f64::MIN_POSITIVE))
    };
    orders.iter().zip(&sums).map(line).collect()
}

/// Frequency of the strongest line in time, if one stands out, Hz.
pub(super) fn frequency(data: &Data, residual: &[f64]) -> Option<f64> {
    let (lines, coarse) = frequency_lines(data.signals.period, residual);
    strongest(lines, &coarse)
}

/// Frequencies (Hz), and the share of the squares that each takes, of a residual sampled every `period` seconds; and the means over which
/// they are looked for.
fn frequency_lines(period: f64, residual: &[f64]) -> (Vec<(f64, f64)>, Vec<f64>) {
    let block = residual.len().div_ceil(SPECTRUM).max(1);
    let coarse: Vec<f64> = residual.chunks(block).map(|c| c.iter().sum::<f64>() / c.len() as f64).collect();
    let step = period * block as f64;
    let duration = step * coarse.len() as f64;
    let total: f64 = residual.iter().map(|r| r * r).sum::<f64>() / block as f64;
    let most = ((0.25 / step) * duration) as usize;
    // Whole numbers of periods: the angles come back.
    let count = coarse.len();
    let turn = |n: usize| Real::sin_cos(TAU * n as f64 / count as f64);
    let angles: Vec<(f64, f64)> = (0..count).map(turn).collect();
    let line = |k: usize| {
        let (mut c, mut q, mut at) = (0.0, 0.0, 0);
        for r in &coarse {
            let (sin, cos) = angles[at];
            c += r * cos;
            q += r * sin;
            at += k;
            if at >= count {
                at -= count;
            }
        }
        (k as f64 / duration, 2.0 * (c * c + q * q) / count as f64 / total.max(f64::MIN_POSITIVE))
    };
    ((4..most).map(line).collect(), coarse)
}

/// Frequency of the strongest line in several series together, each a share of its own squares, Hz; whether it stands out is not asked.
pub fn strongest_frequency(period: f64, series: &[Vec<f64>]) -> Option<f64> {
    let lines: Vec<Vec<(f64, f64)>> = series.iter().map(|x| frequency_lines(period, x).0).collect();
    let together =
        (0..lines.first()?.len()).map(|k| (lines[0][k].0, lines.iter().map(|own| own[k].1).sum::<f64>()));
    together.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(frequency, _)| frequency)
}

/// The strongest of some lines if its share of the squares is large and unlikely by chance (Fisher's test with the
/// effective number of samples, corrected for the number of lines).
fn strongest(lines: Vec<(f64, f64)>, residual: &[f64]) -> Option<f64> {
    let count = lines.len() as f64;
    let (at, share) = lines.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let samples = effective_samples(residual).max(8.0);
    let chance = count * (-share.min(0.999) * 0.5 * samples).exp();
    (share > LINE.0 && chance < LINE.1).then_some(at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{data, setup, speeds};

    #[test]
    fn lines_take_the_share_that_sines_of_each_sample_say() {
        let manoeuvre = speeds(1.0, &[(0.1, 60.0), (0.5, -40.0), (0.8, 90.0)]);
        let (data, _) = data(&setup(manoeuvre, Vec::new()));
        let signals = &data.signals;
        let (n, n_p) = (signals.len(), signals.n_p);
        let wave = |k: usize| {
            let (t, theta) = (k as f64 / n as f64, signals.theta_m[k]);
            0.3 + (6.0 * n_p * theta + 0.4).sin() + 0.5 * (TAU * 37.0 * t).cos() + t * t
        };
        let residual: Vec<f64> = (0..n).map(wave).collect();
        let share = |angle: &dyn Fn(usize) -> f64, r: &[f64]| {
            let (mut sums, mut total) = ([0.0; 4], 0.0);
            for (k, r) in r.iter().enumerate() {
                let (sin, cos) = angle(k).sin_cos();
                for (sum, x) in sums.iter_mut().zip([r * cos, r * sin, cos * cos, sin * sin]) {
                    *sum += x;
                }
                total += r * r;
            }
            let [c, q, cc, qq] = sums;
            (c * c / cc + q * q / qq) / total
        };
        let mean = residual.iter().sum::<f64>() / n as f64;
        let moved: Vec<f64> = residual.iter().map(|r| r - mean).collect();
        let lines = order_lines(signals, &residual);
        assert!(n_p > 2.0 && lines.len() == 24 + 3, "{}", lines.len());
        for (order, found) in &lines {
            let expected = share(&|k| order * signals.theta_m[k], &moved);
            assert!((found - expected).abs() < 1e-10, "{order}: {found} {expected}");
        }
        let most = lines.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert_eq!(most.0, 6.0 * n_p);

        // As many samples as are looked at one by one, up to a quarter of their rate.
        let residual = &residual[..n.min(SPECTRUM)];
        let (lines, coarse) = frequency_lines(signals.period, residual);
        assert_eq!((coarse.len(), lines.len()), (4096, 1019));
        for (f, found) in lines {
            let expected = share(&|k| TAU * f * signals.period * k as f64, residual);
            assert!((found - expected).abs() < 1e-9, "{f}: {found} {expected}");
        }
    }
}
