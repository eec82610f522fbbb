//! What a recording would have shown: for each absent effect the chance that it had been found at its typical strength, and
//! how far it resembles the effects that were found. What an effect adds to a special case of it that was found is taken to be of the
//! found one's size.
//!
//! Both follow from the recording's own Gram matrix. An effect of typical strength would add the mean square Δ_c² to channel
//! c, freed of what all fitted parameters can do and in units of what is left there. The diagnosis counts that as
//!
//! > g = Σ_c ½·w_c·ln(1 + Δ_c²) nats,  with the standard deviation  (Σ_c w_c²·Δ_c²/(n_c·(1 + Δ_c²)²) + ½·k·max_c w_c/n_c)^½,
//!
//! w_c being what the channel is worth, n_c its independent samples and k the effect's parameters; for w_c = n_c and a small
//! Δ_c this is half a noncentral χ² with the noncentrality Σ_c n_c·Δ_c² (Kay, "Fundamentals of statistical signal
//! processing: detection theory", 1998, section 6.5). The power is the probability that g exceeds what an effect must gain.

mod absorbed;
mod products;
mod shapes;
mod words;

use super::data::Data;
use super::evidence::price;
use super::hypothesis::Hypothesis;
use super::locate::upper_tail;
use super::options::DiagnosisOptions;
use super::score::{Scorer, batches, solve};
use super::verdict;
use crate::effect::Role;
use crate::effects::EffectId;
use crate::error::Result;
use crate::experiment::{Block, Channel};
use crate::machine::BaseParameter;
use crate::monitor::Monitor;
use crate::numerics::basis::{freed, orthonormal, orthonormal_beside};
use absorbed::Fitted;
use nalgebra::{DMatrix, DVector};
use products::{Known, Products, Sum};
use rayon::prelude::*;
use shapes::{Look, Strengths, Strongest};
use std::ops::Range;

pub use words::cannot_see;

/// Power below which an effect is listed as one that the recording would not show.
pub const EVEN: f64 = 0.5;

/// What this recording would show of one absent effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// The effect.
    pub effect: EffectId,
    /// Probability that it had been found at its typical strength, or at that of its special case, on average over its shapes.
    pub power: f64,
    /// Root mean square that it would add in its strongest channel, in units of what is left there: before and after the
    /// fitted parameters absorb what they can.
    pub size: (f64, f64),
    /// That of the form in which it shows least.
    pub least: f64,
    /// Probability that it had been found at its typical strength in the form in which it shows most.
    pub at_best: f64,
    /// That channel.
    pub channel: Channel,
    /// Fitted parameters that absorb most of it.
    pub absorbed_by: Vec<String>,
    /// For each found effect that it could replace: how much of that effect's trace it reproduces within its own
    /// physical bounds (cosine), and by how many nats it would still lose.
    pub likeness: Vec<(EffectId, f64, f64)>,
}

impl Shown {
    /// How much of a found effect's trace this one reproduces within its bounds; all of it where that is not known.
    pub fn cosine(&self, found: EffectId) -> f64 {
        self.likeness.iter().find(|(e, ..)| *e == found).map_or(1.0, |(_, cosine, _)| *cosine)
    }
}

/// What a found effect adds to the residual.
struct Found {
    effect: EffectId,
    /// Numbers of the known columns that are an orthonormal basis of what only its parameters can do.
    alone: Range<usize>,
    /// Number of that which holds what it adds, freed of what the other parameters can do.
    trace: usize,
    /// Its largest strength, in units of the typical one.
    size: f64,
}

/// The fitted set, its residual and the columns with which each absent effect is compared.
struct Survey<'a> {
    scorer: Scorer<'a>,
    best: &'a Hypothesis,
    worth: &'a [f64],
    poor: bool,
    options: DiagnosisOptions,
    fitted: Fitted,
    known: Known,
    found: Vec<Found>,
}

/// A figure of each effect of a set.
pub type OfEach = [(EffectId, f64)];

/// A fitted set with what each of its effects does to the residual.
pub struct Traces<'a> {
    data: &'a Data,
    scorer: Scorer<'a>,
    best: &'a Hypothesis,
    each: Vec<Trace>,
}

impl<'a> Traces<'a> {
    /// Of the set `best`, fitted to `data`.
    pub fn new(data: &'a Data, best: &'a Hypothesis) -> Self {
        let scorer = Scorer::new(data, best);
        let (jacobian, _) = scorer.fitted();
        let left = scorer.experiment().residual(&best.parameters);
        let each = best.effects().par_iter().map(|e| trace(&scorer, best, *e, jacobian, &left)).collect();
        Self { data, best, each, scorer }
    }

