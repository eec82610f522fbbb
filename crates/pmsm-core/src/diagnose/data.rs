//! Recordings made ready for the diagnosis: signals, windows, floors, and what is known beforehand.
//!
//! Several recordings of one machine are fitted together, each with its own clock, noise, load and initial values; see
//! [`super::join`].

use super::options::DiagnosisOptions;
use crate::base::BASE;
use crate::error::Result;
use crate::experiment::floor::{self, Floor};
use crate::experiment::{Channel, Channels, Experiment, Joint, Prior};
use crate::machine::{BaseParameter, Machine};
use crate::model::Model;
use crate::noise::input::InputNoise;
use crate::noise::lasting;
use crate::noise::wander::Wander;
use crate::noise::whitening::Whitening;
use crate::optimise::least_squares::Settings;
use crate::recording::Kind;
use crate::signals::{Logged, Signals};
use crate::simulate::mechanical::{self, Nuisance};
use crate::start;
use std::ops::Range;

/// Noise of a current that no third phase shows, share of the largest current: a usual sensor of a drive.
const CURRENT_NOISE: f64 = 0.002;
/// Noise of the voltage of a steady point before its neighbours show it, share of the largest voltage.
const VOLTAGE_NOISE: f64 = 0.005;
/// Length of a short window, s, and the fewest rows of one.
const SHORT: f64 = 0.025;
const FEWEST_ROWS: usize = 8;
/// Fewest mechanical windows from which every other one is held out where no validation run is given.
const FEWEST_WINDOWS: usize = 4;

/// One recording, or several of one machine, made ready for fitting.
#[derive(Debug, Clone)]
pub struct Data {
    /// Its signals; those of several recordings lie end to end, and drive no model.
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
    /// What the nameplate says of them.
    pub nameplate: [Option<f64>; BASE],
    /// What is known of parameters beforehand, from the nameplate or from what machines there are.
    pub prior: Vec<Prior>,
    /// Whether the recording does not pin down what the machine does elsewhere.
    pub poor: bool,
    /// Samples that do not count, if some are held out.
    pub held_out: Option<Vec<bool>>,
    /// The constants on which a verdict rests.
    pub options: DiagnosisOptions,
    /// When a fit to it ends.
    pub settings: Settings,
    /// The recordings, if there are several; the rest then describes all of them. What a recording shows of the motion and of steady points are
    /// two parts.
    pub parts: Vec<Data>,
    /// The recording from which each part comes, from zero.
    pub origins: Vec<usize>,
}

impl Data {
    /// Prepares a recording. Floors are still the sensors' alone, read from the log; [`Data::settle_floors`] completes them.
    ///
    /// # Errors
    /// Those of [`Signals::new`] and [`start::values`].
    pub fn new(signals: Signals, machine: &Machine, options: &DiagnosisOptions) -> Result<Self> {
        let start = start::values(&signals, machine)?;
        Ok(Self::started(signals, machine, start, options))
    }

    /// The same from given base parameters.
    pub fn started(
        mut signals: Signals,
        machine: &Machine,
        mut start: [f64; BASE],
        options: &DiagnosisOptions,
    ) -> Self {
        lasting::find(&mut signals);
        let windows = mechanical::windows(&signals);
        let nameplate = BaseParameter::ALL.map(|p| machine.get(p));
        let known = |p: &BaseParameter| known(*p, nameplate[p.index()], &signals, options);
        let prior: Vec<Prior> = BaseParameter::ALL.iter().filter_map(known).collect();
        for prior in &prior {
            // A regression far outside the prior is no start for a fit.
            if prior.off(start[prior.index]).0.abs() > OUTLANDISH {
                start[prior.index] = prior.value;
            }
        }
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
        let current = floor::current_noise(&signals);
        let floors = channels
            .iter()
            .map(|&channel| {
                let sensor = match channel {
                    Channel::ID | Channel::IQ => current.unwrap_or(CURRENT_NOISE * signals.context.i_max),
                    Channel::OmegaE => {
                        floor::speed_noise(&signals).max(floor::RESOLUTION * signals.context.omega_e_max)
                    }
                    Channel::VD | Channel::VQ => VOLTAGE_NOISE * signals.context.v_max,
                };
                Floor { channel, sensor, driven: 0.0, unsure: 0.0, swing: 0.0, wander: None }
            })
            .collect();
        let (input, whitening) = (InputNoise::default(), None);
        let (held_out, parts, origins) = (None, Vec::new(), Vec::new());
        Self {
            signals,
            windows,
            floors,
            input,
            whitening,
            start,
            nameplate,
            prior,
            poor: false,
            held_out,
            options: *options,
            settings: SETTINGS,
            parts,
            origins,
        }
    }

    /// The recordings, each by itself.
    pub fn runs(&self) -> &[Data] {
        if self.parts.is_empty() { std::slice::from_ref(self) } else { &self.parts }
    }

    /// Number of the recording from which part `run` comes, from one; none where there is only one recording.
    pub fn number(&self, run: usize) -> Option<usize> {
        let several = self.origins.iter().any(|origin| *origin > 0);
        several.then(|| self.origins[run] + 1)
    }

