//! The frame in which a voltage is constant over a control period. The rotor's is assumed until the recording shows the stator's.

use super::data::Data;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::select::{Outcome, Swap};
use super::transfer::transfer;
use super::verdict::beyond_chance;
use crate::effect::Site;
use crate::error::Result;
use crate::monitor::Monitor;
use crate::signals::{Finding, Logged};

/// Share of an excess mean square that may remain where voltages held in the stator's frame explain it. The frame has no free parameter, so
/// that the rest must also be near the noise.
const LEFT: f64 = 0.25;
/// Share by which the mean square of the other channels may rise.
const MORE: f64 = 0.05;
/// Share of the excess of currents or motion that may remain with the logged voltage as the commanded vector; beyond it the reading as a
/// mean is not tried. Under the wrong one of the two readings a quarter remains.
const PROMISING: f64 = 0.6;

/// The frame that the recordings show.
pub enum Frame {
    /// In the stator's frame: the hypothesis fitted anew.
    Stator(Box<Hypothesis>),
    /// In the rotor's: the other recordings with the floors that the hypothesis gives them there.
    Rotor(Vec<Data>),
    /// It was not tested.
    Untested,
}

/// Fits a hypothesis again with voltages held in the stator's frame, and takes them for all recordings where they explain its residual.
///
/// They must explain the currents of all recordings or the motion of all, without any effect, and no other channel may become worse.
/// `known` is the hypothesis on the others where it has been transferred to them; else nothing.
///
/// # Errors
/// Those of the least-squares fits.
pub fn select(
    data: &mut Data,
    others: &mut [Data],
    found: &Hypothesis,
    known: &[Hypothesis],
    monitor: &dyn Monitor,
) -> Result<Frame> {
    let driven = data.has_electrical() && data.runs().iter().all(|run| run.signals.v.is_some());
    if data.signals.stator_held.is_some() || !driven {
        return Ok(Frame::Untested);
    }
    let in_stator = |logged: Logged| -> Result<(Data, Hypothesis)> {
        let mut tried = data.clone();
        tried.hold_in_stator(logged);
        let held = fitting::refit(&tried, found, monitor)?;
        Ok((tried, held))
    };
    let in_rotor = || -> Result<(Vec<Data>, Vec<Hypothesis>)> {
        let (mut theirs, mut before) = (others.to_vec(), vec![found.clone()]);
        for (run, other) in theirs.iter_mut().enumerate() {
            let transferred = match known.get(run) {
                Some(known) => known.clone(),
                None => transfer(other, found, monitor)?,
            };
            monitor.go_on()?;
            other.settle_floors(&transferred);
            before.push(transferred.seen_again(other));
        }
        Ok((theirs, before))
    };
    let enough = data.options.explained;
    let asks = |hypothesis: &Hypothesis| beyond_chance(hypothesis).any(|excess| excess > enough);
    let command = || in_stator(Logged::Command);
    let (early, rotor) = rayon::join(|| asks(found).then(command).transpose(), in_rotor);
    let (in_rotor, before) = rotor?;
    let (mut tried, mut held) = match early? {
        Some(both) => both,
        None if before.iter().any(asks) => command()?,
        None => return Ok(Frame::Rotor(in_rotor)),
    };
    if !promises(&before, &held, enough) {
        return Ok(Frame::Rotor(in_rotor));
    }
    let mut logged = Logged::Command;
    let (by_mean, mean) = in_stator(Logged::Mean)?;
    if log_squares(&mean) < log_squares(&held) {
        (tried, held, logged) = (by_mean, mean, Logged::Mean);
    }
    let mut after = vec![held.clone()];
    if !tells(&before[..1], &after, enough) {
        return Ok(Frame::Rotor(in_rotor));
    }
    let mut theirs = in_rotor.clone();
    for other in &mut theirs {
        other.hold_in_stator(logged);
        after.push(transfer(other, &held, monitor)?);
    }
    if !explained(&before, &after, enough) {
        return Ok(Frame::Rotor(in_rotor));
    }
    tried.signals.findings.push(Finding {
        finding: format!(
            "the voltages act as if they were held in the stator's frame over each control period, the log holding {}",
            match logged {
                Logged::Command => "the vector that is held",
                Logged::Mean => "its mean as the rotor sees it",
            }
        ),
        consequence: "the models turn them back as the rotor turns on, and the torque between two samples is corrected for it"
            .into(),
        fix: "nothing is wrong; log mean currents, or sample faster, to be free of it".into(),
    });
    tried.settle_floors(&held);
    *data = tried;
    others.clone_from_slice(&theirs);
    Ok(Frame::Stator(Box::new(fitting::refit(data, &held, monitor)?)))
}

