//! A fitted hypothesis on another recording, where only what a run leaves open is estimated: the unknown load, initial values, and the
//! electrical turn of the revolution in which the run begins.

use super::data::Data;
use super::hypothesis::Hypothesis;
use super::motion;
use crate::error::Result;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::numerics::tall;
use crate::optimise::least_squares::scaled_inverse;
use crate::simulate::mechanical::Nuisance;
use nalgebra::DVector;
use std::f64::consts::TAU;

/// Other turns that are tried from one in which the run has been fitted.
const TRIED: usize = 2;
/// Mean square, over the floor's, below which a turn is no better: the floor is no more certain. It is that of `floor_known_to` by default.
const LEAST_SQUARE: f64 = 0.9;
/// Share of the residual that another turn must explain to first order to be tried.
const PROMISE: f64 = 1e-3;

/// Estimates on `data` what its run leaves open, and nothing else.
///
/// # Errors
/// Those of the least-squares fit.
pub fn transfer(data: &Data, hypothesis: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let model = &hypothesis.model;
    let mut best = on_run(data, model, hypothesis.own(), monitor)?;
    let turns: Vec<Vec<f64>> = if data.signals.turn_known { Vec::new() } else { turns(data, hypothesis) };
    let mut tried = vec![0];
    let mut better = turns.len() > 1;
    while better {
        better = false;
        let next: Vec<usize> =
            promising(data, &best, &turns).filter(|t| !tried.contains(t)).take(TRIED).collect();
        for turn in next {
            tried.push(turn);
            let there = on_run(data, model, &turns[turn], monitor)?;
            if total(&there) < total(&best) {
                (best, better) = (there, true);
            }
        }
    }
    Ok(best)
}

fn on_run(data: &Data, model: &Model, own: &[f64], monitor: &dyn Monitor) -> Result<Hypothesis> {
    let mut parameters = own.to_vec();
    let mut nuisances = vec![Nuisance::known(0); data.runs().len()];
    if data.has_mechanical() {
        let fitted = motion::fit(data, model, &parameters, &[], None, monitor)?;
        (parameters, nuisances) = (fitted.parameters, fitted.nuisances);
    }
    Ok(Hypothesis::on(data, model.clone(), parameters, Vec::new(), nuisances))
}

fn total(hypothesis: &Hypothesis) -> f64 {
    hypothesis.squares.iter().map(|(_, s)| s.max(LEAST_SQUARE).ln()).sum()
}

/// The model's parameters as they are if the run begins in the first, second, … electrical turn of the revolution; only the first if
/// the model knows no turns.
fn turns(data: &Data, hypothesis: &Hypothesis) -> Vec<Vec<f64>> {
    let n_p = data.signals.n_p;
    let seen_from = |turn: usize| hypothesis.model.turned(hypothesis.own(), TAU * turn as f64 / n_p);
    std::iter::once(hypothesis.own().to_vec()).chain((1..n_p as usize).map_while(seen_from)).collect()
}

/// Numbers of the `turns` that promise to leave less than the one in which `fitted` is, the best first: by what the derivatives with
/// respect to what turns say, whatever the run leaves open being fitted anew.
fn promising(data: &Data, fitted: &Hypothesis, turns: &[Vec<f64>]) -> impl Iterator<Item = usize> + use<> {
    let own = fitted.own();
    let turning: Vec<usize> =
        (0..own.len()).filter(|k| turns.iter().any(|turn| turn[*k] != turns[0][*k])).collect();
    let free: Vec<usize> = turning.iter().copied().chain(own.len()..fitted.parameters.len()).collect();
    let channels = data.channels(fitted.model.has_sensor(), true);
    let linear =
        data.experiment(&fitted.model, &fitted.nuisances, channels).linearise(&fitted.parameters, &free);
    let (normal, slope) =
        (tall::gram(&linear.jacobian), tall::tr_mul_vector(&linear.jacobian, &linear.residual));
    let (count, open) = (turning.len(), free.len() - turning.len());
    let inverse = scaled_inverse(&normal.view((count, count), (open, open)).into_owned());
    let left = |turn: &[f64]| {
        let away = DVector::from_iterator(count, turning.iter().map(|k| turn[*k] - own[*k]));
        let pulled = slope.rows(count, open) + normal.view((count, 0), (open, count)) * &away;
        let bent = &away.transpose() * normal.view((0, 0), (count, count)) * &away;
        2.0 * slope.rows(0, count).dot(&away) + bent[0] - pulled.dot(&(&inverse * &pulled))
    };
    let present = left(own);
    let mut order: Vec<(usize, f64)> = turns.iter().map(|turn| left(turn) - present).enumerate().collect();
    order.retain(|(_, change)| *change < -PROMISE * linear.residual.norm_squared());
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    order.into_iter().map(|(turn, _)| turn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::drive::{Schedule, Shape};
    use crate::effects::EffectId;
    use crate::experiment::Channel;
    use crate::monitor::Silent;

    fn pulsating(steps: Vec<(f64, f64)>, kind: &str) -> (Data, Hypothesis, Hypothesis) {
        let mut manoeuvre = speeds(2.0, &[(0.1, 60.0), (0.9, 100.0), (1.7, 40.0)]);
        manoeuvre.tau_load = Some(Schedule::new(steps, Shape::Steps).unwrap());
        manoeuvre.load_kind = Some(kind.into());
        let (data, base) = data(&setup(manoeuvre, vec![choice("load_torque_pulsation", "a", 0.15)]));
        let right = fitted(&data, &base, EffectId::LoadTorquePulsation);
        (data, base, right)
    }

    #[test]
    fn the_turn_in_which_a_run_begins_is_found() {
        // Under a known load nothing but the turn is left open.
        for (steps, kind) in
            [(vec![(0.0, 0.4), (0.75, 1.2)], "unknown_piecewise"), (vec![(0.0, 0.4)], "known_constant")]
        {
            let (data, base, right) = pulsating(steps, kind);
            let omega = |h: &Hypothesis| h.square(Channel::OmegaE);
            assert!(omega(&right) < 1.1 && omega(&base) > 2.0, "{} {}", omega(&right), omega(&base));
            let n_p = data.signals.n_p as usize;
            assert!(n_p > 2);
            for turn in 0..n_p {
                let seen = right.model.turned(right.own(), TAU * turn as f64 / n_p as f64).unwrap();
                let elsewhere = Hypothesis::unfitted(right.model.clone(), seen.clone());
                let found = transfer(&data, &elsewhere, &Silent).unwrap();
                assert!(omega(&found) < 1.01 * omega(&right), "{turn}: {} {}", omega(&found), omega(&right));
            }
            let turned = right.model.turned(right.own(), TAU / n_p as f64).unwrap();
            let elsewhere = on_run(&data, &right.model, &turned, &Silent).unwrap();
            assert!(omega(&elsewhere) > 2.0, "{}", omega(&elsewhere));
        }
    }
}
