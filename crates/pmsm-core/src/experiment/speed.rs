//! The speed's residual and its derivatives. The initial speed of each window is estimated and projected out.

use super::course::{Course, Run};
use super::rows::{Rows, of_groups};
use super::{Channel, Experiment, LANES, seed};
use crate::numerics::dual::Dual;
use crate::numerics::real::Real;
use crate::numerics::tall;
use crate::simulate::mechanical::{self, Restart, Windows};
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::OnceLock;

impl<'a> Experiment<'a> {
    /// What the rotor does at `p`, if the speed is compared.
    pub fn course(&self, p: &[f64]) -> Option<Course> {
        self.has_mechanical().then(|| {
            let torque = self.torque_at(p).into_owned();
            let starts = self.starts(p, &torque).into_owned();
            let run = self.speed_pass(p, &torque, &starts);
            Course { torque, starts, run, gains: OnceLock::new(), stations: OnceLock::new() }
        })
    }

    /// One over the speed's standard deviation.
    pub(super) fn speed_weight(&self) -> f64 {
        self.row_of(Channel::OmegaE).expect("asked for the speed").1
    }

    /// The speed's rows at `p`, where the rotor's course may be `known`.
    pub(super) fn linearise_mechanical(
        &self,
        p: &[f64],
        free: &[usize],
        known: Option<&Course>,
        mut rows: Rows<'_>,
    ) {
        let speed = self.columns_of_speed(p, free, known, &mut rows);
        self.project(&speed, rows);
    }

