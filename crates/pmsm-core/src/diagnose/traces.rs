//! Measured and predicted signals behind an answer, and the root mean squares of their difference.

use super::answer::{BeforeAfter, Columns};
use super::data::Data;
use super::hypothesis::Hypothesis;
use super::per_recording;
use crate::recording::Kind;
use std::collections::BTreeMap;

/// What was measured, and what two sets predict, with the operating points.
pub fn columns(data: &Data, before: &Hypothesis, after: &Hypothesis) -> Columns {
    let mut columns = Columns::new();
    let s = &data.signals;
    columns.insert("t".into(), s.t.clone());
    if let Some(number) = per_recording::numbers(data) {
        columns.insert("recording".into(), number);
    }
    let first = data.whole(before);
    let shown = |hypothesis: &Hypothesis| data.whole(hypothesis).predict(&hypothesis.parameters);
    let (x, y) = rayon::join(|| shown(before), || shown(after));
    for (at, channel) in first.channels().iter().enumerate() {
        let name = channel.name();
        columns.insert(format!("{name}_measured"), first.measured(*channel));
        columns.insert(format!("{name}_before"), x[at].clone());
        columns.insert(format!("{name}_after"), y[at].clone());
    }
    columns.insert("op_omega_e".into(), s.omega_e.clone());
    if let Some([d, q]) = &s.i {
        columns.insert("op_i_d".into(), d.clone());
        columns.insert("op_i_q".into(), q.clone());
    }
    if s.angle_known && s.kind != Kind::OperatingPoints {
        columns.insert("op_theta_e".into(), s.theta_e.clone());
        columns.insert("op_theta_m".into(), s.theta_m.clone());
    }
    columns
}

/// Root mean square of measured minus model in each channel of these columns, before and after.
pub fn table(columns: &Columns, data: &Data) -> BeforeAfter {
    let rms = |when: &str| -> BTreeMap<String, f64> {
        data.floors
            .iter()
            .filter_map(|f| {
                let name = f.channel.name();
                let (measured, model) =
                    (columns.get(&format!("{name}_measured"))?, columns.get(&format!("{name}_{when}"))?);
                Some((name.to_string(), per_recording::rms(measured, model)))
            })
            .collect()
    };
    BeforeAfter { before: rms("before"), after: rms("after") }
}

/// Root mean square of model minus measurement by channel, over all recordings that hold it.
pub fn residual_rms(data: &Data, hypothesis: &Hypothesis) -> BTreeMap<String, f64> {
    let mut sums: BTreeMap<String, Vec<(f64, usize)>> = BTreeMap::new();
    let floors = data.runs().iter().flat_map(|run| run.floors.iter().map(|f| (f, run.signals.len())));
    let experiment = data.whole(hypothesis).plain();
    let relative = experiment.relative_rms(&experiment.residual(&hypothesis.parameters));
    for ((floor, samples), relative) in floors.zip(relative) {
        let rms = relative * floor.total();
        sums.entry(floor.channel.name().to_string()).or_default().push((rms, samples));
    }
    let root = |parts: Vec<(f64, usize)>| match parts[..] {
        [(rms, _)] => rms,
        _ => {
            let samples: usize = parts.iter().map(|(_, n)| n).sum();
            (parts.iter().map(|(rms, n)| rms * rms * *n as f64).sum::<f64>() / samples as f64).sqrt()
        }
    };
    sums.into_iter().map(|(name, parts)| (name, root(parts))).collect()
}
