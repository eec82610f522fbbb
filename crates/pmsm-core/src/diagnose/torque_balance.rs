//! A set of effects of the motion from the balance of torques along the measured course.
//!
//! > ∫τ_e dt = j·Δω_m + b·Δθ_m + ∫τ_load dt + Σ_k a_k·∫c_k dt,
//!
//! each integral from the beginning of a window and less its mean there. It is linear in j, b, a constant load and the strengths a_k.
//! Free run takes the torque as exact: the speed is off by what the model lacks. That misleads where a controller holds the speed,
//! as the torque then answers to whatever is missing, and the dq-model fits best with far too large an inertia. Here the speed is exact
//! and the torque errs, with the colour of what remains. See Swevers, Verdonck & De Schutter, "Dynamic model identification for industrial
//! robots", IEEE Control Systems 27 (5), 2007.

use super::adequacy;
use super::data::Data;
use super::decimation;
use super::evidence::{Evidence, price};
use super::fitting;
use super::hypothesis::Hypothesis;
use super::identifiability::identifiable;
use super::select::reduced;
use crate::effect::{Role, Site};
use crate::effects::EffectId;
use crate::error::Result;
use crate::machine::BaseParameter;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::noise::colour::Colour;
use crate::numerics::basis::{freed, orthonormal};
use crate::numerics::tall;
use crate::recording::{Kind, Load};
use crate::simulate::mechanical::{Nuisance, Rotor, Torque};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::ops::Range;

/// Rounds in which strengths and colour are estimated in turn.
const ROUNDS: usize = 2;
/// Effects in a row that do not help the simulation, after which no more are tried.
const IN_VAIN: usize = 2;

/// The set with most evidence, fitted by simulation, of those that grow by the balance of torques, its effects of the motion in place of
/// those of `set`. None where the balance does not apply or shows no effect.
///
/// # Errors
/// Those of the least-squares fits.
pub fn grown(data: &Data, set: &Hypothesis, monitor: &dyn Monitor) -> Result<Option<Hypothesis>> {
    let fewer = decimation::decimated(data, &[]).map(|found| found.0);
    let data = &fewer.as_ref().unwrap_or(data).roughly();
    let moving = set.effects().into_iter().filter(|e| e.info().site == Site::Mechanical);
    let (model, own) = moving.fold((set.model.clone(), set.own().to_vec()), |(model, own), effect| {
        reduced(&Hypothesis::unfitted(model, own), effect)
    });
    let shows =
        |run: &Data| run.has_mechanical() && matches!(run.signals.kind, Kind::Full | Kind::Mechanical);
    if !data.runs().iter().all(shows) || model.map().is_some() {
        return Ok(None);
    }
    let balance = Balance::new(data, &model, &own);
    let evidence = Evidence::new(data, &[]);
    let (identifiable, _) = identifiable(data);
    let asked = |e: &EffectId| applies(*e) && !amplitudes(*e, &model).is_empty();
    let candidates: Vec<EffectId> = identifiable.into_iter().filter(asked).collect();
    let cost = |set: &Hypothesis| evidence.cost_on_recording(set);
    let (mut best, mut chosen) = (fitting::fit(data, &model, &own, true, monitor)?, Vec::new());
    let mut in_vain = 0;
    while chosen.len() < data.options.most_effects && in_vain < IN_VAIN {
        monitor.go_on()?;
        let absent = candidates.iter().filter(|e| chosen.iter().all(|c: &Candidate| c.effect != **e));
        let Some(next) = balance.leading(&chosen, absent.copied()) else { break };
        chosen.push(next);
        let (model, start) = balance.start(&chosen);
        let fitted = fitting::fit(data, &model, &start, true, monitor)?;
        // A simulation may need several of them before it follows the motion: what the balance shows decides what comes next.
        in_vain += 1;
        if cost(&fitted) < cost(&best) {
            (best, in_vain) = (fitted, 0);
        }
    }
    Ok((best.effects() != model.effects()).then_some(best))
}

