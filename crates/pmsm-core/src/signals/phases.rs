//! Phase currents and voltages as they were logged, and as the rotor sees them.

use super::Finding;
use super::open_circuit::Calibration;
use super::turned::to_rotor;
use crate::error::{Error, Result};
use crate::numerics::extent::peak;
use crate::numerics::transforms::park;
use crate::recording::Recording;

/// Pairs of rows in which the order of the phases is looked at, and the share of their squared changes below which another one is right.
const PAIRS: usize = 128;
const SMOOTHER: f64 = 0.05;

/// Columns of the phase currents.
const PHASES: [&str; 3] = ["i_a", "i_b", "i_c"];

/// Share of the largest current that the other two phases must add up to before a column of zeros counts as one that was not measured.
const UNBALANCED: f64 = 0.1;
/// What three currents of which one was computed from the others add up to at most: this share of the largest, or as many of the steps in
/// which they were written.
const ROUNDING: (f64, f64) = (2e-5, 1.51);
/// Samples in which that step is looked for, in a glance at first, and what two values of the same step differ by at most, share of the
/// largest.
const LOOKED_AT: usize = 500;
const GLANCE: usize = 20;
const ALIKE: f64 = 1e-9;

/// The phase currents that were measured: a column of zeros beside two that do not add up to nothing was not, and where the three add up
/// to no more than rounding i_c is taken for what the others leave.
fn measured(recording: &Recording) -> [Option<&[f64]>; 3] {
    let logged = PHASES.map(|name| recording.column(name));
    let [Some(a), Some(b), Some(c)] = logged else { return logged };
    let sums: Vec<f64> = a.iter().zip(b).zip(c).map(|((a, b), c)| a + b + c).collect();
    let (sum, most) = (peak(&sums), [a, b, c].map(peak).into_iter().fold(0.0, f64::max));
    let step = |samples| step(&[a, b, c], ALIKE * most, samples);
    let rounded = |step: f64| sum <= ROUNDING.1 * step;
    // A few values mostly tell that there is no such step.
    let in_steps = || step(GLANCE).is_none_or(rounded) && step(LOOKED_AT).is_some_and(rounded);
    if most > 0.0 && (sum <= ROUNDING.0 * most || in_steps()) {
        return [Some(a), Some(b), None];
    }
    logged.map(|x| x.filter(|x| sum <= UNBALANCED * most || x.iter().any(|x| *x != 0.0)))
}

/// Step in which the values of `columns` were written: the smallest of the differences above `least` between so many samples of
/// each; `None` where all are alike.
fn step(columns: &[&[f64]], least: f64, samples: usize) -> Option<f64> {
    let stride = columns[0].len().div_ceil(samples);
    let mut values: Vec<f64> = columns.iter().flat_map(|x| x.iter().copied().step_by(stride)).collect();
    values.sort_by(f64::total_cmp);
    let apart = values.windows(2).map(|pair| pair[1] - pair[0]).filter(|x| *x > least);
    apart.reduce(f64::min)
}

/// The phase currents of a recording.
#[derive(Debug, Default)]
pub struct Currents {
    /// All three, where at least two were measured.
    pub phases: Option<[Vec<f64>; 3]>,
    /// Whether three were measured.
    pub three: bool,
    /// Number of the only one that was not.
    pub completed: Option<usize>,
}

/// A finding where voltages were logged that make no vector.
pub fn incomplete_voltage(recording: &Recording) -> Option<Finding> {
    let logged: Vec<&str> =
        ["v_d", "v_q", "v_a", "v_b", "v_c"].into_iter().filter(|v| recording.has(&[v])).collect();
    (!logged.is_empty()).then(|| Finding {
        finding: format!("{} alone: that is no voltage vector that the rotor sees", logged.join(", ")),
        consequence: "the voltage equations are not tested, and nothing is said of them".into(),
        fix: "log v_d and v_q, or v_a, v_b and v_c with the angle".into(),
    })
}

