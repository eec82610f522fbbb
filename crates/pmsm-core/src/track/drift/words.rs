//! What a movement looks like, in words.

use super::{Cause, Move};
use crate::figures;
use crate::identify::Target;
use crate::machine::BaseParameter;
use crate::track::noise::Noise;

/// Standard deviations from which a residual is not white.
pub const WHITE: f64 = 6.0;
/// Ratio of variances from which it matters.
pub const EXCESS: f64 = 1.5;
/// Share of a channel's peak from which it matters.
const RELEVANT: f64 = 1e-3;
/// Copper at 50 A/mm² without any cooling gains about 5 % of resistance per second.
const FASTEST_HEATING: f64 = 0.05;

/// What a movement of a parameter looks like, and the sentence that says so.
pub fn explain(target: Target, moved: Move) -> (Cause, String) {
    let (name, unit) = (target.name(), target.unit());
    let told = match moved {
        Move::Trend { change, from, time, .. } => {
            let way = if change > 0.0 { "rises" } else { "falls" };
            format!(
                "{name} {way} steadily, from {} to {} {unit} in {time:.3} s",
                figure(from),
                figure(from + change)
            )
        }
        Move::Jump { change, from } => {
            format!("{name} jumps from {} to {} {unit}", figure(from), figure(from + change))
        }
    };
    let (cause, why) = match (target, moved) {
        (Target::Base(BaseParameter::RS), Move::Trend { change, from, time, cooled, current }) => {
            let heat = if change > 0.0 { current } else { cooled };
            let rate = (change / from / time).abs();
            match heat {
                true if rate > FASTEST_HEATING => (
                    Cause::Thermal,
                    format!(
                        ", as when a winding changes its temperature, though {:.0} % per second is faster than copper can",
                        100.0 * rate
                    ),
                ),
                true => (Cause::Thermal, ", as when a winding changes its temperature".to_owned()),
                false => (Cause::Mismatch, ", which the current's heat does not explain".to_owned()),
            }
        }
        (Target::Base(BaseParameter::RS), Move::Jump { .. }) => (
            Cause::Mismatch,
            ", which heat cannot do: a contact, or something the model leaves out".to_owned(),
        ),
        (Target::Base(BaseParameter::PsiM), Move::Trend { change, .. }) if change < 0.0 => {
            (Cause::Thermal, ", as when magnets warm up".to_owned())
        }
        (Target::TauLoad, _) => (Cause::Load, ": the load changes".to_owned()),
        (Target::Base(BaseParameter::J | BaseParameter::B), _) => {
            (Cause::Load, ": what turns with the rotor changes".to_owned())
        }
        _ => (Cause::Mismatch, ", though it is no quantity that should move by itself".to_owned()),
    };
    (cause, format!("{told}{why}."))
}

/// A number with four significant digits.
fn figure(x: f64) -> String {
    figures::figure(x, 4)
}

/// Says so if the residual of a channel is more than white noise.
pub fn coloured(rms: &[(&'static str, f64)], noise: &[Noise], n: usize) -> Option<String> {
    let error = (2.62 / n as f64).sqrt();
    let worst = rms
        .iter()
        .filter_map(|(channel, rms)| {
            let noise = noise.iter().find(|x| x.channel == *channel)?;
            let ratio = (rms / noise.sigma.max(f64::MIN_POSITIVE)).powi(2);
            let excess = (rms * rms - noise.sigma * noise.sigma).max(0.0).sqrt();
            let counts = (ratio - 1.0) / error > WHITE && ratio > EXCESS && excess > RELEVANT * noise.peak;
            counts.then_some((*channel, ratio.sqrt()))
        })
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(format!(
        "{} has a residual of {:.1} times its noise. The model leaves something out, or the load or a parameter changed within \
         the window; the estimates take it up in part.",
        worst.0, worst.1
    ))
}
