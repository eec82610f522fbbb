//! The coupled model's sum of squares with the initial values of each gap-free segment (i_d, i_q, ω_e) as parameters of
//! their own: normal equations are summed up as the run goes, and nothing is stored.

use super::{INITIAL, Objective};
use crate::least_squares::Normal;
use crate::real::Dual;
use crate::simulate::coupled;
use nalgebra::{DMatrix, DVector};

impl Objective<'_> {
    /// The measured initial values of all segments, three each.
    pub fn measured_starts(&self) -> Vec<f64> {
        let signals = self.experiment.signals;
        let Some([d, q]) = &signals.i else { return Vec::new() };
        signals.segments.iter().flat_map(|s| [d[s.start], q[s.start], signals.omega_e[s.start]]).collect()
    }

    /// Sum of squares at the point `p` from the initial values `starts`; not finite where the model cannot be evaluated.
    pub fn free_cost(&self, p: &[f64], starts: &[f64]) -> f64 {
        let signals = self.experiment.signals;
        let Some([d, q]) = &signals.i else { return f64::INFINITY };
        let weight = self.weights();
        let own = self.experiment.model.parameter_count();
        let mut sum = 0.0;
        for (segment, start) in signals.segments.iter().zip(starts.chunks(INITIAL)) {
            let begin = |_, _| [start[0], start[1], start[2]];
            let (model, range) = (self.experiment.model, segment.clone());
            coupled::run_from(model, signals, range, &p[..own], p[own], begin, |k, now| {
                let error = [now[0] - d[k], now[1] - q[k], now[2] - signals.omega_e[k]];
                for c in 0..INITIAL {
                    sum += (error[c] * weight[c]).powi(2);
                }
                true
            });
        }
        sum
    }

    /// Normal equations in the entries `free` of the point and in all initial values, in this order.
    pub fn free_normal(&self, p: &[f64], free: &[usize], starts: &[f64]) -> Normal {
        match free.len() {
            0..=2 => self.free_normal_sized::<5>(p, free, starts),
            3..=4 => self.free_normal_sized::<7>(p, free, starts),
            _ => self.free_normal_sized::<10>(p, free, starts),
        }
    }

    /// Derivatives are carried by dual numbers with `L` slots, the last three for the initial values of the segment.
    fn free_normal_sized<const L: usize>(&self, p: &[f64], free: &[usize], starts: &[f64]) -> Normal {
        let signals = self.experiment.signals;
        let dim = free.len() + starts.len();
        let mut normal =
            Normal { cost: f64::INFINITY, jtj: DMatrix::zeros(dim, dim), jtr: DVector::zeros(dim) };
        let Some([d, q]) = &signals.i else { return normal };
        let (weight, lanes, own) = (self.weights(), L - INITIAL, self.experiment.model.parameter_count());
        let mut seeded: Vec<Dual<L>> = p.iter().map(|x| Dual { re: *x, eps: [0.0; L] }).collect();
        for (slot, entry) in free.iter().enumerate() {
            seeded[*entry].eps[slot] = 1.0;
        }
        normal.cost = 0.0;
        for (s, (segment, start)) in signals.segments.iter().zip(starts.chunks(INITIAL)).enumerate() {
            let begin = |_, _| [0, 1, 2].map(|c| Dual::variable(start[c], lanes + c));
            let (mut jtj, mut jtr, mut cost) = ([[0.0; L]; L], [0.0; L], 0.0);
            let (model, range) = (self.experiment.model, segment.clone());
            coupled::run_from(model, signals, range, &seeded[..own], seeded[own], begin, |k, now| {
                let measured = [d[k], q[k], signals.omega_e[k]];
                for c in 0..INITIAL {
                    let error = (now[c].re - measured[c]) * weight[c];
                    let mut slope = now[c].eps;
                    for e in &mut slope {
                        *e *= weight[c];
                    }
                    cost += error * error;
                    for a in 0..L {
                        jtr[a] += slope[a] * error;
                        // The whole row: half as many products would not be vectorised.
                        for b in 0..L {
                            jtj[a][b] += slope[a] * slope[b];
                        }
                    }
                }
                true
            });
            normal.cost += cost;
            let place = |slot: usize| {
                if slot < lanes {
                    Some(slot).filter(|x| *x < free.len())
                } else {
                    Some(free.len() + s * INITIAL + slot - lanes)
                }
            };
            for a in 0..L {
                let Some(row) = place(a) else { continue };
                normal.jtr[row] += jtr[a];
                for b in 0..L {
                    if let Some(column) = place(b) {
                        normal.jtj[(row, column)] += jtj[a][b];
                    }
                }
            }
        }
        normal
    }

    fn weights(&self) -> [f64; INITIAL] {
        [0, 1, 2].map(|c| 1.0 / self.experiment.channels[c].1)
    }
}
