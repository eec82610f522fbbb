//! What a diagnosis has found so far: the answer of one that is interrupted. Nothing is computed for it any more.

use super::answer::{Answer, Estimate, FoundModel, Step};
use super::conclude;
use super::data::Data;
use super::hypothesis::Hypothesis;
use crate::base::Base;
use crate::machine::BaseParameter;
use crate::signals::Finding;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// The best set so far.
#[derive(Debug, Default)]
pub struct SoFar(Mutex<Option<Hypothesis>>);

impl SoFar {
    /// Keeps a set in place of the one before.
    pub fn note(&self, set: &Hypothesis) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(set.clone());
    }

    /// The answer that is `undetermined` because it was interrupted, with the values of the best set so far.
    pub fn answer(self, data: &Data) -> Answer {
        let set = self.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        let effects: Vec<String> =
            set.iter().flat_map(Hypothesis::effects).map(|e| e.id().to_string()).collect();
        let best = match (&set, effects.is_empty()) {
            (None, _) => "before the dq-model was fitted".to_string(),
            (Some(_), true) => "when the dq-model was fitted and no effect was taken up".to_string(),
            (Some(_), false) => format!("when the best set of effects was {}", effects.join(", ")),
        };
        let finding = Finding {
            finding: format!("the diagnosis was interrupted {best}"),
            consequence: "what had not been tried is neither named nor excluded".into(),
            fix: "let it run to its end".into(),
        };
        let mut answer = conclude::undetermined(data, finding, None);
        if let Some(set) = set {
            let base = base(data, &set);
            let parameters = set.effects().into_iter().map(|e| (e.id().to_string(), own(&set, e))).collect();
            let step = Step {
                effects: effects.clone(),
                base: base.clone(),
                parameters,
                rms: BTreeMap::new(),
            };
            answer.model = FoundModel { effects, base, ..answer.model };
            answer.path = vec![step];
        }
        answer
    }
}

/// Base parameters that the recordings can show, without uncertainties.
fn base(data: &Data, set: &Hypothesis) -> BTreeMap<String, Estimate> {
    let shown = BaseParameter::ALL.into_iter().filter(|p| data.needs(*p));
    shown.map(|p| (p.name().to_string(), plain(set.own()[p.index()], p.unit()))).collect()
}

/// Parameters of one effect of a set, without uncertainties.
fn own(set: &Hypothesis, effect: crate::effects::EffectId) -> BTreeMap<String, Estimate> {
    let slots = set.model.slots().iter().filter(|slot| slot.effect == effect);
    let outputs = slots.flat_map(|slot| {
        effect.outputs(&set.parameters[slot.parameters.clone()], &Base::new(set.own()), set.model.context())
    });
    outputs.map(|(name, unit, value)| (name.to_string(), plain(value, unit))).collect()
}

fn plain(value: f64, unit: &str) -> Estimate {
    Estimate {
        value: value.is_finite().then_some(value),
        stderr: None,
        ci95: None,
        unit: unit.to_string(),
        why_none: Some("the diagnosis was interrupted before it was computed".into()),
    }
}
