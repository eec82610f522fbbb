//! The answer of a diagnosis, schema `pmsm-rs.diagnosis/2`.

use super::budget::Budget;
use super::locate::Located;
use super::options::DiagnosisOptions;
use super::remaining::Remaining;
use super::unmodelled::Unmodelled;
use crate::effects;
use crate::signals::Finding;
use crate::specification::Specification;
use serde::Serialize;
use std::collections::BTreeMap;

/// Normal quantile of a two-sided interval of 95 %.
pub(super) const Z95: f64 = 1.959_964;

/// Version of the answer's form.
pub const SCHEMA: &str = "pmsm-rs.diagnosis/2";

/// What the diagnosis concludes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The dq-model explains the recording, and the validation run, down to the noise.
    NoMismatch,
    /// The omitted physics is named.
    Named,
    /// Named physics is missing, and something more beside it.
    Partial,
    /// Several effects explain it equally well.
    Ambiguous,
    /// Something is missing, and no effect of the catalogue has enough evidence for a name.
    Unknown,
    /// Nothing can be said: the recording shows too little, the fitted machine is no model of it, or recordings contradict each other.
    /// `reason` says which.
    Undetermined,
}

/// A parameter with its uncertainty.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Estimate {
    /// Value in `unit`; none if the recording does not show it.
    pub value: Option<f64>,
    /// Standard error.
    pub stderr: Option<f64>,
    /// 95 % interval.
    pub ci95: Option<[f64; 2]>,
    /// SI unit.
    pub unit: String,
    /// Why there is no value, or no uncertainty; none where both are given.
    pub why_none: Option<String>,
}

/// One candidate effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Candidate {
    /// Identifier.
    pub effect: String,
    /// Probability.
    pub probability: f64,
    /// What was left out, in plain words.
    pub sentence: String,
    /// Its equation.
    pub equation: String,
    /// Its fitted parameters.
    pub parameters: BTreeMap<String, Estimate>,
    /// Effects that this recording cannot tell from this one.
    pub equivalent_to: Vec<String>,
    /// Share of the excess mean square that it removes, between −1 and 1: on the recordings that were not fitted, or on the fitted one without
    /// any. It is the share of the whole set that holds the effect.
    pub gain_held_out: f64,
}

/// The model that was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FoundModel {
    /// Its effects.
    pub effects: Vec<String>,
    /// Its base parameters.
    pub base: BTreeMap<String, Estimate>,
    /// Where the verdict is `unknown` or `partial`: a map of what no effect explains.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unmodelled: Option<Unmodelled>,
    /// What is needed to simulate it again, to the bit; none where nothing was fitted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub specification: Option<Specification>,
    /// Covariance of what was estimated; none where nothing was fitted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub covariance: Option<Covariance>,
}

/// Estimated parameters and their covariance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Covariance {
    /// Their names: a base parameter's own, `EFFECT.PARAMETER` of an effect.
    pub names: Vec<String>,
    /// Their values, SI: without a map of missing torques and voltages beside them. Where no effect is named, base parameters may be better known beside it.
    pub values: Vec<f64>,
    /// One row per name, in the products of their SI units; none where the recording does not show one.
    pub matrix: Vec<Vec<Option<f64>>>,
}

impl Covariance {
    /// Takes value and standard error of a parameter from a fit of its own, of which no covariance with the others is known.
    pub(super) fn known_by_itself(&mut self, name: &str, value: f64, stderr: f64) {
        let Some(at) = self.names.iter().position(|own| own == name) else { return };
        self.values[at] = value;
        self.matrix[at].fill(None);
        self.matrix.iter_mut().for_each(|row| row[at] = None);
        self.matrix[at][at] = Some(stderr * stderr);
    }
}

/// One step on the way from the dq-model to the model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Step {
    /// Effects so far.
    pub effects: Vec<String>,
    /// Base parameters, an unknown load with them.
    pub base: BTreeMap<String, Estimate>,
    /// Parameters of each effect.
    pub parameters: BTreeMap<String, BTreeMap<String, Estimate>>,
    /// Root mean square of measured minus model on the recording by channel.
    pub rms: BTreeMap<String, f64>,
}

/// An effect that the recording would not show.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unseen {
    /// Identifier.
    pub effect: String,
    /// Why.
    pub why: String,
    /// Probability that it would be found at its typical strength.
    pub power: f64,
}

/// Root mean square of measured minus model by channel, before and after.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct BeforeAfter {
    /// The dq-model with all its parameters estimated.
    pub before: BTreeMap<String, f64>,
    /// The found model.
    pub after: BTreeMap<String, f64>,
}

