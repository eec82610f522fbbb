//! Sensor noise that lasts: its errors are not independent from one row to the next. It is read without any model where a log holds a
//! quantity twice: three currents add up to nothing, and the speed is the slope of the angle.
//!
//! What both readings differ by is noise only as far as it is no function of the motion. Offsets, gains and curved characteristics of the
//! current sensors, and the errors of an encoder over the turn, over speed and over acceleration, are therefore taken out by least squares.
//! What is left must be as large at high currents, speeds and accelerations as at low ones: an error of the sensors that physics causes
//! grows with them.

use super::colour::effective_samples;
use crate::numerics::differences::white_noise;
use crate::numerics::extent::peak;
use crate::recording::Kind;
use crate::signals::{Finding, SensorNoise, Signals};
use nalgebra::{SMatrix, SVector};
use std::f64::consts::SQRT_2;

/// Standard errors by which a mean square must exceed that of white noise, and by which those of parts of a log may differ.
const SIGNIFICANT: f64 = 4.0;
/// Relative standard error of the square of white noise from third differences, times the root of the number of samples: the mean square of
/// correlated differences is that uncertain.
const UNCERTAIN: f64 = 3.6;
/// Parts of a log, by the size of a current, a speed or an acceleration, in which noise is equally large.
const PARTS: usize = 4;
/// Share of what two readings differ by that must be noise of the sensor, and no error of the other reading.
const OWN: f64 = 0.5;

/// The part of a `series` that is noise of the sensor, if it lasts: its mean square then exceeds that of `white` noise. It must be as large in
/// all parts of the log, by the size of each of `keys`. The error of the other reading, `other`, is no part of it.
fn lasting(mut series: Vec<f64>, white: f64, other: f64, keys: &[Vec<f64>]) -> Option<SensorNoise> {
    let (square, count) = (mean_square(&series), series.len() as f64);
    let error = (2.0 / effective_samples(&series)).sqrt();
    let known = white * white + other * other;
    let larger = square > known * (1.0 + SIGNIFICANT * (error + UNCERTAIN / count.sqrt()));
    let apart = SIGNIFICANT * SQRT_2 * error * (PARTS as f64).sqrt();
    let even = |key: &Vec<f64>| {
        let parts = by_size(&series, key);
        let (least, most) = parts.iter().fold((f64::INFINITY, 0.0f64), |(a, b), x| (a.min(*x), b.max(*x)));
        (most / least).ln() < apart
    };
    let own = 1.0 - other * other / square;
    if !larger || own < OWN || !keys.iter().all(even) {
        return None;
    }
    series.iter_mut().for_each(|x| *x *= own.sqrt());
    Some(SensorNoise { rms: (own * square).sqrt(), unsure: 2.0 * SQRT_2 * error, series })
}

/// Reads it from the log, and says what was found.
pub fn find(signals: &mut Signals) {
    if !matches!(signals.kind, Kind::Full | Kind::Electrical | Kind::Mechanical) {
        return;
    }
    let (currents, speed) = (of_currents(signals), of_speed(signals));
    let told = |what: &str, noise: &SensorNoise, unit: &str| Finding {
        finding: format!(
            "the noise of the {what} lasts: {} {unit} in all, {:.1} times what changes from row to row",
            digits(noise.rms),
            noise.rms / white_noise(&noise.series)
        ),
        consequence: "all of it counts as noise".into(),
        fix: "look for interference, or for a filter in the sensor".into(),
    };
    let found = [
        currents.as_ref().map(|noise| told("current sensors", noise, "A per axis")),
        speed.as_ref().map(|noise| told("logged speed", noise, "rad/s (electrical)")),
    ]
    .into_iter()
    .flatten();
    found.for_each(|finding| signals.limited_by(finding));
    (signals.limits.current_noise, signals.limits.speed_noise) = (currents, speed);
}

