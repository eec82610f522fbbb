//! Attribution of the mismatch to an equation: its places, that of the cause first.
//!
//! All equations share the flux and the inductances. Physics that is missing in the voltage equations biases their estimates. The torque
//! computed from biased values then mismatches the motion, often more than the currents do.

use super::answer::Verdict;
use super::data::Data;
use super::fitting::free_parameters;
use super::hypothesis::Hypothesis;
use super::locate::{self, Located};
use super::select::Outcome;
use super::verdict;
use crate::base::BASE;
use crate::effect::Site;
use crate::experiment::Channel;
use crate::machine::BaseParameter;
use crate::model::Model;
use crate::numerics::basis::orthonormal;

/// Share of the excess that sensor errors must explain to be its first place where more than noise remains: the larger half.
const LARGER_HALF: f64 = 0.5;

/// The places of the mismatch, on the validation run if that alone shows it.
pub fn located(data: &Data, validation: Option<&Data>, outcome: &Outcome, verdict: Verdict) -> Vec<Located> {
    let base = &outcome.base.fitted;
    let mut located = locate::locate(data, base);
    let on_validation = validation.zip(outcome.base.held_out.last());
    if let Some((run, base)) = on_validation.filter(|_| located.is_empty() && verdict == Verdict::Unknown) {
        located = locate::locate(run, base);
        for at in &mut located {
            at.sentence = format!("On the validation run alone: {}", at.sentence);
        }
        return located;
    }
    let named = matches!(verdict, Verdict::Named | Verdict::Ambiguous);
    let sites: Vec<Site> = outcome.best.fitted.effects().iter().map(|e| e.info().site).collect();
    if named && sites.first() == Some(&Site::Sensor) {
        attribute_to_sensor(&mut located, 1.0);
    } else if verdict == Verdict::Partial && sites.iter().all(|site| *site == Site::Sensor) {
        let explained = 1.0 - verdict::excess(&outcome.best.fitted) / verdict::excess(base);
        if explained > LARGER_HALF {
            attribute_to_sensor(&mut located, explained);
        }
    } else if named && sites.contains(&Site::Electrical) && !sites.contains(&Site::Mechanical) {
        if located.iter().all(in_the_motion) {
            located.extend(absorbed(data, base, &outcome.best.fitted));
        }
        attribute_to_currents(&mut located, "");
    } else if located.first().is_some_and(in_the_motion) && biased(data, base) {
        let how = ": another flux and other inductances than those that the currents are fitted with would take it away";
        attribute_to_currents(&mut located, how);
    }
    located
}

fn in_the_motion(at: &Located) -> bool {
    at.equation == locate::equation_of(Channel::OmegaE)
}

/// Attributes the mismatch of the motion to the voltage equations.
fn attribute_to_currents(located: &mut [Located], how: &str) {
    let theirs: f64 = located.iter().filter(|at| !in_the_motion(at)).map(|at| at.share).sum();
    if theirs <= 0.0 {
        return;
    }
    for at in located.iter_mut() {
        if in_the_motion(at) {
            at.share = 0.0;
            at.sentence += &format!(" The same cause shows there{how}.");
        } else {
            at.share /= theirs;
        }
    }
    located.sort_by(|a, b| b.share.total_cmp(&a.share));
}

/// Attributes the `explained` share of the excess, in all equations, to a sensor.
fn attribute_to_sensor(located: &mut Vec<Located>, explained: f64) {
    if let Some(strongest) = located.first().cloned() {
        let how_much =
            if explained < 1.0 { format!("{:.1} % of it", 100.0 * explained) } else { "it".into() };
        let sentence = format!(
            "The measurement is wrong, not the motor. {} A sensor error explains {how_much} in all equations.",
            strongest.sentence
        );
        let share = explained * located.iter().map(|l| l.share).sum::<f64>();
        located.insert(0, Located { equation: "sensor".into(), share, sentence, ..strongest });
    }
}

/// Where the voltage equations need the effects that were found, if the parameters of the dq-model absorb them: the residual without the
/// effects at the parameters of the whole model.
fn absorbed(data: &Data, base: &Hypothesis, best: &Hypothesis) -> Vec<Located> {
    let bare = Model::new(*best.model.context(), &[]);
    let mut without = Hypothesis::of_currents(data, &bare, &best.own()[..BASE], &base.free);
    for ((channel, square), (_, left)) in without.squares.iter_mut().zip(&base.squares) {
        if !channel.is_electrical() {
            *square = *left;
        }
    }
    let mut places = locate::locate(data, &without);
    places.retain(|at| !in_the_motion(at));
    for at in &mut places {
        at.sentence = format!(
            "Other parameters make up for it in the currents. With those of the whole model: {}",
            at.sentence
        );
    }
    places
}

/// Whether the currents are mismatched, and another flux and other inductances would explain the mismatch of the motion, to first order.
fn biased(data: &Data, base: &Hypothesis) -> bool {
    let mut excess = base.squares.iter().zip(verdict::beyond_chance(base));
    if !excess.any(|((channel, _), excess)| channel.is_electrical() && excess > data.options.mismatch) {
        return false;
    }
    let (_, rotor, _) = free_parameters(data, &base.model);
    let loads = base.model.parameter_count()..base.parameters.len();
    // The torque depends on the difference of the inductances only.
    let torque = [BaseParameter::PsiM, BaseParameter::LQ].map(BaseParameter::index);
    let free: Vec<usize> = rotor.into_iter().chain(loads).chain(torque).collect();
    let experiment = data.experiment(&base.model, &base.nuisances, data.channels(false, true));
    let experiment = experiment.with_plain_speed();
    let linear = experiment.linearise(&base.parameters, &free);
    let basis = orthonormal(&linear.jacobian);
    let freed = &linear.residual - &basis * basis.tr_mul(&linear.residual);
    experiment.relative_rms(&freed).iter().all(|left| left * left <= 1.0 + data.options.mismatch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::drive::Choice;
    use crate::effects::EffectId;

    fn recorded(effects: Vec<Choice>) -> (Data, Hypothesis) {
        let manoeuvre = speeds(1.0, &[(0.1, 90.0), (0.4, -80.0), (0.8, 60.0)]);
        data(&setup(manoeuvre, effects))
    }

    #[test]
    fn the_motion_is_biased_by_a_wrong_flux_and_not_by_friction() {
        let with_flux_off = |effects: Vec<Choice>| {
            let (data, base) = recorded(effects);
            assert!(!biased(&data, &base));
            let mut parameters = base.parameters.clone();
            parameters[BaseParameter::PsiM.index()] *= 1.05;
            let off = Hypothesis::on(&data, base.model, parameters, base.free, base.nuisances);
            biased(&data, &off)
        };
        assert!(with_flux_off(Vec::new()));
        assert!(!with_flux_off(vec![choice("coulomb_friction", "tau_c", 0.3)]));
    }

    #[test]
    fn what_other_parameters_absorb_is_found_with_those_of_the_whole_model() {
        let (data, base) = recorded(vec![choice("dead_time", "v_err", 4.0)]);
        let best = fitted(&data, &base, EffectId::DeadTime);
        let places = absorbed(&data, &base, &best);
        assert!(!places.is_empty() && places.iter().all(|at| at.equation != "mechanical"), "{places:?}");
        assert!(places[0].sentence.contains("With those of the whole model"), "{places:?}");
        let (data, base) = recorded(vec![choice("coulomb_friction", "tau_c", 0.3)]);
        let best = fitted(&data, &base, EffectId::CoulombFriction);
        assert_eq!(absorbed(&data, &base, &best), []);
    }
}
