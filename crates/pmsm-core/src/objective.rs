//! The fitness (9) of Liu, Liu & Cartes (2008) and its residuals:
//!
//! > Σ_k (i_a − î_a)² + (i_b − î_b)² + (i_c − î_c)² + (w·(ω_e − ω̂_e))²,  w = |i_abc|/ω_e.
//!
//! At the measured angle the squared error of three phase currents is 3/2 of that of i_d, i_q; the zero sequence, which
//! no model of a star-connected machine moves, is left out. w is one number per recording: the root mean square of the
//! current vector (i_a² + i_b² + i_c²)^½ over that of ω_e, where ω_e counts as no slower than a hundredth of the speed at
//! which the largest flux linkage induces the largest voltage, so that a run near standstill has a weight, too.
//! What a recording does not contain drops out of the sum; operating points compare voltages in place of currents.

mod kernel;
mod side_by_side;

use crate::bare::Track;
use crate::dual::Dual;
use crate::experiment::{Channel, Experiment, Linearisation};
use crate::model::Model;
use crate::real::Real;
use crate::signals::Signals;
use crate::simulate::coupled;
use crate::simulate::mechanical::Nuisance;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use std::ops::Range;
use std::sync::Arc;

pub use kernel::{Course, Nearby, Starts};

/// Squared phase quantities over squared rotor-frame quantities.
const PHASES: f64 = 1.5;
/// Initial values of a segment: i_d, i_q, ω_e.
const INITIAL: usize = 3;
/// Initial values rest where a step changes them by no more than this share of the largest current and speed.
const AT_REST: f64 = 1e-5;
/// Most runs on the way to the best initial values.
const ROUNDS: usize = 20;
/// Derivatives carried in one pass.
const SLOTS: usize = 8;

/// What drives the model, and so which channels are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Drive {
    /// Voltage and load drive currents and speed: the coupled model (1)–(3).
    Coupled,
    /// Voltage and the measured speed drive the currents.
    MeasuredSpeed,
    /// The torque of the measured currents, or the recorded torque, drives the speed within short windows.
    MeasuredTorque,
    /// Steady operating points: the voltage that each measured current and speed calls for.
    OperatingPoints,
    /// The measured speed turns the magnet past open terminals.
    OpenCircuit,
}

impl Drive {
    /// The channels compared.
    pub fn channels(self) -> &'static [Channel] {
        match self {
            Self::Coupled => &[Channel::ID, Channel::IQ, Channel::OmegaE],
            Self::MeasuredSpeed => &[Channel::ID, Channel::IQ],
            Self::MeasuredTorque => &[Channel::OmegaE],
            Self::OperatingPoints | Self::OpenCircuit => &[Channel::VD, Channel::VQ],
        }
    }
}

/// w of equation (9), A·s/rad; 1 where the recording has no currents. See the module's documentation.
pub fn speed_weight(signals: &Signals) -> f64 {
    let Some([d, q]) = &signals.i else { return 1.0 };
    let n = signals.len() as f64;
    let current = (PHASES * d.iter().zip(q).map(|(d, q)| d * d + q * q).sum::<f64>() / n).sqrt();
    let speed = (signals.omega_e.iter().map(|w| w * w).sum::<f64>() / n).sqrt();
    let slowest = 0.01 * signals.context.v_max / signals.context.psi_max;
    current.max(1e-9) / speed.max(slowest).max(1e-6)
}

/// One recording, one model and the sum of squares that a fit lowers. A point is the model's parameter vector followed
/// by the load torque (N·m) that comes on top of what the recording tells of the load.
#[derive(Debug, Clone)]
pub struct Objective<'a> {
    drive: Drive,
    experiment: Experiment<'a>,
    prepared: Prepared,
}

/// What is prepared once for any number of evaluations.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// [`speed_weight`] of the recording.
    weight: f64,
    /// The recording for the kernels, where they know the model and the sampling.
    track: Option<Arc<Track>>,
}

