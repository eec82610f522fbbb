//! Parameters of a fitted hypothesis with their uncertainties.

mod covariance;
mod interval;

use super::answer::{Covariance, Estimate, Z95};
use super::collinearity::{self, Collinearity};
use super::data::Data;
use super::hypothesis::Hypothesis;
use crate::base::Base;
use crate::effect::{Role, Site};
use crate::effects::EffectId;
use crate::machine::BaseParameter;
use crate::numerics::dual::Dual;
use covariance::finite;
use interval::{estimate, shown, signed, within_errors};
use nalgebra::DMatrix;
use std::collections::BTreeMap;

/// Parameters that one effect's outputs may depend on.
const LANES: usize = 8;
/// The form of an effect's equation is itself an approximation: against plants that have the same physics in other forms its
/// parameters scatter by this factor more than the residuals say, and by the share of its strength that the effect states. Read off
/// the independent plant in `proof/`.
pub const FORM: f64 = 1.5;
/// Share of its value by which a base parameter scatters against independent plants, however little noise there is: rows show voltage, current
/// and angle at instants, and what happens between them is interpolated. With this and [`FORM`], 305 of 321 intervals of 95 % hold the
/// truth: `python -m proof --split calibration --families singles,pairs --cases 44 --seed 7301` and `--families clean --cases 24 --seed 7101`.
const BETWEEN_ROWS: f64 = 1e-4;

/// Uncertainty of a fitted hypothesis on its recording.
pub struct Outputs<'a> {
    data: &'a Data,
    hypothesis: &'a Hypothesis,
    free: Vec<usize>,
    covariance: DMatrix<f64>,
}

impl<'a> Outputs<'a> {
    /// Works out the covariance of the fitted parameters.
    pub fn new(data: &'a Data, hypothesis: &'a Hypothesis) -> Self {
        let (free, covariance) = covariance::of_parameters(data, hypothesis);
        Self { data, hypothesis, free, covariance }
    }

    /// Parameters of effects that this recording hardly separates from base parameters.
    pub fn ties(&self) -> Vec<Collinearity> {
        collinearity::collinear(self.hypothesis, &self.free, &self.covariance, FORM)
    }

    fn variance_of(&self, a: usize, b: usize) -> f64 {
        let place = |index: usize| self.free.iter().position(|f| *f == index);
        match (place(a), place(b)) {
            (Some(a), Some(b)) => self.covariance[(a, b)],
            _ => 0.0,
        }
    }

    /// Base parameters by name, an unknown load with them: `tau_load`, or its levels and instants; `_of_2` is that of the second
    /// recording.
    pub fn base(&self) -> BTreeMap<String, Estimate> {
        let mut load = Vec::new();
        let mut first = self.hypothesis.own().len();
        let nuisances = &self.hypothesis.nuisances;
        for (run, nuisance) in nuisances.iter().enumerate() {
            let of = self.data.number(run).map_or(String::new(), |number| format!("_of_{number}"));
            let mut push = |name: String, index: usize, unit: &str| {
                let value = self.hypothesis.parameters[index];
                load.push((name, estimate(value, self.variance_of(index, index), unit, None)));
            };
            for k in 0..nuisance.levels {
                let number = if nuisance.levels > 1 { format!("_{}", k + 1) } else { String::new() };
                push(format!("tau_load{number}{of}"), first + k, "N m");
            }
            for k in 0..nuisance.steps() {
                push(format!("t_load_{}{of}", k + 1), first + nuisance.levels + k, "s");
            }
            first += nuisance.parameter_count();
        }
        let base = self.base_parameters();
        base.into_iter().chain(load).collect()
    }

    /// Covariance of the base parameters and of the effects' own parameters that were estimated, widened as their intervals are.
    pub fn covariance(&self) -> Covariance {
        let model = &self.hypothesis.model;
        let form = if model.slots().is_empty() { 1.0 } else { FORM };
        let base = BaseParameter::ALL.into_iter().map(|p| (p.index(), p.name().to_string(), BETWEEN_ROWS));
        let own = model.slots().iter().flat_map(|slot| {
            let named = slot.parameters.clone().zip(slot.effect.info().parameters);
            named.map(|(index, info)| {
                let share = if info.role == Role::Amplitude { slot.effect.form() } else { 0.0 };
                (index, format!("{}.{}", slot.effect.id(), info.name), share)
            })
        });
        let told: Vec<(usize, String, f64)> = base.chain(own).filter(|x| self.free.contains(&x.0)).collect();
        let entry = |a: &(usize, String, f64), b: &(usize, String, f64)| {
            let scattered = self.variance_of(a.0, b.0) * form * form;
            let more = if a.0 == b.0 { (a.2 * self.hypothesis.parameters[a.0]).powi(2) } else { 0.0 };
            Some(scattered + more).filter(|x| x.is_finite())
        };
        Covariance {
            matrix: told.iter().map(|a| told.iter().map(|b| entry(a, b)).collect()).collect(),
            values: told.iter().map(|x| self.hypothesis.parameters[x.0]).collect(),
            names: told.into_iter().map(|x| x.1).collect(),
        }
    }

