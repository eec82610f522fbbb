//! Derivatives at several forms of an effect that has no strength: the model does the same in each of them, and they are run beside
//! one another.

use super::course::Run;
use super::rows::{Rows, of_groups};
use super::{Channel, Course, Experiment, LANES, Linearisation, seed};
use crate::numerics::dual::Dual;
use crate::numerics::real::Real;
use crate::simulate::electrical;
use crate::simulate::mechanical::{By, Forms};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

impl Experiment<'_> {
    /// Derivatives of the weighted residuals with respect to the parameters `free` at each of the parameter vectors `forms`, one form's
    /// columns behind the other's. What the forms differ in must change nothing but these derivatives; the rotor's `course` may be known.
    /// Of a rotor that begins to have states, and so follows a changing load a little differently in each form, the initial speeds are
    /// projected out along that course.
    ///
    /// # Panics
    /// As [`Self::linearise`], or if there are no forms.
    pub fn linearise_forms(
        &self,
        forms: &[Vec<f64>],
        free: &[usize],
        course: Option<&Course>,
    ) -> DMatrix<f64> {
        if forms.len() < 2 || free.is_empty() {
            return self.linearise_along(&forms[0], free, course).jacobian;
        }
        let own = if course.is_none() { self.course(&forms[0]) } else { None };
        let known = course.or(own.as_ref());
        let columns = forms.len() * free.len();
        let mut linear = Linearisation::zeros(self.channels.len() * self.samples(), columns);
        let (mut electrical, mut speed) = linear.split_rows(self.electrical_rows());
        let currents = || {
            if self.has_electrical() && free.iter().any(|k| self.is_electrical(*k)) {
                self.currents_of_forms(forms, free, &mut electrical);
            }
        };
        let motion = || {
            if let Some(course) = known {
                self.motion_of_forms(forms, free, course, &mut speed);
                self.project(&course.run, speed);
            }
        };
        rayon::join(currents, motion);
        self.mask(&mut linear);
        linear.jacobian
    }

    /// The currents' or voltages' rows.
    fn currents_of_forms(&self, forms: &[Vec<f64>], free: &[usize], rows: &mut Rows<'_>) {
        if free.len() > 1 || !self.currents_beside(forms, free, rows) {
            self.currents_apart(forms, free, rows);
        }
        let reaching: Vec<usize> = (0..rows.columns.len()).collect();
        let every: Vec<usize> = (0..free.len()).collect();
        let rates = || forms.iter().flat_map(|p| self.inductance_rates(p, free, &every)).collect();
        self.whiten_residual(&forms[0], rates, &reaching, rows);
    }

    /// Those of currents with respect to one parameter, if this processor can run the forms beside one another.
    fn currents_beside(&self, forms: &[Vec<f64>], free: &[usize], rows: &mut Rows<'_>) -> bool {
        let (Some((d, wd)), Some((q, wq))) = (self.row_of(Channel::ID), self.row_of(Channel::IQ)) else {
            return false;
        };
        let Some(i) = &self.signals.i else { return false };
        if self.row_of(Channel::VD).is_some() || self.row_of(Channel::VQ).is_some() {
            return false;
        }
        let seeded = self.seeded_forms(forms, free);
        let Rows { residual, columns } = &mut *rows;
        electrical::run_beside(self.model, self.signals, &seeded, |form, k, now: [Dual<1>; 2]| {
            for (row, weight, now, measured) in [(d + k, wd, now[0], i[0][k]), (q + k, wq, now[1], i[1][k])] {
                if form == 0 {
                    residual[row] = (now.re - measured) * weight;
                }
                columns[form][row] = now.eps[0] * weight;
            }
        })
    }

    /// Each form by itself.
    fn currents_apart(&self, forms: &[Vec<f64>], free: &[usize], rows: &mut Rows<'_>) {
        let every: Vec<usize> = (0..free.len()).collect();
        let all: Vec<usize> = (0..rows.columns.len()).collect();
        let groups: Vec<&[usize]> = all.chunks(free.len()).flat_map(|form| form.chunks(LANES)).collect();
        let passes = forms.iter().flat_map(|p| every.chunks(LANES).map(move |columns| (p, columns)));
        let first = std::iter::once(Some(&mut *rows.residual)).chain(std::iter::repeat_with(|| None));
        let jobs: Vec<_> = passes.zip(of_groups(&mut rows.columns, &groups)).zip(first).collect();
        jobs.into_par_iter().for_each(|(((p, columns), rows), residual)| {
            self.electrical_passes((p, free, columns), residual, rows);
        });
    }

    /// The speed's rows before the initial speeds are projected out.
    fn motion_of_forms(&self, forms: &[Vec<f64>], free: &[usize], course: &Course, rows: &mut Rows<'_>) {
        let inert = free.iter().all(|k| !self.is_electrical(*k) && !self.answers_as_speed(*k));
        if inert && self.motion_beside(forms, free, course, rows) {
            return;
        }
        let own: Vec<_> = rows.columns.chunks_mut(free.len()).zip(forms).collect();
        own.into_par_iter().for_each(|(columns, p)| {
            let columns = columns.iter_mut().map(|rows| &mut **rows).collect();
            self.columns_of_speed(p, free, Some(course), &mut Rows { residual: &mut [], columns });
        });
    }

    /// The same with respect to parameters of the rotor and its load, if it has states of its own and this processor can run the forms
    /// beside one another.
    fn motion_beside(
        &self,
        forms: &[Vec<f64>],
        free: &[usize],
        course: &Course,
        rows: &mut Rows<'_>,
    ) -> bool {
        let weight = self.speed_weight();
        let seeded = self.seeded_forms(forms, free);
        let Course { torque, starts, .. } = course;
        let put = |column: usize, k: usize, now: Dual<1>| rows.columns[column][k] = now.eps[0] * weight;
        let Self { model, signals, windows, nuisance: load, .. } = *self;
        let by = By::Parameter;
        Forms { model, signals, forms: &seeded, tau_e: torque, load, windows, starts, by }.run(put)
    }

    /// Weighted residuals of the speed alone at several parameter vectors that differ in nothing that changes the motor's torque. The initial
    /// speeds are the given ones, or else those estimated at the first; what better ones would change is projected out of each.
    ///
    /// # Panics
    /// If there are no vectors.
    pub fn motion_residuals(&self, forms: &[Vec<f64>]) -> Vec<DVector<f64>> {
        if !self.has_mechanical() {
            return vec![DVector::zeros(0); forms.len()];
        }
        let torque = self.torque_at(&forms[0]);
        let starts = self.starts(&forms[0], &torque);
        let fixed = |p: &Vec<f64>| p.iter().map(|x| Dual::constant(*x)).collect();
        let constants: Vec<Vec<Dual<1>>> = forms.iter().map(fixed).collect();
        let mut runs = vec![Run::new(self.samples()); forms.len()];
        let Self { model, signals, windows, nuisance: load, .. } = *self;
        let (by, tau_e) = (By::Start, &*torque);
        let together = Forms { model, signals, forms: &constants, tau_e, load, windows, starts: &starts, by };
        let keep = |form: usize, k: usize, now: Dual<1>| {
            (runs[form].shown[k], runs[form].slope[k]) = (now.re, now.eps[0]);
        };
        if !together.run(keep) {
            runs = forms.iter().map(|p| self.speed_pass(p, &torque, &starts)).collect();
        }
        let residual = |run: &Run| {
            let mut linear = Linearisation::zeros(self.samples(), 0);
            self.project(run, linear.split_rows(0).1);
            self.mask(&mut linear);
            linear.residual
        };
        runs.iter().map(residual).collect()
    }

    /// Each of the forms with the derivative by each of the parameters that are `free` in turn.
    fn seeded_forms(&self, forms: &[Vec<f64>], free: &[usize]) -> Vec<Vec<Dual<1>>> {
        let every: Vec<usize> = (0..free.len()).collect();
        forms.iter().flat_map(|p| every.chunks(1).map(move |column| seed(p, column, free))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::experiment::testing::{of_speed, reversing};
    use crate::model::Model;
    use crate::simulate::mechanical::{self, Nuisance};
    use std::borrow::Cow;

    #[test]
    fn forms_beside_one_another_have_the_bits_of_one_after_the_other() {
        // With and without states of their own, of the windings and of the rotor; more forms than a vector holds, and fewer.
        for (effect, beside, amplitudes, scales) in [
            (
                EffectId::SaturationD,
                EffectId::IronLoss,
                vec![0],
                vec![0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3],
            ),
            (EffectId::SaturationD, EffectId::TwoMassShaft, vec![0], vec![0.7, 1.0]),
            (EffectId::MagnetThermalDrift, EffectId::QuadraticDrag, vec![0, 1], vec![0.5, 1.0, 2.0]),
            (EffectId::InterTurnShort, EffectId::CoulombFriction, vec![0], vec![1.0, 1.5]),
            (EffectId::CoggingTorque, EffectId::DeadTime, vec![0, 1, 2, 3], vec![1.0, 2.0]),
            (EffectId::TwoMassShaft, EffectId::DeadTime, vec![0], vec![0.6, 0.8, 1.0]),
        ] {
            // Also with respect to what the rotor's own states begin with.
            let begun = if effect == EffectId::TwoMassShaft { 2 } else { 0 };
            let signals = reversing(2e-4, &(0.31..0.32));
            let windows = mechanical::windows(&signals);
            let model = Model::new(signals.context, &[beside, effect]);
            let typical = |e: EffectId| e.info().parameters.iter().map(|x| (x.typical)(&signals.context));
            let mut p = vec![0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3];
            p.extend(typical(beside));
            let first = p.len();
            p.extend(typical(effect));
            let last = p.len();
            let initial = model.mechanical_states();
            p.push(0.3);
            p.resize(p.len() + initial * mechanical::beginnings(&signals, &windows), 0.0);
            let form = |scale: &f64| {
                let mut p = p.clone();
                for k in first..last {
                    p[k] = if amplitudes.contains(&(k - first)) { 0.0 } else { p[k] * scale };
                }
                p
            };
            let forms: Vec<Vec<f64>> = scales.iter().map(form).collect();
            let states = last + 1..last + 1 + begun;
            let free: Vec<usize> = amplitudes.iter().map(|k| first + k).chain(states).collect();
            let nuisance = Nuisance::unknown(0, initial * mechanical::beginnings(&signals, &windows));
            let channels = vec![(Channel::ID, 0.05), (Channel::IQ, 0.05), (Channel::OmegaE, 0.1)];
            let experiment = Experiment { channels, ..of_speed(&model, &signals, nuisance, &windows) };
            let course = experiment.course(&forms[0]);
            let together = experiment.linearise_forms(&forms, &free, course.as_ref());
            let one = |p: &Vec<f64>| experiment.linearise_along(p, &free, course.as_ref()).jacobian;
            for (at, alone) in forms.iter().map(one).enumerate() {
                let own = together.columns(at * free.len(), free.len());
                assert!(alone.norm() > 0.0 && alone.iter().all(|x| x.is_finite()), "{effect:?}");
                assert!(own == alone, "{effect:?} {at}: {} of {}", (own - &alone).norm(), alone.norm());
            }
        }
    }
    #[test]
    fn residuals_of_the_speed_beside_one_another_are_those_of_one_after_the_other() {
        let signals = reversing(2e-4, &(0.31..0.32));
        let windows = mechanical::windows(&signals);
        // A rotor that keeps its states from window to window, and one without any.
        for effect in [EffectId::TwoMassShaft, EffectId::CoulombFriction] {
            let model = Model::new(signals.context, &[effect]);
            let mut p = vec![0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3];
            p.extend(effect.info().parameters.iter().map(|x| (x.typical)(&signals.context)));
            let initial = model.mechanical_states() * mechanical::beginnings(&signals, &windows);
            p.resize(p.len() + initial, 0.0);
            let stronger = |times: f64| [&p[..6], &[p[6] * times], &p[7..]].concat();
            let forms: Vec<Vec<f64>> = [0.5, 0.8, 1.0, 1.2, 1.5].map(stronger).to_vec();
            let nuisance = Nuisance::known(initial);
            let channels = vec![(Channel::OmegaE, 0.1)];
            let mut experiment = Experiment { channels, ..of_speed(&model, &signals, nuisance, &windows) };
            experiment.starts = experiment.estimated_starts(&forms[0]).map(Cow::Owned);
            let together = experiment.motion_residuals(&forms);
            let apart: Vec<DVector<f64>> = forms.iter().map(|p| experiment.residual(p)).collect();
            assert!(together == apart && apart[0] != apart[4], "{effect:?}");
        }
    }
}
