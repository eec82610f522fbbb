//! Consistency of several recordings: whether one set of parameters holds for all.
//!
//! A mismatch of the joint fit may vanish in fits to each recording, at other parameters. Another machine, another temperature or a change
//! in between is then the cause, and no effect of the catalogue.

use super::data::Data;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::wording::times;
use crate::effect::Site;
use crate::effects::EffectId;
use crate::error::Result;
use crate::experiment::Channel;
use crate::figures::quantity;
use crate::machine::BaseParameter;
use crate::monitor::Monitor;
use crate::signals::Finding;

/// Largest share of its excess mean square that a contradicting recording keeps when it is fitted alone.
const ALONE: f64 = 0.25;

/// A contradiction between recordings.
pub struct Contradiction {
    /// The finding.
    pub finding: Finding,
    /// Whether it lies in the voltage equations.
    electrical: bool,
}

impl Contradiction {
    /// Whether the effects that were found may only describe it: one acts in the same equations, or none was found.
    pub fn concerns(&self, found: &[EffectId]) -> bool {
        let same = |effect: &EffectId| match effect.info().site {
            Site::Sensor => true,
            site => (site == Site::Electrical) == self.electrical,
        };
        found.is_empty() || found.iter().any(same)
    }
}

/// The contradiction if the settled model explains recordings alone that it does not explain together.
///
/// # Errors
/// Those of the least-squares fits.
pub fn contradiction(data: &Data, best: &Hypothesis, monitor: &dyn Monitor) -> Result<Option<Contradiction>> {
    let blocks = data.whole(best).blocks();
    let left = best.squares.iter().any(|(_, square)| *square > 1.0 + data.options.mismatch);
    if data.number(0).is_none() || !left {
        return Ok(None);
    }
    let fit = |part: &Data| fitting::fit(part, &best.model, best.own(), false, monitor);
    let alone: Vec<Hypothesis> = data.parts.iter().map(fit).collect::<Result<_>>()?;
    let worse = |at: usize| {
        let block = &blocks[at];
        let (together, own) = (best.squares[at].1, alone[block.run].square(block.channel));
        let contradicts = together > 1.0 + data.options.mismatch && own - 1.0 < ALONE * (together - 1.0);
        contradicts.then_some((block, together, own))
    };
    let worst = (0..blocks.len()).filter_map(worse).max_by(|a, b| a.1.total_cmp(&b.1));
    Ok(worst.map(|(block, together, own)| {
        let finding = format!(
            "the recordings contradict each other: fitted together the model has a residual of {} times the noise in {} of \
             recording {}, fitted to it alone {} times{}",
            times(together.sqrt()),
            block.channel.name(),
            data.number(block.run).unwrap_or(1),
            times(own.sqrt()),
            parameter_words(data, &alone, block.channel)
        );
        let consequence = "one machine does not explain them all, and an effect named in these equations may only describe \
                           the difference";
        let fix = "diagnose each by itself, or give together only what was recorded in one state, equally warm";
        let finding = Finding { finding, consequence: consequence.into(), fix: fix.into() };
        Contradiction { finding, electrical: block.channel.is_electrical() }
    }))
}

/// The base parameter of the channel's equation on which the recordings differ most, relative to its size.
fn parameter_words(data: &Data, alone: &[Hypothesis], channel: Channel) -> String {
    let group =
        if channel.is_electrical() { &BaseParameter::ELECTRICAL[..] } else { &BaseParameter::MECHANICAL[..] };
    let spread = |p: &&BaseParameter| -> f64 {
        let values = values(data, alone, **p);
        let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(l, h), (_, x)| (l.min(*x), h.max(*x)));
        (high - low) / high.abs().max(low.abs()).max(f64::MIN_POSITIVE)
    };
    let Some(parameter) = group.iter().max_by(|a, b| spread(a).total_cmp(&spread(b))) else {
        return String::new();
    };
    let told: Vec<String> = values(data, alone, *parameter)
        .iter()
        .map(|(run, x)| format!("{} in recording {run}", quantity(*x, 4, parameter.unit())))
        .collect();
    if told.len() < 2 {
        String::new()
    } else {
        format!("; alone {} is {}", parameter.name(), told.join(" and "))
    }
}

/// Values of a parameter in the recordings whose equations contain it.
fn values(data: &Data, alone: &[Hypothesis], parameter: BaseParameter) -> Vec<(usize, f64)> {
    let each = data.parts.iter().zip(alone).enumerate();
    each.filter(|(_, (part, _))| part.needs(parameter))
        .map(|(run, (_, fitted))| (data.number(run).unwrap_or(1), fitted.parameters[parameter.index()]))
        .collect()
}

#[cfg(test)]
mod tests {
    use crate::diagnose::answer::{Answer, Verdict};
    use crate::diagnose::diagnose;
    use crate::diagnose::testing::{setup, speeds};
    use crate::drive::simulate;
    use crate::machine::BaseParameter;
    use crate::monitor::Silent;
    use crate::recording::Recording;

    #[test]
    fn recordings_of_two_machines_are_told_as_such() {
        let manoeuvre = speeds(0.8, &[(0.1, 60.0), (0.3, -60.0), (0.5, 80.0)]);
        let one = setup(manoeuvre, Vec::new());
        let mut other = one.clone();
        other.machine = other.machine.with(BaseParameter::J, 1.3 * 0.008).unwrap();
        let runs = [&one, &other].map(|s| simulate(s, &Silent).unwrap().recording);
        let ask = |runs: [&Recording; 2]| {
            diagnose(&runs, &one.nameplate, None, &Default::default(), &Silent).unwrap()
        };
        let said = |answer: &Answer| {
            answer.data_quality.iter().map(|f| f.finding.clone()).find(|f| f.contains("contradict"))
        };
        let different = ask([&runs[0], &runs[1]]);
        let text = said(&different).unwrap();
        assert!(text.contains("omega_e") && text.contains("alone j is"), "{text}");
        assert_eq!(different.verdict, Verdict::Undetermined);
        assert!(
            different.ranking.iter().all(|c| c.probability <= different.options.ceiling_unknown),
            "{:?}",
            different.ranking
        );
        let again =
            simulate(&crate::drive::Setup { seed: one.seed + 1, ..one.clone() }, &Silent).unwrap().recording;
        let same = ask([&runs[0], &again]);
        assert_eq!((said(&same), same.verdict), (None, Verdict::NoMismatch));
    }
}
