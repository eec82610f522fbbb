//! Evidence of fitted sets of effects: likelihood of the recordings less the price of parameters and effects.
//!
//! With the variance of a channel's residual s·σ² (σ² the floor's) taken as unknown, a set with k fitted parameters costs
//!
//! > C = Σ_runs Σ_c ½·n_c·ln s_c + ½·k·ln n + m·ln(1/π) nats,
//!
//! the Laplace approximation of its marginal likelihood (Schwarz, "Estimating the dimension of a model", Ann. Statist. 6, 1978) with the
//! prior odds π of each of its m effects. Runs that were not used for fitting add their likelihood alone: what the set predicts there.
//! n_c counts independent samples, one in a hundred rows ([`DiagnosisOptions::rows_per_sample`]), and of a speed one in each window of the
//! motion at least.

use super::data::Data;
use super::hypothesis::Hypothesis;
use super::options::DiagnosisOptions;
use super::verdict::{self, Validated};
use crate::experiment::Channel;
use crate::recording::Kind;
use crate::simulate::mechanical::Nuisance;

/// Independent samples of each channel, on the fitted and on the other recordings.
#[derive(Debug, Clone)]
pub struct Evidence {
    fitted: Vec<f64>,
    held_out: Vec<Vec<f64>>,
    options: DiagnosisOptions,
}

impl Evidence {
    /// By the samples that count of each recording.
    pub fn new(data: &Data, held_out: &[&Data]) -> Self {
        let of = |data: &Data| data.runs().iter().flat_map(of_run).collect();
        let held_out = held_out.iter().map(|data| of(data)).collect();
        Self { fitted: of(data), held_out, options: data.options }
    }