impl<'a> Objective<'a> {
    /// Compares `model` with `signals`; `windows` are those of [`crate::simulate::mechanical::windows`].
    pub fn new(drive: Drive, model: &'a Model, signals: &'a Signals, windows: &'a [Range<usize>]) -> Self {
        let prepared = Prepared { weight: speed_weight(signals), track: None };
        let mut objective = Self::with(drive, model, signals, windows, prepared);
        if drive == Drive::Coupled && model.slots().is_empty() && model.map().is_none() {
            let [i_d, _, omega_e] = [0, 1, 2].map(|k| objective.experiment.channels[k].1.powi(-2));
            objective.prepared.track = Track::new(signals, i_d, omega_e).map(Arc::new);
        }
        objective
    }

    /// The same with what another objective of this recording has prepared (see [`Objective::into_prepared`]).
    pub fn with(
        drive: Drive,
        model: &'a Model,
        signals: &'a Signals,
        windows: &'a [Range<usize>],
        prepared: Prepared,
    ) -> Self {
        let (phase, speed) = (1.0 / PHASES.sqrt(), 1.0 / prepared.weight);
        let sigma = |c: Channel| if c == Channel::OmegaE { speed } else { phase };
        let logged = |c: &&Channel| match c {
            Channel::VD => signals.axes[0],
            Channel::VQ => signals.axes[1],
            _ => true,
        };
        let channels = drive.channels().iter().filter(logged).map(|c| (*c, sigma(*c))).collect();
        let nuisance = Nuisance::unknown(0, model.mechanical_states());
        let experiment = Experiment {
            model,
            signals,
            nuisance,
            windows,
            channels,
            held_out: None,
            prior: &[],
            torque: None,
            starts: None,
            whitening: None,
            wander: None,
            colour: None,
        };
        Self { drive, experiment, prepared }
    }

    /// What drives the model.
    pub fn drive(&self) -> Drive {
        self.drive
    }

    /// Length of a point.
    pub fn len(&self) -> usize {
        let e = &self.experiment;
        e.model.parameter_count() + e.nuisance.parameter_count()
    }

    /// Never true: a point has at least the base parameters.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// What it has prepared.
    pub fn into_prepared(self) -> Prepared {
        self.prepared
    }

    /// The same objective without the kernels: every number by the equations as the catalogue has them.
    pub fn reference(self) -> Self {
        Self { prepared: Prepared { track: None, ..self.prepared }, ..self }
    }

    /// The fitness (9) at `p`, the coupled model starting from the measured values as in the paper; infinite where the
    /// model cannot be evaluated, and as soon as the sum has passed `bound`, which a sum of squares cannot undo.
    pub fn fitness(&self, p: &[f64], bound: f64) -> f64 {
        let sum = if self.drive == Drive::Coupled {
            self.coupled_fitness(p, bound)
        } else {
            self.experiment.residual(p).norm_squared()
        };
        if sum <= bound && sum.is_finite() { sum } else { f64::INFINITY }
    }

    fn coupled_fitness(&self, p: &[f64], bound: f64) -> f64 {
        let e = &self.experiment;
        let (Some([d, q]), omega) = (&e.signals.i, &e.signals.omega_e) else { return f64::INFINITY };
        let weight = 1.0 / e.channels[2].1;
        let (own, load) = (e.model.parameter_count(), p[e.model.parameter_count()]);
        let mut sum = 0.0;
        coupled::run(e.model, e.signals, 0..e.signals.len(), &p[..own], load, |k, [i_d, i_q, w]| {
            let (e_d, e_q, e_w) = (i_d - d[k], i_q - q[k], (w - omega[k]) * weight);
            sum += PHASES * (e_d * e_d + e_q * e_q) + e_w * e_w;
            // False for NaN, too.
            sum <= bound
        });
        sum
    }

