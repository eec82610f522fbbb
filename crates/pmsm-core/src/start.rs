//! First values of the base parameters: the nameplate's, or a linear regression of the equations integrated over short
//! stretches. First values of a free run: the measured ones, or better.

mod regression;

use crate::base::BASE;
use crate::error::{Error, Result};
use crate::machine::{BaseParameter, Machine};
use crate::model::Model;
use crate::recording::Kind;
use crate::signals::Signals;
use crate::simulate::coupled;
use regression::{electrical, mechanical};

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
        && let Some(x) = electrical(signals, [None; 4])
    {
        found[..4].copy_from_slice(&x);
    }
    let mut psi = machine.get(BaseParameter::PsiM);
    psi = psi.or(Some(found[BaseParameter::PsiM.index()]).filter(|x| x.is_finite()));
    if unknown(&BaseParameter::MECHANICAL)
        && let Some([j, b, _]) = mechanical(signals, [psi.unwrap_or(0.0), 0.0], [None; 3])
    {
        found[4..].copy_from_slice(&[j, b]);
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

/// The point `p` (base parameters and load torque on top of what the recording tells of it) with the entries `free` from a regression of
/// each equation that holds the others; what the regression does not show stays.
pub fn regressed(signals: &Signals, p: &[f64], free: &[usize]) -> Vec<f64> {
    let held = |k: usize| (!free.contains(&k)).then_some(p[k]);
    let mut out = p.to_vec();
    if free.iter().any(|k| *k < 4) {
        take(&mut out[..4], electrical(signals, [0, 1, 2, 3].map(held)));
    }
    if free.iter().any(|k| *k >= 4) {
        let flux = [out[BaseParameter::PsiM.index()], out[1] - out[2]];
        take(&mut out[4..], mechanical(signals, flux, [4, 5, 6].map(held)));
    }
    out
}

/// r_s, l_d, l_q and psi_m from a regression of the voltage equations alone, and the share of the squares that it leaves; `None` where the
/// recording does not show them.
pub fn voltages(signals: &Signals) -> Option<([f64; 4], f64)> {
    regression::voltages(signals)
}

/// Takes over what was found.
fn take<const N: usize>(out: &mut [f64], found: Option<[f64; N]>) {
    let shown = out.iter_mut().zip(found.into_iter().flatten()).filter(|(_, x)| x.is_finite());
    shown.for_each(|(out, x)| *out = x);
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
    let turns = signals.omega_e.iter().any(|x| *x != 0.0);
    let [d, q] = signals.axes;
    match parameter {
        BaseParameter::RS => (d && flows(0)) || (q && flows(1)),
        BaseParameter::LD => q && flows(0) && turns,
        BaseParameter::LQ => d && flows(1) && turns,
        _ => q && turns,
    }
}

/// A harmless value for a parameter that no equation of the recording contains.
fn stand_in(parameter: BaseParameter) -> f64 {
    [1.0, 1e-3, 1e-3, 0.1, 1e-3, 0.0][parameter.index()]
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::{Manoeuvre, Schedule, Setup, Shape, simulate};
    use crate::monitor::Silent;

    #[test]
    fn a_regression_of_what_is_asked_for_holds_the_rest() {
        let mut manoeuvre = Manoeuvre::new(1.0);
        let speeds = vec![(0.1, 90.0), (0.3, -80.0), (0.5, 60.0), (0.7, -60.0), (0.9, 80.0)];
        manoeuvre.omega_m = Some(Schedule::new(speeds, Shape::Linear).unwrap());
        manoeuvre.tau_load = Some(Schedule::constant(2.0).unwrap());
        manoeuvre.load_kind = Some("unknown_constant".into());
        let machine = Machine::liu_2008().with_drive(Some(560.0), Some(20.0), Some(5e3)).unwrap();
        let mut setup = Setup::new(machine, manoeuvre);
        (setup.drive.sensors.noise_i, setup.drive.sensors.noise_omega_e) = (0.05, 0.3);
        let recording = simulate(&setup, &Silent).unwrap().recording;
        let signals = Signals::new(&recording, &setup.nameplate).unwrap();
        let truth = [values(&signals, &setup.machine).unwrap().as_slice(), &[2.0]].concat();

        let off: Vec<f64> = truth.iter().map(|x| 1.5 * x).collect();
        assert_eq!(regressed(&signals, &off, &[]), off);
        for free in [vec![0, 6], vec![3, 4], vec![0, 2, 3, 4, 6]] {
            // What is held is held at its true value.
            let start: Vec<f64> = (0..7).map(|k| if free.contains(&k) { off[k] } else { truth[k] }).collect();
            let found = regressed(&signals, &start, &free);
            for k in 0..7 {
                let close = (found[k] / truth[k] - 1.0).abs() < if free.contains(&k) { 0.1 } else { 1e-15 };
                assert!(close, "{free:?}: {k} at {}, truly {}", found[k], truth[k]);
            }
        }
    }
}
