//! Recordings seen through one model: residuals, exact derivatives, and the fit of any subset of parameters.
//!
//! The parameter vector is the model's, followed by that of the run's [`Nuisance`]. Residuals are model minus measurement over
//! the noise of the channel, stacked channel by channel. The initial speed of each mechanical window is estimated
//! inside and projected out, so that callers never see it.

mod course;
mod currents;
mod decay;
mod fitting;
pub mod floor;
mod forms;
mod joint;
mod load;
mod lost;
mod prior;
mod response;
mod rows;
mod speed;
#[cfg(test)]
mod testing;
mod transition;
mod variation;

pub use course::Course;
pub use fitting::Fitted;
pub use joint::{Block, Channels, Joint, split};
pub use lost::{Answering, LAGS, LATE, LATE_SQUARED, TURNED};
pub use prior::Prior;

use crate::base::BASE;
use crate::effect::Site;
use crate::machine::BaseParameter;
use crate::model::Model;
use crate::noise::colour::Colour;
use crate::noise::wander::Wander;
use crate::noise::whitening::Whitening;
use crate::numerics::dual::Dual;
use crate::numerics::real::Real;
use crate::signals::Signals;
use crate::simulate::mechanical::Nuisance;
use nalgebra::{DMatrix, DVector};
use std::borrow::Cow;
use std::ops::Range;

/// Passes of models through recordings on this thread, for tests of what is left undone after a stop.
#[cfg(test)]
pub(crate) mod passes {
    use std::cell::Cell;

    thread_local! {
        static COUNT: Cell<usize> = const { Cell::new(0) };
    }

    pub fn count() -> usize {
        COUNT.get()
    }

    pub(super) fn add() {
        COUNT.set(COUNT.get() + 1);
    }
}

/// A measured quantity that a model predicts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// d-axis current, A.
    ID,
    /// q-axis current, A.
    IQ,
    /// Electrical speed, rad/s.
    OmegaE,
    /// d-axis voltage of an operating point, V.
    VD,
    /// q-axis voltage of an operating point, V.
    VQ,
}

impl Channel {
    /// Column name.
    pub fn name(self) -> &'static str {
        ["i_d", "i_q", "omega_e", "v_d", "v_q"][self as usize]
    }

    /// SI unit.
    pub fn unit(self) -> &'static str {
        ["A", "A", "rad/s", "V", "V"][self as usize]
    }

    /// Whether the channel belongs to the voltage equations.
    pub fn is_electrical(self) -> bool {
        self != Self::OmegaE
    }
}

/// Fewest blocks whose mean square is still sharp enough to be looked at.
const LEAST_BLOCKS: usize = 500;
/// The same of a speed that wanders: of a torque that is missing its filter leaves what is slow.
const LEAST_SWINGS: usize = 40;
/// Derivatives carried in one pass.
const LANES: usize = 8;

/// A recording, a model and what is compared.
#[derive(Debug, Clone)]
pub struct Experiment<'a> {
    /// The model.
    pub model: &'a Model,
    /// The recording.
    pub signals: &'a Signals,
    /// What the run leaves open: unknown load, initial values.
    pub nuisance: Nuisance,
    /// Mechanical windows.
    pub windows: &'a [Range<usize>],
    /// Channels compared, each with the standard deviation of its noise; the speed comes last.
    pub channels: Vec<(Channel, f64)>,
    /// Motor torque per sample (N·m) where it is known not to change with what is fitted.
    pub torque: Option<&'a [f64]>,
    /// Electrical speed (rad/s) with which each window is simulated from; estimated where it is not given. What a better initial
    /// value would change is projected out, so that it need only be near.
    pub starts: Option<Cow<'a, [f64]>>,
    /// Filter that whitens the currents' residual, and the floors (A) of i_d and i_q to which it refers; none leaves it as it is.
    pub whitening: Option<(&'a Whitening, [f64; 2])>,
    /// How noise makes the speed wander, which is taken out of its residual within each window, and the floor (rad/s) to which that refers;
    /// none leaves it as it is.
    pub wander: Option<(Wander, f64)>,
    /// Colour by which the speed's residual is whitened within each window; none leaves it as it is.
    pub colour: Option<Colour>,
    /// Samples that do not count (held out), if any.
    pub held_out: Option<&'a [bool]>,
    /// What is known of parameters beforehand. It decides only what the recording does not show.
    pub prior: &'a [Prior],
}

