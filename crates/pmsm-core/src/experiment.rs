//! One recording seen through one model: residuals, exact derivatives, and the fit of any subset of parameters.
//!
//! The parameter vector is the model's, followed by that of the run's [`Nuisance`]. Residuals are model minus measurement over
//! the noise of the channel, stacked channel by channel. The initial speed of each mechanical window is estimated
//! inside and projected out, so that callers never see it.

use crate::base::BASE;
use crate::effect::Site;
use crate::error::Result;
use crate::least_squares::{self, Fit, Normal, Problem, Settings};
use crate::machine::BaseParameter;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::real::{Dual, Real};
use crate::signals::Signals;
use crate::simulate::mechanical::{self, Nuisance, Restart};
use crate::simulate::{electrical, quasi_static};
use nalgebra::{DMatrix, DVector};
use std::borrow::Cow;
use std::ops::Range;

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

/// Derivatives carried in one pass.
const LANES: usize = 8;
/// Rounds of a fit after each of which the initial speeds are estimated anew.
const STARTS: usize = 3;
/// Relative change of the cost by new initial speeds that calls for another round.
const STALE: f64 = 1e-3;

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
    /// Channels compared, each with the standard deviation of its noise.
    pub channels: Vec<(Channel, f64)>,
    /// Motor torque per sample (N·m) where it is known not to change with what is fitted.
    pub torque: Option<&'a [f64]>,
    /// Electrical speed (rad/s) with which each window is simulated from; estimated where it is not given. What a better initial
    /// value would change is projected out, so that it need only be near.
    pub starts: Option<Cow<'a, [f64]>>,
    /// Lag-one correlation by which the speed's residual is whitened within each window; zero leaves it as it is.
    pub colour: f64,
    /// Samples that do not count (held out), if any.
    pub held_out: Option<&'a [bool]>,
    /// What is known beforehand: parameter, value, standard deviation. It decides only what the recording does not show.
    pub prior: &'a [(usize, f64, f64)],
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
    fn samples(&self) -> usize {
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
        let slot = self.model.slots().iter().find(|s| s.parameters.contains(&index));
        slot.is_some_and(|s| s.effect.info().site != Site::Mechanical)
    }

    /// Weighted residuals at `p`.
    pub fn residual(&self, p: &[f64]) -> DVector<f64> {
        let mut residual = DVector::zeros(self.channels.len() * self.samples());
        if self.has_electrical() {
            self.fill_electrical::<f64>(p, |row, value| residual[row] = value);
        }
        if self.has_mechanical() {
            let torque = self.torque_at(p);
            let (shown, slope) = self.speed_pass(p, &torque, &self.starts(p, &torque));
            self.project(&shown, &slope, residual.as_mut_slice(), &mut DMatrix::zeros(0, 0));
        }
        self.mask(&mut residual, None);
        residual
    }

    /// Weighted residuals at `p` and their derivatives with respect to the parameters `free`.
    pub fn linearise(&self, p: &[f64], free: &[usize]) -> Linearisation {
        let rows = self.channels.len() * self.samples();
        let mut residual = DVector::zeros(rows);
        let mut jacobian = DMatrix::zeros(rows, free.len());
        if self.has_electrical() {
            let reaching: Vec<usize> = (0..free.len()).filter(|c| self.is_electrical(free[*c])).collect();
            for columns in chunks(&reaching, LANES) {
                let at = (p, free, columns);
                match columns.len() {
                    0..=2 => self.electrical_pass::<2>(at, &mut residual, &mut jacobian),
                    3..=4 => self.electrical_pass::<4>(at, &mut residual, &mut jacobian),
                    _ => self.electrical_pass::<LANES>(at, &mut residual, &mut jacobian),
                }
            }
        }
        if self.has_mechanical() {
            self.linearise_mechanical(p, free, &mut residual, &mut jacobian);
        }
        self.mask(&mut residual, Some(&mut jacobian));
        Linearisation { residual, jacobian }
    }

    fn fill_electrical<T: Real>(&self, p: &[T], mut put: impl FnMut(usize, T)) {
        let p = &p[..self.model.parameter_count()];
        let pair = |a, b| Some((self.row_of(a)?, self.row_of(b)?));
        if let (Some(((d, wd), (q, wq))), Some(i)) = (pair(Channel::ID, Channel::IQ), &self.signals.i) {
            electrical::run(self.model, self.signals, p, |k, now| {
                put(d + k, (now[0] - i[0][k]) * wd);
                put(q + k, (now[1] - i[1][k]) * wq);
            });
        }
        if let (Some(((d, wd), (q, wq))), Some(v)) = (pair(Channel::VD, Channel::VQ), &self.signals.v) {
            quasi_static::run(self.model, self.signals, p, |k, now| {
                put(d + k, (now[0] - v[0][k]) * wd);
                put(q + k, (now[1] - v[1][k]) * wq);
            });
        }
    }

    /// Electrical residuals and their derivatives for some `columns` of the parameters `free`.
    fn electrical_pass<const N: usize>(
        &self,
        (p, free, columns): (&[f64], &[usize], &[usize]),
        residual: &mut DVector<f64>,
        jacobian: &mut DMatrix<f64>,
    ) {
        let seeded = seed::<N>(p, columns, free);
        self.fill_electrical(&seeded, |row, value: Dual<N>| {
            residual[row] = value.re;
            for (slot, column) in columns.iter().enumerate() {
                jacobian[(row, *column)] = value.eps[slot];
            }
        });
    }

    fn linearise_mechanical(
        &self,
        p: &[f64],
        free: &[usize],
        residual: &mut DVector<f64>,
        jacobian: &mut DMatrix<f64>,
    ) {
        let torque = self.torque_at(p);
        let starts = self.starts(p, &torque);
        let n = self.samples();
        let mut speed = (vec![0.0; n], vec![0.0; n]);
        let all: Vec<usize> = (0..free.len()).collect();
        for columns in chunks(&all, LANES - 1) {
            let at = (p, free, columns);
            match columns.len() {
                0..=1 => self.mechanical_pass::<2>(at, &torque, &starts, &mut speed, jacobian),
                2..=3 => self.mechanical_pass::<4>(at, &torque, &starts, &mut speed, jacobian),
                _ => self.mechanical_pass::<LANES>(at, &torque, &starts, &mut speed, jacobian),
            }
        }
        self.project(&speed.0, &speed.1, residual.as_mut_slice(), jacobian);
    }

    /// Speed, its derivative with respect to the initial speeds, and those for some `columns` of the parameters `free`.
    fn mechanical_pass<const N: usize>(
        &self,
        (p, free, columns): (&[f64], &[usize], &[usize]),
        torque: &[f64],
        starts: &[f64],
        (shown, slope): &mut (Vec<f64>, Vec<f64>),
        jacobian: &mut DMatrix<f64>,
    ) {
        let (row, weight) = self.row_of(Channel::OmegaE).expect("asked for the speed");
        let count = self.model.parameter_count();
        let seeded = seed::<N>(p, columns, free);
        let lifted: Vec<Dual<N>> = if columns.iter().any(|c| self.is_electrical(free[*c])) {
            mechanical::torque(self.model, self.signals, &seeded[..count])
        } else {
            torque.iter().map(|x| Dual::constant(*x)).collect()
        };
        let restart = FromStarts::<N> { starts, slot: N - 1 };
        let load = (self.nuisance, &seeded[count..]);
        let own = &seeded[..count];
        mechanical::run(self.model, self.signals, own, &lifted, load, self.windows, restart, |_, k, now| {
            (shown[k], slope[k]) = (now.re, now.eps[N - 1]);
            for (at, column) in columns.iter().enumerate() {
                jacobian[(row + k, *column)] = now.eps[at] * weight;
            }
        });
    }

    /// Motor torque per sample.
    fn torque_at(&self, p: &[f64]) -> Cow<'a, [f64]> {
        match self.torque {
            Some(torque) => Cow::Borrowed(torque),
            None => {
                Cow::Owned(mechanical::torque(self.model, self.signals, &p[..self.model.parameter_count()]))
            }
        }
    }

    /// Speed and its derivative with respect to the initial speed of its window.
    fn speed_pass(&self, p: &[f64], torque: &[f64], starts: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let n = self.samples();
        let count = self.model.parameter_count();
        let (mut shown, mut slope) = (vec![0.0; n], vec![0.0; n]);
        let lifted: Vec<Dual<1>> = p.iter().map(|x| Dual::constant(*x)).collect();
        let torque: Vec<Dual<1>> = torque.iter().map(|x| Dual::constant(*x)).collect();
        let restart = FromStarts::<1> { starts, slot: 0 };
        let load = (self.nuisance, &lifted[count..]);
        mechanical::run(
            self.model,
            self.signals,
            &lifted[..count],
            &torque,
            load,
            self.windows,
            restart,
            |_, k, x| {
                (shown[k], slope[k]) = (x.re, x.eps[0]);
            },
        );
        (shown, slope)
    }

    /// Initial speed of each window: the given one, or that of least squares.
    fn starts(&self, p: &[f64], torque: &[f64]) -> Cow<'_, [f64]> {
        if let Some(starts) = &self.starts {
            return Cow::Borrowed(starts);
        }
        let omega = &self.signals.omega_e;
        let mut starts: Vec<f64> = self.windows.iter().map(|w| omega[w.start]).collect();
        let (shown, slope) = self.speed_pass(p, torque, &starts);
        for (start, window) in starts.iter_mut().zip(self.windows) {
            let (mut product, mut square) = (0.0, 0.0);
            for k in window.clone() {
                product += slope[k] * (omega[k] - shown[k]);
                square += slope[k] * slope[k];
            }
            if square > 0.0 && product.is_finite() {
                *start += product / square;
            }
        }
        Cow::Owned(starts)
    }

    /// Writes the speed's residual and takes the initial speed of each window out of it and of the derivatives.
    fn project(&self, shown: &[f64], slope: &[f64], residual: &mut [f64], jacobian: &mut DMatrix<f64>) {
        let (row, weight) = self.row_of(Channel::OmegaE).expect("asked for the speed");
        let omega = &self.signals.omega_e;
        for window in self.windows {
            for k in window.clone() {
                residual[row + k] = (shown[k] - omega[k]) * weight;
            }
            let rows = row + window.start..row + window.end;
            let mut slope = slope[window.clone()].to_vec();
            whiten(self.colour, &mut slope);
            let free = |x: &mut [f64]| {
                whiten(self.colour, x);
                remove(&slope, x);
            };
            free(&mut residual[rows.clone()]);
            for column in 0..jacobian.ncols() {
                free(&mut jacobian.column_mut(column).as_mut_slice()[rows.clone()]);
            }
        }
    }

    fn mask(&self, residual: &mut DVector<f64>, jacobian: Option<&mut DMatrix<f64>>) {
        let Some(held_out) = self.held_out else { return };
        let n = self.samples();
        let rows: Vec<usize> = (0..residual.len()).filter(|row| held_out[row % n]).collect();
        for row in &rows {
            residual[*row] = 0.0;
        }
        if let Some(jacobian) = jacobian {
            for mut column in jacobian.column_iter_mut() {
                for row in &rows {
                    column[*row] = 0.0;
                }
            }
        }
    }

    /// What the model shows in each channel; the speed runs free from its estimated initial value in each window.
    pub fn predict(&self, p: &[f64]) -> Prediction {
        let n = self.samples();
        let mut residual = DVector::zeros(self.channels.len() * n);
        self.fill_electrical::<f64>(p, |row, value| residual[row] = value);
        let mut out: Prediction = (0..self.channels.len())
            .map(|c| {
                let (channel, sigma) = self.channels[c];
                let measured = self.measured(channel);
                (0..n).map(|k| residual[c * n + k] * sigma + measured[k]).collect()
            })
            .collect();
        if let Some(c) = self.channels.iter().position(|(c, _)| *c == Channel::OmegaE) {
            let torque = self.torque_at(p);
            let starts = self.starts(p, &torque);
            out[c] = self.speed_pass(p, &torque, &starts).0;
        }
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

    /// Root mean square of the weighted residual in each channel, over the samples that count.
    pub fn relative_rms(&self, residual: &DVector<f64>) -> Vec<f64> {
        let n = self.samples();
        let counted = self.held_out.map_or(n, |h| h.iter().filter(|x| !**x).count()).max(1);
        (0..self.channels.len())
            .map(|c| (residual.rows(c * n, n).norm_squared() / counted as f64).sqrt())
            .collect()
    }

    /// Physical bounds of parameter `index`, load levels included.
    pub fn bounds(&self, index: usize) -> (f64, f64) {
        if index < self.model.parameter_count() {
            self.model.bounds(index)
        } else if index < self.model.parameter_count() + self.nuisance.levels {
            let reach = 10.0 * self.model.context().tau_max;
            (-reach, reach)
        } else if index < self.model.parameter_count() + self.nuisance.levels + self.nuisance.steps() {
            (0.0, self.signals.context.duration)
        } else {
            (f64::NEG_INFINITY, f64::INFINITY)
        }
    }

    /// Fits the parameters `free`, starting from `start` (whole vector).
    ///
    /// # Errors
    /// Those of [`least_squares::minimise`].
    pub fn fit(
        &self,
        start: &[f64],
        free: &[usize],
        settings: &Settings,
        monitor: &dyn Monitor,
    ) -> Result<Fitted> {
        let bounds: Vec<(f64, f64)> = free.iter().map(|k| self.bounds(*k)).collect();
        let mut start = start.to_vec();
        let mut round = 0;
        loop {
            let seen = self.from_estimated_starts(&start);
            let problem = Fitting { experiment: &seen, start: &start, free };
            let at: Vec<f64> = free.iter().map(|k| start[*k]).collect();
            let fit = least_squares::minimise(&problem, &at, &bounds, settings, monitor)?;
            let parameters = problem.whole(&fit.parameters);
            round += 1;
            // Initial speeds that were estimated at the start may be too far off for the solution.
            let stale = seen.starts.is_some() && round < STARTS && !monitor.cancelled() && {
                let again = self.from_estimated_starts(&parameters);
                let cost = Fitting { experiment: &again, start: &parameters, free }.cost(&fit.parameters);
                (cost - fit.cost).abs() > STALE * fit.cost
            };
            if !stale {
                return Ok(Fitted { parameters, free: free.to_vec(), fit });
            }
            start = parameters;
        }
    }

    /// The same with the initial speeds of the windows estimated once and for all at `p`.
    fn from_estimated_starts(&self, p: &[f64]) -> Self {
        Self { starts: self.estimated_starts(p).map(Cow::Owned), ..self.clone() }
    }

    /// Least-squares initial electrical speed (rad/s) of each window at `p`, if the speed is compared.
    pub fn estimated_starts(&self, p: &[f64]) -> Option<Vec<f64>> {
        self.has_mechanical().then(|| self.starts(p, &self.torque_at(p)).into_owned())
    }
}

