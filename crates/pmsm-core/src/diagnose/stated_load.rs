//! What a load does that the machine file states, or that was measured, and that is a little off.

use super::answer::Estimate;
use super::data::Data;
use super::hypothesis::Hypothesis;
use super::outputs::Outputs;
use crate::effects::EffectId;
use crate::numerics::extent::peak;
use crate::recording::Load;
use crate::signals::Finding;
use std::collections::BTreeMap;

/// Share of its largest value to which no load is known: the class of good torque transducers.
const KNOWN: f64 = 1e-3;

/// Whether `effect` is friction that differs by direction by no more, as far as its estimates tell, than the load of each recording may be
/// off: then this does the same.
pub fn accounts_for(data: &Data, found: &Hypothesis, effect: EffectId) -> bool {
    let off = |run: &Data| match &run.signals.load {
        Load::KnownConstant(value) => KNOWN * value.abs(),
        Load::Measured => KNOWN * run.signals.tau_m.as_deref().map_or(0.0, peak),
        _ => 0.0,
    };
    let off = data.runs().iter().map(off).fold(f64::INFINITY, f64::min);
    if effect != EffectId::AsymmetricFriction || off == 0.0 {
        return false;
    }
    let estimates = Outputs::new(data, found).effect(effect);
    let least = |name: &str| {
        let known = estimates.get(name).and_then(|e| e.value.zip(e.stderr));
        known.map_or(0.0, |(value, stderr)| (value.abs() - stderr).max(0.0))
    };
    !estimates.is_empty() && least("tau_a") + least("b_a") * data.signals.context.omega_m_max() <= off
}

/// Mean of the load that the machine file states or that was measured, N·m; of several recordings that of the first.
pub fn mean(data: &Data) -> Option<f64> {
    let run = data.runs().iter().find(|run| run.has_mechanical())?;
    match &run.signals.load {
        Load::KnownConstant(value) => Some(*value),
        Load::Measured => {
            let tau_m = run.signals.tau_m.as_deref()?;
            Some(tau_m.iter().sum::<f64>() / tau_m.len().max(1) as f64)
        }
        _ => None,
    }
}

/// A torque that is the same in both directions is what a load that is a little off makes, too, where the file states or measures it.
/// `asymmetric` are the estimates of friction that differs by direction, if it was found.
pub fn may_be_off(data: &Data, asymmetric: &BTreeMap<String, Estimate>) -> Option<Finding> {
    let known = |run: &Data| {
        !matches!(run.signals.load, Load::UnknownConstant | Load::UnknownPiecewise | Load::Locked)
    };
    if !data.runs().iter().any(known) {
        return None;
    }
    let torque = asymmetric.get("tau_a")?;
    let (value, stderr) = torque.value.zip(torque.stderr)?;
    (value.abs() > stderr).then(|| Finding {
        finding: format!(
            "a load that is {:.3} N·m {} than the log or the machine file says would do what tau_a does",
            value.abs(),
            if value > 0.0 { "more" } else { "less" }
        ),
        consequence: "friction that differs by direction, and a load, a zero or a scale of the torque that is off, are one and the same in this respect"
            .into(),
        fix: "compare it with what the load is known to; give [load] kind = \"unknown_constant\" where it is not, and see what is left"
            .into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::drive::{Choice, Schedule};

    #[test]
    fn a_load_that_is_stated_may_be_off_and_one_that_is_open_may_not() {
        let torque = |value: f64, stderr: f64| {
            let (value, stderr, unit) = (Some(value), Some(stderr), "N m".into());
            let estimate = Estimate { value, stderr, ci95: None, unit, why_none: None };
            BTreeMap::from([("tau_a".to_string(), estimate)])
        };
        let told = |kind: &str, torque: &BTreeMap<String, Estimate>| {
            let mut manoeuvre = speeds(0.3, &[(0.1, 50.0), (0.2, -40.0)]);
            manoeuvre.tau_load = Some(Schedule::constant(1.0).unwrap());
            manoeuvre.load_kind = Some(kind.into());
            may_be_off(&data(&setup(manoeuvre, Vec::new())).0, torque).map(|finding| finding.finding)
        };
        let said = told("known_constant", &torque(-0.2, 0.05)).unwrap();
        assert!(said.contains("0.200 N·m less"), "{said}");
        assert_eq!(told("known_constant", &torque(-0.2, 0.5)), None);
        assert_eq!(told("known_constant", &BTreeMap::new()), None);
        assert_eq!(told("unknown_constant", &torque(-0.2, 0.05)), None);
    }

    #[test]
    fn what_a_load_may_be_off_by_is_no_friction() {
        let accounted = |kind: &str, present: Vec<Choice>| {
            let mut manoeuvre = speeds(0.6, &[(0.05, 50.0), (0.2, -40.0), (0.35, 60.0), (0.5, -30.0)]);
            manoeuvre.tau_load = Some(Schedule::constant(5.0).unwrap());
            manoeuvre.load_kind = Some(kind.into());
            let (data, base) = data(&setup(manoeuvre, present));
            let found = fitted(&data, &base, EffectId::AsymmetricFriction);
            assert!(!accounts_for(&data, &found, EffectId::CoulombFriction));
            accounts_for(&data, &found, EffectId::AsymmetricFriction)
        };
        let strong = |name: &str, value: f64| vec![choice("asymmetric_friction", name, value)];
        assert!(accounted("known_constant", Vec::new()) && accounted("measured", Vec::new()));
        assert!(!accounted("unknown_constant", Vec::new()));
        assert!(!accounted("known_constant", strong("tau_a", 0.1)));
        assert!(!accounted("measured", strong("b_a", 2e-3)));
    }
}
