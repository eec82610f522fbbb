//! Steady points of shorted terminals: v_d = v_q = 0, and the turning magnet drives the currents.
//!
//! With both voltages zero the steady equations are homogeneous in r_s, l_d, l_q and ψ_m: currents over speed show the ratios
//!
//! > i_d = −ω²·l_q·ψ_m/D, i_q = −ω·r_s·ψ_m/D, D = r_s² + ω²·l_d·l_q,
//!
//! and the scale comes from a measured torque or from the flux on the nameplate. The torque brakes with what the resistance turns into
//! heat, which ties its scale to r_s: both are fitted together. The size of the current does not depend on the rotor's angle. Where its
//! angle contradicts its size, the size is taken.

mod fit;

use super::answer::Answer;
use super::options::DiagnosisOptions;
use super::parameters_alone::{self, Shown};
use crate::error::Result;
use crate::machine::{BaseParameter, Machine};
use crate::recording::{Kind, Recording};
use crate::signals::{Finding, Signals};
use fit::{Fit, Points, currents};

/// Standard error of the logarithm of a value beyond which it is not shown.
const SHOWN: f64 = 0.2;
/// Fewest points from which the drag that grows with the speed is told from one that does not.
const DRAGS: usize = 8;

/// What the points of a recording show; `None` where its terminals are not shorted.
///
/// # Errors
/// Those of [`Signals::new`].
pub fn answer(
    recording: &Recording,
    machine: &Machine,
    options: &DiagnosisOptions,
) -> Result<Option<Answer>> {
    if !recording.is_shorted() {
        return Ok(None);
    }
    let signals = Signals::new(recording, machine)?;
    let points = Points::new(&signals);
    let kind = Kind::OperatingPoints;
    let Some(fit) = points.as_far_as_believed() else {
        let why = Finding {
            finding:
                "the terminals are shorted, and the currents do not follow the speed as a magnet drives them"
                    .into(),
            consequence: "nothing can be said of the machine".into(),
            fix: "check the speed and n_p, and record a low, a middle and a high speed".into(),
        };
        return Ok(Some(parameters_alone::answer((why, kind), &[], machine, signals.findings, options)));
    };
    let scale = Scale::new(&fit, machine);
    let [r_s, l_d, l_q] = fit.ratios;
    let ratios = format!(
        "the terminals are shorted: {} points show r_s/psi_m = {r_s:.4} A/s, psi_m/l_d = {:.1} A and l_q/l_d = {:.3}, to {:.2} % of the current",
        points.size.len(),
        1.0 / l_d,
        l_q / l_d,
        100.0 * fit.rms
    );
    let (shown, why) = match &scale {
        Some(scale) => {
            let psi = scale.psi_m;
            let named = [BaseParameter::RS, BaseParameter::LD, BaseParameter::LQ, BaseParameter::PsiM];
            let per_flux = [r_s, l_d, l_q, 1.0];
            let all = (0..named.len()).filter(|k| scale.error[*k] < SHOWN);
            let shown: Vec<Shown> =
                all.map(|k| (named[k], per_flux[k] * psi, per_flux[k] * psi * scale.error[k])).collect();
            let from = if scale.measured { "the measured torque" } else { "psi_m on the nameplate" };
            (shown, format!("{ratios}; {from} gives the scale"))
        }
        None => (Vec::new(), format!("{ratios}; nothing gives the scale")),
    };
    let fix = match scale {
        Some(_) => "record points with voltages and load, or a waveform, for what the model leaves out",
        None => {
            "give psi_m under [machine], or map the measured torque to tau_m: with voltages of zero only ratios to psi_m show"
        }
    };
    let why = Finding {
        finding: why,
        consequence: "j and b cannot be seen, and no effect is named or excluded".into(),
        fix: fix.into(),
    };
    let mut findings = signals.findings.clone();
    findings.extend(fit.outliers(&points, options));
    findings.extend(fit.angle_off(&points));
    findings.extend(fit.unseen());
    Ok(Some(parameters_alone::answer((why, kind), &shown, machine, findings, options)))
}

/// The flux of the magnet, V s, standard errors of the logarithms of r_s, l_d, l_q and of the flux, and whether it was measured here.
struct Scale {
    psi_m: f64,
    error: [f64; 4],
    measured: bool,
}

impl Scale {
    /// By a measured torque, else by the nameplate.
    fn new(fit: &Fit, machine: &Machine) -> Option<Self> {
        let [r_s, l_d, l_q] = fit.error;
        let shown = fit.scale.filter(|(_, error)| error[3] < SHOWN);
        let measured = shown.map(|(psi_m, error)| Self { psi_m, error, measured: true });
        let stated = || machine.get(BaseParameter::PsiM);
        measured
            .or_else(|| stated().map(|psi_m| Self { psi_m, error: [r_s, l_d, l_q, 0.0], measured: false }))
    }
}

impl Fit {
    /// Points that the others contradict.
    fn outliers(&self, points: &Points<'_>, options: &DiagnosisOptions) -> Option<Finding> {
        let level = options.remaining_chance / self.chance.len() as f64;
        let told = |k: usize| format!("{} ({:.3} rad/s)", k + 1, points.omega[k] / points.n_p);
        let beyond = self.chance.iter().filter(|(_, p)| *p < level).map(|(k, _)| told(*k));
        parameters_alone::contradicted(
            &beyond.collect::<Vec<_>>(),
            "speed",
            "they hardly count",
            "measure such points again",
        )
    }