/// The grown set where it is a model of recordings of which the dq-model `base` is none. Their noise is then read with it.
///
/// # Errors
/// Those of the least-squares fits.
pub fn adequate(data: &mut Data, base: &mut Hypothesis, monitor: &dyn Monitor) -> Result<Option<Hypothesis>> {
    let Some(set) = grown(data, base, monitor)? else { return Ok(None) };
    let set = fitting::carried_over(data, &set, monitor)?;
    if adequacy::lack_of_fit(data, &set).is_some() || adequacy::contradicts_nameplate(data, &set) {
        return Ok(None);
    }
    data.settle_floors(&set);
    *base = fitting::refit(data, base, monitor)?;
    fitting::on_from(data, &set, monitor).map(Some)
}

/// Whether the torque of an effect is linear in its strength along a measured course.
fn applies(effect: EffectId) -> bool {
    effect.info().site == Site::Mechanical && effect.mechanical_state_count() == 0 && effect.is_first_order()
}

/// An effect with one of its shapes.
struct Candidate {
    effect: EffectId,
    shape: Vec<f64>,
    /// Integral of its torque per unit of each strength, N·m·s.
    columns: DMatrix<f64>,
}

/// The balance of the recordings for one model without effects of the motion.
struct Balance<'a> {
    data: &'a Data,
    model: &'a Model,
    own: &'a [f64],
    /// What drives the rotor, less a load that is known, N·m.
    driving: Vec<f64>,
    /// Its integral, N·m·s.
    impulse: DVector<f64>,
    /// Speed, angle and the levels of unknown loads: what j, b and each level are multiplied by.
    known: DMatrix<f64>,
    /// Windows that are not held out, over the rows of all recordings.
    windows: Vec<Range<usize>>,
}

impl<'a> Balance<'a> {
    fn new(data: &'a Data, model: &'a Model, own: &'a [f64]) -> Self {
        let torque = data.torque(model, own);
        let held_out = |k: usize| data.held_out.as_deref().is_some_and(|h| h[k]);
        let each = data.runs().iter().enumerate().flat_map(|(run, part)| {
            let first = data.samples_of(run).start;
            part.windows.iter().map(move |w| first + w.start..first + w.end)
        });
        let windows = each.filter(|w| !held_out(w.start)).collect();
        let mut balance = Self {
            data,
            model,
            own,
            driving: Vec::new(),
            impulse: DVector::zeros(0),
            known: DMatrix::zeros(0, 0),
            windows,
        };
        balance.driving = balance.driving_torque(model, own, &torque);
        balance.impulse = balance.integral(&balance.driving);
        let speeds =
            data.runs().iter().flat_map(|run| run.signals.omega_e.iter().map(|w| w / run.signals.n_p));
        let speed: Vec<f64> = speeds.collect();
        let mut known = vec![balance.about_mean(speed.clone()), balance.integral(&speed)];
        for (run, part) in data.runs().iter().enumerate() {
            if matches!(part.signals.load, Load::UnknownConstant | Load::UnknownPiecewise) {
                let rows = data.samples_of(run);
                let here: Vec<f64> =
                    (0..speed.len()).map(|k| f64::from(u8::from(rows.contains(&k)))).collect();
                known.push(balance.integral(&here));
            }
        }
        balance.known = DMatrix::from_columns(&known);
        balance
    }

    /// What accelerates a rotor without bearing friction, N·m: `torque` less known loads and the effects of `model`.
    fn driving_torque(&self, model: &Model, own: &[f64], torque: &[f64]) -> Vec<f64> {
        let mut p = own.to_vec();
        p[BaseParameter::B.index()] = 0.0;
        let j = own[BaseParameter::J.index()];
        let mut out = vec![0.0; torque.len()];
        for (run, part) in self.data.runs().iter().enumerate() {
            let samples = self.data.samples_of(run);
            let rotor = Rotor {
                model,
                signals: &part.signals,
                p: &p[..],
                tau_e: Torque::Fixed(&torque[samples.clone()]),
                load: (Nuisance::known(0), &[]),
                windows: &part.windows,
                shown: &part.signals.omega_e,
            };
            let (into, per) = (&mut out[samples], j / part.signals.n_p);
            rotor.accelerations(|window, here, _| {
                into[window.clone()].iter_mut().zip(here).for_each(|(out, a)| *out = a * per);
            });
        }
        out
    }

