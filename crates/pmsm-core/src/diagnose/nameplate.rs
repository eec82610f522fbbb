//! Contradictions between estimates and the nameplate. They are no missing physics: a wrong unit or scale fits as well as the right one.

use super::answer::Estimate;
use super::data::Data;
use super::options::DiagnosisOptions;
use crate::figures::quantity;
use crate::machine::{BaseParameter, Machine};
use crate::numerics::transforms::SQRT3;
use crate::signals::Finding;
use std::collections::BTreeMap;
use std::f64::consts::SQRT_2;

/// Standard errors beyond which a value of known uncertainty and the nameplate's differ.
const DIFFERS: f64 = 3.0;
/// Factor by which a nameplate may be off either way; what lies beyond was written or measured in another unit or scale.
const OFF: f64 = 1.35;
/// Standard error, share of the value, up to which a parameter is known well enough to be compared with the nameplate.
const CERTAIN: f64 = 0.1;
/// What may be in a wrong scale, and the powers of it by which r_s, l_d, l_q, psi_m and j are then off.
const LOGGED: [(Scaled, &str, [f64; 5]); 4] = [
    (Scaled::Voltages, "the scale of the voltages, or speed and time", [1.0, 1.0, 1.0, 1.0, 1.0]),
    (Scaled::Currents, "the scale of the currents", [-1.0, -1.0, -1.0, 0.0, 1.0]),
    (Scaled::Both, "the scale of both currents and voltages", [0.0, 0.0, 0.0, 1.0, 2.0]),
    (Scaled::PolePairs, "the number of pole pairs n_p", [0.0, 0.0, 0.0, 0.0, 2.0]),
];
/// Scales that are mistaken for one another.
const MISTAKEN: [(f64, &str); 5] = [
    (1.224_744_871_391_589, "√1.5, as power-invariant d and q stand to amplitude-invariant ones"),
    (SQRT_2, "√2, as rms stands to peak values"),
    (SQRT3, "√3, as line-to-line stands to phase voltages"),
    (10.0, "10, as a probe's ratio may be"),
    (1000.0, "1000, as a unit's prefix may be"),
];
/// The same of the number of pole pairs.
const POLES: [(f64, &str); 1] = [(2.0, "2, as poles stand to pole pairs")];
/// The same of voltages over the DC link's.
const OF_LINK: [(f64, &str); 3] = [
    (2.0, "2/v_dc, as a modulation index stands to its voltage"),
    (1.0, "1/v_dc, as a duty cycle stands to its voltage"),
    (SQRT3, "√3/v_dc, as the index of space vectors stands to its voltage"),
];

/// What may be in a wrong scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scaled {
    /// All voltages, which a wrong speed and time look like.
    Voltages,
    /// All currents.
    Currents,
    /// Both by the same factor.
    Both,
    /// The pole pairs: of given currents they make the torque.
    PolePairs,
}

/// The factors by which something may have been logged too large; `link` is the DC link's voltage where it is stated.
fn factors(scaled: Scaled, link: Option<f64>) -> Vec<(f64, &'static str)> {
    let usual = if scaled == Scaled::PolePairs { &POLES[..] } else { &MISTAKEN };
    let mut factors: Vec<(f64, &str)> =
        usual.iter().flat_map(|(factor, words)| [(*factor, *words), (1.0 / factor, *words)]).collect();
    if let Some(v_dc) = link.filter(|_| scaled == Scaled::Voltages) {
        factors.extend(OF_LINK.map(|(factor, words)| (factor / v_dc, words)));
    }
    factors
}

/// What voltages are that were logged so many times too large, where that is a share of the DC link's voltage, V.
pub fn of_link(factor: f64, link: f64) -> Option<&'static str> {
    let share = |x: &&(f64, &str)| (factor * link / x.0 - 1.0).abs() < 1e-9;
    OF_LINK.iter().find(share).map(|(_, words)| *words)
}

/// The base parameters that are known well enough over those of the nameplate. The friction of bearings varies too much for one.
pub fn ratios(data: &Data, base: &BTreeMap<String, Estimate>) -> Vec<(BaseParameter, f64)> {
    let ratio = |p: &BaseParameter| {
        let nameplate = data.nameplate[p.index()]?;
        let found = base.get(p.name()).filter(|e| certain(e))?.value?;
        (nameplate > 0.0 && found > 0.0).then(|| (*p, found / nameplate))
    };
    BaseParameter::ALL.iter().filter(|p| **p != BaseParameter::B).filter_map(ratio).collect()
}

fn is_off(ratio: f64) -> bool {
    ratio.ln().abs() > OFF.ln()
}

/// Whether a parameter is farther from the nameplate than one may be off.
pub fn contradict(ratios: &[(BaseParameter, f64)]) -> bool {
    ratios.iter().any(|(_, ratio)| is_off(*ratio))
}

/// Half the sum of squares of the deviations from the nameplate in units of its spread: nats.
pub fn misfit(ratios: &[(BaseParameter, f64)], options: &DiagnosisOptions) -> f64 {
    ratios.iter().map(|(_, ratio)| 0.5 * (ratio.ln() / options.nameplate_spread).powi(2)).sum()
}

