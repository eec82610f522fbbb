//! A model with the values of its parameters, as it is written to files: everything that is needed to simulate it again, to the bit.
//!
//! The object `model.specification` of a diagnosis' JSON answer is one:
//!
//! ```
//! use pmsm_core::monitor::Silent;
//! use pmsm_core::simulate::response::{self, Begin, Heating, Inputs};
//! use pmsm_core::specification::Specification;
//!
//! let text = r#"{
//!     "base": {"r_s": 0.17, "l_d": 1.9e-3, "l_q": 1.9e-3, "psi_m": 0.19, "j": 8e-3, "b": 1.1e-3},
//!     "effects": [{"effect": "quadratic_drag", "parameters": {"k": 1e-5}}],
//!     "scales": {"n_p": 4, "i_max": 10, "v_max": 300, "omega_e_max": 400, "tau_max": 11, "psi_max": 0.2, "swing": 6.3,
//!         "duration": 1, "period": 1e-4, "v_dc": 540, "electrical_rate": 90, "zero_sequence": 0, "completed_phase": null,
//!         "load_known": false, "steady": false, "has_temperature": false, "has_magnet_temperature": false}
//! }"#;
//! let (model, p) = serde_json::from_str::<Specification>(text)?.model()?;
//! let t: Vec<f64> = (0..500).map(|k| f64::from(k) * 1e-3).collect();
//! let (v_d, v_q, tau_load) = (vec![0.0; 500], vec![20.0; 500], vec![0.5; 500]);
//! let inputs = Inputs { t: &t, v: [&v_d, &v_q], tau_load: &tau_load };
//! let steps = response::steps(&model, &p, 1e-3);
//! let run = response::respond(&model, &p, inputs, Begin::default(), Heating::default(), steps, &Silent)?;
//! assert!(run["omega_m"][499] > 10.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::base::BASE;
use crate::drive::Choice;
use crate::effect::Context;
use crate::effects::EffectId;
use crate::error::{Error, Result};
use crate::machine::{BaseParameter, Machine};
use crate::map::{Factor, MOST, Map, Part, Spline, Variable};
use crate::model::Model;
use crate::signals::Logged;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Parts of a map at most.
const PARTS: usize = 16;

/// A part of a map with its coefficients.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapPart {
    /// Its form.
    #[serde(flatten)]
    pub part: Part,
    /// Its coefficients: those of the first equation, then those of the second; functions of the first factor count slowest.
    pub coefficients: Vec<f64>,
}

/// A model with the values of its parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Specification {
    /// Base parameters by name, SI.
    pub base: BTreeMap<String, f64>,
    /// Its effects with all parameters of their equations.
    #[serde(default)]
    pub effects: Vec<Choice>,
    /// Missing voltage or torque without a name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub map: Vec<MapPart>,
    /// The scales at which the effects' parameters are meant.
    pub scales: Context,
    /// How recordings are read for it.
    #[serde(default)]
    pub reading: Reading,
}

/// How the recordings of a model are read: what was found out about the log when the model was fitted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Reading {
    /// Whether it holds for the voltage equations.
    pub electrical: bool,
    /// Whether it holds for the equation of motion.
    pub mechanical: bool,
    /// What of the voltage is logged where it is held in the stator's frame over a control period, and not in the rotor's.
    pub stator_held: Option<Logged>,
    /// Whether an angle in steps is the lower end of its step.
    pub middle_of_steps: bool,
    /// Whether the voltage of a row is that of its instant, and is drawn straight from row to row.
    pub voltages_drawn: bool,
    /// Time constant of a low pass in the log of the currents, s.
    pub current_filter: Option<f64>,
}

impl Default for Reading {
    fn default() -> Self {
        Self {
            electrical: true,
            mechanical: true,
            stator_held: None,
            middle_of_steps: false,
            voltages_drawn: false,
            current_filter: None,
        }
    }
}

impl Specification {
    /// A model at the parameter vector `p`, whose entries behind those of the model are ignored.
    pub fn of(model: &Model, p: &[f64]) -> Self {
        let base = BaseParameter::ALL.map(|b| (b.name().to_string(), p[b.index()])).into_iter().collect();
        let named = |slot: &crate::model::Slot| {
            let own = slot.effect.info().parameters.iter().zip(&p[slot.parameters.clone()]);
            let parameters = own.map(|(info, x)| (info.name.to_string(), *x)).collect();
            Choice {
                effect: slot.effect.id().into(),
                parameters,
                definition: slot.effect.definition().cloned(),
            }
        };
        let coefficients = &p[model.map_parameters()];
        let places = model.map().into_iter().flat_map(Map::places);
        let map = places
            .map(|(part, place)| MapPart { part: part.clone(), coefficients: coefficients[place].to_vec() })
            .collect();
        Self {
            base,
            effects: model.slots().iter().map(named).collect(),
            map,
            scales: *model.context(),
            reading: Reading::default(),
        }
    }