    /// The effect, by its best shape, for which beside the chosen ones the evidence is largest, if there is one.
    fn leading(&self, chosen: &[Candidate], absent: impl Iterator<Item = EffectId>) -> Option<Candidate> {
        let (colour, columns, residual) = self.whitened(chosen)?;
        let basis = orthonormal(&columns);
        let residual = freed(&basis, &DMatrix::from_columns(&[residual])).column(0).into_owned();
        let (rows, square) =
            (self.windows.iter().map(Range::len).sum::<usize>() as f64, residual.norm_squared());
        let (options, context) = (&self.data.options, self.model.context());
        let tried = absent.flat_map(|effect| {
            let probes = effect.probes(context);
            let forms = (probes.len().max(1) as f64).ln();
            probes.into_iter().map(move |shape| (effect, shape, forms))
        });
        let weighed = |(effect, shape, forms): (EffectId, Vec<f64>, f64)| {
            let candidate = self.candidate(effect, shape);
            let mut own = candidate.columns.clone();
            own.column_iter_mut().for_each(|mut column| self.whiten(&colour, column.as_mut_slice()));
            let own = freed(&basis, &own);
            let taken = self.taken(&candidate, &own, &residual);
            let cost = options.effect_cost + forms + price(&[rows], options) * own.ncols() as f64;
            let nats = 0.5 * rows * (square / (square - taken)).ln() - cost;
            (nats > 0.0).then_some((nats, candidate))
        };
        let better = |a: (f64, Candidate), b: (f64, Candidate)| if b.0 > a.0 { b } else { a };
        let tried: Vec<_> = tried.collect();
        tried.into_par_iter().filter_map(weighed).reduce_with(better).map(|(_, candidate)| candidate)
    }

    /// Squares of the `residual` that an effect takes away by strengths within their bounds, with its whitened columns.
    fn taken(&self, candidate: &Candidate, columns: &DMatrix<f64>, residual: &DVector<f64>) -> f64 {
        let Some(mut strengths) = solved(columns, residual) else { return 0.0 };
        let own = amplitudes(candidate.effect, self.model);
        for (x, k) in strengths.iter_mut().zip(own) {
            let parameter = &candidate.effect.info().parameters[k];
            *x = x.clamp((parameter.low)(self.model.context()), (parameter.high)(self.model.context()));
        }
        residual.norm_squared() - (residual - columns * strengths).norm_squared()
    }

    fn candidate(&self, effect: EffectId, shape: Vec<f64>) -> Candidate {
        let effects = [&self.model.effects()[..], &[effect]].concat();
        let model = Model::new(*self.model.context(), &effects);
        let idle = vec![0.0; self.driving.len()];
        let parameters = effect.info().parameters;
        let resting = |k: usize, x: f64| if parameters[k].role == Role::Amplitude { 0.0 } else { x };
        let still: Vec<f64> = shape.iter().enumerate().map(|(k, x)| resting(k, *x)).collect();
        let braked = |own: &[f64]| self.driving_torque(&model, &[self.own, own].concat(), &idle);
        let without = braked(&still);
        let columns: Vec<DVector<f64>> = amplitudes(effect, &model)
            .into_iter()
            .map(|k| {
                let mut own = still.clone();
                own[k] = (parameters[k].typical)(model.context());
                let per = 1.0 / own[k];
                let each = without.iter().zip(braked(&own)).map(|(without, with)| (without - with) * per);
                self.integral(&each.collect::<Vec<_>>())
            })
            .collect();
        Candidate { effect, shape, columns: DMatrix::from_columns(&columns) }
    }

    /// The colour of what the chosen effects leave, with the columns and the impulse whitened by it.
    fn whitened(&self, chosen: &[Candidate]) -> Option<(Colour, DMatrix<f64>, DVector<f64>)> {
        let all = self.all_columns(chosen);
        let mut strengths = solved(&all, &self.impulse)?;
        let mut found = None;
        for _ in 0..ROUNDS {
            let residual = &self.impulse - &all * &strengths;
            let colour = Colour::of(residual.as_slice(), &self.windows)?;
            let (mut columns, mut impulse) = (all.clone(), self.impulse.clone());
            columns.column_iter_mut().for_each(|mut column| self.whiten(&colour, column.as_mut_slice()));
            self.whiten(&colour, impulse.as_mut_slice());
            strengths = solved(&columns, &impulse)?;
            found = Some((colour, columns, impulse));
        }
        found
    }

