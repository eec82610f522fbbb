//! The equations integrated over short stretches, whose noise nearly cancels from one to the next, as linear regressions.

use crate::recording::Kind;
use crate::signals::Signals;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Samples integrated over in the electrical regression.
const ELECTRICAL_STRETCH: usize = 8;
/// Stretch of the mechanical regression, s, and the fewest of them in a segment.
const MECHANICAL_STRETCH: f64 = 0.02;
const FEWEST_STRETCHES: usize = 16;
/// Least eigenvalue of a regression's normal equations, as a share of the largest, that is no rounding.
const SHOWN: f64 = 1e-12;

/// r_s, l_d, l_q, psi_m from ∫v dt = r_s∫i dt + ΔΛ + rotation, per stretch; those that are `held` as they are.
pub fn electrical(signals: &Signals, held: [Option<f64>; 4]) -> Option<[f64; 4]> {
    of_voltages(signals, held)?.solve()
}

/// The same with nothing held, and the share of the squares that it leaves.
pub fn voltages(signals: &Signals) -> Option<([f64; 4], f64)> {
    let regression = of_voltages(signals, [None; 4])?;
    let found = regression.solve()?;
    Some((found, regression.left(&found)))
}

fn of_voltages(signals: &Signals, held: [Option<f64>; 4]) -> Option<Regression<4>> {
    let (v, i) = (signals.v.as_ref()?, signals.i.as_ref()?);
    let steady = matches!(signals.kind, Kind::OperatingPoints | Kind::OpenCircuit);
    let mut regression = Regression::new(held);
    for segment in &signals.segments {
        let mut k = segment.start;
        let stretch = if steady { 1 } else { ELECTRICAL_STRETCH };
        while k + stretch < segment.end || (steady && k < segment.end) {
            let mut sum = [0.0; 7];
            for m in k..k + stretch {
                let n = if steady { m } else { m + 1 };
                let h = if steady { 1.0 } else { signals.t[n] - signals.t[m] };
                let mean = |x: &[f64]| 0.5 * (x[m] + x[n]);
                let w = mean(&signals.omega_e);
                let (d, q) = (mean(&i[0]), mean(&i[1]));
                for (s, x) in sum.iter_mut().zip([v[0][m], v[1][m], d, q, w * d, w * q, w]) {
                    *s += x * h;
                }
            }
            let change = |x: &[f64]| if steady { 0.0 } else { x[k + stretch] - x[k] };
            if signals.axes[0] {
                regression.add([sum[2], change(&i[0]), -sum[5], 0.0], sum[0]);
            }
            if signals.axes[1] {
                regression.add([sum[3], sum[4], change(&i[1]), sum[6]], sum[1]);
            }
            k += stretch;
        }
    }
    Some(regression)
}

/// j, b and a constant torque from ∫τ_e dt = J·Δω_m + b·∫ω_m dt + level, per stretch; those that are `held` as they are. `flux` is that of
/// the magnet and l_d − l_q.
pub fn mechanical(
    signals: &Signals,
    [psi_m, saliency]: [f64; 2],
    held: [Option<f64>; 3],
) -> Option<[f64; 3]> {
    let n_p = signals.n_p;
    let torque: Vec<f64> = match (&signals.tau_e, &signals.i) {
        (Some(tau), _) => tau.clone(),
        (None, Some([d, q])) => {
            d.iter().zip(q).map(|(d, q)| 1.5 * n_p * (psi_m + saliency * d) * q).collect()
        }
        _ => return None,
    };
    let longest = ((MECHANICAL_STRETCH / signals.period) as usize).max(1);
    let mut regression = Regression::new(held);
    for segment in &signals.segments {
        let stretch = longest.min(segment.len() / FEWEST_STRETCHES).max(1);
        let mut k = segment.start;
        while k + stretch < segment.end {
            let (mut tau, mut turned) = (0.0, 0.0);
            for m in k..k + stretch {
                let h = signals.t[m + 1] - signals.t[m];
                let mean = |x: &[f64]| 0.5 * (x[m] + x[m + 1]);
                tau += (mean(&torque) - signals.tau_m.as_deref().map_or(0.0, mean)) * h;
                turned += mean(&signals.omega_e) / n_p * h;
            }
            let change = (signals.omega_e[k + stretch] - signals.omega_e[k]) / n_p;
            regression.add([change, turned, signals.t[k + stretch] - signals.t[k]], tau);
            k += stretch;
        }
    }
    regression.solve()
}

