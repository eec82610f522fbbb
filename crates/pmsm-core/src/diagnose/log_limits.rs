//! Whether the log itself, and not the machine, may have caused what a model leaves. Missing physics is a function of what moves the machine:
//! a map of it predicts other data. What a log cannot hold, such as the voltage between its rows or the error of an angle in steps, is none.

use super::data::Data;
use super::unmodelled::Unmodelled;
use crate::signals::Finding;

/// Why nothing can be said of what is left, where no map predicts it and the log is limited.
pub fn may_have_caused(data: &Data, rest: &Unmodelled) -> Option<String> {
    let of_run = |run: &Data| run.signals.limits.first().cloned().or_else(|| run.input.of_rows(&run.signals));
    let Finding { finding, fix, .. } =
        data.runs().iter().find_map(of_run).filter(|_| rest.terms.is_empty())?;
    Some(format!(
        "the dq-model has a residual above the noise, no function of speed, angle, currents and time predicts it, and the log may have caused it: {finding}; {fix}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{data, setup, speeds};

    #[test]
    fn what_a_limited_log_may_have_caused_is_not_said_of_a_full_one_nor_of_what_a_map_predicts() {
        let (mut data, _) = data(&setup(speeds(1.0, &[(0.1, 80.0), (0.4, -60.0), (0.8, 70.0)]), Vec::new()));
        let rest = Unmodelled { sentence: "The rest stays.".into(), gain_held_out: None, terms: Vec::new() };
        assert_eq!(may_have_caused(&data, &rest), None);
        let said = |text: &str| text.to_string();
        data.signals.limits.found.push(Finding {
            finding: said("the speed is held"),
            consequence: said("its error counts as noise"),
            fix: said("log it in every row"),
        });
        let why = may_have_caused(&data, &rest).unwrap();
        assert!(why.ends_with("the speed is held; log it in every row"), "{why}");
    }
}