    fn base_parameters(&self) -> BTreeMap<String, Estimate> {
        BaseParameter::ALL
            .iter()
            .filter(|p| self.data.needs(**p))
            .map(|p| {
                let index = p.index();
                let value = self.hypothesis.parameters[index];
                let why = if self.free.contains(&index) {
                    None
                } else {
                    Some("held at the nameplate value: the recording does not contain it".to_string())
                };
                // Base parameters absorb part of the error in the form of the effects that they are fitted with.
                let form = if self.hypothesis.effects().is_empty() { 1.0 } else { FORM };
                let mut variance =
                    self.variance_of(index, index) * form * form + (BETWEEN_ROWS * value).powi(2);
                if *p == BaseParameter::RS {
                    let psi_m = self.hypothesis.parameters[BaseParameter::PsiM.index()];
                    let clock = self.data.runs().iter().filter_map(|run| run.signals.clock_error(psi_m));
                    variance += clock.fold(0.0, f64::max).powi(2);
                }
                let low = p.physical_range().0;
                let mut estimate = signed(estimate(value, variance, p.unit(), why), low);
                if estimate.stderr.is_none() && self.free.contains(&index) && value <= low {
                    // Where the search for it ended is no value.
                    estimate.value = None;
                }
                let positive = *p != BaseParameter::B;
                (p.name().to_string(), if positive { shown(estimate) } else { estimate })
            })
            .collect()
    }

    /// The outputs of one effect by name, with errors carried through by their derivatives, and widened by what the form of its
    /// equation is worth.
    pub fn effect(&self, effect: EffectId) -> BTreeMap<String, Estimate> {
        let hypothesis = self.hypothesis;
        let Some(slot) = hypothesis.model.slots().iter().find(|s| s.effect == effect) else {
            return BTreeMap::new();
        };
        let fitted: Vec<usize> =
            slot.parameters.clone().filter(|k| self.free.contains(k)).take(LANES).collect();
        let mut seeded: Vec<Dual<LANES>> =
            hypothesis.own().iter().map(|x| crate::numerics::real::Real::constant(*x)).collect();
        for (lane, index) in fitted.iter().enumerate() {
            seeded[*index] = Dual::variable(hypothesis.parameters[*index], lane);
        }
        let (base, cx) = (Base::new(&seeded), hypothesis.model.context());
        let within = self.within_bounds(effect, slot.parameters.start, &fitted);
        let mut absent = hypothesis.own().to_vec();
        for (index, info) in slot.parameters.clone().zip(effect.info().parameters) {
            if info.role == Role::Amplitude {
                absent[index] = 0.0;
            }
        }
        let without = effect.outputs(&absent[slot.parameters.clone()], &Base::new(&absent), cx);
        effect
            .outputs(&seeded[slot.parameters.clone()], &base, cx)
            .into_iter()
            .zip(without)
            .map(|((name, unit, value), (_, _, zero))| {
                let spread = |covariance: &dyn Fn(usize, usize) -> f64| -> f64 {
                    let mut variance = 0.0;
                    for a in 0..fitted.len() {
                        for b in 0..fitted.len() {
                            let weight = value.eps[a] * value.eps[b];
                            if weight != 0.0 {
                                variance += weight * covariance(a, b);
                            }
                        }
                    }
                    variance
                };
                let unbounded = spread(&|a, b| self.variance_of(fitted[a], fitted[b]));
                let mut variance = spread(&|a, b| within[(a, b)]);
                // A gain differs from one by its strength; a resistance that stands aside is infinite without the effect.
                let strength = if zero.is_finite() { (value.re - zero).abs() } else { f64::INFINITY };
                let strength = strength.min(value.re.abs());
                let of_form = (effect.form() * strength).powi(2);
                variance = variance * FORM * FORM + of_form;
                let fixed = value.eps.iter().all(|e| *e == 0.0);
                let parameter = effect.info().parameters.iter().find(|p| p.name == name);
                let bounds = parameter.map(|p| ((p.low)(cx), (p.high)(cx)));
                // A shape as wide as its bounds is one that nothing is known of.
                let shape = parameter.is_some_and(|p| p.role == Role::Shape);
                let widest = if shape { unbounded * FORM * FORM + of_form } else { variance };
                let any = bounds.is_some_and(|(low, high)| widest.sqrt() > high - low);
                let why = if fixed {
                    Some("a whole number, chosen and not estimated".to_string())
                } else {
                    any.then(|| "the recording does not show it: anything within its bounds fits".to_string())
                };
                let estimate = estimate(value.re, variance, unit, why);
                (name.to_string(), signed(estimate, bounds.map_or(f64::NEG_INFINITY, |(low, _)| low)))
            })
            .collect()
    }

