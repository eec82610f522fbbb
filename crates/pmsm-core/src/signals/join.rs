//! Several recordings seen as one: laid end to end, for whatever looks at them sample by sample. No model is driven by this;
//! each recording keeps its own clock and its own start for that.

use super::{Finding, Limits, Signals};
use crate::effect::Context;
use crate::recording::Kind;

impl Signals {
    /// The recordings one behind the other, each beginning one sample period after the last ended. What some of them did not log
    /// is NaN there, or missing where it would mean something else; the scales are the largest of all.
    ///
    /// # Panics
    /// Without any recording.
    pub fn end_to_end(parts: &[&Self]) -> Self {
        let first = *parts.first().expect("at least one recording");
        let all = |holds: fn(&Self) -> bool| parts.iter().all(|s| holds(s));
        let chain = |x: fn(&Self) -> &Vec<f64>| parts.iter().flat_map(|s| x(s)).copied().collect();
        let (mut t, mut segments, mut begin) = (Vec::new(), Vec::new(), 0.0);
        for part in parts {
            let at = t.len();
            t.extend(part.t.iter().map(|x| x + begin));
            segments.extend(part.segments.iter().map(|s| s.start + at..s.end + at));
            begin = t[t.len() - 1] + part.period;
        }
        let kind = if parts.iter().all(|s| s.kind == first.kind) { first.kind } else { Kind::Full };
        Self {
            t,
            segments,
            period: largest(parts, |s| s.period),
            control_period: first.control_period,
            averaged: 1,
            within: None,
            stator_held: first.stator_held,
            voltages_drawn: first.voltages_drawn,
            current_filter: first.current_filter,
            link_stated: first.link_stated,
            middle_of_steps: first.middle_of_steps,
            phase_voltages: first.phase_voltages,
            v: series(parts, |s| s.v.as_ref()),
            axes: [0, 1].map(|axis| parts.iter().any(|s| s.axes[axis])),
            phase_currents: all(|s| s.phase_currents),
            i: series(parts, |s| s.i.as_ref()),
            phases: series(parts, |s| s.phases.as_ref()),
            theta_e: chain(|s| &s.theta_e),
            theta_m: chain(|s| &s.theta_m),
            angle_known: all(|s| s.angle_known),
            angle_from_voltages: parts.iter().any(|s| s.angle_from_voltages),
            turn_known: all(|s| s.turn_known),
            three_currents: all(|s| s.three_currents),
            omega_e: chain(|s| &s.omega_e),
            speed_known: all(|s| s.speed_known),
            limits: Limits {
                coarse: parts.iter().find_map(|s| s.limits.coarse.clone()),
                angle_step: parts.iter().map(|s| s.limits.angle_step).fold(0.0, f64::max),
                found: parts.iter().flat_map(|s| s.limits.found.iter().cloned()).collect(),
                ..Limits::default()
            },
            tau_e: single(parts, |s| s.tau_e.as_ref()),
            tau_m: single(parts, |s| s.tau_m.as_ref()),
            heating: single(parts, |s| s.heating.as_ref()),
            magnet_heating: single(parts, |s| s.magnet_heating.as_ref()),
            load: first.load,
            kind,
            n_p: first.n_p,
            context: scales(parts),
            findings: findings(parts.iter().map(|s| &s.findings[..])),
        }
    }
}

/// What was found in each of several recordings: with its number, unless it was found in all of them.
pub fn findings<'a>(parts: impl Iterator<Item = &'a [Finding]> + Clone) -> Vec<Finding> {
    let count = parts.clone().count();
    let mut out: Vec<Finding> = Vec::new();
    for (number, own) in parts.clone().enumerate() {
        for finding in own {
            let everywhere = parts.clone().all(|part| part.contains(finding));
            if count == 1 || everywhere {
                if number == 0 {
                    out.push(finding.clone());
                }
                continue;
            }
            out.push(Finding {
                finding: format!("recording {}: {}", number + 1, finding.finding),
                ..finding.clone()
            });
        }
    }
    out
}

/// One column of all recordings, NaN where one does not hold it; none if none does.
fn single<'a>(
    parts: &[&'a Signals],
    column: impl Fn(&'a Signals) -> Option<&'a Vec<f64>>,
) -> Option<Vec<f64>> {
    parts.iter().any(|s| column(s).is_some()).then(|| {
        let own = |s: &&'a Signals| column(s).cloned().unwrap_or_else(|| vec![f64::NAN; s.len()]);
        parts.iter().flat_map(own).collect()
    })
}

/// Several columns that come together.
fn series<'a, const N: usize>(
    parts: &[&'a Signals],
    columns: impl Fn(&'a Signals) -> Option<&'a [Vec<f64>; N]>,
) -> Option<[Vec<f64>; N]> {
    let all: Vec<Vec<f64>> = (0..N).map_while(|x| single(parts, |s| columns(s).map(|c| &c[x]))).collect();
    all.try_into().ok()
}

fn largest(parts: &[&Signals], of: impl Fn(&Signals) -> f64) -> f64 {
    parts.iter().map(|s| of(s)).fold(f64::NEG_INFINITY, f64::max)
}

fn scales(parts: &[&Signals]) -> Context {
    let most = |of: fn(&Context) -> f64| largest(parts, |s| of(&s.context));
    let three: Vec<&&Signals> = parts.iter().filter(|s| s.three_currents).collect();
    let samples: usize = three.iter().map(|s| s.len()).sum();
    let common: f64 = three.iter().map(|s| s.context.zero_sequence * s.len() as f64).sum();
    Context {
        n_p: parts[0].context.n_p,
        i_max: most(|c| c.i_max),
        v_max: most(|c| c.v_max),
        omega_e_max: most(|c| c.omega_e_max),
        tau_max: most(|c| c.tau_max),
        psi_max: most(|c| c.psi_max),
        swing: most(|c| c.swing),
        duration: most(|c| c.duration),
        period: most(|c| c.period),
        v_dc: most(|c| c.v_dc),
        electrical_rate: parts[0].context.electrical_rate,
        zero_sequence: if samples > 0 { common / samples as f64 } else { 0.0 },
        completed_phase: parts[0]
            .context
            .completed_phase
            .filter(|_| parts.iter().all(|s| s.context.completed_phase == parts[0].context.completed_phase)),
        load_known: parts.iter().all(|s| s.context.load_known),
        steady: parts.iter().any(|s| s.context.steady),
        has_temperature: parts.iter().all(|s| s.context.has_temperature),
        has_magnet_temperature: parts.iter().all(|s| s.context.has_magnet_temperature),
    }
}
