//! Steady points of currents, speed and measured torque, without voltages, as a dynamometer maps them.
//!
//! At a constant speed the balance of the shaft is
//!
//! > τ_m = 3/2·n_p·(ψ_m·i_q + (l_d − l_q)·i_d·i_q) − b·ω_m − τ_c·sgn ω_m,
//!
//! linear in what is not known. It shows flux and friction; what a model of the voltages or of the motion leaves out it does not.

use super::answer::Answer;
use super::options::DiagnosisOptions;
use super::parameters_alone::{self, Shown};
use crate::error::Result;
use crate::figures::{figure, quantity};
use crate::machine::{BaseParameter, Machine};
use crate::numerics::robust::{self, Line};
use crate::recording::{Kind, Recording};
use crate::signals::{Finding, Signals};
use crate::simulate::mechanical::WINDOW;

/// Share of the rows that must turn each way for an offset of the torque sensor to be told from Coulomb friction.
const EACH_WAY: f64 = 0.1;
/// Standard errors from which a term is told.
const SHOWN: f64 = 3.0;
/// Range of a term, share of its largest value, from which it is told from a constant.
const VARIES: f64 = 0.1;

/// Whether a recording holds such points: a measured load torque beside currents, in rows so far apart that no window of the motion holds two.
pub fn are(recording: &Recording) -> bool {
    let torque = recording.has(&["tau_m"]) && !recording.has(&["tau_e"]);
    recording.kind() == Kind::Mechanical && torque && recording.period() > WINDOW
}

/// What the points of a recording show.
///
/// # Errors
/// Those of [`Signals::new`].
pub fn answer(recording: &Recording, machine: &Machine, options: &DiagnosisOptions) -> Result<Answer> {
    let signals = Signals::new(recording, machine)?;
    let (Some([d, q]), Some(tau_m)) = (&signals.i, &signals.tau_m) else {
        unreachable!("points of torque hold currents and a torque")
    };
    let balance = Balance::new(machine, &signals, d, q);
    let line = robust::line(&balance.columns, &balance.right(tau_m));
    let follows = |line: &Line| line.found[0].abs() > SHOWN * line.error[0];
    let line = match line.filter(follows) {
        Some(line) if line.found[0] > 0.0 => line,
        other => {
            let why = if other.is_some() {
                turned_round()
            } else {
                said("the torque does not follow i_q in these points".into())
            };
            let why = (why, Kind::Mechanical);
            return Ok(parameters_alone::answer(why, &[], machine, signals.findings, options));
        }
    };
    let psi_m = line.found[0];
    let mut shown: Vec<Shown> = vec![(BaseParameter::PsiM, psi_m, line.error[0])];
    shown.extend(balance.place("b").map(|at| (BaseParameter::B, line.found[at], line.error[at])));
    let constant = 1.5 * signals.n_p * psi_m;
    let why = said(format!(
        "{} steady points of torque show k_t = {} N m/A (psi_m = {}){}, with a residual of {} rms",
        tau_m.len() - line.outliers.len(),
        figure(constant, 3),
        quantity(psi_m, 4, "V s"),
        balance.friction_words(&line),
        quantity(line.scatter, 2, "N m")
    ));
    let mut findings = signals.findings;
    findings.extend(outliers(&line));
    findings.extend(balance.held.clone());
    Ok(parameters_alone::answer((why, Kind::Mechanical), &shown, machine, findings, options))
}

/// That the torque has the wrong sign.
fn turned_round() -> Finding {
    Finding {
        finding: "the measured torque counts against i_q: the flux of the magnet would be negative".into(),
        consequence: "as it is logged no machine makes such a torque".into(),
        fix: "turn it round with tau_m = { from = \"...\", scale = -1 } under [columns], or i_q and the speed in the same manner".into(),
    }
}

/// That nothing more is told, and why.
fn said(finding: String) -> Finding {
    Finding {
        finding,
        consequence: "r_s, l_d, l_q and j cannot be seen without voltages and motion, and no effect is named or excluded".into(),
        fix: "log the voltages of the same points for the electrical parameters, and a waveform for what the model leaves out".into(),
    }
}

/// Rows that the others contradict.
fn outliers(line: &Line) -> Option<Finding> {
    let told = |k: &usize| format!("{} ({:+.3} N m)", k + 1, line.off[*k]);
    parameters_alone::contradicted(
        &line.outliers.iter().map(told).collect::<Vec<_>>(),
        "how far they are off",
        "they have no weight",
        "measure such points again; they are kept where others near them agree",
    )
}

/// The terms of the balance that the points can tell apart.
struct Balance {
    names: Vec<&'static str>,
    columns: Vec<Vec<f64>>,
    /// Torque of what is held, N m.
    known: Vec<f64>,
    /// What is to be said of it.
    held: Option<Finding>,
}

