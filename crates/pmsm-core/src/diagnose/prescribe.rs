//! Which recording would tell rivals apart: where their predictions already differ most on this one.

use super::data::Data;
use super::locate::regions;
use super::verdict::Judged;

/// One sentence on what to record next, given two fitted rivals.
pub fn separate(data: &Data, a: (&str, &Judged), b: (&str, &Judged)) -> String {
    let predict = |judged: &Judged| {
        let experiment = data.whole(&judged.fitted);
        (experiment.predict(&judged.fitted.parameters), experiment.channels)
    };
    let ((first, channels), (second, _)) = (predict(a.1), predict(b.1));
    // The channel in which they differ most, in units of its noise.
    let differences = first.iter().zip(&second).zip(&channels).map(|((x, y), (channel, sigma))| {
        let d: Vec<f64> = x.iter().zip(y).map(|(x, y)| (x - y) / sigma).collect();
        let rms = (d.iter().map(|v| v * v).sum::<f64>() / d.len() as f64).sqrt();
        (*channel, rms, d)
    });
    let Some((channel, rms, difference)) = differences.max_by(|a, b| a.1.total_cmp(&b.1)) else {
        return String::new();
    };
    // Regions are taken from excess over the noise; scale so that the difference itself counts.
    let scaled: Vec<f64> = difference.iter().map(|d| 3.0 * d / rms.max(1e-12)).collect();
    let places: Vec<String> = regions(data, &scaled).iter().map(super::locate::Region::words).collect();
    let place = if places.is_empty() {
        "over the whole range; record longer and with more reversals, two levels of i_q, steps of i_d"
            .to_string()
    } else {
        format!("for {}; record more of that, and go beyond it where it is safe", places.join(", "))
    };
    format!(
        "{} and {} differ here by only {rms:.2} times the noise in {}, most {place}.",
        a.0,
        b.0,
        channel.name()
    )
}
