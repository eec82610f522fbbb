//! What an answer contradicts of the nameplate. That is no physics that a model leaves out, and a wrong unit or scale fits as well as the
//! right one.

use super::answer::Estimate;
use super::data::Data;
use crate::machine::BaseParameter;
use crate::signals::Finding;
use crate::transforms::SQRT3;
use std::collections::BTreeMap;
use std::f64::consts::SQRT_2;

/// Factor by which a nameplate may be off either way; what lies beyond was written or measured in another unit or scale.
const OFF: f64 = 1.35;
/// Standard error, share of the value, up to which a parameter is known well enough to be held against the nameplate.
const CERTAIN: f64 = 0.1;
/// Factor within which parameters are off by one scale, and within which that is one of those that are mistaken for one another.
const SAME: f64 = 1.25;
const NEAR: f64 = 1.15;
const MISTAKEN: [(f64, &str); 4] = [
    (SQRT_2, "√2, as rms stands to peak values"),
    (SQRT3, "√3, as line-to-line stands to phase voltages"),
    (10.0, "10, as a probe's ratio may be"),
    (1000.0, "1000, as a unit's prefix may be"),
];

/// Base parameters that came out far from the nameplate, and of what scale that may come. A poor recording does not contradict it.
pub fn against_nameplate(data: &Data, base: &BTreeMap<String, Estimate>) -> Option<Finding> {
    if data.poor {
        return None;
    }
    let ratio = |p: &BaseParameter| {
        let nameplate = data.nameplate[p.index()]?;
        let found = base.get(p.name()).filter(|e| certain(e))?.value?;
        (nameplate > 0.0 && found > 0.0).then(|| (*p, found / nameplate))
    };
    // A bearing's friction is nobody's nameplate.
    let ratios: Vec<(BaseParameter, f64)> =
        BaseParameter::ALL.iter().filter(|p| **p != BaseParameter::B).filter_map(ratio).collect();
    let off: Vec<String> = ratios
        .iter()
        .filter(|(_, ratio)| ratio.ln().abs() > OFF.ln())
        .map(|(p, ratio)| format!("{} at {ratio:.3} times", p.name()))
        .collect();
    (!off.is_empty()).then(|| Finding {
        finding: format!("this comes out far from the nameplate: {} its value there", off.join(", ")),
        consequence:
            "a wrong unit, scale or number of pole pairs fits as well as the right one, and nothing else tells of it"
                .into(),
        fix: format!("check {}", suspect(&ratios)),
    })
}

fn certain(estimate: &Estimate) -> bool {
    estimate.value.zip(estimate.stderr).is_some_and(|(value, stderr)| stderr <= CERTAIN * value.abs())
}

/// What is to be checked where base parameters come out at these multiples of the nameplate.
fn suspect(ratios: &[(BaseParameter, f64)]) -> String {
    let of = |wanted: &[BaseParameter]| -> Vec<f64> {
        ratios.iter().filter(|(p, _)| wanted.contains(p)).map(|(_, r)| r.ln()).collect()
    };
    let winding = of(&[BaseParameter::RS, BaseParameter::LD, BaseParameter::LQ]);
    let flux = of(&[BaseParameter::PsiM]);
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let alike = |x: &[f64]| x.len() > 1 && x.iter().all(|r| (r - mean(x)).abs() < SAME.ln());
    let far = |x: &[f64]| alike(x) && mean(x).abs() > OFF.ln();
    let named = |scale: f64| {
        let known = MISTAKEN.iter().find(|(known, _)| (scale.abs() - known.ln()).abs() < NEAR.ln());
        known.map_or(String::new(), |(_, words)| format!(": the factor may be {words}"))
    };
    let all = [&winding[..], &flux].concat();
    if far(&all) && !flux.is_empty() {
        return format!("the scale of the voltages, or of speed and time{}", named(mean(&all)));
    }
    if far(&winding) {
        return format!("the scale of the currents{}", named(mean(&winding)));
    }
    "the nameplate, n_p, and the units of voltages, currents, speed and time".into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use BaseParameter as P;

    #[test]
    fn what_is_hardly_known_contradicts_nothing() {
        let known =
            |stderr| Estimate { value: Some(2.0), stderr, ci95: None, unit: "H".into(), why_none: None };
        assert!(certain(&known(Some(0.1))) && !certain(&known(Some(0.5))) && !certain(&known(None)));
    }

    #[test]
    fn a_scale_is_recognised_by_what_it_multiplies() {
        let voltages = suspect(&[(P::RS, 1.5), (P::LD, 1.35), (P::LQ, 1.3), (P::PsiM, 1.45), (P::J, 1.0)]);
        assert!(voltages.contains("voltages") && voltages.contains("√2"), "{voltages}");
        let currents = suspect(&[(P::RS, 0.1), (P::LD, 0.09), (P::LQ, 0.11), (P::PsiM, 1.1)]);
        assert!(currents.contains("currents") && currents.contains("probe"), "{currents}");
        let turns = suspect(&[(P::RS, 1.1), (P::LD, 0.9), (P::LQ, 1.0), (P::PsiM, 1.0), (P::J, 4.0)]);
        assert!(turns.contains("n_p"), "{turns}");
    }
}
