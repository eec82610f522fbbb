//! Mistakes of wiring, sign and column order, which no physics explains. Each is undone in turn, and reported where the dq-model then fits far
//! better than with any missing effect.

mod mistakes;
mod rival;
#[cfg(test)]
mod testing;

use super::hypothesis::Hypothesis;
use super::options::DiagnosisOptions;
use super::{adequacy, baseline, join, verdict};
use crate::error::Result;
use crate::machine::{BaseParameter, Machine};
use crate::monitor::Monitor;
use crate::recording::Recording;
use crate::signals::{Finding, Signals};
use crate::start;
use mistakes::mistakes;
use rayon::prelude::*;

pub use rival::in_place_of_effects;

/// Excess mean square of the dq-model from which a mistake is looked for: weaker misfits are physics.
const FAR: f64 = 100.0;
/// Share of the excess that may remain with a mistake undone: further physics may be missing.
const LEFT: f64 = 0.04;
/// Ratio of the residuals of a regression with a mistake undone and without, below which the mistake is tried by simulation.
const BETTER: f64 = 0.9;
/// Most mistakes that are tried by simulation, the likeliest first.
const TRIED: usize = 4;
/// Factor within which the residuals of two mistakes count as equal.
const ALIKE: f64 = 1.05;

/// A mistake that explains what the `base` machine, fitted to the `recordings`, leaves, if one does.
///
/// # Errors
/// Those of the least-squares fits. A log that cannot be read with a mistake undone was not made by it.
pub fn suspected(
    recordings: &[&Recording],
    machine: &Machine,
    base: &Hypothesis,
    options: &DiagnosisOptions,
    monitor: &dyn Monitor,
) -> Result<Option<Finding>> {
    let finite = base.squares.iter().all(|(_, square)| square.is_finite());
    let before = if finite { verdict::largest_excess(base) } else { f64::INFINITY };
    // Without starting values of the nameplate a correct log may diverge, too, and with a mistake undone converge by chance.
    let stated = BaseParameter::ELECTRICAL.iter().all(|p| machine.base[p.index()].is_some());
    if before <= FAR || !finite && !stated {
        return Ok(None);
    }
    let limit = misfit(recordings[0], machine).map_or(1.0, |left| BETTER * left);
    let mistakes = mistakes(machine.n_p);
    let undone = |at: usize, recording| mistakes[at].undone(recording);
    let promise = |at| -> Result<Option<(f64, usize)>> {
        monitor.go_on()?;
        let left = undone(at, recordings[0]).and_then(|undone| misfit(&undone, machine));
        Ok(left.filter(|left| *left < limit).map(|left| (left, at)))
    };
    let (of_motion, others): (Vec<usize>, Vec<usize>) =
        (0..mistakes.len()).partition(|at| mistakes[*at].of_motion);
    let promising: Result<Vec<_>> = others.into_par_iter().map(promise).collect();
    let mut likely: Vec<(f64, usize)> = promising?.into_iter().flatten().collect();
    likely.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut explaining: Vec<(f64, usize)> = Vec::new();
    // The voltage equations say nothing of what shows in the motion alone.
    let moves = base.squares.iter().any(|(c, square)| !c.is_electrical() && square - 1.0 > FAR);
    let likely = likely.iter().take(TRIED).map(|(_, at)| *at);
    for at in likely.chain(of_motion.into_iter().filter(|_| moves)) {
        let Some(undone) = recordings.iter().map(|r| undone(at, r)).collect::<Option<Vec<_>>>() else {
            continue;
        };
        monitor.go_on()?;
        let undone: Vec<&Recording> = undone.iter().collect();
        let Ok(mut data) = join::prepare(&undone, machine, options) else { continue };
        let fitted = baseline::fit(&mut data, monitor)?;
        let left = verdict::largest_excess(&fitted);
        // A diverged fit has no share. A delay or a lag may look like a shift in time, which must therefore explain all.
        let most = match mistakes[at].of_time {
            true => options.form_error(),
            false if finite => LEFT * before,
            false => FAR,
        };
        if left < most && adequacy::lack_of_fit(&data, &fitted).is_none() {
            explaining.push((left, at));
        }
    }
    let Some(least) = explaining.iter().map(|(left, _)| 1.0 + left.max(0.0)).reduce(f64::min) else {
        return Ok(None);
    };
    // What is the same to this log is told together.
    explaining.retain(|(left, _)| 1.0 + left < ALIKE * least);
    let words: Vec<&str> = explaining.iter().map(|(_, at)| mistakes[*at].words.as_str()).collect();
    Ok(Some(told(
        &words.join(", or "),
        least,
        &format!(" instead of {:.0}", (1.0 + before).sqrt()),
        "no physics that is missing does that; what is said of this log as it is does not hold for the motor",
    )))
}

