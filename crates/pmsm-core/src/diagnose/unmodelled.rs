//! What no candidate explains, modelled without a name: a map of the missing voltage or torque, or of the angle's error. It is added to the
//! equations and fitted by simulation like any effect. It stays if it predicts what it was not fitted to.
//!
//! The map and its stiffness are chosen on blocks of the recording that are left out (`choice`); then the whole model is
//! fitted with it, and it is kept only if it has more evidence than the model without it, as holds for effects. It has no place in the
//! catalogue and takes part in no ranking.

mod candidates;
mod choice;
mod discrepancy;
mod integral;
mod linear;
mod mapped;
mod rival;
mod share;
mod supported;
mod swings;
mod view;
mod words;

use super::data::Data;
use super::evidence::Evidence;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::locate::{self, Located};
use super::outputs::Outputs;
use super::select::reduced;
use crate::effect::Site;
use crate::effects::EffectId;
use crate::error::Result;
use crate::experiment::Channel;
use crate::map::{Equation, Map, Part};
use crate::model::Model;
use crate::monitor::Monitor;
use crate::recording::Load;
use mapped::{Mapped, Recordings};
use serde::Serialize;

pub use choice::MOST_WORTH;
pub use rival::rival;
pub use supported::{Alternative, Supported, probability, supported, without_motion};

/// Most parts of a map on one side, chosen one after the other.
const PARTS: usize = 3;

/// Why no torque is described beside an effect such as backlash.
const IMPACTS: &str = "No map of a torque is laid beside backlash. A small error of its parameters moves every impact in time. \
                       No torque over a variable describes that.";

/// Voltage equations or equation of motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Electrical,
    Mechanical,
}

/// A factor of a term: its functions of one variable.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "basis", rename_all = "snake_case")]
pub enum Basis {
    /// cos(order·x), sin(order·x) for each order in turn; of time, the orders are angular frequencies in rad/s.
    Harmonic {
        /// Column name.
        variable: &'static str,
        /// Unit of the variable.
        unit: &'static str,
        /// Periods per 2π of the variable.
        orders: Vec<f64>,
    },
    /// (1 + tanh(x/width))/2 and (1 − tanh(x/width))/2: either direction of rotation.
    Direction {
        /// Column name.
        variable: &'static str,
        /// Unit of the variable.
        unit: &'static str,
        /// Speed over which the direction turns over.
        width: f64,
    },
    /// Uniform B-splines of this degree, `pieces + degree` of them; outside the range its ends hold.
    BSpline {
        /// Column name.
        variable: &'static str,
        /// Unit of the variable.
        unit: &'static str,
        /// Lower end of the range.
        low: f64,
        /// Upper end of the range.
        high: f64,
        /// Degree.
        degree: usize,
        /// Pieces of the range.
        pieces: usize,
        /// Half-width w about zero within which the pieces are narrow: they are uniform in x/(w + |x|). Zero where they are in x.
        warp: f64,
    },
}

/// What a map adds to one equation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Term {
    /// `d`, `q`, `mechanical` or `sensor`.
    pub equation: Equation,
    /// In plain words.
    pub sentence: String,
    /// Where it enters.
    pub formula: &'static str,
    /// Its variables; the term is the sum over all products of their functions.
    pub variables: Vec<Basis>,
    /// One coefficient per product, the last variable's functions counting fastest.
    pub coefficients: Vec<f64>,
    /// SI unit of the coefficients and of the term.
    pub unit: &'static str,
    /// Largest absolute value over the recording.
    pub peak: f64,
}

/// A map of what no candidate explains.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unmodelled {
    /// In plain words: what is modelled without a name, or that no map helps.
    pub sentence: String,
    /// Share of the residual's squares above the floor that it removes: on the validation run, or on the recording itself without one; none
    /// without a map.
    pub gain_held_out: Option<f64>,
    /// What it adds to each equation; empty if no map improves the prediction.
    pub terms: Vec<Term>,
}