/// The phase currents as they were measured.
pub fn currents(recording: &Recording, findings: &mut Vec<Finding>) -> Currents {
    let logged = measured(recording);
    if let [Some(a), Some(b), Some(c)] = logged {
        return Currents { phases: Some([a, b, c].map(<[f64]>::to_vec)), three: true, completed: None };
    }
    let mut missing = (0..3).filter(|k| logged[*k].is_none());
    let Some(lost) = missing.next().filter(|_| missing.next().is_none()) else {
        return Currents::default();
    };
    let computed =
        PHASES.iter().all(|name| recording.column(name).is_some_and(|x| x.iter().any(|x| *x != 0.0)));
    let unseen = "the currents' noise is estimated from the model, and a common offset cannot be seen";
    findings.push(if computed {
        Finding {
            finding: "i_a, i_b and i_c add up to nothing but rounding: one was computed from the others"
                .into(),
            consequence: format!("{unseen}; i_c is taken for the computed one"),
            fix: "log what three sensors measure; where the computed one is not i_c, leave it out".into(),
        }
    } else {
        Finding {
            finding: "only two phase currents are measured".into(),
            consequence: unseen.into(),
            fix: "log the third phase current".into(),
        }
    });
    let rest = (0..recording.len()).map(|k| -logged.iter().flatten().map(|x| x[k]).sum::<f64>()).collect();
    let mut phases = logged.map(|x| x.unwrap_or_default().to_vec());
    phases[lost] = rest;
    Currents { phases: Some(phases), three: false, completed: Some(lost) }
}

/// Refuses phase currents whose b and c are interchanged against the angle `theta` (rad), seen in which they would turn back twice as fast
/// as the rotor turns: with the two put right they hardly change from one row to the next.
///
/// # Errors
/// [`Error::Column`] for `i_b`.
pub fn check_order(phases: &[Vec<f64>; 3], theta: &[f64]) -> Result<()> {
    let pairs = theta.len().saturating_sub(1);
    let stride = pairs.div_ceil(PAIRS).max(1);
    let (mut given, mut interchanged) = (0.0, 0.0);
    for k in (0..pairs).step_by(stride) {
        let turned = [k, k + 1].map(|k| theta[k].sin_cos());
        let change = |order: [usize; 3]| {
            let seen = |n: usize| park(order.map(|x| phases[x][k + n]), turned[n].1, turned[n].0);
            let (now, next) = (seen(0), seen(1));
            (next[0] - now[0]).powi(2) + (next[1] - now[1]).powi(2)
        };
        given += change([0, 1, 2]);
        interchanged += change([0, 2, 1]);
    }
    if interchanged < SMOOTHER * given {
        return Err(Error::Column {
            column: "i_b".into(),
            problem: format!(
                "seen from the rotor the phase currents turn back twice as fast as it turns; with i_b and i_c interchanged they change {:.0} \
                 times less from row to row",
                (given / interchanged.max(f64::MIN_POSITIVE)).sqrt().min(1e6)
            ),
            fix: "interchange i_b and i_c, or the sense of angle and speed; voltages of the phases alike"
                .into(),
        });
    }
    Ok(())
}

/// What is wrong with a recording whose phase currents do not make a current vector.
pub fn too_few(recording: &Recording) -> Error {
    let measured = measured(recording);
    let dead = (0..3).find(|k| measured[*k].is_none() && recording.column(PHASES[*k]).is_some());
    Error::Column {
        column: PHASES[dead.unwrap_or(0)].into(),
        problem: "is zero throughout, and so is another phase current".into(),
        fix: "log two phase currents at least, or leave the columns of phases that were not measured out"
            .into(),
    }
}

/// The three phase voltages, if all were logged.
pub fn logged_voltages(recording: &Recording) -> Option<[&[f64]; 3]> {
    Some([recording.column("v_a")?, recording.column("v_b")?, recording.column("v_c")?])
}

/// Measured phase voltages of open terminals in the rotor frame, without what their channels add.
pub fn induced_voltages(abc: [&[f64]; 3], calibration: &Calibration, theta: &[f64]) -> [Vec<f64>; 2] {
    let corrected: Vec<[f64; 3]> =
        (0..theta.len()).map(|k| calibration.corrected([abc[0][k], abc[1][k], abc[2][k]])).collect();
    let phase = |x: usize| corrected.iter().map(|v| v[x]).collect();
    let [a, b, c]: [Vec<f64>; 3] = [phase(0), phase(1), phase(2)];
    to_rotor([&a, &b, &c], theta)
}

