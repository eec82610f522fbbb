//! The equation of motion in integral form along the measured speed: ω(t) = ω(0) + ∫ a(ω_measured) dt within each window.
//!
//! In free run a missing torque moves the simulated speed away from the measured one, and a linearisation there says little about a map.
//! Along the measured speed the prediction is linear in load, friction and the coefficients of a map, however large the missing torque.

use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::effect::{Role, Site};
use crate::experiment::Channel;
use crate::machine::BaseParameter;
use crate::map::{Part, Point};
use crate::recording::Kind;
use crate::signals::Signals;
use crate::simulate::environment::{measured_env, true_env};
use crate::simulate::mechanical::{Rotor, Torque};
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Step of the difference quotients, share of the parameter and at least, in its unit. The prediction is linear or smooth in all of them.
const STEP: (f64, f64) = (1e-4, 1e-7);

/// The parameters of the winding that make the torque of given currents: of l_d − l_q one of the two suffices.
pub(super) const TORQUE_CONSTANTS: [BaseParameter; 2] = [BaseParameter::LQ, BaseParameter::PsiM];

/// The motion of recordings whose rotor has no states of its own.
pub(super) struct Integral<'a> {
    data: &'a Data,
    best: &'a Hypothesis,
    torque: &'a [f64],
}

impl<'a> Integral<'a> {
    /// Whether the recordings and the model have this form: each shows the speed as it runs, and nothing but it moves.
    pub(super) fn applies(data: &Data, best: &Hypothesis) -> bool {
        let runs =
            |run: &Data| run.has_mechanical() && matches!(run.signals.kind, Kind::Full | Kind::Mechanical);
        best.model.mechanical_states() == 0 && data.runs().iter().all(runs)
    }

    /// Where they have it.
    pub(super) fn new(data: &'a Data, best: &'a Hypothesis, torque: &'a [f64]) -> Option<Self> {
        Self::applies(data, best).then_some(Self { data, best, torque })
    }

    /// What the model leaves, in units of the noise.
    pub(super) fn residual(&self) -> DVector<f64> {
        let predicted = self.predicted(&self.best.parameters, self.torque);
        let measured = self.data.runs().iter().flat_map(|run| self.speed(&run.signals));
        self.weighted(predicted.into_iter().zip(measured).map(|(p, m)| p - m).collect())
    }

    /// The true electrical speed behind the measured one, rad/s.
    fn speed(&self, signals: &Signals) -> Vec<f64> {
        let model = &self.best.model;
        let behind = |k: usize| {
            let measured = measured_env(signals, k);
            true_env(&model.sensor(self.best.own(), &measured), &measured, signals.n_p).omega_e
        };
        if model.has_sensor() { (0..signals.len()).map(behind).collect() } else { signals.omega_e.clone() }
    }

    /// Its derivatives by the parameters `free`.
    pub(super) fn jacobian(&self, free: &[usize]) -> DMatrix<f64> {
        let columns: Vec<DVector<f64>> = free.iter().map(|k| self.derivative(*k)).collect();
        if columns.is_empty() {
            return DMatrix::zeros(self.data.signals.len(), 0);
        }
        DMatrix::from_columns(&columns)
    }

    /// Its derivatives by the coefficients of a part.
    pub(super) fn columns(&self, part: &Part) -> DMatrix<f64> {
        let (n, count) = (self.data.signals.len(), part.count());
        let mut columns = DMatrix::zeros(n, count);
        let mut values = vec![0.0; count];
        let j = self.best.own()[BaseParameter::J.index()];
        for (run, own) in self.data.runs().iter().enumerate() {
            let (signals, samples) = (&own.signals, self.data.samples_of(run));
            for k in 0..signals.len() {
                let pair = |x: &Option<[Vec<f64>; 2]>| x.as_ref().map_or([0.0; 2], |[d, q]| [d[k], q[k]]);
                let (i, v, tau_e) = (pair(&signals.i), pair(&signals.v), self.torque[samples.start + k]);
                part.functions(&Point { env: measured_env(signals, k), i, v, tau_e }, &mut values);
                let row = samples.start + k;
                values.iter().enumerate().for_each(|(c, f)| columns[(row, c)] = -f * signals.n_p / j);
            }
        }
        for mut column in columns.column_iter_mut() {
            let rates = column.as_slice().to_vec();
            column.copy_from(&self.weighted(self.integrated(&rates)));
        }
        columns
    }