/// Fits maps on top of `best` where it leaves more than noise, and says what they are. The model that comes back is `best`
/// itself if none improves the prediction: of `validation`, or of every other stretch of the recording without one.
///
/// # Errors
/// Those of the least-squares fits.
pub fn explain(
    data: &Data,
    validation: Option<&Data>,
    best: &Hypothesis,
    monitor: &dyn Monitor,
) -> Result<(Hypothesis, Unmodelled)> {
    let mut sides = sides(data, best);
    let of_impacts = best.effects().iter().any(|e| e.is_multimodal()) && sides.contains(&Side::Mechanical);
    if of_impacts {
        sides.retain(|side| *side != Side::Mechanical);
    }
    let (fitted, mut rest) = with_maps(data, validation, best, &sides, monitor)?;
    if of_impacts {
        rest.sentence = match rest.terms.is_empty() {
            true => IMPACTS.into(),
            false => format!("{} {IMPACTS}", rest.sentence),
        };
    }
    Ok((fitted, rest))
}

/// Maps on these sides, one after the other. An error of the angle shows in the motion, too: it is looked for first.
fn with_maps(
    data: &Data,
    validation: Option<&Data>,
    best: &Hypothesis,
    sides: &[Side],
    monitor: &dyn Monitor,
) -> Result<(Hypothesis, Unmodelled)> {
    let mut mapped = Mapped::new(best);
    let recordings = Recordings { data, validation, monitor };
    let choose = |set: &Hypothesis, side| {
        monitor.report("map of what is left", 0.98);
        choice::choose(data, set, side, &places(data, set, side), monitor)
    };
    let (mut order, mut begun) = (sides.to_vec(), None);
    if sides.contains(&Side::Electrical) {
        let choices = choose(best, Side::Electrical)?;
        let of_angle = choices.iter().any(|choice| choice.part.site() == Site::Sensor);
        if of_angle || sides[0] == Side::Electrical {
            let first = mapped.with(&choices, Side::Electrical, &recordings)?;
            if first.as_ref().and_then(Mapped::last_site) == Some(Site::Sensor) {
                order.sort_by_key(|side| *side != Side::Electrical);
            }
            begun = (order[0] == Side::Electrical).then_some(first);
        }
    }
    for side in order {
        for _ in 0..PARTS {
            let more = match begun.take() {
                Some(first) => first,
                None => mapped.with(&choose(&mapped.fitted, side)?, side, &recordings)?,
            };
            let Some(more) = more else { break };
            mapped = more;
        }
    }
    let mut current = mapped.fitted.clone();
    if current.model.map().is_some() {
        current = fitting::on_from(&mapped.recording(data, &current.model), &current, monitor)?;
    }
    let taken = share::taken_away(data, validation, (best, &current), sides, monitor)?;
    // Before a loud residual that a torque takes away, a voltage that makes the currents worse would pass.
    let worse = |(side, share): (&Side, &f64)| *share <= 0.0 && side.is_mapped(&current);
    let useful: Vec<Side> =
        sides.iter().zip(&taken.sides).filter(|each| !worse(*each)).map(|(side, _)| *side).collect();
    if useful.len() < sides.len() && !useful.is_empty() {
        return with_maps(data, validation, best, &useful, monitor);
    }
    if taken.whole <= 0.0 || useful.is_empty() {
        current = best.clone();
    }
    let unmodelled = words::unmodelled(data, &current, sides, (taken.whole, validation.is_some()));
    Ok((current, unmodelled))
}

