//! From rows as they come to windows: what a logger does to time (gaps, repeats, restarts) and to values (NaN) is met here
//! and told with the window in which it happened.

mod lost;

use crate::error::{Error, Result};
use crate::recording::{COLUMNS, first_unsound, sound};
use crate::signals::Finding;
use lost::{Lost, note};
use serde::{Deserialize, Serialize};

/// Most samples of one window.
pub const MOST_SAMPLES: usize = 1 << 18;
/// Steps in time of which the median counts as the sample period.
const STEPS: usize = 15;
/// A row this many periods back in time comes out of order; one farther back belongs to a log that was restarted.
const OUT_OF_ORDER: f64 = 16.0;

/// A finished window: its rows, and what happened to others.
#[derive(Debug, Clone)]
pub struct Cut {
    /// Number of the window, from 0, restarts and empty ones included.
    pub number: u64,
    /// From when to when it reaches, s of the log's own time.
    pub span: [f64; 2],
    /// Columns by name.
    pub columns: Vec<(String, Vec<f64>)>,
    /// Samples that a window without loss would have; 0 if unknown.
    pub expected: f64,
    /// What happened.
    pub notes: Vec<Finding>,
}

/// The window under way. Memory is one window of samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Intake {
    window: f64,
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
    /// Time of the first row since the last restart, and the window under way counted from there.
    origin: Option<f64>,
    index: u64,
    number: u64,
    last: f64,
    steps: Vec<f64>,
    lost: Lost,
    restarted: bool,
}

/// The columns of a batch in the order of the stream.
pub struct Batch<'a> {
    values: Vec<&'a [f64]>,
}

impl Batch<'_> {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.values[0].len()
    }
}

/// How many values on end, from the first one on, are as `good` says of each and the one before it, which is `last` for the first.
fn leading(last: f64, values: &[f64], good: impl Fn(f64, f64) -> bool) -> usize {
    // Without a way out in between a chunk is looked through several values at a time.
    const CHUNK: usize = 128;
    let mut count = usize::from(values.first().is_some_and(|first| good(last, *first)));
    if count == 0 {
        return 0;
    }
    let all_good = |x: &[f64]| x.iter().zip(&x[1..]).fold(true, |all, (last, x)| all & good(*last, *x));
    while let Some(chunk) = values.get(count - 1..count + CHUNK).filter(|chunk| all_good(chunk)) {
        count += chunk.len() - 1;
    }
    let rest = &values[count - 1..];
    count + rest.iter().zip(&rest[1..]).take_while(|(last, x)| good(**last, **x)).count()
}

impl Intake {
    /// An empty one for windows of this length, s.
    pub fn new(window: f64) -> Self {
        Self {
            window,
            names: Vec::new(),
            rows: Vec::new(),
            origin: None,
            index: 0,
            number: 0,
            last: 0.0,
            steps: Vec::new(),
            lost: Lost::default(),
            restarted: false,
        }
    }