    /// The same with no more samples than the residuals of these sets have: beyond noise they are correlated. The whitest residual of each
    /// channel counts.
    #[must_use]
    pub fn limited<'a>(mut self, sets: impl Iterator<Item = &'a Validated> + Clone) -> Self {
        let fewest = self.options.fewest_samples;
        let limit = |own: &mut [f64], left: &dyn Fn(&'a Validated) -> Option<&'a Hypothesis>| {
            let mut most = vec![0.0f64; own.len()];
            for hypothesis in sets.clone().filter_map(left) {
                for (most, samples) in most.iter_mut().zip(&hypothesis.samples) {
                    *most = most.max(*samples);
                }
            }
            for (own, most) in own.iter_mut().zip(most) {
                *own = own.min(most).max(fewest);
            }
        };
        limit(&mut self.fitted, &|set| Some(&set.fitted));
        for (run, own) in self.held_out.iter_mut().enumerate() {
            limit(own, &|set| set.held_out.get(run));
        }
        self
    }

    /// The constants by which sets are compared.
    pub fn options(&self) -> &DiagnosisOptions {
        &self.options
    }

    /// Independent samples of each channel of the fitted recordings.
    pub fn samples(&self) -> &[f64] {
        &self.fitted
    }

    /// Cost of a set on all recordings, nats.
    pub fn cost(&self, set: &Validated) -> f64 {
        self.cost_on_recording(&set.fitted) + self.cost_elsewhere(set)
    }

    /// Cost of a set on the fitted recordings with its parameters and effects, nats.
    pub fn cost_on_recording(&self, fitted: &Hypothesis) -> f64 {
        let mapped = fitted.model.map_parameters();
        let parameters = fitted.free.iter().filter(|k| **k < mapped.start).count() as f64;
        let effects = fitted.model.slots().len() as f64;
        self.misfit(fitted, &self.fitted)
            + price(&self.fitted, &self.options) * parameters
            + self.options.effect_cost * effects
            + self.options.coefficient_cost * mapped.len() as f64
    }

    /// Cost of what a set predicts of the recordings that it was not fitted to, nats.
    pub fn cost_elsewhere(&self, set: &Validated) -> f64 {
        set.held_out.iter().zip(&self.held_out).map(|(run, samples)| self.misfit(run, samples)).sum()
    }

    /// Whether `larger` is worth its further effects over `smaller`: by all recordings, and not by the fitted one alone where another one
    /// shows the channels in which it gains; and by more than counts as explained.
    pub fn prefers(&self, larger: &Validated, smaller: &Validated) -> bool {
        let elsewhere = self.cost_elsewhere(larger) < self.cost_elsewhere(smaller);
        self.cost(larger) + self.options.decisive < self.cost(smaller)
            && (elsewhere || !self.shown_elsewhere(larger, smaller))
            && self.explains_excess(larger, smaller)
    }

    /// The one of `sets` that costs least, of those that are preferred to `best`.
    pub fn best_of<'s>(
        &self,
        sets: impl Iterator<Item = &'s Validated>,
        best: &Validated,
    ) -> Option<&'s Validated> {
        sets.filter(|set| self.prefers(set, best)).min_by(|a, b| self.cost(a).total_cmp(&self.cost(b)))
    }

    /// Whether the further effects of `larger` lower the mean square of some channel by more than `explained`, or save a load step. A
    /// smaller gain may be the error of the simulation, which must not get a name.
    fn explains_excess(&self, larger: &Validated, smaller: &Validated) -> bool {
        fn runs(set: &Validated) -> impl Iterator<Item = &Hypothesis> {
            std::iter::once(&set.fitted).chain(&set.held_out)
        }
        let effects = |set: &Validated| set.fitted.model.slots().len();
        let steps = |set: &Validated| set.fitted.nuisances.iter().map(Nuisance::steps).sum::<usize>();
        let takes_away = |(larger, smaller): (&Hypothesis, &Hypothesis)| {
            let mut channels = larger.squares.iter().zip(&smaller.squares);
            channels.any(|((_, after), (_, before))| before - after > self.options.explained)
        };
        effects(larger) <= effects(smaller)
            || steps(larger) < steps(smaller)
            || runs(larger).zip(runs(smaller)).any(takes_away)
    }

    /// Whether `larger` explains more beyond `smaller` than it leaves, on each recording. It is asked only where more than noise is left, but
    /// no more than the forms of right effects may leave: no further effect is named for that.
    pub fn more_than_remains(&self, larger: &Validated, smaller: &Validated) -> bool {
        let excess = |set: &Hypothesis| verdict::beyond_chance(set).map(|x| x.max(0.0)).sum::<f64>();
        let most = verdict::largest_excess(&larger.fitted).max(larger.held_out_excess());
        let of_forms = most <= self.options.form_error();
        let explains = |larger: &Hypothesis, smaller: &Hypothesis| {
            let left = excess(larger);
            left <= self.options.explained || excess(smaller) - left > self.options.beside_remainder * left
        };
        let mut elsewhere = larger.held_out.iter().zip(&smaller.held_out);
        !of_forms || explains(&larger.fitted, &smaller.fitted) && elsewhere.all(|(l, s)| explains(l, s))
    }

    /// Whether the other recordings hold the channels in which `larger` gains most on the fitted one.
    fn shown_elsewhere(&self, larger: &Validated, smaller: &Validated) -> bool {
        let (mut all, mut shown) = (0.0, 0.0);
        for (at, (channel, square)) in larger.fitted.squares.iter().enumerate() {
            let least = self.least_square(*channel, larger.fitted.chance[at]);
            let nats = |square: f64| 0.5 * self.fitted[at] * log_square(square, least);
            let gain = (nats(smaller.fitted.squares[at].1) - nats(*square)).max(0.0);
            all += gain;
            if larger.held_out.iter().any(|run| run.squares.iter().any(|(c, _)| c == channel)) {
                shown += gain;
            }
        }
        shown > 0.5 * all
    }

    /// Negative logarithm of the likelihood of one recording with what the steps of its load cost, nats.
    fn misfit(&self, hypothesis: &Hypothesis, samples: &[f64]) -> f64 {
        let channels = hypothesis.squares.iter().zip(&hypothesis.chance).zip(samples);
        let nats = |(((channel, square), chance), n): ((&(Channel, f64), &f64), &f64)| {
            0.5 * n * log_square(*square, self.least_square(*channel, *chance))
        };
        let all: f64 = channels.map(nats).sum();
        let steps: usize = hypothesis.nuisances.iter().map(Nuisance::steps).sum();
        // Height and instant of each step.
        let price = samples.iter().copied().fold(self.options.fewest_samples, f64::max).ln();
        all + price * steps as f64
    }

    /// Mean square, over the floor's, below which a model gains nothing. Of currents and speed it is what driven noise adds by chance. The
    /// floor of a voltage is read from neighbouring points, of which there may be few, and the noise may be that much less.
    fn least_square(&self, channel: Channel, chance: f64) -> f64 {
        let known_to = self.options.floor_known_to;
        match channel {
            Channel::ID | Channel::IQ | Channel::OmegaE => known_to + chance,
            Channel::VD | Channel::VQ => known_to / (1.0 + chance),
        }
    }
}