    /// Weighted residuals at `p`, model minus measurement, stacked channel by channel: their sum of squares is the
    /// fitness with the initial values of each gap-free segment (i_d, i_q, ω_e) estimated instead of measured. Without
    /// this the noise of one first sample would shift a whole segment.
    pub fn residual(&self, p: &[f64]) -> DVector<f64> {
        if self.drive == Drive::Coupled {
            self.coupled_linear(p, &[], None).residual
        } else {
            self.experiment.residual(p)
        }
    }

    /// [`Objective::residual`] and its derivatives with respect to the entries `free` of the point. `starts`, where they are
    /// known, are the best initial values there.
    pub fn linearise(&self, p: &[f64], free: &[usize], starts: Option<&Starts>) -> Linearisation {
        if self.drive == Drive::Coupled {
            self.coupled_linear(p, free, starts)
        } else {
            self.experiment.linearise(p, free)
        }
    }

    /// Estimates the initial values of each segment, then takes derivatives there and projects out what the initial
    /// values can still do.
    fn coupled_linear(&self, p: &[f64], free: &[usize], starts: Option<&Starts>) -> Linearisation {
        if let Some(linear) = self.kernel_linear(p, free, starts) {
            return linear;
        }
        let settled = || self.settle(|starts| Some(self.better_starts(p, starts)));
        let starts = starts.cloned().or_else(settled).unwrap_or_default();
        let signals = self.experiment.signals;
        let (mut linear, mut initial) = self.coupled_pass(p, free, &starts);
        for segment in &signals.segments {
            project(&stacked(segment, signals.len()), &mut initial, &mut linear);
        }
        linear
    }

    /// Sum of squares from the initial values `starts`, and the better ones that this run calls for; where they cannot be
    /// told apart the same ones.
    fn better_starts(&self, p: &[f64], starts: &Starts) -> (f64, Starts) {
        let signals = self.experiment.signals;
        let (seen, initial) = self.coupled_pass(p, &[], starts);
        let mut better = starts.clone();
        for (segment, start) in signals.segments.iter().zip(&mut better) {
            let rows = stacked(segment, signals.len());
            let slope = DMatrix::from_fn(rows.len(), INITIAL, |r, c| initial[(rows[r], c)]);
            let error = DVector::from_fn(rows.len(), |r, _| seen.residual[rows[r]]);
            let normal = slope.tr_mul(&slope);
            let Some(step) = normal.cholesky().map(|c| c.solve(&slope.tr_mul(&error))) else { continue };
            if step.iter().all(|x| x.is_finite()) {
                for c in 0..INITIAL {
                    start[c] -= step[c];
                }
            }
        }
        (seen.residual.norm_squared(), better)
    }

    /// The best initial values, from the measured ones by Gauss–Newton steps, halved while they lead uphill. `look` gives the
    /// sum of squares from some initial values and the better ones that this run calls for.
    fn settle(&self, mut look: impl FnMut(&Starts) -> Option<(f64, Starts)>) -> Option<Starts> {
        let cx = &self.experiment.signals.context;
        let sizes = [cx.i_max, cx.i_max, cx.omega_e_max];
        let mut starts = self.measured_starts();
        let (mut cost, mut goal) = look(&starts)?;
        for _ in 0..ROUNDS {
            if apart(&starts, &goal, sizes) <= AT_REST {
                return Some(goal);
            }
            let (there, next) = look(&goal)?;
            if there <= cost {
                (starts, cost, goal) = (goal, there, next);
            } else {
                goal = halfway(&starts, &goal);
            }
        }
        Some(starts)
    }

