//! A fitted map as numbers that can be used elsewhere, and in plain words.

use super::{Basis, Side, Term, Unmodelled, candidates};
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::map::{Equation, Factor, Map, Part, Point, Spline, Variable};
use crate::simulate::environment::measured_env;
use std::f64::consts::TAU;

/// Says what the maps of `fitted` are, or that none of those tried on some sides helps. `gain` is the share that they take away, and
/// whether that is on data that were not used for fitting.
pub fn unmodelled(data: &Data, fitted: &Hypothesis, tried: &[Side], gain: (f64, bool)) -> Unmodelled {
    let map = fitted.model.map().cloned().unwrap_or_default();
    let coefficients = &fitted.parameters[fitted.model.map_parameters()];
    let peaks = peaks(data, fitted, &map, coefficients);
    let mut terms = Vec::new();
    for ((part, place), [first, second]) in map.places().zip(peaks) {
        let own = coefficients[place].chunks_exact(part.size());
        for (equation, own) in part.equations.iter().zip(own) {
            match equation {
                Equation::Link => {
                    terms.push(term(part, (Equation::D, Some(largest_voltage(data))), own, first));
                    terms.push(term(part, (Equation::Q, Some(largest_voltage(data))), own, second));
                }
                Equation::Q => terms.push(term(part, (*equation, None), own, second)),
                _ => terms.push(term(part, (*equation, None), own, first)),
            }
        }
    }
    let sentence = if terms.is_empty() { nothing(tried) } else { something(&terms, gain) };
    Unmodelled { sentence, gain_held_out: (!terms.is_empty()).then_some(gain.0), terms }
}

/// Largest commanded voltage of one axis in the recordings, V.
fn largest_voltage(data: &Data) -> f64 {
    let axes = data.runs().iter().filter_map(|run| run.signals.v.as_ref()).flatten();
    axes.flatten().fold(0.0, |largest, v| v.abs().max(largest))
}

fn something(terms: &[Term], (gain, held_out): (f64, bool)) -> String {
    let parts: Vec<&str> = terms.iter().map(|t| t.sentence.as_str()).collect();
    let share = if gain > 0.99 { "over 99".to_string() } else { format!("{:.0}", 100.0 * gain) };
    let on =
        if held_out { "data that were not used for fitting" } else { "the recording to which it was fitted" };
    format!(
        "What the catalogue does not explain is described without a name: {}. On {on} this takes away {share} % of what was \
         left above the noise. It predicts, but it is no cause.",
        parts.join(", and ")
    )
}

fn nothing(tried: &[Side]) -> String {
    let over = |side: &Side| match side {
        Side::Electrical => {
            "of the missing voltage over angle, speed and currents, nor of the angle's error,"
        }
        Side::Mechanical => "of the missing torque over angle, speed and motor torque",
    };
    if tried.is_empty() {
        return "Nothing is left on the recording itself over which a map could be laid.".into();
    }
    let over: Vec<&str> = tried.iter().map(over).collect();
    format!(
        "No map {} predicts data that were not used for fitting: the rest stays.",
        over.join(" and none ")
    )
}

/// What a part adds to one equation; where it is a share of the command, with the largest voltage of one axis.
fn term(part: &Part, (equation, share_of): (Equation, Option<f64>), coefficients: &[f64], peak: f64) -> Term {
    let (what, formula) = match equation {
        Equation::D | Equation::Link => ("d-axis voltage", "v_d = r_s·i_d + dλ_d/dt − ω·λ_q + term"),
        Equation::Q => ("q-axis voltage", "v_q = r_s·i_q + dλ_q/dt + ω·λ_d + term"),
        Equation::Mechanical => ("torque", "j·dω_m/dt = τ_e − τ_load − b·ω_m − term"),
        Equation::Sensor => ("error of the logged angle", "θ_measured = θ_e + term"),
    };
    let mut over: Vec<String> = part.factors().map(over).collect();
    let mut variables: Vec<Basis> = part.factors().map(basis).collect();
    let mut coefficients = of_basis(part, coefficients);
    if let Some(largest) = share_of {
        // The command itself is the line between two splines of degree one.
        let variable = if equation == Equation::Q { Variable::VQ } else { Variable::VD };
        let (low, high, degree, pieces) = (-largest, largest, 1, 1);
        let line = Spline { variable, low, high, degree, pieces, warp: 0.0, odd: false };
        over.push(format!("in proportion to {}", variable.name()));
        variables.push(basis(&Factor::Spline(line)));
        coefficients = coefficients.iter().flat_map(|c| [c * low, c * high]).collect();
    }
    let unit = equation.unit();
    let decimals = (1.0 - peak.max(1e-300).log10().floor()).clamp(0.0, 12.0) as usize;
    let over = over.join(" and ");
    let sentence = format!("unmodelled {what} over {over}, up to {peak:.decimals$} {unit}");
    Term { equation, sentence, formula, variables, coefficients, unit, peak }
}

