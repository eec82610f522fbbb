//! The handle of an effect given as text.
//!
//! Models hold their effects by value and copy them in inner loops, so that the handle is a reference which lives as long as the process. Equal
//! definitions share one text, so that nothing grows with the number of calls; different ones are bounded.

use super::{Definition, Text};
use crate::error::{Error, Result};
use std::cmp::Ordering;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::sync::{Mutex, PoisonError};

/// Different definitions in one process at most: each takes a few kilobytes that are not given back.
pub const MOST_KNOWN: usize = 4096;

static KNOWN: Mutex<Vec<TextId>> = Mutex::new(Vec::new());

/// An effect given as text.
#[derive(Clone, Copy)]
pub struct TextId(&'static Text);

impl TextId {
    /// The effect that a definition gives; the same one for equal definitions.
    ///
    /// # Errors
    /// [`Error::Formula`] with the place in a formula that is wrong, [`Error::Unusable`] for another part of the definition that is, or where the
    /// process has had too many.
    pub fn new(definition: &Definition) -> Result<Self> {
        let find = |known: &[Self]| known.iter().copied().find(|id| id.0.definition == *definition);
        // Held while a new text is read, so that no two threads keep the same one.
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(id) = find(&known) {
            return Ok(id);
        }
        if known.len() >= MOST_KNOWN {
            return Err(Error::unusable(
                format!("this process has had {MOST_KNOWN} different effects as text"),
                "start another process for more",
            ));
        }
        let text = definition.text()?;
        let id = Self(Box::leak(Box::new(text)));
        known.push(id);
        Ok(id)
    }

    #[inline(always)]
    pub(super) fn text(self) -> &'static Text {
        self.0
    }

    /// What tells it from all others, in an order that does not depend on when it was read.
    fn key(self) -> (&'static str, String) {
        (self.0.definition.name.as_str(), serde_json::to_string(&self.0.definition).unwrap_or_default())
    }
}

impl fmt::Debug for TextId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.definition.name)
    }
}

impl PartialEq for TextId {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self.0, other.0)
    }
}

impl Eq for TextId {}

impl Hash for TextId {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.0.definition.name.hash(state);
    }
}

impl PartialOrd for TextId {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for TextId {
    fn cmp(&self, other: &Self) -> Ordering {
        if self == other { Ordering::Equal } else { self.key().cmp(&other.key()) }
    }
}