    /// The model and its parameter vector.
    ///
    /// # Errors
    /// [`Error::Unknown`] for a parameter or an effect that does not exist; [`Error::Quantity`] for a value without meaning;
    /// [`Error::Unusable`] for a base parameter or a coefficient that is missing, an effect that is named twice, or a map that has no meaning.
    pub fn model(&self) -> Result<(Model, Vec<f64>)> {
        self.check_scales()?;
        let mut p = self.base()?.to_vec();
        let mut effects: Vec<EffectId> = Vec::new();
        for choice in &self.effects {
            let effect = choice.id()?;
            if effects.contains(&effect) {
                return Err(wrong(format!("the effect {} stands in it twice", choice.effect)));
            }
            let known = effect.info().parameters;
            let mut names = choice.parameters.keys();
            if let Some(name) = names.find(|name| known.iter().all(|k| k.name != **name)) {
                return Err(Error::Unknown {
                    kind: "parameter of this effect",
                    name: format!("{}.{name}", choice.effect),
                    known: known.iter().map(|k| k.name).collect::<Vec<_>>().join(", "),
                });
            }
            for info in known {
                let value = choice.parameters.get(info.name).copied();
                let value = value.filter(|x| x.is_finite());
                let missing = || wrong(format!("{}.{} is missing, or no number", choice.effect, info.name));
                p.push(value.ok_or_else(missing)?);
            }
            effects.push(effect);
        }
        let model = laid(Model::new(self.scales, &effects), &self.map, &mut p)?;
        Ok((model, p))
    }

    /// The machine with the base parameters of this model.
    ///
    /// # Errors
    /// Those of [`Machine::new`] and [`Machine::with`].
    pub fn machine(&self) -> Result<Machine> {
        let base = self.base()?;
        let mut machine = Machine::new(self.scales.n_p as u32)?;
        for parameter in BaseParameter::ALL {
            machine = machine.with(parameter, base[parameter.index()])?;
        }
        Ok(machine)
    }

    fn base(&self) -> Result<[f64; BASE]> {
        let names = BaseParameter::ALL.map(BaseParameter::name);
        if let Some(name) = self.base.keys().find(|name| !names.contains(&name.as_str())) {
            return Err(Error::Unknown { kind: "parameter", name: name.clone(), known: names.join(", ") });
        }
        let mut base = [0.0; BASE];
        for parameter in BaseParameter::ALL {
            let name = parameter.name();
            let value = self.base.get(name).ok_or_else(|| wrong(format!("base.{name} is missing")))?;
            let (low, high) = parameter.physical_range();
            if !(value.is_finite() && (low..=high).contains(value)) {
                let expected = format!("give {low} to {high}");
                return Err(Error::quantity(name, *value, parameter.unit(), &expected));
            }
            base[parameter.index()] = *value;
        }
        Ok(base)
    }

    fn check_scales(&self) -> Result<()> {
        let s = &self.scales;
        if !(s.n_p >= 1.0 && s.n_p <= 1000.0 && s.n_p.fract() == 0.0) {
            return Err(Error::quantity("scales.n_p", s.n_p, "1", "give the pole pairs, a whole number"));
        }
        let scales = [
            ("i_max", s.i_max),
            ("v_max", s.v_max),
            ("omega_e_max", s.omega_e_max),
            ("tau_max", s.tau_max),
            ("psi_max", s.psi_max),
            ("swing", s.swing),
            ("duration", s.duration),
            ("period", s.period),
            ("v_dc", s.v_dc),
            ("electrical_rate", s.electrical_rate),
        ];
        for (name, value) in scales {
            if !(value.is_finite() && value >= 0.0) {
                let name = format!("scales.{name}");
                return Err(Error::quantity(&name, value, "SI", "give zero or a positive finite value"));
            }
        }
        if !s.zero_sequence.is_finite() || s.completed_phase.is_some_and(|x| x > 2) {
            return Err(wrong("its scales name a phase that no motor has".into()));
        }
        Ok(())
    }
}

/// A model with a map on top of it, whose coefficients are appended to its parameter vector `p`.
///
/// # Errors
/// [`Error::Unusable`] for a map that has no meaning.
pub fn laid(model: Model, map: &[MapPart], p: &mut Vec<f64>) -> Result<Model> {
    if map.is_empty() {
        return Ok(model);
    }
    if map.len() > PARTS {
        return Err(wrong(format!("its map has {} parts, and {PARTS} is the most", map.len())));
    }
    for MapPart { part, coefficients } in map {
        check(part)?;
        if coefficients.len() != part.count() || coefficients.iter().any(|c| !c.is_finite()) {
            let got = coefficients.len();
            return Err(wrong(format!("a part of its map needs {} numbers and has {got}", part.count())));
        }
        p.extend(coefficients);
    }
    Ok(model.with_map(Map { parts: map.iter().map(|m| m.part.clone()).collect() }))
}

