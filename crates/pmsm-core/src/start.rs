//! First values of the base parameters: the nameplate's, and for what the nameplate leaves open a linear regression
//! of the equations integrated over short stretches. First values of a free run: the measured ones, or better.

use crate::base::BASE;
use crate::error::{Error, Result};
use crate::machine::{BaseParameter, Machine};
use crate::model::Model;
use crate::recording::Kind;
use crate::signals::Signals;
use crate::simulate::coupled;
use nalgebra::{DMatrix, DVector};

/// Samples integrated over in the electrical regression.
const ELECTRICAL_STRETCH: usize = 8;
/// Stretch of the mechanical regression, s.
const MECHANICAL_STRETCH: f64 = 0.02;
/// Share of a segment from which its first values are estimated, and the fewest samples worth it.
const OPENING: f64 = 0.04;
const FEWEST_OPENING: usize = 6;

/// Base parameters to start from, in the order of [`BaseParameter::ALL`].
///
/// # Errors
/// [`Error::Unusable`] if a parameter is neither on the nameplate nor visible in the recording.
pub fn values(signals: &Signals, machine: &Machine) -> Result<[f64; BASE]> {
    let mut found = [f64::NAN; BASE];
    let unknown = |group: &[BaseParameter]| group.iter().any(|p| machine.get(*p).is_none());
    if unknown(&BaseParameter::ELECTRICAL)
        && let Some(x) = electrical(signals)
    {
        found[..4].copy_from_slice(&x);
    }
    let mut psi = machine.get(BaseParameter::PsiM);
    psi = psi.or(Some(found[BaseParameter::PsiM.index()]).filter(|x| x.is_finite()));
    if unknown(&BaseParameter::MECHANICAL)
        && let Some(x) = mechanical(signals, psi)
    {
        found[4..].copy_from_slice(&x);
    }
    let mut out = [0.0; BASE];
    for p in BaseParameter::ALL {
        let (low, high) = p.physical_range();
        out[p.index()] = match machine.get(p) {
            Some(value) => value,
            None if found[p.index()].is_finite() => found[p.index()].clamp(low, high),
            None if !needed(signals, p) => stand_in(p),
            None => {
                return Err(Error::unusable(
                    format!("{} is not on the nameplate and this recording does not show it", p.name()),
                    format!("give {} in {} under [machine]", p.name(), p.unit()),
                ));
            }
        };
    }
    Ok(out)
}

/// Whether the recording's equations contain the parameter at all.
pub fn needed(signals: &Signals, parameter: BaseParameter) -> bool {
    let electrical = BaseParameter::ELECTRICAL.contains(&parameter);
    match signals.kind {
        Kind::Full => true,
        Kind::Electrical => electrical,
        Kind::OperatingPoints => electrical && in_steady_equations(signals, parameter),
        Kind::OpenCircuit => parameter == BaseParameter::PsiM,
        Kind::Mechanical => !electrical || (signals.tau_e.is_none() && parameter == BaseParameter::PsiM),
    }
}

/// Whether v_d = r_s·i_d − ω·l_q·i_q or v_q = r_s·i_q + ω·(l_d·i_d + ψ_m), as far as they were logged, contain the parameter.
fn in_steady_equations(signals: &Signals, parameter: BaseParameter) -> bool {
    let Some(i) = &signals.i else { return false };
    let flows = |axis: usize| i[axis].iter().any(|x| *x != 0.0);
    let [d, q] = signals.axes;
    match parameter {
        BaseParameter::RS => (d && flows(0)) || (q && flows(1)),
        BaseParameter::LD => q && flows(0),
        BaseParameter::LQ => d && flows(1),
        _ => q,
    }
}

/// A harmless value for a parameter that no equation of the recording contains.
fn stand_in(parameter: BaseParameter) -> f64 {
    [1.0, 1e-3, 1e-3, 0.1, 1e-3, 0.0][parameter.index()]
}

/// r_s, l_d, l_q, psi_m from ∫v dt = r_s∫i dt + ΔΛ + rotation, per stretch.
fn electrical(signals: &Signals) -> Option<[f64; 4]> {
    let (v, i) = (signals.v.as_ref()?, signals.i.as_ref()?);
    let steady = matches!(signals.kind, Kind::OperatingPoints | Kind::OpenCircuit);
    let mut rows: Vec<([f64; 4], f64)> = Vec::new();
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
                rows.push(([sum[2], change(&i[0]), -sum[5], 0.0], sum[0]));
            }
            if signals.axes[1] {
                rows.push(([sum[3], sum[4], change(&i[1]), sum[6]], sum[1]));
            }
            k += stretch;
        }
    }
    solve(&rows)
}