/// Residuals and their derivatives at one point.
#[derive(Debug, Clone)]
pub struct Linearisation {
    /// Stacked weighted residuals, channel by channel.
    pub residual: DVector<f64>,
    /// Their derivatives, one column per free parameter.
    pub jacobian: DMatrix<f64>,
}

/// What a model predicts for each compared channel, in the order of [`Experiment::channels`].
pub type Prediction = Vec<Vec<f64>>;

impl<'a> Experiment<'a> {
    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.signals.len()
    }

    fn row_of(&self, channel: Channel) -> Option<(usize, f64)> {
        self.channels
            .iter()
            .position(|(c, _)| *c == channel)
            .map(|k| (k * self.samples(), 1.0 / self.channels[k].1))
    }

    fn has_mechanical(&self) -> bool {
        self.row_of(Channel::OmegaE).is_some()
    }

    fn has_electrical(&self) -> bool {
        self.channels.iter().any(|(c, _)| c.is_electrical())
    }

    /// Whether parameter `index` reaches the voltage equations or the measurement.
    pub fn is_electrical(&self, index: usize) -> bool {
        if index < BASE {
            return index < BaseParameter::J.index();
        }
        let mapped = self.model.map_parameters();
        if mapped.contains(&index) {
            let site = self.model.map().and_then(|map| map.site(index - mapped.start));
            return site.is_some_and(|site| site != Site::Mechanical);
        }
        let slot = self.model.slots().iter().find(|s| s.parameters.contains(&index));
        slot.is_some_and(|s| s.effect.info().site != Site::Mechanical)
    }

    /// Rows of the channels before the speed.
    fn electrical_rows(&self) -> usize {
        let before = self.channels.iter().take_while(|(c, _)| c.is_electrical()).count();
        assert!(self.channels.len() - before <= 1, "the speed is the last channel");
        before * self.samples()
    }

    /// Weighted residuals at `p`.
    ///
    /// # Panics
    /// If the speed is not the last of the channels.
    pub fn residual(&self, p: &[f64]) -> DVector<f64> {
        #[cfg(test)]
        passes::add();
        let mut linear = Linearisation::zeros(self.channels.len() * self.samples(), 0);
        let (mut electrical, speed) = linear.split_rows(self.electrical_rows());
        let currents = || {
            if self.has_electrical() {
                self.fill_electrical::<f64>(p, |row, value| electrical.residual[row] = value);
                self.whiten_residual(p, Vec::new, &[], &mut electrical);
            }
        };
        let motion = || {
            if self.has_mechanical() {
                let torque = self.torque_at(p);
                let run = self.speed_pass(p, &torque, &self.starts(p, &torque));
                self.project(&run, speed);
            }
        };
        rayon::join(currents, motion);
        self.mask(&mut linear);
        linear.residual
    }

    /// Weighted residuals at `p` and their derivatives with respect to the parameters `free`.
    ///
    /// # Panics
    /// If the speed is not the last of the channels.
    pub fn linearise(&self, p: &[f64], free: &[usize]) -> Linearisation {
        self.linearise_along(p, free, None)
    }

    /// The same where the rotor's `course` at `p` may be known; voltage equations that nothing of `free` reaches are then left out,
    /// their residual along with them.
    ///
    /// # Panics
    /// As [`Self::linearise`].
    pub fn linearise_along(&self, p: &[f64], free: &[usize], course: Option<&Course>) -> Linearisation {
        #[cfg(test)]
        passes::add();
        let mut linear = Linearisation::zeros(self.channels.len() * self.samples(), free.len());
        let (electrical, speed) = linear.split_rows(self.electrical_rows());
        let wanted = course.is_none() || free.iter().any(|k| self.is_electrical(*k));
        let currents = || {
            if self.has_electrical() && wanted {
                self.linearise_electrical(p, free, electrical);
            }
        };
        let motion = || {
            if self.has_mechanical() {
                self.linearise_mechanical(p, free, course, speed);
            }
        };
        rayon::join(currents, motion);
        self.mask(&mut linear);
        linear
    }

    fn mask(&self, linear: &mut Linearisation) {
        let Some(held_out) = self.held_out else { return };
        let n = self.samples();
        let Linearisation { residual, jacobian } = linear;
        let columns = jacobian.as_mut_slice().chunks_exact_mut(residual.len().max(1));
        for column in columns.chain([residual.as_mut_slice()]) {
            for channel in column.chunks_exact_mut(n) {
                channel.iter_mut().zip(held_out).filter(|(_, out)| **out).for_each(|(x, _)| *x = 0.0);
            }
        }
    }

    /// What the model shows in each channel; the speed runs free from its estimated initial value in each window.
    ///
    /// # Panics
    /// As [`Self::residual`].
    pub fn predict(&self, p: &[f64]) -> Prediction {
        #[cfg(test)]
        passes::add();
        let n = self.samples();
        let electrical = || -> Prediction {
            let mut residual = vec![0.0; self.electrical_rows()];
            self.fill_electrical::<f64>(p, |row, value| residual[row] = value);
            let shown = residual.chunks(n.max(1)).zip(&self.channels).map(|(rows, (channel, sigma))| {
                rows.iter().zip(self.measured(*channel)).map(|(r, measured)| r * sigma + measured).collect()
            });
            shown.collect()
        };
        let mechanical = || {
            self.has_mechanical().then(|| {
                let torque = self.torque_at(p);
                self.speed_pass(p, &torque, &self.starts(p, &torque)).shown
            })
        };
        let (mut out, speed) = rayon::join(electrical, mechanical);
        out.extend(speed);
        out
    }

    /// The measurement of a channel.
    pub fn measured(&self, channel: Channel) -> &'a [f64] {
        let s = self.signals;
        let pair = |x: &'a Option<[Vec<f64>; 2]>, axis: usize| x.as_ref().map_or(&[][..], |x| &x[axis]);
        match channel {
            Channel::ID => pair(&s.i, 0),
            Channel::IQ => pair(&s.i, 1),
            Channel::VD => pair(&s.v, 0),
            Channel::VQ => pair(&s.v, 1),
            Channel::OmegaE => &s.omega_e,
        }
    }

    /// Mean square of the weighted residual in each channel, over the samples that count, and the number of samples that share one
    /// independent value. Whitened residuals are looked at in means over 1, 2, 4, … samples; the scale at which most is left counts.
    pub fn mean_squares(&self, residual: &DVector<f64>) -> Vec<(f64, usize)> {
        let plain = self.relative_rms(residual);
        let wanders = self.whitening.is_some_and(|(filter, _)| filter.wanders());
        let at = |c: usize| {
            let slow = match self.channels[c].0 {
                Channel::ID | Channel::IQ => wanders,
                Channel::OmegaE => self.wander.is_some(),
                Channel::VD | Channel::VQ => false,
            };
            if slow { self.loudest(residual, c, plain[c]) } else { (plain[c] * plain[c], 1) }
        };
        (0..self.channels.len()).map(at).collect()
    }

    /// Root of the mean square over blocks, times their length, at the scale at which most is left, for each channel: one for white
    /// noise of the size of the floor, and more the longer that lasts which is left.
    pub fn loudness(&self, residual: &DVector<f64>) -> Vec<f64> {
        let plain = self.relative_rms(residual);
        (0..self.channels.len()).map(|c| self.loudest(residual, c, plain[c]).0.sqrt()).collect()
    }

    /// Mean square of channel `c`, whose root mean square is `plain`, in means over 1, 2, 4, … samples, in which white noise keeps the
    /// mean square and what lasts longer stands out: the largest, and the number of samples of its scale. Noise of the sensor that lasts is
    /// expected to.
    fn loudest(&self, residual: &DVector<f64>, c: usize, plain: f64) -> (f64, usize) {
        let n = self.samples();
        let rows = &residual.as_slice()[c * n..(c + 1) * n];
        let counted = self.counted();
        let mut best = (plain * plain, 1);
        let mut size = 2;
        let lasting = self.lasting_rows(c);
        let expected = |size: usize| {
            let of = |rows: &Vec<f64>| 1.0 + self.block_square(rows, size) - self.block_square(rows, 1);
            lasting.as_ref().map_or(1.0, of).max(1.0)
        };
        let speed = self.channels[c].0 == Channel::OmegaE && self.wander.is_some();
        let least = if speed { LEAST_SWINGS } else { LEAST_BLOCKS };
        while counted / size >= least {
            // Of two standard errors nothing is known for certain.
            let certain = 1.0 - 2.0 * (2.0 * size as f64 / counted as f64).sqrt();
            let mean = self.block_square(rows, size) * certain / expected(size);
            if mean > best.0 {
                best = (mean, size);
            }
            size *= 2;
        }
        best
    }

    /// What noise of the sensor that lasts leaves in channel `c`, weighted and whitened as its residual is; `None` where the noise is white.
    fn lasting_rows(&self, c: usize) -> Option<Vec<f64>> {
        let limits = &self.signals.limits;
        let (channel, floor) = self.channels[c];
        if channel == Channel::OmegaE {
            let mut rows: Vec<f64> = limits.speed_noise.as_ref()?.series.iter().map(|x| x / floor).collect();
            self.windows.iter().for_each(|window| self.whiten_speed(&mut rows[window.clone()]));
            return Some(rows);
        }
        let mut d = limits.current_noise.as_ref()?.series.clone();
        let mut q = d.clone();
        // The two axes have noise of the same colour, and not the same noise.
        q.rotate_left(d.len() / 2);
        if let Some((whitening, floors)) = self.whitening {
            whitening.apply(&mut d, &mut q);
            let axis = usize::from(channel == Channel::IQ);
            [&mut d, &mut q][axis].iter_mut().for_each(|x| *x *= floors[axis]);
        }
        let mut rows = if channel == Channel::IQ { q } else { d };
        rows.iter_mut().for_each(|x| *x /= floor);
        Some(rows)
    }

    /// Fewest values in which what is left of the speed is looked at: every sample, or few long means where it wanders.
    pub fn fewest_speeds(&self) -> usize {
        if self.wander.is_some() { LEAST_SWINGS.min(self.counted()) } else { self.counted() }
    }

    /// Mean square of the sums over blocks of `size` samples that count, divided by `size`.
    fn block_square(&self, rows: &[f64], size: usize) -> f64 {
        let counts = |block: usize| {
            let range = block * size..(block + 1) * size;
            self.held_out.is_none_or(|h| h[range].iter().all(|x| !x))
        };
        let blocks: Vec<usize> = (0..rows.len() / size).filter(|b| counts(*b)).collect();
        let sum = |b: &usize| rows[b * size..(b + 1) * size].iter().sum::<f64>().powi(2) / size as f64;
        blocks.iter().map(sum).sum::<f64>() / blocks.len().max(1) as f64
    }

    /// Number of samples that count.
    fn counted(&self) -> usize {
        self.held_out.map_or(self.samples(), |h| h.iter().filter(|x| !**x).count())
    }

    /// Root mean square of the weighted residual in each channel, over the samples that count.
    pub fn relative_rms(&self, residual: &DVector<f64>) -> Vec<f64> {
        let n = self.samples();
        let counted = self.counted().max(1);
        (0..self.channels.len())
            .map(|c| (residual.rows(c * n, n).norm_squared() / counted as f64).sqrt())
            .collect()
    }
}

/// The parameter vector with derivative slots for the given columns of `free`.
fn seed<const N: usize>(p: &[f64], columns: &[usize], free: &[usize]) -> Vec<Dual<N>> {
    let mut seeded: Vec<Dual<N>> = p.iter().map(|x| Dual::constant(*x)).collect();
    for (slot, column) in columns.iter().enumerate() {
        seeded[free[*column]] = Dual::variable(p[free[*column]], slot);
    }
    seeded
}
