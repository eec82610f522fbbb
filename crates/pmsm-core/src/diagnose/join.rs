//! Several recordings of one machine made into one set of data.
//!
//! Machine and effects are the same in all of them. Clock, noise, load, initial values and thermal states are each recording's
//! own; what a recording does not hold (voltages, the motion) is simply not compared there.

use super::data::Data;
use super::hypothesis::Hypothesis;
use super::options::DiagnosisOptions;
use crate::base::BASE;
use crate::error::{Error, Result};
use crate::experiment::floor::Floor;
use crate::experiment::split;
use crate::machine::{BaseParameter, Machine};
use crate::noise::input::InputNoise;
use crate::recording::{Kind, Load, Recording};
use crate::signals::{self, Finding, Signals};
use crate::start;

/// Prepares recordings of one machine.
///
/// # Errors
/// [`Error::Unusable`] without any recording; those of [`Data::new`], and [`Error::Column`] for one that cannot be combined with the
/// first, of several recordings within [`Error::InRecording`].
pub fn prepare(recordings: &[&Recording], machine: &Machine, options: &DiagnosisOptions) -> Result<Data> {
    prepared(recordings, machine, None, options)
}

/// The same without the voltages, which tell nothing and `why`, where motion is left without them.
///
/// # Errors
/// Those of [`prepare`].
pub fn motion_alone(
    recordings: &[&Recording],
    machine: &Machine,
    why: &Finding,
    options: &DiagnosisOptions,
) -> Result<Data> {
    prepared(recordings, machine, Some(why), options)
}

/// A recording as signals, without its voltages if there is a reason for that.
///
/// # Errors
/// Those of [`Signals::new`].
pub fn read(recording: &Recording, machine: &Machine, why: Option<&Finding>) -> Result<Signals> {
    let mut signals = Signals::new(recording, machine)?;
    if let Some(why) = why.filter(|_| signals.kind == Kind::Full) {
        signals.leave_voltages_out(why.clone());
    }
    Ok(signals)
}

fn prepared(
    recordings: &[&Recording],
    machine: &Machine,
    why: Option<&Finding>,
    options: &DiagnosisOptions,
) -> Result<Data> {
    let numbered = |(at, recording): (usize, &&Recording)| {
        read(recording, machine, why).map_err(|e| within(e, at, recordings.len()))
    };
    let whole: Vec<Signals> = recordings.iter().enumerate().map(numbered).collect::<Result<_>>()?;
    if whole.is_empty() {
        return Err(Error::unusable("no recording was given", "give at least one"));
    }
    let (mut signals, mut origins) = (Vec::new(), Vec::new());
    for (at, (own, recording)) in whole.into_iter().zip(recordings).enumerate() {
        let parts = in_parts(own, recording, machine);
        origins.extend(parts.iter().map(|_| at));
        signals.extend(parts);
    }
    if signals.len() == 1 {
        return Data::new(signals.remove(0), machine, options);
    }
    distinct(recordings)?;
    combinable(&signals, &origins)?;
    let common = agree_on_temperatures(&mut signals);
    let start = first_values(&signals, &origins, machine)?;
    let parts = signals.into_iter().map(|s| Data::started(s, machine, start, options)).collect();
    Ok(Data::joined(parts, origins, common))
}

/// A recording as what is compared of it: as it is, or its motion and its steady points. These are points of the q equation where v_q was logged
/// without v_d, and of both where the rows are too far apart for transients.
fn in_parts(mut signals: Signals, recording: &Recording, machine: &Machine) -> Vec<Signals> {
    if let Some(mut points) = signals.points_between_rows(recording, machine) {
        // What the points say of the rows is said in place of what was said without them.
        let said = signals.limits.coarse.as_ref().map(|why| why.finding.clone());
        signals.findings.retain(|f| Some(&f.finding) != said.as_ref());
        signals.findings.splice(0..0, std::mem::take(&mut points.findings));
        return vec![signals, points];
    }
    if !recording.has_q_alone() {
        return vec![signals];
    }
    let Some(mut points) = signals.q_points(recording, machine) else {
        signals.q_unused();
        return vec![signals];
    };
    signals.findings.splice(0..0, std::mem::take(&mut points.findings));
    if signals.load != Load::Locked {
        return vec![signals, points];
    }
    // A held rotor has no motion to tell of.
    points.findings = signals.findings;
    vec![points]
}