/// Phase voltages held from sample to sample, seen from the rotor in the middle of the interval.
pub fn held_voltages(
    recording: &Recording,
    t: &[f64],
    theta: &[f64],
    omega: &[f64],
    angle_known: bool,
) -> Option<[Vec<f64>; 2]> {
    let abc = logged_voltages(recording)?;
    if !angle_known {
        return None;
    }
    let n = t.len();
    let middle = |k: usize| {
        let h = if k + 1 < n { t[k + 1] - t[k] } else { recording.period() };
        theta[k] + 0.5 * h.min(2.0 * recording.period()) * omega[k]
    };
    let theta: Vec<f64> = (0..n).map(middle).collect();
    Some(to_rotor(abc, &theta))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::normal_pair;

    const THIRD: f64 = std::f64::consts::TAU / 3.0;

    /// Three currents of amplitude 5 A under noise of 0.02 A, written by `write`; the third is `computed` or has a sensor of its own.
    fn logged(computed: bool, write: fn(f64) -> f64) -> Recording {
        let phase = |number: u32, shift: f64| -> Vec<f64> {
            let noise = |k: u32| 0.02 * normal_pair(7, [k, number, 0, 0]).0;
            (0..4000).map(|k| 5.0 * (0.01 * f64::from(k) + shift).sin() + noise(k)).collect()
        };
        let (a, b, own) = (phase(0, 0.0), phase(1, -THIRD), phase(2, THIRD));
        let rest = a.iter().zip(&b).map(|(a, b)| -a - b).collect();
        let mut columns: Vec<(String, Vec<f64>)> =
            vec![("t".into(), (0..4000).map(|k| 1e-4 * f64::from(k)).collect())];
        let currents = [a, b, if computed { rest } else { own }];
        let written = currents.map(|x: Vec<f64>| x.into_iter().map(write).collect());
        columns.extend(PHASES.iter().map(ToString::to_string).zip(written));
        columns.extend(["theta_e", "omega_e"].map(|name| (name.into(), vec![0.0; 4000])));
        Recording::new(columns, None).unwrap()
    }

    fn completed(recording: &Recording) -> Option<usize> {
        currents(recording, &mut Vec::new()).completed
    }

    #[test]
    fn a_current_computed_from_two_is_no_third_sensor_however_it_was_written() {
        let roundings: [fn(f64) -> f64; 4] =
            [|x| x, |x| f64::from(x as f32), |x| (x * 1e3).round() / 1e3, |x| (x / 0.0122).round() * 0.0122];
        for write in roundings {
            assert_eq!(completed(&logged(true, write)), Some(2));
            assert_eq!(completed(&logged(false, write)), None);
        }
        let (mut findings, recording) = (Vec::new(), logged(true, |x| x));
        assert!(!currents(&recording, &mut findings).three);
        assert!(findings[0].finding.contains("computed"), "{findings:?}");
    }

    #[test]
    fn a_column_of_zeros_is_no_measurement_unless_the_others_balance() {
        let column = |f: fn(f64) -> f64| (0..40).map(|k| f(0.1 * f64::from(k))).collect::<Vec<f64>>();
        let lost = |b: fn(f64) -> f64, c: fn(f64) -> f64| {
            let columns = [
                ("t", column(|t| t)),
                ("i_a", column(f64::sin)),
                ("i_b", column(b)),
                ("i_c", column(c)),
                ("theta_e", column(|t| 3.0 * t)),
                ("omega_e", column(|_| 3.0)),
            ];
            let recording = Recording::new(columns.map(|(n, x)| (n.to_owned(), x)).to_vec(), None).unwrap();
            completed(&recording)
        };
        assert_eq!(lost(|t| (t - 2.0).sin(), |_| 0.0), Some(2));
        assert_eq!(lost(|t| -t.sin(), |_| 0.0), Some(2));
        assert_eq!(lost(|t| (t - 2.0).sin(), |t| (t + 2.0).sin()), None);
    }

    #[test]
    fn interchanged_phases_are_told_where_the_rotor_turns_and_nowhere_else() {
        let currents = |order: [f64; 3], speed: f64| -> ([Vec<f64>; 3], Vec<f64>) {
            let theta: Vec<f64> = (0..3000).map(|k| speed * f64::from(k)).collect();
            let of = |number: u32, shift: f64| -> Vec<f64> {
                let noise = |k: usize| 0.05 * normal_pair(7, [k as u32, number, 0, 0]).0;
                theta.iter().enumerate().map(|(k, theta)| 5.0 * (theta + shift).sin() + noise(k)).collect()
            };
            ([of(0, order[0]), of(1, order[1]), of(2, order[2])], theta)
        };
        let checked = |order, speed| {
            let (phases, theta) = currents(order, speed);
            check_order(&phases, &theta)
        };
        let (right, wrong) = ([0.0, -THIRD, THIRD], [0.0, THIRD, -THIRD]);
        for speed in [0.1, -0.1, 1e-9] {
            assert!(checked(right, speed).is_ok(), "{speed}");
        }
        assert!(checked(wrong, 1e-9).is_ok());
        for speed in [0.1, -0.1] {
            let said = checked(wrong, speed).unwrap_err().to_string();
            assert!(said.contains("i_b") && said.contains("interchange"), "{said}");
        }
    }
}
