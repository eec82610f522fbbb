//! Estimates with their intervals, as an answer states them.

use crate::diagnose::answer::{Estimate, Z95};
use crate::effect::Role;
use crate::effects::EffectId;
use crate::figures::quantity;
use std::collections::BTreeMap;

/// An estimate with its standard error, or why it has none.
pub(super) fn estimate(value: f64, variance: f64, unit: &str, why: Option<String>) -> Estimate {
    let stderr = variance.max(0.0).sqrt();
    let why = why
        .or_else(|| (!stderr.is_finite()).then(|| "the recording does not show how exact it is".to_string()));
    let shown = why.is_none();
    Estimate {
        value: Some(value),
        stderr: shown.then_some(stderr),
        ci95: shown.then_some([value - Z95 * stderr, value + Z95 * stderr]),
        unit: unit.into(),
        why_none: if shown { None } else { why },
    }
}

/// Whether none of an effect's estimates exceeds so many `times` its standard error. A whole number, which has none, says nothing of a
/// strength; what else has none counts as beyond it.
pub(super) fn within_errors(effect: EffectId, estimates: &BTreeMap<String, Estimate>, times: f64) -> bool {
    let chosen = |name: &String| {
        effect.info().parameters.iter().any(|p| p.name == name.as_str() && p.role == Role::Fixed)
    };
    let within = |x: &Estimate| matches!((x.value, x.stderr), (Some(value), Some(error)) if value.abs() < times * error);
    estimates.iter().filter(|(name, _)| !chosen(name)).all(|(_, x)| within(x))
}

/// The interval of what cannot be negative, as its lowest value tells, does not reach below zero. Other bounds are where it was sought.
pub(super) fn signed(estimate: Estimate, low: f64) -> Estimate {
    let least = if low >= 0.0 { 0.0 } else { f64::NEG_INFINITY };
    Estimate { ci95: estimate.ci95.map(|[from, to]| [from.max(least), to]), ..estimate }
}

/// A positive parameter whose standard error exceeds its value is not shown; all that is known of it is how large it may be.
pub(super) fn shown(estimate: Estimate) -> Estimate {
    let (Some(value), Some(stderr)) = (estimate.value, estimate.stderr) else { return estimate };
    if stderr <= value {
        return estimate;
    }
    let most = value + Z95 * stderr;
    let most = quantity(most, 3, &estimate.unit);
    let why = format!("the recording does not show it: anything up to {most} fits");
    Estimate { value: None, stderr: None, ci95: None, why_none: Some(why), ..estimate }
}