/// An effect that the map of `fitted` replaces: the same set with the same map has as much evidence without it. Only those are asked whose
/// strength may be zero beside the coefficients of the map, or is not determined beside them. The comparison with smooth terms is of first order; this one is not.
///
/// # Errors
/// Those of the least-squares fits.
pub fn replaced(data: &Data, fitted: &Hypothesis, monitor: &dyn Monitor) -> Result<Option<EffectId>> {
    if fitted.model.map().is_none() {
        return Ok(None);
    }
    let data = &data.roughly();
    let outputs = Outputs::new(data, fitted);
    let mapped =
        |e: EffectId| [Side::Electrical, Side::Mechanical].iter().any(|s| s.has(e) && s.is_mapped(fitted));
    let unknown = |e: EffectId| outputs.effect(e).values().all(|x| x.stderr.is_none());
    let asked = |e: &EffectId| mapped(*e) && (outputs.may_be_absent(*e) || unknown(*e));
    let asked: Vec<EffectId> = fitted.effects().into_iter().filter(asked).collect();
    if asked.is_empty() {
        return Ok(None);
    }
    let evidence = Evidence::new(data, &[]);
    let whole = evidence.cost_on_recording(&fitting::on_from(data, fitted, monitor)?);
    let mut least: Option<(f64, EffectId)> = None;
    for effect in asked {
        monitor.go_on()?;
        let (model, start) = reduced(fitted, effect);
        let cost = evidence.cost_on_recording(&fitting::fit(data, &model, &start, false, monitor)?);
        if cost <= least.map_or(whole, |(least, _)| least) {
            least = Some((cost, effect));
        }
    }
    Ok(least.map(|(_, effect)| effect))
}

/// The set of which parameters are told: `best` with the map's errors of the angle, without the missing torques and voltages of `settled`.
///
/// A map of those does much of what parameters do, such as friction or saturation. Beside it only their sum is determined, so a parameter
/// is that of the best fit without it; see Plumlee, "Bayesian calibration of inexact computer models", JASA 112 (2017), where the discrepancy
/// is orthogonal to what parameters do. An error of the angle is nothing that a motor does.
///
/// # Errors
/// Those of the least-squares fits.
pub fn estimated(
    data: &Data,
    best: &Hypothesis,
    settled: &Hypothesis,
    monitor: &dyn Monitor,
) -> Result<Hypothesis> {
    let Some(map) = settled.model.map() else { return Ok(best.clone()) };
    let of_angle = |part: &Part| part.site() == Site::Sensor;
    if map.parts.iter().all(of_angle) {
        return Ok(settled.clone());
    }
    if !map.parts.iter().any(of_angle) {
        return Ok(best.clone());
    }
    let first = settled.model.map_parameters().start;
    let mut start = settled.own()[..first].to_vec();
    let mut parts = Vec::new();
    for (part, place) in map.places().filter(|(part, _)| of_angle(part)) {
        start.extend(place.map(|k| settled.own()[first + k]));
        parts.push(part.clone());
    }
    let model = Model::new(*settled.model.context(), &settled.effects()).with_map(Map { parts });
    fitting::fit(data, &model, &start, false, monitor)
}

/// A set with errors of the angle, where one explains the currents better than any missing voltage does.
///
/// # Errors
/// Those of the least-squares fits.
fn with_angle_error(
    data: &Data,
    validation: Option<&Data>,
    set: &Hypothesis,
    monitor: &dyn Monitor,
) -> Result<Mapped> {
    let mut mapped = Mapped::new(set);
    let side = Side::Electrical;
    if !sides(data, set).contains(&side) {
        return Ok(mapped);
    }
    let recordings = Recordings { data, validation, monitor };
    for _ in 0..PARTS {
        let here = &mapped.fitted;
        let choices = choice::choose(data, here, side, &places(data, here, side), monitor)?;
        if choices.iter().all(|choice| choice.part.site() != Site::Sensor) {
            break;
        }
        let more = mapped.with(&choices, side, &recordings)?;
        let Some(more) = more.filter(|more| more.last_site() == Some(Site::Sensor)) else { break };
        mapped = more;
    }
    Ok(mapped)
}

/// Where a set leaves something in the equations of one side.
fn places(data: &Data, set: &Hypothesis, side: Side) -> Vec<Located> {
    locate::locate(data, set).into_iter().filter(|l| side.holds(&l.equation)).collect()
}

/// Sides on which more is left than may remain where something is explained, the larger excess first.
fn sides(data: &Data, best: &Hypothesis) -> Vec<Side> {
    let mut left: Vec<_> = best.squares.iter().filter(|(_, s)| *s > 1.0 + data.options.explained).collect();
    left.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut sides = Vec::new();
    for (channel, _) in left {
        let side = if channel.is_electrical() { Side::Electrical } else { Side::Mechanical };
        let held = side == Side::Mechanical && data.runs().iter().all(|run| run.signals.load == Load::Locked);
        if !sides.contains(&side) && !held {
            sides.push(side);
        }
    }
    sides
}