/// Cost of one fitted parameter, nats: half the logarithm of all independent samples.
pub fn price(samples: &[f64], options: &DiagnosisOptions) -> f64 {
    0.5 * samples.iter().sum::<f64>().max(options.fewest_samples).ln()
}

/// Independent samples of each channel of one recording.
fn of_run(run: &Data) -> impl Iterator<Item = f64> {
    // Steady points and rows at open terminals have no memory: each counts. Means of a waveform's rows count as its rows do.
    let steady = matches!(run.signals.kind, Kind::OperatingPoints | Kind::OpenCircuit);
    let correlated = match run.signals.averaged {
        1 if steady => 1.0,
        rows => (run.options.rows_per_sample / rows as f64).max(1.0),
    };
    let samples = (run.counted() as f64 / correlated).max(run.options.fewest_samples);
    // Each window of the motion begins anew, with a speed of its own.
    let windows = run.windows.iter().filter(|w| !run.held_out.as_deref().is_some_and(|h| h[w.start])).count();
    let of = move |channel| if channel == Channel::OmegaE { samples.max(windows as f64) } else { samples };
    run.floors.iter().map(move |floor| of(floor.channel))
}

/// Logarithm of a mean square of at least `least`; infinite for one that is not finite.
fn log_square(square: f64, least: f64) -> f64 {
    if square.is_finite() { square.max(least).ln() } else { 1e6 }
}

