//! A low pass in the log of the currents. Noise that has passed one is not white, and the logged currents lag behind the voltages. The time
//! constant is the most likely one, and it is taken out where nothing but white noise is left of the currents then.

use super::baseline;
use super::data::Data;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::verdict::mismatched_currents;
use crate::error::Result;
use crate::experiment::Block;
use crate::monitor::Monitor;
use crate::noise::colour::Colour;

/// Shortest and longest time constant that is looked for, rows, and how many are tried between them and about the best of these.
const ROWS: (f64, f64) = (0.3, 40.0);
const TRIED: (usize, usize) = (8, 8);

/// Takes a low pass that the currents have passed out of `data`, if they have, and fits `base` anew.
///
/// # Errors
/// Those of the least-squares fits.
pub fn take_out(data: &mut Data, base: &mut Hypothesis, monitor: &dyn Monitor) -> Result<()> {
    let electrical = |run: &&Data| run.has_electrical();
    let mismatched = |base: &Hypothesis| mismatched_currents(base, &data.options);
    let may = data.runs().iter().filter(electrical).all(|run| run.signals.currents_may_be_filtered());
    // What lags behind may pass for noise of the voltages.
    let noisy = data.runs().iter().any(|run| run.input.voltage > 0.0);
    if !(mismatched(base) || noisy) || !may || !data.runs().iter().any(|run| run.has_electrical()) {
        return Ok(());
    }
    let period = data.leading().signals.period;
    let white = data.with_white_currents();
    let worth = |rows: f64| -> Result<f64> {
        monitor.go_on()?;
        likelihood(&white.without_filter(rows * period), base, (rows, Noise::White), monitor)
    };
    let (low, high) = (ROWS.0.ln(), ROWS.1.ln());
    let step = (high - low) / (TRIED.0 - 1) as f64;
    let mut best = (f64::NEG_INFINITY, 0.0);
    for k in 0..TRIED.0 {
        let rows = (low + step * k as f64).exp();
        best = larger(best, (worth(rows)?, rows));
    }
    // One more parameter, and as rare as any effect.
    let pays =
        |gain: f64| gain / data.options.rows_per_sample >= data.options.effect_cost + data.options.decisive;
    if !pays(best.0 - likelihood(&white, base, (0.0, Noise::White), monitor)?) {
        return Ok(());
    }
    let mut reach = step;
    for _ in 0..TRIED.1 / 2 {
        reach *= 0.5;
        for rows in [best.1 * (-reach).exp(), best.1 * reach.exp()] {
            best = larger(best, (worth(rows)?, rows));
        }
    }
    // Noise of the voltages, which is not white in the currents, would gain by any filter.
    let coloured = |data: &Data, rows: f64| likelihood(data, base, (rows, Noise::Coloured), monitor);
    if !pays(coloured(&white.without_filter(best.1 * period), best.1)? - coloured(&white, 0.0)?) {
        return Ok(());
    }
    let mut tried = data.without_filter(best.1 * period);
    let fitted = baseline::fit(&mut tried, monitor)?;
    // Beside something else that is missing its time constant is not known.
    if mismatched(&fitted) {
        return Ok(());
    }
    (*data, *base) = (tried, fitted);
    Ok(())
}

/// What is left of the currents beside what the model explains.
#[derive(Clone, Copy, PartialEq)]
enum Noise {
    White,
    /// By an autoregression of its own.
    Coloured,
}

fn larger(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    if b.0 > a.0 { b } else { a }
}

