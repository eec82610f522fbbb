//! What remains beside the effects of a model: the residual of each equation in times the noise, on every recording.

use super::answer::Step;
use super::data::Data;
use super::hypothesis::Hypothesis;
use super::locate::{self, Located};
use super::options::DiagnosisOptions;
use super::wording::{enumerated, times};
use crate::experiment::Channel;
use serde::Serialize;

/// Times the noise that is left of an equation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TimesNoise {
    /// On the recording.
    pub recording: f64,
    /// On the validation run; none without one that holds the equation's channel.
    pub validation: Option<f64>,
}

/// What is left of one equation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Remaining {
    /// `d`, `q` or `mechanical`.
    pub equation: String,
    /// The effects beside which it is left: those of the model, or where nothing is named those that come nearest; none of the dq-model.
    pub beside: Vec<String>,
    /// How large it is.
    pub times_noise: TimesNoise,
    /// Variables over which it is left.
    pub over: Vec<String>,
    /// Probability of so much by chance.
    pub p_value: f64,
    /// In plain words.
    pub sentence: String,
    /// The model with that effect of the catalogue whose form comes nearest to it, where one does: no name, as a smooth map does as well.
    pub nearest: Option<Step>,
}

impl Remaining {
    /// Tells which effect of the catalogue comes nearest to it, of the model in which it stands.
    pub fn set_nearest(&mut self, nearest: Option<Step>) {
        let name = nearest.as_ref().and_then(|step| step.effects.iter().find(|e| !self.beside.contains(e)));
        if let Some(name) = name {
            let more = format!(
                " Of the catalogue {name} comes nearest; a smooth torque does as well, so that is no name."
            );
            self.sentence += &more;
        }
        self.nearest = nearest;
    }
}

/// Residuals of `model` on the recording and, as `predicted`, on the validation run, largest first; empty where they are noise.
pub fn beside(data: &Data, model: &Hypothesis, predicted: Option<(&Data, &Hypothesis)>) -> Vec<Remaining> {
    let names: Vec<String> = model.effects().iter().map(|e| e.id().to_string()).collect();
    let of = |channel: Channel| {
        let here = Seen::of(model, channel)?;
        let there = predicted.and_then(|(_, found)| Seen::of(found, channel));
        let further = |seen: &Seen| seen.is_a_further_cause(&data.options);
        let worst = [Some(here), there].into_iter().flatten().filter(further).reduce(Seen::larger)?;
        let (run, found) = predicted.filter(|_| there == Some(worst)).unwrap_or((data, model));
        let equation = locate::equation_of(channel);
        let place = locate::locate(run, found).into_iter().find(|at| at.equation == equation);
        Some(told(equation, &names, channel, (here, there), worst, place.as_ref()))
    };
    let size = |r: &Remaining| r.times_noise.validation.unwrap_or(0.0).max(r.times_noise.recording);
    let mut out: Vec<Remaining> = model.channels().into_iter().filter_map(of).collect();
    out.sort_by(|a, b| size(b).total_cmp(&size(a)));
    out
}

/// The largest mean square of a channel that is left, over the floor's.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Seen {
    square: f64,
    /// Beyond one, and beyond chance.
    excess: f64,
    p_value: f64,
}

impl Seen {
    fn of(model: &Hypothesis, channel: Channel) -> Option<Self> {
        let each = model.squares.iter().zip(&model.chance).zip(&model.samples);
        let own = each.filter(|(((c, _), _), _)| *c == channel).map(|(((_, square), chance), samples)| {
            let excess = square - 1.0 - chance;
            // Of n independent normal samples the mean square has the variance 2/n.
            Self { square: *square, excess, p_value: locate::upper_tail(excess * (0.5 * samples).sqrt()) }
        });
        own.reduce(Self::larger)
    }

    fn is_a_further_cause(&self, options: &DiagnosisOptions) -> bool {
        self.excess > options.form_error() && self.p_value < options.remaining_chance
    }

    fn larger(self, other: Self) -> Self {
        if other.excess > self.excess { other } else { self }
    }
}

