//! Score test: how much of what a fitted model leaves could each effect explain, to first order?
//!
//! The derivatives of the exact simulation with respect to an effect's amplitudes, at zero amplitude and for every shape
//! on its grid, are freed of what the already fitted parameters can do; what they then explain of the residual is the score.
//! Channels are weighed by what is left in them, so that a large misfit in one does not hide a small one in another.

use super::hypothesis::{Data, Hypothesis};
use crate::effect::{Role, Site};
use crate::effects::EffectId;
use crate::model::Model;
use nalgebra::{DMatrix, DVector};

/// The most promising start for fitting one more effect.
#[derive(Debug, Clone)]
pub struct Prospect {
    /// The effect.
    pub effect: EffectId,
    /// Its parameters: best shape, first-order amplitudes within bounds.
    pub start: Vec<f64>,
    /// Mean square explained, in units of what is left in each channel, summed over the channels.
    pub score: f64,
    /// Mean square that the effect at its typical strength would add and the fitted parameters could not absorb, in units
    /// of the floor: what this recording would show of it.
    pub visible: f64,
}

/// Scores `effect` added to `hypothesis`.
pub fn score(data: &Data, hypothesis: &Hypothesis, effect: EffectId) -> Prospect {
    let mut effects = hypothesis.effects();
    effects.push(effect);
    let context = *hypothesis.model.context();
    let model = Model::new(context, &effects);
    let slot = model.slots().last().expect("just added").clone();
    let info = effect.info();
    let amplitudes: Vec<usize> = (0..info.parameters.len())
        .filter(|k| info.parameters[*k].role == Role::Amplitude && effect.fitted(&context, *k))
        .collect();
    let own = hypothesis.own();
    let tail = &hypothesis.parameters[own.len()..];
    // The new effect's parameters push the run's own ones back.
    let shift = info.parameters.len();
    let nuisance = crate::simulate::mechanical::Nuisance {
        initial: model.mechanical_states(),
        ..hypothesis.nuisance
    };
    let extra = nuisance.initial - hypothesis.nuisance.initial;
    // A purely mechanical effect leaves the voltage equations as they are.
    let rotor_only = info.site == Site::Mechanical;
    let fitted: Vec<usize> = hypothesis
        .free
        .iter()
        .filter(|k| !(rotor_only && data.whole(hypothesis).is_electrical(**k)))
        .map(|k| if *k < own.len() { *k } else { k + shift })
        .collect();
    let mut best = Prospect { effect, start: effect.probes(&context).swap_remove(0), score: 0.0, visible: 0.0 };
    for probe in effect.probes(&context) {
        let mut parameters = own.to_vec();
        parameters.extend(probe.iter().enumerate().map(|(k, x)| if amplitudes.contains(&k) { 0.0 } else { *x }));
        parameters.extend(tail);
        parameters.extend(std::iter::repeat_n(0.0, extra));
        let mut free = fitted.clone();
        free.extend(amplitudes.iter().map(|k| slot.parameters.start + k));
        let channels = data
            .floors
            .iter()
            .filter(|f| !(rotor_only && f.channel.is_electrical()))
            .map(|f| (f.channel, f.total() * hypothesis.square(f.channel).max(1.0).sqrt()))
            .collect();
        let mut experiment = data.whole(hypothesis);
        (experiment.model, experiment.nuisance, experiment.channels) = (&model, nuisance, channels);
        let linear = experiment.linearise(&parameters, &free);
        let (gain, step, schur) = projected(&linear.jacobian, &linear.residual, fitted.len());
        let n = data.signals.len() as f64;
        let typical =
            DVector::from_iterator(amplitudes.len(), amplitudes.iter().map(|k| (info.parameters[*k].typical)(&context)));
        best.visible = best.visible.max((typical.transpose() * &schur * &typical)[(0, 0)] / n);
        let score = gain / n;
        if score > best.score {
            let mut start = probe.clone();
            for (k, s) in amplitudes.iter().zip(step.iter()) {
                let parameter = &info.parameters[*k];
                let (low, high) = ((parameter.low)(&context), (parameter.high)(&context));
                let least = 0.02 * (parameter.typical)(&context).abs();
                let wanted = if s.abs() < least { least.copysign(*s) } else { *s };
                start[*k] = wanted.clamp(low, high);
            }
            (best.start, best.score) = (start, score);
        }
    }
    best
}

/// Gain, step and information of the last columns after those before them are projected out.
fn projected(
    jacobian: &DMatrix<f64>,
    residual: &DVector<f64>,
    fixed: usize,
) -> (f64, DVector<f64>, DMatrix<f64>) {
    let count = jacobian.ncols();
    let scale: Vec<f64> = jacobian.column_iter().map(|c| c.norm()).collect();
    let unit = DMatrix::from_fn(jacobian.nrows(), count, |r, c| {
        if scale[c] > 0.0 { jacobian[(r, c)] / scale[c] } else { 0.0 }
    });
    let gram = unit.tr_mul(&unit);
    let right = unit.tr_mul(residual);
    let (a, b, c) = (
        gram.view((0, 0), (fixed, fixed)).into_owned(),
        gram.view((0, fixed), (fixed, count - fixed)).into_owned(),
        gram.view((fixed, fixed), (count - fixed, count - fixed)).into_owned(),
    );
    let inverse = a.pseudo_inverse(1e-10).unwrap_or_else(|_| DMatrix::zeros(fixed, fixed));
    let schur = c - b.transpose() * &inverse * &b;
    let rest = right.rows(fixed, count - fixed) - b.transpose() * &inverse * right.rows(0, fixed);
    let solved = schur.clone().pseudo_inverse(1e-8).map_or_else(|_| DVector::zeros(count - fixed), |m| m * &rest);
    let gain = rest.dot(&solved);
    let step = DVector::from_fn(count - fixed, |k, _| {
        if scale[fixed + k] > 0.0 { -solved[k] / scale[fixed + k] } else { 0.0 }
    });
    let free = DMatrix::from_fn(count - fixed, count - fixed, |r, c| {
        schur[(r, c)] * scale[fixed + r] * scale[fixed + c]
    });
    (gain.max(0.0), step, free)
}