impl Side {
    /// The fitted parameters of its equations, loads and initial values included.
    fn parameters(self, data: &Data, fitted: &Hypothesis) -> Vec<usize> {
        let experiment = data.experiment(&fitted.model, &fitted.nuisances, data.channels(true, true));
        let own = |k: &usize| experiment.is_electrical(*k) == (self == Self::Electrical);
        fitted.free.iter().copied().filter(own).collect()
    }

    /// Whether a channel shows its equations.
    fn shows(self, channel: Channel) -> bool {
        channel.is_electrical() == (self == Self::Electrical)
    }

    /// Whether an effect acts in its equations that a smooth term over speed, currents and turn could replace: names that cover any function
    /// are not in question, nor is what depends on a temperature.
    fn has(self, effect: EffectId) -> bool {
        let moves = effect.info().site == Site::Mechanical;
        moves == (self == Self::Mechanical) && !effect.is_general() && !effect.is_thermal()
    }

    /// Whether a map holds something in its equations.
    fn is_mapped(self, fitted: &Hypothesis) -> bool {
        let parts = fitted.model.map().map_or(&[][..], |map| &map.parts);
        parts
            .iter()
            .flat_map(|part| &part.equations)
            .any(|e| (*e == Equation::Mechanical) == (self == Self::Mechanical))
    }

    fn holds(self, equation: &str) -> bool {
        (equation == "mechanical") == (self == Self::Mechanical)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, prepared, settled, setup, speeds};
    use crate::experiment::Channel;
    use crate::map::{Factor, Variable};
    use crate::monitor::Silent;
    use std::f64::consts::TAU;

    fn manoeuvre() -> crate::drive::Manoeuvre {
        speeds(2.0, &[(0.2, 60.0), (0.6, 100.0), (1.0, -40.0), (1.4, -90.0), (1.8, 70.0)])
    }

    #[test]
    fn a_torque_over_the_revolution_is_found_again_without_a_name() {
        let mut pulsating = choice("load_torque_pulsation", "a", 0.4);
        pulsating.parameters.insert("order_mech".into(), 1.0);
        let (data, base) = data(&setup(manoeuvre(), vec![pulsating]));
        let (fitted, unmodelled) = explain(&data, None, &base, &Silent).unwrap();
        assert!(fitted.square(Channel::OmegaE) < 1.15, "{}", fitted.square(Channel::OmegaE));
        assert_eq!(fitted.effects(), base.effects());
        let [term] = &unmodelled.terms[..] else { panic!("{unmodelled:?}") };
        assert_eq!((term.equation, term.unit), (Equation::Mechanical, "N m"));
        assert!((term.peak - 0.4).abs() < 0.04, "{}", term.peak);
        assert!(term.sentence.contains("theta_m"), "{}", term.sentence);
        assert!(unmodelled.gain_held_out.unwrap() > 0.9);
    }

    #[test]
    fn a_voltage_over_angle_and_speed_is_found_again_without_a_name() {
        let harmonics = choice("back_emf_harmonics", "a_5", 0.02);
        let (data, base) = data(&setup(manoeuvre(), vec![harmonics]));
        let (fitted, unmodelled) = explain(&data, None, &base, &Silent).unwrap();
        // The torque repeats with the angle, too.
        let volts: Vec<&Term> = unmodelled.terms.iter().filter(|t| t.unit == "V").collect();
        assert!(!volts.is_empty() && volts[0].sentence.contains("theta_e"), "{}", unmodelled.sentence);
        let left = |h: &Hypothesis| h.square(Channel::ID) + h.square(Channel::IQ) - 2.0;
        assert!(left(&fitted) < 0.1 * left(&base), "{} {}", left(&fitted), left(&base));
    }

