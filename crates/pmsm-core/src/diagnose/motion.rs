//! The equation of motion fitted to the measured speed, with an unknown load whose steps are found, added where the
//! simulation still misses one, and pruned where they do not pay.

use super::data::{Data, SETTINGS};
use crate::colour::Colour;
use crate::error::Result;
use crate::experiment::{Channel, Fitted, Joint, split};
use crate::least_squares::{Settings, Status};
use crate::load_steps;
use crate::machine::BaseParameter;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::recording::Load;
use crate::simulate::mechanical::Nuisance;
use nalgebra::{DMatrix, DVector};

/// Excess mean square of the speed from which a missing load step is looked for.
const MISSING: f64 = 0.3;
/// A step added there must bring the mean square below this share of what it was.
const IMPROVEMENT: f64 = 0.7;
/// Instants tried for it.
const TRIED: usize = 96;
/// Steps added at most.
const ADDED: usize = 4;

/// Settings of a first fit, after which load steps are pruned.
const ROUGH: Settings = Settings { max_iterations: 5, ..SETTINGS };

/// A fitted equation of motion.
pub struct Motion {
    /// Model parameters followed by those of each recording's nuisance.
    pub parameters: Vec<f64>,
    /// Which of them were fitted.
    pub free: Vec<usize>,
    /// What each recording leaves open: the shape of its unknown load.
    pub nuisances: Vec<Nuisance>,
    /// Mean square of the residual over the floor's, in each recording.
    squares: Vec<f64>,
}

/// Unknown load and initial values of one recording at some stage of the fit.
#[derive(Clone)]
struct State {
    levels: Vec<f64>,
    steps: Vec<f64>,
    deviations: Vec<f64>,
}

/// Fits the mechanical parameters `rotor` of `model`, starting from `start`, and whatever each recording leaves open.
///
/// # Errors
/// Those of the least-squares fit.
pub fn fit(
    data: &Data,
    model: &Model,
    start: &[f64],
    rotor: &[usize],
    monitor: &dyn Monitor,
) -> Result<Motion> {
    let own = &start[..model.parameter_count()];
    let torque = data.torque(model, own);
    let begin =
        |(run, part): (usize, &Data)| State::start(part, model, own, rotor, &torque[data.samples_of(run)]);
    let states = data.runs().iter().enumerate().map(begin).collect();
    let mut best = settle(data, model, own, states, rotor, &torque, monitor)?;
    for (run, part) in data.runs().iter().enumerate() {
        if part.signals.load != Load::UnknownPiecewise || !part.has(false) {
            continue;
        }
        for _ in 0..ADDED {
            if best.squares[run] < 1.0 + MISSING || monitor.cancelled() {
                break;
            }
            let mut states = best.states(model.parameter_count());
            let own = &best.parameters[..model.parameter_count()];
            let samples = &torque[data.samples_of(run)];
            let Some(state) = with_missing_step(part, model, own, &states[run], samples) else { break };
            states[run] = state;
            let more = settle(data, model, own, states, rotor, &torque, monitor)?;
            if more.squares[run] > IMPROVEMENT * best.squares[run] {
                break;
            }
            best = more;
        }
    }
    Ok(best)
}

/// The same under a load of given shape, whose levels and instants are fitted but to which no step is added: `load` holds the
/// nuisances and values of each recording.
///
/// # Errors
/// Those of the least-squares fit.
pub fn fit_under(
    data: &Data,
    model: &Model,
    start: &[f64],
    rotor: &[usize],
    (nuisances, load): (&[Nuisance], &[f64]),
    monitor: &dyn Monitor,
) -> Result<Motion> {
    let own = &start[..model.parameter_count()];
    let states = split(nuisances, load).map(|(nuisance, values)| State {
        deviations: vec![0.0; model.mechanical_states()],
        ..State::of(values, nuisance)
    });
    settle(data, model, own, states.collect(), rotor, &data.torque(model, own), monitor)
}

impl Motion {
    fn states(&self, count: usize) -> Vec<State> {
        split(&self.nuisances, &self.parameters[count..]).map(|(n, own)| State::of(own, n)).collect()
    }
}

/// Lag-one correlation within windows from which a fitted speed is fitted once more with whitened residuals.
const COLOURED: f64 = 0.3;
/// Rounds of whitening, each by the colour of what the round before leaves.
const ROUNDS: usize = 3;

/// The same equation of motion fitted once more with the residual whitened by its own colour within the windows, as an
/// efficient estimate wants it where torque errors add up in the speed or let a shaft ring; `None` where they hardly do.
///
/// # Errors
/// Those of the least-squares fit.
pub fn whitened(
    data: &Data,
    model: &Model,
    fitted: &[f64],
    nuisances: &[Nuisance],
    rotor: &[usize],
    monitor: &dyn Monitor,
) -> Result<Option<Vec<f64>>> {
    let count = model.parameter_count();
    let torque = data.torque(model, &fitted[..count]);
    let mut free = rotor.to_vec();
    free.extend(count..fitted.len());
    let mut best = None;
    for _ in 0..if rotor.is_empty() { 0 } else { ROUNDS } {
        let experiment = experiment(data, model, nuisances, &torque);
        let from = best.as_deref().unwrap_or(fitted);
        let residual = experiment.residual(from);
        let coloured = experiment.coloured(&residual, |run, rows| {
            Colour::of(rows, run.windows).filter(|c| c.lag_one() >= COLOURED)
        });
        let Some(experiment) = coloured.filter(|_| !monitor.cancelled()) else { break };
        best = Some(experiment.fit(from, &free, &SETTINGS, monitor)?.parameters);
    }
    Ok(best)
}

