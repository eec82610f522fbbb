//! The speed's residual and its derivatives. The initial speed of each window is estimated and projected out.

use super::{Channel, Experiment, LANES, seed};
use crate::dual::Dual;
use crate::real::Real;
use crate::simulate::mechanical::{self, Restart, Windows};
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
                0..=1 => self.mechanical_pass::<2>(at, torque, &starts, speed.to_mut(), jacobian),
                2..=3 => self.mechanical_pass::<4>(at, torque, &starts, speed.to_mut(), jacobian),
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
        let varied: Vec<usize> = columns.iter().map(|c| free[*c]).collect();
        let mut sink = |k: usize, now: f64, slopes: &[f64; N]| {
            (shown[k], slope[k]) = (now, slopes[N - 1]);
            for (slope, column) in slopes.iter().zip(columns) {
                jacobian[(row + k, *column)] = slope * weight;
            }
        };
        if !self.side_by_side(p, &varied, &torque, starts, &mut sink) {
            self.one_by_one(p, &varied, torque, starts, sink);
        }
    }

    /// Hands to `sink` what [`Windows::run`] does, which runs the windows beside one another, where that applies.
    fn side_by_side<'t, const N: usize>(
        &self,
        p: &[f64],
        varied: &[usize],
        torque: impl Fn() -> &'t [f64],
        starts: &[f64],
        sink: impl FnMut(usize, f64, &[f64; N]),
    ) -> bool {
        let (own, nuisance) = p.split_at(self.model.parameter_count());
        if varied.iter().any(|k| self.is_electrical(*k) || *k >= own.len()) {
            return false;
        }
        let windows = Windows {
            model: self.model,
            signals: self.signals,
            p: own,
            tau_e: torque(),
            load: (self.nuisance, nuisance),
            windows: self.windows,
            starts,
            varied,
        };
        windows.run(sink)
    }

    /// The same with one window after the other, with respect to any parameters.
    fn one_by_one<'t, const N: usize>(
        &self,
        p: &[f64],
        varied: &[usize],
        torque: impl Fn() -> &'t [f64],
        starts: &[f64],
        mut sink: impl FnMut(usize, f64, &[f64; N]),
    ) {
        let every: Vec<usize> = (0..varied.len()).collect();
        let seeded = seed::<N>(p, &every, varied);
        let (own, nuisance) = seeded.split_at(self.model.parameter_count());
        let lifted = self.lifted(own, varied.iter().any(|k| self.is_electrical(*k)), torque);
        let restart = FromStarts::<N> { starts, slot: N - 1 };
        let load = (self.nuisance, nuisance);
        mechanical::run(self.model, self.signals, own, &lifted, load, self.windows, restart, |_, k, now| {
            sink(k, now.re, &now.eps);
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
        let mut speed = (vec![0.0; n], vec![0.0; n]);
        self.mechanical_pass::<1>((p, &[], &[]), || torque, starts, &mut speed, &mut DMatrix::zeros(0, 0));
        speed
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

#[cfg(test)]
mod tests {
    use crate::effects::EffectId;
    use crate::experiment::testing::{of_speed, reversing};
    use crate::lanes::Path;
    use crate::model::Model;
    use crate::simulate::mechanical::Nuisance;
    use std::ops::Range;

    #[test]
    fn windows_beside_one_another_have_the_bits_of_one_after_the_other() {
        let effects = [
            EffectId::AsymmetricFriction,
            EffectId::StribeckFriction,
            EffectId::CoggingTorque,
            EffectId::TimeVaryingLoad,
            EffectId::EncoderEccentricity,
        ];
        // In steps of two samples and of one, in even windows and around a gap, in half a vector, in a whole one and in more.
        for (h, gap, length) in
            [(1e-4, 0.0..0.0, 2000), (4e-4, 0.0..0.0, 250), (1e-4, 0.31..0.32, 1000), (4e-4, 0.31..0.4, 130)]
        {
            let signals = reversing(h, &gap);
            let cut = |s: &Range<usize>| {
                let end = s.end;
                s.clone().step_by(length).map(move |k| k..(k + length).min(end)).collect::<Vec<_>>()
            };
            let windows: Vec<Range<usize>> = signals.segments.iter().flat_map(cut).collect();
            for effects in [&effects[..], &effects[..4], &[]] {
                let model = Model::new(signals.context, effects);
                let mut p = vec![0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3];
                for effect in effects {
                    p.extend(effect.info().parameters.iter().map(|x| (x.typical)(&signals.context)));
                }
                p.extend([0.3, -0.2, 0.41]);
                let experiment = of_speed(&model, &signals, Nuisance::unknown(1, 0), &windows);
                let (torque, starts) = (experiment.torque_at(&p), experiment.starts.clone().unwrap());
                let n = signals.len();
                let empty = || (vec![0.0; n], vec![[0.0; 4]; n]);
                // Inertia, and a torque of the first friction.
                let varied = &[4, 7][..if effects.is_empty() { 1 } else { 2 }];
                let (mut one, mut beside) = (empty(), empty());
                experiment.one_by_one(
                    &p,
                    varied,
                    || &torque,
                    &starts,
                    |k, now, slopes: &[f64; 4]| {
                        (one.0[k], one.1[k]) = (now, *slopes);
                    },
                );
                assert!(one.0.iter().any(|w| *w != 0.0) && one.1.iter().flatten().all(|x| x.is_finite()));
                let ran = experiment.side_by_side(
                    &p,
                    varied,
                    || &torque,
                    &starts,
                    |k, now, slopes: &[f64; 4]| {
                        (beside.0[k], beside.1[k]) = (now, *slopes);
                    },
                );
                assert_eq!(ran, Path::best() >= Path::Avx2);
                if ran {
                    assert!(beside == one, "{h} {length} {effects:?}");
                }
                let alone = one.1.iter().map(|slopes| slopes[3]).collect();
                assert_eq!(experiment.speed_pass(&p, &torque, &starts), (one.0, alone));
            }
        }
    }
}
