//! Phase voltages at open terminals: where the rotor stands, how fast it really turns, and what each channel adds.
//!
//! With no current the voltage of phase x is that of the magnet alone,
//!
//! > v_x = o_x + g_x·ω·ψ·Σ_n [c_n·cos(nφ) + s_n·sin(nφ)],  φ = (1+ε)·∫ω dt,
//!
//! linear in everything but the speed's error ε. The fundamental alone is −ω·ψ_m·g_x·sin(φ + θ_0 − 2πx/3), so that its
//! positive sequence gives the angle's zero θ_0, and its size in each phase the channel's gain. The harmonics are only there
//! to keep a run of few turns from leaking into offset and fundamental. Gains are relative to the middle one of the three: a
//! gain common to all cannot be told from ψ_m.

use super::Finding;
use crate::error::{Error, Result};
use crate::numerics::real::Real;
use nalgebra::{Complex, DMatrix, DVector};
use std::f64::consts::TAU;

/// Orders of the induced voltage that are told apart, as far as the sampling shows them.
const ORDERS: usize = 13;
/// Samples per period of the highest order.
const LEAST_PER_PERIOD: f64 = 5.0;
/// Fewest electrical turns of a run.
const FEWEST_TURNS: f64 = 2.0;
/// Samples used at most, evenly spread.
const MOST_SAMPLES: usize = 20_000;
/// Steps of the speed's correction, and the one at which it is small enough.
const ROUNDS: usize = 12;
const SETTLED: f64 = 1e-9;
/// Gain, offset (share of the fundamental) and speed errors from which they are worth telling, in this many standard errors.
const WORTH_TELLING: f64 = 0.02;
const SPEED_WORTH_TELLING: f64 = 0.01;
const CERTAIN: f64 = 5.0;
/// Largest share of the negative sequence in the fundamental.
const REVERSED: f64 = 0.5;

/// What the voltages tell of angle, speed and channels.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// Factor on the logged speed.
    pub speed: f64,
    /// Electrical angle at the first sample, rad.
    pub angle: f64,
    /// Gain of each channel relative to the middle one.
    pub gain: [f64; 3],
    /// Offset of each channel, V.
    pub offset: [f64; 3],
    /// Fundamental of each channel over the speed, V·s.
    flux: [f64; 3],
    /// Standard error of the offsets and of gain times flux, V and V·s.
    spread: [[f64; 2]; 3],
    /// Largest electrical speed, rad/s.
    top: f64,
}

/// Least-squares fit of the orders to one phase.
struct Phase {
    coefficients: DVector<f64>,
    residual: DVector<f64>,
    spread: [f64; 2],
}

/// Calibrates against the speed `omega` (rad/s) and the angle `theta` (rad) that belongs to it; where `angle_known`, neither
/// is corrected.
///
/// # Errors
/// [`Error::Column`] if the rotor turns too little, the sampling is too coarse, a channel is dead, or the phases follow
/// each other against the sense of rotation.
pub fn calibrate(
    voltages: [&[f64]; 3],
    omega: &[f64],
    theta: &[f64],
    angle_known: bool,
) -> Result<Calibration> {
    let n = theta.len();
    let turned = (theta[n - 1] - theta[0]).abs();
    if turned < FEWEST_TURNS * TAU {
        let turns = turned / TAU;
        return refuse(
            &format!("shows {turns:.2} electrical turns"),
            &format!("record at least {FEWEST_TURNS} turns in one direction, or check speed and n_p"),
        );
    }
    let per_turn = n as f64 * TAU / turned;
    let orders = ((per_turn / LEAST_PER_PERIOD) as usize).min(ORDERS);
    if orders == 0 {
        return refuse(
            &format!("is sampled {per_turn:.1} times per electrical turn"),
            "sample at least five times per electrical turn",
        );
    }
    let stride =
        n.div_ceil(MOST_SAMPLES).min((per_turn / (orders as f64 * LEAST_PER_PERIOD)) as usize).max(1);
    let kept: Vec<usize> = (0..n).step_by(stride).collect();
    let pick = |x: &[f64]| DVector::from_iterator(kept.len(), kept.iter().map(|k| x[*k]));
    let (omega, theta) = (pick(omega), pick(theta).add_scalar(-theta[0]));
    let voltages = voltages.map(pick);
    let mut speed = if angle_known { 1.0 } else { coarse(&voltages, &theta) };
    let mut phases = fit(&voltages, &omega, &theta, speed, orders)?;
    for _ in 0..if angle_known { 0 } else { ROUNDS } {
        let step = speed_step(&phases, &omega, &theta, speed, orders);
        speed += step;
        phases = fit(&voltages, &omega, &theta, speed, orders)?;
        if step.abs() < SETTLED {
            break;
        }
    }
    read(&phases, speed, omega.amax())
}