/// Fits from given states, pruning load steps until all that are left pay.
fn settle(
    data: &Data,
    model: &Model,
    own: &[f64],
    mut states: Vec<State>,
    rotor: &[usize],
    torque: &[f64],
    monitor: &dyn Monitor,
) -> Result<Motion> {
    let count = model.parameter_count();
    let mut parameters = own.to_vec();
    loop {
        let nuisances: Vec<Nuisance> = states.iter().map(State::nuisance).collect();
        parameters.truncate(count);
        parameters.extend(states.iter().flat_map(State::values));
        let mut free = rotor.to_vec();
        free.extend(count..parameters.len());
        let experiment = experiment(data, model, &nuisances, torque);
        if free.is_empty() {
            let squares = mean_squares(&experiment, &parameters);
            return Ok(Motion { parameters, free, nuisances, squares });
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
        // Steps that do not pay hardly move the cost and are long in settling: they go before the fit is finished.
        let mut fitted = experiment.fit(&parameters, &free, &ROUGH, monitor)?;
        let mut keep = worthwhile(&fitted);
        if all_pay(&keep) && fitted.fit.status == Status::IterationLimit {
            fitted = experiment.fit(&fitted.parameters, &free, &SETTINGS, monitor)?;
            keep = worthwhile(&fitted);
        }
        parameters = fitted.parameters;
        if all_pay(&keep) || monitor.cancelled() {
            let squares = mean_squares(&experiment, &parameters);
            return Ok(Motion { parameters, free, nuisances, squares });
        }
        // What is left starts from where it was.
        let fresh = split(&nuisances, &parameters[count..]).map(|(n, own)| State::of(own, n));
        let fewer = |(run, state): (usize, State)| {
            state.with_steps(&keep[run], data.runs()[run].signals.context.duration)
        };
        states = fresh.enumerate().map(fewer).collect();
    }
}

impl State {
    /// Where the fit of one recording begins.
    fn start(data: &Data, model: &Model, own: &[f64], rotor: &[usize], torque: &[f64]) -> Self {
        if !data.has(false) {
            return Self { levels: Vec::new(), steps: Vec::new(), deviations: Vec::new() };
        }
        let piecewise = data.signals.load == Load::UnknownPiecewise;
        let steps =
            if piecewise { load_steps::find(model, &data.signals, own, torque, rotor) } else { Vec::new() };
        let unknown = piecewise || data.signals.load == Load::UnknownConstant;
        let level = if unknown { start_level(data, torque, own) } else { 0.0 };
        Self {
            levels: vec![level; if unknown { steps.len() + 1 } else { 0 }],
            steps,
            deviations: vec![0.0; model.mechanical_states()],
        }
    }

    /// From the nuisance's part of the parameters.
    fn of(own: &[f64], nuisance: Nuisance) -> Self {
        let (levels, rest) = own.split_at(nuisance.levels);
        let (steps, deviations) = rest.split_at(nuisance.steps());
        Self { levels: levels.to_vec(), steps: steps.to_vec(), deviations: deviations.to_vec() }
    }

    fn nuisance(&self) -> Nuisance {
        Nuisance { levels: self.levels.len(), initial: self.deviations.len() }
    }

    /// The nuisance's part of the parameters.
    fn values(&self) -> Vec<f64> {
        [&self.levels[..], &self.steps, &self.deviations].concat()
    }

    /// The same with some of its steps only. Of what lay between two of them the level that lasted longest stays.
    fn with_steps(self, keep: &[usize], duration: f64) -> Self {
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

fn experiment<'a>(data: &'a Data, model: &'a Model, nuisances: &[Nuisance], torque: &'a [f64]) -> Joint<'a> {
    data.experiment(model, nuisances, data.channels(false, true)).with_torque(torque)
}

/// Mean square of the speed's residual in each recording; one where it does not show the motion.
fn mean_squares(experiment: &Joint, parameters: &[f64]) -> Vec<f64> {
    let rms = experiment.relative_rms(&experiment.residual(parameters));
    let mut squares = vec![1.0; experiment.runs().len()];
    for (block, rms) in experiment.blocks().iter().zip(rms) {
        if block.channel == Channel::OmegaE {
            squares[block.run] = rms * rms;
        }
    }
    squares
}

/// The fitted load with one more step, at the instant where one explains most of what the simulation leaves. The
/// response to a step is the simulation's own: the derivative with respect to all load levels behind it.
fn with_missing_step(
    data: &Data,
    model: &Model,
    own: &[f64],
    state: &State,
    torque: &[f64],
) -> Option<State> {
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
    let linear = experiment(data, model, &[nuisance], torque).linearise(&parameters, &free);
    let mut responses: Vec<DVector<f64>> = Vec::with_capacity(steps.len());
    let mut sum = DVector::zeros(linear.residual.len());
    for column in (1..levels.len()).rev() {
        sum += linear.jacobian.column(column);
        responses.push(sum.clone());
    }
    responses.reverse();
    // What the present levels can do is theirs.
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let whole = &sum + linear.jacobian.column(0);
    let present = std::iter::once(&whole)
        .chain(steps.iter().zip(&responses).filter(|(s, _)| state.steps.contains(s)).map(|(_, r)| r));
    for column in present {
        let mut free = column.clone();
        for _ in 0..2 {
            for b in &basis {
                let along = b.dot(&free);
                free.axpy(-along, b, 1.0);
            }
        }
        let norm = free.norm();
        if norm > 1e-6 * column.norm() {
            basis.push(free / norm);
        }
    }
    let gain = |response: &DVector<f64>| {
        let mut free = response.clone();
        for b in &basis {
            let along = b.dot(&free);
            free.axpy(-along, b, 1.0);
        }
        let square = free.norm_squared();
        let product = free.dot(&linear.residual);
        if square > 1e-9 * response.norm_squared() { product * product / square } else { 0.0 }
    };
    let best = steps
        .iter()
        .zip(&responses)
        .filter(|(s, _)| !state.steps.contains(s))
        .map(|(s, r)| (*s, gain(r)))
        .max_by(|a, b| a.1.total_cmp(&b.1))?
        .0;
    let at = segment(best);
    let mut more = state.clone();
    more.steps.insert(at, best);
    more.levels.insert(at, state.levels[at]);
    Some(more)
}

/// Mean torque that is neither acceleration nor viscous friction: where the search for the load begins.
fn start_level(data: &Data, torque: &[f64], own: &[f64]) -> f64 {
    let b = own[BaseParameter::B.index()];
    let friction = data.signals.omega_e.iter().map(|w| b * w / data.signals.n_p);
    torque.iter().zip(friction).map(|(t, f)| t - f).sum::<f64>() / torque.len() as f64
}

/// What a load step must be worth: this share of the floor's variance over the whole recording, and this many times the
/// variance of what is left, colour included.
const STEP_SHARE: f64 = 0.003;
const STEP_SIGNIFICANCE: f64 = 25.0;

/// Numbers of the steps of the fitted load of recording `run` without those that have run into the one before, past it, or into an end
/// of the recording: nothing can be said of them there.
fn steps_apart(experiment: &Joint, fitted: &Fitted, run: usize) -> Vec<usize> {
    let (nuisance, own) = (experiment.runs()[run].nuisance, experiment.nuisance(run).start);
    let steps = &fitted.parameters[own + nuisance.levels..][..nuisance.steps()];
    let duration = experiment.runs()[run].signals.context.duration;
    let closest = load_steps::CLOSEST * duration;
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
fn worthwhile_steps(experiment: &Joint, fitted: &Fitted, run: usize) -> Vec<usize> {
    let (nuisance, own) = (experiment.runs()[run].nuisance, experiment.nuisance(run).start);
    let mut kept: Vec<usize> = (0..nuisance.steps()).collect();
    if kept.is_empty() {
        return kept;
    }
    let residual = experiment.residual(&fitted.parameters);
    let rows = experiment.rows(run, Channel::OmegaE).expect("a load shows in the speed");
    let residual = DVector::from_column_slice(&residual.as_slice()[rows]);
    let n = residual.len() as f64;
    let colour = n / load_steps::effective_samples(residual.as_slice());
    let unit = (residual.norm_squared() / n).max(1.0) * colour.max(1.0);
    let threshold = (STEP_SIGNIFICANCE * unit).max(STEP_SHARE * n);
    let position = |index: usize| fitted.free.iter().position(|f| *f == index).expect("levels are free");
    // Constraints of the steps already taken away: level after minus level before.
    let constraint = |step: usize| {
        let mut row = DVector::zeros(fitted.free.len());
        row[position(own + step + 1)] = 1.0;
        row[position(own + step)] = -1.0;
        row
    };
    let levels = DVector::from_iterator(fitted.free.len(), fitted.free.iter().map(|k| fitted.parameters[*k]));
    let information = scaled_inverse(&fitted.fit.normal.jtj);
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

/// Inverse of an information matrix after scaling to unit diagonal, by eigenvalues with a floor.
fn scaled_inverse(jtj: &DMatrix<f64>) -> DMatrix<f64> {
    let n = jtj.nrows();
    let scale: Vec<f64> = (0..n).map(|k| jtj[(k, k)].max(f64::MIN_POSITIVE).sqrt()).collect();
    let scaled = DMatrix::from_fn(n, n, |r, c| jtj[(r, c)] / (scale[r] * scale[c]));
    let eigen = scaled.symmetric_eigen();
    let inverse = eigen.eigenvalues.map(|x| 1.0 / x.max(1e-12));
    let full = &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose();
    DMatrix::from_fn(n, n, |r, c| full[(r, c)] / (scale[r] * scale[c]))
}
