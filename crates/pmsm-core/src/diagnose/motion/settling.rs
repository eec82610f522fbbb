//! Repeated fits of the equation of motion, each without the load steps that explained too little in the one before.

use super::state::{State, states_of};
use super::steps::{steps_apart, worthwhile_steps};
use crate::diagnose::data::Data;
use crate::error::Result;
use crate::experiment::{Channel, Fitted, Joint};
use crate::model::Model;
use crate::monitor::Monitor;
use crate::optimise::least_squares::{Settings, Status};
use crate::simulate::mechanical::Nuisance;
use nalgebra::DVector;

/// Iterations of a first fit, after which load steps are pruned.
const ROUGH: usize = 5;

/// A fitted equation of motion.
pub struct Motion {
    /// Model parameters followed by those of each recording's nuisance.
    pub parameters: Vec<f64>,
    /// Which of them were fitted.
    pub free: Vec<usize>,
    /// What each recording leaves open: the shape of its unknown load.
    pub nuisances: Vec<Nuisance>,
    /// Mean square of the residual over the floor's, in each recording.
    pub squares: Vec<f64>,
}

/// Fits from given states that prune load steps until each of the rest explains more than its price.
pub struct Settling<'a> {
    pub data: &'a Data,
    pub model: &'a Model,
    /// Mechanical parameters that are fitted.
    pub rotor: &'a [usize],
    /// Motor torque per sample, N·m.
    pub torque: &'a [f64],
    /// Whether the states of the rotor begin as they are given: how they begin is lost at an impact.
    pub initial_held: bool,
    pub monitor: &'a dyn Monitor,
}

/// Outcome of one fit.
enum Round {
    /// All load steps are worth their price.
    Settled(Motion),
    /// Parameters, and the states of each recording with the steps that are worth their price.
    Pruned(Vec<f64>, Vec<State>, Vec<Vec<usize>>),
}

impl Settling<'_> {
    /// From the model parameters `own`.
    pub fn settle(&self, mut own: Vec<f64>, mut states: Vec<State>) -> Result<Motion> {
        loop {
            match self.round(own, &states)? {
                Round::Settled(motion) => return Ok(motion),
                Round::Pruned(left, fewer, _) => (own, states) = (left, fewer),
            }
        }
    }

    /// The same, or `None` if that takes away at once the step that was added, by recording and number: without it the states are those
    /// of before.
    pub fn settle_with(
        &self,
        own: Vec<f64>,
        states: Vec<State>,
        (run, at): (usize, usize),
    ) -> Result<Option<Motion>> {
        match self.round(own, &states)? {
            Round::Settled(motion) => Ok(Some(motion)),
            Round::Pruned(.., keep) if !keep[run].contains(&at) => Ok(None),
            Round::Pruned(own, states, _) => self.settle(own, states).map(Some),
        }
    }

    fn round(&self, mut parameters: Vec<f64>, states: &[State]) -> Result<Round> {
        let Self { data, model, monitor, .. } = *self;
        monitor.go_on()?;
        let count = model.parameter_count();
        let nuisances: Vec<Nuisance> = states.iter().map(State::nuisance).collect();
        parameters.extend(states.iter().flat_map(State::values));
        let mut free = self.rotor.to_vec();
        let mut at = count;
        for nuisance in &nuisances {
            let end = at + nuisance.parameter_count();
            free.extend(at..if self.initial_held { end - nuisance.initial } else { end });
            at = end;
        }
        let experiment = data.motion(model, &nuisances, self.torque);
        if free.is_empty() {
            let squares = mean_squares(&experiment, &experiment.residual(&parameters));
            return Ok(Round::Settled(Motion { parameters, free, nuisances, squares }));
        }
        let worthwhile = |fitted: &Fitted| -> Vec<Vec<usize>> {
            (0..nuisances.len())
                .map(|run| {
                    let apart = steps_apart(&experiment, fitted, run);
                    let all = apart.len() == nuisances[run].steps();
                    if all { worthwhile_steps(&experiment, fitted, run) } else { apart }
                })
                .collect()
        };
        let all_pay = |keep: &[Vec<usize>]| keep.iter().zip(&nuisances).all(|(k, n)| k.len() == n.steps());
        // Weak steps hardly change the cost and converge slowly: they are removed before the fit is finished.
        let rough = Settings { max_iterations: ROUGH, ..data.settings };
        let mut fitted = experiment.fit(&parameters, &free, &rough, monitor)?;
        let mut keep = worthwhile(&fitted);
        if all_pay(&keep) && fitted.fit.status == Status::IterationLimit {
            fitted = experiment.fit(&fitted.parameters, &free, &data.settings, monitor)?;
            keep = worthwhile(&fitted);
        }
        if all_pay(&keep) {
            let squares = mean_squares(&experiment, &fitted.residual(&experiment));
            let parameters = fitted.parameters;
            return Ok(Round::Settled(Motion { parameters, free, nuisances, squares }));
        }
        // What is left starts from where it was.
        let mut parameters = fitted.parameters;
        let fresh = states_of(&nuisances, &parameters[count..]).into_iter();
        let fewer = |(run, state): (usize, State)| {
            state.with_steps(&keep[run], data.runs()[run].signals.context.duration)
        };
        let states = fresh.enumerate().map(fewer).collect();
        parameters.truncate(count);
        Ok(Round::Pruned(parameters, states, keep))
    }
}

/// Mean square of the speed's residual in each recording; one where it does not show the motion.
fn mean_squares(experiment: &Joint, residual: &DVector<f64>) -> Vec<f64> {
    let mean_squares = experiment.mean_squares(residual, |_| 1.0);
    let mut squares = vec![1.0; experiment.runs().len()];
    for (block, (square, _)) in experiment.blocks().iter().zip(mean_squares) {
        if block.channel == Channel::OmegaE {
            squares[block.run] = square;
        }
    }
    squares
}
