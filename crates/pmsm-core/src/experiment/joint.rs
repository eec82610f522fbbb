//! Several recordings of one machine seen through one model.
//!
//! The parameter vector is the model's, followed by the nuisance of each recording in turn. Rows are stacked channel by channel,
//! the voltage equations first, and within a channel recording by recording; where a recording does not hold a channel its rows
//! are zero. With a single recording everything is that of its [`Experiment`].

mod stacked;

use super::{Channel, Experiment, Prior};
use crate::simulate::mechanical::Nuisance;
use nalgebra::DVector;
use std::borrow::Cow;
use std::ops::Range;

/// Channels compared in each recording, each with the standard deviation of its noise.
pub type Channels = Vec<Vec<(Channel, f64)>>;

/// One channel of one recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Number of the recording.
    pub run: usize,
    /// The channel.
    pub channel: Channel,
    /// Its rows among those of all recordings.
    pub rows: Range<usize>,
    /// Rows that count.
    pub counted: usize,
}

/// One recording among several.
#[derive(Debug, Clone)]
struct Place {
    /// Its samples among those of all recordings.
    samples: Range<usize>,
    /// Its windows among those of all recordings.
    windows: Range<usize>,
    /// Its nuisance in the whole parameter vector.
    nuisance: Range<usize>,
}

/// Recordings of one machine, a model and what is compared.
#[derive(Debug, Clone)]
pub struct Joint<'a> {
    runs: Vec<Experiment<'a>>,
    places: Vec<Place>,
    channels: Vec<Channel>,
}

impl<'a> Joint<'a> {
    /// Puts experiments of one model side by side.
    ///
    /// # Panics
    /// Without any experiment.
    pub fn new(runs: Vec<Experiment<'a>>) -> Self {
        let (mut sample, mut window) = (0, 0);
        let mut parameter = runs.first().expect("at least one recording").model.parameter_count();
        let mut places = Vec::with_capacity(runs.len());
        for run in &runs {
            let (samples, windows, own) = (run.samples(), run.windows.len(), run.nuisance.parameter_count());
            places.push(Place {
                samples: sample..sample + samples,
                windows: window..window + windows,
                nuisance: parameter..parameter + own,
            });
            (sample, window, parameter) = (sample + samples, window + windows, parameter + own);
        }
        let mut channels: Vec<Channel> =
            runs.iter().flat_map(|r| r.channels.iter().map(|(c, _)| *c)).collect();
        channels.sort_by_key(|c| (!c.is_electrical(), *c));
        channels.dedup();
        Self { runs, places, channels }
    }

