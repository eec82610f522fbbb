//! What a recording cannot show, in plain words.

use super::{EVEN, Shown};
use crate::diagnose::answer::Unseen;
use crate::diagnose::select::Outcome;
use crate::diagnose::wording::{NOTHING, times};
use crate::effects::EffectId;

/// What is left of an effect, relative to what it adds, below which the fitted parameters are said to absorb it.
const ABSORBED: f64 = 0.5;

/// Effects that would probably be missed at their typical strength, and those that could not be asked for, least power first.
pub fn cannot_see(outcome: &Outcome) -> Vec<Unseen> {
    let found = outcome.best.fitted.effects();
    let mut out: Vec<Unseen> = outcome
        .unidentifiable
        .iter()
        .map(|(effect, why)| Unseen { effect: effect.id().into(), why: why.clone(), power: 0.0 })
        .collect();
    let missed = outcome.shown.iter().filter(|s| s.power < EVEN && !found.contains(&s.effect));
    out.extend(missed.map(|s| Unseen { effect: s.effect.id().into(), why: s.why(&found), power: s.power }));
    out.sort_by(|a, b| a.power.total_cmp(&b.power));
    out
}

impl Shown {
    /// Why it would be missed, in plain words.
    pub(super) fn why(&self, found: &[EffectId]) -> String {
        let (before, after) = self.size;
        let channel = self.channel.name();
        let contained = found.iter().find(|e| self.effect.contains(**e));
        if let Some(special) = contained {
            return format!(
                "{} is a special case of it and fits as well. Its other part, if of the same size, would add at most {} times the noise to \
                 {channel}, so that it cannot be excluded",
                special.id(),
                times(after)
            );
        }
        if self.at_best > EVEN {
            return format!(
                "in some of its forms it hides: at its typical strength it would add {} to {} times the noise to {channel} \
                 after the fitted parameters have adjusted",
                times(self.least),
                times(after)
            );
        }
        if after > ABSORBED * before {
            return format!(
                "at its typical strength it would add {}{} times the noise to {channel}",
                if after < NOTHING { "" } else { "only " },
                times(after)
            );
        }
        if before < NOTHING {
            return format!(
                "at its typical strength it moves {channel} by {} times the noise",
                times(before)
            );
        }
        let by = match self.absorbed_by.as_slice() {
            [] => "the fitted parameters together absorb".to_string(),
            [one] => format!("the fitted {one} absorbs"),
            [first, second, ..] => format!("the fitted {first} and {second} absorb"),
        };
        let rest =
            if after < NOTHING { String::new() } else { format!(" but {} times the noise", times(after)) };
        format!(
            "at its typical strength it moves {channel} by {} times the noise, but {by} all{rest} of that",
            times(before)
        )
    }
}
