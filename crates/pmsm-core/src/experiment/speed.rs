//! The speed's residual and its derivatives. The initial speed of each window is estimated and projected out.

use super::{Channel, Experiment, LANES, seed};
use crate::dual::Dual;
use crate::real::Real;
use crate::simulate::mechanical::{self, Restart};
use nalgebra::{DMatrix, DVector};
use std::borrow::Cow;
use std::cell::OnceCell;

/// What the rotor does at one point of the parameters.
#[derive(Debug, Clone)]
pub struct Course {
    /// Motor torque per sample, N·m.
    torque: Vec<f64>,
    /// Initial electrical speed of each window, rad/s.
    starts: Vec<f64>,
    /// Electrical speed per sample (rad/s), and its derivative with respect to the initial speed of its window.
    speed: (Vec<f64>, Vec<f64>),
}

impl<'a> Experiment<'a> {
    /// What the rotor does at `p`, if the speed is compared.
    pub fn course(&self, p: &[f64]) -> Option<Course> {
        self.has_mechanical().then(|| {
            let torque = self.torque_at(p).into_owned();
            let starts = self.starts(p, &torque).into_owned();
            let speed = self.speed_pass(p, &torque, &starts);
            Course { torque, starts, speed }
        })
    }

    /// The speed's rows at `p`, where the rotor's course may be `known`.
    pub(super) fn linearise_mechanical(
        &self,
        p: &[f64],
        free: &[usize],
        known: Option<&Course>,
        residual: &mut DVector<f64>,
        jacobian: &mut DMatrix<f64>,
    ) {
        // A pass whose columns change the torque has its own.
        let own = OnceCell::new();
        let torque = || known.map_or_else(|| &**own.get_or_init(|| self.torque_at(p)), |known| &known.torque);
        let starts = match (known, &self.starts) {
            (Some(known), _) => Cow::Borrowed(&*known.starts),
            (None, Some(starts)) => Cow::Borrowed(&**starts),
            (None, None) => self.starts(p, torque()),
        };
        let n = self.samples();
        let none = || Cow::Owned((vec![0.0; n], vec![0.0; n]));
        let mut speed = known.map_or_else(none, |known| Cow::Borrowed(&known.speed));
        let (answering, other): (Vec<usize>, Vec<usize>) =
            (0..free.len()).partition(|c| self.answers_as_speed(free[*c]));
        let (load, other): (Vec<usize>, Vec<usize>) =
            other.into_iter().partition(|c| self.passes_on(free[*c]));
        for columns in other.chunks(LANES - 1) {
            let at = (p, free, columns);
            match columns.len() {
                0..=3 => self.mechanical_pass::<4>(at, torque, &starts, speed.to_mut(), jacobian),
                _ => self.mechanical_pass::<LANES>(at, torque, &starts, speed.to_mut(), jacobian),
            }
        }
        if other.is_empty() && known.is_none() {
            speed = Cow::Owned(self.speed_pass(p, torque(), &starts));
        }
        self.respond(p, free, &answering, torque, &speed, jacobian);
        if !load.is_empty() {
            self.load_passed_on(p, free, &load, torque(), &starts, jacobian);
        }
        self.project(&speed.0, &speed.1, residual.as_mut_slice(), jacobian);
    }

    /// Speed, its derivative with respect to the initial speeds, and those for some `columns` of the parameters `free`.
    pub(super) fn mechanical_pass<'t, const N: usize>(
        &self,
        (p, free, columns): (&[f64], &[usize], &[usize]),
        torque: impl Fn() -> &'t [f64],
        starts: &[f64],
        (shown, slope): &mut (Vec<f64>, Vec<f64>),
        jacobian: &mut DMatrix<f64>,
    ) {
        let (row, weight) = self.row_of(Channel::OmegaE).expect("asked for the speed");
        let count = self.model.parameter_count();
        let seeded = seed::<N>(p, columns, free);
        let lifted =
            self.lifted(&seeded[..count], columns.iter().any(|c| self.is_electrical(free[*c])), torque);
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

    /// Motor torque per sample with its derivatives, if it `changes` with what they belong to.
    pub(super) fn lifted<'t, const N: usize>(
        &self,
        seeded: &[Dual<N>],
        changes: bool,
        torque: impl Fn() -> &'t [f64],
    ) -> Vec<Dual<N>> {
        if changes {
            return mechanical::torque(self.model, self.signals, seeded);
        }
        torque().iter().map(|x| Dual::constant(*x)).collect()
    }

    /// Motor torque per sample.
    pub(super) fn torque_at(&self, p: &[f64]) -> Cow<'a, [f64]> {
        match self.torque {
            Some(torque) => Cow::Borrowed(torque),
            None => {
                Cow::Owned(mechanical::torque(self.model, self.signals, &p[..self.model.parameter_count()]))
            }
        }
    }

    /// Speed and its derivative with respect to the initial speed of its window.
    pub(super) fn speed_pass(&self, p: &[f64], torque: &[f64], starts: &[f64]) -> (Vec<f64>, Vec<f64>) {
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
    pub(super) fn starts(&self, p: &[f64], torque: &[f64]) -> Cow<'_, [f64]> {
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
    pub(super) fn project(
        &self,
        shown: &[f64],
        slope: &[f64],
        residual: &mut [f64],
        jacobian: &mut DMatrix<f64>,
    ) {
        let (row, weight) = self.row_of(Channel::OmegaE).expect("asked for the speed");
        let omega = &self.signals.omega_e;
        for window in self.windows {
            for k in window.clone() {
                residual[row + k] = (shown[k] - omega[k]) * weight;
            }
            let rows = row + window.start..row + window.end;
            let mut slope = slope[window.clone()].to_vec();
            let whiten = |x: &mut [f64]| {
                if let Some((wander, floor)) = &self.wander {
                    wander.whiten(*floor, x);
                }
                if let Some(colour) = &self.colour {
                    colour.whiten(x);
                }
            };
            whiten(&mut slope);
            let free = |x: &mut [f64]| {
                whiten(x);
                remove(&slope, x);
            };
            free(&mut residual[rows.clone()]);
            for column in 0..jacobian.ncols() {
                free(&mut jacobian.column_mut(column).as_mut_slice()[rows.clone()]);
            }
        }
    }

    /// Least-squares initial electrical speed (rad/s) of each window at `p`, if the speed is compared.
    pub fn estimated_starts(&self, p: &[f64]) -> Option<Vec<f64>> {
        self.has_mechanical().then(|| self.starts(p, &self.torque_at(p)).into_owned())
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