fn within(error: Error, at: usize, count: usize) -> Error {
    if count == 1 { error } else { Error::InRecording { number: at + 1, source: Box::new(error) } }
}

/// What is given twice would count twice.
fn distinct(recordings: &[&Recording]) -> Result<()> {
    for (at, recording) in recordings.iter().enumerate() {
        if let Some(first) = recordings[..at].iter().position(|other| recording.same_samples(other)) {
            let problem = Error::Column {
                column: "t".into(),
                problem: format!("and all other columns are those of recording {}", first + 1),
                fix: "give each recording once: what is given twice would count twice".into(),
            };
            return Err(within(problem, at, recordings.len()));
        }
    }
    Ok(())
}

/// Steady points have other equations than the voltages of waveforms: the fit of one says nothing of the transients of the other. The motion
/// alone goes with both.
fn combinable(signals: &[Signals], origins: &[usize]) -> Result<()> {
    let steady = |s: &Signals| s.kind == Kind::OperatingPoints;
    let with_voltages = |s: &&Signals| s.kind != Kind::Mechanical;
    let Some(first) = signals.iter().find(with_voltages).map(steady) else { return Ok(()) };
    let other = |s: &Signals| with_voltages(&s) && steady(s) != first;
    match signals.iter().position(other) {
        None => Ok(()),
        Some(at) => {
            let what = |steady: bool| if steady { "steady operating points" } else { "a waveform" };
            let problem = Error::Column {
                column: "t".into(),
                problem: format!(
                    "at a sample period of {} s these are {}, another recording holds {}: they have other equations and \
                     cannot be fitted together",
                    signals[at].period,
                    what(!first),
                    what(first)
                ),
                fix: "diagnose the operating points and the waveforms each by themselves".into(),
            };
            Err(within(problem, origins[at], signals.len()))
        }
    }
}

/// A temperature that only some recordings hold is left out: r_s or psi_m would refer to another temperature in each.
fn agree_on_temperatures(signals: &mut [Signals]) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut settle = |name: &str, of: fn(&mut Signals) -> (&mut Option<Vec<f64>>, &mut bool)| {
        let held: Vec<bool> = signals.iter_mut().map(|s| *of(s).1).collect();
        if held.iter().all(|h| *h) || !held.iter().any(|h| *h) {
            return;
        }
        for s in signals.iter_mut() {
            let (column, has) = of(s);
            (*column, *has) = (None, false);
        }
        findings.push(Finding {
            finding: format!("column {name} was logged in some of the recordings only"),
            consequence: "it is left out, and each recording is taken to begin at the same temperature"
                .into(),
            fix: "log it in every recording".into(),
        });
    };
    settle("temperature", |s| (&mut s.heating, &mut s.context.has_temperature));
    settle("temperature_magnet", |s| (&mut s.magnet_heating, &mut s.context.has_magnet_temperature));
    findings
}

/// Base parameters to start from: the mean of what the recordings say that contain them.
fn first_values(signals: &[Signals], origins: &[usize], machine: &Machine) -> Result<[f64; BASE]> {
    let alone: Vec<Result<[f64; BASE]>> = signals.iter().map(|s| start::values(s, machine)).collect();
    let tells = |each: &[Result<[f64; BASE]>], p: BaseParameter| -> Vec<f64> {
        let shown = each.iter().zip(signals).filter(|(_, s)| start::needed(s, p));
        shown.filter_map(|(x, _)| x.as_ref().ok().map(|x| x[p.index()])).collect()
    };
    // One that does not show a parameter takes it from those that do.
    let mut helped = machine.clone();
    for p in BaseParameter::ALL.into_iter().filter(|p| machine.get(*p).is_none()) {
        if let Some(value) = mean(&tells(&alone, p)) {
            helped = helped.with(p, value)?;
        }
    }
    let again = |(own, s): (Result<[f64; BASE]>, &Signals)| {
        own.or_else(|error| start::values(s, &helped).map_err(|_| error))
    };
    let each: Vec<Result<[f64; BASE]>> = alone.into_iter().zip(signals).map(again).collect();
    let mut out = [0.0; BASE];
    for p in BaseParameter::ALL {
        let shows = |s: &Signals| start::needed(s, p);
        let told = tells(&each, p);
        let untold = each.iter().find_map(|x| x.as_ref().ok()).map(|x| x[p.index()]);
        out[p.index()] = match (machine.get(p), mean(&told), untold) {
            (Some(value), ..) => value,
            (None, None, Some(value)) if !signals.iter().any(shows) => value,
            (None, None, _) => {
                let failed = each.iter().enumerate().find_map(|(at, x)| Some((at, x.as_ref().err()?)));
                let (at, error) = failed.expect("a recording that contains it was refused");
                return Err(within(error.clone(), origins[at], 1 + origins.iter().max().unwrap_or(&0)));
            }
            (None, Some(told), _) => told,
        };
    }
    Ok(out)
}