fn refuse<T>(problem: &str, fix: &str) -> Result<T> {
    Err(Error::Column { column: "v_a".into(), problem: problem.into(), fix: fix.into() })
}

/// The speed's factor from how the turning voltage vector runs away from the logged angle, turn by turn.
fn coarse(voltages: &[DVector<f64>; 3], theta: &DVector<f64>) -> f64 {
    let third = TAU / 3.0;
    // Equal sizes keep a channel of another scale from distorting the vector.
    let level = voltages.each_ref().map(|v| {
        let mean = v.mean();
        (mean, (v.add_scalar(-mean).norm_squared() / v.len() as f64).sqrt().max(f64::MIN_POSITIVE))
    });
    let mut turns: Vec<(f64, Complex<f64>)> = Vec::new();
    let mut turn = f64::NAN;
    for k in 0..theta.len() {
        let number = (theta[k] / TAU).floor();
        if number != turn {
            turn = number;
            turns.push((0.0, Complex::new(0.0, 0.0)));
        }
        let vector: Complex<f64> = (0..3)
            .map(|x| Complex::from_polar((voltages[x][k] - level[x].0) / level[x].1, x as f64 * third))
            .sum();
        if let Some(last) = turns.last_mut() {
            *last = (theta[k], last.1 + vector * Complex::from_polar(1.0, -theta[k]));
        }
    }
    let mut slip = 0.0;
    let mut turned = 0.0;
    for pair in turns.windows(2) {
        slip += (pair[1].1 * pair[0].1.conj()).arg();
        turned += pair[1].0 - pair[0].0;
    }
    if turned == 0.0 { 1.0 } else { 1.0 + slip / turned }
}

/// Columns: one, then ω·cos(nφ), ω·sin(nφ) for each order.
fn columns(omega: &DVector<f64>, theta: &DVector<f64>, speed: f64, orders: usize) -> DMatrix<f64> {
    let mut out = DMatrix::from_element(theta.len(), 1 + 2 * orders, 1.0);
    for k in 0..theta.len() {
        for n in 1..=orders {
            let (s, c) = Real::sin_cos(n as f64 * speed * theta[k]);
            out[(k, 2 * n - 1)] = omega[k] * c;
            out[(k, 2 * n)] = omega[k] * s;
        }
    }
    out
}

fn fit(
    voltages: &[DVector<f64>; 3],
    omega: &DVector<f64>,
    theta: &DVector<f64>,
    speed: f64,
    orders: usize,
) -> Result<Vec<Phase>> {
    let design = columns(omega, theta, speed, orders);
    let Some(inverse) = design.tr_mul(&design).try_inverse() else {
        return refuse("does not show the speed", "record a rotor that turns all the time");
    };
    Ok(voltages
        .iter()
        .map(|v| {
            let coefficients = &inverse * design.tr_mul(v);
            let residual = v - &design * &coefficients;
            let variance = residual.norm_squared() / residual.len() as f64;
            let spread = [0, 1].map(|k| (variance * inverse[(k, k)]).sqrt());
            Phase { coefficients, residual, spread }
        })
        .collect())
}

