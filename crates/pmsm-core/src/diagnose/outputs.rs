//! Parameters of a fitted hypothesis with their uncertainties.

use super::answer::Estimate;
use super::hypothesis::{Data, Hypothesis};
use crate::effects::EffectId;
use crate::machine::BaseParameter;
use crate::model::Base;
use crate::real::Dual;
use crate::start;
use crate::uncertainty;
use nalgebra::DMatrix;
use std::collections::BTreeMap;

/// Parameters that one effect's outputs may depend on.
const LANES: usize = 8;
/// Relative standard error from which a parameter is said not to be shown.
const UNSHOWN: f64 = 0.5;
/// Normal quantile of a 95 % interval.
const Z95: f64 = 1.959_964;

/// Uncertainty of a fitted hypothesis on its recording.
pub struct Outputs<'a> {
    data: &'a Data,
    hypothesis: &'a Hypothesis,
    free: Vec<usize>,
    covariance: DMatrix<f64>,
}

impl<'a> Outputs<'a> {
    /// Works out the covariance of the fitted parameters, corrected for coloured residuals.
    pub fn new(data: &'a Data, hypothesis: &'a Hypothesis) -> Self {
        let experiment = data.whole(hypothesis);
        let free = hypothesis.free.clone();
        let covariance = if free.is_empty() {
            DMatrix::zeros(0, 0)
        } else {
            let linear = experiment.linearise(&hypothesis.parameters, &free);
            uncertainty::covariance(&linear.jacobian, &linear.residual, data.signals.len())
        };
        Self { data, hypothesis, free, covariance }
    }

    fn variance_of(&self, a: usize, b: usize) -> f64 {
        let place = |index: usize| self.free.iter().position(|f| *f == index);
        match (place(a), place(b)) {
            (Some(a), Some(b)) => self.covariance[(a, b)],
            _ => 0.0,
        }
    }

    /// Base parameters by name, an unknown load with them: `tau_load`, or its levels and instants.
    pub fn base(&self) -> BTreeMap<String, Estimate> {
        let own = self.hypothesis.own().len();
        let nuisance = self.hypothesis.nuisance;
        let levels = (0..nuisance.levels).map(|k| match nuisance.levels {
            1 => ("tau_load".to_string(), own, "N m"),
            _ => (format!("tau_load_{}", k + 1), own + k, "N m"),
        });
        let instants =
            (0..nuisance.steps()).map(|k| (format!("t_load_{}", k + 1), own + nuisance.levels + k, "s"));
        let load = levels.chain(instants).map(|(name, index, unit)| {
            let value = self.hypothesis.parameters[index];
            (name, estimate(value, self.variance_of(index, index), unit, None))
        });
        let base = self.base_parameters();
        base.into_iter().chain(load).collect()
    }

    fn base_parameters(&self) -> BTreeMap<String, Estimate> {
        BaseParameter::ALL
            .iter()
            .filter(|p| start::needed(&self.data.signals, **p))
            .map(|p| {
                let index = p.index();
                let value = self.hypothesis.parameters[index];
                let why = if self.free.contains(&index) {
                    None
                } else {
                    Some("held at the nameplate value: the recording does not contain it".to_string())
                };
                let variance = self.variance_of(index, index);
                (p.name().to_string(), estimate(value, variance, p.unit(), why))
            })
            .collect()
    }

    /// The outputs of one effect by name, with errors carried through by their derivatives.
    pub fn effect(&self, effect: EffectId) -> BTreeMap<String, Estimate> {
        let hypothesis = self.hypothesis;
        let Some(slot) = hypothesis.model.slots().iter().find(|s| s.effect == effect) else {
            return BTreeMap::new();
        };
        let fitted: Vec<usize> =
            slot.parameters.clone().filter(|k| self.free.contains(k)).take(LANES).collect();
        let mut seeded: Vec<Dual<LANES>> =
            hypothesis.own().iter().map(|x| crate::real::Real::constant(*x)).collect();
        for (lane, index) in fitted.iter().enumerate() {
            seeded[*index] = Dual::variable(hypothesis.parameters[*index], lane);
        }
        let base = Base::new(&seeded);
        effect
            .outputs(&seeded[slot.parameters.clone()], &base, hypothesis.model.context())
            .into_iter()
            .map(|(name, unit, value)| {
                let mut variance = 0.0;
                for (a, ka) in fitted.iter().enumerate() {
                    for (b, kb) in fitted.iter().enumerate() {
                        let weight = value.eps[a] * value.eps[b];
                        if weight != 0.0 {
                            variance += weight * self.variance_of(*ka, *kb);
                        }
                    }
                }
                let fixed = value.eps.iter().all(|e| *e == 0.0);
                let why = fixed.then(|| "a whole number, chosen and not estimated".to_string());
                (name.to_string(), estimate(value.re, variance, unit, why))
            })
            .collect()
    }
}

fn estimate(value: f64, variance: f64, unit: &str, why: Option<String>) -> Estimate {
    let stderr = variance.max(0.0).sqrt();
    let why = why.or_else(|| (!stderr.is_finite()).then(|| "the recording does not show it".to_string()));
    let shown = why.is_none();
    let why = why.or_else(|| {
        (stderr > UNSHOWN * value.abs()).then(|| "uncertain: the recording hardly shows it".to_string())
    });
    Estimate {
        value,
        stderr: shown.then_some(stderr),
        ci95: shown.then_some([value - Z95 * stderr, value + Z95 * stderr]),
        unit: unit.into(),
        why_none: if shown { None } else { why },
    }
}