fn told(
    equation: &str,
    names: &[String],
    channel: Channel,
    (here, there): (Seen, Option<Seen>),
    worst: Seen,
    place: Option<&Located>,
) -> Remaining {
    let over = place.map_or(Vec::new(), variables);
    let subject = match equation {
        "mechanical" => "the equation of motion has a residual of".to_string(),
        axis => format!("the {axis}-axis voltage equation has a residual of"),
    };
    let beside = if names.is_empty() { String::new() } else { format!("beside {}, ", enumerated(names)) };
    let where_to = match there {
        Some(there) => {
            format!(" on the recording and {} times on the validation run", times(there.square.sqrt()))
        }
        None => " on the recording".into(),
    };
    let size = times(here.square.sqrt());
    let tail = if over.is_empty() { String::new() } else { format!(", over {}", enumerated(&over)) };
    let mut sentence =
        format!("{beside}{subject} {size} times the noise in {}{where_to}{tail}.", channel.name());
    sentence[..1].make_ascii_uppercase();
    Remaining {
        equation: equation.into(),
        beside: names.to_vec(),
        times_noise: TimesNoise {
            recording: here.square.sqrt(),
            validation: there.map(|seen| seen.square.sqrt()),
        },
        over,
        p_value: worst.p_value,
        sentence,
        nearest: None,
    }
}

