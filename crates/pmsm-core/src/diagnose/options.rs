//! The constants on which a verdict rests, each with its meaning and the reason for its value.
//!
//! Some belong to the likelihood (how much a row counts), some to the priors (how rare an effect is), the others say from where on a verdict
//! speaks. None belongs to a kind of machine or to an effect. Every answer lists them.
//!
//! They are definitions and priors: no command computes them. `make proof SPLIT=calibration` counts right and wrong verdicts on the cases on
//! which a value may be changed; `docs/proof.md` says which cases these are.

use crate::effects::text::OwnEffects;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// The constants on which a verdict rests. All are pure numbers unless they say otherwise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DiagnosisOptions {
    /// Rows of a waveform that count as one independent sample. Inexact forms of effects, quantisation and an inexact noise floor cause
    /// correlated errors, which row by row would call for effects that do not exist. Steady points and rows at open terminals count each.
    pub rows_per_sample: f64,
    /// Fewest independent samples of a channel: a short recording counts, too.
    pub fewest_samples: f64,
    /// Mean square, over that of the noise floor, below which a model gains nothing: the mean square of the floor is uncertain by a tenth.
    pub floor_known_to: f64,
    /// Prior cost of an effect, nats. The natural logarithm of prior odds of 1 to 20 is -3.0: of all effects of the catalogue one or two are
    /// missing. Physics outside the catalogue is as rare.
    pub effect_cost: f64,
    /// Prior cost of a coefficient of a map, nats. It is below the price of a parameter, since a ridge holds the coefficient near zero.
    pub coefficient_cost: f64,
    /// Gain from which a set counts as better, nats: by definition posterior odds of ten to one, ln 10.
    pub decisive: f64,
    /// Prior probability of physics outside the catalogue where a set reaches the noise. It limits the probability of a name to 0.98.
    pub unknown: f64,
    /// Posterior probability from which an effect is named beside something else: by definition nine names of ten are right.
    pub named: f64,
    /// Excess mean square that an effect must explain beside the others, over the excess that remains: by definition at least as much. It is
    /// asked where something else is missing, beside the discrepancy, and where inexact forms of effects may be the cause of the rest.
    pub beside_remainder: f64,
    /// Most effects in one set: a limit of computing time above the number that recordings have shown at once.
    pub most_effects: usize,
    /// Excess mean square, over the floor's, from which a channel is mismatched. Below it the uncertainty of the floor may be the cause, and
    /// nothing is looked for.
    pub mismatch: f64,
    /// The same on a recording that was not used for fitting, where errors of the parameters add to it.
    pub mismatch_held_out: f64,
    /// Excess mean square up to which a channel counts as explained, about the uncertainty of the floor. An effect is named only if it lowers
    /// the mean square of a channel by more.
    pub explained: f64,
    /// Multiple of the dq-model's mean square on another recording beyond which a model is refuted, with `refuted_by` added: by definition it
    /// predicts far worse.
    pub refuted_times: f64,
    /// Mean square, over the floor's, that is added to that multiple. It keeps noise from refuting a model where the dq-model has no mismatch.
    pub refuted_by: f64,
    /// Residual, times the noise, from which a further cause is missing. A smaller one may be the error of the forms of right effects: real
    /// saturation curves, shaft dampings and friction humps are not quite those of the catalogue.
    pub remaining_times: f64,
    /// Probability of so large a residual by chance above which nothing is said to remain: the level of a significance test.
    pub remaining_chance: f64,
    /// Highest probability of any name where nothing is named, or where another recording contradicts it: by definition below an even chance.
    pub ceiling_unknown: f64,
    /// Highest probability of a name in doubt: by definition an even chance. Something else remains beside it, a poor recording does not
    /// predict another one, or the 95 % interval of its strength holds zero.
    pub ceiling_doubtful: f64,
    /// Standard deviation of the logarithm of a nameplate value: magnets and windings scatter and warm up.
    pub nameplate_spread: f64,
    /// Standard deviation of a stated friction, or of a value of zero, share of the value: a bearing's friction may vanish.
    pub friction_spread: f64,
    /// Time in which its largest torque brings a rotor to its largest speed, s: the prior of an inertia that no nameplate states.
    pub run_up: f64,
    /// Standard deviation of the logarithm of that time, a factor of ten: milliseconds in a servo, half a minute in a vehicle.
    pub run_up_spread: f64,
    /// Factor by which the residual of a dq-model may exceed the signal's own variation: in a short window accumulated noise does that.
    pub worse_than_constant: f64,
    /// A signal that varies by less than this many times its noise has nothing to explain.
    pub still: f64,
    /// Effects given as text, which are asked about besides those of the catalogue.
    #[serde(skip_serializing_if = "OwnEffects::is_empty")]
    pub effects: OwnEffects,
}