    /// Gain of each effect to first order, nats, all other parameters refitted. `samples` is what each channel counts.
    pub fn worth(&self, samples: &[f64]) -> Vec<(EffectId, f64)> {
        let blocks = self.scorer.experiment().blocks();
        let of = |Trace { trace, .. }: &Trace| {
            let nats = |(block, n): (&Block, &f64)| {
                let rows = trace.rows(block.rows.start, block.rows.len());
                0.5 * n * (rows.norm_squared() / block.counted.max(1) as f64).ln_1p()
            };
            blocks.iter().zip(samples).map(nats).sum()
        };
        self.best.effects().into_iter().zip(self.each.iter().map(of)).collect()
    }

    /// Excess mean square that each effect explains to first order over the one that is left, summed over the channels.
    pub fn over_remainder(&self) -> Vec<(EffectId, f64)> {
        let blocks = self.scorer.experiment().blocks();
        let left: f64 = verdict::beyond_chance(self.best).map(|x| x.max(0.0)).sum();
        let of = |Trace { trace, .. }: &Trace| {
            let explained = |(block, (_, square)): (&Block, &(Channel, f64))| {
                let rows = trace.rows(block.rows.start, block.rows.len());
                rows.norm_squared() / block.counted.max(1) as f64 * square.max(1.0)
            };
            let all: f64 = blocks.iter().zip(&self.best.squares).map(explained).sum();
            all / left.max(f64::MIN_POSITIVE)
        };
        self.best.effects().into_iter().zip(self.each.iter().map(of)).collect()
    }

