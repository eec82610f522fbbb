//! Whether the voltage of a log changed between its rows. Rows picked from a faster drive hold the voltage of one instant, and not that which
//! acts up to the next row. The residual of the voltage equations is then no physics.

use super::data::Data;
use super::fitting;
use super::hypothesis::Hypothesis;
use crate::error::Result;
use crate::experiment::Channel;
use crate::machine::BaseParameter;
use crate::monitor::Monitor;
use crate::signals::{Finding, Signals};

/// Row distance, as a share of an electrical time constant, below which the question is not asked. A held voltage and one drawn straight
/// from row to row then act alike on the currents.
const NEAR: f64 = 0.1;
/// Electrical time constants, and fewest rows, of the pieces of a recording in which a voltage held over each row is compared with one drawn
/// straight from row to row. A current forgets within a few time constants, so that pieces of ten are independent of one another.
const PIECE: f64 = 10.0;
const FEWEST_ROWS: usize = 8;
/// Standard errors by which the mean log ratio of what both leave must differ from zero (Vuong, "Likelihood ratio tests for model selection
/// and non-nested hypotheses", 1989). Of logs as slow as these whose machine file tells no rate, half may be picked from faster ones; a
/// twentieth of the others is taken for such.
const DECISIVE: f64 = 1.645;

/// Why nothing can be asked of the voltages, where they moved between the rows, or these lie too far apart for the machine that was fitted.
///
/// # Errors
/// Those of the least-squares fits.
pub fn moved(data: &Data, base: &Hypothesis, monitor: &dyn Monitor) -> Result<Option<Finding>> {
    let rate = {
        let own = |p: BaseParameter| base.own()[p.index()];
        own(BaseParameter::RS) / own(BaseParameter::LD).min(own(BaseParameter::LQ))
    };
    let sampled = |run: &Data| run.has_electrical() && run.has_mechanical() && run.signals.within.is_none();
    if !data.runs().iter().any(sampled) {
        return Ok(None);
    }
    if let Some(run) = data.runs().iter().find(|run| sampled(run) && run.signals.is_coarse(rate)) {
        return Ok(Some(run.signals.too_coarse(rate, "")));
    }
    let far =
        |run: &Data| sampled(run) && !run.signals.holds_every_period() && run.signals.period * rate > NEAR;
    let mismatched =
        |(channel, square): &(Channel, f64)| channel.is_electrical() && *square > 1.0 + data.options.mismatch;
    if !base.squares.iter().any(mismatched) || !data.runs().iter().any(far) {
        return Ok(None);
    }
    let mut drawn = data.clone();
    drawn.signals.draw_voltages_through();
    drawn.parts.iter_mut().for_each(|part| part.signals.draw_voltages_through());
    let as_held = left_in_pieces(data, &fitting::currents_alone(data, base, monitor)?, rate);
    let as_drawn = left_in_pieces(&drawn, &fitting::currents_alone(&drawn, base, monitor)?, rate);
    let ratios: Vec<f64> = as_held.iter().zip(&as_drawn).map(|(held, drawn)| (held / drawn).ln()).collect();
    let count = ratios.len() as f64;
    let mean = ratios.iter().sum::<f64>() / count;
    let spread = (ratios.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
    // A NaN decides nothing.
    let beyond = mean * count.sqrt() - DECISIVE * spread;
    if beyond.is_nan() || beyond <= 0.0 {
        return Ok(None);
    }
    let known = ", and a voltage drawn straight from row to row explains the currents far better than one held over each";
    Ok(Some(data.leading().signals.too_coarse(rate, known)))
}

/// Squares that a hypothesis leaves of both currents, in pieces of each recording; the `rate` of the currents is r_s/l, 1/s.
fn left_in_pieces(data: &Data, hypothesis: &Hypothesis, rate: f64) -> Vec<f64> {
    let channels = data.channels(true, false);
    let experiment = data.experiment(&hypothesis.model, &hypothesis.nuisances, channels).plain();
    let residual = experiment.residual(&hypothesis.parameters);
    let mut pieces = Vec::new();
    for (run, part) in data.runs().iter().enumerate() {
        let size = ((PIECE / (rate * part.signals.period)).ceil() as usize).max(FEWEST_ROWS);
        let mut own = vec![0.0; part.signals.len().div_ceil(size)];
        for block in experiment.blocks().into_iter().filter(|block| block.run == run) {
            let rows = &residual.as_slice()[block.rows.clone()];
            rows.iter().enumerate().for_each(|(k, x)| own[k / size] += x * x);
        }
        // A piece in which nothing is left compares nothing.
        pieces.extend(own.into_iter().map(|square| square.max(f64::MIN_POSITIVE)));
    }
    pieces
}

impl Signals {
    /// Takes the voltage of each row for that of its instant: what acts up to the next one is the mean of both.
    fn draw_voltages_through(&mut self) {
        let Some(v) = &mut self.v else { return };
        for segment in &self.segments {
            for k in segment.start..segment.end.saturating_sub(1) {
                v.iter_mut().for_each(|x| x[k] = 0.5 * (x[k] + x[k + 1]));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::diagnose::answer::{Answer, Verdict};
    use crate::diagnose::diagnose;
    use crate::diagnose::testing::{choice, setup, speeds};
    use crate::drive::{Choice, Schedule, Shape, simulate};
    use crate::machine::Machine;
    use crate::monitor::Silent;
    use crate::recording::Recording;

    /// The diagnosis of every `pace`th row of a drive at 5 kHz, which the machine file does not tell.
    fn picked(pace: usize, effects: Vec<Choice>) -> Answer {
        let mut manoeuvre = speeds(2.4, &[(0.2, 80.0), (0.8, -60.0), (1.4, 90.0), (2.0, -70.0)]);
        let steps = (0..12).map(|k| (0.2 * f64::from(k), [-4.0, 3.0][k as usize % 2])).collect();
        manoeuvre.i_d = Some(Schedule::new(steps, Shape::Steps).unwrap());
        let setup = setup(manoeuvre, effects);
        let whole = simulate(&setup, &Silent).unwrap().recording;
        let columns = whole.names().into_iter().map(|name| {
            let x = whole.column(name).unwrap();
            (name.to_string(), x.iter().step_by(pace).copied().collect())
        });
        let recording = Recording::new(columns.collect(), Some(whole.load())).unwrap();
        let machine = Machine { f_sample: None, ..setup.nameplate };
        diagnose(&[&recording], &machine, None, &Default::default(), &Silent).unwrap()
    }

    #[test]
    fn rows_picked_from_a_faster_drive_are_no_physics_and_no_all_clear() {
        for pace in [8, 16, 40] {
            let answer = picked(pace, Vec::new());
            assert_eq!(answer.verdict, Verdict::Undetermined, "{pace}: {:?}", answer.model);
            let reason = answer.reason.unwrap();
            assert!(
                reason.contains("rows lie") && answer.ranking.iter().all(|c| c.probability <= 0.5),
                "{reason}"
            );
        }
        // Every row of the drive is nothing of the kind.
        assert_eq!(picked(1, Vec::new()).verdict, Verdict::NoMismatch);
    }

    #[test]
    fn what_is_missing_behind_picked_rows_is_never_an_all_clear() {
        for effect in [choice("coulomb_friction", "tau_c", 0.5), choice("dead_time", "v_err", 8.0)] {
            let answer = picked(16, vec![effect.clone()]);
            assert_ne!(answer.verdict, Verdict::NoMismatch, "{effect:?}");
        }
    }
}