/// Variables over which a place lies.
fn variables(place: &Located) -> Vec<String> {
    let mut out: Vec<String> = place.regions.iter().map(|region| region.variable.clone()).collect();
    out.extend(place.order_electrical.map(|_| "theta_e".to_string()));
    out.extend(place.order_mechanical.map(|_| "theta_m".to_string()));
    if place.frequency_hz.is_some() || place.trend.is_some() {
        out.push("t".into());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::testing::{choice, data, fitted, hypothesis, setup, speeds};
    use super::*;
    use crate::diagnose::answer::{Answer, Verdict};
    use crate::diagnose::diagnose;
    use crate::drive::{Choice, simulate};
    use crate::effects::EffectId;
    use crate::machine::Machine;
    use crate::monitor::Silent;
    use crate::recording::Recording;
    use std::sync::OnceLock;

    /// A recording with these effects and a torque beside them that no effect of the catalogue has: `foreign` of the mechanical speed, N·m.
    /// It is logged as the opposite load, which leaves the equation of motion without it.
    fn recorded(
        path: &[(f64, f64)],
        effects: Vec<Choice>,
        foreign: &dyn Fn(f64) -> f64,
    ) -> (Recording, Machine) {
        let setup = setup(speeds(2.4, path), effects);
        let whole = simulate(&setup, &Silent).unwrap().recording;
        let n_p = f64::from(setup.nameplate.n_p);
        let load = whole.column("omega_e").unwrap().iter().map(|w| -foreign(w / n_p)).collect();
        let columns =
            whole.names().into_iter().map(|name| (name.to_string(), whole.column(name).unwrap().to_vec()));
        let columns = columns.chain([("tau_m".to_string(), load)]).collect();
        (Recording::new(columns, None).unwrap(), setup.nameplate)
    }

    fn told(effects: Vec<Choice>, foreign: &dyn Fn(f64) -> f64) -> Answer {
        let path = [(0.2, 80.0), (0.6, 30.0), (0.8, -60.0), (1.4, 90.0), (2.0, -80.0)];
        let other = [(0.3, -70.0), (0.9, 95.0), (1.2, 20.0), (1.7, -40.0), (2.2, 60.0)];
        let (recording, machine) = recorded(&path, effects.clone(), foreign);
        let (validation, _) = recorded(&other, effects, foreign);
        diagnose(&[&recording], &machine, Some(&validation), &Default::default(), &Silent).unwrap()
    }

    /// A brake by eddy currents: strongest at 25 rad/s, weaker beyond.
    fn brake(w: f64) -> f64 {
        2.4 * (w / 25.0) / (1.0 + (w / 25.0).powi(2))
    }

    /// What is told of the brake alone.
    fn brake_alone() -> &'static Answer {
        static ANSWER: OnceLock<Answer> = OnceLock::new();
        ANSWER.get_or_init(|| told(Vec::new(), &brake))
    }

    #[test]
    fn no_name_is_sure_beside_a_torque_that_the_catalogue_does_not_hold() {
        let beside = told(vec![choice("coulomb_friction", "tau_c", 0.3)], &brake);
        for (present, answer) in [(Vec::new(), brake_alone()), (vec!["coulomb_friction"], &beside)] {
            let wrong = |name: &str| !present.contains(&name);
            let sure = answer.ranking.iter().any(|c| c.probability > 0.6 && wrong(&c.effect));
            // A name may stand beside the torque only where it is there.
            let alone = present.is_empty();
            let honest = answer.verdict == Verdict::Unknown || answer.verdict == Verdict::Partial && !alone;
            assert!(honest && !sure, "{present:?} {:?} {:?}", answer.verdict, answer.ranking);
            // Where a candidate was found, it is said what lies beside it.
            assert!(answer.ranking.iter().all(|c| c.probability < 0.4) || !answer.remaining.is_empty());
        }
        let answer = told(vec![choice("coulomb_friction", "tau_c", 0.3)], &|_| 0.0);
        assert!(answer.verdict == Verdict::Named && answer.remaining.is_empty(), "{:?}", answer.verdict);
    }

    #[test]
    fn the_share_that_a_map_is_said_to_take_away_is_that_of_the_answers_own_fit() {
        let answer = brake_alone();
        let map = answer.model.unmodelled.as_ref().unwrap();
        let stated = map.gain_held_out.expect("a map");
        let square = |rms: &std::collections::BTreeMap<String, f64>| -> f64 {
            let excess = |(name, floor): (&String, &f64)| ((rms[name] / floor).powi(2) - 1.0).max(0.0);
            answer.noise_floor.iter().map(excess).sum()
        };
        let fit = &answer.fit.validation;
        let own = 1.0 - square(&fit.after) / square(&fit.before);
        assert!((stated - own).abs() < 0.02 && stated > 0.5, "{stated} {own}");
    }

    #[test]
    fn what_is_noise_or_chance_does_not_remain_and_what_is_more_does() {
        let seen = |square: f64, samples: f64, chance: f64| {
            let mut model = hypothesis(1.0, square, 0);
            model.samples = vec![samples; model.squares.len()];
            model.chance = vec![chance; model.squares.len()];
            let seen = Seen::of(&model, Channel::OmegaE).unwrap();
            seen.is_a_further_cause(&DiagnosisOptions::default())
        };
        assert!(!seen(1.9, 1000.0, 0.0) && seen(2.5, 1000.0, 0.0));
        // Of few independent samples, or of noise that adds up, chance leaves as much.
        assert!(!seen(2.5, 6.0, 0.0) && !seen(2.5, 1000.0, 0.5));
    }

    #[test]
    fn what_an_effect_leaves_is_told_with_its_size_and_nothing_where_it_reaches_the_noise() {
        let beside = |swing: f64| {
            let manoeuvre =
                speeds(2.0, &[(0.2, 60.0), (0.6, 100.0), (1.0, -40.0), (1.4, -90.0), (1.8, 70.0)]);
            let mut effects = vec![choice("coulomb_friction", "tau_c", 0.3)];
            let mut pulsating = choice("load_torque_pulsation", "a", swing);
            pulsating.parameters.insert("order_mech".into(), 1.0);
            effects.push(pulsating);
            let (data, base) = data(&setup(manoeuvre, effects));
            beside(&data, &fitted(&data, &base, EffectId::CoulombFriction), None)
        };
        assert_eq!(beside(0.0), []);
        let left = beside(0.3);
        let options = DiagnosisOptions::default();
        let [one] = &left[..] else { panic!("{left:?}") };
        assert!(one.equation == "mechanical" && one.beside == ["coulomb_friction"], "{one:?}");
        assert!(
            one.times_noise.recording > options.remaining_times
                && one.p_value < options.remaining_chance
                && one.times_noise.validation.is_none()
        );
    }
}