    #[test]
    fn a_torque_over_the_turn_is_found_with_its_mean_where_no_load_is_stated() {
        // A cam that presses and never pulls: its mean is as large as what repeats.
        let mut pulsating = choice("load_torque_pulsation", "a", 0.4);
        pulsating.parameters.insert("order_mech".into(), 1.0);
        let mut manoeuvre = manoeuvre();
        manoeuvre.tau_load = Some(crate::drive::Schedule::constant(0.4).unwrap());
        let setup = setup(manoeuvre, vec![pulsating]);
        let whole = crate::drive::simulate(&setup, &Silent).unwrap().recording;
        let names = ["t", "theta_e", "omega_e", "i_a", "i_b", "i_c", "v_d", "v_q"];
        let columns = names.iter().map(|name| (name.to_string(), whole.column(name).unwrap().to_vec()));
        let recording = crate::recording::Recording::new(columns.collect(), Some(Load::None)).unwrap();
        let (data, base) = settled(prepared(&recording, &setup));
        assert_eq!(data.signals.load, Load::None);
        let (fitted, unmodelled) = explain(&data, None, &base, &Silent).unwrap();
        assert!(fitted.square(Channel::OmegaE) < 1.15, "{}", fitted.square(Channel::OmegaE));
        let [term] = &unmodelled.terms[..] else { panic!("{unmodelled:?}") };
        assert!(term.sentence.contains("theta_m (mean"), "{}", term.sentence);
        assert!((term.coefficients[0] - 0.4).abs() < 0.04, "{:?}", term.coefficients);
        assert!((term.peak - 0.8).abs() < 0.08, "{}", term.peak);
    }

    #[test]
    fn a_link_that_swings_is_found_as_a_share_of_the_command() {
        let setup = setup(manoeuvre(), Vec::new());
        let whole = crate::drive::simulate(&setup, &Silent).unwrap().recording;
        let t = whole.column("t").unwrap();
        let share = |t: f64| 0.03 * (TAU * 141.7 * t).cos() + 0.01 * (TAU * 283.4 * t).sin();
        let names = ["t", "theta_e", "omega_e", "i_a", "i_b", "i_c", "v_d", "v_q"];
        let columns = names.iter().map(|name| {
            let logged = whole.column(name).unwrap().iter().zip(t);
            let of_link =
                |(x, t): (&f64, &f64)| if name.starts_with('v') { x / (1.0 - share(*t)) } else { *x };
            (name.to_string(), logged.map(of_link).collect())
        });
        let recording = crate::recording::Recording::new(columns.collect(), None).unwrap();
        let (data, base) = settled(prepared(&recording, &setup));
        let (fitted, unmodelled) = explain(&data, None, &base, &Silent).unwrap();
        let left = |h: &Hypothesis| h.square(Channel::ID) + h.square(Channel::IQ) - 2.0;
        assert!(left(&fitted) < 0.02 * left(&base), "{} {}", left(&fitted), left(&base));
        let link = fitted.model.map().unwrap();
        assert_eq!(link.parts[0].equations, [Equation::Link], "{}", unmodelled.sentence);
        // It is told of either axis, over time and that axis' command.
        let [d, q, ..] = &unmodelled.terms[..] else { panic!("{unmodelled:?}") };
        assert_eq!((d.equation, q.equation, q.unit), (Equation::D, Equation::Q, "V"));
        assert!(
            q.sentence.contains("141.7") && q.sentence.contains("in proportion to v_q"),
            "{}",
            q.sentence
        );
        let largest = data.signals.v.as_ref().unwrap()[1].iter().fold(0f64, |m, v| m.max(v.abs()));
        assert!((q.peak / largest - 0.035).abs() < 0.01, "{} of {largest}", q.peak);
    }

