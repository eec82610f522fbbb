//! Data quality: what the user should know of the recordings behind an answer.

use super::collinearity::{self, Collinearity};
use super::coverage;
use super::data::Data;
use super::hypothesis::Hypothesis;
use super::verdict;
use super::wording::times;
use crate::effects::EffectId;
use crate::figures::figure;
use crate::recording::Kind;
use crate::signals::{self, Finding};

/// Findings on the recordings and on what they determine, for the answer on a set whose parameters `found` are collinear.
pub fn findings(data: &Data, weak: &[String], found: &[Collinearity], refuted: bool) -> Vec<Finding> {
    let mut findings = data.signals.findings.clone();
    let noise: Vec<Vec<Finding>> = data.runs().iter().map(|run| run.input.findings(&run.signals)).collect();
    findings.extend(signals::join::findings(noise.iter().map(Vec::as_slice)));
    findings.extend(collinearity::findings(found));
    if data.signals.kind == Kind::OperatingPoints && data.signals.averaged == 1 {
        findings.push(Finding {
            finding: "the samples are far apart compared with the electrical time constants".into(),
            consequence: "they are taken as steady operating points; nothing is said about transients or ripple".into(),
            fix: "sample at the switching frequency for those questions".into(),
        });
    }
    let richer = match data.signals.kind {
        Kind::OperatingPoints => "record points at other levels of i_q and i_d, and in both directions",
        _ => "add reversals, a second level of i_q and steps of i_d",
    };
    if !weak.is_empty() {
        findings.push(Finding {
            finding: format!("the recording does not pin down {}", weak.join(", ")),
            consequence: "effects that resemble a change of these parameters cannot be told from it".into(),
            fix: richer.into(),
        });
    }
    if weak.is_empty() && coverage::stays_at_one_point(&data.signals) {
        findings.push(Finding {
            finding: "the machine was recorded at one speed and load".into(),
            consequence: "what has the same form there cannot be told apart, and nothing is said of other speeds and loads".into(),
            fix: richer.into(),
        });
    }
    if refuted {
        findings.push(Finding {
            finding: "what fits this recording predicts the validation run worse than the dq-model alone"
                .into(),
            consequence: "the candidates are listed, but none is put into the model".into(),
            fix: "diagnose a manoeuvre with reversals, two levels of i_q and steps of i_d".into(),
        });
    }
    findings
}

/// A finding if the source resistance of a sagging link was found from a link voltage that nobody stated.
pub fn link_assumed(data: &Data, found: &Hypothesis) -> Option<Finding> {
    let signals = &data.leading().signals;
    let rests = found.effects().contains(&EffectId::DcLinkSag) && !signals.link_stated;
    rests.then(|| Finding {
        finding: format!(
            "r_source rests on a link of {} V, the least that makes the largest voltage: v_dc is not stated",
            figure(signals.context.v_dc, 3)
        ),
        consequence: "it goes with the square of the true link voltage, and may be several times as large"
            .into(),
        fix: "state v_dc in [drive]".into(),
    })
}

/// A finding if a model fitted to a poor recording does not predict the validation run.
pub fn not_predicted(on_validation: &Hypothesis, limit: f64) -> Option<Finding> {
    if verdict::largest_excess(on_validation) <= limit {
        return None;
    }
    let (channel, square) = on_validation.squares.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(Finding {
        finding: format!(
            "on the validation run the model has a residual of {} times the noise in {}",
            times(square.sqrt()),
            channel.name()
        ),
        consequence: "either a parameter that this recording does not pin down is wrong, or something is missing that it does not show"
            .into(),
        fix: "diagnose the validation run by itself, or both recordings together".into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};

    #[test]
    fn a_source_resistance_from_a_link_that_nobody_stated_is_told() {
        let mut setup = setup(
            speeds(0.6, &[(0.1, 90.0), (0.3, -80.0), (0.5, 60.0)]),
            vec![choice("dc_link_sag", "r_source", 3.0)],
        );
        let told = |setup: &_| {
            let (data, base) = data(setup);
            let sag = fitted(&data, &base, EffectId::DcLinkSag);
            assert_eq!(link_assumed(&data, &base), None);
            link_assumed(&data, &sag)
        };
        assert_eq!(told(&setup), None);
        setup.drive.v_dc = setup.nameplate.v_dc.take();
        assert!(told(&setup).unwrap().finding.contains("v_dc is not stated"));
    }
}