    fn whiten(&self, colour: &Colour, x: &mut [f64]) {
        self.windows.iter().for_each(|window| colour.whiten(&mut x[window.clone()]));
    }

    fn all_columns(&self, chosen: &[Candidate]) -> DMatrix<f64> {
        let own = chosen.iter().flat_map(|c| c.columns.column_iter());
        DMatrix::from_columns(&self.known.column_iter().chain(own).collect::<Vec<_>>())
    }

    /// Model and parameters with the chosen effects: the start of a fit by simulation.
    fn start(&self, chosen: &[Candidate]) -> (Model, Vec<f64>) {
        let mut effects = self.model.effects();
        effects.extend(chosen.iter().map(|c| c.effect));
        let model = Model::new(*self.model.context(), &effects);
        let strengths = self.whitened(chosen).and_then(|(_, columns, impulse)| solved(&columns, &impulse));
        let strengths = strengths.unwrap_or_else(|| DVector::zeros(self.all_columns(chosen).ncols()));
        let mut start = self.own.to_vec();
        for (p, x) in [BaseParameter::J, BaseParameter::B].into_iter().zip(strengths.iter()) {
            // Noise of the speed may hide an inertia, and some of the friction: then what is known of them is the start.
            let known = &self.data.prior;
            let (low, high) = p.physical_range();
            let far =
                known.iter().any(|prior| prior.index == p.index() && prior.off(*x).0.abs() > adequacy::FAR);
            start[p.index()] = if *x > low && *x < high && !far { *x } else { self.data.start[p.index()] };
        }
        let mut at = self.known.ncols();
        for candidate in chosen {
            let (mut own, context) = (candidate.shape.clone(), model.context());
            for k in amplitudes(candidate.effect, &model) {
                let parameter = &candidate.effect.info().parameters[k];
                own[k] = strengths[at].clamp((parameter.low)(context), (parameter.high)(context));
                at += 1;
            }
            start.extend(own);
        }
        (model, start)
    }

    /// Integral over each window by the trapezoidal rule, less its mean there; zero elsewhere.
    fn integral(&self, rates: &[f64]) -> DVector<f64> {
        let mut out = vec![0.0; rates.len()];
        for (run, part) in self.data.runs().iter().enumerate() {
            let (first, t) = (self.data.samples_of(run).start, &part.signals.t);
            for window in &part.windows {
                for k in window.start + 1..window.end {
                    let (at, h) = (first + k, t[k] - t[k - 1]);
                    out[at] = out[at - 1] + 0.5 * h * (rates[at] + rates[at - 1]);
                }
            }
        }
        self.about_mean(out)
    }

    fn about_mean(&self, x: Vec<f64>) -> DVector<f64> {
        let mut out = DVector::zeros(x.len());
        for window in &self.windows {
            let mean = x[window.clone()].iter().sum::<f64>() / window.len().max(1) as f64;
            window.clone().for_each(|k| out[k] = x[k] - mean);
        }
        out
    }
}

/// Parameters of an effect that carry its strength and are fitted.
fn amplitudes(effect: EffectId, model: &Model) -> Vec<usize> {
    let parameters = effect.info().parameters;
    let carries = |k: &usize| parameters[*k].role == Role::Amplitude && effect.fitted(model.context(), *k);
    (0..parameters.len()).filter(carries).collect()
}

