//! Noise measured once more with the help of what was found: the bare machine was too far off to tell it from what is missing.

use super::data::Data;
use super::hypothesis::Hypothesis;
use super::verdict::Validated;
use crate::effect::Site;

/// Share of the voltages' noise, as the bare machine sees it, below which a better model must bring it to be believed.
const QUIETER: f64 = 0.93;

/// Measures the noise once more with the help of what was found, and says whether part of that on the voltages was physics, or hidden by
/// it, or whether the bare machine was too far from a speed that wanders for it to be judged as such.
pub fn update(whole: &mut Data, others: &mut [Data], base: &Validated, best: &Validated) -> bool {
    let noisy = whole.input.voltage > 0.0;
    // What is explained down to the floors hides no noise, and what is found on a poor recording that the bare machine explains is none.
    // What is left of the motion tells of torques alone where those that were found have exact forms.
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
    if !physics && !far {
        return false;
    }
    let theirs: Vec<Data> = others.iter().zip(&best.held_out).map(|(d, found)| updated(d, found)).collect();
    let filtered = |before: &Data, now: &Data| unfiltered(now) < unfiltered(before);
    if !physics && !filtered(whole, &again) && !others.iter().zip(&theirs).any(|(a, b)| filtered(a, b)) {
        return false;
    }
    *whole = again;
    for (data, again) in others.iter_mut().zip(theirs) {
        *data = again;
    }
    true
}

/// Recordings with the noise measured once more with the help of what was found.
pub fn updated(data: &Data, found: &Hypothesis) -> Data {
    let mut again = data.clone();
    again.settle_floors(found);
    again
}

/// Recordings that show a speed which wanders, and is not judged as such.
pub fn unfiltered(data: &Data) -> usize {
    data.runs().iter().filter(|run| run.wanders_unfiltered()).count()
}
