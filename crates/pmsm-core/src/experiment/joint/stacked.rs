//! What each recording's own experiment computes, stacked with that of the others.

use super::Joint;
use crate::experiment::{Answering, Channel, Course, Experiment, LAGS, Linearisation, Prediction, TURNED};
use crate::map::Part;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::borrow::Cow;

/// Some columns of one recording at its parameters, by how its currents answer.
type ColumnsOf<'a> = &'a dyn Fn(&Experiment, &[f64], &Answering) -> DMatrix<f64>;

impl Joint<'_> {
    /// Copies rows of recording `run` to where they belong among those of all recordings.
    fn place(&self, run: usize, own: &[f64], all: &mut [f64]) {
        let n = self.runs[run].samples();
        for (at, (channel, _)) in self.runs[run].channels.iter().enumerate() {
            let rows = self.rows(run, *channel).expect("a channel of this recording");
            all[rows].copy_from_slice(&own[at * n..(at + 1) * n]);
        }
    }

    /// The rows of recording `run` alone, out of those of all.
    fn rows_of_run<'r>(&self, run: usize, all: &'r DVector<f64>) -> Cow<'r, DVector<f64>> {
        if self.runs.len() == 1 {
            return Cow::Borrowed(all);
        }
        let n = self.runs[run].samples();
        let mut own = DVector::zeros(self.runs[run].channels.len() * n);
        for (at, (channel, _)) in self.runs[run].channels.iter().enumerate() {
            let rows = self.rows(run, *channel).expect("a channel of this recording");
            own.rows_mut(at * n, n).copy_from(&all.rows(rows.start, n));
        }
        Cow::Owned(own)
    }

    /// Weighted residuals at `p`.
    pub fn residual(&self, p: &[f64]) -> DVector<f64> {
        if let Some(run) = self.only() {
            return run.residual(p);
        }
        let mut all = DVector::zeros(self.channels.len() * self.samples());
        let own = |(r, run): (usize, &Experiment)| run.residual(&self.of_run(p, r));
        let residuals: Vec<DVector<f64>> = self.runs.par_iter().enumerate().map(own).collect();
        for (r, own) in residuals.iter().enumerate() {
            self.place(r, own.as_slice(), all.as_mut_slice());
        }
        all
    }

    /// Weighted residuals of the speed alone at several parameter vectors; see [`Experiment::motion_residuals`].
    ///
    /// # Panics
    /// If another channel is compared, or there are no vectors.
    pub fn motion_residuals(&self, forms: &[Vec<f64>]) -> Vec<DVector<f64>> {
        assert!(self.channels.iter().all(|c| !c.is_electrical()), "the speed alone");
        if let Some(run) = self.only() {
            return run.motion_residuals(forms);
        }
        let mut all = vec![DVector::zeros(self.channels.len() * self.samples()); forms.len()];
        for (r, run) in self.runs.iter().enumerate() {
            let own: Vec<Vec<f64>> = forms.iter().map(|p| self.of_run(p, r).into_owned()).collect();
            for (all, own) in all.iter_mut().zip(run.motion_residuals(&own)) {
                self.place(r, own.as_slice(), all.as_mut_slice());
            }
        }
        all
    }

    /// Weighted residuals at `p` and their derivatives with respect to the parameters `free`.
    pub fn linearise(&self, p: &[f64], free: &[usize]) -> Linearisation {
        self.linearise_along(p, free, &[])
    }

    /// What the rotor does at `p` on each recording that compares the speed.
    pub fn courses(&self, p: &[f64]) -> Vec<Option<Course>> {
        self.runs.par_iter().enumerate().map(|(r, run)| run.course(&self.of_run(p, r))).collect()
    }

    /// The same where the rotor's `courses` at `p` are known, one for each recording, or none; see
    /// [`Experiment::linearise_along`].
    pub fn linearise_along(&self, p: &[f64], free: &[usize], courses: &[Option<Course>]) -> Linearisation {
        let course = |r: usize| courses.get(r).and_then(Option::as_ref);
        if let Some(run) = self.only() {
            return run.linearise_along(p, free, course(0));
        }
        let rows = self.channels.len() * self.samples();
        let (mut residual, mut jacobian) = (DVector::zeros(rows), DMatrix::zeros(rows, free.len()));
        let linearise = |(r, run): (usize, &Experiment)| {
            let (columns, own) = self.own_of(r, free);
            (columns, run.linearise_along(&self.of_run(p, r), &own, course(r)))
        };
        let linear: Vec<_> = self.runs.par_iter().enumerate().map(linearise).collect();
        for (r, (columns, own)) in linear.iter().enumerate() {
            self.place(r, own.residual.as_slice(), residual.as_mut_slice());
            self.place_columns(r, &own.jacobian, columns, free, &mut jacobian);
        }
        Linearisation { residual, jacobian }
    }

    /// Derivatives with respect to the parameters `free` at each of the parameter vectors `forms`, one form's columns behind the other's;
    /// see [`Experiment::linearise_forms`].
    pub fn linearise_forms(
        &self,
        forms: &[Vec<f64>],
        free: &[usize],
        courses: &[Option<Course>],
    ) -> DMatrix<f64> {
        let course = |r: usize| courses.get(r).and_then(Option::as_ref);
        if let Some(run) = self.only() {
            return run.linearise_forms(forms, free, course(0));
        }
        let mut jacobian = DMatrix::zeros(self.channels.len() * self.samples(), forms.len() * free.len());
        let repeated: Vec<usize> = forms.iter().flat_map(|_| free).copied().collect();
        let linearise = |(r, run): (usize, &Experiment)| {
            let (columns, own) = self.own_of(r, free);
            let forms: Vec<Vec<f64>> = forms.iter().map(|p| self.of_run(p, r).into_owned()).collect();
            let every = (0..forms.len()).flat_map(|form| columns.iter().map(move |c| form * free.len() + c));
            (every.collect::<Vec<_>>(), run.linearise_forms(&forms, &own, course(r)))
        };
        let linear: Vec<_> = self.runs.par_iter().enumerate().map(linearise).collect();
        for (r, (columns, own)) in linear.iter().enumerate() {
            self.place_columns(r, own, columns, &repeated, &mut jacobian);
        }
        jacobian
    }

    /// How the currents of each recording answer at `p` to a voltage that is lost, if they can be followed on all of them; see
    /// [`Experiment::answering`].
    pub fn answering(&self, p: &[f64]) -> Option<Vec<Answering>> {
        self.runs.par_iter().enumerate().map(|(r, run)| run.answering(&self.of_run(p, r))).collect()
    }

    /// Derivatives with respect to the coefficients of `part`, all of them zero, beside the model whose currents are `answering` like
    /// this at `p`; see [`Experiment::lost_columns`].
    pub fn lost_columns(&self, p: &[f64], answering: &[Answering], part: &Part) -> DMatrix<f64> {
        self.answered(p, answering, part.count(), &|run, p, answering| run.lost_columns(p, answering, part))
    }

    /// Derivatives with respect to how the current sensors lag; see [`Experiment::lag_columns`].
    pub fn lag_columns(&self, p: &[f64], answering: &[Answering]) -> DMatrix<f64> {
        self.answered(p, answering, LAGS, &|run, p, answering| run.lag_columns(p, answering))
    }

    /// Derivatives with respect to an error of the rotor angle over speed and turn; see [`Experiment::turned_columns`].
    pub fn turned_columns(&self, p: &[f64], answering: &[Answering]) -> DMatrix<f64> {
        self.answered(p, answering, TURNED, &|run, p, answering| run.turned_columns(p, answering))
    }

    /// Some `count` columns of each recording, one below the other.
    fn answered(&self, p: &[f64], answering: &[Answering], count: usize, own: ColumnsOf) -> DMatrix<f64> {
        if let Some(run) = self.only() {
            return own(run, p, &answering[0]);
        }
        let mut columns = DMatrix::zeros(self.channels.len() * self.samples(), count);
        for (r, (run, answering)) in self.runs.iter().zip(answering).enumerate() {
            let own = own(run, &self.of_run(p, r), answering);
            for (own, mut all) in own.column_iter().zip(columns.column_iter_mut()) {
                self.place(r, own.as_slice(), all.as_mut_slice());
            }
        }
        columns
    }

    /// Those columns of the parameters `free` that recording `run` knows, and the parameters as it numbers them.
    fn own_of(&self, run: usize, free: &[usize]) -> (Vec<usize>, Vec<usize>) {
        let knows = |c: &usize| self.owner(free[*c]).is_none_or(|owner| owner == run);
        let columns: Vec<usize> = (0..free.len()).filter(knows).collect();
        let own = columns.iter().map(|c| self.index_in(run, free[*c])).collect();
        (columns, own)
    }

    /// Copies derivatives of recording `run` to where they belong among those of all recordings.
    fn place_columns(
        &self,
        run: usize,
        own: &DMatrix<f64>,
        columns: &[usize],
        free: &[usize],
        all: &mut DMatrix<f64>,
    ) {
        for (at, column) in columns.iter().enumerate() {
            let mut target = all.column_mut(*column);
            self.place(run, own.column(at).as_slice(), target.as_mut_slice());
            let factor = self.factor(run, free[*column]);
            if factor != 1.0 {
                for (channel, _) in &self.runs[run].channels {
                    let rows = self.rows(run, *channel).expect("a channel of this recording");
                    target.rows_mut(rows.start, rows.len()).scale_mut(factor);
                }
            }
        }
    }

    /// What the model shows in each channel, in the order of [`Joint::channels`]; NaN where a recording does not hold it.
    pub fn predict(&self, p: &[f64]) -> Prediction {
        if let Some(run) = self.only() {
            return run.predict(p);
        }
        let n = self.samples();
        let mut all = vec![f64::NAN; self.channels.len() * n];
        let own = |(r, run): (usize, &Experiment)| run.predict(&self.of_run(p, r)).concat();
        let shown: Vec<Vec<f64>> = self.runs.par_iter().enumerate().map(own).collect();
        for (r, own) in shown.iter().enumerate() {
            self.place(r, own, &mut all);
        }
        all.chunks(n).map(<[f64]>::to_vec).collect()
    }

    /// The measurement of a channel; NaN where a recording does not hold it.
    pub fn measured(&self, channel: Channel) -> Vec<f64> {
        let own = |run: &Experiment| match run.row_of(channel) {
            Some(_) => run.measured(channel).to_vec(),
            None => vec![f64::NAN; run.samples()],
        };
        self.runs.iter().flat_map(own).collect()
    }

    /// Mean square of the weighted residual in each of [`Joint::blocks`], with the independent samples that it rests on (see
    /// [`Experiment::mean_squares`]); `independent` counts those of a block whose residual is looked at sample by sample.
    pub fn mean_squares(
        &self,
        residual: &DVector<f64>,
        independent: impl Fn(&[f64]) -> f64,
    ) -> Vec<(f64, f64)> {
        let of = |run: usize| -> Vec<(f64, f64)> {
            let own = self.rows_of_run(run, residual);
            let n = self.runs[run].samples();
            let squares = self.runs[run].mean_squares(&own);
            let rows = own.as_slice().chunks(n);
            squares.into_iter().zip(rows).map(|((s, size), x)| (s, independent(x) / size as f64)).collect()
        };
        (0..self.runs.len()).flat_map(of).collect()
    }

    /// Samples of the longest means in which the currents of a recording are looked at; see [`Experiment::mean_squares`].
    pub fn scale_of_currents(&self, residual: &DVector<f64>) -> usize {
        let of = |run: usize| {
            let squares = self.runs[run].mean_squares(&self.rows_of_run(run, residual));
            let channels = self.runs[run].channels.iter().zip(squares);
            channels.filter(|((c, _), _)| c.is_electrical()).map(|(_, (_, size))| size).max()
        };
        (0..self.runs.len()).filter_map(of).max().unwrap_or(1)
    }

    /// [`Experiment::loudness`] in each of [`Joint::blocks`].
    pub fn loudness(&self, residual: &DVector<f64>) -> Vec<f64> {
        let of = |run: usize| self.runs[run].loudness(&self.rows_of_run(run, residual));
        (0..self.runs.len()).flat_map(of).collect()
    }

    /// Root mean square of the weighted residual in each of [`Joint::blocks`].
    pub fn relative_rms(&self, residual: &DVector<f64>) -> Vec<f64> {
        let of = |run: usize| self.runs[run].relative_rms(&self.rows_of_run(run, residual));
        (0..self.runs.len()).flat_map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::experiment::testing::{of_speed, reversing};
    use crate::map::{Equation, Factor, Map, Variable};
    use crate::model::Model;
    use crate::simulate::mechanical::{self, Nuisance};

    #[test]
    fn columns_of_a_map_lie_where_a_run_of_all_recordings_has_them() {
        let signals =
            [(1e-4, 0.31..0.32), (2e-4, 0.0..0.0), (1e-3, 0.0..0.0)].map(|(h, gap)| reversing(h, &gap));
        let windows = signals.each_ref().map(mechanical::windows);
        let currents = vec![(Channel::ID, 0.05), (Channel::IQ, 0.02)];
        // The last recording compares the speed alone.
        let channels = [currents.clone(), currents, vec![(Channel::OmegaE, 0.1)]];
        let of = |model| {
            let run = |k: usize| {
                let known = Nuisance::known(0);
                let channels = channels[k].clone();
                Experiment { channels, ..of_speed(model, &signals[k], known, &windows[k]) }
            };
            Joint::new((0..3).map(run).collect())
        };
        let part = Part {
            equations: vec![Equation::D, Equation::Q],
            first: Factor::Harmonics { angle: Variable::ThetaE, order: 1, count: 3 },
            second: None,
        };
        let model = Model::new(signals[0].context, &[EffectId::DeadTime]);
        let mut p = vec![0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3];
        let dead_time = EffectId::DeadTime.info().parameters.iter();
        p.extend(dead_time.map(|x| (x.typical)(&signals[0].context)));
        let columns = of(&model).lost_columns(&p, &of(&model).answering(&p).unwrap(), &part);

        let richer = model.clone().with_map(Map { parts: vec![part.clone()] });
        let free: Vec<usize> = (p.len()..p.len() + part.count()).collect();
        p.resize(p.len() + part.count(), 0.0);
        let run = of(&richer).linearise(&p, &free).jacobian;
        assert_eq!(columns.shape(), run.shape());
        let mut first = 0;
        for channel in 0..3 {
            for (k, signals) in signals.iter().enumerate() {
                let n = signals.len();
                let (own, exact) = (columns.rows(first, n), run.rows(first, n));
                assert_eq!(exact.norm() > 0.0, channel < 2 && k < 2, "{channel} {k}");
                assert!((own - exact).norm() <= 0.01 * exact.norm(), "{channel} {k}");
                first += n;
            }
        }
    }
}