/// Logarithm of the likelihood of the logged currents, nats, if nothing but noise is left of them and they passed a low pass. Its time constant
/// is so many `rows`, and it was taken out of `data`. Of a new value the share 1 − e^(−1/rows) enters the log.
fn likelihood(
    data: &Data,
    base: &Hypothesis,
    (rows, noise): (f64, Noise),
    monitor: &dyn Monitor,
) -> Result<f64> {
    let fitted = fitting::currents_alone(data, base, monitor)?;
    let experiment = data.experiment(&fitted.model, &fitted.nuisances, data.channels(true, false)).plain();
    let mut residual = experiment.residual(&fitted.parameters);
    if noise == Noise::Coloured {
        for block in experiment.blocks() {
            let own = &mut residual.as_mut_slice()[block.rows.clone()];
            let segments = &data.runs()[block.run].signals.segments;
            if let Some(colour) = Colour::of(own, segments) {
                segments.iter().for_each(|segment| colour.whiten(&mut own[segment.clone()]));
            }
        }
    }
    let left = experiment.relative_rms(&residual);
    let enters = if rows > 0.0 { 1.0 - (-1.0 / rows).exp() } else { 1.0 };
    let of = |(block, left): (Block, f64)| -(block.rows.len() as f64) * (left * enters).ln();
    Ok(experiment.blocks().into_iter().zip(left).map(of).sum())
}

impl Data {
    /// The same without a low pass of the time constant `tau` (s) in its currents.
    pub(super) fn without_filter(&self, tau: f64) -> Self {
        let mut out = self.clone();
        out.signals.take_filter_out(tau);
        out.parts.iter_mut().for_each(|part| part.signals.take_filter_out(tau));
        out
    }
}

#[cfg(test)]
mod tests {
    use crate::diagnose::answer::{Answer, Verdict};
    use crate::diagnose::diagnose;
    use crate::diagnose::testing::{choice, telemetry};
    use crate::drive::Choice;
    use crate::monitor::Silent;
    use crate::numerics::random::normal_pair;
    use crate::recording::Recording;

    /// Of a machine whose axis currents were logged behind a low pass with the time constant `tau` (s), and whose voltages with `noise` (V).
    fn told(effects: &[Choice], tau: f64, noise: f64) -> Answer {
        let run = |levels: [f64; 3]| {
            let (mut columns, setup) = telemetry(levels, effects.to_vec());
            let a = if tau > 0.0 { (-(columns[0].1[1] - columns[0].1[0]) / tau).exp() } else { 0.0 };
            for (_, x) in columns.iter_mut().filter(|(name, _)| name.starts_with("i_")) {
                (1..x.len()).for_each(|k| x[k] = a * x[k - 1] + (1.0 - a) * x[k]);
            }
            for (number, (_, x)) in columns.iter_mut().filter(|(name, _)| name.starts_with("v_")).enumerate()
            {
                let own = |k: usize| noise * normal_pair(13, [k as u32, number as u32, 0, 0]).0;
                x.iter_mut().enumerate().for_each(|(k, v)| *v += own(k));
            }
            (Recording::new(columns, None).unwrap(), setup.nameplate)
        };
        let ((recording, machine), (validation, _)) = (run([90.0, -70.0, 40.0]), run([-60.0, 80.0, -30.0]));
        diagnose(&[&recording], &machine, Some(&validation), &Default::default(), &Silent).unwrap()
    }

    #[test]
    fn a_low_pass_in_the_log_of_the_currents_is_found_and_taken_out() {
        for (effects, named) in
            [(Vec::new(), vec![]), (vec![choice("coulomb_friction", "tau_c", 0.3)], vec!["coulomb_friction"])]
        {
            let answer = told(&effects, 6e-4, 0.0);
            let filter = |answer: &Answer| {
                answer.data_quality.iter().any(|f| f.finding.contains("currents are low-pass filtered at 2"))
            };
            assert!(filter(&answer), "{:?}", answer.data_quality);
            assert_eq!(answer.model.effects, named);
            let expected = if named.is_empty() { Verdict::NoMismatch } else { Verdict::Named };
            assert_eq!(answer.verdict, expected, "{:?}", answer.remaining);
        }
        // Noise of the voltages is no filter of the currents.
        for noise in [0.0, 1.4] {
            let without = told(&[], 0.0, noise);
            let said = &without.data_quality;
            let none = said.iter().all(|f| !f.finding.contains("filtered"));
            assert!(without.verdict == Verdict::NoMismatch && none, "{noise}: {said:?}");
        }
    }
}
