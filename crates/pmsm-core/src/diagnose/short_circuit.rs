//! Steady points of shorted terminals: v_d = v_q = 0, and the turning magnet drives the currents.
//!
//! With both voltages zero the steady equations are homogeneous in r_s, l_d, l_q and ψ_m: currents over speed show the ratios
//!
//! > i_d = −ω²·l_q·ψ_m/D, i_q = −ω·r_s·ψ_m/D, D = r_s² + ω²·l_d·l_q,
//!
//! and the scale comes from a measured torque or from the flux on the nameplate. The size of the current does not depend on the rotor's
//! angle. Where its angle contradicts its size, the size is taken.

use super::answer::Answer;
use super::options::DiagnosisOptions;
use super::parameters_alone::{self, Shown};
use crate::error::Result;
use crate::machine::{BaseParameter, Machine};
use crate::numerics::robust;
use crate::recording::{Kind, Recording};
use crate::signals::{Finding, Signals};
use nalgebra::{Matrix3, Vector3};

/// Most rounds of Levenberg's method.
const ROUNDS: usize = 200;
/// Step of its difference quotients, in the logarithm of a ratio.
const STEP: f64 = 1e-5;
/// Residual of both currents, over that of their size alone, and as a share of the current, above both of which the angle is not used.
const ANGLE: (f64, f64) = (3.0, 0.02);
/// Standard error of the logarithm of a ratio beyond which it is not shown.
const SHOWN: f64 = 0.2;
/// Residual, relative to each measured value, beyond which the fit is no model of the points: it misses half of them.
const NO_MODEL: f64 = 0.5;
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
    let scale = points.scale(&fit, &signals, machine);
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
            let named = [BaseParameter::RS, BaseParameter::LD, BaseParameter::LQ];
            let mut shown: Vec<Shown> = Vec::new();
            for (k, parameter) in named.into_iter().enumerate().filter(|(k, _)| fit.error[*k] < SHOWN) {
                shown.push((
                    parameter,
                    fit.ratios[k] * psi,
                    fit.ratios[k] * psi * fit.error[k].hypot(scale.error),
                ));
            }
            shown.push((BaseParameter::PsiM, psi, if scale.measured { psi * scale.error } else { 0.0 }));
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
    findings.extend(points.angle_off(&fit));
    findings.extend(fit.unseen());
    Ok(Some(parameters_alone::answer((why, kind), &shown, machine, findings, options)))
}

/// Currents over speed.
struct Points<'a> {
    omega: &'a [f64],
    i: [&'a [f64]; 2],
    size: Vec<f64>,
}

/// Ratios of r_s, l_d and l_q to ψ_m.
struct Fit {
    ratios: [f64; 3],
    /// Standard errors of their logarithms.
    error: [f64; 3],
    /// Root mean square of what is left, share of the current.
    rms: f64,
    /// Whether the size of the current alone was compared.
    of_size: bool,
}

/// Flux of the magnet, V s, its relative error, and whether it was measured here.
struct Scale {
    psi_m: f64,
    error: f64,
    measured: bool,
}

/// i_d and i_q of shorted terminals at the ratios (r_s, l_d, l_q)/ψ_m.
fn currents([r_s, l_d, l_q]: [f64; 3], w: f64) -> [f64; 2] {
    let d = r_s * r_s + w * w * l_d * l_q;
    [-w * w * l_q / d, -w * r_s / d]
}

impl<'a> Points<'a> {
    fn new(signals: &'a Signals) -> Self {
        let [d, q] = signals.i.as_ref().expect("steady points hold both currents");
        let size = d.iter().zip(q).map(|(d, q)| d.hypot(*q)).collect();
        Self { omega: &signals.omega_e, i: [d, q], size }
    }

    /// The fit to both currents, or to their size where the angle contradicts it.
    fn as_far_as_believed(&self) -> Option<Fit> {
        let of_size = self.fit(true)?;
        match self.fit(false) {
            Some(both) if both.rms <= (ANGLE.0 * of_size.rms).max(ANGLE.1) => Some(both),
            _ => Some(of_size),
        }
    }

    /// What is left at these logarithms of the ratios, share of the current.
    fn left(&self, x: &Vector3<f64>, of_size: bool) -> Vec<f64> {
        let ratios = [x[0].exp(), x[1].exp(), x[2].exp()];
        let counted = (0..self.size.len()).filter(|k| self.size[*k] > 0.0 && self.omega[*k] != 0.0);
        counted
            .flat_map(|k| {
                let [d, q] = currents(ratios, self.omega[k]);
                let size = self.size[k];
                match of_size {
                    true => vec![d.hypot(q) / size - 1.0],
                    false => vec![(d - self.i[0][k]) / size, (q - self.i[1][k]) / size],
                }
            })
            .collect()
    }

