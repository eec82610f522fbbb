//! The residuals of the voltage equations and their derivatives: the currents of a recording in time, the voltages of operating points.

use super::rows::{Rows, of_groups};
use super::{Channel, Experiment, LANES, seed};
use crate::numerics::dual::Dual;
use crate::numerics::real::Real;
use crate::simulate::electrical;
use crate::simulate::inductances::incremental_inductances;
use crate::simulate::quasi_static;
use rayon::prelude::*;

impl Experiment<'_> {
    /// The currents' or voltages' rows at `p`.
    pub(super) fn linearise_electrical(&self, p: &[f64], free: &[usize], mut rows: Rows<'_>) {
        let reaching: Vec<usize> = (0..free.len()).filter(|c| self.is_electrical(free[*c])).collect();
        // One group without columns if there are none, so that the residual is still computed.
        let groups = if reaching.is_empty() { vec![&reaching[..]] } else { reaching.chunks(LANES).collect() };
        let first = std::iter::once(Some(&mut *rows.residual)).chain(std::iter::repeat_with(|| None));
        let jobs: Vec<_> = groups.iter().zip(of_groups(&mut rows.columns, &groups)).zip(first).collect();
        jobs.into_par_iter().for_each(|((columns, rows), residual)| {
            self.electrical_passes((p, free, columns), residual, rows);
        });
        let rates = || self.inductance_rates(p, free, &reaching);
        self.whiten_residual(p, rates, &reaching, &mut rows);
    }

    /// See [`Self::electrical_pass`], for at most [`LANES`] columns.
    pub(super) fn electrical_passes(
        &self,
        (p, free, columns): (&[f64], &[usize], &[usize]),
        residual: Option<&mut [f64]>,
        rows: Vec<&mut [f64]>,
    ) {
        match columns.len() {
            0..=4 => self.electrical_pass::<4>((p, free, columns), residual, rows),
            _ => self.electrical_pass::<LANES>((p, free, columns), residual, rows),
        }
    }

    /// Hands the weighted residual of each row to `put`.
    pub(super) fn fill_electrical<T: Real>(&self, p: &[T], mut put: impl FnMut(usize, T)) {
        let p = &p[..self.model.parameter_count()];
        let pair = |a, b| Some((self.row_of(a)?, self.row_of(b)?));
        if let (Some(((d, wd), (q, wq))), Some(i)) = (pair(Channel::ID, Channel::IQ), &self.signals.i) {
            electrical::run(self.model, self.signals, p, |k, now| {
                put(d + k, (now[0] - i[0][k]) * wd);
                put(q + k, (now[1] - i[1][k]) * wq);
            });
        }
        let axes = [self.row_of(Channel::VD), self.row_of(Channel::VQ)];
        if let (true, Some(v)) = (axes.iter().any(Option::is_some), &self.signals.v) {
            quasi_static::run(self.model, self.signals, p, |k, now| {
                for (axis, place) in axes.iter().enumerate() {
                    if let Some((row, weight)) = place {
                        put(row + k, (now[axis] - v[axis][k]) * *weight);
                    }
                }
            });
        }
    }

    /// Relative rates at which the inductances (d, q) that the whitening filter follows change with those `columns` of the parameters
    /// `free`, per unit of each.
    pub(super) fn inductance_rates(&self, p: &[f64], free: &[usize], columns: &[usize]) -> Vec<[f64; 2]> {
        let count = self.model.parameter_count();
        let rates = columns.chunks(LANES).flat_map(|chunk| {
            let seeded = seed::<LANES>(&p[..count], chunk, free);
            let along = incremental_inductances(self.model, self.signals, &seeded);
            (0..chunk.len()).map(move |slot| [0, 1].map(|axis: usize| along[axis].eps[slot] / along[axis].re))
        });
        rates.collect()
    }

    /// Passes a residual at `p` and some `columns` of its derivatives, which change the inductances at these `rates`, through the whitening
    /// filter that belongs to `p`.
    pub(super) fn whiten_residual(
        &self,
        p: &[f64],
        rates: impl FnOnce() -> Vec<[f64; 2]>,
        columns: &[usize],
        rows: &mut Rows<'_>,
    ) {
        let Some((whitening, _)) = self.whitening else { return };
        let count = self.model.parameter_count();
        if !whitening.follows() {
            self.on_currents(rows.residual, |d, q| whitening.apply(d, q));
            let own = of_groups(&mut rows.columns, &[columns]).swap_remove(0);
            own.into_par_iter().for_each(|rows| {
                self.on_currents(rows, |d, q| whitening.apply(d, q));
            });
            return;
        }
        let wanted = incremental_inductances(self.model, self.signals, &p[..count]);
        let l = whitening.within(wanted);
        let followed = [0, 1].map(|axis| (l[axis] / wanted[axis] - 1.0).abs() < 1e-9);
        let filter = whitening.at(self.signals, l, !columns.is_empty());
        let bend = self.on_currents(rows.residual, |d, q| filter.follow(l, d, q)).flatten();
        let own = of_groups(&mut rows.columns, &[columns]).swap_remove(0);
        let jobs: Vec<_> = own.into_iter().zip(rates()).collect();
        jobs.into_par_iter().for_each(|(rows, rates)| {
            self.on_currents(rows, |d, q| {
                filter.apply(d, q);
                for (axis, [bend_d, bend_q]) in
                    bend.iter().flatten().enumerate().filter(|(a, _)| followed[*a])
                {
                    let bends = d.iter_mut().zip(bend_d).chain(q.iter_mut().zip(bend_q));
                    bends.for_each(|(x, bend)| *x += rates[axis] * bend);
                }
            });
        });
    }

    /// Does something to the rows of the currents, in units of A before and of the floors afterwards.
    fn on_currents<R>(&self, rows: &mut [f64], act: impl FnOnce(&mut [f64], &mut [f64]) -> R) -> Option<R> {
        let (_, floors) = self.whitening?;
        let ((d, wd), (q, wq)) = (self.row_of(Channel::ID)?, self.row_of(Channel::IQ)?);
        let n = self.samples();
        let (first, second) = rows.split_at_mut(d.max(q));
        let (d, q) = if d < q {
            (&mut first[d..d + n], &mut second[..n])
        } else {
            (&mut second[..n], &mut first[q..q + n])
        };
        d.iter_mut().for_each(|x| *x /= wd);
        q.iter_mut().for_each(|x| *x /= wq);
        let out = act(d, q);
        d.iter_mut().for_each(|x| *x *= floors[0] * wd);
        q.iter_mut().for_each(|x| *x *= floors[1] * wq);
        Some(out)
    }

    /// Electrical residuals, if they are wanted, and their derivatives for some `columns` of the parameters `free`, each with its `rows`.
    fn electrical_pass<const N: usize>(
        &self,
        (p, free, columns): (&[f64], &[usize], &[usize]),
        mut residual: Option<&mut [f64]>,
        mut rows: Vec<&mut [f64]>,
    ) {
        let seeded = seed::<N>(p, columns, free);
        self.fill_electrical(&seeded, |row, value: Dual<N>| {
            if let Some(residual) = &mut residual {
                residual[row] = value.re;
            }
            for (rows, slope) in rows.iter_mut().zip(value.eps) {
                rows[row] = slope;
            }
        });
    }
}