    /// Whether its voltages are those of steady points.
    pub fn is_steady(&self) -> bool {
        self.runs().iter().any(|run| run.signals.kind == Kind::OperatingPoints)
    }

    /// The recording that holds most: voltages before motion, then the longest.
    pub fn leading(&self) -> &Data {
        let rank = |d: &&Data| (d.signals.kind == Kind::Full, d.has_electrical(), d.signals.len());
        self.runs().iter().rev().max_by_key(rank).expect("at least one recording")
    }

    /// The same with further priors.
    pub fn with_prior(mut self, more: &[Prior]) -> Self {
        self.prior.extend(more);
        self.parts.iter_mut().for_each(|part| part.prior.extend(more));
        self
    }

    /// The same without priors.
    pub fn without_prior(mut self) -> Self {
        self.prior.clear();
        self.parts = self.parts.into_iter().map(Self::without_prior).collect();
        self
    }

    /// The same where noise of the voltages does not let the currents wander.
    pub(super) fn with_white_currents(&self) -> Self {
        let mut out = self.clone();
        (out.whitening, out.input) = (None, InputNoise::default());
        out.parts.iter_mut().for_each(|part| *part = part.with_white_currents());
        out
    }

    /// The same in windows so short that an impact at a wrong time hardly moves what follows: the best parameters then lie in a wide valley.
    pub fn in_short_windows(&self) -> Self {
        let mut out = self.clone();
        let rows = ((SHORT / self.signals.period) as usize).max(FEWEST_ROWS);
        for windows in std::iter::once(&mut out.windows).chain(out.parts.iter_mut().map(|p| &mut p.windows)) {
            let pieces = |w: &Range<usize>| {
                let (count, w) = ((w.len() / rows).max(1), w.clone());
                let at = move |k: usize| w.start + k * w.len() / count;
                (0..count).map(move |k| at(k)..at(k + 1))
            };
            *windows = windows.iter().flat_map(pieces).collect();
        }
        out
    }

    /// The recording split into windows of which every other one is held out, and the complement; `None` if there are too few.
    pub fn halves(&self) -> Option<(Self, Self)> {
        if self.windows.len() < FEWEST_WINDOWS {
            return None;
        }
        let mut odd = vec![false; self.signals.len()];
        for run in 0..self.runs().len() {
            let samples = self.samples_of(run);
            let own = self.windows.iter().filter(|w| samples.contains(&w.start));
            for window in own.skip(1).step_by(2) {
                odd[window.clone()].fill(true);
            }
        }
        let even = odd.iter().map(|x| !x).collect();
        Some((self.masked(odd), self.masked(even)))
    }

    /// The same recording for fits that are only compared, which may end 0.3 nats of evidence before their minimum.
    pub fn roughly(&self) -> Self {
        let rows = self.counted() * self.floors.len().max(1);
        let tolerance = 2.0 * self.options.rows_per_sample * ROUGHLY / rows.max(1) as f64;
        let cost_tolerance = tolerance.clamp(SETTINGS.cost_tolerance, LARGEST_TOLERANCE);
        let settings = Settings { cost_tolerance, stall_tolerance: cost_tolerance, ..SETTINGS };
        Self { settings, ..self.clone() }
    }

    /// The same recording with some samples held out.
    pub fn masked(&self, held_out: Vec<bool>) -> Self {
        let mut at = 0;
        let own = |part: &Data| {
            let samples = at..at + part.signals.len();
            at = samples.end;
            part.masked(held_out[samples].to_vec())
        };
        let parts = self.parts.iter().map(own).collect();
        Self { parts, held_out: Some(held_out), ..self.clone() }
    }

    /// Number of samples that count.
    pub fn counted(&self) -> usize {
        self.held_out.as_ref().map_or(self.signals.len(), |h| h.iter().filter(|x| !**x).count())
    }