#[cfg(test)]
impl Evidence {
    /// By these independent samples of each channel.
    pub fn counting(fitted: Vec<f64>, held_out: Vec<Vec<f64>>) -> Self {
        Self { fitted, held_out, options: DiagnosisOptions::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{hypothesis, prepared, setup, speeds, validated};
    use super::*;
    use crate::drive::simulate;
    use crate::effects::EffectId;
    use crate::model::Model;
    use crate::monitor::Silent;
    use crate::recording::Recording;

    #[test]
    fn every_window_of_the_motion_counts_for_a_speed_that_is_logged_slowly() {
        let setup = setup(speeds(4.0, &[(0.1, 60.0), (2.0, -50.0), (3.5, 70.0)]), Vec::new());
        let whole = simulate(&setup, &Silent).unwrap().recording;
        let thinned = |name: &str| whole.column(name).unwrap().iter().copied().step_by(50).collect();
        let columns = whole.names().into_iter().map(|name| (name.to_string(), thinned(name)));
        let recording = Recording::new(columns.collect(), Some(whole.load())).unwrap();
        let data = prepared(&recording, &setup);
        let evidence = Evidence::new(&data, &[]);
        let samples = evidence.samples();
        // At 100 Hz the voltage equations are left out.
        assert_eq!(data.floors.len(), 1);
        assert!(data.windows.len() > 10 && samples == [data.windows.len() as f64], "{samples:?}");
    }

    /// Two channels of the recording and of another one.
    fn evidence() -> Evidence {
        Evidence::counting(vec![50.0; 2], vec![vec![50.0; 2]])
    }

    #[test]
    fn what_the_simulation_may_be_off_by_is_worth_no_effect_however_many_samples_there_are() {
        let evidence = Evidence::counting(vec![500.0; 2], vec![vec![500.0; 2]]);
        let with_effect = |mut set: Validated| {
            set.fitted.model = Model::new(*set.fitted.model.context(), &[EffectId::VoltageDelay]);
            set
        };
        let bare = |square: f64| validated(square, 1.0, square, 4);
        let larger = with_effect(validated(1.0, 1.0, 1.0, 5));
        assert!(evidence.prefers(&larger, &bare(1.15)));
        assert!(evidence.cost(&larger) + evidence.options.decisive < evidence.cost(&bare(1.1)));
        assert!(!evidence.prefers(&larger, &bare(1.1)));
        // With one number less the same set is another matter.
        assert!(evidence.prefers(&validated(1.0, 1.0, 1.0, 4), &bare(1.1)));
        // So is one that spares a step of the load.
        let mut stepping = bare(1.1);
        stepping.fitted.nuisances = vec![Nuisance::unknown(1, 0)];
        assert!(evidence.prefers(&larger, &stepping));
    }

    #[test]
    fn what_explains_all_recordings_is_preferred_and_a_gain_on_the_fitted_one_alone_is_not_enough() {
        let (bare, lucky) = (validated(2.0, 1.0, 2.0, 4), validated(1.0, 1.0, 2.0, 5));
        let right = validated(1.0, 1.0, 1.0, 5);
        let evidence = evidence();
        assert!(evidence.prefers(&right, &bare) && !evidence.prefers(&bare, &right));
        assert!(evidence.cost(&lucky) + evidence.options.decisive < evidence.cost(&bare));
        assert!(!evidence.prefers(&lucky, &bare));
    }

    #[test]
    fn an_effect_explains_more_than_the_forms_of_the_others_leave() {
        let evidence = evidence();
        let more = |with: f64, without: f64| {
            evidence.more_than_remains(&validated(with, 1.0, with, 5), &validated(without, 1.0, without, 4))
        };
        assert!(!more(1.6, 2.0) && more(1.6, 2.4));
        // Of noise, and where something else is missing, others decide.
        assert!(more(1.05, 1.07) && more(6.0, 6.5));
    }

    #[test]
    fn a_recording_without_the_channel_cannot_speak_against_a_gain_in_it() {
        let of_motion = |d: f64| {
            let mut validated = validated(d, 1.0, 1.0, 4);
            let other = &mut validated.held_out[0];
            (other.squares, other.chance) = (other.squares.split_off(1), vec![0.0]);
            validated
        };
        let evidence = Evidence::counting(vec![50.0; 2], vec![vec![50.0]]);
        assert!(evidence.prefers(&of_motion(1.0), &of_motion(9.0)));
        assert!(!evidence.prefers(&of_motion(9.0), &of_motion(1.0)));
    }

    #[test]
    fn parameters_effects_and_steps_of_the_load_have_their_price() {
        let (evidence, bare) = (evidence(), validated(1.0, 1.0, 1.0, 4));
        let more = |set: &Validated| evidence.cost(set) - evidence.cost(&bare);
        assert!(
            (more(&validated(1.0, 1.0, 1.0, 6)) - 2.0 * price(evidence.samples(), evidence.options())).abs()
                < 1e-9
        );
        let mut named = bare.clone();
        named.fitted.model = Model::new(*bare.fitted.model.context(), &[EffectId::CoulombFriction]);
        assert!((more(&named) - evidence.options.effect_cost).abs() < 1e-9);
        // Three steps on the recording, two on the other: each a height and an instant.
        let mut stepping = bare.clone();
        stepping.fitted.nuisances = vec![Nuisance::unknown(3, 0)];
        stepping.held_out[0].nuisances = vec![Nuisance::unknown(2, 0)];
        assert!((more(&stepping) - 5.0 * 50.0f64.ln()).abs() < 1e-9);
        // Small gains do not pay for them.
        assert!(!evidence.prefers(&validated(1.0, 1.0, 1.0, 5), &validated(1.02, 1.0, 1.02, 4)));
    }

    #[test]
    fn what_driven_noise_may_do_by_chance_decides_nothing() {
        let (mut bare, mut other) = (validated(1.0, 1.3, 1.0, 4), validated(1.0, 1.0, 1.0, 5));
        let evidence = evidence();
        assert!(evidence.prefers(&other, &bare));
        for set in [&mut bare, &mut other] {
            set.fitted.chance[1] = 0.5;
            set.held_out[0].chance[1] = 0.5;
        }
        assert!(evidence.cost(&other) > evidence.cost(&bare));
        // Nor does what is below the floor.
        let least = evidence.least_square(Channel::ID, 0.0);
        assert_eq!(log_square(0.5, least), log_square(0.2, least));
    }

    #[test]
    fn what_is_not_a_number_never_wins_and_the_cost_is_one() {
        let (evidence, bare) = (evidence(), validated(5.0, 1.0, 5.0, 4));
        for broken in [validated(f64::NAN, 1.0, 1.0, 4), validated(1.0, 1.0, f64::INFINITY, 4)] {
            assert!(evidence.cost(&broken).is_finite());
            assert!(
                !evidence.prefers(&broken, &bare)
                    && evidence.cost(&bare) + evidence.options.decisive < evidence.cost(&broken)
            );
        }
        // Recordings too short for one independent sample count as a few.
        assert!(
            price(&[0.0], evidence.options()) > 0.0
                && evidence.misfit(&hypothesis(1.0, 1.0, 4), &[0.0, 0.0]) == 0.0
        );
    }
}
