//! Whether the voltage of a log changed between its rows. Rows picked from a faster drive hold the voltage of one instant, and not that which
//! acts up to the next row. The residual of the voltage equations is then no physics.

use super::baseline;
use super::data::Data;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::verdict::mismatched_currents;
use crate::error::Result;
use crate::machine::BaseParameter;
use crate::monitor::Monitor;
use crate::signals::{Finding, Signals};

/// Row distance, as a share of an electrical time constant, below which the voltages are asked about all the same. A held voltage and one drawn
/// straight from row to row then act nearly alike on the currents.
const NEAR: f64 = 0.1;
/// Electrical time constants, and fewest rows, of the pieces of a recording in which a voltage held over each row is compared with one drawn
/// straight from row to row. A current forgets within a few time constants, so that pieces of ten are independent of one another.
const PIECE: f64 = 10.0;
const FEWEST_ROWS: usize = 8;
/// Standard errors by which the mean log ratio of what both leave must differ from zero (Vuong, "Likelihood ratio tests for model selection
/// and non-nested hypotheses", 1989). Of logs as slow as these whose machine file tells no rate, half may be picked from faster ones; a
/// twentieth of the others is taken for such.
const DECISIVE: f64 = 1.645;

/// What the voltage did from one row to the next.
pub enum Voltages {
    /// It was held, or nothing tells of anything else.
    Held,
    /// It went straight from row to row, as means over rows do: the recordings read so, and the dq-model fitted to them.
    Drawn(Box<(Data, Hypothesis)>),
    /// No log tells, so that nothing can be asked of the voltages, and why.
    Unknown(Finding),
}

/// What the voltage did between the rows. It is unknown where these lie too far apart for the machine that was fitted. It is unknown, too, if a
/// voltage drawn straight from row to row explains the currents far better than a held one, but not down to the noise.
///
/// # Errors
/// Those of the least-squares fits.
pub fn select(data: &Data, base: &Hypothesis, monitor: &dyn Monitor) -> Result<Voltages> {
    let rate = {
        let own = |p: BaseParameter| base.own()[p.index()];
        own(BaseParameter::RS) / own(BaseParameter::LD).min(own(BaseParameter::LQ))
    };
    let sampled = |run: &Data| run.has_electrical() && run.has_mechanical() && run.signals.within.is_none();
    if !data.runs().iter().any(sampled) {
        return Ok(Voltages::Held);
    }
    if let Some(run) = data.runs().iter().find(|run| sampled(run) && run.signals.is_coarse(rate)) {
        return Ok(Voltages::Unknown(run.signals.too_coarse(rate, "")));
    }
    let mismatched = |base: &Hypothesis| mismatched_currents(base, &data.options);
    let open = |run: &Data| sampled(run) && !run.signals.holds_every_period();
    if !mismatched(base) || !data.runs().iter().any(open) {
        return Ok(Voltages::Held);
    }
    let mut drawn = data.clone();
    drawn.draw_voltages_through();
    let left = |data: &Data| -> Result<Vec<f64>> {
        let data = data.with_white_currents();
        Ok(left_in_pieces(&data, &fitting::currents_alone(&data, base, monitor)?, rate))
    };
    let (as_held, as_drawn) = (left(data)?, left(&drawn)?);
    let ratios: Vec<f64> = as_held.iter().zip(&as_drawn).map(|(held, drawn)| (held / drawn).ln()).collect();
    let count = ratios.len() as f64;
    let mean = ratios.iter().sum::<f64>() / count;
    let spread = (ratios.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
    // A NaN decides nothing.
    let beyond = mean * count.sqrt() - DECISIVE * spread;
    if beyond.is_nan() || beyond <= 0.0 {
        return Ok(Voltages::Held);
    }
    let fitted = baseline::fit(&mut drawn, monitor)?;
    if !mismatched(&fitted) {
        drawn.signals.say_drawn();
        drawn.parts.iter_mut().for_each(|part| part.signals.say_drawn());
        return Ok(Voltages::Drawn(Box::new((drawn, fitted))));
    }
    if !data.runs().iter().any(|run| open(run) && run.signals.period * rate > NEAR) {
        return Ok(Voltages::Held);
    }
    let known = ", and a voltage drawn straight from row to row explains the currents far better than one held over each";
    Ok(Voltages::Unknown(data.leading().signals.too_coarse(rate, known)))
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

impl Data {
    fn draw_voltages_through(&mut self) {
        self.signals.draw_voltages_through();
        self.parts.iter_mut().for_each(|part| part.signals.draw_voltages_through());
    }
}

impl Signals {
    /// Reads the log as another one of the same bench was read: its voltages drawn from row to row, a low pass taken out of its currents.
    pub(super) fn read_as(&mut self, drawn: bool, filter: Option<f64>) {
        if drawn {
            self.draw_voltages_through();
        }
        if let Some(tau) = filter {
            self.take_filter_out(tau);
        }
    }

    fn say_drawn(&mut self) {
        self.limited_by(Finding {
            finding: "the voltages act as if they went straight from row to row, as means over rows do"
                .into(),
            consequence: "they are drawn so".into(),
            fix: "log every period of the drive, with f_sample under [drive], to see what is quicker".into(),
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::diagnose::answer::{Answer, Verdict};
    use crate::diagnose::diagnose;
    use crate::diagnose::testing::{choice, setup, speeds, telemetry};
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

    /// The diagnosis of means over so many periods of the drive each, with another run to check it.
    fn of_means(count: usize, effects: &[Choice]) -> Answer {
        let run = |levels: [f64; 3]| {
            let (columns, setup) = telemetry(levels, effects.to_vec());
            let of = |name: &str, rows: &[f64]| {
                // An angle goes on beyond a whole turn.
                let ahead =
                    |x: &f64| if name == "theta_e" { (x - rows[0]).sin().asin() } else { x - rows[0] };
                let mean = rows.iter().map(ahead).sum::<f64>() / rows.len() as f64;
                if name == "t" { rows[0] } else { rows[0] + mean }
            };
            let means = columns.into_iter().map(|(name, x)| {
                let x = x.chunks_exact(count).map(|rows| of(&name, rows)).collect();
                (name, x)
            });
            (Recording::new(means.collect(), None).unwrap(), setup.nameplate)
        };
        let ((recording, machine), (validation, _)) = (run([90.0, -70.0, 40.0]), run([-60.0, 80.0, -30.0]));
        diagnose(&[&recording], &machine, Some(&validation), &Default::default(), &Silent).unwrap()
    }

    #[test]
    fn means_over_rows_accuse_nobody_and_show_friction() {
        for count in [2, 4, 8] {
            let healthy = of_means(count, &[]);
            let innocent = [Verdict::NoMismatch, Verdict::Undetermined];
            assert!(innocent.contains(&healthy.verdict), "{count}: {:?}", healthy.remaining);
            let rubbing = of_means(count, &[choice("coulomb_friction", "tau_c", 0.5)]);
            assert_eq!(rubbing.model.effects, ["coulomb_friction"], "{count}: {:?}", rubbing.verdict);
        }
    }
}
