//! Waveforms whose v_q was logged and whose v_d was not.
//!
//! Without v_d no voltage vector drives the currents. The mean of the q equation over a block of time T holds all the same,
//!
//! > mean v_q = r_s·mean i_q + l_q·Δi_q/T + mean ω·(l_d·i_d + ψ_m),
//!
//! and where i_q hardly changes the block is a steady point of it.

use super::steady_points::{blocks, change, means};
use super::{Finding, Signals};
use crate::figures::{quantity, short};
use crate::machine::Machine;
use crate::numerics::extent::peak;
use crate::recording::{FEWEST_SAMPLES, Load, OPERATING_POINT_PERIOD, Recording};
use std::ops::Range;

/// Length of a block, s: many samples, and a small part of the time in which a current that counts as steady changes.
const BLOCK: f64 = 0.02;
/// Time in which a steady current changes by no more than the run's largest one, s: the time from which rows count as steady points anyway. What
/// l_q then adds to the drop over the winding is the share l_q/r_s of this time.
const STEADY: f64 = OPERATING_POINT_PERIOD;
/// Lengths of a block within which the next one must follow for the speed's rate to be taken between them.
const NEXT: f64 = 1.5;

impl Signals {
    /// The steady points of the q equation that this recording holds where v_d was not logged; `None` with v_d or without v_q, and where
    /// too few blocks are steady.
    pub fn q_points(&self, recording: &Recording, machine: &Machine) -> Option<Self> {
        let v_q = recording.column("v_q").filter(|_| recording.has_q_alone())?;
        let [d, q] = self.i.as_ref()?;
        let blocks = steady(&self.t, self.period, d, q);
        if blocks.len() < FEWEST_SAMPLES {
            return None;
        }
        let v_q = means(v_q, &blocks);
        let mut points = self.points_at(&blocks, [vec![0.0; blocks.len()], v_q], machine);
        points.axes = [false, true];
        points.findings.push(points.of_one_axis(recording.load()));
        Some(points)
    }

    /// What is to be said of points of the q equation alone.
    fn of_one_axis(&self, load: Load) -> Finding {
        let at_zero = self.i.as_ref().is_some_and(|[d, _]| d.iter().all(|x| *x == 0.0));
        let (with, unseen) = match (at_zero, load == Load::Locked) {
            (true, false) => (" with i_d = 0", "l_d and l_q cannot be seen"),
            (true, true) => (" with i_d = 0 and a held rotor", "psi_m, l_d and l_q cannot be seen"),
            (false, true) => (" with a held rotor", "psi_m, l_d and l_q cannot be seen"),
            (false, false) => ("", "l_q cannot be seen"),
        };
        Finding {
            finding: format!(
                "v_d is not logged: the q equation is used at {} steady points{with}, means over {} s each",
                self.len(),
                short(self.period, 3)
            ),
            consequence: format!("{unseen}, and nothing is said of transients or ripple of the voltages"),
            fix: "log v_d beside v_q for the d equation and the inductances".into(),
        }
    }

    /// What an error of one row between the times of v_q and of the speed does to r_s, ohm; `None` where nothing is averaged. Where the speed
    /// changes in step with i_q, the voltage that is induced in such a time counts as a drop over the winding.
    pub fn clock_error(&self, psi_m: f64) -> Option<f64> {
        let (Some([_, q]), true) = (&self.i, self.averaged > 1) else { return None };
        let (mut product, mut square) = (0.0, 0.0);
        for k in 1..self.len() {
            let passed = self.t[k] - self.t[k - 1];
            if passed < NEXT * self.period {
                let i = 0.5 * (q[k] + q[k - 1]);
                product += (self.omega_e[k] - self.omega_e[k - 1]) / passed * i;
                square += i * i;
            }
        }
        let change = psi_m * product / square * self.row();
        change.is_finite().then(|| change.abs())
    }

    /// Period of the rows of the log before they were averaged, s.
    fn row(&self) -> f64 {
        self.period / self.averaged as f64
    }

