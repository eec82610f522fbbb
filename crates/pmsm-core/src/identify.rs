//! Offline identification as in Liu, Liu & Cartes (2008): any subset of the dq-model's parameters and the load torque from
//! one recording, by the paper's particle swarm, by least squares, or by both.
//!
//! A recording of a running machine is compared with the coupled model (1)–(3) in free run, weighted by the fitness
//! (9). Where it cannot be, or where only electrical parameters are asked for and inertia, friction or load are unknown,
//! measured signals take the place of the missing equation (see [`Drive`]).

mod answer;
mod fitness;
mod found;
mod plan;
mod search;
mod warm;

pub use warm::{Warm, identify_warm};

use crate::error::{Error, Result};
use crate::kernels::objective::{Drive, Objective};
use crate::machine::{BaseParameter, Machine};
use crate::model::Model;
use crate::monitor::Monitor;
use crate::optimise::swarm::SwarmSettings;
use crate::optimise::uncertainty::{Estimate, NotShown};
use crate::pairs;
use crate::recording::Recording;
use crate::signals::Signals;
pub use fitness::Fitness;
use plan::Plan;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// A parameter that can be fitted. It is written to files by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Target {
    /// One of the machine.
    Base(BaseParameter),
    /// Constant load torque, N·m; where the recording tells of a load, what comes on top of it.
    TauLoad,
}

impl Target {
    /// All, in the order of a point of [`Objective`].
    pub const ALL: [Self; 7] = [
        Self::Base(BaseParameter::RS),
        Self::Base(BaseParameter::LD),
        Self::Base(BaseParameter::LQ),
        Self::Base(BaseParameter::PsiM),
        Self::Base(BaseParameter::J),
        Self::Base(BaseParameter::B),
        Self::TauLoad,
    ];

    /// Name used in files and results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Base(p) => p.name(),
            Self::TauLoad => "tau_load",
        }
    }

    /// SI unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Base(p) => p.unit(),
            Self::TauLoad => "N m",
        }
    }

    /// Whether it acts on the speed alone.
    pub fn is_mechanical(self) -> bool {
        match self {
            Self::Base(p) => BaseParameter::MECHANICAL.contains(&p),
            Self::TauLoad => true,
        }
    }

    /// Place in a point of [`Objective`].
    pub(crate) fn index(self) -> usize {
        match self {
            Self::Base(p) => p.index(),
            Self::TauLoad => plan::LOAD,
        }
    }
}

impl From<Target> for String {
    fn from(target: Target) -> Self {
        target.name().into()
    }
}

impl TryFrom<String> for Target {
    type Error = Error;

    fn try_from(name: String) -> Result<Self> {
        name.parse()
    }
}

impl FromStr for Target {
    type Err = Error;

    /// By name.
    fn from_str(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|t| t.name() == name).ok_or_else(|| Error::Unknown {
            kind: "parameter",
            name: name.into(),
            known: Self::ALL.map(Self::name).join(", "),
        })
    }
}

/// How the minimum is sought.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// Particle swarm as in the paper.
    #[serde(rename = "pso")]
    Swarm,
    /// Levenberg–Marquardt from a regression of the equations, and from the nameplate where that fails.
    #[serde(rename = "lm")]
    LeastSquares,
    /// Swarm, then least squares from its best point.
    #[serde(rename = "pso+lm")]
    Both,
}

impl FromStr for Method {
    type Err = Error;

    /// `pso`, `lm` or `pso+lm`.
    fn from_str(name: &str) -> Result<Self> {
        match name {
            "pso" => Ok(Self::Swarm),
            "lm" => Ok(Self::LeastSquares),
            "pso+lm" => Ok(Self::Both),
            _ => Err(Error::Unknown { kind: "method", name: name.into(), known: "pso, lm, pso+lm".into() }),
        }
    }
}

