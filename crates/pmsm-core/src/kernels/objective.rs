//! The fitness (9) of Liu, Liu & Cartes (2008) and its residuals:
//!
//! > Σ_k (i_a − î_a)² + (i_b − î_b)² + (i_c − î_c)² + (w·(ω_e − ω̂_e))²,  w = |i_abc|/ω_e.
//!
//! At the measured angle the squared error of three phase currents is 3/2 of that of i_d, i_q; the zero sequence, which
//! no model of a star-connected machine moves, is left out. w is one number per recording: the root mean square of the
//! current vector (i_a² + i_b² + i_c²)^½ over that of ω_e, where ω_e counts as no slower than a hundredth of the speed at
//! which the largest flux linkage induces the largest voltage, so that a run near standstill has a weight, too.
//! What a recording does not contain drops out of the sum; operating points compare voltages in place of currents.

mod equations;
mod initial;
mod kernel;
mod recorded;
mod side_by_side;

use crate::experiment::{Channel, Experiment, Linearisation};
use crate::kernels::bare::Track;
use crate::kernels::bare::copies::INITIAL;
use crate::model::Model;
use crate::signals::Signals;
use crate::simulate::mechanical::{self, Nuisance};
use nalgebra::DVector;
use serde::Serialize;
use std::ops::Range;
use std::sync::Arc;

pub use kernel::{Course, Nearby, Starts};

/// Initial values rest where a Gauss–Newton step changes them by no more than this share of the largest current and speed.
const AT_REST: f64 = 1e-5;

/// Squared phase quantities over squared rotor-frame quantities.
const PHASES: f64 = 1.5;

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

    /// The windows in which the speed is run: none but where the torque drives it.
    pub fn windows(self, signals: &Signals) -> Vec<Range<usize>> {
        if self == Self::MeasuredTorque { mechanical::windows(signals) } else { Vec::new() }
    }
}

/// w of equation (9), A·s/rad; 1 where the recording has no currents. See the module's documentation.
pub fn speed_weight(signals: &Signals) -> f64 {
    let Some([d, q]) = &signals.i else { return 1.0 };
    let n = signals.len() as f64;
    let (mut currents, mut speeds) = (0.0, 0.0);
    for ((d, q), omega) in d.iter().zip(q).zip(&signals.omega_e) {
        currents += d * d + q * q;
        speeds += omega * omega;
    }
    let (current, speed) = ((PHASES * currents / n).sqrt(), (speeds / n).sqrt());
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
    /// Compares `model` with `signals`; `windows` are those of [`Drive::windows`].
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

    /// Initial i_d, i_q (A) and ω_e (rad/s) of each gap-free segment at which the fitness at `p` is least: a Gauss–Newton step from
    /// there is at most 10⁻⁵ of the largest current and speed, save where a hundred runs do not lead there. Empty where the
    /// recording has no currents, and where another drive than the coupled model is asked.
    pub fn initial_values(&self, p: &[f64]) -> Starts {
        if self.drive != Drive::Coupled || self.experiment.signals.i.is_none() {
            return Starts::new();
        }
        let kernels = self.settle(|starts| self.slopes_on_kernels(p, starts));
        kernels.or_else(|| self.settle(|starts| Some(self.slopes(p, starts)))).unwrap_or_default()
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

    /// Root mean square of measured minus model in each channel, in the channel's own unit.
    pub fn rms(&self, residual: &DVector<f64>) -> Vec<(Channel, f64)> {
        let rms = self.experiment.relative_rms(residual);
        self.experiment.channels.iter().zip(rms).map(|((c, sigma), r)| (*c, r * sigma)).collect()
    }
}
