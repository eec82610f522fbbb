//! Rows that are left out, and how that is told.

use crate::signals::Finding;
use serde::{Deserialize, Serialize};

/// Rows that were left out of the window under way.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lost {
    /// Rows with a value that is not finite.
    pub not_finite: u64,
    /// The column of the first of them.
    pub first_column: Option<String>,
    /// Rows without a time.
    pub no_time: u64,
    /// Rows with the time of the row before.
    pub repeated: u64,
    /// Rows whose time runs a little back.
    pub out_of_order: u64,
}

impl Lost {
    /// Adds what there is to tell.
    pub fn tell(&self, notes: &mut Vec<Finding>) {
        let rows = |n: u64| if n == 1 { "1 row".to_owned() } else { format!("{n} rows") };
        let gap = "the model restarts behind the gap";
        if self.not_finite > 0 {
            let column = self.first_column.as_deref().unwrap_or("t");
            let finding =
                format!("{} without a usable value, the first in column '{column}'", rows(self.not_finite));
            notes.push(note(finding, gap, "repair the log or the sensor"));
        }
        if self.no_time > 0 {
            let finding = format!("{} without a usable time", rows(self.no_time));
            notes.push(note(finding, gap, "repair the log"));
        }
        if self.repeated > 0 {
            let finding = format!("{} with the time of the row before", rows(self.repeated));
            notes.push(note(finding, "only the first of them counts", "log each sample once"));
        }
        if self.out_of_order > 0 {
            let finding = format!("{} out of order in time", rows(self.out_of_order));
            notes.push(note(finding, "they are left out", "sort the rows by time"));
        }
    }
}

/// A finding with constant consequence and fix.
pub fn note(finding: String, consequence: &str, fix: &str) -> Finding {
    Finding { finding, consequence: consequence.into(), fix: fix.into() }
}
