//! Steady points of the voltage equations in a waveform whose rows lie too far apart for what the voltage does between them.
//!
//! Between such rows the currents have long followed the voltage, so a row tells nothing of inductances by their transients. Where currents and
//! speed stay as they are for a while, the steady equations hold all the same,
//!
//! > v_d = r_s·i_d − ω·l_q·i_q, v_q = r_s·i_q + ω·(l_d·i_d + ψ_m).

use super::{Finding, Limits, Signals};
use crate::figures::short;
use crate::machine::Machine;
use crate::numerics::extent::peak;
use crate::recording::{FEWEST_SAMPLES, Kind, Recording};
use std::ops::Range;

/// Length of a point, s, and its fewest rows: several time constants of any winding whose log is too coarse for it.
const POINT: (f64, usize) = (0.1, 4);
/// Change over a point, share of the largest value, from which it is not steady. The voltage that drives the change is no more than that share
/// of the drop over the winding.
const CHANGE: f64 = 0.02;
/// A block may last this many times what its rows would without a gap.
const LONGEST: f64 = 2.0;

/// Means of a signal over each block.
pub(super) fn means(x: &[f64], blocks: &[Range<usize>]) -> Vec<f64> {
    blocks.iter().map(|b| x[b.clone()].iter().sum::<f64>() / b.len() as f64).collect()
}

impl Signals {
    /// The steady points that this log holds, whose voltages were left out as its rows are too far apart; `None` where they were not, and
    /// where too little of it is steady.
    pub fn points_between_rows(&self, recording: &Recording, machine: &Machine) -> Option<Self> {
        let why = self.limits.coarse.as_ref()?;
        let whole = Self::in_rotor_frame(recording, machine).ok()?;
        let ([v_d, v_q], [d, q]) = (whole.v.as_ref()?, whole.i.as_ref()?);
        let size = ((POINT.0 / self.period).round() as usize).max(POINT.1);
        let current = CHANGE * peak(d).max(peak(q));
        let omega = (&self.omega_e, CHANGE * peak(&self.omega_e));
        let still = |block: Range<usize>| {
            [(d, current), (q, current), omega].iter().all(|(x, most)| change(&x[block.clone()]) <= *most)
        };
        let blocks = blocks(&self.t, self.period, size, still);
        if blocks.len() < FEWEST_SAMPLES {
            return None;
        }
        let v = [v_d, v_q].map(|v| means(v, &blocks));
        let mut points = whole.points_at(&blocks, v, machine);
        points.limits.coarse = Some(why.clone());
        points.findings.push(Finding {
            finding: format!(
                "{}: of the voltage equations only the parameters are asked, at {} steady points, means over {} s each",
                why.finding,
                points.len(),
                short(points.period, 3)
            ),
            consequence: "nothing is said of what the model leaves out of the voltage equations".into(),
            fix: why.fix.clone(),
        });
        Some(points)
    }

    /// The means of each block of this waveform as steady points, with these voltages.
    pub(super) fn points_at(&self, blocks: &[Range<usize>], v: [Vec<f64>; 2], machine: &Machine) -> Self {
        let mean = |x: &Vec<f64>| means(x, blocks);
        let n = blocks.len();
        let mut points = Self {
            t: mean(&self.t),
            averaged: blocks[0].len(),
            segments: std::iter::once(0..n).collect(),
            period: self.period * blocks[0].len() as f64,
            v: Some(v),
            phase_currents: false,
            i: self.i.as_ref().map(|[d, q]| [mean(d), mean(q)]),
            phases: None,
            theta_e: mean(&self.theta_e),
            theta_m: mean(&self.theta_m),
            three_currents: false,
            omega_e: mean(&self.omega_e),
            limits: Limits::default(),
            tau_e: None,
            tau_m: None,
            heating: self.heating.as_ref().map(mean),
            magnet_heating: self.magnet_heating.as_ref().map(mean),
            kind: Kind::OperatingPoints,
            findings: Vec::new(),
            ..self.clone()
        };
        points.context.steady = true;
        points.context.period = points.period;
        points.set_scales(machine, n);
        points.complete();
        points
    }
}

/// Blocks of so many rows, without gaps, that are `still`.
pub(super) fn blocks(
    t: &[f64],
    period: f64,
    size: usize,
    still: impl Fn(Range<usize>) -> bool,
) -> Vec<Range<usize>> {
    let holds = |block: &Range<usize>| {
        let lasts = t[block.end - 1] - t[block.start];
        lasts <= LONGEST * period * size as f64 && still(block.clone())
    };
    (0..t.len() / size).map(|b| b * size..(b + 1) * size).filter(holds).collect()
}

/// Change of a signal over a block: from the middle of one half to that of the other it changes half as much.
pub(super) fn change(x: &[f64]) -> f64 {
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let (first, second) = x.split_at(x.len() / 2);
    if first.is_empty() { 0.0 } else { 2.0 * (mean(second) - mean(first)).abs() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::BaseParameter;

    /// Ten seconds at 50 Hz of a machine with 0.2 Ω, 0.5 mH and 0.02 V s that drives through these levels of speed and current.
    fn recorded(level: impl Fn(usize) -> f64) -> (Recording, Machine) {
        let t: Vec<f64> = (0..500).map(|k| 0.02 * f64::from(k)).collect();
        let omega: Vec<f64> = (0..500).map(|k| 60.0 + 40.0 * level(k)).collect();
        let q: Vec<f64> = (0..500).map(|k| 3.0 - level(k)).collect();
        let columns = vec![
            ("v_d".to_string(), (0..500).map(|k| -omega[k] * 5e-4 * q[k]).collect()),
            ("v_q".to_string(), (0..500).map(|k| 0.2 * q[k] + 0.02 * omega[k]).collect()),
            ("i_d".to_string(), vec![0.0; 500]),
            ("i_q".to_string(), q.clone()),
            ("omega_e".to_string(), omega.clone()),
            ("t".to_string(), t),
        ];
        let stated = [(BaseParameter::RS, 0.2), (BaseParameter::LD, 5e-4), (BaseParameter::LQ, 5e-4)];
        let with = |machine: Machine, (parameter, value)| machine.with(parameter, value).unwrap();
        let machine = stated.into_iter().fold(Machine::new(4).unwrap(), with);
        (Recording::new(columns, None).unwrap(), machine)
    }

    #[test]
    fn a_slow_log_of_levels_holds_steady_points_of_both_equations() {
        let (recording, machine) = recorded(|k| (k / 125) as f64);
        let slow = Signals::new(&recording, &machine).unwrap();
        assert!(slow.v.is_none() && slow.limits.coarse.is_some());
        let points = slow.points_between_rows(&recording, &machine).unwrap();
        assert_eq!((points.kind, points.axes, points.averaged), (Kind::OperatingPoints, [true, true], 5));
        assert_eq!(points.len(), 100, "levels change between points");
        let (v, i) = (points.v.as_ref().unwrap(), points.i.as_ref().unwrap());
        for k in 0..points.len() {
            assert!((v[1][k] - 0.2 * i[1][k] - 0.02 * points.omega_e[k]).abs() < 1e-12);
        }
        assert!(points.findings[0].finding.contains("100 steady points"), "{:?}", points.findings);
    }

    #[test]
    fn a_log_in_which_nothing_is_steady_holds_none() {
        let (recording, machine) = recorded(|k| [0.0, 3.0][k / 3 % 2]);
        let slow = Signals::new(&recording, &machine).unwrap();
        assert!(slow.points_between_rows(&recording, &machine).is_none());
    }
}