impl Default for DiagnosisOptions {
    fn default() -> Self {
        Self {
            rows_per_sample: 100.0,
            fewest_samples: 10.0,
            floor_known_to: 0.9,
            effect_cost: 3.0,
            coefficient_cost: 0.5,
            decisive: 2.3,
            unknown: 0.02,
            named: 0.9,
            beside_remainder: 1.0,
            most_effects: 10,
            mismatch: 0.3,
            mismatch_held_out: 1.0,
            explained: 0.12,
            refuted_times: 2.0,
            refuted_by: 1.0,
            remaining_times: 1.5,
            remaining_chance: 1e-3,
            ceiling_unknown: 0.4,
            ceiling_doubtful: 0.5,
            nameplate_spread: 0.2,
            friction_spread: 0.3,
            run_up: 0.3,
            run_up_spread: 2.3,
            worse_than_constant: 1.1,
            still: 2.0,
            effects: OwnEffects::default(),
        }
    }
}

impl DiagnosisOptions {
    /// Excess mean square up to which the forms of right effects may err. Beyond it a further cause is missing.
    pub fn form_error(&self) -> f64 {
        self.remaining_times.powi(2) - 1.0
    }

    /// Checks that each is a number with which a diagnosis can be made.
    ///
    /// # Errors
    /// [`Error::Unusable`] naming the first that is not finite or not above zero, or the probability above one.
    pub fn check(&self) -> Result<()> {
        let serde_json::Value::Object(each) = serde_json::to_value(self)
            .map_err(|e| Error::unusable(format!("the options are not readable: {e}"), "give numbers"))?
        else {
            return Ok(());
        };
        let shares =
            ["floor_known_to", "unknown", "named", "remaining_chance", "ceiling_unknown", "ceiling_doubtful"];
        for (name, value) in each.into_iter().filter(|(name, _)| name != "effects") {
            let value = value.as_f64().unwrap_or(f64::NAN);
            if !value.is_finite() || value <= 0.0 || shares.contains(&name.as_str()) && value > 1.0 {
                let range = if shares.contains(&name.as_str()) { " up to one" } else { "" };
                return Err(Error::unusable(
                    format!("the option {name} is {value}"),
                    format!("give a finite number above zero{range}"),
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_come_back_from_json_and_a_part_of_them_is_enough() {
        let options = DiagnosisOptions { named: 0.95, ..DiagnosisOptions::default() };
        let text = serde_json::to_string(&options).unwrap();
        assert_eq!(serde_json::from_str::<DiagnosisOptions>(&text).unwrap(), options);
        assert_eq!(serde_json::from_str::<DiagnosisOptions>("{\"named\": 0.95}").unwrap(), options);
        assert!(serde_json::from_str::<DiagnosisOptions>("{\"name\": 0.95}").is_err());
    }

    #[test]
    fn what_is_no_probability_or_no_number_is_refused_by_name() {
        assert!(DiagnosisOptions::default().check().is_ok());
        let refused = |options: DiagnosisOptions| options.check().unwrap_err().to_string();
        let default = DiagnosisOptions::default;
        assert!(refused(DiagnosisOptions { named: 1.2, ..default() }).contains("named"));
        assert!(refused(DiagnosisOptions { mismatch: f64::NAN, ..default() }).contains("mismatch"));
        assert!(refused(DiagnosisOptions { still: 0.0, ..default() }).contains("still"));
    }
}