/// Fit on the recording and on the validation run.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct FitTable {
    /// On the recording.
    pub recording: BeforeAfter,
    /// On the validation run; empty without one.
    pub validation: BeforeAfter,
}

/// One of several recordings that were fitted together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OfRecording {
    /// Number of samples.
    pub samples: usize,
    /// Time from its first to its last sample, s.
    pub duration: f64,
    /// Which questions it can answer.
    pub kind: crate::recording::Kind,
    /// What is known of its load.
    pub load: &'static str,
    /// What a perfect model would leave in each of its channels.
    pub noise_floor: BTreeMap<String, f64>,
    /// Root mean square of measured minus model, before and after.
    pub fit: BeforeAfter,
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Answer {
    /// Version of this schema.
    pub schema: &'static str,
    /// Conclusion.
    pub verdict: Verdict,
    /// What the user should know of the data.
    pub data_quality: Vec<Finding>,
    /// Every constant on which the verdict rests.
    pub options: DiagnosisOptions,
    /// Where the dq-model fails.
    pub located: Vec<Located>,
    /// Residual of each equation beyond the noise beside the effects that were found, named or not, largest first; empty where they reach it.
    pub remaining: Vec<Remaining>,
    /// Share of the mismatch that each effect explains, by channel and run.
    pub budget: Vec<Budget>,
    /// Why nothing is said, where the verdict is `undetermined`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Candidate effects, those of the model first, then by probability.
    pub ranking: Vec<Candidate>,
    /// The model that was found.
    pub model: FoundModel,
    /// The way from the dq-model to that model, one effect more at each step.
    pub path: Vec<Step>,
    /// What the recording would not show.
    pub cannot_see: Vec<Unseen>,
    /// The recording that would decide.
    pub next_experiment: Option<String>,
    /// What a perfect model would leave in each channel.
    pub noise_floor: BTreeMap<String, f64>,
    /// Before and after.
    pub fit: FitTable,
    /// Which questions the recording could answer; none where it could not be read as one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recording_kind: Option<crate::recording::Kind>,
    /// Each of several recordings by itself, in the order in which they were given; empty for one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub recordings: Vec<OfRecording>,
    /// Signals and predictions of the recording and of the validation run, by name; not part of the JSON.
    #[serde(skip)]
    pub traces: Traces,
}

impl Answer {
    /// Where nothing can be said: nothing is located, ranked or seen, and `why` is all that is known.
    pub fn undetermined(why: Finding) -> Self {
        let unseen = |effect: &effects::EffectId| Unseen {
            effect: effect.id().into(),
            why: why.finding.clone(),
            power: 0.0,
        };
        Self {
            schema: SCHEMA,
            verdict: Verdict::Undetermined,
            cannot_see: effects::ALL.iter().map(unseen).collect(),
            data_quality: vec![why.clone()],
            options: DiagnosisOptions::default(),
            located: Vec::new(),
            remaining: Vec::new(),
            budget: Vec::new(),
            reason: Some(why.reason()),
            ranking: Vec::new(),
            model: FoundModel {
                effects: Vec::new(),
                base: BTreeMap::new(),
                unmodelled: None,
                specification: None,
                covariance: None,
            },
            path: Vec::new(),
            next_experiment: None,
            noise_floor: BTreeMap::new(),
            fit: FitTable::default(),
            recording_kind: None,
            recordings: Vec::new(),
            traces: Traces::default(),
        }
    }

    /// The refusal of recordings that cannot be diagnosed at all, as an answer: the `problem` and what to do about it.
    pub fn refusal(problem: String, fix: String) -> Self {
        let consequence = "nothing can be said of the motor from this recording".into();
        Self::undetermined(Finding { finding: problem, consequence, fix })
    }
}

/// Columns of equal length by name.
pub type Columns = BTreeMap<String, Vec<f64>>;

/// Signals behind an answer.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Traces {
    /// The recording.
    pub recording: Columns,
    /// The validation run; empty without one.
    pub validation: Columns,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_lists_every_effect_as_unseen_and_nothing_else() {
        let answer = Answer::refusal("it stands still".into(), "let it turn".into());
        assert_eq!(answer.verdict, Verdict::Undetermined);
        assert_eq!(answer.cannot_see.len(), effects::ALL.len());
        assert!(answer.cannot_see.iter().all(|u| u.why == "it stands still" && u.power == 0.0));
        assert!(answer.ranking.is_empty() && answer.located.is_empty());
        let text = serde_json::to_value(&answer).unwrap();
        assert_eq!(text["data_quality"][0]["fix"], "let it turn");
        assert!(text.get("recording_kind").is_none());
    }
}