/// The finding of a mistake in these `words`, with which undone the mean square over the floor's is `left`.
fn told(words: &str, left: f64, beside: &str, consequence: &str) -> Finding {
    let left = left.sqrt();
    Finding {
        finding: format!(
            "the log reads as if {words}: with that undone the dq-model has a residual of {left:.2} times the noise{beside}"
        ),
        consequence: consequence.into(),
        fix: "check wiring, signs, scales and the order of columns, put it right, and diagnose again".into(),
    }
}

/// Share of the squares that a regression of the voltage equations leaves; `None` where it cannot be read, or where a resistance, an
/// inductance or the flux would be negative.
fn misfit(recording: &Recording, machine: &Machine) -> Option<f64> {
    let signals = Signals::new(recording, machine).ok()?;
    let (found, left) = start::voltages(&signals)?;
    found.iter().all(|x| *x > 0.0).then_some(left)
}

#[cfg(test)]
mod tests {
    use super::mistakes::{Columns, interchange, negate, scale, turn_angle, turn_frame};
    use super::testing::recorded;
    use super::*;
    use crate::diagnose::answer::Verdict;
    use crate::diagnose::diagnose;
    use crate::diagnose::testing::choice;
    use crate::monitor::Silent;
    use crate::numerics::transforms::park;
    use std::f64::consts::TAU;

    /// Currents by axis and not by phase.
    fn by_axis(c: &mut Columns) {
        let (theta, phases) =
            (c["theta_e"].clone(), ["i_a", "i_b", "i_c"].map(|name| c.remove(name).unwrap()));
        let seen: Vec<[f64; 2]> = (0..theta.len())
            .map(|k| park([0, 1, 2].map(|x| phases[x][k]), theta[k].cos(), theta[k].sin()))
            .collect();
        c.insert("i_d", seen.iter().map(|x| x[0]).collect());
        c.insert("i_q", seen.iter().map(|x| x[1]).collect());
    }

    fn said(recording: &Recording, machine: &Machine) -> Option<String> {
        let mut data = join::prepare(&[recording], machine, &Default::default()).unwrap();
        let base = baseline::fit(&mut data, &Silent).unwrap();
        suspected(&[recording], machine, &base, &Default::default(), &Silent)
            .unwrap()
            .map(|finding| finding.finding)
    }

    #[test]
    fn mistakes_are_told_from_each_other() {
        type Made = fn(&mut Columns);
        let made: [(&str, Made); 10] = [
            ("the angle and the speed had the opposite sign", |c| {
                by_axis(c);
                assert!(negate(c, &["theta_e", "omega_e"]));
            }),
            ("the speed was in rpm and not in rad/s", |c| {
                by_axis(c);
                c.remove("theta_e");
                assert!(scale(c, &["omega_e"], 60.0 / TAU));
            }),
            ("omega_e was the mechanical speed and not 4 times that", |c| {
                by_axis(c);
                c.remove("theta_e");
                assert!(scale(c, &["omega_e"], 0.25));
            }),
            ("all currents had the opposite sign", |c| assert!(negate(c, &["i_a", "i_b", "i_c"]))),
            ("theta_e was 90° too large", |c| assert!(turn_angle(c, -0.25 * TAU, 4.0))),
            ("theta_e was 180° too large", |c| assert!(turn_angle(c, 0.5 * TAU, 4.0))),
            ("i_b had the opposite sign", |c| assert!(negate(c, &["i_b"]))),
            ("i_d and i_q were interchanged", |c| {
                by_axis(c);
                assert!(interchange(c, "i_d", "i_q"));
            }),
            ("i_q had the opposite sign", |c| {
                by_axis(c);
                assert!(negate(c, &["i_q"]));
            }),
            ("d and q were those of an axis 90° ahead of the magnet", |c| {
                by_axis(c);
                assert!(turn_frame(c, -0.25 * TAU));
            }),
        ];
        for (words, make) in made {
            let (recording, machine) = recorded(Vec::new(), None, make);
            let told = said(&recording, &machine);
            assert!(told.as_ref().is_some_and(|told| told.contains(words)), "{words}: {told:?}");
        }
    }

