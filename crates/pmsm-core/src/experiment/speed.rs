//! The speed's residual and its derivatives. The initial speed of each window is estimated and projected out.

use super::{Channel, Experiment, LANES, chunks, seed};
use crate::dual::Dual;
use crate::machine::BaseParameter;
use crate::real::Real;
use crate::simulate::mechanical::{self, Restart};
use nalgebra::{DMatrix, DVector};
use std::borrow::Cow;
use std::cell::OnceCell;

impl<'a> Experiment<'a> {
    pub(super) fn linearise_mechanical(
        &self,
        p: &[f64],
        free: &[usize],
        residual: &mut DVector<f64>,
        jacobian: &mut DMatrix<f64>,
    ) {
        // A pass whose columns change the torque has its own.
        let known = OnceCell::new();
        let torque = || &**known.get_or_init(|| self.torque_at(p));
        let starts = match &self.starts {
            Some(starts) => Cow::Borrowed(&**starts),
            None => self.starts(p, torque()),
        };
        let n = self.samples();
        let mut speed = (vec![0.0; n], vec![0.0; n]);
        // Without states of its own the rotor answers to the load as to a change of its speed.
        let count = self.model.parameter_count();
        let profile = count..count + self.nuisance.levels + self.nuisance.steps();
        let (load, other): (Vec<usize>, Vec<usize>) =
            (0..free.len()).partition(|c| self.model.mechanical_states() == 0 && profile.contains(&free[*c]));
        for columns in chunks(&other, LANES - 1) {
            let at = (p, free, columns);
            match columns.len() {
                0..=3 => self.mechanical_pass::<4>(at, torque, &starts, &mut speed, jacobian),
                _ => self.mechanical_pass::<LANES>(at, torque, &starts, &mut speed, jacobian),
            }
        }
        self.load_columns(p, free, &load, &speed.1, jacobian);
        self.project(&speed.0, &speed.1, residual.as_mut_slice(), jacobian);
    }

    /// Speed, its derivative with respect to the initial speeds, and those for some `columns` of the parameters `free`.
    fn mechanical_pass<'t, const N: usize>(
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
        let lifted: Vec<Dual<N>> = if columns.iter().any(|c| self.is_electrical(free[*c])) {
            mechanical::torque(self.model, self.signals, &seeded[..count])
        } else {
            torque().iter().map(|x| Dual::constant(*x)).collect()
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

    /// Derivatives of the speed with respect to the levels and instants of the load, from its derivative `slope` with respect
    /// to the initial speed of the window: what a torque adds over one sample fades as an initial speed does.
    fn load_columns(
        &self,
        p: &[f64],
        free: &[usize],
        columns: &[usize],
        slope: &[f64],
        jacobian: &mut DMatrix<f64>,
    ) {
        if columns.is_empty() {
            return;
        }
        let (row, weight) = self.row_of(Channel::OmegaE).expect("asked for the speed");
        let (levels, rest) = p[self.model.parameter_count()..].split_at(self.nuisance.levels);
        let steps = &rest[..self.nuisance.steps()];
        let per_torque = -self.signals.n_p / p[BaseParameter::J.index()];
        let place =
            |index: usize| columns.iter().copied().find(|c| free[*c] == self.model.parameter_count() + index);
        let of_level: Vec<Option<usize>> = (0..levels.len()).map(place).collect();
        let of_step: Vec<Option<usize>> = (0..steps.len()).map(|s| place(levels.len() + s)).collect();
        let t = &self.signals.t;
        let mut level = 0;
        let mut response = vec![0.0; jacobian.ncols()];
        for window in self.windows {
            response.fill(0.0);
            for k in window.clone() {
                for column in columns {
                    jacobian[(row + k, *column)] = response[*column] * weight;
                }
                if k + 1 >= window.end {
                    break;
                }
                let kept = if slope[k] == 0.0 { 0.0 } else { slope[k + 1] / slope[k] };
                for column in columns {
                    response[*column] *= kept;
                }
                let h = t[k + 1] - t[k];
                while level < steps.len() && steps[level] < t[k] {
                    level += 1;
                }
                let gain = per_torque * kept.max(0.0).sqrt();
                let behind = steps.get(level).map_or(0.0, |step| (t[k + 1] - step).clamp(0.0, h));
                if let Some(column) = of_level[level] {
                    response[column] += gain * (h - behind);
                }
                if behind > 0.0 {
                    if let Some(column) = of_level[level + 1] {
                        response[column] += gain * behind;
                    }
                    if let Some(column) = of_step[level] {
                        response[column] -= gain * (levels[level + 1] - levels[level]);
                    }
                }
            }
        }
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
