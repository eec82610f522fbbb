//! Whether the torque has the opposite sign of the acceleration, from an encoder, a current or a torque sensor. The best fit is then a rotor
//! that hardly turns, and everything seems to be noise.
//!
//! Both signs are fitted alike, each with its own inertia, friction and load, and compared by their likelihood. No physics of a rotor turns
//! the sign round: with the right one the fit can always do as well as a rotor that no torque moves.

use super::adequacy;
use super::data::Data;
use super::evidence::Evidence;
use super::hypothesis::Hypothesis;
use super::motion;
use crate::effect::Site;
use crate::error::Result;
use crate::experiment::floor::Floor;
use crate::experiment::{Block, Channel};
use crate::machine::BaseParameter;
use crate::monitor::Monitor;
use crate::signals::Finding;

/// Nats by which the opposite sign must be more likely: one log in a hundred is of the wrong sign, and of a hundred that are said to be so
/// ninety-nine must be.
const DECISIVE: f64 = 9.2;

/// A finding if the opposite sign of the torque explains the motion far better than the logged one does.
///
/// # Errors
/// Those of the least-squares fits.
pub fn opposite(data: &Data, base: &Hypothesis, monitor: &dyn Monitor) -> Result<Option<Finding>> {
    debug_assert!(base.effects().iter().all(|e| e.info().site != Site::Mechanical), "the dq-model alone");
    if !data.has_mechanical() {
        return Ok(None);
    }
    if adequacy::explains_half(data, base, false) {
        return Ok(None);
    }
    let torque = data.torque(&base.model, base.own());
    let opposite: Vec<f64> = torque.iter().map(|x| -x).collect();
    let as_logged = left(data, base, &torque, monitor)?;
    let turned = left(data, base, &opposite, monitor)?;
    // What lies below the noise, or within chance of it, is no better than the noise.
    let nats = |left: &Left| left.square.max(1.0 + left.chance).ln();
    let better = |(logged, turned): (&Left, &Left)| 0.5 * logged.samples * (nats(logged) - nats(turned));
    let evidence: f64 = as_logged.iter().zip(&turned).map(better).sum();
    if evidence.is_nan() || evidence <= DECISIVE {
        return Ok(None);
    }
    let total = |left: &[Left]| left.iter().map(|l| l.square).sum::<f64>();
    let times = (total(&as_logged) / total(&turned)).sqrt();
    let torque_logged = data.runs().iter().all(|run| run.signals.tau_e.is_some());
    let (what, column) = if torque_logged { ("torque", "tau_e") } else { ("torque of the currents", "i_q") };
    Ok(Some(Finding {
        finding: format!(
            "the {what} counts with the opposite sign against the acceleration: turned round, the residual of the motion is {times:.1} times smaller"
        ),
        consequence:
            "as it is logged no rotor moves like this, and nothing can be said of what the model leaves out"
                .into(),
        fix: format!(
            "turn it round with {column} = {{ from = \"...\", scale = -1 }} under [columns], or, if the angle or the speed is the one that \
             counts the wrong way, that one in the same manner"
        ),
    }))
}

/// Mean square of the motion that a fit leaves in one recording, and the independent samples that it rests on.
struct Left {
    square: f64,
    samples: f64,
    chance: f64,
}

/// Residual of each recording's speed when this torque, N·m, drives the rotor without effects.
fn left(data: &Data, base: &Hypothesis, torque: &[f64], monitor: &dyn Monitor) -> Result<Vec<Left>> {
    let rotor = BaseParameter::MECHANICAL.map(BaseParameter::index);
    // The fit as logged may have diverged and is no start.
    let mut start = base.own().to_vec();
    for prior in data.prior.iter().filter(|prior| rotor.contains(&prior.index)) {
        start[prior.index] = prior.value;
    }
    let fitted = motion::fit_driven_by(data, &base.model, &start, &rotor, torque, monitor)?;
    let experiment = data.motion(&base.model, &fitted.nuisances, torque).plain();
    let residual = experiment.residual(&fitted.parameters);
    let squares = experiment.mean_squares(&residual, super::hypothesis::independent_samples);
    let speed = experiment.blocks().into_iter().zip(squares).filter(|(b, _)| b.channel == Channel::OmegaE);
    let counted = Evidence::new(data, &[]);
    let most = counted.samples().iter().copied().fold(0.0, f64::max);
    let left = |(block, (square, samples)): (Block, (f64, f64))| {
        let floor = data.runs()[block.run].floors.iter().find(|f| f.channel == Channel::OmegaE);
        Left { square, samples: samples.min(most), chance: floor.map_or(0.0, Floor::chance) }
    };
    Ok(speed.map(left).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::answer::Verdict;
    use crate::diagnose::diagnose;
    use crate::diagnose::testing::{choice, setup, speeds};
    use crate::drive::{Choice, simulate};
    use crate::model::Model;
    use crate::monitor::Silent;
    use crate::recording::Recording;
    use crate::signals::Signals;

    /// The diagnosis of a motion whose torque was logged with this sign.
    fn told(sign: f64, effects: Vec<Choice>) -> (Verdict, String) {
        let setup = setup(speeds(2.0, &[(0.2, 80.0), (0.7, -60.0), (1.2, 90.0), (1.7, -70.0)]), effects);
        let whole = simulate(&setup, &Silent).unwrap().recording;
        let signals = Signals::new(&whole, &setup.nameplate).unwrap();
        let data = Data::new(signals, &setup.nameplate, &Default::default()).unwrap();
        let torque = data.torque(&Model::new(data.signals.context, &[]), &data.start);
        let columns = vec![
            ("t".into(), data.signals.t.clone()),
            ("omega_e".into(), data.signals.omega_e.clone()),
            ("tau_e".into(), torque.iter().map(|x| sign * x).collect()),
        ];
        let recording = Recording::new(columns, Some(whole.load())).unwrap();
        let answer = diagnose(&[&recording], &setup.nameplate, None, &Default::default(), &Silent).unwrap();
        (answer.verdict, answer.data_quality.first().map_or(String::new(), |f| f.finding.clone() + &f.fix))
    }

    #[test]
    fn a_torque_of_the_opposite_sign_is_told_first_and_nothing_else_is() {
        for effects in [Vec::new(), vec![choice("coulomb_friction", "tau_c", 0.5)]] {
            let (verdict, said) = told(-1.0, effects.clone());
            assert_eq!(verdict, Verdict::Undetermined, "{said}");
            assert!(said.contains("opposite sign") && said.contains("scale = -1"), "{said}");
            let (verdict, said) = told(1.0, effects);
            assert!(verdict != Verdict::Undetermined && !said.contains("opposite sign"), "{said}");
        }
    }
}
