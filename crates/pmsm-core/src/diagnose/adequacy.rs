//! Adequacy of the fitted dq-model. A fit whose residual exceeds the variation of the signal is no model of the recording, and every effect
//! compared with it would seem to explain something.

use super::data::Data;
use super::hypothesis::Hypothesis;
use crate::experiment::{Block, Channel, Prior};
use crate::figures::quantity;
use crate::machine::BaseParameter;
use crate::signals::Finding;

/// Standard deviations of its prior beyond which a parameter has run away: its ordinary scatter is less.
pub const FAR: f64 = 3.0;
/// Relative distance from a bound below which a parameter lies on it: what a bounded fit leaves by rounding.
const AT_BOUND: f64 = 1e-6;
/// Largest share of the variance of a signal that a fit which explains the larger part may leave.
const HALF: f64 = 0.5;

/// Residual of the dq-model in a channel of one recording, and the variation of that channel.
struct Excess {
    run: usize,
    channel: Channel,
    left: f64,
    variation: f64,
}

/// A finding if the residual of a fitted `set` exceeds the variation of a channel: by how much, and which parameter ran away.
pub fn lack_of_fit(data: &Data, set: &Hypothesis) -> Option<Finding> {
    let times = |excess: &Excess| excess.left / excess.variation;
    let what = if set.effects().is_empty() { "dq-model" } else { "set of effects" };
    let worst = excesses(data, set).into_iter().max_by(|a, b| times(a).total_cmp(&times(b)))?;
    let (unit, name) = (worst.channel.unit(), worst.channel.name());
    let place = data.number(worst.run).map_or(String::new(), |number| format!(" of recording {number}"));
    Some(Finding {
        finding: format!(
            "the best {what} has a residual of {:.3} {unit} in {name}{place}, and {name} itself varies by {:.3} {unit} only{}",
            worst.left,
            worst.variation,
            ran_away(data, set, worst.channel).unwrap_or_default()
        ),
        consequence: "this is no model of the recording, and nothing can be said of what is missing in it"
            .into(),
        fix: "check units, signs and n_p, and give the parameters on the nameplate that are missing there"
            .into(),
    })
}

/// Channels whose residual exceeds their variation.
fn excesses(data: &Data, base: &Hypothesis) -> Vec<Excess> {
    let experiment = data.whole(base).plain();
    let left = experiment.relative_rms(&experiment.residual(&base.parameters));
    let each = experiment.blocks().into_iter().zip(left);
    each.filter_map(|(block, left)| {
        let (run, channel) = (block.run, block.channel);
        let floor = data.runs()[run].floors.iter().find(|f| f.channel == channel)?;
        let variation = experiment.runs()[run].variation(channel);
        let left = left * floor.total();
        // Written with `<=`, so that a NaN is no model.
        let still = variation <= data.options.still * floor.sensor;
        let fits = left <= data.options.worse_than_constant * variation || still;
        (!fits).then_some(Excess { run, channel, left, variation })
    })
    .collect()
}

/// Whether a fitted machine explains more than half of the variance of the currents (or the speed) of each recording, where they exceed
/// their noise.
pub fn explains_half(data: &Data, fitted: &Hypothesis, electrical: bool) -> bool {
    let experiment = data.whole(fitted).plain();
    let left = experiment.relative_rms(&experiment.residual(&fitted.parameters));
    let own = |block: &Block| block.channel.is_electrical() == electrical;
    experiment.blocks().iter().zip(left).filter(|(block, _)| own(block)).all(|(block, left)| {
        let floor = data.runs()[block.run].floors.iter().find(|f| f.channel == block.channel);
        let variation = experiment.runs()[block.run].variation(block.channel);
        floor.is_some_and(|floor| {
            variation <= data.options.still * floor.sensor
                || (left * floor.total()).powi(2) < HALF * variation * variation
        })
    })
}

/// Whether a base parameter of the motion has run away from what is known of it.
pub fn contradicts_nameplate(data: &Data, fitted: &Hypothesis) -> bool {
    ran_away(data, fitted, Channel::OmegaE).is_some()
}

/// The base parameter of the channel's equations that lies farthest from what is known of it, with both values, or that sits at its bound.
fn ran_away(data: &Data, base: &Hypothesis, channel: Channel) -> Option<String> {
    let own = |p: &BaseParameter| BaseParameter::ELECTRICAL.contains(p) == channel.is_electrical();
    let candidates = BaseParameter::ALL.into_iter().filter(|p| own(p) && base.free.contains(&p.index()));
    let told = |p: BaseParameter| {
        let (value, unit) = (base.parameters[p.index()], p.unit());
        let prior: Option<&Prior> = data.prior.iter().find(|prior| prior.index == p.index());
        let (off, against) = match (data.nameplate[p.index()], prior) {
            (Some(stated), Some(prior)) => {
                (prior.off(value).0.abs(), format!("the nameplate states {}", quantity(stated, 4, unit)))
            }
            (None, Some(prior)) => (
                prior.off(value).0.abs(),
                format!("a machine of this torque and speed has about {}", quantity(prior.value, 2, unit)),
            ),
            _ => {
                let (low, high) = p.physical_range();
                // No friction at all is where a bearing may be.
                let bound =
                    [low, high].into_iter().find(|b| *b > 0.0 && (value - b).abs() <= AT_BOUND * b)?;
                (f64::INFINITY, format!("its bound is {}", quantity(bound, 1, unit)))
            }
        };
        Some((off, format!("; {} ran away to {}, where {against}", p.name(), quantity(value, 4, unit))))
    };
    let farthest = candidates.filter_map(told).max_by(|a, b| a.0.total_cmp(&b.0))?;
    (farthest.0 > FAR).then_some(farthest.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{data, setup, speeds};

    /// The fitted dq-model with another inertia, by this factor.
    fn with_inertia(data: &Data, base: &Hypothesis, factor: f64) -> Hypothesis {
        let mut parameters = base.parameters.clone();
        parameters[BaseParameter::J.index()] *= factor;
        Hypothesis::on(data, base.model.clone(), parameters, base.free.clone(), base.nuisances.clone())
    }

    #[test]
    fn no_floor_lies_above_its_signal_and_a_machine_that_ran_away_is_told_with_its_parameter() {
        let setup = setup(speeds(1.0, &[(0.1, 80.0), (0.4, -60.0), (0.8, 70.0)]), Vec::new());
        let (mut data, base) = data(&setup);
        assert_eq!(lack_of_fit(&data, &base), None);
        let away = with_inertia(&data, &base, 1e-4);
        let said = lack_of_fit(&data, &away).unwrap().finding;
        assert!(said.contains("omega_e") && said.contains("j ran away"), "{said}");
        data.settle_floors(&away);
        let experiment = data.whole(&away);
        for floor in &data.floors {
            let variation = experiment.runs()[0].variation(floor.channel);
            assert!(floor.total() <= 1.000_001 * variation, "{floor:?} {variation}");
        }
        assert!(lack_of_fit(&data, &with_inertia(&data, &base, 1e-4)).is_some());
    }
}