/// A fitted parameter vector.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The whole parameter vector.
    pub parameters: Vec<f64>,
    /// Which of its entries were fitted.
    pub free: Vec<usize>,
    /// How the fit ended.
    pub fit: Fit,
}

struct Fitting<'a> {
    experiment: &'a Experiment<'a>,
    start: &'a [f64],
    free: &'a [usize],
}

impl Fitting<'_> {
    /// Prior knowledge of the free parameters: position among them, value, standard deviation.
    fn known(&self) -> impl Iterator<Item = (usize, f64, f64)> + '_ {
        self.experiment.prior.iter().filter_map(|(parameter, value, sd)| {
            self.free.iter().position(|f| f == parameter).map(|k| (k, *value, *sd))
        })
    }

    fn whole(&self, point: &[f64]) -> Vec<f64> {
        let mut p = self.start.to_vec();
        for (index, value) in self.free.iter().zip(point) {
            p[*index] = *value;
        }
        p
    }
}

impl Problem for Fitting<'_> {
    fn dim(&self) -> usize {
        self.free.len()
    }

    fn cost(&self, point: &[f64]) -> f64 {
        let whole = self.whole(point);
        let known: f64 =
            self.known().map(|(k, value, sd)| ((whole[self.free[k]] - value) / sd).powi(2)).sum();
        self.experiment.residual(&whole).norm_squared() + known
    }

    fn normal(&self, point: &[f64]) -> Normal {
        let whole = self.whole(point);
        let linear = self.experiment.linearise(&whole, self.free);
        let mut normal = Normal {
            cost: linear.residual.norm_squared(),
            jtj: linear.jacobian.tr_mul(&linear.jacobian),
            jtr: linear.jacobian.tr_mul(&linear.residual),
        };
        for (k, value, sd) in self.known() {
            let off = (whole[self.free[k]] - value) / sd;
            normal.cost += off * off;
            normal.jtj[(k, k)] += 1.0 / (sd * sd);
            normal.jtr[k] += off / sd;
        }
        normal
    }
}