    /// That the angle of the current contradicts its size, and by how much.
    fn angle_off(&self, points: &Points<'_>) -> Option<Finding> {
        if !self.of_size {
            return None;
        }
        let off = |k: usize| {
            let [d, q] = currents(self.ratios, points.omega[k]);
            let [i_d, i_q] = points.i.map(|axis| axis[k]);
            (d * i_q - q * i_d).atan2(d * i_d + q * i_q).abs()
        };
        let worst = (0..points.size.len()).map(off).fold(0.0, f64::max);
        Some(Finding {
            finding: format!(
                "i_d and i_q do not belong to shorted terminals: their size does, to {:.2} %, but their angle is off by up to {worst:.2} rad",
                100.0 * self.rms
            ),
            consequence: "the rotor angle by which they were turned is wrong in these rows; only the size of the current is used".into(),
            fix: "check the angle offset, and when the angle was taken for each point".into(),
        })
    }

    /// What the range of speeds does not show.
    fn unseen(&self) -> Option<Finding> {
        let names = ["r_s", "l_d", "l_q"];
        let weak: Vec<&str> = (0..3).filter(|k| self.error[*k] >= SHOWN).map(|k| names[k]).collect();
        (!weak.is_empty()).then(|| Finding {
            finding: format!("the points do not pin down {}", weak.join(", ")),
            consequence: "no value is given".into(),
            fix: "record speeds at which r_s limits the current, and speeds at which the inductances do"
                .into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::answer::Verdict;
    use crate::diagnose::diagnose;
    use crate::monitor::Silent;

    /// r_s, l_d, l_q and ψ_m.
    const MACHINE: [f64; 4] = [0.01, 2e-4, 5e-4, 0.08];

    /// Points at seven speeds, the currents turned by `angle(k)`, with the torque of the shaft if it is `measured`.
    fn points(angle: impl Fn(usize) -> f64, measured: bool) -> Recording {
        sized(|_| 1.0, angle, measured)
    }

    /// The same, the currents logged `size(k)` times as large.
    fn sized(size: impl Fn(usize) -> f64, angle: impl Fn(usize) -> f64, measured: bool) -> Recording {
        let speeds: Vec<f64> = [20.0, 50.0, 80.0, 150.0, 300.0, 700.0, 1500.0].into();
        let [r_s, l_d, l_q, psi_m] = MACHINE;
        let both: Vec<[f64; 2]> =
            speeds.iter().map(|w| currents([r_s / psi_m, l_d / psi_m, l_q / psi_m], *w)).collect();
        let turned = |axis: usize| -> Vec<f64> {
            let of = |(k, [d, q]): (usize, &[f64; 2])| {
                let (s, c) = angle(k).sin_cos();
                size(k) * [c * d - s * q, s * d + c * q][axis]
            };
            both.iter().enumerate().map(of).collect()
        };
        let mut columns = vec![
            ("t".to_string(), (0..7).map(|k| 10.0 * f64::from(k)).collect()),
            ("i_d".to_string(), turned(0)),
            ("i_q".to_string(), turned(1)),
            ("v_d".to_string(), vec![0.0; 7]),
            ("v_q".to_string(), vec![0.0; 7]),
            ("omega_e".to_string(), speeds),
        ];
        if measured {
            let torque = |[d, q]: &[f64; 2]| 6.0 * (psi_m + (l_d - l_q) * d) * q - 0.4;
            columns.push(("tau_m".to_string(), both.iter().map(torque).collect()));
        }
        Recording::new(columns, None).unwrap()
    }

    fn ask(recording: &Recording, psi_m: Option<f64>) -> Answer {
        let machine = Machine::new(4).unwrap();
        let machine = psi_m.map_or(machine.clone(), |psi| machine.with(BaseParameter::PsiM, psi).unwrap());
        diagnose(&[recording], &machine, None, &Default::default(), &Silent).unwrap()
    }

    fn off(answer: &Answer, parameter: BaseParameter) -> f64 {
        answer.model.base[parameter.name()].value.unwrap() / MACHINE[parameter.index()] - 1.0
    }

    #[test]
    fn shorted_terminals_show_ratios_and_the_nameplate_or_a_torque_their_scale() {
        let alone = ask(&points(|_| 0.0, false), None);
        assert!(alone.model.base.is_empty() && alone.verdict == Verdict::Undetermined);
        assert!(
            alone.data_quality[0].finding.contains("nothing gives the scale"),
            "{:?}",
            alone.data_quality
        );
        for answer in [ask(&points(|_| 0.0, false), Some(0.08)), ask(&points(|_| 0.0, true), None)] {
            for p in BaseParameter::ELECTRICAL {
                assert!(off(&answer, p).abs() < 1e-3, "{} {:?}", p.name(), answer.model.base);
            }
        }
    }

    #[test]
    fn a_wrong_rotor_angle_is_told_and_does_not_bend_the_parameters() {
        let answer = ask(&points(|k| [0.9, -0.3, 0.1, 0.5, -0.2, 0.3, 0.2][k], true), None);
        for p in BaseParameter::ELECTRICAL {
            assert!(off(&answer, p).abs() < 1e-2, "{} {:?}", p.name(), answer.model.base);
        }
        assert!(
            answer.data_quality.iter().any(|f| f.finding.contains("up to 0.90 rad")),
            "{:?}",
            answer.data_quality
        );
    }

    #[test]
    fn a_point_that_the_others_contradict_is_told_and_hardly_counts() {
        let answer = ask(&sized(|k| if k == 0 { 1.07 } else { 1.0 }, |_| 0.0, true), None);
        for p in BaseParameter::ELECTRICAL {
            assert!(off(&answer, p).abs() < 1e-3, "{} {:?}", p.name(), answer.model.base);
        }
        let told = "contradict 1 of them, by their number and speed: 1 (5.000 rad/s)";
        assert!(answer.data_quality.iter().any(|f| f.finding.contains(told)), "{:?}", answer.data_quality);
    }
}