    /// What the recording would have shown of each of `absent` beside the effects of the set. `worth` is what each channel counts,
    /// in independent samples; a `poor` recording must show a mismatch before anything is looked for.
    ///
    /// # Errors
    /// [`Error::Interrupted`](crate::error::Error::Interrupted).
    pub fn survey(
        self,
        absent: &[EffectId],
        worth: &[f64],
        poor: bool,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Shown>> {
        monitor.go_on()?;
        let Self { data, scorer, best, each } = self;
        let blocks = scorer.experiment().blocks();
        let (jacobian, basis) = scorer.fitted();
        let (mut found, mut columns) = (Vec::new(), Vec::new());
        let mut at = basis.ncols();
        for (effect, Trace { alone, trace, size }) in best.effects().into_iter().zip(each) {
            let end = at + alone.ncols();
            found.push(Found { effect, alone: at..end, trace: end, size });
            at = end + 1;
            columns.extend([alone, trace]);
        }
        let fitted = Fitted::new(jacobian, basis);
        let known = Known::new(basis.clone(), &columns, blocks);
        let survey = Survey { scorer, best, worth, poor, options: data.options, fitted, known, found };
        let shown: Result<Vec<Option<Shown>>> =
            absent.par_iter().map(|effect| survey.shown(*effect, monitor)).collect();
        Ok(shown?.into_iter().flatten().collect())
    }
}

/// What a found effect does to the residual.
struct Trace {
    /// Orthonormal basis of what only its parameters can do.
    alone: DMatrix<f64>,
    /// What it adds, freed of what the other parameters can do, in one column.
    trace: DMatrix<f64>,
    /// Its largest strength, in units of the typical one.
    size: f64,
}

fn trace(
    scorer: &Scorer,
    best: &Hypothesis,
    effect: EffectId,
    jacobian: &DMatrix<f64>,
    left: &DVector<f64>,
) -> Trace {
    let slot =
        best.model.slots().iter().find(|s| s.effect == effect).expect("an effect of the model has a slot");
    let (own, kept): (Vec<usize>, Vec<usize>) =
        (0..best.free.len()).partition(|k| slot.parameters.contains(&best.free[*k]));
    let others = orthonormal(&jacobian.select_columns(&kept));
    let alone = orthonormal_beside(&others, &jacobian.select_columns(&own));
    let mut without = best.parameters.clone();
    let mut size = 0.0f64;
    for (parameter, index) in effect.info().parameters.iter().zip(slot.parameters.clone()) {
        if parameter.role == Role::Amplitude {
            size = size.max((best.parameters[index] / (parameter.typical)(best.model.context())).abs());
            without[index] = 0.0;
        }
    }
    let freed_of_others = |step: DVector<f64>| freed(&others, &DMatrix::from_columns(&[step]));
    let mut trace = freed_of_others(left - scorer.experiment().residual(&without));
    let moved = own.iter().map(|k| best.parameters[best.free[*k]] - without[best.free[*k]]);
    let linear = freed_of_others(jacobian.select_columns(&own) * DVector::from_iterator(own.len(), moved));
    // Without the effect the rotor may move further than the linearised model holds. The smaller of both traces is then the first-order
    // one.
    if linear.norm_squared() < trace.norm_squared() {
        trace = linear;
    }
    if trace.iter().any(|x| !x.is_finite()) {
        // Without the effect the model cannot be evaluated: nothing can replace it.
        trace.fill(0.0);
    }
    Trace { alone, trace, size }
}

impl Survey<'_> {
    fn shown(&self, effect: EffectId, monitor: &dyn Monitor) -> Result<Option<Shown>> {
        let context = self.best.model.context();
        let parameters = effect.info().parameters;
        let amplitudes = self.scorer.amplitudes(effect);
        let special = self.found.iter().filter(|f| effect.contains(f.effect));
        let share = special.map(|f| f.size).fold(1.0, f64::min);
        let typical = DVector::from_iterator(
            amplitudes.len(),
            amplitudes.iter().map(|k| (parameters[*k].typical)(context)),
        );
        let bounds =
            amplitudes.iter().map(|k| &parameters[*k]).map(|p| ((p.low)(context), (p.high)(context)));
        let strengths = Strengths { typical, bounds: bounds.collect(), share };
        let probes = effect.probes(context);
        let together: Vec<&[Vec<f64>]> = batches(&probes, amplitudes.len()).collect();
        let look = |shapes| {
            monitor.go_on()?;
            Ok(self.look(effect, &strengths, shapes))
        };
        let looks: Vec<Option<Look>> = together.into_par_iter().map(look).collect::<Result<_>>()?;
        let nothing = Look::nothing(self.found.len());
        let look = looks.into_iter().try_fold(nothing, |all, next| next.map(|next| all.and(next)));
        let Some(look) = look else { return Ok(None) };
        let Some(Strongest { at, before, after, along }) = look.strongest else { return Ok(None) };
        let power = look.powers.iter().fold(0.0, |sum, power| sum + power / probes.len() as f64);
        let found = self.found.iter().zip(look.likeness);
        let likeness = found.map(|(found, (cosine, nats))| (found.effect, cosine, nats)).collect();
        Ok(Some(Shown {
            effect,
            power,
            size: (share * before.sqrt(), share * after.sqrt()),
            least: share * look.least,
            at_best: look.at_best,
            channel: self.known.blocks()[at].channel,
            absorbed_by: self
                .fitted
                .absorbing(&along)
                .into_iter()
                .map(|k| self.name(self.best.free[k]))
                .collect(),
            likeness,
        }))
    }

    fn power(&self, squares: &[f64], count: usize) -> f64 {
        let (mut gain, mut variance, mut share) = (0.0, 0.0, 0.0f64);
        for ((square, worth), samples) in squares.iter().zip(self.worth).zip(&self.best.samples) {
            let (samples, total) = (samples.max(*worth), 1.0 + square);
            gain += 0.5 * worth * total.ln();
            variance += worth * worth * square / (samples * total * total);
            share = share.max(worth / samples);
        }
        let options = &self.options;
        let needed = options.effect_cost + options.decisive + price(self.worth, options) * count as f64;
        let spread = (variance + 0.5 * count as f64 * share).sqrt();
        let power = upper_tail((needed - gain) / spread.max(f64::MIN_POSITIVE));
        if self.poor && squares.iter().all(|x| *x <= options.mismatch) { 0.0 } else { power }
    }