/// j and b from ∫τ_e dt = J·Δω_m + b·∫ω_m dt + level, per stretch.
fn mechanical(signals: &Signals, psi: Option<f64>) -> Option<[f64; 2]> {
    let n_p = signals.n_p;
    let torque: Vec<f64> = match (&signals.tau_e, &signals.i) {
        (Some(tau), _) => tau.clone(),
        (None, Some(i)) => i[1].iter().map(|q| 1.5 * n_p * psi.unwrap_or(0.0) * q).collect(),
        _ => return None,
    };
    let stretch = ((MECHANICAL_STRETCH / signals.period) as usize).max(1);
    let mut rows: Vec<([f64; 3], f64)> = Vec::new();
    for segment in &signals.segments {
        let mut k = segment.start;
        while k + stretch < segment.end {
            let (mut tau, mut turned) = (0.0, 0.0);
            for m in k..k + stretch {
                let h = signals.t[m + 1] - signals.t[m];
                tau += 0.5 * (torque[m] + torque[m + 1]) * h;
                turned += 0.5 * (signals.omega_e[m] + signals.omega_e[m + 1]) / n_p * h;
            }
            let change = (signals.omega_e[k + stretch] - signals.omega_e[k]) / n_p;
            let load = signals.tau_m.as_ref().map_or(0.0, |x| x[k] * stretch as f64 * signals.period);
            rows.push(([change, turned, signals.t[k + stretch] - signals.t[k]], tau - load));
            k += stretch;
        }
    }
    solve(&rows).map(|[j, b, _]| [j, b])
}

/// Replaces the first currents and speed of each gap-free segment by an estimate with less noise: a free run of the
/// coupled model at the point `p` (base parameters and load torque) is compared with the opening of the segment, and
/// the straight line through what it leaves, taken back to the first sample, is the first sample's error. The slope of
/// the line takes up what a wrong parameter does in so short a time. The variance of a first value falls to 4/m of the
/// sensor's, m being the samples of the opening.
pub fn settle(signals: &mut Signals, model: &Model, p: &[f64]) {
    for segment in signals.segments.clone() {
        let m = (OPENING * segment.len() as f64) as usize;
        let Some(measured) = signals.i.as_ref().filter(|_| m >= FEWEST_OPENING) else { continue };
        let (mut sum, mut moment) = ([0.0; 3], [0.0; 3]);
        let first = segment.start;
        let own = model.parameter_count();
        coupled::run(model, signals, first..first + m, &p[..own], p[own], |k, now| {
            let seen = [measured[0][k], measured[1][k], signals.omega_e[k]];
            for c in 0..3 {
                sum[c] += seen[c] - now[c];
                moment[c] += (seen[c] - now[c]) * (k - first) as f64;
            }
            true
        });
        let m = m as f64;
        // Intercept of the regression on 0, 1, ..., m - 1.
        let error = [0, 1, 2].map(|c| (2.0 * (2.0 * m - 1.0) * sum[c] - 6.0 * moment[c]) / (m * (m + 1.0)));
        if let Some([d, q]) = signals.i.as_mut().filter(|_| error.iter().all(|e| e.is_finite())) {
            d[first] += error[0];
            q[first] += error[1];
            signals.omega_e[first] += error[2];
        }
    }
}

fn solve<const N: usize>(rows: &[([f64; N], f64)]) -> Option<[f64; N]> {
    if rows.len() < 2 * N {
        return None;
    }
    let matrix = DMatrix::from_fn(rows.len(), N, |r, c| rows[r].0[c]);
    let rhs = DVector::from_fn(rows.len(), |r, _| rows[r].1);
    let scale: Vec<f64> = matrix.column_iter().map(|c| c.norm()).collect();
    let scaled = DMatrix::from_fn(rows.len(), N, |r, c| matrix[(r, c)] / scale[c].max(f64::MIN_POSITIVE));
    let solution = scaled.svd(true, true).solve(&rhs, 1e-9).ok()?;
    let mut out = [f64::NAN; N];
    for c in 0..N {
        if scale[c] > 0.0 {
            out[c] = solution[c] / scale[c];
        }
    }
    Some(out)
}