    /// Covariance of the parameters `fitted` of an effect, of which the first is parameter `first` of the model. A shape that the recording
    /// hardly shows lies within its bounds all the same, and errors are carried over from it only as far as its own value: beyond that they are
    /// not linear. The strength is no less certain than such a prior of the shape leaves it, by Bayes' rule.
    fn within_bounds(&self, effect: EffectId, first: usize, fitted: &[usize]) -> DMatrix<f64> {
        let cx = self.hypothesis.model.context();
        let mut covariance =
            DMatrix::from_fn(fitted.len(), fitted.len(), |a, b| self.variance_of(fitted[a], fitted[b]));
        for (at, index) in fitted.iter().enumerate() {
            let parameter = &effect.info().parameters[index - first];
            let uniform = ((parameter.high)(cx) - (parameter.low)(cx)).powi(2) / 12.0;
            let known = uniform.min(self.hypothesis.parameters[*index].powi(2));
            let own = covariance[(at, at)];
            if parameter.role != Role::Shape || own <= known {
                continue;
            }
            let column = covariance.column(at).map(finite);
            if own.is_finite() {
                covariance -= &column * column.transpose() / (own + known);
            }
            covariance[(at, at)] = own.min(known);
        }
        covariance
    }

    /// Whether `effect` acts on the motion and the standard error of its strength exceeds the strength. Something else is then the cause of
    /// what it explains.
    pub fn moves_nothing(&self, effect: EffectId) -> bool {
        let mechanical = effect.info().site == Site::Mechanical;
        mechanical && (self.hypothesis.vanishes(effect) || within_errors(effect, &self.effect(effect), 1.0))
    }