    #[test]
    fn a_load_torque_of_the_wrong_sign_is_told_and_friction_is_not_taken_for_it() {
        let measured = |sign: f64, effects: Vec<crate::drive::Choice>| {
            let (recording, machine) = recorded(effects, Some(1.5), |_| ());
            let names = recording.names().into_iter();
            let mut columns: Vec<(String, Vec<f64>)> =
                names.map(|name| (name.to_string(), recording.column(name).unwrap().to_vec())).collect();
            columns.push(("tau_m".into(), vec![1.5 * sign; recording.len()]));
            said(&Recording::new(columns, None).unwrap(), &machine)
        };
        let told = measured(-1.0, Vec::new());
        assert!(told.as_ref().is_some_and(|told| told.contains("tau_m had the opposite sign")), "{told:?}");
        assert_eq!(measured(1.0, Vec::new()), None);
        assert_eq!(measured(1.0, vec![choice("asymmetric_friction", "tau_a", 1.0)]), None);
    }

    #[test]
    fn a_log_that_diverges_from_no_starting_values_is_not_accused() {
        let (recording, nameplate) =
            recorded(Vec::new(), None, |c| assert!(negate(c, &["i_a", "i_b", "i_c"])));
        let mut data = join::prepare(&[&recording], &nameplate, &Default::default()).unwrap();
        let mut base = baseline::fit(&mut data, &Silent).unwrap();
        base.squares.iter_mut().for_each(|(_, square)| *square = f64::INFINITY);
        let suspects = |machine: &Machine| {
            suspected(&[&recording], machine, &base, &Default::default(), &Silent).unwrap().is_some()
        };
        assert!(suspects(&nameplate) && !suspects(&Machine::new(nameplate.n_p).unwrap()));
    }

    #[test]
    fn a_mistake_is_told_beside_physics_that_is_missing() {
        type Made = fn(&mut Columns);
        let made: [(&str, Made); 2] = [
            ("v_d and v_q were interchanged", |c| assert!(interchange(c, "v_d", "v_q"))),
            ("i_a and i_b were interchanged", |c| assert!(interchange(c, "i_a", "i_b"))),
        ];
        for (words, make) in made {
            let (recording, machine) = recorded(vec![choice("dead_time", "v_err", 6.0)], None, make);
            let told = said(&recording, &machine);
            assert!(told.as_ref().is_some_and(|told| told.contains(words)), "{words}: {told:?}");
        }
    }

    #[test]
    fn a_mistake_leads_the_answer_where_the_dq_model_is_no_model_of_the_log() {
        let (recording, machine) = recorded(Vec::new(), None, |c| assert!(negate(c, &["v_d", "v_q"])));
        let mut data = join::prepare(&[&recording], &machine, &Default::default()).unwrap();
        let base = baseline::fit(&mut data, &Silent).unwrap();
        assert!(adequacy::lack_of_fit(&data, &base).is_some());
        let answer = diagnose(&[&recording], &machine, None, &Default::default(), &Silent).unwrap();
        assert_eq!(answer.verdict, Verdict::Undetermined);
        assert!(answer.data_quality[0].finding.contains("opposite sign"));
        assert!(answer.data_quality[1].finding.contains("itself varies"), "{:?}", answer.data_quality);
    }

    #[test]
    fn physics_and_a_sound_log_are_no_mistake() {
        for effects in [
            Vec::new(),
            vec![choice("dead_time", "v_err", 6.0)],
            vec![choice("encoder_angle_offset", "offset_el_rad", 0.3)],
            vec![choice("current_gain_imbalance", "g_beta", 0.15)],
        ] {
            let (recording, machine) = recorded(effects, None, |_| ());
            assert_eq!(said(&recording, &machine), None);
        }
    }
}