/// Linear least squares for the unknowns that are not held, from the sums of its normal equations.
struct Regression<const N: usize> {
    open: Vec<usize>,
    /// What is held, zero for the others.
    held: [f64; N],
    sums: [[f64; N]; N],
    right: [f64; N],
    square: f64,
    rows: usize,
}

impl<const N: usize> Regression<N> {
    fn new(held: [Option<f64>; N]) -> Self {
        let open = (0..N).filter(|c| held[*c].is_none()).collect();
        let held = held.map(|h| h.unwrap_or(0.0));
        Self { open, held, sums: [[0.0; N]; N], right: [0.0; N], square: 0.0, rows: 0 }
    }

    /// One equation Σ `row`·x = `right`.
    fn add(&mut self, row: [f64; N], right: f64) {
        let mut rest = right;
        for k in 0..N {
            rest -= row[k] * self.held[k];
        }
        for k in 0..N {
            self.right[k] += row[k] * rest;
            for other in 0..N {
                self.sums[k][other] += row[k] * row[other];
            }
        }
        self.square += rest * rest;
        self.rows += 1;
    }

    /// Share of the squares that `found`, its solution, leaves.
    fn left(&self, found: &[f64; N]) -> f64 {
        let taken: f64 = self.open.iter().map(|c| found[*c] * self.right[*c]).sum();
        (1.0 - taken / self.square).max(0.0)
    }

    /// All unknowns, NaN where nothing depends on one; `None` without anything to find, or without enough and finite equations. Of what cannot be told
    /// apart the shortest solution, in units of the columns.
    fn solve(&self) -> Option<[f64; N]> {
        let Self { open, sums, right, .. } = self;
        if open.is_empty() || self.rows < 2 * open.len() {
            return None;
        }
        let depends = |k: usize| sums[open[k]][open[k]] > 0.0;
        let scale = |k: usize| if depends(k) { sums[open[k]][open[k]].sqrt() } else { 1.0 };
        let size = open.len();
        let unit = DMatrix::from_fn(size, size, |r, c| sums[open[r]][open[c]] / (scale(r) * scale(c)));
        let right = DVector::from_fn(size, |r, _| right[open[r]] / scale(r));
        if !unit.iter().chain(&right).all(|x| x.is_finite()) {
            return None;
        }
        let eigen = SymmetricEigen::new(unit);
        let mut along = eigen.eigenvectors.tr_mul(&right);
        let floor = SHOWN * eigen.eigenvalues.max();
        for (x, value) in along.iter_mut().zip(&eigen.eigenvalues) {
            *x = if *value > floor { *x / value } else { 0.0 };
        }
        let found = eigen.eigenvectors * along;
        let mut out = self.held;
        for (k, &c) in open.iter().enumerate() {
            out[c] = if depends(k) { found[k] / scale(k) } else { f64::NAN };
        }
        Some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_nothing_depends_on_is_not_found() {
        let of = |count: u32, held: [Option<f64>; 2]| {
            let mut regression = Regression::new(held);
            (0..count).map(f64::from).for_each(|x| regression.add([x, 0.0], 3.0 * x));
            regression.solve()
        };
        let found = of(9, [None; 2]).unwrap();
        assert!((found[0] - 3.0).abs() < 1e-12 && found[1].is_nan());
        assert_eq!(of(9, [Some(1.0), None]).unwrap()[0], 1.0);
        assert!(of(9, [Some(1.0), Some(2.0)]).is_none() && of(3, [None; 2]).is_none());
    }
}