/// Gauss–Newton step of the speed's factor, each phase weighed by its own size.
fn speed_step(
    phases: &[Phase],
    omega: &DVector<f64>,
    theta: &DVector<f64>,
    speed: f64,
    orders: usize,
) -> f64 {
    let design = columns(omega, theta, speed, orders);
    let Some(inverse) = design.tr_mul(&design).try_inverse() else { return 0.0 };
    let (mut product, mut square) = (0.0, 0.0);
    for phase in phases {
        // d/dε: each cosine turns into the sine of its order, times n·θ.
        let mut turned = DVector::zeros(phase.coefficients.len());
        for n in 1..=orders {
            let (c, s) = (phase.coefficients[2 * n - 1], phase.coefficients[2 * n]);
            (turned[2 * n - 1], turned[2 * n]) = (n as f64 * s, -(n as f64) * c);
        }
        let slope = (&design * turned).component_mul(theta);
        let free = &slope - &design * (&inverse * design.tr_mul(&slope));
        let weight = 1.0 / phase.coefficients[1].hypot(phase.coefficients[2]).max(f64::MIN_POSITIVE).powi(2);
        product += weight * free.dot(&phase.residual);
        square += weight * free.norm_squared();
    }
    if square > 0.0 { product / square } else { 0.0 }
}

fn read(phases: &[Phase], speed: f64, top: f64) -> Result<Calibration> {
    let third = TAU / 3.0;
    // −ω·F·sin(φ + α) = −ω·F·(sin α·cos φ + cos α·sin φ).
    let vectors: Vec<Complex<f64>> =
        phases.iter().map(|p| Complex::new(-p.coefficients[2], -p.coefficients[1])).collect();
    let flux = [0, 1, 2].map(|x: usize| vectors[x].norm());
    let mut sorted = flux;
    sorted.sort_by(f64::total_cmp);
    for (x, phase) in phases.iter().enumerate() {
        // Not "less": a channel of zeros has no scatter either.
        if flux[x] <= CERTAIN * phase.spread[1] || flux[x].is_nan() {
            let column = ["v_a", "v_b", "v_c"][x].to_string();
            let problem = "shows no voltage at the frequency of the speed".to_string();
            return Err(Error::Column { column, problem, fix: "check the probe, the speed and n_p".into() });
        }
    }
    let gain = flux.map(|f| f / sorted[1]);
    let sequence = |sense: f64| -> Complex<f64> {
        (0..3).map(|x| vectors[x] / gain[x] * Complex::from_polar(1.0, sense * x as f64 * third)).sum()
    };
    let (with, against) = (sequence(1.0), sequence(-1.0));
    if against.norm() > REVERSED * with.norm() {
        return refuse(
            "and the other phases follow each other against the sense of rotation",
            "exchange two phases in [columns], or turn the speed round with scale = -1",
        );
    }
    Ok(Calibration {
        speed,
        angle: with.arg(),
        gain,
        offset: [0, 1, 2].map(|x: usize| phases[x].coefficients[0]),
        flux,
        spread: [0, 1, 2].map(|x: usize| phases[x].spread),
        top,
    })
}

