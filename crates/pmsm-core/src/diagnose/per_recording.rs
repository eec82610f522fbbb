//! The part of the answer on each of several recordings by itself.

use super::answer::{BeforeAfter, Columns, OfRecording};
use super::data::Data;
use crate::experiment::Channel;
use crate::recording::Kind;
use std::collections::BTreeMap;

/// Each of several recordings with its own noise and its own part of the fit; nothing of a single one.
pub fn recordings(data: &Data, traces: &Columns) -> Vec<OfRecording> {
    let of = |run: usize, part: &Data| {
        let samples = data.samples_of(run);
        let column = |channel: Channel, what: &str| {
            traces.get(&format!("{}_{what}", channel.name())).map(|x| &x[samples.clone()])
        };
        let fit = |when: &str| -> BTreeMap<String, f64> {
            let channel = |c: Channel| Some((c.name().into(), rms(column(c, "measured")?, column(c, when)?)));
            part.floors.iter().filter_map(|f| channel(f.channel)).collect()
        };
        let noise = part.floors.iter().map(|f| (f.channel.name().to_string(), f.total()));
        OfRecording {
            samples: part.signals.len(),
            duration: part.signals.context.duration,
            kind: part.signals.kind,
            load: part.signals.load.kind(),
            noise_floor: noise.collect(),
            fit: BeforeAfter { before: fit("before"), after: fit("after") },
        }
    };
    let mut out: Vec<OfRecording> = Vec::new();
    for (run, part) in data.parts.iter().enumerate() {
        let Some(number) = data.number(run) else { return Vec::new() };
        let own = of(run, part);
        if number > out.len() {
            out.push(own);
        } else {
            // Of its steady points a recording tells beside its motion.
            let whole = &mut out[number - 1];
            whole.kind = Kind::Full;
            whole.noise_floor.extend(own.noise_floor);
            whole.fit.before.extend(own.fit.before);
            whole.fit.after.extend(own.fit.after);
        }
    }
    out
}

/// The number of the recording to which each sample belongs, counted from one; none where there is only one.
pub fn numbers(data: &Data) -> Option<Vec<f64>> {
    let number =
        |(run, part): (usize, &Data)| vec![data.number(run).unwrap_or(run + 1) as f64; part.signals.len()];
    (!data.parts.is_empty()).then(|| data.parts.iter().enumerate().flat_map(number).collect())
}

/// Root mean square of measured minus model, over the samples that were measured.
pub fn rms(measured: &[f64], model: &[f64]) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (m, x) in measured.iter().zip(model).filter(|(m, _)| m.is_finite()) {
        sum += (m - x).powi(2);
        count += 1;
    }
    (sum / f64::from(count)).sqrt()
}