/// Base parameters that came out far from the nameplate, and of what scale that may come. A poor recording does not contradict it.
pub fn contradicts(data: &Data, base: &BTreeMap<String, Estimate>) -> Option<Finding> {
    if data.poor {
        return None;
    }
    let ratios = ratios(data, base);
    let off: Vec<String> = ratios
        .iter()
        .filter(|(_, ratio)| is_off(*ratio))
        .map(|(p, ratio)| format!("{} at {ratio:.3} times", p.name()))
        .collect();
    (!off.is_empty()).then(|| Finding {
        finding: format!("this comes out far from the nameplate: {} its value there", off.join(", ")),
        consequence:
            "a wrong unit, scale or number of pole pairs fits as well as the right one, and nothing else tells of it"
                .into(),
        fix: format!("check {}", suspect(&ratios, data.link())),
    })
}

/// A finding where a value with its standard error lies farther from that on the nameplate than the spread of nameplates.
pub fn contradicts_value(
    machine: &Machine,
    (parameter, value, error): (BaseParameter, f64, f64),
    options: &DiagnosisOptions,
) -> Option<Finding> {
    let stated = machine.get(parameter).filter(|stated| *stated > 0.0 && parameter != BaseParameter::B)?;
    let far =
        (value / stated).ln().abs() > options.nameplate_spread && (value - stated).abs() > DIFFERS * error;
    (value <= 0.0 || far).then(|| Finding {
        finding: format!(
            "{} is {} by these points, the nameplate states {}",
            parameter.name(),
            quantity(value, 4, parameter.unit()),
            quantity(stated, 4, parameter.unit())
        ),
        consequence: "one of the two is not that of this machine, or not in this state".into(),
        fix: "check the nameplate, n_p, and units and scale of the columns".into(),
    })
}

fn certain(estimate: &Estimate) -> bool {
    estimate.value.zip(estimate.stderr).is_some_and(|(value, stderr)| stderr <= CERTAIN * value.abs())
}

/// The mistake of scale that brings all ratios nearest to one, where it brings them as near as a nameplate may be off: what is scaled, by
/// which factor, and both in words. `link` is the DC link's voltage where it is stated, V.
pub fn scale(ratios: &[(BaseParameter, f64)], link: Option<f64>) -> Option<(Scaled, f64, String)> {
    let left = |powers: &[f64; 5], scale: f64| -> Vec<f64> {
        ratios.iter().map(|(p, ratio)| ratio.ln() - powers[p.index()] * scale.ln()).collect()
    };
    let mut best: Option<(f64, (Scaled, f64, String))> = None;
    for (scaled, logged, powers) in &LOGGED {
        for (factor, words) in factors(*scaled, link) {
            let left = left(powers, factor);
            let square = left.iter().map(|x| x * x).sum::<f64>();
            let near = left.iter().all(|x| x.abs() <= OFF.ln());
            if near && best.as_ref().is_none_or(|(least, _)| square < *least) {
                best = Some((square, (*scaled, factor, format!("{logged}: the factor may be {words}"))));
            }
        }
    }
    best.map(|(_, found)| found)
}

/// All mistakes of scale: what is scaled, by which factor, and by which the torque of the log is then too large.
pub fn torque_scales(link: Option<f64>) -> Vec<(Scaled, f64, f64)> {
    let of_each = |(scaled, ..): (Scaled, &str, [f64; 5])| {
        let torque = move |factor: f64| if scaled == Scaled::Both { factor * factor } else { factor };
        factors(scaled, link).into_iter().map(move |(factor, _)| (scaled, factor, torque(factor)))
    };
    LOGGED.into_iter().flat_map(of_each).collect()
}

/// What is to be checked where base parameters come out at these multiples of the nameplate.
fn suspect(ratios: &[(BaseParameter, f64)], link: Option<f64>) -> String {
    match scale(ratios, link) {
        Some((.., words)) => words,
        None => "the nameplate, n_p, and the units of voltages, currents, speed and time".into(),
    }
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
        let voltages =
            suspect(&[(P::RS, 1.5), (P::LD, 1.35), (P::LQ, 1.3), (P::PsiM, 1.45), (P::J, 1.5)], Some(540.0));
        assert!(voltages.contains("voltages") && voltages.contains("√2"), "{voltages}");
        let currents =
            suspect(&[(P::RS, 0.1), (P::LD, 0.09), (P::LQ, 0.11), (P::PsiM, 1.1), (P::J, 9.0)], Some(540.0));
        assert!(currents.contains("currents") && currents.contains("probe"), "{currents}");
        let scaled = suspect(
            &[(P::RS, 0.95), (P::LD, 1.03), (P::LQ, 0.97), (P::PsiM, 1.25), (P::J, 1.43)],
            Some(540.0),
        );
        assert!(scaled.contains("power-invariant"), "{scaled}");
        let turns =
            suspect(&[(P::RS, 1.1), (P::LD, 0.9), (P::LQ, 1.0), (P::PsiM, 1.0), (P::J, 4.0)], Some(540.0));
        assert!(turns.contains("n_p"), "{turns}");
        let index = 2.0 / 540.0;
        let small = [P::RS, P::LD, P::LQ, P::PsiM, P::J].map(|p| (p, 1.1 * index));
        let (known, unknown) = (suspect(&small, Some(540.0)), suspect(&small, None));
        assert!(known.contains("modulation index") && !unknown.contains("modulation"), "{known} {unknown}");
        assert!(of_link(index, 540.0).is_some_and(|words| words.contains("modulation index")));
        assert_eq!(of_link(1.3 * index, 540.0), None);
    }
}
