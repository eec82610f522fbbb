//! One recording made ready for the diagnosis: signals, windows, floors, and what is known beforehand.

use crate::base::BASE;
use crate::error::Result;
use crate::experiment::{Channel, Experiment};
use crate::input_noise::InputNoise;
use crate::least_squares::Settings;
use crate::machine::{BaseParameter, Machine};
use crate::model::Model;
use crate::noise::{self, Floor};
use crate::recording::Kind;
use crate::signals::Signals;
use crate::simulate::mechanical::{self, Nuisance};
use crate::start;
use crate::whitening::Whitening;
use std::ops::Range;

/// Standard deviation of a nameplate value, share of the value.
const NAMEPLATE_SPREAD: f64 = 0.3;

/// One recording made ready for fitting.
#[derive(Debug, Clone)]
pub struct Data {
    /// Its signals.
    pub signals: Signals,
    /// Mechanical windows.
    pub windows: Vec<Range<usize>>,
    /// Noise floors of its channels.
    pub floors: Vec<Floor>,
    /// Noise of its voltages.
    pub input: InputNoise,
    /// Filter that whitens its currents' residuals, where they are not white by themselves.
    pub whitening: Option<Whitening>,
    /// Base parameters to start from.
    pub start: [f64; BASE],
    /// What the nameplate says of them: index, value, standard deviation.
    pub prior: Vec<(usize, f64, f64)>,
    /// Samples that do not count, if some are held out.
    pub held_out: Option<Vec<bool>>,
}

impl Data {
    /// Prepares a recording. Floors are still the sensors' alone, read from the log; [`Data::settle_floors`] completes them.
    ///
    /// # Errors
    /// Those of [`Signals::new`] and [`start::values`].
    pub fn new(signals: Signals, machine: &Machine) -> Result<Self> {
        let windows = mechanical::windows(&signals);
        let start = start::values(&signals, machine)?;
        let prior = BaseParameter::ALL
            .iter()
            .filter_map(|p| {
                let value = machine.get(*p)?;
                Some((p.index(), value, NAMEPLATE_SPREAD * value.abs().max(1e-9)))
            })
            .collect();
        let channels: &[Channel] = match signals.kind {
            Kind::Full => &[Channel::ID, Channel::IQ, Channel::OmegaE],
            Kind::Electrical => &[Channel::ID, Channel::IQ],
            Kind::Mechanical => &[Channel::OmegaE],
            Kind::OperatingPoints | Kind::OpenCircuit => match signals.axes {
                [true, false] => &[Channel::VD],
                [false, true] => &[Channel::VQ],
                _ => &[Channel::VD, Channel::VQ],
            },
        };
        let current = noise::current_noise(&signals);
        let floors = channels
            .iter()
            .map(|&channel| {
                let sensor = match channel {
                    Channel::ID | Channel::IQ => current.unwrap_or(0.002 * signals.context.i_max),
                    Channel::OmegaE => {
                        noise::white_noise(&signals.omega_e).max(1e-6 * signals.context.omega_e_max)
                    }
                    Channel::VD | Channel::VQ => 0.005 * signals.context.v_max,
                };
                Floor { channel, sensor, driven: 0.0 }
            })
            .collect();
        let (input, whitening) = (InputNoise::default(), None);
        Ok(Self { signals, windows, floors, input, whitening, start, prior, held_out: None })
    }

    /// The same recording with some samples held out.
    pub fn masked(&self, held_out: Vec<bool>) -> Self {
        Self { held_out: Some(held_out), ..self.clone() }
    }

    /// Number of samples that count.
    pub fn counted(&self) -> usize {
        self.held_out.as_ref().map_or(self.signals.len(), |h| h.iter().filter(|x| !**x).count())
    }

    /// The recording seen through a model.
    pub fn experiment<'a>(
        &'a self,
        model: &'a Model,
        nuisance: Nuisance,
        channels: Vec<(Channel, f64)>,
    ) -> Experiment<'a> {
        Experiment {
            model,
            signals: &self.signals,
            nuisance,
            windows: &self.windows,
            channels,
            torque: None,
            starts: None,
            whitening: self.whitening.as_ref().zip(self.current_floors()),
            colour: None,
            held_out: self.held_out.as_deref(),
            prior: &self.prior,
        }
    }

    /// Floors of i_d and i_q, A.
    fn current_floors(&self) -> Option<[f64; 2]> {
        let floor = |c: Channel| self.floors.iter().find(|f| f.channel == c).map(Floor::total);
        Some([floor(Channel::ID)?, floor(Channel::IQ)?])
    }

    /// Channels with the floors as weights.
    pub fn channels(&self, electrical: bool, mechanical: bool) -> Vec<(Channel, f64)> {
        let wanted = |c: Channel| if c.is_electrical() { electrical } else { mechanical };
        self.floors.iter().filter(|f| wanted(f.channel)).map(|f| (f.channel, f.total())).collect()
    }

    /// Whether it holds electrical (or mechanical) channels.
    pub fn has(&self, electrical: bool) -> bool {
        self.floors.iter().any(|f| f.channel.is_electrical() == electrical)
    }
}

/// Settings of every fit of the diagnosis: as exact as the noise deserves.
pub const SETTINGS: Settings =
    Settings { max_iterations: 25, cost_tolerance: 1e-5, step_tolerance: 1e-9, initial_damping: 1e-3 };
