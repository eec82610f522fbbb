//! What a log does to its own clock and speed is undone where the angle shows it.

use super::{Finding, clock, lag};
use std::f64::consts::TAU;
use std::ops::Range;

/// Evens out time stamps and undoes a lag of the speed, where the angle shows them.
pub fn mend(
    t: &mut Vec<f64>,
    omega: &mut Vec<f64>,
    theta: &[f64],
    segments: &[Range<usize>],
) -> Vec<Finding> {
    let mut findings = Vec::new();
    if let Some((even, jitter)) = clock::even(t, segments, theta, omega) {
        *t = even;
        findings.push(Finding {
            finding: format!(
                "the time stamps jitter by {:.1} % of the sample period, but the rotor turns evenly",
                100.0 * jitter
            ),
            consequence: "evenly spaced samples are assumed".into(),
            fix: "stamp the samples when they are taken".into(),
        });
    }
    if let Some((prompt, lag)) = lag::undo(t, theta, omega, segments) {
        *omega = prompt;
        let (what, fix) = match lag {
            lag::Lag::Filter(tau) => (
                format!("is low-pass filtered at {:.0} Hz", 1.0 / (TAU * tau)),
                "log the speed before its filter, or the angle alone",
            ),
            lag::Lag::Delay(tau) => {
                (format!("is {:.2} ms late", 1e3 * tau), "log speed and angle at the same instant")
            }
        };
        findings.push(Finding {
            finding: format!("the logged speed {what}, as the angle shows"),
            consequence: "the lag is undone, which raises the noise of the speed".into(),
            fix: fix.into(),
        });
    }
    findings
}
