//! Which effects the simulated machine has, and with which parameters.

use crate::effect::{Context, Parameter, Role};
use crate::effects::EffectId;
use crate::effects::text::{Definition, TextId};
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// An effect that is switched on. Shapes and whole numbers that are left out take their typical value for the machine.
/// So do all strengths if none is given; once one is given, those left out are zero.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Choice {
    /// Identifier of the catalogue, or the name of the effect given as text.
    pub effect: String,
    /// Values of its parameters by name, SI.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
    /// The effect itself, where it is given as text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub definition: Option<Definition>,
}

impl Choice {
    /// The effect.
    ///
    /// # Errors
    /// [`Error::Unknown`] for an effect that does not exist; those of [`TextId::new`]; [`Error::Unusable`] where its definition has another name.
    pub fn id(&self) -> Result<EffectId> {
        let Some(definition) = &self.definition else { return EffectId::parse(&self.effect) };
        if definition.name != self.effect {
            return Err(Error::unusable(
                format!("the effect '{}' is defined under the name '{}'", self.effect, definition.name),
                "give both the same name",
            ));
        }
        TextId::new(definition).map(EffectId::Text)
    }

    /// The effect and its whole parameter slice.
    ///
    /// # Errors
    /// [`Error::Unknown`] for an effect or a parameter that does not exist; [`Error::Quantity`] for a value that is not
    /// finite, has the wrong sign, or is a pure number outside its range.
    pub fn resolve(&self, cx: &Context) -> Result<(EffectId, Vec<f64>)> {
        let effect = self.id()?;
        let known = effect.info().parameters;
        if let Some(name) = self.parameters.keys().find(|name| known.iter().all(|p| p.name != **name)) {
            return Err(Error::Unknown {
                kind: "parameter of this effect",
                name: format!("{}.{name}", self.effect),
                known: known.iter().map(|p| p.name).collect::<Vec<_>>().join(", "),
            });
        }
        let strong = known.iter().any(|p| p.role == Role::Amplitude && self.parameters.contains_key(p.name));
        let values = known
            .iter()
            .map(|p| match self.parameters.get(p.name) {
                Some(value) => check(&self.effect, p, *value, cx),
                None if strong && p.role == Role::Amplitude => Ok(0.0),
                None => Ok((p.typical)(cx)),
            })
            .collect::<Result<_>>()?;
        Ok((effect, values))
    }
}

/// Dimensional ranges of the catalogue follow the scales of a recording and bound a search; a machine that is made up
/// may lie beyond them, with the right sign.
fn check(effect: &str, p: &Parameter, value: f64, cx: &Context) -> Result<f64> {
    let (low, high) = ((p.low)(cx), (p.high)(cx));
    let (ok, expected) = if p.unit == "1" {
        ((low..=high).contains(&value), format!("give {low} to {high}"))
    } else if low < 0.0 {
        (true, "give a finite value".into())
    } else if p.role == Role::Shape && low > 0.0 {
        (value > 0.0, "give a positive finite value".into())
    } else {
        (value >= 0.0, "give zero or a positive finite value".into())
    };
    if ok && value.is_finite() {
        return Ok(value);
    }
    Err(Error::quantity(&format!("{effect}.{}", p.name), value, p.unit, &expected))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::ALL;
    use crate::effects::testing::CX;

    fn choice(effect: &str, given: &[(&str, f64)]) -> Choice {
        let parameters = given.iter().map(|(name, x)| ((*name).to_string(), *x)).collect();
        Choice { effect: effect.into(), parameters, definition: None }
    }

    #[test]
    fn what_is_left_out_is_typical_or_zero() {
        let resolve = |given: &[(&str, f64)]| choice("stribeck_friction", given).resolve(&CX).unwrap().1;
        let typical: Vec<f64> =
            EffectId::StribeckFriction.info().parameters.iter().map(|p| (p.typical)(&CX)).collect();
        assert_eq!(resolve(&[]), typical);
        let names: Vec<&str> = EffectId::StribeckFriction.info().parameters.iter().map(|p| p.name).collect();
        let some = resolve(&[("tau_c", 0.3)]);
        for (k, name) in names.iter().enumerate() {
            let role = EffectId::StribeckFriction.info().parameters[k].role;
            let expected = match (*name, role) {
                ("tau_c", _) => 0.3,
                (_, Role::Amplitude) => 0.0,
                _ => typical[k],
            };
            assert_eq!(some[k], expected, "{name}");
        }
    }

    #[test]
    fn every_effect_resolves_with_its_typical_parameters() {
        for effect in ALL {
            let (id, p) = choice(effect.id(), &[]).resolve(&CX).unwrap();
            assert_eq!((id, p.len()), (*effect, effect.info().parameters.len()));
        }
    }

    #[test]
    fn wrong_names_and_values_are_refused() {
        for (effect, name, value) in [
            ("dead_tim", "v_err", 1.0),
            ("dead_time", "v", 1.0),
            ("dead_time", "v_err", -1.0),
            ("dead_time", "v_err", f64::INFINITY),
            ("dead_time", "i_th", 0.0),
            ("voltage_delay", "extra_samples", 2.5),
        ] {
            assert!(choice(effect, &[(name, value)]).resolve(&CX).is_err(), "{effect}.{name} = {value}");
        }
        assert!(choice("dead_time", &[("v_err", 1e3)]).resolve(&CX).is_ok());
    }
}