/// What is asked of [`identify`].
#[derive(Debug, Clone)]
pub struct Request {
    /// Parameters to fit, each with its bounds in SI units or `None` for a wide range around the nameplate (a fifth to
    /// five times the value; the load torque within three rated torques). Empty: all that the recording can show.
    pub fit: Vec<(Target, Option<(f64, f64)>)>,
    /// How the minimum is sought.
    pub method: Method,
    /// Settings of the swarm.
    pub swarm: SwarmSettings,
    /// Seed of the swarm.
    pub seed: u64,
    /// Whether the answer says how certain it is, what the recording does not show, and what the model leaves in each channel: some
    /// further runs around the best point.
    pub uncertainties: bool,
}

impl Default for Request {
    fn default() -> Self {
        let (fit, method, swarm) = (Vec::new(), Method::Both, SwarmSettings::default());
        Self { fit, method, swarm, seed: 1, uncertainties: true }
    }
}

/// The answer of [`identify`]; serialises to the object that is written to files.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Identification {
    /// Estimates by name; what was asked for and cannot be fitted has no value.
    #[serde(serialize_with = "pairs::as_map")]
    pub parameters: Vec<(&'static str, Estimate)>,
    /// The fitness (9) at the answer; with least squares its initial values are estimated (see [`Objective::residual`]) and its last step is
    /// that which the normal equations promise.
    pub cost: f64,
    /// Best cost after each generation of the swarm, then after each step of least squares.
    pub history: Vec<f64>,
    /// How the minimum was sought.
    pub method: Method,
    /// What drove the model.
    pub drive: Drive,
    /// Number of evaluations of the fitness.
    pub evaluations: usize,
    /// True if least squares met its tolerance, or the swarm came to rest.
    pub converged: bool,
    /// True if the monitor stopped the search: this is the best so far.
    pub interrupted: bool,
    /// Root mean square of measured minus model per channel, in the channel's SI unit; empty unless uncertainties were asked for.
    #[serde(serialize_with = "pairs::as_map")]
    pub rms: Vec<(&'static str, f64)>,
    /// Parameters, or combinations of them, that the recording does not show.
    pub cannot_show: Vec<NotShown>,
    /// Disturbed load torque (4), N·m, mean over the recording: what an identification with the nameplate's J and B
    /// would call the load. `None` unless the load is fitted and the nameplate has both.
    pub disturbed_load_torque: Option<f64>,
    /// Seed of the swarm.
    pub seed: u64,
}

impl Identification {
    /// The estimate of a parameter that was asked for.
    pub fn get(&self, name: &str) -> Option<&Estimate> {
        self.parameters.iter().find(|(n, _)| *n == name).map(|(_, e)| e)
    }
}

/// Estimates parameters of the dq-model from a recording. The same call gives the same bits for any number of threads.
/// Once `monitor` says stop, the best so far is returned.
///
/// An unknown load is always fitted along with anything that acts on the speed.
///
/// # Errors
/// Those of [`Signals::new`]; [`Error::Unusable`] if none of the parameters asked for is in the equations of this
/// recording, or if a value that is needed is neither on the nameplate nor visible; [`Error::Quantity`] for bounds
/// outside the physical range and for absurd settings of the swarm.
pub fn identify(
    recording: &Recording,
    machine: &Machine,
    request: &Request,
    monitor: &dyn Monitor,
) -> Result<Identification> {
    let mut signals = Signals::in_rotor_frame(recording, machine)?;
    let plan = Plan::new(&mut signals, machine, &request.fit)?;
    if plan.drive != Drive::Coupled {
        signals.complete();
    }
    let windows = plan.drive.windows(&signals);
    let model = Model::new(signals.context, &[]);
    let objective = Objective::new(plan.drive, &model, &signals, &windows);
    let found = match request.method {
        Method::Swarm => found::by_swarm(&objective, &plan, request, false, monitor)?,
        Method::LeastSquares => {
            let starts = [&|| plan.regressed(&signals), &|| plan.first()] as [&dyn Fn() -> Vec<f64>; 2];
            found::from_starts(&objective, &plan, starts, &search::SETTINGS, monitor)?
        }
        Method::Both => {
            let first = found::by_swarm(&objective, &plan, request, true, monitor)?;
            found::refined(&objective, &plan, first, &search::SETTINGS, monitor)?
        }
    };
    answer::assemble(&objective, &plan, &signals, machine, request, found)
}