impl Calibration {
    /// Offset and gain of the channels taken out of the sample `abc`, V.
    pub fn corrected(&self, abc: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|x: usize| (abc[x] - self.offset[x]) / self.gain[x])
    }

    /// What a user should know of it.
    pub fn findings(&self, angle_known: bool) -> Vec<Finding> {
        let mut findings = Vec::new();
        for (x, column) in ["v_a", "v_b", "v_c"].iter().enumerate() {
            let (gain, spread) = (self.gain[x], self.spread[x]);
            let (off, size) = ((gain - 1.0).abs(), spread[1] / self.flux[x] * gain);
            if off > WORTH_TELLING && off > CERTAIN * size {
                findings.push(Finding {
                    finding: format!("the sensor of {column} has {gain:.4} times the gain of the others"),
                    consequence: "it is divided by this factor".into(),
                    fix: format!(
                        "check the scale of its probe, or give scale = {:.4} in [columns]",
                        1.0 / gain
                    ),
                });
            }
            let (offset, fundamental) = (self.offset[x], self.flux[x] * self.top);
            if offset.abs() > WORTH_TELLING * fundamental && offset.abs() > CERTAIN * spread[0] {
                findings.push(Finding {
                    finding: format!(
                        "the sensor of {column} has an offset of {offset:.4} V, {:.1} % of the amplitude",
                        100.0 * offset.abs() / fundamental
                    ),
                    consequence: "it is subtracted".into(),
                    fix: "zero the sensor before recording".into(),
                });
            }
        }
        if !angle_known {
            findings.push(Finding {
                finding: "no rotor angle was logged: it is the one of the voltages' fundamental".into(),
                consequence: "an error of the angle cannot be seen".into(),
                fix: "log the angle of the encoder as well".into(),
            });
        }
        let error = self.speed - 1.0;
        if error.abs() > SPEED_WORTH_TELLING {
            findings.push(Finding {
                finding: format!("the rotor turns {:.4} times as fast as the logged speed says", self.speed),
                consequence: "the speed is corrected by this factor".into(),
                fix: "check the unit of the speed and the pole pairs".into(),
            });
        }
        findings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAIN: [f64; 3] = [1.0, 0.1, 1.004];
    const OFFSET: [f64; 3] = [0.0, 0.03, -0.2];

    /// Voltages of 3.7 turns at a speed that rises by a tenth, logged one per cent too low, with a 5th harmonic.
    fn run(sense: f64) -> (Vec<Vec<f64>>, Vec<f64>, Vec<f64>) {
        let n = 4000;
        let (mut omega, mut theta, mut at) = (Vec::new(), Vec::new(), 0.0);
        let h = 3.7 * TAU / 700.0 / n as f64;
        for k in 0..n {
            let w = 700.0 * (0.95 + 0.1 * k as f64 / n as f64);
            omega.push(w);
            theta.push(at);
            at += w * h;
        }
        let voltages = (0..3)
            .map(|x| {
                let phase = |k: usize| 1.01 * theta[k] + 0.4 - sense * x as f64 * TAU / 3.0;
                let emf = |k: usize| {
                    -omega[k] * 1.01 * 5e-3 * (phase(k).sin() + 0.03 * (5.0 * phase(k) + 1.0).sin())
                };
                (0..n).map(|k| OFFSET[x] + GAIN[x] * emf(k)).collect()
            })
            .collect();
        (voltages, omega, theta)
    }

    fn calibrated(sense: f64) -> Result<Calibration> {
        let (v, omega, theta) = run(sense);
        calibrate([&v[0], &v[1], &v[2]], &omega, &theta, false)
    }

    #[test]
    fn angle_speed_gain_and_offset_are_found_together() {
        let found = calibrated(1.0).unwrap();
        assert!((found.speed - 1.01).abs() < 1e-9 && (found.angle - 0.4).abs() < 1e-9, "{found:?}");
        for x in 0..3 {
            assert!((found.gain[x] - GAIN[x]).abs() < 1e-9 && (found.offset[x] - OFFSET[x]).abs() < 1e-9);
        }
        let words: Vec<String> = found.findings(false).into_iter().map(|f| f.finding).collect();
        assert!(words[0].contains("v_b has 0.1000 times") && words.len() == 5, "{words:?}");
        assert!(
            words[1].contains("v_b has an offset") && words[2].contains("v_c has an offset of -0.2000 V")
        );
    }

    #[test]
    fn a_probe_that_fell_off_is_named() {
        let (mut v, omega, theta) = run(1.0);
        v[1].fill(0.0);
        for angle_known in [false, true] {
            let text = calibrate([&v[0], &v[1], &v[2]], &omega, &theta, angle_known).unwrap_err().to_string();
            assert!(text.contains("v_b") && text.contains("shows no voltage"), "{text}");
        }
    }

    #[test]
    fn phases_in_the_wrong_order_are_refused() {
        let text = calibrated(-1.0).unwrap_err().to_string();
        assert!(text.contains("against the sense") && text.contains("exchange two phases"), "{text}");
    }
}