    fn fit(&self, of_size: bool) -> Option<Fit> {
        let most = self.size.iter().copied().fold(0.0, f64::max);
        let slope =
            (0..self.size.len()).map(|k| self.size[k] / self.omega[k].abs()).filter(|x| x.is_finite());
        // At low speed the resistance limits the current, at high speed l_d does.
        let (l_d, r_s) = (1.0 / most, 1.0 / slope.fold(0.0, f64::max));
        let mut x = Vector3::new(r_s.ln(), l_d.ln(), (1.5 * l_d).ln());
        if !x.iter().all(|x| x.is_finite()) {
            return None;
        }
        let cost = |x: &Vector3<f64>| self.left(x, of_size).iter().map(|r| r * r).sum::<f64>();
        let (mut damping, mut best) = (1e-2, cost(&x));
        let mut normal = Matrix3::zeros();
        for _ in 0..ROUNDS {
            let rest = self.left(&x, of_size);
            let slopes: [Vec<f64>; 3] = std::array::from_fn(|k| {
                let mut near = x;
                near[k] += STEP;
                self.left(&near, of_size).iter().zip(&rest).map(|(a, b)| (a - b) / STEP).collect()
            });
            let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            normal = Matrix3::from_fn(|r, c| product(&slopes[r], &slopes[c]));
            let along = Vector3::from_fn(|r, _| product(&slopes[r], &rest));
            let damped =
                normal + Matrix3::from_diagonal(&normal.diagonal().map(|d| damping * d + f64::MIN_POSITIVE));
            let next = x - damped.try_inverse()? * along;
            let after = cost(&next);
            if after < best {
                let settled = best - after <= 1e-12 * best;
                (x, best, damping) = (next, after, damping * 0.2);
                if settled {
                    break;
                }
            } else {
                damping *= 5.0;
            }
        }
        let rows = self.left(&x, of_size).len();
        let inverse = normal.try_inverse().filter(|_| rows > 3)?;
        let variance = best / (rows - 3) as f64;
        let error = std::array::from_fn(|k| (variance * inverse[(k, k)]).sqrt());
        let rms = (best / rows as f64).sqrt();
        let found = rms < NO_MODEL && error.iter().all(|e: &f64| !e.is_nan());
        found.then(|| Fit { ratios: [x[0].exp(), x[1].exp(), x[2].exp()], error, rms, of_size })
    }

    /// The flux of the magnet by a measured torque, else by the nameplate.
    fn scale(&self, fit: &Fit, signals: &Signals, machine: &Machine) -> Option<Scale> {
        let stated =
            || machine.get(BaseParameter::PsiM).map(|psi_m| Scale { psi_m, error: 0.0, measured: false });
        let Some(tau_m) = &signals.tau_m else { return stated() };
        let [_, l_d, l_q] = fit.ratios;
        let per_flux = |w: &f64| {
            let [d, q] = currents(fit.ratios, *w);
            1.5 * signals.n_p * (q + (l_d - l_q) * d * q)
        };
        let mut terms =
            vec![self.omega.iter().map(per_flux).collect(), self.omega.iter().map(|w| -w.signum()).collect()];
        if self.omega.len() >= DRAGS {
            terms.push(self.omega.iter().map(|w| -w / signals.n_p).collect());
        }
        let line = robust::line(&terms, tau_m)?;
        let shown = line.found[0] > 0.0 && line.error[0] < SHOWN * line.found[0];
        let measured = Scale { psi_m: line.found[0], error: line.error[0] / line.found[0], measured: true };
        if shown { Some(measured) } else { stated() }
    }

    /// That the angle of the current contradicts its size, and by how much.
    fn angle_off(&self, fit: &Fit) -> Option<Finding> {
        if !fit.of_size {
            return None;
        }
        let off = |k: usize| {
            let [d, q] = currents(fit.ratios, self.omega[k]);
            let (cross, dot) = (d * self.i[1][k] - q * self.i[0][k], d * self.i[0][k] + q * self.i[1][k]);
            cross.atan2(dot).abs()
        };
        let worst = (0..self.size.len()).map(off).fold(0.0, f64::max);
        Some(Finding {
            finding: format!(
                "i_d and i_q do not belong to shorted terminals: their size does, to {:.2} %, but their angle is off by up to {worst:.2} rad",
                100.0 * fit.rms
            ),
            consequence: "the rotor angle by which they were turned is wrong in these rows; only the size of the current is used".into(),
            fix: "check the angle offset, and when the angle was taken for each point".into(),
        })
    }
}

impl Fit {
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
        let speeds: Vec<f64> = [20.0, 50.0, 80.0, 150.0, 300.0, 700.0, 1500.0].into();
        let [r_s, l_d, l_q, psi_m] = MACHINE;
        let both: Vec<[f64; 2]> =
            speeds.iter().map(|w| currents([r_s / psi_m, l_d / psi_m, l_q / psi_m], *w)).collect();
        let turned = |axis: usize| -> Vec<f64> {
            let of = |(k, [d, q]): (usize, &[f64; 2])| {
                let (s, c) = angle(k).sin_cos();
                [c * d - s * q, s * d + c * q][axis]
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
}