    /// A finding if that error is more than a part in a hundred.
    pub fn of_clock(&self, r_s: f64, psi_m: f64) -> Option<Finding> {
        let change = self.clock_error(psi_m).filter(|change| *change > 0.01 * r_s)?;
        Some(Finding {
            finding: format!(
                "the speed changes in step with i_q: if v_q was logged {} ms (one row) earlier or later than the speed, r_s is {} \
                 higher or lower",
                short(1e3 * self.row(), 4),
                quantity(change, 2, "ohm")
            ),
            consequence: "the stated error of r_s includes it".into(),
            fix: "hold several currents at constant speeds, or a locked rotor, for r_s".into(),
        })
    }

    /// Says that the logged v_q was not used, as too little of the run is steady.
    pub fn q_unused(&mut self) {
        self.findings.push(Finding {
            finding: format!(
                "v_d is not logged, and in fewer than {FEWEST_SAMPLES} places of {BLOCK} s i_q keeps its sign and changes by less than its \
                 largest value in {STEADY} s"
            ),
            consequence: "v_q is not used: nothing is said of the voltage equations".into(),
            fix: "log v_d beside v_q, or hold several currents and speeds for a while each".into(),
        });
    }
}

/// Blocks of samples in which neither current changes by much and i_q keeps its sign: where the currents of the phases commutate, what they take from
/// the voltage is not that of the mean current.
fn steady(t: &[f64], period: f64, d: &[f64], q: &[f64]) -> Vec<Range<usize>> {
    let size = ((BLOCK / period).round() as usize).max(1);
    let most = period * size as f64 / STEADY * peak(d).max(peak(q));
    let keeps_sign = |x: &[f64]| x.iter().all(|x| *x >= 0.0) || x.iter().all(|x| *x <= 0.0);
    blocks(t, period, size, |block| {
        let (d, q) = (&d[block.clone()], &q[block]);
        keeps_sign(q) && change(d) <= most && change(q) <= most
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Kind;

    /// A second of i_q at 1 kHz, without i_d, beside the voltage of r_s = 2 Ω, ψ_m = 0.1 V s at 50 rad/s.
    fn recorded(i_q: impl Fn(f64) -> f64, load: Option<Load>) -> (Recording, Machine) {
        let t: Vec<f64> = (0..2000).map(|k| 1e-3 * f64::from(k)).collect();
        let q: Vec<f64> = t.iter().map(|t| i_q(*t)).collect();
        let columns = vec![
            ("v_q".to_string(), q.iter().map(|q| 2.0 * q + 5.0).collect()),
            ("i_d".to_string(), vec![0.0; t.len()]),
            ("omega_e".to_string(), vec![50.0; t.len()]),
            ("i_q".to_string(), q),
            ("t".to_string(), t),
        ];
        (Recording::new(columns, load).unwrap(), Machine::new(4).unwrap())
    }

    fn points(i_q: impl Fn(f64) -> f64, load: Option<Load>) -> Option<Signals> {
        let (recording, machine) = recorded(i_q, load);
        Signals::new(&recording, &machine).unwrap().q_points(&recording, &machine)
    }

    #[test]
    fn a_waveform_without_v_d_holds_steady_points_of_the_q_equation() {
        let found = points(|t| 1.0 + t, None).unwrap();
        assert_eq!((found.len(), found.kind, found.axes), (100, Kind::OperatingPoints, [false, true]));
        assert!(found.context.steady && (found.period - 0.02).abs() < 1e-12);
        let (v, i) = (found.v.as_ref().unwrap(), found.i.as_ref().unwrap());
        for k in 0..found.len() {
            assert!((v[1][k] - 2.0 * i[1][k] - 5.0).abs() < 1e-12 && i[0][k] == 0.0);
        }
        let said = &found.findings[0];
        assert!(said.finding.contains("q equation is used at 100 steady points with i_d = 0"), "{said:?}");
        assert!(said.consequence.contains("l_d and l_q cannot be seen"), "{said:?}");
        let held = points(|t| 1.0 + t, Some(Load::Locked)).unwrap();
        assert!(held.findings[0].consequence.contains("psi_m"), "{:?}", held.findings);
    }

    #[test]
    fn blocks_in_which_the_current_changes_or_turns_round_are_no_points() {
        let turns = points(|t| if t < 1.01 { 3.0 } else { -3.0 }, None).unwrap();
        assert_eq!(turns.len(), 99);
        assert!(points(|t| (400.0 * t).sin(), None).is_none(), "nowhere steady");
    }
}