    /// The motion alone, driven by a motor `torque` per sample (N·m) that does not change with what is fitted.
    pub fn motion<'a>(&'a self, model: &'a Model, nuisances: &[Nuisance], torque: &'a [f64]) -> Joint<'a> {
        self.experiment(model, nuisances, self.channels(false, true)).with_torque(torque)
    }

    /// The recordings seen through a model. A recording without a nuisance in `nuisances` leaves nothing open.
    pub fn experiment<'a>(
        &'a self,
        model: &'a Model,
        nuisances: &[Nuisance],
        channels: Channels,
    ) -> Joint<'a> {
        let see = |run: usize, part: &'a Data, channels: &[(Channel, f64)]| Experiment {
            model,
            signals: &part.signals,
            nuisance: nuisances.get(run).copied().unwrap_or(Nuisance::known(0)),
            windows: &part.windows,
            channels: channels.to_vec(),
            torque: None,
            starts: None,
            whitening: part.whitening.as_ref().zip(part.current_floors()),
            wander: part.wander(),
            colour: None,
            held_out: part.held_out.as_deref(),
            prior: &self.prior,
        };
        Joint::new(
            self.runs().iter().zip(&channels).enumerate().map(|(k, (part, c))| see(k, part, c)).collect(),
        )
    }

    /// Whether its speed has driven noise that is not filtered.
    pub fn wanders_unfiltered(&self) -> bool {
        self.floors.iter().any(Floor::unfiltered)
    }

    /// The driven noise of the speed, where there is one, and the floor of the speed, rad/s.
    pub fn wander(&self) -> Option<(Wander, f64)> {
        self.floors.iter().find_map(|f| Some((f.wander?, f.total())))
    }

    /// Floors of i_d and i_q, A.
    fn current_floors(&self) -> Option<[f64; 2]> {
        let floor = |c: Channel| self.floors.iter().find(|f| f.channel == c).map(Floor::total);
        Some([floor(Channel::ID)?, floor(Channel::IQ)?])
    }

    /// Channels of each recording with the floors as weights.
    pub fn channels(&self, electrical: bool, mechanical: bool) -> Channels {
        let wanted = |c: Channel| if c.is_electrical() { electrical } else { mechanical };
        let own = |part: &Data| {
            part.floors.iter().filter(|f| wanted(f.channel)).map(|f| (f.channel, f.total())).collect()
        };
        self.runs().iter().map(own).collect()
    }

    /// Motor torque per sample from the measured currents (or as recorded), N·m; zero in a recording that does not show the motion.
    pub fn torque(&self, model: &Model, own: &[f64]) -> Vec<f64> {
        let of = |part: &Data| match part.has_mechanical() {
            true => mechanical::torque(model, &part.signals, own),
            false => vec![0.0; part.signals.len()],
        };
        self.runs().iter().flat_map(of).collect()
    }

    /// Takes the voltages of all recordings as held in the stator's frame; see [`Signals::hold_in_stator`].
    pub fn hold_in_stator(&mut self, logged: Logged) {
        self.signals.hold_in_stator(logged);
        self.parts.iter_mut().for_each(|part| part.hold_in_stator(logged));
    }

    /// Number of initial values of a model's mechanical states that this recording leaves open: theirs each time they begin anew.
    pub fn initial_states(&self, model: &Model) -> usize {
        model.mechanical_states() * mechanical::beginnings(&self.signals, &self.windows)
    }

    /// Whether an equation of any recording contains the parameter.
    pub fn needs(&self, parameter: BaseParameter) -> bool {
        self.runs().iter().any(|part| start::needed(&part.signals, parameter))
    }

    /// Voltage of the DC link where it is stated, V.
    pub fn link(&self) -> Option<f64> {
        let signals = &self.signals;
        signals.link_stated.then_some(signals.context.v_dc)
    }

    /// Whether it holds electrical channels.
    pub fn has_electrical(&self) -> bool {
        self.floors.iter().any(|f| f.channel.is_electrical())
    }

    /// Whether it holds the speed.
    pub fn has_mechanical(&self) -> bool {
        self.floors.iter().any(|f| !f.channel.is_electrical())
    }
}

/// Standard deviations of its prior beyond which a first value of a parameter is replaced by the mean of the prior.
const OUTLANDISH: f64 = 3.0;

/// What is known of a base parameter whose `nameplate` value is this, if anything is.
fn known(
    parameter: BaseParameter,
    nameplate: Option<f64>,
    signals: &Signals,
    options: &DiagnosisOptions,
) -> Option<Prior> {
    let (index, cx) = (parameter.index(), &signals.context);
    match nameplate {
        Some(value) if value > 0.0 && parameter != BaseParameter::B => {
            Some(Prior::lognormal(index, value, options.nameplate_spread))
        }
        Some(value) => Some(Prior::normal(index, value, options.friction_spread * value.abs().max(1e-9))),
        None if parameter == BaseParameter::J => {
            let median = options.run_up * cx.tau_max / cx.omega_m_max();
            (median > 0.0 && median.is_finite())
                .then(|| Prior::lognormal(index, median, options.run_up_spread))
        }
        None => None,
    }
}

/// Nats that a fit may leave where sets are compared: what decides is many times that.
const ROUGHLY: f64 = 0.3;
/// Largest share of the cost that a fit may leave.
const LARGEST_TOLERANCE: f64 = 1e-3;

/// Settings of every fit that counts: as exact as the noise deserves.
pub const SETTINGS: Settings = Settings {
    max_iterations: 25,
    cost_tolerance: 1e-5,
    step_tolerance: 1e-9,
    initial_damping: 1e-3,
    leaves_rest: false,
    stall_tolerance: 2e-5,
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{data, setup, speeds};

    #[test]
    fn short_windows_cover_the_rows_of_the_long_ones() {
        let (data, _) = data(&setup(speeds(0.6, &[(0.1, 60.0), (0.4, -50.0)]), Vec::new()));
        let short = data.in_short_windows();
        let rows = |data: &Data| data.windows.iter().cloned().flatten().collect::<Vec<usize>>();
        assert_eq!(rows(&short), rows(&data));
        let lasts = |w: &Range<usize>| w.len() as f64 * data.signals.period;
        assert!(short.windows.len() > 5 * data.windows.len());
        assert!(short.windows.iter().all(|w| (0.02..0.035).contains(&lasts(w))), "{:?}", short.windows);
    }
}