/// A positive number with three digits.
fn digits(x: f64) -> String {
    let decimals = (2.0 - x.log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{x:.decimals$}")
}

/// Noise of the currents as one axis of the rotor sees it, A, from the sum of three.
fn of_currents(signals: &Signals) -> Option<SensorNoise> {
    let phases = signals.phases.as_ref().filter(|_| signals.three_currents)?;
    let i = signals.i.as_ref()?;
    let most = phases.iter().map(|x| peak(x)).fold(f64::MIN_POSITIVE, f64::max);
    let sum: Vec<f64> = (0..signals.len()).map(|k| phases.iter().map(|x| x[k]).sum()).collect();
    let errors = |k: usize| {
        // Without the sum itself, which they are to explain.
        let x = phases.each_ref().map(|x| (x[k] - sum[k] / 3.0) / most);
        let (even, curved, cubed) = (x.map(|x| x * x), x.map(|x| x * x.abs()), x.map(|x| x * x * x));
        [
            1.0, x[0], x[1], even[0], even[1], even[2], curved[0], curved[1], curved[2], cubed[0], cubed[1],
            cubed[2],
        ]
    };
    let rest = without(&sum, &errors);
    // Each phase has a third of the variance of the sum, and an axis two thirds of that of a phase.
    let scale = SQRT_2 / 3.0;
    let series: Vec<f64> = rest.iter().map(|x| scale * x).collect();
    let white = scale * white_noise(&rest);
    let size = (0..signals.len()).map(|k| i[0][k].hypot(i[1][k])).collect();
    let speed = signals.omega_e.iter().map(|w| w.abs()).collect();
    lasting(series, white, 0.0, &[size, speed])
}

/// Noise of the logged speed, rad/s (electrical), from the slope of the angle.
fn of_speed(signals: &Signals) -> Option<SensorNoise> {
    let limits = &signals.limits;
    if !signals.speed_known || !signals.angle_known || signals.angle_from_voltages || limits.lasting {
        return None;
    }
    let slope = signals.slope_of_angle();
    let n = signals.len();
    let (omega, error) = (&slope.omega, (slope.error.iter().map(|x| x * x).sum::<f64>() / n as f64).sqrt());
    let apart: Vec<f64> = signals.omega_e.iter().zip(omega).map(|(logged, slope)| logged - slope).collect();
    let reach = 2 * slope.half;
    let gain = |k: usize| {
        let (before, after) = (k.saturating_sub(reach), (k + reach).min(n - 1));
        (omega[after] - omega[before]) / (signals.t[after] - signals.t[before]).max(f64::MIN_POSITIVE)
    };
    let gains: Vec<f64> = (0..n).map(gain).collect();
    let (fastest, steepest) = (peak(omega).max(f64::MIN_POSITIVE), peak(&gains).max(f64::MIN_POSITIVE));
    let errors = |k: usize| {
        let (w, a) = (omega[k] / fastest, gains[k] / steepest);
        let ([s, c], [s_m, c_m]) =
            [signals.theta_e[k], signals.theta_m[k]].map(|x| [x.sin(), x.cos()]).into();
        let twice = |s: f64, c: f64| [2.0 * s * c, c * c - s * s];
        let ([s2, c2], [s2_m, c2_m]) = (twice(s, c), twice(s_m, c_m));
        [
            1.0,
            w,
            w * w.abs(),
            a,
            a * w.abs(),
            a * w * w,
            w * s,
            w * c,
            w * s2,
            w * c2,
            w * s_m,
            w * c_m,
            w * s2_m,
            w * c2_m,
        ]
    };
    let rest = without(&apart, &errors);
    let white = white_noise(&signals.omega_e);
    let size = |x: &[f64]| x.iter().map(|x| x.abs()).collect();
    lasting(rest, white, error, &[size(omega), size(&gains)])
}

/// What a linear combination of P functions leaves of a series.
fn without<const P: usize>(x: &[f64], functions: &dyn Fn(usize) -> [f64; P]) -> Vec<f64> {
    let (mut normal, mut right) = (SMatrix::<f64, P, P>::zeros(), SVector::<f64, P>::zeros());
    for (k, x) in x.iter().enumerate() {
        let f = SVector::from(functions(k));
        normal += f * f.transpose();
        right += f * *x;
    }
    let most = normal.diagonal().max();
    // Functions that are the same along this log share what they explain.
    (0..P).for_each(|k| normal[(k, k)] += 1e-12 * most);
    let share = normal.cholesky().map_or_else(SVector::zeros, |c| c.solve(&right));
    x.iter().enumerate().map(|(k, x)| x - SVector::from(functions(k)).dot(&share)).collect()
}

fn mean_square(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>() / x.len().max(1) as f64
}

/// Mean squares of a series in parts of one length each, by the size of `key`.
fn by_size(series: &[f64], key: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..series.len()).collect();
    order.sort_by(|a, b| key[*a].total_cmp(&key[*b]));
    let part = order.len().div_ceil(PARTS).max(1);
    order
        .chunks(part)
        .map(|own| own.iter().map(|k| series[*k].powi(2)).sum::<f64>() / own.len() as f64)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Machine;
    use crate::numerics::random::normal_pair;
    use crate::recording::Recording;

    const COUNT: u32 = 30_000;

    /// A machine that reverses. Its current sensors have white noise of 0.05 A, its speed of 0.3 rad/s. Noise that lasts for eight rows is
    /// `more` times as large. The angle is ahead by a function of itself and the speed.
    fn logged(more: f64, ahead: fn(f64, f64) -> f64, curved: f64) -> Signals {
        let mut lasting = [0.0; 4];
        let keep = (-1.0f64 / 8.0).exp();
        let mut columns: Vec<(String, Vec<f64>)> = ["t", "i_a", "i_b", "i_c", "theta_e", "omega_e"]
            .map(|name| (name.to_string(), Vec::new()))
            .into();
        for k in 0..COUNT {
            let t = 1e-4 * f64::from(k);
            let (omega, theta) = (300.0 * (7.0 * t).sin(), 300.0 / 7.0 * (1.0 - (7.0 * t).cos()));
            let noise = [0, 1, 2, 3].map(|x| normal_pair(11, [k, x, 0, 0]));
            for (own, (_, drive)) in lasting.iter_mut().zip(noise) {
                *own = keep * *own + (1.0 - keep * keep).sqrt() * drive;
            }
            let error = |x: usize| noise[x].0 + more * lasting[x];
            columns[0].1.push(t);
            for x in 0..3 {
                let i = 6.0 * (theta - std::f64::consts::TAU * x as f64 / 3.0).cos();
                columns[1 + x].1.push(i + curved * i * i * i + 0.05 * error(x));
            }
            columns[4].1.push(theta + ahead(theta, omega));
            columns[5].1.push(omega + 0.3 * error(3));
        }
        let mut signals =
            Signals::new(&Recording::new(columns, None).unwrap(), &Machine::new(3).unwrap()).unwrap();
        find(&mut signals);
        signals
    }

    #[test]
    fn noise_that_lasts_is_seen_with_its_size_and_white_noise_is_none() {
        let signals = logged(2.0, |_, _| 0.0, 0.0);
        let (current, speed) = (signals.limits.current_noise.unwrap(), signals.limits.speed_noise.unwrap());
        let whole = 5f64.sqrt();
        assert!((current.rms / ((2.0f64 / 3.0).sqrt() * 0.05 * whole) - 1.0).abs() < 0.1, "{}", current.rms);
        assert!((mean_square(&current.series).sqrt() / current.rms - 1.0).abs() < 0.1);
        assert!((speed.rms / (0.3 * whole) - 1.0).abs() < 0.1, "{}", speed.rms);
        assert_eq!(signals.limits.found.len(), 2);
        assert_eq!(digits(0.06839), "0.0684");
        let white = logged(0.0, |_, _| 0.0, 0.0).limits;
        assert!(white.current_noise.is_none() && white.speed_noise.is_none() && white.found.is_empty());
    }

    #[test]
    fn errors_of_the_sensors_that_follow_the_motion_are_no_noise() {
        let errors: [fn(f64, f64) -> f64; 4] = [
            |theta, _| 0.05 * theta.cos(),
            |_, omega| -2e-4 * omega,
            |theta, _| 0.02 * (5.0 * theta).sin(),
            |_, omega| 0.05 * (omega / 80.0).tanh(),
        ];
        for (number, error) in errors.into_iter().enumerate() {
            let limits = logged(0.0, error, 1e-3).limits;
            assert!(limits.speed_noise.is_none(), "{number}: {:?}", limits.speed_noise.map(|x| x.rms));
            assert!(limits.current_noise.is_none());
        }
    }
}
