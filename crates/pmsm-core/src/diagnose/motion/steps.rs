//! Steps of an unknown load: those that a fitted equation of motion still misses, and those that explain too little.

use super::state::State;
use crate::diagnose::data::Data;
use crate::experiment::{Channel, Fitted, Joint};
use crate::load_steps;
use crate::model::Model;
use crate::noise::colour::effective_samples;
use crate::numerics::basis;
use crate::optimise::least_squares;
use crate::simulate::mechanical::Nuisance;
use nalgebra::{DMatrix, DVector};

/// Instants tried for a missing step.
const TRIED: usize = 96;
/// Least gain of a load step: this share of the floor's variance over all values of the residual, and this many times the variance of the
/// coloured residual.
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
    // The part that the present levels explain is projected off.
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

/// Numbers of the steps of the fitted load of recording `run` that explain more than their price. The weakest is removed as long as it does
/// not, by the Wald statistic of equal levels on either side.
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
    let count = nuisance.levels;
    let places: Vec<usize> = (0..count).map(|k| position(own + k)).collect();
    let mut levels = DVector::zeros(fitted.free.len());
    for (k, place) in places.iter().enumerate() {
        levels[*place] = fitted.parameters[own + k];
    }
    let information = &fitted.fit.normal.jtj;
    let mut gone: Vec<usize> = Vec::new();
    // The least that the sum of squares rises where the levels on both sides of each of `steps` are one, and all else gives way. A level
    // between two steps in a gap of the log is not determined at all: it may be either of its neighbours, but does not let these differ.
    let cost = |steps: &[usize]| -> f64 {
        let mut merged = DMatrix::zeros(levels.len(), levels.len() - steps.len());
        let mut column = 0;
        for (k, place) in places.iter().enumerate() {
            if k > 0 && !steps.contains(&(k - 1)) {
                column += 1;
            }
            merged[(*place, column)] = 1.0;
        }
        for place in (0..levels.len()).filter(|place| !places.contains(place)) {
            column += 1;
            merged[(place, column)] = 1.0;
        }
        let along = information * &merged;
        let fewer = least_squares::scaled_inverse(&merged.tr_mul(&along)) * along.tr_mul(&levels);
        let off = &levels - merged * fewer;
        off.dot(&(information * &off))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::data::SETTINGS;
    use crate::diagnose::testing::{prepared, setup, speeds};
    use crate::drive::{Schedule, Shape, simulate};
    use crate::machine::BaseParameter;
    use crate::monitor::Silent;
    use crate::recording::Recording;

    #[test]
    fn of_two_steps_in_a_gap_of_the_log_one_stays() {
        let mut manoeuvre = speeds(1.2, &[(0.1, 90.0), (0.4, -80.0), (0.8, 90.0), (1.1, -60.0)]);
        let load = Schedule::new(vec![(0.0, 1.0), (0.6, -1.5)], Shape::Steps).unwrap();
        manoeuvre.tau_load = Some(load);
        manoeuvre.load_kind = Some("unknown_piecewise".into());
        let setup = setup(manoeuvre, Vec::new());
        let whole = simulate(&setup, &Silent).unwrap().recording;
        let logged = |x: &[f64]| -> Vec<f64> {
            whole.t().iter().zip(x).filter(|(t, _)| !(0.55..0.65).contains(*t)).map(|(_, x)| *x).collect()
        };
        let names = ["t", "v_d", "v_q", "i_a", "i_b", "i_c", "theta_e", "omega_e"];
        let columns = names.iter().filter_map(|name| Some((name.to_string(), logged(whole.column(name)?))));
        let recording = Recording::new(columns.collect(), None).unwrap();
        let data = prepared(&recording, &setup);
        let model = Model::new(data.signals.context, &[]);
        let own: Vec<f64> = BaseParameter::ALL.iter().map(|p| setup.machine.get(*p).unwrap()).collect();
        let torque = data.torque(&model, &own);
        let kept = |steps: &[f64]| {
            let nuisance = Nuisance { levels: steps.len() + 1, initial: 0 };
            let experiment = data.motion(&model, &[nuisance], &torque);
            let count = own.len();
            let mut start = own.clone();
            start.extend(vec![0.0; nuisance.levels]);
            start.extend(steps);
            let free: Vec<usize> = [BaseParameter::J.index(), BaseParameter::B.index()]
                .into_iter()
                .chain(count..start.len())
                .collect();
            let fitted = experiment.fit(&start, &free, &SETTINGS, &Silent).unwrap();
            worthwhile_steps(&experiment, &fitted, 0).len()
        };
        assert_eq!(kept(&[0.59]), 1);
        assert_eq!(kept(&[0.58, 0.62]), 1);
    }
}
