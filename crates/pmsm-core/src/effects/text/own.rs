//! The effects given as text that a diagnosis asks about besides the catalogue.

use super::{Definition, TextId};
use crate::effects::EffectId;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Effects as text in one diagnosis at most: each takes as much time as one of the catalogue.
pub const MOST_OWN: usize = 16;

/// A list of effects given as text, each under its own name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(try_from = "Vec<Definition>", into = "Vec<Definition>")]
pub struct OwnEffects([Option<TextId>; MOST_OWN]);

impl OwnEffects {
    /// The effects.
    pub fn iter(&self) -> impl Iterator<Item = EffectId> {
        self.0.into_iter().flatten().map(EffectId::Text)
    }

    /// Whether one of them stands in the place of an effect of the catalogue.
    pub fn replace(&self, effect: EffectId) -> bool {
        self.0.into_iter().flatten().any(|own| own.definition().replaces.iter().any(|id| id == effect.id()))
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0[0].is_none()
    }
}

impl TryFrom<Vec<Definition>> for OwnEffects {
    type Error = Error;

    fn try_from(given: Vec<Definition>) -> Result<Self> {
        if given.len() > MOST_OWN {
            return Err(Error::unusable(
                format!("{} effects were given as text", given.len()),
                format!("give {MOST_OWN} at most"),
            ));
        }
        let mut own = Self::default();
        for (k, definition) in given.iter().enumerate() {
            if given[..k].iter().any(|other| other.name == definition.name) {
                return Err(Error::unusable(
                    format!("two effects have the name '{}'", definition.name),
                    "give each its own name",
                ));
            }
            own.0[k] = Some(TextId::new(definition)?);
        }
        Ok(own)
    }
}

impl From<OwnEffects> for Vec<Definition> {
    fn from(own: OwnEffects) -> Self {
        own.0.into_iter().flatten().map(|id| id.definition().clone()).collect()
    }
}