/// Coefficients of the products of the bases: those of odd functions are those of all splines, mirrored, and a mean is a cosine of order zero.
fn of_basis(part: &Part, coefficients: &[f64]) -> Vec<f64> {
    let whole = |factor: &Factor| match factor {
        Factor::Spline(s) if s.odd => s.pieces + s.degree,
        Factor::Fourier { count, .. } => 2 * (count + 1),
        other => other.count(),
    };
    // Number of the function that holds that of the basis, and its sign there; a sine of order zero is in none, nor is the middle one of an
    // odd number of splines.
    let place = |factor: &Factor, k: usize| match factor {
        Factor::Spline(s) if s.odd => {
            let mirrored = s.pieces + s.degree - 1 - k;
            (k != mirrored).then(|| (k.min(mirrored), if k < mirrored { 1.0 } else { -1.0 }))
        }
        Factor::Fourier { .. } if k < 2 => (k == 0).then_some((0, 1.0)),
        Factor::Fourier { .. } => Some((k - 1, 1.0)),
        _ => Some((k, 1.0)),
    };
    let second = part.second.as_ref();
    let (m, own) = (second.map_or(1, whole), second.map_or(1, Factor::count));
    let value = |(a, b): (usize, usize)| {
        let (first, x) = place(&part.first, a)?;
        let (second, y) = second.map_or(Some((0, 1.0)), |factor| place(factor, b))?;
        Some(x * y * coefficients[first * own + second])
    };
    let all = (0..whole(&part.first)).flat_map(|a| (0..m).map(move |b| (a, b)));
    all.map(|at| value(at).unwrap_or(0.0)).collect()
}

fn over(factor: &Factor) -> String {
    match factor {
        Factor::Harmonics { angle, order, count } => {
            let last = *count as u32 * order;
            let orders = match count {
                1 => format!("order {order}"),
                2 => format!("orders {order} and {last}"),
                _ if *order == 1 => format!("orders 1 to {last}"),
                _ => format!("orders {order}, {}, … {last}", 2 * order),
            };
            format!("{} ({orders})", angle.name())
        }
        Factor::Fourier { angle, count } => format!("{} (mean and orders 1 to {count})", angle.name()),
        Factor::Swing { frequency, count: 1 } => format!("time ({frequency:.2} Hz)"),
        Factor::Swing { frequency, count } => format!("time (1 to {count} times {frequency:.2} Hz)"),
        Factor::Direction { .. } => "the direction of rotation".into(),
        Factor::Spline(spline) if spline.variable == Variable::T => "time".into(),
        Factor::Spline(spline) => spline.variable.name().into(),
    }
}

fn basis(factor: &Factor) -> Basis {
    let (variable, unit) = (factor.variable().name(), factor.variable().unit());
    match *factor {
        Factor::Harmonics { order, count, .. } => {
            let orders = (1..=count).map(|k| f64::from(order) * k as f64).collect();
            Basis::Harmonic { variable, unit, orders }
        }
        Factor::Fourier { count, .. } => {
            Basis::Harmonic { variable, unit, orders: (0..=count).map(|k| k as f64).collect() }
        }
        Factor::Swing { frequency, count } => {
            let orders = (1..=count).map(|k| TAU * frequency * k as f64).collect();
            Basis::Harmonic { variable, unit, orders }
        }
        Factor::Direction { width } => Basis::Direction { variable, unit, width },
        Factor::Spline(s) => Basis::BSpline {
            variable,
            unit,
            low: s.low,
            high: s.high,
            degree: s.degree,
            pieces: s.pieces,
            warp: s.warp,
        },
    }
}

/// Largest absolute values of what each part adds over the recording: to the voltage of d and q, or in the first place to torque or angle.
fn peaks(data: &Data, fitted: &Hypothesis, map: &Map, coefficients: &[f64]) -> Vec<[f64; 2]> {
    let mut peaks = vec![[0.0f64; 2]; map.parts.len()];
    if map.parts.is_empty() {
        return peaks;
    }
    let torque = candidates::torque(data, fitted);
    let samples = data.runs().iter().flat_map(|run| (0..run.signals.len()).map(move |k| (&run.signals, k)));
    for ((s, k), tau_e) in samples.zip(torque) {
        let pair = |x: &Option<[Vec<f64>; 2]>| x.as_ref().map_or([0.0; 2], |[d, q]| [d[k], q[k]]);
        let at = Point { env: measured_env(s, k), i: pair(&s.i), v: pair(&s.v), tau_e };
        for ((part, place), peaks) in map.places().zip(&mut peaks) {
            let mut out = [0.0; 2];
            part.add(&coefficients[place], &at, &mut out);
            peaks.iter_mut().zip(out).for_each(|(peak, x)| *peak = peak.max(x.abs()));
        }
    }
    peaks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::env;

    #[test]
    fn coefficients_of_odd_functions_are_told_for_all_splines() {
        let variable = Variable::OmegaE;
        let odd = Spline { variable, low: -80.0, high: 80.0, degree: 3, pieces: 6, warp: 5.0, odd: true };
        let part = |spline| Part {
            equations: vec![Equation::Mechanical],
            first: Factor::Spline(spline),
            second: Some(Factor::Direction { width: 2.0 }),
        };
        let own: Vec<f64> = (0..8).map(|k| 0.3 * f64::from(k) - 1.0).collect();
        let told = of_basis(&part(odd), &own);
        assert_eq!(told.len(), 9 * 2);
        for omega in [-75.0, -20.0, -0.5, 0.0, 3.0, 41.0] {
            let at = Point { env: env(0.4, omega), i: [0.0; 2], v: [0.0; 2], tau_e: 0.0 };
            let value = |part: &Part, p: &[f64]| {
                let mut out = [0.0; 2];
                part.add(p, &at, &mut out);
                out[0]
            };
            let (wanted, whole) =
                (value(&part(odd), &own), value(&part(Spline { odd: false, ..odd }), &told));
            assert!((wanted - whole).abs() < 1e-12, "{omega}: {wanted} {whole}");
        }
    }
}