    #[test]
    fn parameters_are_told_without_a_missing_torque_and_beside_an_error_of_the_angle() {
        let (data, base) = data(&setup(manoeuvre(), Vec::new()));
        let part = |equation, first| Part { equations: vec![equation], first, second: None };
        let torque =
            part(Equation::Mechanical, Factor::Harmonics { angle: Variable::ThetaM, order: 1, count: 1 });
        let angle = part(Equation::Sensor, Factor::Fourier { angle: Variable::ThetaM, count: 1 });
        let with = |parts: Vec<Part>| {
            let map = Map { parts };
            let count = map.count();
            let model = base.model.clone().with_map(map);
            let start = [base.own(), &vec![0.0; count]].concat();
            let mapped = fitting::fit(&data, &model, &start, false, &Silent).unwrap();
            (estimated(&data, &base, &mapped, &Silent).unwrap(), mapped)
        };
        let (alone, _) = with(vec![torque.clone()]);
        assert_eq!(alone.parameters, base.parameters);
        let (beside, mapped) = with(vec![angle.clone()]);
        assert_eq!(beside.parameters, mapped.parameters);
        let (beside, _) = with(vec![torque, angle.clone()]);
        assert_eq!(beside.model.map().unwrap().parts, [angle]);
    }

    #[test]
    fn an_effect_whose_torque_the_map_holds_is_replaced_and_another_is_not() {
        let mut pulsating = choice("load_torque_pulsation", "a", 0.4);
        pulsating.parameters.insert("order_mech".into(), 1.0);
        let (data, base) =
            data(&setup(manoeuvre(), vec![pulsating, choice("coulomb_friction", "tau_c", 0.3)]));
        let of = |effects: &[EffectId]| {
            let context = data.signals.context;
            let typical = effects.iter().flat_map(|e| e.info().parameters).map(|p| (p.typical)(&context));
            let start: Vec<f64> = base.own().iter().copied().chain(typical).collect();
            fitting::fit(&data, &Model::new(context, effects), &start, false, &Silent).unwrap()
        };
        let friction = of(&[EffectId::CoulombFriction]);
        let both = of(&[EffectId::CoulombFriction, EffectId::LoadTorquePulsation]);
        let over_turn = |effects: &Hypothesis| {
            let first = Factor::Harmonics { angle: Variable::ThetaM, order: 1, count: 1 };
            let map =
                Map { parts: vec![Part { equations: vec![Equation::Mechanical], first, second: None }] };
            let start = [effects.own(), &vec![0.0; map.count()]].concat();
            fitting::fit(&data, &effects.model.clone().with_map(map), &start, false, &Silent).unwrap()
        };
        let mapped = over_turn(&both);
        assert_eq!(replaced(&data, &mapped, &Silent).unwrap(), Some(EffectId::LoadTorquePulsation));
        assert_eq!(replaced(&data, &over_turn(&friction), &Silent).unwrap(), None);
        assert_eq!(replaced(&data, &both, &Silent).unwrap(), None);
    }

    #[test]
    fn beside_backlash_no_torque_is_described_and_that_is_said() {
        let (data, base) = data(&setup(manoeuvre(), vec![choice("coulomb_friction", "tau_c", 0.4)]));
        let context = data.signals.context;
        let play = EffectId::Backlash.info().parameters.iter().map(|p| (p.typical)(&context));
        let own: Vec<f64> = base.own().iter().copied().chain(play).collect();
        let model = Model::new(context, &[EffectId::Backlash]);
        let set = fitting::fit(&data, &model, &own, false, &Silent).unwrap();
        assert!(set.square(Channel::OmegaE) > 2.0, "{}", set.square(Channel::OmegaE));
        let (_, unmodelled) = explain(&data, None, &set, &Silent).unwrap();
        assert!(unmodelled.terms.iter().all(|t| t.equation != Equation::Mechanical), "{unmodelled:?}");
        assert!(unmodelled.sentence.contains("impact"), "{}", unmodelled.sentence);
    }

    #[test]
    fn where_only_noise_is_left_no_map_is_laid() {
        let (data, base) = data(&setup(manoeuvre(), Vec::new()));
        for side in [Side::Electrical, Side::Mechanical] {
            assert!(choice::choose(&data, &base, side, &[], &Silent).unwrap().is_empty(), "{side:?}");
        }
        let (fitted, unmodelled) = explain(&data, None, &base, &Silent).unwrap();
        assert!(unmodelled.terms.is_empty() && unmodelled.gain_held_out.is_none());
        assert_eq!(fitted.parameters, base.parameters);
    }
}