    /// How much of a found effect's trace another's columns reproduce within bounds, and what they would lose against it.
    fn likeness(&self, found: &Found, products: &Products, bounds: &[(f64, f64)]) -> (f64, f64) {
        let (count, trace) = (bounds.len(), products.known(found.trace));
        let one = |k: usize| products.others(&DVector::from_fn(count, |x, _| f64::from(u8::from(x == k))));
        let columns: Vec<Sum> = (0..count).map(one).collect();
        let free: Vec<Sum> = columns.iter().map(|c| products.freed_but(c, &found.alone)).collect();
        let whole = products.dot(&trace, &trace);
        let gram = DMatrix::from_fn(count, count, |a, b| products.dot(&free[a], &free[b]));
        let right = DVector::from_fn(count, |k, _| products.dot(&free[k], &trace));
        let length: Vec<f64> = columns.iter().map(|c| products.dot(c, c).sqrt()).collect();
        let Some(step) = solve(&gram, &right, &length).filter(|_| whole > 0.0) else {
            return (0.0, f64::INFINITY);
        };
        let bounded = |k: usize| step[k].clamp(bounds[k].0, bounds[k].1);
        let rest = free.iter().enumerate().fold(trace, |rest, (k, free)| rest - free * bounded(k));
        let cosine = (1.0 - products.dot(&rest, &rest) / whole).clamp(0.0, 1.0).sqrt();
        let squares = products.squares(&rest);
        let nats: f64 = squares.iter().zip(self.worth).map(|(s, w)| 0.5 * w * (1.0 + s).ln()).sum();
        (cosine, nats)
    }