/// Least-squares solution, in units of each column.
fn solved(columns: &DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let gram = tall::gram(columns);
    let scale: Vec<f64> =
        gram.diagonal().iter().map(|x| 1.0 / x.sqrt().max(f64::MIN_POSITIVE.sqrt())).collect();
    let along = tall::tr_mul_vector(columns, right);
    let unit = DMatrix::from_fn(scale.len(), scale.len(), |r, c| gram[(r, c)] * scale[r] * scale[c]);
    let right = DVector::from_fn(scale.len(), |k, _| along[k] * scale[k]);
    let found = unit.pseudo_inverse(1e-10).ok()? * right;
    Some(DVector::from_fn(scale.len(), |k, _| found[k] * scale[k]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::answer::Answer;
    use crate::diagnose::diagnose;
    use crate::diagnose::testing::{choice, data, setup, speeds};
    use crate::drive::Choice;
    use crate::experiment::Channel;
    use crate::machine::Machine;
    use crate::monitor::Silent;
    use crate::numerics::random::normal_pair;
    use crate::recording::Recording;

    fn found(effects: Vec<Choice>) -> Option<Hypothesis> {
        let manoeuvre = speeds(1.5, &[(0.1, 60.0), (0.5, -50.0), (0.9, 70.0), (1.2, -20.0)]);
        let (data, base) = data(&setup(manoeuvre, effects));
        grown(&data, &base, &Silent).unwrap()
    }

    #[test]
    fn missing_torques_are_found_with_the_inertia() {
        let set = found(vec![choice("coulomb_friction", "tau_c", 0.8), choice("cogging_torque", "a_1", 0.6)]);
        let set = set.unwrap();
        assert!(set.effects().contains(&EffectId::CoggingTorque), "{:?}", set.effects());
        let truth = setup(speeds(0.1, &[(0.0, 1.0)]), Vec::new()).machine.get(BaseParameter::J).unwrap();
        let j = set.own()[BaseParameter::J.index()];
        assert!((j / truth - 1.0).abs() < 0.05, "{j} {truth}");
        assert!(set.square(Channel::OmegaE) < 1.5, "{:?}", set.squares);
    }

    #[test]
    fn nothing_is_found_where_nothing_is_missing() {
        assert!(found(Vec::new()).is_none());
    }

    /// An arm of 20 kg m² that a controller moves through part of a turn, with a torque sensor whose noise moves it more than the speed's own.
    fn arm(tau_g: f64, tau_c: f64) -> Answer {
        let t: Vec<f64> = (0..1000).map(|k| 0.01 * f64::from(k)).collect();
        // Two swings: angle, speed and acceleration.
        let swings = [(0.9, 0.9, 0.3), (0.4, 2.3, 1.1)];
        let sum =
            |of: &dyn Fn(f64, f64, f64) -> f64| swings.iter().map(|(a, w, p)| of(*a, *w, *p)).sum::<f64>();
        let noise = |k: usize| normal_pair(5, [k as u32, 0, 0, 0]);
        let angle = |t: f64| sum(&|a, w, p| a * (w * t + p).sin());
        let speed = |t: f64| sum(&|a, w, p| a * w * (w * t + p).cos());
        let torque = |t: f64| {
            let accelerating = 20.0 * sum(&|a, w, p| -a * w * w * (w * t + p).sin());
            accelerating + 5.0 * speed(t) + tau_g * angle(t).cos() + tau_c * (speed(t) / 0.01).tanh()
        };
        let of =
            |x: &dyn Fn(usize, f64) -> f64| t.iter().enumerate().map(|(k, t)| x(k, *t)).collect::<Vec<_>>();
        let columns = vec![
            ("t".to_string(), t.clone()),
            ("theta_m".into(), of(&|_, t| angle(t))),
            ("omega_m".into(), of(&|k, t| speed(t) + 0.002 * noise(k).0)),
            ("tau_e".into(), of(&|k, t| torque(t) + 3.0 * noise(k).1)),
        ];
        let recording = Recording::new(columns, Some(Load::UnknownConstant)).unwrap();
        diagnose(&[&recording], &Machine::new(1).unwrap(), None, &Default::default(), &Silent).unwrap()
    }

    #[test]
    fn gravity_and_friction_of_an_arm_whose_torque_answers_to_them_are_named() {
        let answer = arm(-140.0, 26.0);
        let effects = &answer.model.effects;
        assert!(
            ["gravity_torque", "coulomb_friction"].iter().all(|e| effects.contains(&(*e).to_string())),
            "{:?} {:?} {:?}",
            answer.verdict,
            answer.ranking,
            answer.remaining
        );
        let j = answer.model.base["j"].value.unwrap();
        assert!((j / 20.0 - 1.0).abs() < 0.2, "{j}");
        assert_eq!(arm(0.0, 0.0).model.effects, Vec::<String>::new());
    }
}