    /// The columns of the speed's rows before the initial speeds are projected out, and the speed.
    pub(super) fn columns_of_speed<'k>(
        &self,
        p: &[f64],
        free: &[usize],
        known: Option<&'k Course>,
        rows: &mut Rows<'_>,
    ) -> Cow<'k, Run> {
        // A pass whose columns change the torque has its own. Whoever asks first computes it, on its own thread alone: one that took up
        // another job meanwhile might wait for itself.
        let own = OnceLock::new();
        let torque = || known.map_or_else(|| &**own.get_or_init(|| self.torque_at(p)), |known| &known.torque);
        let starts = match (known, &self.starts) {
            (Some(known), _) => Cow::Borrowed(&*known.starts),
            (None, Some(starts)) => Cow::Borrowed(&**starts),
            (None, None) => self.starts(p, torque()),
        };
        let moving = (0..free.len()).filter(|c| !self.is_electrical(free[*c]) || self.model.turns(free[*c]));
        let (answering, other): (Vec<usize>, Vec<usize>) =
            moving.partition(|c| self.answers_as_speed(free[*c]));
        let (load, other): (Vec<usize>, Vec<usize>) =
            other.into_iter().partition(|c| self.passes_on(free[*c]));
        // One pass shows the speed, too.
        let passes = other.chunks(LANES - 1);
        let mut speed = match known {
            Some(known) if other.is_empty() => Cow::Borrowed(&known.run),
            _ if other.is_empty() => Cow::Owned(self.speed_pass(p, torque(), &starts)),
            _ => Cow::Owned(Run::new(self.samples())),
        };
        let groups: Vec<&[usize]> = passes.chain((!load.is_empty()).then_some(&load[..])).collect();
        let first = (!other.is_empty()).then(|| speed.to_mut());
        let shows = std::iter::once(first).chain(std::iter::repeat_with(|| None));
        let jobs: Vec<_> = groups.iter().zip(of_groups(&mut rows.columns, &groups)).zip(shows).collect();
        jobs.into_par_iter().for_each(|((columns, rows), speed)| {
            let at = (p, free, *columns);
            match columns.len() {
                _ if self.passes_on(free[columns[0]]) => self.load_passed_on(at, torque(), &starts, rows),
                0..=3 => self.mechanical_pass::<4>(at, torque, &starts, speed, rows),
                _ => self.mechanical_pass::<LANES>(at, torque, &starts, speed, rows),
            }
        });
        self.respond((p, free, &answering), known, torque, &speed, rows);
        speed
    }

    /// Derivatives of the speed for some `columns` of the parameters `free`, each with its `rows`, and the speed itself where there is
    /// room for it.
    pub(super) fn mechanical_pass<'t, const N: usize>(
        &self,
        (p, free, columns): (&[f64], &[usize], &[usize]),
        torque: impl Fn() -> &'t [f64],
        starts: &[f64],
        mut speed: Option<&mut Run>,
        mut rows: Vec<&mut [f64]>,
    ) {
        let weight = self.speed_weight();
        let varied: Vec<usize> = columns.iter().map(|c| free[*c]).collect();
        let mut sink = |k: usize, now: f64, slopes: &[f64; N]| {
            if let Some(speed) = &mut speed {
                (speed.shown[k], speed.slope[k]) = (now, slopes[N - 1]);
            }
            for (slope, rows) in slopes.iter().zip(&mut rows) {
                rows[k] = slope * weight;
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

    /// The speed in free run.
    pub(super) fn speed_pass(&self, p: &[f64], torque: &[f64], starts: &[f64]) -> Run {
        let mut run = Run::new(self.samples());
        self.mechanical_pass::<1>((p, &[], &[]), || torque, starts, Some(&mut run), Vec::new());
        run
    }

    /// Initial speed of each window: the given one, or that of least squares.
    pub(super) fn starts(&self, p: &[f64], torque: &[f64]) -> Cow<'_, [f64]> {
        if let Some(starts) = &self.starts {
            return Cow::Borrowed(starts);
        }
        let omega = &self.signals.omega_e;
        let mut starts: Vec<f64> = self.windows.iter().map(|w| omega[w.start]).collect();
        let Run { shown, slope } = self.speed_pass(p, torque, &starts);
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
    pub(super) fn project(&self, Run { shown, slope }: &Run, rows: Rows<'_>) {
        let weight = self.speed_weight();
        let Rows { residual, mut columns } = rows;
        for k in self.windows.iter().flat_map(Range::clone) {
            residual[k] = (shown[k] - self.signals.omega_e[k]) * weight;
        }
        let mut slope = slope.clone();
        self.windows.iter().for_each(|window| self.whiten_speed(&mut slope[window.clone()]));
        let own = self.windows.iter().map(|window| &slope[window.clone()]);
        let directions: Vec<(&[f64], f64)> = own.map(|slope| (slope, tall::dot(slope, slope))).collect();
        columns.push(residual);
        columns.into_par_iter().for_each(|column| {
            for (window, (direction, square)) in self.windows.iter().zip(&directions) {
                let x = &mut column[window.clone()];
                // What acts for a while only leaves other windows alone.
                if x.iter().all(|x| *x == 0.0) {
                    continue;
                }
                self.whiten_speed(x);
                remove(direction, *square, x);
            }
        });
    }

    /// Turns what is left of the speed within a window into innovations, and takes out its colour, where one of them is known.
    pub(super) fn whiten_speed(&self, x: &mut [f64]) {
        if let Some((wander, floor)) = &self.wander {
            wander.whiten(*floor, x);
        }
        if let Some(colour) = &self.colour {
            colour.whiten(x);
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

/// Takes the component along `direction`, of such a `square`, out of `x`.
fn remove(direction: &[f64], square: f64, x: &mut [f64]) {
    if square > 0.0 {
        let share = tall::dot(direction, x) / square;
        for (x, s) in x.iter_mut().zip(direction) {
            *x -= share * s;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Run;
    use crate::base::BASE;
    use crate::effect::Site;
    use crate::effects::{ALL, EffectId};
    use crate::experiment::testing::{of_speed, reversing};
    use crate::machine::BaseParameter;
    use crate::model::Model;
    use crate::numerics::dual::Dual;
    use crate::numerics::lanes::Path;
    use crate::numerics::real::Real;
    use crate::simulate::mechanical::{self, Nuisance};
    use std::ops::Range;

    /// Keeps what a run hands out: speeds, and their derivatives.
    fn keep(into: &mut (Vec<f64>, Vec<[f64; 4]>)) -> impl FnMut(usize, f64, &[f64; 4]) {
        |k, now, slopes| (into.0[k], into.1[k]) = (now, *slopes)
    }

    #[test]
    fn the_torque_of_given_currents_depends_on_what_turns_the_rotor_and_on_nothing_else() {
        let signals = reversing(2e-3, &(0.3..0.35));
        let typical = |e: EffectId| e.info().parameters.iter().map(move |x| (x.typical)(&signals.context));
        let slopes = |effects: &[EffectId], index: usize| -> (f64, bool) {
            let model = Model::new(signals.context, effects);
            let mut p = vec![0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3];
            p.extend(effects.iter().flat_map(|e| typical(*e)));
            let varied = |k: usize| if k == index { Dual::variable(p[k], 0) } else { Dual::constant(p[k]) };
            let p: Vec<Dual<1>> = (0..p.len()).map(varied).collect();
            let torque = mechanical::torque(&model, &signals, &p);
            assert!(torque.iter().all(|x| x.re.is_finite()), "{effects:?}");
            (torque.iter().map(|x| x.eps[0].abs()).sum(), model.turns(index))
        };
        let electrical = || ALL.iter().copied().filter(|e| e.info().site == Site::Electrical);
        let mut still = 0;
        for effect in electrical() {
            let count = effect.info().parameters.len();
            let all: Vec<(f64, bool)> = (BASE..BASE + count).map(|k| slopes(&[effect], k)).collect();
            assert_eq!(effect.turns(), all.iter().any(|(slope, _)| *slope > 0.0), "{effect:?} {all:?}");
            for other in electrical().filter(|e| *e != effect) {
                for index in (BASE..BASE + count).chain([BaseParameter::RS.index()]) {
                    let (slope, turns) = slopes(&[effect, other], index);
                    assert!(turns || slope == 0.0, "{effect:?} {other:?} {index}: {slope}");
                    still += usize::from(!turns);
                }
            }
        }
        assert!(still > 50);
    }

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
                experiment.one_by_one(&p, varied, || &torque, &starts, keep(&mut one));
                assert!(one.0.iter().any(|w| *w != 0.0) && one.1.iter().flatten().all(|x| x.is_finite()));
                let ran = experiment.side_by_side(&p, varied, || &torque, &starts, keep(&mut beside));
                assert_eq!(ran, Path::best() >= Path::Avx2);
                if ran {
                    assert!(beside == one, "{h} {length} {effects:?}");
                }
                let alone = one.1.iter().map(|slopes| slopes[3]).collect();
                assert_eq!(experiment.speed_pass(&p, &torque, &starts), Run { shown: one.0, slope: alone });
            }
        }
    }
}