/// Takes voltages held in the stator's frame where they replace one of several effects, and says whether they do. For a single effect the
/// comparison with the dq-model has answered this.
///
/// # Errors
/// Those of [`select`].
pub fn in_place_of_one(
    data: &mut Data,
    others: &mut [Data],
    outcome: &Outcome,
    monitor: &dyn Monitor,
) -> Result<bool> {
    let several = outcome.best.fitted.effects().len() > 1;
    let electrical = |swap: &&Swap| swap.by.is_none() && swap.replaced.info().site == Site::Electrical;
    for Swap { validated, .. } in outcome.swaps.iter().filter(|_| several).filter(electrical) {
        let known = if validated.held_out.len() == others.len() { &validated.held_out[..] } else { &[] };
        if matches!(select(data, others, &validated.fitted, known, monitor)?, Frame::Stator(_)) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Whether the excess of the currents, or of the motion, on the first recording has fallen so far `after` that one reading of the log may
/// explain it. An excess on other recordings alone may be explained, too.
fn promises(before: &[Hypothesis], after: &Hypothesis, enough: f64) -> bool {
    let of = |hypothesis: &Hypothesis, electrical: bool| -> Vec<f64> {
        let channels = beyond_chance(hypothesis).zip(&hypothesis.squares);
        channels
            .filter(|(_, (c, _))| c.is_electrical() == electrical)
            .map(|(excess, _)| excess.max(0.0))
            .collect()
    };
    let asks = |hypothesis: &Hypothesis, side: bool| of(hypothesis, side).iter().any(|x| *x > enough);
    let sum = |hypothesis: &Hypothesis, side: bool| of(hypothesis, side).iter().sum::<f64>();
    [true, false].into_iter().any(|side| match asks(&before[0], side) {
        true => sum(after, side) <= PROMISING * sum(&before[0], side),
        false => before[1..].iter().any(|other| asks(other, side)),
    })
}

/// Sum of the logarithms of the mean squares of all channels: each channel counts by its ratio.
fn log_squares(hypothesis: &Hypothesis) -> f64 {
    hypothesis.squares.iter().map(|(_, square)| square.ln()).sum()
}

/// Whether all excess of the currents, or of the motion, is explained, and the other channels are no worse.
fn explained(before: &[Hypothesis], after: &[Hypothesis], enough: f64) -> bool {
    sides(before, after, enough).into_iter().any(|side| side.asks && side.gone)
}

/// Whether that is possible for these recordings and more.
fn tells(before: &[Hypothesis], after: &[Hypothesis], enough: f64) -> bool {
    sides(before, after, enough).into_iter().any(|side| side.gone)
}

/// Currents or motion of some recordings.
struct Side {
    /// Whether anything was left.
    asks: bool,
    /// Whether all of it is gone, and the rest no worse.
    gone: bool,
}

fn sides(before: &[Hypothesis], after: &[Hypothesis], enough: f64) -> [Side; 2] {
    let pairs = |electrical: bool| -> Vec<(f64, f64)> {
        let on_run = |(before, after): (&Hypothesis, &Hypothesis)| {
            let excess = beyond_chance(before).zip(beyond_chance(after));
            let own =
                excess.zip(&before.squares).filter(|(_, (channel, _))| channel.is_electrical() == electrical);
            own.map(|(excess, _)| excess).collect::<Vec<_>>()
        };
        before.iter().zip(after).flat_map(on_run).collect()
    };
    [true, false].map(|side| {
        let (own, rest) = (pairs(side), pairs(!side));
        let gone = |(before, after): &(f64, f64)| {
            *after <= if *before > enough { (LEFT * before).min(enough) } else { enough }
        };
        let no_worse = |(before, after): &(f64, f64)| *after <= before + MORE * (1.0 + before.max(0.0));
        Side {
            asks: own.iter().any(|(before, _)| *before > enough),
            gone: own.iter().all(gone) && rest.iter().all(no_worse),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENOUGH: f64 = 0.12;
    use crate::effects::testing::CX;
    use crate::experiment::Channel;
    use crate::model::Model;

    fn left(d: f64, q: f64, speed: f64) -> Hypothesis {
        let mut out = Hypothesis::unfitted(Model::new(CX, &[]), vec![1.0; 6]);
        out.squares = vec![(Channel::ID, d), (Channel::IQ, q), (Channel::OmegaE, speed)];
        out.chance = vec![0.0; 3];
        out
    }

    #[test]
    fn the_other_reading_is_asked_where_one_has_done_most_of_it() {
        assert!(promises(&[left(9.0, 3.0, 50.0)], &left(3.0, 1.5, 50.0), ENOUGH));
        assert!(!promises(&[left(9.0, 3.0, 50.0)], &left(8.0, 2.5, 49.0), ENOUGH));
        // Where friction is missing nothing is left of the currents that anything could explain.
        assert!(!promises(&[left(1.02, 1.0, 50.0)], &left(1.0, 1.0, 50.0), ENOUGH));
        assert!(promises(&[left(1.02, 1.0, 1.0), left(1.4, 1.0, 1.0)], &left(1.05, 1.0, 1.0), ENOUGH));
        // Of two readings the one that leaves less of a faint channel is the better, whatever a loud one says.
        assert!(log_squares(&left(1.0, 1.0, 50.1)) < log_squares(&left(1.2, 1.1, 50.0)));
    }

    #[test]
    fn one_side_must_be_explained_whole_and_the_other_no_worse() {
        let runs = |a, b| [a, b];
        // The currents show it on the second run alone; friction is missing.
        let before = runs(left(1.05, 1.0, 90.0), left(1.42, 1.1, 40.0));
        assert!(explained(&before, &runs(left(1.0, 1.0, 89.0), left(1.01, 1.0, 41.0)), ENOUGH));
        assert!(!explained(&before, &runs(left(1.0, 1.0, 89.0), left(1.2, 1.0, 41.0)), ENOUGH));
        // Of the first run alone it is not known yet, or no longer.
        assert!(
            tells(&before[..1], &[left(1.0, 1.0, 89.0)], ENOUGH)
                && !explained(&before[..1], &[left(1.0, 1.0, 89.0)], ENOUGH)
        );
        assert!(!tells(&before[..1], &[left(1.2, 1.0, 89.0)], ENOUGH));
        assert!(!explained(&before, &runs(left(1.0, 1.0, 99.0), left(1.01, 1.0, 41.0)), ENOUGH));
        // The motion of the fitted run alone proves nothing against that of the other one.
        let before = runs(left(1.0, 1.0, 1.3), left(1.0, 1.0, 1.05));
        assert!(explained(&before, &runs(left(1.0, 1.0, 1.01), left(1.0, 1.0, 1.0)), ENOUGH));
        assert!(!explained(&before, &runs(left(1.0, 1.0, 1.01), left(1.0, 1.0, 1.9)), ENOUGH));
        // Where nothing was left there is nothing to explain.
        let still = runs(left(1.0, 1.0, 1.05), left(1.0, 1.0, 1.05));
        assert!(!explained(&still, &runs(left(1.0, 1.0, 1.0), left(1.0, 1.0, 1.0)), ENOUGH));
    }
}