    /// The experiment of the only recording, if there is only one.
    fn only(&self) -> Option<&Experiment<'a>> {
        if let [run] = &self.runs[..] { Some(run) } else { None }
    }

    /// The recordings' own experiments.
    pub fn runs(&self) -> &[Experiment<'a>] {
        &self.runs
    }

    /// Channels that at least one recording holds, in the order of the rows.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// Number of samples of all recordings together.
    pub fn samples(&self) -> usize {
        self.places.last().map_or(0, |p| p.samples.end)
    }

    /// Where the nuisance of recording `run` sits in the parameter vector.
    pub fn nuisance(&self, run: usize) -> Range<usize> {
        self.places[run].nuisance.clone()
    }

    /// The same with motor torque given per sample of all recordings (N·m), as it does not change with what is fitted.
    #[must_use]
    pub fn with_torque(mut self, torque: &'a [f64]) -> Self {
        for (run, place) in self.runs.iter_mut().zip(&self.places) {
            run.torque = Some(&torque[place.samples.clone()]);
        }
        self
    }

    /// The same with the initial electrical speed (rad/s) of each window given, where it is.
    #[must_use]
    pub fn with_starts(mut self, starts: Option<&'a [f64]>) -> Self {
        for (run, place) in self.runs.iter_mut().zip(&self.places) {
            let own = starts.filter(|_| run.has_mechanical()).map(|s| &s[place.windows.clone()]);
            run.starts = own.map(Cow::Borrowed);
        }
        self
    }

    /// The same with every residual as it is, through no filter.
    #[must_use]
    pub fn plain(mut self) -> Self {
        for run in &mut self.runs {
            (run.whitening, run.wander, run.colour) = (None, None, None);
        }
        self
    }

    /// The same with the speed's residual as it is: to first order a missing torque is seen by how far it moves the speed, slowly, which
    /// single samples of innovations hardly show.
    #[must_use]
    pub fn with_plain_speed(mut self) -> Self {
        self.runs.iter_mut().for_each(|run| run.wander = None);
        self
    }

    /// The same with the speed's residual of each recording whitened by a colour of its own, where `colour` finds one; `None`
    /// if it finds none at all.
    pub fn coloured(
        mut self,
        residual: &DVector<f64>,
        colour: impl Fn(&Experiment, &[f64]) -> Option<crate::noise::colour::Colour>,
    ) -> Option<Self> {
        let mut any = false;
        for r in 0..self.runs.len() {
            let found = self
                .rows(r, Channel::OmegaE)
                .and_then(|rows| colour(&self.runs[r], &residual.as_slice()[rows]));
            any |= found.is_some();
            self.runs[r].colour = found;
        }
        any.then_some(self)
    }

    /// The same with the initial speeds of the windows estimated once and for all at `p`.
    pub(super) fn with_estimated_starts(&self, p: &[f64]) -> Self {
        let mut seen = self.clone();
        for (r, run) in seen.runs.iter_mut().enumerate() {
            run.starts = self.runs[r].estimated_starts(&self.of_run(p, r)).map(Cow::Owned);
        }
        seen
    }

    /// Whether the initial speeds are given.
    pub(super) fn has_starts(&self) -> bool {
        self.runs.iter().any(|r| r.starts.is_some())
    }

    /// Least-squares initial electrical speed (rad/s) of each window at `p`, if the speed is compared; the measured one where
    /// a recording does not compare it.
    pub fn estimated_starts(&self, p: &[f64]) -> Option<Vec<f64>> {
        let own: Vec<Option<Vec<f64>>> =
            self.runs.iter().enumerate().map(|(r, run)| run.estimated_starts(&self.of_run(p, r))).collect();
        if own.iter().all(Option::is_none) {
            return None;
        }
        let measured = |run: &Experiment| run.windows.iter().map(|w| run.signals.omega_e[w.start]).collect();
        Some(
            own.into_iter()
                .zip(&self.runs)
                .flat_map(|(own, run)| own.unwrap_or_else(|| measured(run)))
                .collect(),
        )
    }

    /// Whether parameter `index` reaches the voltage equations or the measurement.
    pub fn is_electrical(&self, index: usize) -> bool {
        self.runs[0].is_electrical(index)
    }

    /// What is known beforehand of the parameters.
    pub(super) fn prior(&self) -> &'a [Prior] {
        self.runs[0].prior
    }

    /// Physical bounds of parameter `index`, load levels included.
    pub fn bounds(&self, index: usize) -> (f64, f64) {
        let run = self.owner(index).unwrap_or(0);
        self.runs[run].bounds(self.index_in(run, index))
    }

    /// Number of the recording to whose nuisance parameter `index` belongs; none if it is the machine's.
    fn owner(&self, index: usize) -> Option<usize> {
        self.places.iter().position(|p| p.nuisance.contains(&index))
    }

    /// Where parameter `index` sits in the parameter vector of recording `run` alone.
    fn index_in(&self, run: usize, index: usize) -> usize {
        let place = &self.places[run].nuisance;
        if place.contains(&index) { index - place.start + self.places[0].nuisance.start } else { index }
    }

    /// Factor from the machine's value of parameter `index` to that of recording `run`.
    fn factor(&self, run: usize, index: usize) -> f64 {
        let model = self.runs[run].model;
        let Some(slot) = model.slots().iter().find(|s| s.parameters.contains(&index)) else { return 1.0 };
        let info = &slot.effect.info().parameters[index - slot.parameters.start];
        if info.counts_samples() { model.context().period / self.runs[run].signals.period } else { 1.0 }
    }

    /// The parameter vector of recording `run` alone.
    pub fn of_run<'p>(&self, p: &'p [f64], run: usize) -> Cow<'p, [f64]> {
        if self.runs.len() == 1 {
            return Cow::Borrowed(p);
        }
        let own = self.places[0].nuisance.start;
        let machine = (0..own).map(|k| p[k] * self.factor(run, k));
        Cow::Owned(machine.chain(p[self.places[run].nuisance.clone()].iter().copied()).collect())
    }

    /// Rows of one channel of recording `run`, if it holds that channel.
    pub fn rows(&self, run: usize, channel: Channel) -> Option<Range<usize>> {
        self.runs[run].row_of(channel)?;
        let at = self.channels.iter().position(|c| *c == channel)? * self.samples();
        let samples = &self.places[run].samples;
        Some(at + samples.start..at + samples.end)
    }

    /// All channels of all recordings, recording by recording.
    pub fn blocks(&self) -> Vec<Block> {
        let of = |run: usize| {
            let experiment = &self.runs[run];
            let counted = experiment.counted();
            experiment.channels.iter().filter_map(move |(channel, _)| {
                let rows = self.rows(run, *channel)?;
                Some(Block { run, channel: *channel, rows, counted })
            })
        };
        (0..self.runs.len()).flat_map(of).collect()
    }
}

/// The nuisance of each of several recordings within the parameters that follow the model's.
pub fn split<'p>(
    nuisances: &'p [Nuisance],
    parameters: &'p [f64],
) -> impl Iterator<Item = (Nuisance, &'p [f64])> {
    let mut at = 0;
    nuisances.iter().map(move |nuisance| {
        let own = &parameters[at..at + nuisance.parameter_count()];
        at += nuisance.parameter_count();
        (*nuisance, own)
    })
}
