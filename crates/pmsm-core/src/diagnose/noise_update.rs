//! Noise measured again with the best set. The residual of the dq-model held missing physics as well as noise.

use super::adequacy;
use super::data::Data;
use super::hypothesis::Hypothesis;
use super::verdict::Validated;
use crate::effect::Site;
use crate::experiment::Channel;
use crate::experiment::floor::Floor;

/// Share of the voltage noise under the dq-model to which the best set must lower it; a smaller change may be scatter of its estimate.
const QUIETER: f64 = 0.93;

/// Measures the noise again with the best set, and says whether that changed it.
///
/// It does where part of the voltage noise was missing physics or was hidden by it, or where the driven noise of the speed was hidden: by an
/// inertia that missing torques had made too large, too.
pub fn update(whole: &mut Data, others: &mut [Data], base: &Validated, best: &Validated) -> bool {
    // Impacts that fall a little beside their times leave what looks like noise of the torque.
    if best.fitted.effects().iter().any(|e| e.is_multimodal()) {
        return false;
    }
    let noisy = whole.input.voltage > 0.0;
    // A set that reaches the floors hides no noise. An effect on a poor recording that the dq-model explains is not believed.
    // The residual of the speed is noise of the torque only if the effects found have exact forms.
    let exact = best.fitted.effects().iter().all(|e| e.info().site == Site::Mechanical);
    let far = exact && others.iter().chain([&*whole]).any(|data| unfiltered(data) > 0);
    let mismatch = whole.options.mismatch;
    let hides = noisy || best.excess() > mismatch || far;
    let real = !whole.poor || base.excess() > mismatch;
    if best.fitted.effects().is_empty() || !hides || !real {
        return false;
    }
    let again = updated(whole, &best.fitted);
    let (before, now) = (whole.input.voltage, again.input.voltage);
    let physics = if noisy { now <= QUIETER * before } else { now > 0.0 };
    let louder = best.excess() > mismatch
        && !adequacy::contradicts_nameplate(whole, &best.fitted)
        && speed_noise(&again).zip(speed_noise(whole)).any(|(now, before)| QUIETER * now > before);
    if !physics && !far && !louder {
        return false;
    }
    let theirs: Vec<Data> = others.iter().zip(&best.held_out).map(|(d, found)| updated(d, found)).collect();
    let filtered = |before: &Data, now: &Data| unfiltered(now) < unfiltered(before);
    if !physics
        && !louder
        && !filtered(whole, &again)
        && !others.iter().zip(&theirs).any(|(a, b)| filtered(a, b))
    {
        return false;
    }
    *whole = again;
    for (data, again) in others.iter_mut().zip(theirs) {
        *data = again;
    }
    true
}

/// Recordings with the noise measured again with the set `found`.
pub fn updated(data: &Data, found: &Hypothesis) -> Data {
    let mut again = data.clone();
    again.settle_floors(found);
    again
}

/// Floor of the speed of each recording that has one, rad/s.
fn speed_noise(data: &Data) -> impl Iterator<Item = f64> {
    let speed = |run: &Data| run.floors.iter().find(|f| f.channel == Channel::OmegaE).map(Floor::total);
    data.runs().iter().filter_map(speed)
}

/// Number of recordings whose speed has driven noise that is not filtered.
pub fn unfiltered(data: &Data) -> usize {
    data.runs().iter().filter(|run| run.wanders_unfiltered()).count()
}
