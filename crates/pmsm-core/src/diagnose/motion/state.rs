//! The parameters of one recording in the equation of motion: its unknown load and initial values.

use crate::diagnose::data::Data;
use crate::experiment::split;
use crate::load_steps;
use crate::machine::BaseParameter;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::recording::Load;
use crate::simulate::mechanical::Nuisance;

/// Unknown load and initial values of one recording at some stage of the fit.
#[derive(Clone)]
pub struct State {
    pub levels: Vec<f64>,
    pub steps: Vec<f64>,
    pub deviations: Vec<f64>,
}

impl State {
    /// Where the fit of one recording begins.
    pub fn start(
        data: &Data,
        model: &Model,
        own: &[f64],
        rotor: &[usize],
        torque: &[f64],
        monitor: &dyn Monitor,
    ) -> Self {
        if !data.has_mechanical() {
            return Self { levels: Vec::new(), steps: Vec::new(), deviations: Vec::new() };
        }
        let piecewise = data.signals.load == Load::UnknownPiecewise;
        let steps = if piecewise {
            load_steps::find(model, &data.signals, own, torque, rotor, monitor)
        } else {
            Vec::new()
        };
        let unknown = piecewise || data.signals.load == Load::UnknownConstant;
        Self {
            levels: if unknown { start_levels(data, torque, own, &steps) } else { Vec::new() },
            steps,
            deviations: vec![0.0; data.initial_states(model)],
        }
    }

    /// From the nuisance's part of the parameters.
    pub fn of(own: &[f64], nuisance: Nuisance) -> Self {
        let (levels, rest) = own.split_at(nuisance.levels);
        let (steps, deviations) = rest.split_at(nuisance.steps());
        Self { levels: levels.to_vec(), steps: steps.to_vec(), deviations: deviations.to_vec() }
    }

    pub fn nuisance(&self) -> Nuisance {
        Nuisance { levels: self.levels.len(), initial: self.deviations.len() }
    }

    /// The nuisance's part of the parameters.
    pub fn values(&self) -> Vec<f64> {
        [&self.levels[..], &self.steps, &self.deviations].concat()
    }

    /// The same with some of its steps only. Between two of them the level that lasted longest stays.
    pub fn with_steps(self, keep: &[usize], duration: f64) -> Self {
        if self.levels.is_empty() {
            return self;
        }
        let edges = |at: usize| {
            let start = if at == 0 { 0.0 } else { self.steps[at - 1] };
            self.steps.get(at).copied().unwrap_or(duration) - start
        };
        let firsts = std::iter::once(0).chain(keep.iter().map(|k| k + 1));
        let ends = keep.iter().map(|k| k + 1).chain([self.levels.len()]);
        let longest = |(first, end): (usize, usize)| {
            (first..end).max_by(|a, b| edges(*a).total_cmp(&edges(*b))).expect("a piece between two steps")
        };
        Self {
            levels: firsts.zip(ends).map(longest).map(|at| self.levels[at]).collect(),
            steps: keep.iter().map(|k| self.steps[*k]).collect(),
            deviations: self.deviations,
        }
    }
}

/// The states of all recordings from their nuisances and values.
pub fn states_of(nuisances: &[Nuisance], values: &[f64]) -> Vec<State> {
    split(nuisances, values).map(|(nuisance, own)| State::of(own, nuisance)).collect()
}

/// Mean torque between the `steps` (s) that is neither acceleration nor viscous friction: the levels from which the search for the load begins;
/// none where a model diverged.
fn start_levels(data: &Data, torque: &[f64], own: &[f64], steps: &[f64]) -> Vec<f64> {
    let [j, b] = [BaseParameter::J, BaseParameter::B].map(|p| own[p.index()] / data.signals.n_p);
    let (t, omega) = (&data.signals.t, &data.signals.omega_e);
    let mut sums = vec![(0.0, 0.0); steps.len() + 1];
    for k in data.signals.segments.iter().flat_map(|segment| segment.start + 1..segment.end) {
        let h = t[k] - t[k - 1];
        let middle = t[k - 1] + 0.5 * h - t[0];
        let (sum, time) = &mut sums[steps.partition_point(|step| *step < middle)];
        let mean = |x: &[f64]| 0.5 * (x[k - 1] + x[k]);
        *sum += h * (mean(torque) - b * mean(omega)) - j * (omega[k] - omega[k - 1]);
        *time += h;
    }
    let level = |(sum, time): (f64, f64)| if time > 0.0 && sum.is_finite() { sum / time } else { 0.0 };
    sums.into_iter().map(level).collect()
}