    /// Residuals and derivatives from the initial values `starts` of each segment, and the derivatives with respect to
    /// those. Dual numbers with [`SLOTS`] slots: the last three for the initial values, the others for parameters.
    fn coupled_pass(&self, p: &[f64], free: &[usize], starts: &[[f64; 3]]) -> (Linearisation, DMatrix<f64>) {
        let e = &self.experiment;
        let (n, own, lanes) = (e.signals.len(), e.model.parameter_count(), SLOTS - INITIAL);
        let measured = [Channel::ID, Channel::IQ, Channel::OmegaE].map(|c| e.measured(c));
        let weight = [0, 1, 2].map(|c| 1.0 / e.channels[c].1);
        let mut residual = DVector::zeros(3 * n);
        let mut jacobian = DMatrix::zeros(3 * n, free.len());
        let mut initial = DMatrix::zeros(3 * n, INITIAL);
        for first in (0..free.len().max(1)).step_by(lanes.max(1)) {
            let columns = first..(first + lanes).min(free.len());
            let mut seeded: Vec<Dual<SLOTS>> = p.iter().map(|x| Dual::constant(*x)).collect();
            for (slot, column) in columns.clone().enumerate() {
                seeded[free[column]] = Dual::variable(p[free[column]], slot);
            }
            let start = |k: usize, measured: [f64; 3]| {
                let known = e.signals.segments.iter().position(|s| s.start == k);
                let x = known.map_or(measured, |s| starts[s]);
                [0, 1, 2].map(|c| Dual::variable(x[c], lanes + c))
            };
            let (load, all) = (seeded[own], 0..n);
            coupled::run_from(e.model, e.signals, all, &seeded[..own], load, start, |k, now| {
                for c in 0..3 {
                    let row = c * n + k;
                    residual[row] = (now[c].re - measured[c][k]) * weight[c];
                    for (slot, column) in columns.clone().enumerate() {
                        jacobian[(row, column)] = now[c].eps[slot] * weight[c];
                    }
                    for x in 0..INITIAL {
                        initial[(row, x)] = now[c].eps[lanes + x] * weight[c];
                    }
                }
                true
            });
        }
        (Linearisation { residual, jacobian }, initial)
    }

    /// Root mean square of measured minus model in each channel, in the channel's own unit.
    pub fn rms(&self, residual: &DVector<f64>) -> Vec<(Channel, f64)> {
        let rms = self.experiment.relative_rms(residual);
        self.experiment.channels.iter().zip(rms).map(|((c, sigma), r)| (*c, r * sigma)).collect()
    }
}

/// Largest difference between initial values, as a share of `sizes`.
fn apart(a: &Starts, b: &Starts, sizes: [f64; INITIAL]) -> f64 {
    let both = a.iter().zip(b);
    both.flat_map(|(a, b)| (0..INITIAL).map(|k| (a[k] - b[k]).abs() / sizes[k])).fold(0.0, f64::max)
}

fn halfway(a: &Starts, b: &Starts) -> Starts {
    a.iter().zip(b).map(|(a, b)| [0, 1, 2].map(|k| 0.5 * (a[k] + b[k]))).collect()
}

/// The rows of a segment in three stacked channels of `n` samples.
fn stacked(segment: &Range<usize>, n: usize) -> Vec<usize> {
    (0..3).flat_map(|c| segment.clone().map(move |k| c * n + k)).collect()
}

/// Takes the columns of `initial`, restricted to `rows`, out of the residual and of the derivatives (Gram–Schmidt).
fn project(rows: &[usize], initial: &mut DMatrix<f64>, linear: &mut Linearisation) {
    let remove = |direction: &[f64], x: &mut [f64]| {
        let share: f64 = rows.iter().zip(direction).map(|(r, d)| x[*r] * d).sum();
        for (r, d) in rows.iter().zip(direction) {
            x[*r] -= share * d;
        }
    };
    for column in 0..initial.ncols() {
        let direction: Vec<f64> = rows.iter().map(|r| initial[(*r, column)]).collect();
        let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
        if !(length > 0.0 && length.is_finite()) {
            continue;
        }
        let direction: Vec<f64> = direction.iter().map(|d| d / length).collect();
        for mut later in initial.column_iter_mut().skip(column + 1) {
            remove(&direction, later.as_mut_slice());
        }
        remove(&direction, linear.residual.as_mut_slice());
        for mut derivative in linear.jacobian.column_iter_mut() {
            remove(&direction, derivative.as_mut_slice());
        }
    }
}
