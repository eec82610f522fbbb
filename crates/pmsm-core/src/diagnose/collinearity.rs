//! Collinearity: parameters of effects that a recording hardly separates from base parameters, and whether the effect itself is in doubt.

use super::hypothesis::Hypothesis;
use crate::effect::Role;
use crate::effects::EffectId;
use crate::machine::BaseParameter;
use crate::signals::Finding;
use nalgebra::DMatrix;

/// Correlation of two estimates from which they are said to be hardly separable.
const INSEPARABLE: f64 = 0.95;
/// Normal quantile of 95 % to one side.
const ONE_SIDED: f64 = 1.644_854;

/// A parameter of an effect that is hardly separable from base parameters.
pub struct Collinearity {
    /// The effect.
    pub effect: EffectId,
    /// Its parameter.
    pub parameter: &'static str,
    /// Whether this is a strength that might as well be none, so that the effect itself is in doubt.
    pub doubtful: bool,
    /// The base parameters.
    pub others: Vec<&'static str>,
    /// Largest correlation of the estimates.
    pub correlation: f64,
}

/// The collinear parameters of a hypothesis whose parameters `free` were estimated with this covariance, in the order of `free`. Estimates of
/// effects scatter `form` times as much.
pub fn collinear(
    hypothesis: &Hypothesis,
    free: &[usize],
    covariance: &DMatrix<f64>,
    form: f64,
) -> Vec<Collinearity> {
    let place = |index: usize| free.iter().position(|f| *f == index);
    let correlation =
        |a: usize, b: usize| (covariance[(a, b)] / (covariance[(a, a)] * covariance[(b, b)]).sqrt()).abs();
    let mut out = Vec::new();
    for slot in hypothesis.model.slots() {
        for (index, info) in slot.parameters.clone().zip(slot.effect.info().parameters) {
            let Some(a) = place(index) else { continue };
            let tied: Vec<(&str, f64)> = BaseParameter::ALL
                .iter()
                .filter_map(|base| Some((base.name(), correlation(a, place(base.index())?))))
                .filter(|(_, r)| r.is_finite() && *r > INSEPARABLE)
                .collect();
            if tied.is_empty() {
                continue;
            }
            let least = ONE_SIDED * form * covariance[(a, a)].sqrt();
            out.push(Collinearity {
                effect: slot.effect,
                parameter: info.name,
                doubtful: info.role == Role::Amplitude && hypothesis.parameters[index].abs() < least,
                others: tied.iter().map(|(name, _)| *name).collect(),
                correlation: tied.iter().fold(0.0, |most, (_, r)| r.max(most)),
            });
        }
    }
    out
}

/// What the user should know of them: one finding for the parameters of an effect that go with the same others.
pub fn findings(ties: &[Collinearity]) -> Vec<Finding> {
    let alike = |a: &Collinearity, b: &Collinearity| a.effect == b.effect && a.others == b.others;
    let told = |group: &[Collinearity]| {
        let names: Vec<&str> = group.iter().map(|tie| tie.parameter).collect();
        let (is, from) = (if names.len() > 1 { "are" } else { "is" }, group[0].others.join(", "));
        let most = group.iter().fold(0.0, |most: f64, tie| most.max(tie.correlation));
        Finding {
            finding: format!(
                "{} of {} {is} hardly separable from {from} here (correlation {most:.2})",
                names.join(", "),
                group[0].effect.id()
            ),
            consequence: "each can take over the part of the others, so that none of their values is reliable by itself"
                .into(),
            fix: "record at other speeds, currents and directions as well".into(),
        }
    };
    ties.chunk_by(alike).map(told).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, MACHINE};
    use crate::model::Model;

    /// Saturation of the q axis with strength k = 0.5 and exponent s = 2, whose estimates have these standard errors; `tied` says
    /// which of them goes with l_q, by a correlation of 0.98.
    fn found(stderr: [f64; 2], tied: usize) -> Vec<Collinearity> {
        let model = Model::new(CX, &[EffectId::SaturationQ]);
        let own = model.slots()[0].parameters.clone();
        let hypothesis = Hypothesis::unfitted(model, [&MACHINE[..], &[0.5, 2.0]].concat());
        let free = [BaseParameter::LD.index(), BaseParameter::LQ.index(), own.start, own.start + 1];
        let size = [0.1, 0.1, stderr[0], stderr[1]];
        let covariance = DMatrix::from_fn(4, 4, |r, c| {
            let pair = [r.min(c), r.max(c)] == [1, 2 + tied];
            size[r]
                * size[c]
                * if r == c {
                    1.0
                } else if pair {
                    0.98
                } else {
                    0.3
                }
        });
        collinear(&hypothesis, &free, &covariance, 1.5)
    }

    #[test]
    fn a_strength_that_might_as_well_be_none_puts_its_effect_in_doubt() {
        // 0.5 over 1.5 × 0.25 is 1.33 standard errors, over 1.5 × 0.15 it is 2.2.
        for (stderr, doubtful) in [(0.25, true), (0.15, false)] {
            let found = found([stderr, 0.1], 0);
            assert_eq!(found.len(), 1);
            assert_eq!((found[0].parameter, &found[0].others[..]), ("k", &["l_q"][..]));
            assert_eq!(found[0].doubtful, doubtful);
            assert!((found[0].correlation - 0.98).abs() < 1e-12);
        }
    }

    #[test]
    fn the_shape_of_an_effect_may_be_anything_without_a_doubt_of_the_effect() {
        let found = found([0.01, 5.0], 1);
        assert_eq!((found.len(), found[0].parameter, found[0].doubtful), (1, "s", false));
    }

    #[test]
    fn what_goes_with_no_base_parameter_is_no_tie() {
        let model = Model::new(CX, &[EffectId::SaturationQ]);
        let own = model.slots()[0].parameters.clone();
        let hypothesis = Hypothesis::unfitted(model, [&MACHINE[..], &[0.5, 2.0]].concat());
        // The two of one effect go with each other.
        let covariance = DMatrix::from_row_slice(2, 2, &[1.0, 0.99, 0.99, 1.0]);
        assert!(collinear(&hypothesis, &[own.start, own.start + 1], &covariance, 1.5).is_empty());
    }

    #[test]
    fn what_goes_with_the_same_parameters_is_told_at_once() {
        let tie = |parameter: &'static str, others: &[&'static str], correlation: f64| Collinearity {
            effect: EffectId::SaturationQ,
            parameter,
            doubtful: false,
            others: others.to_vec(),
            correlation,
        };
        let told = findings(&[tie("k", &["l_q"], 0.96), tie("s", &["l_q"], 0.98), tie("s", &["r_s"], 0.97)]);
        assert_eq!(told.len(), 2);
        assert!(told[0].finding.starts_with("k, s of saturation_q are hardly separable from l_q"));
        assert!(told[0].finding.contains("0.98") && told[1].finding.starts_with("s of saturation_q is"));
    }
}
