//! Derivatives of the speed by variation of constants.
//!
//! Where the rotor has no states of its own, a change δω of its speed obeys dδω/dt = (∂a/∂ω)·δω + ∂a/∂p, with its acceleration a: what a
//! parameter adds over one step fades from then on as a change of the initial speed does. One run tells how that fades; a parameter
//! then costs its share of the acceleration at each sample, in place of a run.

use super::course::{Course, Gains, Run};
use super::decay::{added, kept, root};
use super::rows::{Rows, of_groups};
use super::{Experiment, decay, seed};
use crate::base::BASE;
use crate::effect::{Role, Site};
use crate::model::Slot;
use crate::numerics::dual::Dual;
use crate::numerics::real::Real;
use crate::simulate::mechanical::{self, Losses, Rotor, Stations, Torque};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::OnceLock;

/// Columns that share a pass over the samples: with more of them, too many numbers for the registers are in hand at once.
const TOGETHER: usize = 4;

/// How a parameter changes the acceleration of a rotor without states of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Through the motor's torque.
    Torque,
    /// Through the torque that an effect or the map takes from the rotor.
    Loss,
    /// In another way.
    Rotor,
    /// Through the unknown load.
    Load,
}

impl Experiment<'_> {
    /// Whether the speed answers to parameter `index` as to a change of itself. It does not where the rotor has states of its own, and not
    /// to what the sensors show; how fast a torque jumps decides itself within one step, so that only a run knows.
    pub(super) fn answers_as_speed(&self, index: usize) -> bool {
        if self.model.mechanical_states() > 0 {
            return false;
        }
        let Some(slot) = self.model.slots().iter().find(|s| s.parameters.contains(&index)) else {
            return true;
        };
        let parameter = &slot.effect.info().parameters[index - slot.parameters.start];
        slot.effect.info().site != Site::Sensor && !(slot.effect.jumps() && parameter.role == Role::Shape)
    }

    /// Derivatives of the `speed`, which comes with its derivative with respect to the initial speeds, for those `answering` columns of
    /// the parameters `free` to which it answers as to a change of itself; the rotor's course may be `known`.
    pub(super) fn respond<'t>(
        &self,
        (p, free, answering): (&[f64], &[usize], &[usize]),
        known: Option<&Course>,
        torque: impl Fn() -> &'t [f64] + Sync,
        speed: &Run,
        rows: &mut Rows<'_>,
    ) {
        // What changes the motor's torque takes a pass of its own through the currents.
        let of = |kind: Kind| answering.iter().copied().filter(move |c| self.kind(free[*c]) == kind);
        let load: Vec<usize> = of(Kind::Load).collect();
        let mut groups: Vec<(Kind, &[usize])> = Vec::new();
        let passes = [Kind::Torque, Kind::Loss, Kind::Rotor].map(|kind| (kind, of(kind).collect::<Vec<_>>()));
        for (kind, columns) in &passes {
            groups.extend(columns.chunks(TOGETHER).map(|columns| (*kind, columns)));
        }
        groups.extend((!load.is_empty()).then_some((Kind::Load, &load[..])));
        let (own_gains, own_stations) = (OnceLock::new(), OnceLock::new());
        let gains =
            || known.map_or(&own_gains, |known| &known.gains).get_or_init(|| self.gains(p, torque(), speed));
        let stations = || {
            let known = known.map_or(&own_stations, |known| &known.stations);
            known.get_or_init(|| Stations::new(&self.rotor(p, Torque::Fixed(torque()), p, speed)))
        };
        let own_flux = OnceLock::new();
        let flux = || {
            // It is iterated for, so that its last digits are this model's own.
            let own = &p[..self.model.parameter_count()];
            own_flux.get_or_init(|| mechanical::flux(self.model, self.signals, own)).as_ref()
        };
        let columns: Vec<&[usize]> = groups.iter().map(|(_, columns)| *columns).collect();
        let jobs: Vec<_> = groups.iter().zip(of_groups(&mut rows.columns, &columns)).collect();
        jobs.into_par_iter().for_each(|((kind, columns), rows)| {
            let at = (p, free, *columns);
            match (kind, columns.len()) {
                (Kind::Load, _) => self.load_columns(at, &speed.slope, rows),
                (Kind::Torque, 1) => self.torque_columns::<1>(at, (gains(), flux()), speed, rows),
                (Kind::Torque, _) => self.torque_columns::<TOGETHER>(at, (gains(), flux()), speed, rows),
                (Kind::Loss, 1) => self.loss_columns::<1>(at, stations(), speed, rows),
                (Kind::Loss, 2) => self.loss_columns::<2>(at, stations(), speed, rows),
                (Kind::Loss, 3) => self.loss_columns::<3>(at, stations(), speed, rows),
                (Kind::Loss, _) => self.loss_columns::<TOGETHER>(at, stations(), speed, rows),
                (Kind::Rotor, 1) => self.rotor_columns::<1>(at, torque(), speed, rows),
                (Kind::Rotor, _) => self.rotor_columns::<TOGETHER>(at, torque(), speed, rows),
            }
        });
    }

    /// How parameter `index`, to which the speed answers, changes the acceleration.
    fn kind(&self, index: usize) -> Kind {
        if index >= self.model.parameter_count() {
            Kind::Load
        } else if self.is_electrical(index) {
            Kind::Torque
        } else if index >= BASE {
            Kind::Loss
        } else {
            Kind::Rotor
        }
    }

    /// The rotor along the `speed`, driven and loaded as the parameters `p` say.
    fn rotor<'a, T>(
        &'a self,
        own: &'a [T],
        tau_e: Torque<'a, T>,
        p: &'a [f64],
        speed: &'a Run,
    ) -> Rotor<'a, T> {
        let count = self.model.parameter_count();
        Rotor {
            model: self.model,
            signals: self.signals,
            p: &own[..count],
            tau_e,
            load: (self.nuisance, &p[count..]),
            windows: self.windows,
            shown: &speed.shown,
        }
    }

    /// How the acceleration answers to the motor's torque along the `speed`.
    fn gains(&self, p: &[f64], torque: &[f64], speed: &Run) -> Gains {
        let fixed: Vec<Dual<1>> = p.iter().map(|x| Dual::constant(*x)).collect();
        let torque: Vec<Dual<1>> = torque.iter().map(|x| Dual::variable(*x, 0)).collect();
        let n = self.samples();
        let mut gains = Gains { here: vec![0.0; n], between: vec![None; n] };
        self.rotor(&fixed, Torque::Varied(&torque), p, speed).accelerations(|window, here, between| {
            for ((k, here), between) in window.clone().zip(here).zip(between) {
                gains.here[k] = here.eps[0];
                gains.between[k] = between.map(|x| x.eps[0]);
            }
        });
        gains
    }

    /// Derivatives with respect to parameters that change the acceleration through the motor's torque alone.
    fn torque_columns<const N: usize>(
        &self,
        (p, free, columns): (&[f64], &[usize], &[usize]),
        (gains, flux): (&Gains, Option<&[Vec<f64>; 2]>),
        Run { slope, .. }: &Run,
        mut rows: Vec<&mut [f64]>,
    ) {
        let count = self.model.parameter_count();
        let seeded = seed::<N>(p, columns, free);
        let torque = mechanical::torque_with(self.model, self.signals, &seeded[..count], flux);
        for window in self.windows {
            let here = |k: usize| torque[k].eps.map(|x| x * gains.here[k]);
            let between = |k: usize| {
                let gain = gains.between[k]?;
                Some(mechanical::torque_halfway(&torque, k, window).eps.map(|x| x * gain))
            };
            self.accumulate(window, slope, (here, between), &mut rows);
        }
    }

    /// Derivatives with respect to parameters of what takes torque from the rotor: what else does need not be asked.
    fn loss_columns<const N: usize>(
        &self,
        (p, free, columns): (&[f64], &[usize], &[usize]),
        stations: &Stations,
        Run { slope, .. }: &Run,
        mut rows: Vec<&mut [f64]>,
    ) {
        let seeded = seed::<N>(p, columns, free);
        let asks = |s: &&Slot| columns.iter().any(|c| s.parameters.contains(&free[*c]));
        let asked: Vec<&Slot> = self.model.slots().iter().filter(asks).collect();
        let map = columns.iter().any(|c| self.model.map_parameters().contains(&free[*c]));
        let losses =
            Losses { model: self.model, asked: &asked, map, p: &seeded, stations, windows: self.windows };
        losses.accelerations(|window, first, found| {
            let here = |k: usize| found[stations.at(k) - first].eps;
            let between = |k: usize| stations.behind(k).map(|station| found[station - first].eps);
            self.accumulate(window, slope, (here, between), &mut rows);
        });
    }

    /// Derivatives with respect to parameters of the rotor, which change the acceleration at the same `torque` of the motor.
    fn rotor_columns<const N: usize>(
        &self,
        (p, free, columns): (&[f64], &[usize], &[usize]),
        torque: &[f64],
        speed: &Run,
        mut rows: Vec<&mut [f64]>,
    ) {
        let seeded = seed::<N>(p, columns, free);
        self.rotor(&seeded, Torque::Fixed(torque), p, speed).accelerations(|window, here, between| {
            let own = (
                |k: usize| here[k - window.start].eps,
                |k: usize| between[k - window.start].map(|x: Dual<N>| x.eps),
            );
            self.accumulate(window, &speed.slope, own, &mut rows);
        });
    }

    /// What derivatives of the acceleration, at a sample and halfway to the next where a step has its middle there, do to the speed of
    /// one window.
    fn accumulate<const N: usize>(
        &self,
        window: &Range<usize>,
        slope: &[f64],
        (here, between): (impl Fn(usize) -> [f64; N], impl Fn(usize) -> Option<[f64; N]>),
        rows: &mut [&mut [f64]],
    ) {
        let weight = self.speed_weight();
        let t = &self.signals.t;
        let mut put = |k: usize, response: &[f64; N]| {
            for (rows, x) in rows.iter_mut().zip(response) {
                rows[k] = x * weight;
            }
        };
        let (mut k, mut response) = (window.start, [0.0; N]);
        put(k, &response);
        // Simpson's rule, and over half a step what belongs to it.
        while k + 1 < window.end {
            let (h, kept) = (t[k + 1] - t[k], kept(slope, k, 1));
            if let Some(middle) = between(k) {
                let h = h / 6.0;
                let weights = [kept * h, 4.0 * root(kept) * h, h];
                response = added(&response, kept, weights, [&here(k), &middle, &here(k + 1)]);
                k += 1;
            } else {
                let (a, b, c) = (here(k), here(k + 1), here(k + 2));
                let three = [&a, &b, &c];
                let half = root(kept) * h / 12.0;
                put(k + 1, &added(&response, kept, [5.0 * half, 8.0 * half, -half], three));
                let (h, kept) = ((t[k + 2] - t[k]) / 6.0, decay::kept(slope, k, 2));
                response = added(&response, kept, [kept * h, 4.0 * root(kept) * h, h], three);
                k += 2;
            }
            put(k, &response);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{ALL, EffectId};
    use crate::experiment::Linearisation;
    use crate::experiment::testing::{of_speed, reversing};
    use crate::machine::BaseParameter;
    use crate::model::Model;
    use crate::simulate::mechanical::Nuisance;

    #[test]
    fn columns_are_those_of_a_run_that_carries_derivatives_along() {
        // In steps of two samples, and of one.
        for h in [1e-4, 4e-4] {
            let signals = reversing(h, &(0.0..0.0));
            let windows = mechanical::windows(&signals);
            let effects = [
                EffectId::AsymmetricFriction,
                EffectId::CoggingTorque,
                EffectId::TimeVaryingLoad,
                EffectId::SaturationD,
                EffectId::CurrentOffset,
            ];
            let model = Model::new(signals.context, &effects);
            let mut p = vec![0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3];
            for effect in effects {
                p.extend(effect.info().parameters.iter().map(|x| (x.typical)(&signals.context)));
            }
            let count = p.len();
            p.extend([0.3, -0.2, 0.41]);
            let experiment = of_speed(&model, &signals, Nuisance::unknown(1, 0), &windows);
            let free: Vec<usize> = (0..p.len()).collect();
            let linear = experiment.linearise(&p, &free);
            let course = experiment.course(&p);
            let along = experiment.linearise_along(&p, &free, course.as_ref());
            assert_eq!(along.jacobian, linear.jacobian);
            let n = signals.len();
            let torque = experiment.torque_at(&p);
            let starts = experiment.starts.clone().unwrap();
            for k in free {
                let (mut speed, mut run) = (Run::new(n), Linearisation::zeros(n, 1));
                let (_, mut rows) = run.split_rows(0);
                let own = of_groups(&mut rows.columns, &[&[0]]).swap_remove(0);
                experiment.mechanical_pass::<4>((&p, &[k], &[0]), || &torque, &starts, Some(&mut speed), own);
                experiment.project(&speed, rows);
                let run = run.jacobian;
                let off = (linear.jacobian.column(k) - run.column(0)).norm();
                // The load is constant over a step there and over a sample here, and an instant acts within one sample only.
                let share = match k.checked_sub(count) {
                    Some(2) => 0.03,
                    _ if k == BaseParameter::J.index() => 3e-4,
                    _ => 1e-4,
                };
                assert!(off <= share * run.norm(), "{h} {k}: {off} of {}", run.norm());
            }
        }
    }

    /// Effects share the course of a rotor that none of them moves, and whichever thread comes first asks first.
    #[test]
    fn a_shared_course_tells_each_effect_the_same_whoever_asked_first() {
        let signals = reversing(1e-4, &(0.0..0.0));
        let windows = mechanical::windows(&signals);
        for base in [&[][..], &[EffectId::SaturationD], &[EffectId::LoadDependentFriction]] {
            let with = |more: &[EffectId]| Model::new(signals.context, &[base, more].concat());
            let point = |more: &[EffectId]| {
                let typical =
                    |e: &EffectId| e.info().parameters.iter().map(|x| (x.typical)(&signals.context));
                let mut p = vec![0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3];
                p.extend(base.iter().flat_map(typical));
                // Those that are scored have no strength.
                let scored = more.iter().flat_map(|e| e.info().parameters.iter().zip(typical(e)));
                p.extend(scored.map(|(x, typical)| if x.role == Role::Amplitude { 0.0 } else { typical }));
                p.push(0.3);
                p
            };
            let own = with(&[]);
            let fresh = || of_speed(&own, &signals, Nuisance::unknown(0, 0), &windows).course(&point(&[]));
            let scored = |effect: EffectId, course: Option<&Course>| {
                let (model, p) = (with(&[effect]), point(&[effect]));
                let experiment = of_speed(&model, &signals, Nuisance::unknown(0, 0), &windows);
                let free: Vec<usize> = (own.parameter_count()..model.parameter_count()).collect();
                experiment.linearise_along(&p, &free, course).jacobian
            };
            let all = ALL.iter().filter(|e| !base.contains(e));
            let alone: Vec<_> = all.clone().map(|e| scored(*e, fresh().as_ref())).collect();
            let (forwards, backwards) = (fresh(), fresh());
            let told: Vec<_> = all.clone().map(|e| scored(*e, forwards.as_ref())).collect();
            let mut back: Vec<_> = all.clone().rev().map(|e| scored(*e, backwards.as_ref())).collect();
            back.reverse();
            for (((effect, alone), told), back) in all.zip(alone).zip(told).zip(back) {
                assert_eq!(told, alone, "{effect:?} beside {base:?}");
                assert_eq!(back, alone, "{effect:?} beside {base:?}, asked the other way round");
            }
        }
    }

    #[test]
    fn samples_beside_one_another_have_the_bits_of_one_after_the_other() {
        let effects = [
            EffectId::AsymmetricFriction,
            EffectId::CoggingTorque,
            EffectId::StribeckFriction,
            EffectId::SaturationQ,
            EffectId::IronLoss,
            EffectId::EncoderEccentricity,
        ];
        // In steps of two samples and of one; segments that no vector fills, and windows that none divides.
        for (h, gap, length) in [
            (1e-4, 0.0..0.0, 2000),
            (4e-4, 0.31..0.7998, 130),
            (4e-4, 0.0..0.0, 5),
            (4e-4, 0.0063..1.0, 9),
            (4e-4, 0.0067..1.0, 17),
        ] {
            let mut signals = reversing(h, &gap);
            signals.stator_held = Some(crate::signals::Logged::Command);
            let cut = |s: &Range<usize>| {
                let end = s.end;
                s.clone().step_by(length).map(move |k| k..(k + length).min(end)).collect::<Vec<_>>()
            };
            let windows: Vec<_> = signals.segments.iter().flat_map(cut).collect();
            for effects in [&effects[..], &effects[..4], &[]] {
                let model = Model::new(signals.context, effects);
                let mut p = vec![0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3];
                for effect in effects {
                    p.extend(effect.info().parameters.iter().map(|x| (x.typical)(&signals.context)));
                }
                let last = p.len() - 1;
                p.push(0.3);
                let experiment = of_speed(&model, &signals, Nuisance::unknown(0, 0), &windows);
                let (torque, starts) = (experiment.torque_at(&p), experiment.starts.clone().unwrap());
                let speed = experiment.speed_pass(&p, &torque, &starts);
                let gains = experiment.gains(&p, &torque, &speed);
                let stations = Stations::new(&experiment.rotor(&p, Torque::Fixed(&torque), &p, &speed));
                let n = signals.len();
                // The flux and what else drives the motor; what the rotor has itself; what effects take from it.
                let driving = if effects.is_empty() { 1 } else { last };
                let mut asked = vec![(Kind::Torque, [3, driving]), (Kind::Rotor, [4, 5])];
                asked.extend((!effects.is_empty()).then_some((Kind::Loss, [6, 9])));
                for (kind, free) in asked {
                    let columns = |wide: bool, kind: Kind| {
                        let mut out = vec![vec![0.0; n]; 2];
                        let rows = out.iter_mut().map(|x| &mut x[..]).collect();
                        let at = (&p[..], &free[..], &[0, 1][..]);
                        // More derivatives than a vector holds of several samples.
                        match (kind, wide) {
                            (Kind::Torque, true) => {
                                experiment.torque_columns::<4>(at, (&gains, None), &speed, rows)
                            }
                            (Kind::Torque, false) => {
                                experiment.torque_columns::<5>(at, (&gains, None), &speed, rows)
                            }
                            (Kind::Loss, true) => experiment.loss_columns::<4>(at, &stations, &speed, rows),
                            (Kind::Loss, false) => experiment.loss_columns::<5>(at, &stations, &speed, rows),
                            (_, true) => experiment.rotor_columns::<4>(at, &torque, &speed, rows),
                            (_, false) => experiment.rotor_columns::<5>(at, &torque, &speed, rows),
                        }
                        out
                    };
                    let (wide, narrow) = (columns(true, kind), columns(false, kind));
                    let flux = mechanical::flux(&model, &signals, &p[..=last]);
                    assert_eq!(flux.is_some(), effects.len() == 4);
                    if let (Kind::Torque, Some(flux)) = (kind, &flux) {
                        // The same from a flux that is known.
                        let mut out = vec![vec![0.0; n]; 2];
                        let rows = out.iter_mut().map(|x| &mut x[..]).collect();
                        let at = (&p[..], &free[..], &[0, 1][..]);
                        experiment.torque_columns::<4>(at, (&gains, Some(flux)), &speed, rows);
                        let size = wide.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
                        for (one, known) in wide.iter().flatten().zip(out.iter().flatten()) {
                            assert!((one - known).abs() <= 1e-9 * size, "{one} {known}");
                        }
                    }
                    if kind == Kind::Loss {
                        // The same as if all effects are asked.
                        let all = columns(true, Kind::Rotor);
                        for (one, all) in wide.iter().flatten().zip(all.iter().flatten()) {
                            assert!((one - all).abs() <= 1e-10 * all.abs(), "{one} {all}");
                        }
                    }
                    let worth = narrow.iter().map(|c| c.iter().map(|x| x.abs()).sum::<f64>());
                    let worth: Vec<f64> = worth.collect();
                    assert!(
                        worth.iter().all(|x| *x > 0.0 && x.is_finite()),
                        "{h} {length} {kind:?} {worth:?}"
                    );
                    assert!(wide == narrow, "{h} {length} {kind:?} {effects:?}");
                }
            }
        }
    }
}
