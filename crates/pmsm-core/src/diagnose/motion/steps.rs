//! Steps of an unknown load: those that a fitted equation of motion still misses, and those that do not pay.

use super::state::State;
use crate::basis;
use crate::colour::effective_samples;
use crate::diagnose::data::Data;
use crate::experiment::{Channel, Fitted, Joint};
use crate::least_squares;
use crate::load_steps;
use crate::model::Model;
use crate::simulate::mechanical::Nuisance;
use nalgebra::{DMatrix, DVector};

/// Instants tried for a missing step.
const TRIED: usize = 96;
/// What a load step must be worth: this share of the floor's variance over all values in which what is left is looked at, and this
/// many times the variance of what is left, colour included.
const STEP_SHARE: f64 = 0.003;
const STEP_SIGNIFICANCE: f64 = 25.0;

/// The fitted load with one more step, at the instant where one explains most of what the simulation leaves, and that step's number. The
/// response to a step is the simulation's own.
pub fn with_missing_step(
    data: &Data,
    model: &Model,
    own: &[f64],
    state: &State,
    torque: &[f64],
) -> Option<(State, usize)> {
    let count = model.parameter_count();
    let duration = data.signals.context.duration;
    let spacing = duration / (TRIED + 1) as f64;
    let tried: Vec<f64> = (1..=TRIED)
        .map(|k| k as f64 * spacing)
        .filter(|t| state.steps.iter().all(|s| (s - t).abs() > 0.5 * spacing))
        .collect();
    // All instants at once, as steps of no height.
    let mut steps: Vec<f64> = state.steps.iter().chain(&tried).copied().collect();
    steps.sort_by(f64::total_cmp);
    let segment = |t: f64| state.steps.iter().filter(|s| **s <= t).count();
    let levels: Vec<f64> =
        std::iter::once(state.levels[0]).chain(steps.iter().map(|s| state.levels[segment(*s)])).collect();
    let nuisance = Nuisance { levels: levels.len(), initial: state.deviations.len() };
    let mut parameters = own.to_vec();
    parameters.extend(levels.iter().chain(&steps).chain(&state.deviations));
    let free: Vec<usize> = (count..count + levels.len()).collect();
    let linear = data.motion(model, &[nuisance], torque).linearise(&parameters, &free);
    // The response to a step is that to all levels behind it.
    let mut responses = linear.jacobian;
    for column in (1..levels.len()).rev() {
        let (mut before, behind) = responses.columns_range_pair_mut(column - 1, column);
        before += behind;
    }
    // What the present levels can do is theirs.
    let (mut present, mut others) = (vec![0], Vec::new());
    for (column, step) in (1..).zip(&steps) {
        if state.steps.contains(step) { &mut present } else { &mut others }.push(column);
    }
    let basis = basis::orthonormal(&responses.select_columns(&present));
    let gains = basis::gains(&basis, &responses.select_columns(&others), &linear.residual);
    let best = steps[others.into_iter().zip(gains).max_by(|a, b| a.1.total_cmp(&b.1))?.0 - 1];
    let at = segment(best);
    let mut more = state.clone();
    more.steps.insert(at, best);
    more.levels.insert(at, state.levels[at]);
    Some((more, at))
}

/// Numbers of the steps of the fitted load of recording `run` without those that have run into the one before, past it, or into an end
/// of the recording: nothing can be said of them there.
pub fn steps_apart(experiment: &Joint, fitted: &Fitted, run: usize) -> Vec<usize> {
    let (nuisance, own) = (experiment.runs()[run].nuisance, experiment.nuisance(run).start);
    let steps = &fitted.parameters[own + nuisance.levels..][..nuisance.steps()];
    let duration = experiment.runs()[run].signals.context.duration;
    let closest = load_steps::closest(duration);
    let mut last = 0.0;
    let mut apart = Vec::with_capacity(steps.len());
    for (at, step) in steps.iter().enumerate() {
        if *step > last + closest && *step < duration - closest {
            apart.push(at);
            last = *step;
        }
    }
    apart
}

/// Numbers of the steps of the fitted load of recording `run` that pay for themselves: the weakest is taken away as long as it does not, by
/// what equal levels on either side would cost to second order (Wald).
pub fn worthwhile_steps(experiment: &Joint, fitted: &Fitted, run: usize) -> Vec<usize> {
    let (nuisance, own) = (experiment.runs()[run].nuisance, experiment.nuisance(run).start);
    let mut kept: Vec<usize> = (0..nuisance.steps()).collect();
    if kept.is_empty() {
        return kept;
    }
    let residual = fitted.residual(experiment);
    let rows = experiment.rows(run, Channel::OmegaE).expect("a load shows in the speed");
    let residual = DVector::from_column_slice(&residual.as_slice()[rows]);
    let n = residual.len() as f64;
    let colour = n / effective_samples(residual.as_slice());
    let unit = (residual.norm_squared() / n).max(1.0) * colour.max(1.0);
    let threshold =
        (STEP_SIGNIFICANCE * unit).max(STEP_SHARE * experiment.runs()[run].fewest_speeds() as f64);
    let position = |index: usize| fitted.free.iter().position(|f| *f == index).expect("levels are free");
    // Constraints of the steps already taken away: level after minus level before.
    let constraint = |step: usize| {
        let mut row = DVector::zeros(fitted.free.len());
        row[position(own + step + 1)] = 1.0;
        row[position(own + step)] = -1.0;
        row
    };
    let levels = DVector::from_iterator(fitted.free.len(), fitted.free.iter().map(|k| fitted.parameters[*k]));
    let information = least_squares::scaled_inverse(&fitted.fit.normal.jtj);
    let mut gone: Vec<usize> = Vec::new();
    let cost = |steps: &[usize]| -> f64 {
        let rows: Vec<_> = steps.iter().map(|s| constraint(*s)).collect();
        let c = DMatrix::from_columns(&rows);
        let off = c.tr_mul(&levels);
        let spread = c.transpose() * &information * &c;
        spread.pseudo_inverse(1e-12).map_or(f64::INFINITY, |inverse| off.dot(&(inverse * &off)))
    };
    loop {
        let spent = if gone.is_empty() { 0.0 } else { cost(&gone) };
        let weakest = kept
            .iter()
            .map(|step| {
                let mut tried = gone.clone();
                tried.push(*step);
                (*step, cost(&tried) - spent)
            })
            .min_by(|a, b| a.1.total_cmp(&b.1));
        match weakest {
            Some((step, worth)) if worth < threshold => {
                kept.retain(|k| *k != step);
                gone.push(step);
            }
            _ => return kept,
        }
    }
}