    /// Derivative by one parameter. That by the inertia keeps the accelerations by load and friction, whose torques grow with it. An effect
    /// that is taken out of the set then stays out, whatever the inertia becomes.
    fn derivative(&self, index: usize) -> DVector<f64> {
        let value = self.best.parameters[index];
        let step = (STEP.0 * value.abs()).max(STEP.1);
        let makes_torque = TORQUE_CONSTANTS.iter().any(|p| p.index() == index);
        let follow = if index == BaseParameter::J.index() { self.strengths() } else { Vec::new() };
        let at = |x: f64| {
            let mut parameters = self.best.parameters.clone();
            follow.iter().for_each(|k| parameters[*k] *= x / value);
            parameters[index] = x;
            if makes_torque {
                let own = &parameters[..self.best.model.parameter_count()];
                self.predicted(&parameters, &self.data.torque(&self.best.model, own))
            } else {
                self.predicted(&parameters, self.torque)
            }
        };
        let (up, down) = (at(value + step), at(value - step));
        self.weighted(up.into_iter().zip(down).map(|(u, d)| (u - d) / (2.0 * step)).collect())
    }

    /// Parameters in proportion to which a torque acts on the rotor: friction, strengths of effects and levels of unknown loads.
    fn strengths(&self) -> Vec<usize> {
        let (model, nuisances) = (&self.best.model, &self.best.nuisances);
        let mut found = vec![BaseParameter::B.index()];
        for slot in model.slots().iter().filter(|slot| slot.effect.info().site == Site::Mechanical) {
            let each = slot.effect.info().parameters.iter().zip(slot.parameters.clone());
            found.extend(each.filter(|(p, _)| p.role == Role::Amplitude).map(|(_, k)| k));
        }
        let mut at = model.parameter_count();
        for nuisance in nuisances {
            found.extend(at..at + nuisance.levels);
            at += nuisance.parameter_count();
        }
        found
    }

    /// Electrical speed by which each window has gone on from its beginning, rad/s.
    fn predicted(&self, parameters: &[f64], torque: &[f64]) -> Vec<f64> {
        let data = self.data;
        let experiment = data.motion(&self.best.model, &self.best.nuisances, torque);
        let mut rates = vec![0.0; data.signals.len()];
        for (run, part) in data.runs().iter().enumerate() {
            let own = experiment.of_run(parameters, run);
            let (machine, load) = own.split_at(self.best.model.parameter_count());
            let samples = data.samples_of(run);
            let rotor = Rotor {
                model: &self.best.model,
                signals: &part.signals,
                p: machine,
                tau_e: Torque::Fixed(&torque[samples.clone()]),
                load: (self.best.nuisances[run], load),
                windows: &part.windows,
                shown: &part.signals.omega_e,
            };
            let into = &mut rates[samples];
            rotor.accelerations(|window, here, _| into[window.clone()].copy_from_slice(here));
        }
        self.integrated(&rates)
    }

    /// Integral of rates per sample over each window, by the trapezoidal rule.
    fn integrated(&self, rates: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; rates.len()];
        self.each_window(|first, t, window| {
            for k in window.start + 1..window.end {
                let (at, h) = (first + k, t[k] - t[k - 1]);
                out[at] = out[at - 1] + 0.5 * h * (rates[at] + rates[at - 1]);
            }
        });
        out
    }

    /// In units of the noise, less each window's mean: its initial speed is open. What is held out, or lies in no window, is zero.
    fn weighted(&self, x: Vec<f64>) -> DVector<f64> {
        let mut out = DVector::zeros(x.len());
        let floors = self.data.runs().iter().map(|run| {
            let speed = run.floors.iter().find(|f| f.channel == Channel::OmegaE);
            speed.map_or(f64::INFINITY, |f| f.total())
        });
        let floors: Vec<f64> = floors.collect();
        let held_out = self.data.held_out.as_deref();
        let mut window_of = |run: usize, rows: Range<usize>| {
            let mean = x[rows.clone()].iter().sum::<f64>() / rows.len().max(1) as f64;
            for k in rows.filter(|k| !held_out.is_some_and(|h| h[*k])) {
                out[k] = (x[k] - mean) / floors[run];
            }
        };
        for (run, part) in self.data.runs().iter().enumerate() {
            let first = self.data.samples_of(run).start;
            part.windows.iter().for_each(|w| window_of(run, first + w.start..first + w.end));
        }
        out
    }

    fn each_window(&self, mut visit: impl FnMut(usize, &[f64], &Range<usize>)) {
        for (run, part) in self.data.runs().iter().enumerate() {
            let first = self.data.samples_of(run).start;
            part.windows.iter().for_each(|window| visit(first, &part.signals.t, window));
        }
    }
}