fn mean(x: &[f64]) -> Option<f64> {
    (!x.is_empty()).then(|| x.iter().sum::<f64>() / x.len() as f64)
}

impl Data {
    /// Several prepared recordings, with what is to be said of them as a whole.
    pub(super) fn joined(parts: Vec<Self>, origins: Vec<usize>, common: Vec<Finding>) -> Self {
        let each: Vec<&Signals> = parts.iter().map(|p| &p.signals).collect();
        let mut signals = Signals::end_to_end(&each);
        // What was found is said by recordings, not by their parts.
        let count = 1 + origins.iter().max().unwrap_or(&0);
        let mut found = vec![Vec::new(); count];
        each.iter().zip(&origins).for_each(|(s, origin)| found[*origin].extend(s.findings.iter().cloned()));
        signals.findings = signals::join::findings(found.iter().map(Vec::as_slice));
        signals.findings.extend(common);
        let mut windows = Vec::new();
        let mut at = 0;
        for part in &parts {
            windows.extend(part.windows.iter().map(|w| w.start + at..w.end + at));
            at += part.signals.len();
        }
        let mut out = Self {
            signals,
            windows,
            floors: Vec::new(),
            input: InputNoise::default(),
            whitening: None,
            start: parts[0].start,
            prior: parts[0].prior.clone(),
            nameplate: parts[0].nameplate,
            options: parts[0].options,
            settings: parts[0].settings,
            poor: false,
            held_out: None,
            parts,
            origins,
        };
        out.pool_floors();
        out
    }

    /// Root mean square of the recordings' floors in each channel, and their noisiest voltage.
    fn pool_floors(&mut self) {
        let mut pooled: Vec<(Floor, usize)> = Vec::new();
        for part in &self.parts {
            let n = part.signals.len();
            for floor in &part.floors {
                let (sensor, driven) = (n as f64 * floor.sensor.powi(2), n as f64 * floor.driven.powi(2));
                match pooled.iter_mut().find(|(f, _)| f.channel == floor.channel) {
                    Some((sum, count)) => {
                        (sum.sensor, sum.driven) = (sum.sensor + sensor, sum.driven + driven);
                        *count += n;
                    }
                    None => pooled.push((Floor { sensor, driven, wander: None, ..*floor }, n)),
                }
            }
        }
        pooled.sort_by_key(|(f, _)| (!f.channel.is_electrical(), f.channel));
        let root = |(f, n): (Floor, usize)| Floor {
            sensor: (f.sensor / n as f64).sqrt(),
            driven: (f.driven / n as f64).sqrt(),
            ..f
        };
        self.floors = pooled.into_iter().map(root).collect();
        self.input.voltage = self.parts.iter().map(|p| p.input.voltage).fold(0.0, f64::max);
    }

    /// Measures floors and voltage noise of each recording with the help of a fitted hypothesis.
    pub(super) fn settle_each(&mut self, hypothesis: &Hypothesis) {
        let own = hypothesis.own().len();
        let seen: Vec<Hypothesis> = split(&hypothesis.nuisances, &hypothesis.parameters[own..])
            .map(|(nuisance, left_open)| {
                let parameters = [hypothesis.own(), left_open].concat();
                Hypothesis {
                    nuisances: vec![nuisance],
                    ..Hypothesis::unfitted(hypothesis.model.clone(), parameters)
                }
            })
            .collect();
        for (part, hypothesis) in self.parts.iter_mut().zip(&seen) {
            part.settle_floors(hypothesis);
        }
        self.pool_floors();
    }