    fn name(&self, index: usize) -> String {
        let model = &self.best.model;
        if let Some(p) = BaseParameter::ALL.get(index) {
            return p.name().into();
        }
        let Some(slot) = model.slots().iter().find(|s| s.parameters.contains(&index)) else {
            return "unknown load".into();
        };
        let parameter = &slot.effect.info().parameters[index - slot.parameters.start];
        format!("{} of {}", parameter.name, slot.effect.id())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::fitting;
    use crate::diagnose::testing::{choice, data, fitted, narrow, setup, speeds};
    use crate::drive::Schedule;
    use crate::model::Model;
    use crate::monitor::Silent;

    const ASKED: [EffectId; 4] =
        [EffectId::CoulombFriction, EffectId::QuadraticDrag, EffectId::CoggingTorque, EffectId::SaturationQ];

    fn worth(best: &Hypothesis) -> Vec<f64> {
        vec![200.0; best.squares.len()]
    }

    fn power(shown: &[Shown], effect: EffectId) -> f64 {
        shown.iter().find(|s| s.effect == effect).unwrap().power
    }

    /// Whether an effect does nearly all that the found one does, for little less evidence.
    fn resembles(shown: &Shown, found: EffectId) -> bool {
        let (_, cosine, nats) = shown.likeness.iter().find(|(e, ..)| *e == found).unwrap();
        *cosine > 0.95 && *nats < DiagnosisOptions::default().decisive
    }

    #[test]
    fn reversals_show_what_one_speed_hides() {
        let (poor, base) = data(&setup(narrow(), Vec::new()));
        let hidden = Traces::new(&poor, &base).survey(&ASKED, &worth(&base), false, &Silent).unwrap();
        assert!(power(&hidden, EffectId::CoulombFriction) < 0.1, "{hidden:?}");
        let rich = speeds(1.0, &[(0.1, 100.0), (0.4, -100.0), (0.6, -100.0), (0.9, 100.0)]);
        let (rich, base) = data(&setup(rich, Vec::new()));
        let seen = Traces::new(&rich, &base).survey(&ASKED, &worth(&base), false, &Silent).unwrap();
        assert!(power(&seen, EffectId::CoulombFriction) > 0.9, "{seen:?}");
    }

    #[test]
    fn what_another_parameter_makes_up_for_is_worth_nothing_however_strong_it_is() {
        let mut manoeuvre = speeds(1.0, &[(0.1, 80.0), (0.4, -80.0), (0.6, -60.0), (0.9, 90.0)]);
        manoeuvre.tau_load = Some(Schedule::constant(1.0).unwrap());
        manoeuvre.load_kind = Some("unknown_constant".into());
        let (data, base) = data(&setup(manoeuvre, vec![choice("coulomb_friction", "tau_c", 0.8)]));
        let dry = fitted(&data, &base, EffectId::CoulombFriction);
        let effects = [EffectId::CoulombFriction, EffectId::AsymmetricFriction];
        let typical = effects[1].info().parameters.iter().map(|p| (p.typical)(&data.signals.context));
        let start: Vec<f64> = dry.own().iter().copied().chain(typical).collect();
        let model = Model::new(data.signals.context, &effects);
        let mut both = fitting::fit(&data, &model, &start, false, &Silent).unwrap();
        // A friction that always pushes back is a load by another name.
        let place = effects[1].info().parameters.iter().position(|p| p.name == "tau_a").unwrap();
        let (tau_a, tau_load) = (both.model.slots()[1].parameters.start + place, both.own().len());
        both.parameters[tau_a] -= 2.0;
        both.parameters[tau_load] += 2.0;
        let worth = Traces::new(&data, &both).worth(&worth(&both));
        assert!(worth[0].1 > 60.0 && worth[1].1 < 10.0, "{worth:?}");
    }

    #[test]
    fn what_absorbs_a_hidden_effect_is_named() {
        let (poor, base) = data(&setup(narrow(), Vec::new()));
        let hidden = Traces::new(&poor, &base)
            .survey(&[EffectId::CoulombFriction], &worth(&base), false, &Silent)
            .unwrap();
        assert!(hidden[0].size.1 < 0.5 * hidden[0].size.0);
        assert!(hidden[0].absorbed_by.contains(&"b".to_string()), "{hidden:?}");
        assert!(hidden[0].why(&[]).contains("the fitted b"), "{}", hidden[0].why(&[]));
    }

    #[test]
    fn look_alikes_are_found_without_being_fitted() {
        let effects = vec![choice("coulomb_friction", "tau_c", 1.0)];
        let (poor, base) = data(&setup(narrow(), effects.clone()));
        let best = fitted(&poor, &base, EffectId::CoulombFriction);
        let asked = [EffectId::AsymmetricFriction, EffectId::CoggingTorque];
        let shown = Traces::new(&poor, &best).survey(&asked, &worth(&best), false, &Silent).unwrap();
        assert!(resembles(&shown[0], EffectId::CoulombFriction), "{shown:?}");
        assert!(!resembles(&shown[1], EffectId::CoulombFriction), "{shown:?}");
        let rich = speeds(1.0, &[(0.1, 100.0), (0.4, -100.0), (0.6, -100.0), (0.9, 100.0)]);
        let (rich, base) = data(&setup(rich, effects));
        let best = fitted(&rich, &base, EffectId::CoulombFriction);
        let shown = Traces::new(&rich, &best).survey(&asked, &worth(&best), false, &Silent).unwrap();
        assert!(!resembles(&shown[0], EffectId::CoulombFriction), "{shown:?}");
    }

    #[test]
    fn a_generalisation_that_adds_nothing_here_cannot_be_excluded() {
        let effects = vec![choice("coulomb_friction", "tau_c", 1.0)];
        let (data, base) = data(&setup(narrow(), effects));
        let best = fitted(&data, &base, EffectId::CoulombFriction);
        let shown = Traces::new(&data, &best)
            .survey(&[EffectId::StribeckFriction], &worth(&best), false, &Silent)
            .unwrap();
        assert!(shown[0].power < 0.5, "{shown:?}");
        let why = shown[0].why(&[EffectId::CoulombFriction]);
        assert!(why.contains("special case") && why.contains("cannot be excluded"), "{why}");
    }

    #[test]
    fn what_a_generalisation_adds_is_of_the_size_of_what_was_found() {
        let power = |tau_c: f64| {
            let rich = speeds(1.0, &[(0.1, 100.0), (0.4, -100.0), (0.6, -100.0), (0.9, 100.0)]);
            let (data, base) = data(&setup(rich, vec![choice("coulomb_friction", "tau_c", tau_c)]));
            let best = fitted(&data, &base, EffectId::CoulombFriction);
            Traces::new(&data, &best)
                .survey(&[EffectId::StribeckFriction], &worth(&best), false, &Silent)
                .unwrap()[0]
                .power
        };
        let (large, small) = (power(3.0), power(0.02));
        assert!(large > 0.3 && small < 0.1, "{large} {small}");
    }

    #[test]
    fn an_answer_lists_what_it_would_have_missed_and_what_it_cannot_tell_apart() {
        use crate::diagnose::answer::Verdict;
        use crate::drive::simulate;
        let setup = setup(narrow(), vec![choice("coulomb_friction", "tau_c", 1.0)]);
        let recording = simulate(&setup, &Silent).unwrap().recording;
        let answer =
            crate::diagnose::diagnose(&[&recording], &setup.nameplate, None, &Default::default(), &Silent)
                .unwrap();
        assert_ne!(answer.verdict, Verdict::Named, "{:?}", answer.model);
        if answer.verdict == Verdict::Ambiguous {
            assert!(answer.next_experiment.is_some());
        }
        assert!(answer.cannot_see.iter().all(|u| u.power < EVEN && !u.why.is_empty()));
        assert!(answer.cannot_see.windows(2).all(|w| w[0].power <= w[1].power));
        assert!(answer.cannot_see.iter().all(|u| !answer.model.effects.contains(&u.effect)));
    }
}