/// Restarts from given electrical speeds; slot `slot` of the derivative belongs to the window's own initial speed.
struct FromStarts<'a, const N: usize> {
    starts: &'a [f64],
    slot: usize,
}

impl<const N: usize> Restart<Dual<N>> for FromStarts<'_, N> {
    fn speed(&mut self, number: usize, _: usize) -> Dual<N> {
        Dual::variable(self.starts[number], self.slot)
    }
    fn forget(&self, state: &mut Dual<N>) {
        state.eps[self.slot] = 0.0;
    }
}

/// Groups of at most `size` columns; one empty group if there are none, so that the value is still computed.
fn chunks(columns: &[usize], size: usize) -> Vec<&[usize]> {
    if columns.is_empty() { vec![columns] } else { columns.chunks(size).collect() }
}

/// The parameter vector with derivative slots for the given columns of `free`.
fn seed<const N: usize>(p: &[f64], columns: &[usize], free: &[usize]) -> Vec<Dual<N>> {
    let mut seeded: Vec<Dual<N>> = p.iter().map(|x| Dual::constant(*x)).collect();
    for (slot, column) in columns.iter().enumerate() {
        seeded[free[*column]] = Dual::variable(p[free[*column]], slot);
    }
    seeded
}

/// Replaces x_k by x_k − φ·x_{k−1}, the first by √(1−φ²)·x_0, so that an AR(1) series becomes white.
fn whiten(colour: f64, x: &mut [f64]) {
    if colour == 0.0 {
        return;
    }
    for k in (1..x.len()).rev() {
        x[k] -= colour * x[k - 1];
    }
    if let Some(first) = x.first_mut() {
        *first *= (1.0 - colour * colour).max(0.0).sqrt();
    }
}

/// Takes the component along `direction` out of `x`.
fn remove(direction: &[f64], x: &mut [f64]) {
    let square: f64 = direction.iter().map(|s| s * s).sum();
    if square > 0.0 {
        let share = direction.iter().zip(x.iter()).map(|(s, x)| s * x).sum::<f64>() / square;
        for (x, s) in x.iter_mut().zip(direction) {
            *x -= share * s;
        }
    }
}