impl Balance {
    fn new(machine: &Machine, signals: &Signals, d: &[f64], q: &[f64]) -> Self {
        let n = q.len();
        let gain = 1.5 * signals.n_p;
        let speed: Vec<f64> = signals.omega_e.iter().map(|w| w / signals.n_p).collect();
        let reluctance: Vec<f64> = d.iter().zip(q).map(|(d, q)| gain * d * q).collect();
        let mut out = Self {
            names: vec!["psi_m"],
            columns: vec![q.iter().map(|q| gain * q).collect()],
            known: vec![0.0; n],
            held: None,
        };
        let stated = |p| machine.get(p);
        if let (Some(l_d), Some(l_q)) = (stated(BaseParameter::LD), stated(BaseParameter::LQ)) {
            out.known = reluctance.iter().map(|x| (l_d - l_q) * x).collect();
        } else if varies(d) {
            out.add("l_d - l_q", reluctance);
        } else if d.iter().any(|x| *x != 0.0) {
            out.held = Some(Finding {
                finding: "i_d is the same in all points".into(),
                consequence: "the torque of the reluctance, (l_d - l_q) i_d, counts as part of psi_m".into(),
                fix: "give l_d and l_q under [machine], or record points at several i_d".into(),
            });
        }
        if varies(&speed) {
            out.add("b", speed.iter().map(|w| -w).collect());
        }
        let ways = [speed.iter().filter(|w| **w > 0.0).count(), speed.iter().filter(|w| **w < 0.0).count()];
        if ways.iter().any(|way| *way > 0) {
            let sign = |w: &f64| if *w == 0.0 { 0.0 } else { -w.signum() };
            out.add("tau_c", speed.iter().map(sign).collect());
        }
        if ways.iter().all(|way| *way as f64 >= EACH_WAY * n as f64) {
            out.add("offset", vec![1.0; n]);
        }
        out
    }

    fn add(&mut self, name: &'static str, column: Vec<f64>) {
        self.names.push(name);
        self.columns.push(column);
    }

    fn place(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|own| *own == name)
    }

    fn right(&self, tau_m: &[f64]) -> Vec<f64> {
        tau_m.iter().zip(&self.known).map(|(tau, known)| tau - known).collect()
    }

    /// What friction the points show, as it goes on in a sentence.
    fn friction_words(&self, line: &Line) -> String {
        let told = |name: &str| {
            let at = self.place(name)?;
            (line.found[at].abs() > SHOWN * line.error[at]).then(|| line.found[at])
        };
        let mut words = Vec::new();
        words.extend(told("b").map(|b| format!("viscous friction of {}", quantity(b, 2, "N m s"))));
        let apart = if self.place("offset").is_some() {
            ""
        } else {
            " (or an offset of the torque sensor: one direction cannot tell)"
        };
        words.extend(
            told("tau_c").map(|tau| {
                format!("a constant drag of {} against the motion{apart}", quantity(tau, 2, "N m"))
            }),
        );
        words.extend(
            told("offset")
                .map(|tau| format!("an offset of the torque sensor of {}", quantity(tau, 2, "N m"))),
        );
        words.extend(told("l_d - l_q").map(|l| format!("l_d - l_q = {}", quantity(l, 3, "H"))));
        if words.is_empty() { String::new() } else { format!(", {}", words.join(", ")) }
    }
}

/// Whether values differ by a good part of the largest: else their term is that of a constant.
fn varies(x: &[f64]) -> bool {
    let (low, high) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
    high - low > VARIES * high.abs().max(low.abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::answer::Verdict;
    use crate::diagnose::diagnose;
    use crate::monitor::Silent;
    use crate::numerics::random::normal_pair;

    /// Points over currents and speeds of a machine with ψ_m = 0.01 V s, n_p = 5, b = 1 mN m s, τ_c = 0.05 N m; the torque times `sign`.
    fn points(sign: f64) -> Recording {
        let n = 80;
        let of = |f: &dyn Fn(usize) -> f64| (0..n).map(f).collect::<Vec<f64>>();
        let (i_q, omega) = (|k: usize| (k % 10) as f64 - 2.0, |k: usize| 20.0 * (k / 10) as f64 - 70.0);
        let torque = |k: usize| {
            let outlier = if k == 17 || k == 60 { 3.0 } else { 0.0 };
            let noise = 0.002 * normal_pair(3, [k as u32, 0, 0, 0]).0;
            sign * (0.075 * i_q(k) - 1e-3 * omega(k) - 0.05 * omega(k).signum() + outlier + noise)
        };
        let columns = vec![
            ("t".into(), of(&|k| 2.0 * k as f64)),
            ("i_d".into(), vec![0.0; n]),
            ("i_q".into(), of(&i_q)),
            ("omega_m".into(), of(&omega)),
            ("tau_m".into(), of(&torque)),
        ];
        Recording::new(columns, None).unwrap()
    }

    #[test]
    fn points_of_torque_show_flux_and_friction_whatever_some_of_them_say() {
        let machine = Machine::new(5).unwrap();
        let answer = diagnose(&[&points(1.0)], &machine, None, &Default::default(), &Silent).unwrap();
        let base = |name: &str| answer.model.base[name].value.unwrap();
        assert!((base("psi_m") / 0.01 - 1.0).abs() < 0.01 && (base("b") / 1e-3 - 1.0).abs() < 0.05);
        assert_eq!((answer.verdict, answer.ranking.len()), (Verdict::Undetermined, 0));
        let said = &answer.data_quality;
        assert!(
            said[0].finding.contains("k_t = 0.07")
                && said[0].finding.contains("drag of 5")
                && said[0].finding.contains(" mN m against"),
            "{said:?}"
        );
        assert!(said.iter().any(|f| f.finding.contains("18 (+3") && f.finding.contains("61 (+")), "{said:?}");
    }

    #[test]
    fn a_torque_of_the_opposite_sign_is_told() {
        let machine = Machine::new(5).unwrap();
        let answer = diagnose(&[&points(-1.0)], &machine, None, &Default::default(), &Silent).unwrap();
        assert!(answer.data_quality[0].fix.contains("scale = -1") && answer.model.base.is_empty());
    }
}