fn wrong(what: String) -> Error {
    Error::unusable(
        format!("this model cannot be used: {what}"),
        "take the model of an answer as it was written",
    )
}

fn check(part: &Part) -> Result<()> {
    let pure = part.equations.iter().all(|equation| equation.site() == part.site());
    if part.equations.is_empty() || part.equations.len() > 2 || !pure {
        return Err(wrong("a part of its map acts in no equation, or in several kinds".into()));
    }
    for factor in part.factors() {
        let finite = |x: f64| x.is_finite() && x > 0.0;
        let sound = match factor {
            Factor::Harmonics { angle, count, .. } => {
                matches!(angle, Variable::ThetaE | Variable::ThetaM) && (1..=MOST / 2).contains(count)
            }
            Factor::Fourier { angle, count } => {
                matches!(angle, Variable::ThetaE | Variable::ThetaM) && (1..MOST.div_ceil(2)).contains(count)
            }
            Factor::Swing { frequency, count } => finite(*frequency) && (1..=MOST / 2).contains(count),
            Factor::Direction { width } => finite(*width),
            Factor::Spline(Spline { low, high, degree, pieces, warp, odd, .. }) => {
                let ends = low.is_finite() && high.is_finite() && low < high && (!odd || *low == -high);
                let most = if *odd { 2 * MOST } else { MOST };
                let count =
                    (1..=3).contains(degree) && *pieces >= 1 && pieces.saturating_add(*degree) <= most;
                ends && count && warp.is_finite() && *warp >= 0.0
            }
        };
        if !sound {
            return Err(wrong(format!("a factor of its map has no meaning: {factor:?}")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, MACHINE};
    use crate::map::Equation;

    fn example() -> (Model, Vec<f64>) {
        let effects = [EffectId::DeadTime, EffectId::CoulombFriction];
        let line = Spline {
            variable: Variable::IQ,
            low: -8.0,
            high: 8.0,
            degree: 3,
            pieces: 4,
            warp: 0.3,
            odd: false,
        };
        let wave = Factor::Harmonics { angle: Variable::ThetaE, order: 6, count: 2 };
        let part = Part {
            equations: vec![Equation::D, Equation::Q],
            first: wave,
            second: Some(Factor::Spline(line)),
        };
        let model = Model::new(CX, &effects).with_map(Map { parts: vec![part] });
        let mut p = MACHINE.to_vec();
        p.extend(effects.iter().flat_map(|e| e.info().parameters).map(|x| (x.typical)(&CX) / 3.0));
        let count = model.parameter_count() - p.len();
        p.extend((0..count).map(|k| 0.1 * (k as f64 + 0.1).sin()));
        (model, p)
    }

    #[test]
    fn a_model_comes_back_from_its_file_to_the_bit() {
        let (model, p) = example();
        let text = serde_json::to_string(&Specification::of(&model, &p)).unwrap();
        let read: Specification = serde_json::from_str(&text).unwrap();
        let (again, q) = read.model().unwrap();
        assert!(p.iter().zip(&q).all(|(a, b)| a.to_bits() == b.to_bits()) && p.len() == q.len());
        assert_eq!((again.effects(), again.map()), (model.effects(), model.map()));
        assert_eq!(again.context(), model.context());
        assert_eq!(read.machine().unwrap().n_p, CX.n_p as u32);
    }

    #[test]
    fn what_no_model_is_comes_back_as_an_error() {
        let (model, p) = example();
        let good = Specification::of(&model, &p);
        let broken = |change: fn(&mut Specification)| {
            let mut bad = good.clone();
            change(&mut bad);
            bad.model().unwrap_err().to_string()
        };
        for (change, said) in [
            ((|s| _ = s.base.remove("l_q")) as fn(&mut Specification), "l_q"),
            (|s| _ = s.base.insert("l_q".into(), f64::NAN), "l_q"),
            (|s| _ = s.base.insert("l_x".into(), 1.0), "l_x"),
            (|s| s.effects[0].effect = "dead_tim".into(), "dead_tim"),
            (|s| _ = s.effects[0].parameters.remove("v_err"), "v_err"),
            (|s| _ = s.effects[1].parameters.insert("x".into(), 1.0), "x"),
            (|s| s.effects[1] = s.effects[0].clone(), "twice"),
            (|s| _ = s.map[0].coefficients.pop(), "numbers"),
            (|s| s.map[0].part.equations = vec![Equation::D, Equation::Mechanical], "equation"),
            (|s| s.map[0].part.first = Factor::Direction { width: 0.0 }, "factor"),
            (|s| s.map = vec![s.map[0].clone(); 17], "17 parts"),
            (|s| s.scales.n_p = 2.5, "n_p"),
            (|s| s.scales.psi_max = f64::INFINITY, "psi_max"),
            (|s| s.scales.completed_phase = Some(3), "phase"),
        ] {
            let got = broken(change);
            assert!(got.contains(said), "{said}: {got}");
        }
    }
}