    /// Samples of recording `run` among those of all.
    pub fn samples_of(&self, run: usize) -> std::ops::Range<usize> {
        let before: usize = self.runs()[..run].iter().map(|p| p.signals.len()).sum();
        before..before + self.runs()[run].signals.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::answer::{Answer, Verdict};
    use crate::diagnose::diagnose;
    use crate::diagnose::testing::{choice, setup, speeds};
    use crate::drive::{Choice, Manoeuvre, Schedule, Setup, Shape, simulate};
    use crate::monitor::Silent;

    /// Speed along lines through points (s, mechanical rad/s) without load, i_d in steps.
    fn swing(points: &[(f64, f64)]) -> Manoeuvre {
        let mut manoeuvre = speeds(0.6, points);
        let steps = vec![(0.0, 0.0), (0.1, -4.0), (0.25, 3.0), (0.4, -2.0)];
        manoeuvre.i_d = Some(Schedule::new(steps, Shape::Steps).unwrap());
        manoeuvre
    }

    /// From one speed to another and back, without passing through standstill.
    fn sweep(from: f64, to: f64) -> Manoeuvre {
        swing(&[(0.1, from), (0.3, to), (0.5, from)])
    }

    fn coulomb() -> Vec<Choice> {
        vec![choice("coulomb_friction", "tau_c", 0.8)]
    }

    fn together(setups: &[Setup]) -> Answer {
        let runs: Vec<Recording> = setups.iter().map(|s| simulate(s, &Silent).unwrap().recording).collect();
        diagnose(&runs.iter().collect::<Vec<_>>(), &setups[0].nameplate, None, &Default::default(), &Silent)
            .unwrap()
    }

    fn strength(answer: &Answer) -> f64 {
        answer.ranking[0].parameters["tau_c"].value.unwrap()
    }

    #[test]
    fn two_directions_tell_what_neither_does_alone() {
        // In one direction friction that opposes the motion and friction that always pushes back are the same.
        let crawl = swing(&[(0.1, 4.0), (0.3, 90.0), (0.5, 4.0)]);
        let ways = [crawl, sweep(-110.0, -50.0)].map(|way| setup(way, coulomb()));
        let mirrored = |answer: &Answer| {
            answer.ranking[0]
                .equivalent_to
                .iter()
                .any(|e| e == "asymmetric_friction" || e == "coulomb_friction")
        };
        for alone in &ways {
            let answer = together(std::slice::from_ref(alone));
            assert!(answer.verdict != Verdict::Named && mirrored(&answer), "{:?}", answer.ranking);
        }
        let both = together(&ways);
        assert_eq!(both.model.effects, ["coulomb_friction"]);
        // What happens around standstill neither shows.
        assert!(both.ranking[0].equivalent_to.iter().all(|e| e == "stribeck_friction"), "{:?}", both.ranking);
        assert!((strength(&both) / 0.8 - 1.0).abs() < 0.03, "{}", strength(&both));
        assert_eq!(both.recordings.len(), 2);
        let [forward, backward] = ways;
        let swapped = together(&[backward, forward]);
        assert_eq!((swapped.verdict, &swapped.model.effects), (both.verdict, &both.model.effects));
        assert!((strength(&swapped) / strength(&both) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn each_recording_has_a_load_of_its_own() {
        let run = |load: f64| {
            let mut manoeuvre = swing(&[(0.1, 90.0), (0.3, -90.0), (0.5, 90.0)]);
            manoeuvre.tau_load = Some(Schedule::constant(load).unwrap());
            manoeuvre.load_kind = Some("unknown_constant".into());
            setup(manoeuvre, coulomb())
        };
        let answer = together(&[run(0.5), run(2.5)]);
        assert_eq!(answer.model.effects, ["coulomb_friction"]);
        for (name, value) in [("tau_load_of_1", 0.5), ("tau_load_of_2", 2.5)] {
            let found = answer.model.base[name].value.unwrap();
            assert!((found - value).abs() < 0.03, "{name}: {found}");
        }
    }

    #[test]
    fn what_only_one_recording_holds_is_fitted_to_that_one() {
        let turning = simulate(&setup(sweep(60.0, 90.0), Vec::new()), &Silent).unwrap().recording;
        let motion = ["t", "omega_e", "i_d", "i_q", "i_a", "i_b", "i_c", "theta_e"];
        let columns = |keep: &dyn Fn(&str) -> bool| -> Vec<(String, Vec<f64>)> {
            let names = turning.names().into_iter().filter(|n| keep(n));
            names.map(|n| (n.to_string(), turning.column(n).unwrap().to_vec())).collect()
        };
        let mechanical = Recording::new(columns(&|n| motion.contains(&n)), Some(turning.load())).unwrap();
        let held = Recording::new(columns(&|_| true), Some(Load::Locked)).unwrap();
        assert_eq!((mechanical.kind(), held.kind()), (Kind::Mechanical, Kind::Electrical));
        let machine = setup(sweep(60.0, 90.0), Vec::new()).nameplate;
        let answer = diagnose(&[&mechanical, &held], &machine, None, &Default::default(), &Silent).unwrap();
        assert_eq!(answer.recording_kind, Some(Kind::Full));
        let channels = |k: usize| answer.recordings[k].fit.after.keys().cloned().collect::<Vec<_>>();
        assert_eq!(
            (channels(0), channels(1)),
            (vec!["omega_e".to_string()], vec!["i_d".into(), "i_q".into()])
        );
        assert!(answer.fit.recording.after.values().all(|x| x.is_finite()));
        assert!(answer.model.base["j"].stderr.is_some() && answer.model.base["r_s"].stderr.is_some());
    }

    #[test]
    fn operating_points_and_waveforms_are_refused_by_number() {
        let waveform = simulate(&setup(sweep(60.0, 90.0), Vec::new()), &Silent).unwrap().recording;
        let level = |x: f64| (0..20).map(|k| x + f64::from(k)).collect::<Vec<f64>>();
        let columns =
            [("t", 0.0), ("omega_e", 100.0), ("i_d", 0.0), ("i_q", 1.0), ("v_d", 2.0), ("v_q", 9.0)];
        let given = columns.map(|(name, x)| (name.to_string(), level(x))).to_vec();
        let points = Recording::new(given, None).unwrap();
        let machine = setup(sweep(60.0, 90.0), Vec::new()).nameplate;
        let error = prepare(&[&waveform, &points], &machine, &Default::default()).unwrap_err();
        assert!(matches!(error, Error::InRecording { number: 2, .. }), "{error}");
        assert!(
            error.to_string().contains("operating points") && error.to_string().contains("by themselves")
        );
    }

    #[test]
    fn a_recording_that_is_given_twice_is_refused_by_number() {
        let (one, other) = (setup(sweep(60.0, 90.0), Vec::new()), setup(sweep(40.0, 90.0), Vec::new()));
        let machine = one.nameplate.clone();
        let [one, other] = [one, other].map(|s| simulate(&s, &Silent).unwrap().recording);
        let error = prepare(&[&one, &other, &one], &machine, &Default::default()).unwrap_err();
        assert!(matches!(error, Error::InRecording { number: 3, .. }), "{error}");
        assert!(error.to_string().contains("recording 1"), "{error}");
        let error = diagnose(&[&one], &machine, Some(&one), &Default::default(), &Silent).unwrap_err();
        assert!(error.to_string().contains("checks nothing"), "{error}");
    }

    #[test]
    fn findings_carry_the_number_of_their_recording() {
        let finding = |x: &str| Finding { finding: x.into(), consequence: "c".into(), fix: "f".into() };
        let (one, two) = (vec![finding("gaps"), finding("noise")], vec![finding("noise")]);
        let said = signals::join::findings([&one[..], &two[..]].into_iter());
        let words: Vec<&str> = said.iter().map(|f| f.finding.as_str()).collect();
        assert_eq!(words, ["recording 1: gaps", "noise"]);
    }
}