    /// Checks names and lengths of a batch. The first batch settles the columns of the stream; time is put first.
    ///
    /// # Errors
    /// [`Error::Unknown`], [`Error::Column`].
    pub fn columns<'a>(&mut self, batch: &[(&str, &'a [f64])]) -> Result<Batch<'a>> {
        let refuse = |column: &str, problem: String, fix: &str| {
            Err(Error::Column { column: column.into(), problem, fix: fix.into() })
        };
        for (k, (name, values)) in batch.iter().enumerate() {
            if !COLUMNS.iter().any(|(known, _)| known == name) {
                let known = COLUMNS.map(|(n, _)| n).join(", ");
                return Err(Error::Unknown { kind: "column", name: (*name).into(), known });
            }
            if batch[..k].iter().any(|(other, _)| other == name) {
                return refuse(name, "is given twice".into(), "keep one of the two");
            }
            if values.len() != batch[0].1.len() {
                let problem =
                    format!("has {} rows while {} has {}", values.len(), batch[0].0, batch[0].1.len());
                return refuse(name, problem, "give every column the same number of rows");
            }
        }
        if self.names.is_empty() {
            if !batch.iter().any(|(name, _)| *name == "t") {
                return refuse("t", "is missing".into(), "give the sample time in s");
            }
            self.names = batch.iter().map(|(name, _)| (*name).to_owned()).collect();
            self.names.sort_by_key(|name| (name != "t", name.clone()));
            self.rows = vec![Vec::new(); self.names.len()];
        }
        let mut values = Vec::with_capacity(self.names.len());
        for name in &self.names {
            match batch.iter().find(|(other, _)| other == name) {
                Some((_, column)) => values.push(*column),
                None => return refuse(name, "was there before and is missing now".into(), SAME),
            }
        }
        if let Some((name, _)) = batch.iter().find(|(name, _)| !self.names.iter().any(|known| known == name))
        {
            return refuse(name, "was not there before".into(), SAME);
        }
        Ok(Batch { values })
    }

    /// Takes in the rows from number `row` on up to the first one that may call for more than being kept; returns how many
    /// those are. Row by row they would cost more than finding what they tell.
    pub fn keep(&mut self, batch: &Batch, row: usize) -> usize {
        if self.origin.is_none() {
            return 0;
        }
        let (t, room) = (&batch.values[0][row..], MOST_SAMPLES.saturating_sub(self.rows[0].len()));
        let end = self.begins(self.index + 1);
        let plain = |last: f64, t: f64| {
            let step = t - last;
            (step > 0.0) & (t < end - 0.5 * step.min(self.window)) & sound(t)
        };
        let mut count = leading(self.last, &t[..room.min(t.len())], plain);
        for values in &batch.values[1..] {
            let kept = &values[row..row + count];
            count = first_unsound(kept).unwrap_or(count);
        }
        for (column, values) in self.rows.iter_mut().zip(&batch.values) {
            column.extend_from_slice(&values[row..row + count]);
        }
        for k in count.saturating_sub(STEPS)..count {
            self.remember(t[k] - if k == 0 { self.last } else { t[k - 1] });
        }
        if count > 0 {
            self.last = t[count - 1];
        }
        count
    }

    /// Takes in one row; returns the windows that it completes (two if time jumps across whole windows).
    ///
    /// # Errors
    /// [`Error::Unusable`] if a window holds too many samples.
    pub fn push(&mut self, batch: &Batch, row: usize) -> Result<Vec<Cut>> {
        let t = batch.values[0][row];
        if !sound(t) {
            self.lost.no_time += 1;
            return Ok(Vec::new());
        }
        let mut done = Vec::new();
        match self.origin {
            None => self.origin = Some(t),
            Some(_) => {
                let step = t - self.last;
                if step == 0.0 {
                    self.lost.repeated += 1;
                    return Ok(done);
                }
                if step < 0.0 && -step <= OUT_OF_ORDER * self.period().unwrap_or(0.0) {
                    self.lost.out_of_order += 1;
                    return Ok(done);
                }
                if step < 0.0 {
                    let told = format!("time ran back from {} s to {t} s", self.last);
                    done.extend(self.close(Some(told)));
                    self.begin_again(t);
                } else {
                    self.remember(step);
                    done.extend(self.advance(t, step));
                }
            }
        }
        self.last = t;
        if let Some(column) = batch.values.iter().position(|values| !sound(values[row])) {
            self.lost.not_finite += 1;
            self.lost.first_column.get_or_insert_with(|| self.names[column].clone());
            return Ok(done);
        }
        if self.rows[0].len() >= MOST_SAMPLES {
            return Err(Error::unusable(
                format!("a window of {} s holds more than {MOST_SAMPLES} samples", self.window),
                "choose a shorter window, or give the time in s",
            ));
        }
        for (column, values) in self.rows.iter_mut().zip(&batch.values) {
            column.push(values[row]);
        }
        Ok(done)
    }

    /// Ends the window under way, if there is one.
    pub fn finish(&mut self) -> Option<Cut> {
        let cut = self.origin.and_then(|_| self.close(None));
        self.origin = None;
        (self.index, self.restarted) = (0, false);
        cut
    }

    /// Length of a window, s.
    pub fn window(&self) -> f64 {
        self.window
    }

    /// Whether everything in it can have come about by [`Intake::push`].
    pub fn is_sound(&self) -> bool {
        let n = self.rows.first().map_or(0, Vec::len);
        let known = |name: &String| COLUMNS.iter().any(|(known, _)| known == name);
        let finite = |x: &f64| sound(*x);
        self.names.len() == self.rows.len()
            && self.names.iter().all(known)
            && self.names.first().is_none_or(|name| name == "t")
            && self.names.windows(2).skip(1).all(|pair| pair[0] < pair[1])
            && n <= MOST_SAMPLES
            && self.rows.iter().all(|column| column.len() == n && column.iter().all(finite))
            && self.rows.first().is_none_or(|t| t.windows(2).all(|pair| pair[0] < pair[1]))
            && self.origin.is_none_or(|t| finite(&t))
            && finite(&self.last)
            && self.index.max(self.number) < 1 << 53
            && self.steps.len() <= STEPS
            && self.steps.iter().all(|step| step.is_finite() && *step > 0.0)
    }

    fn begin_again(&mut self, t: f64) {
        self.origin = Some(t);
        (self.index, self.restarted) = (0, true);
        self.steps.clear();
    }

    fn remember(&mut self, step: f64) {
        if self.steps.len() == STEPS {
            self.steps.remove(0);
        }
        self.steps.push(step);
    }

    fn period(&self) -> Option<f64> {
        let mut sorted = self.steps.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied()
    }

    fn begins(&self, index: u64) -> f64 {
        self.origin.unwrap_or(0.0) + index as f64 * self.window
    }

    /// Closes windows that end before `t`. A sample within half a period of a border belongs to the later window.
    fn advance(&mut self, t: f64, step: f64) -> Vec<Cut> {
        let slack = 0.5 * self.period().unwrap_or(step).min(step).min(self.window);
        if t < self.begins(self.index + 1) - slack {
            return Vec::new();
        }
        let mut done: Vec<Cut> = self.close(None).into_iter().collect();
        let now = ((t - self.begins(0) + slack) / self.window).floor();
        let missed = now - self.index as f64;
        if missed >= 1.0 {
            let span = [self.begins(self.index), self.begins(0) + now * self.window];
            done.push(self.empty(span, missed));
            self.index = now as u64;
            if (t - self.begins(self.index)).abs() > 2.0 * self.window {
                // So far ahead that counting windows from the old origin has lost its precision.
                self.begin_again(t);
            }
        }
        done
    }

    fn empty(&mut self, span: [f64; 2], windows: f64) -> Cut {
        let number = self.number;
        self.number += 1;
        let finding = format!("no samples for {:.6} s, the length of {windows} windows", span[1] - span[0]);
        let notes = vec![note(finding, "nothing is said of that time", "see why the log was silent")];
        Cut { number, span, columns: Vec::new(), expected: 0.0, notes }
    }

    fn close(&mut self, broken: Option<String>) -> Option<Cut> {
        let columns: Vec<(String, Vec<f64>)> = self
            .names
            .iter()
            .zip(&mut self.rows)
            .map(|(name, column)| (name.clone(), std::mem::take(column)))
            .collect();
        let lost = std::mem::take(&mut self.lost);
        let restarted = std::mem::take(&mut self.restarted);
        let (number, index) = (self.number, self.index);
        (self.number, self.index) = (number + 1, index + 1);
        let mut notes = Vec::new();
        if restarted {
            notes.push(note(
                "the log began again before this window".into(),
                "windows are counted from its new beginning; the last result is still the start",
                "none needed",
            ));
        }
        notes.extend(broken.map(|told| note(told, "the window ends there", "see why the log began again")));
        lost.tell(&mut notes);
        let expected = self.period().map_or(0.0, |period| self.window / period);
        let end = columns.first().and_then(|(_, t)| t.last()).copied().unwrap_or(self.last);
        let span = [self.begins(index), self.begins(index + 1).min(end + self.period().unwrap_or(0.0))];
        Some(Cut { number, span, columns, expected, notes })
    }
}

const SAME: &str = "give every batch of a stream the same columns";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_leads_ends_at_the_first_bad_value_wherever_it_stands() {
        let rising = |last: f64, x: f64| x > last;
        for bad in (0..300).chain([511, 512, 513, 514]) {
            let values: Vec<f64> = (0..515).map(|k| if k == bad { -1.0 } else { f64::from(k) }).collect();
            assert_eq!(leading(-0.5, &values, rising), bad as usize);
        }
        assert_eq!(leading(-0.5, &[], rising), 0);
        let whole: Vec<f64> = (0..515).map(f64::from).collect();
        assert_eq!(leading(-0.5, &whole, rising), 515);
    }
}
