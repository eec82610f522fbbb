//! Phase currents and voltages as they were logged, and as the rotor sees them.

use super::Finding;
use super::open_circuit::Calibration;
use crate::recording::Recording;
use crate::transforms::park;

/// The phase currents, where at least two were logged, and whether all three were.
pub fn currents(recording: &Recording, findings: &mut Vec<Finding>) -> (Option<[Vec<f64>; 3]>, bool) {
    let column = |name: &str| recording.column(name);
    let rest = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| -x - y).collect::<Vec<f64>>();
    let (a, b, c) = (column("i_a"), column("i_b"), column("i_c"));
    let phases = match (a, b, c) {
        (Some(a), Some(b), Some(c)) => return (Some([a.to_vec(), b.to_vec(), c.to_vec()]), true),
        (Some(a), Some(b), None) => Some([a.to_vec(), b.to_vec(), rest(a, b)]),
        (None, Some(b), Some(c)) => Some([rest(b, c), b.to_vec(), c.to_vec()]),
        (Some(a), None, Some(c)) => Some([a.to_vec(), rest(a, c), c.to_vec()]),
        _ => None,
    };
    if phases.is_some() {
        findings.push(Finding {
            finding: "only two phase currents are logged".into(),
            consequence:
                "the currents' noise is estimated from the model, and a common offset cannot be seen".into(),
            fix: "log the third phase current".into(),
        });
    }
    (phases, false)
}

/// Number of the only phase whose current was not logged.
pub fn completed(recording: &Recording) -> Option<usize> {
    match ["i_a", "i_b", "i_c"].map(|name| recording.column(name).is_some()) {
        [false, true, true] => Some(0),
        [true, false, true] => Some(1),
        [true, true, false] => Some(2),
        _ => None,
    }
}

/// Phase values seen from the rotor at the angle `theta`, rad.
pub fn to_rotor(abc: &[Vec<f64>; 3], theta: &[f64]) -> [Vec<f64>; 2] {
    let mut dq = [Vec::with_capacity(theta.len()), Vec::with_capacity(theta.len())];
    for k in 0..theta.len() {
        let (s, c) = theta[k].sin_cos();
        let [d, q] = park([abc[0][k], abc[1][k], abc[2][k]], c, s);
        dq[0].push(d);
        dq[1].push(q);
    }
    dq
}

/// The three phase voltages, if all were logged.
pub fn logged_voltages(recording: &Recording) -> Option<[&[f64]; 3]> {
    Some([recording.column("v_a")?, recording.column("v_b")?, recording.column("v_c")?])
}

/// Measured phase voltages of open terminals in the rotor frame, without what their channels add.
pub fn induced_voltages(abc: [&[f64]; 3], calibration: &Calibration, theta: &[f64]) -> [Vec<f64>; 2] {
    let corrected: Vec<[f64; 3]> =
        (0..theta.len()).map(|k| calibration.corrected([abc[0][k], abc[1][k], abc[2][k]])).collect();
    let phase = |x: usize| corrected.iter().map(|v| v[x]).collect();
    to_rotor(&[phase(0), phase(1), phase(2)], theta)
}

/// Phase voltages held from sample to sample, seen from the rotor in the middle of the interval.
pub fn held_voltages(
    recording: &Recording,
    t: &[f64],
    theta: &[f64],
    omega: &[f64],
    angle_known: bool,
) -> Option<[Vec<f64>; 2]> {
    let abc = logged_voltages(recording)?;
    if !angle_known {
        return None;
    }
    let n = t.len();
    let mut dq = [Vec::with_capacity(n), Vec::with_capacity(n)];
    for k in 0..n {
        let h = if k + 1 < n { t[k + 1] - t[k] } else { recording.period() };
        let (s, c) = (theta[k] + 0.5 * h.min(2.0 * recording.period()) * omega[k]).sin_cos();
        let [d, q] = park([abc[0][k], abc[1][k], abc[2][k]], c, s);
        dq[0].push(d);
        dq[1].push(q);
    }
    Some(dq)
}