    /// Whether zero lies within the 95 % intervals of all that tells the strength of `effect`: no probability may then say that it is there.
    pub fn may_be_absent(&self, effect: EffectId) -> bool {
        within_errors(effect, &self.effect(effect), Z95)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::drive::Choice;

    #[test]
    fn a_parameter_that_may_be_anything_within_its_bounds_has_no_uncertainty() {
        let manoeuvre = speeds(0.5, &[(0.1, 90.0), (0.3, -80.0)]);
        let (data, base) = data(&setup(manoeuvre, vec![choice("coulomb_friction", "tau_c", 0.3)]));
        let found = fitted(&data, &base, EffectId::CoulombFriction);
        let mut outputs = Outputs::new(&data, &found);
        let last = found.own().len() - 1;
        let turns_over = outputs.free.iter().position(|k| *k == last).unwrap();
        let mut told = |stderr: f64| {
            outputs.covariance.row_mut(turns_over).fill(0.0);
            outputs.covariance.column_mut(turns_over).fill(0.0);
            outputs.covariance[(turns_over, turns_over)] = stderr * stderr;
            outputs.effect(EffectId::CoulombFriction)
        };
        let sure = told(0.01);
        assert!(sure["w_0"].stderr.is_some() && sure["tau_c"].stderr.is_some());
        let unsure = told(100.0);
        assert!(unsure["w_0"].value.is_some() && unsure["w_0"].stderr.is_none());
        assert!(unsure["w_0"].why_none.as_ref().unwrap().contains("bounds"));
        assert_eq!(unsure["tau_c"], sure["tau_c"]);
        // Hardly surer than large: the interval ends at zero, and not at a bound above.
        let value = sure["w_0"].value.unwrap();
        let [low, high] = told(0.9 * value)["w_0"].ci95.unwrap();
        assert!(low == 0.0 && high > 2.0 * value, "{low} {high}");
    }

    #[test]
    fn an_interval_of_the_base_holds_what_happens_between_rows_and_the_form_of_effects() {
        let manoeuvre = speeds(0.5, &[(0.1, 90.0), (0.3, -80.0)]);
        let (data, base) = data(&setup(manoeuvre, vec![choice("coulomb_friction", "tau_c", 0.3)]));
        let found = fitted(&data, &base, EffectId::CoulombFriction);
        let of = |set: &Hypothesis, stderr: f64| {
            let mut outputs = Outputs::new(&data, set);
            let at = outputs.free.iter().position(|k| *k == BaseParameter::PsiM.index()).unwrap();
            outputs.covariance[(at, at)] = stderr * stderr;
            let estimate = outputs.base()["psi_m"].clone();
            estimate.stderr.unwrap() / estimate.value.unwrap()
        };
        assert!((of(&base, 0.0) / BETWEEN_ROWS - 1.0).abs() < 1e-9);
        let (alone, beside) = (of(&base, 0.1), of(&found, 0.1));
        assert!((beside / alone / FORM - 1.0).abs() < 0.01, "{alone} {beside}");
    }

    #[test]
    fn a_strength_is_no_less_certain_than_the_bounds_of_its_shape_leave_it() {
        let manoeuvre = speeds(0.5, &[(0.1, 90.0), (0.3, -80.0)]);
        let (data, base) = data(&setup(manoeuvre, vec![choice("coulomb_friction", "tau_c", 0.3)]));
        let found = fitted(&data, &base, EffectId::CoulombFriction);
        let mut outputs = Outputs::new(&data, &found);
        let (first, cx) = (found.own().len() - 2, found.model.context());
        let shape = &EffectId::CoulombFriction.info().parameters[1];
        let uniform = ((shape.high)(cx) - (shape.low)(cx)).powi(2) / 12.0;
        let known = uniform.min(found.own()[first + 1].powi(2));
        let [strength, turns_over] =
            [first, first + 1].map(|k| outputs.free.iter().position(|free| *free == k).unwrap());
        let mut told = |times: f64| {
            // One direction of both parameters is open: the strength rises with the shape.
            let (own, slope) = (times * known, 1e-3);
            outputs.covariance[(turns_over, turns_over)] = own;
            for place in [(strength, turns_over), (turns_over, strength)] {
                outputs.covariance[place] = slope * own;
            }
            outputs.covariance[(strength, strength)] = slope * slope * own;
            outputs.effect(EffectId::CoulombFriction)["tau_c"].stderr.unwrap()
        };
        let (wide, wider) = (told(1e3), told(1e6));
        assert!((wider / wide - 1.0).abs() < 0.01, "{wide} {wider}");
        assert!(wider < 1.1 * FORM * 1e-3 * known.sqrt() + 0.1 * found.own()[first], "{wider}");
    }

    #[test]
    fn an_order_without_an_error_is_no_strength() {
        let estimate = |(name, value, stderr): (&str, f64, Option<f64>)| {
            let unit = "1".into();
            (name.to_string(), Estimate { value: Some(value), stderr, ci95: None, unit, why_none: None })
        };
        let within = |second: Option<f64>, times: f64| {
            let cogging =
                [("tau_cog", 0.06, Some(0.08)), ("tau_cog_2", 0.04, second), ("order_mech", 24.0, None)];
            within_errors(EffectId::CoggingTorque, &cogging.map(estimate).into(), times)
        };
        assert!(within(Some(0.05), 1.0) && !within(Some(0.03), 1.0) && !within(None, 1.0));
        assert!(within(Some(0.03), Z95) && !within(Some(0.02), Z95) && !within(None, Z95));
    }

    #[test]
    fn an_effect_of_the_motion_that_its_own_error_exceeds_moves_nothing() {
        let nothing = |effects: Vec<Choice>| {
            let manoeuvre = speeds(1.0, &[(0.1, 90.0), (0.4, -80.0), (0.8, 60.0)]);
            let (data, base) = data(&setup(manoeuvre, effects));
            let fitted = fitted(&data, &base, EffectId::QuadraticDrag);
            Outputs::new(&data, &fitted).moves_nothing(EffectId::QuadraticDrag)
        };
        assert!(nothing(Vec::new()));
        assert!(!nothing(vec![choice("quadratic_drag", "k", 1e-4)]));
    }
}
