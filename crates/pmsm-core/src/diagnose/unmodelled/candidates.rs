//! Maps that are tried: harmonics where a residual repeats with the angle, splines over what else the equations know, and
//! products of two.

use super::Side;
use super::swings::swings;
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::locate::Located;
use crate::effects::EffectId;
use crate::experiment::Channel;
use crate::map::{Equation, Factor, MOST, Part, Spline, Variable};
use crate::recording::{Kind, Load};
use std::f64::consts::{PI, TAU};

/// Splines over one variable: degree and pieces.
const CURVE: (usize, usize) = (3, 4);
/// And of a torque, since friction may have a hump at one speed.
const FINE: [(usize, usize); 2] = [(3, 12), (3, 28)];
/// Pieces of a smooth torque over the speed in each direction, the smoothest first, and the half-width about standstill within which they are
/// narrow, share of the largest speed: forms of friction differ there.
const SMOOTHNESS: [(usize, f64); 6] = [(3, 0.0), (3, DENSE), (9, 0.0), (9, DENSE), (28, 0.0), (28, DENSE)];
/// Speeds at which a torque may level off, shares of the largest speed: brakes and fluids do so. Two neighbours and the smoothest curve come
/// within 0.2 % of any such torque, with two coefficients. The narrowest is far from a jump: 9 % of one would remain.
const LEVELS_OFF: [f64; 5] = [1.0, 0.5, 0.25, 0.125, 0.0625];
/// Pieces of an odd torque over the speed, as of friction and brakes: it is the same in both directions but for its sign. With each, the
/// half-width about standstill within which they are narrow, share of the largest speed.
const ODD: [(usize, f64); 5] = [(6, 0.0), (12, 0.0), (12, DENSE), (36, DENSE), (56, 0.2 * DENSE)];
/// Half-width about standstill within which the pieces of a curve over the speed are narrow, share of the largest speed: forms of friction
/// differ there.
const DENSE: f64 = 0.1;
/// Splines in each direction of a map over two variables.
const SURFACE: (usize, usize) = (2, 2);
/// Splines with which a harmonic changes along a variable.
const LINE: (usize, usize) = (1, 1);
/// Harmonics of one angle: of a voltage, and of a torque, which may sit at one place of a turn.
const HARMONICS: usize = 8;
const OF_A_PLACE: usize = 16;
/// Harmonics that change along a variable.
const CHANGING: usize = 2;
/// Share of a variable's samples that its range leaves out at either end.
const TAIL: f64 = 0.002;
/// A variable whose range is narrower than this share of its larger end, or than this many times its noise, is a setting.
const NARROW: (f64, f64) = (0.02, 25.0);
/// Speed over which the direction turns over, share of the largest.
const DIRECTION: f64 = 0.002;
/// Speed in either direction from which a recording counts as one with reversals, share of the largest.
const REVERSED: f64 = 0.05;
/// Harmonics are tried up to this share of the sampling theorem's limit.
const SAMPLED: f64 = 0.5;

/// Parts to try on one side, for all equations of that side.
pub fn candidates(data: &Data, best: &Hypothesis, side: Side, located: &[Located]) -> Vec<Part> {
    let mut waves = waves(data, side, located);
    let swings = swings(data, best, side, located, (SAMPLED, HARMONICS));
    waves.extend(&swings);
    if side == Side::Mechanical {
        // What presses or rubs at one place of the turn has a mean over it.
        let with_mean: Vec<Factor> = waves.iter().filter_map(with_mean).collect();
        waves.extend(with_mean);
    }
    let variables = variables(data, best, side);
    let commands = commands(data, side);
    let dense = |v: &(Variable, f64, f64)| {
        let (degree, pieces) = FINE[1];
        let warp = DENSE * v.1.abs().max(v.2.abs());
        Factor::Spline(Spline { variable: v.0, low: v.1, high: v.2, degree, pieces, warp, odd: false })
    };
    let mut pairs: Vec<(Factor, Option<Factor>)> = waves.iter().map(|wave| (*wave, None)).collect();
    pairs.extend(commands.iter().map(|x| (spline(x, CURVE), None)));
    for (k, x) in variables.iter().enumerate() {
        pairs.push((spline(x, CURVE), None));
        if side == Side::Mechanical {
            pairs.extend(FINE.map(|size| (spline(x, size), None)));
            if x.0 == Variable::OmegaE && x.1 < 0.0 && x.2 > 0.0 {
                pairs.push((dense(x), None));
                pairs.extend(ODD.map(|(pieces, share)| (odd_curve(x, pieces, share), None)));
            }
        }
        for y in &variables[k + 1..] {
            pairs.push((spline(x, SURFACE), Some(spline(y, SURFACE))));
        }
    }
    for x in variables.iter().chain(&commands) {
        for wave in &waves {
            let fewer = match *wave {
                Factor::Harmonics { angle, order, count } => {
                    Factor::Harmonics { angle, order, count: count.min(CHANGING) }
                }
                Factor::Swing { frequency, count } => Factor::Swing { frequency, count: count.min(CHANGING) },
                // Its mean that changes along the variable is a curve over it.
                Factor::Fourier { .. } => continue,
                other => other,
            };
            pairs.push((fewer, Some(spline(x, LINE))));
        }
    }
    if side == Side::Mechanical && reverses(data) {
        let direction = Factor::Direction { width: DIRECTION * data.signals.context.omega_e_max };
        pairs.extend(waves.iter().map(|wave| (*wave, Some(direction))));
        let load = variables.iter().filter(|v| v.0 == Variable::TauE);
        pairs.extend(load.map(|x| (spline(x, CURVE), Some(direction))));
    }
    if located.iter().any(|l| l.trend.is_some()) {
        let t = (Variable::T, 0.0, data.signals.context.duration);
        pairs.push((spline(&t, CURVE), None));
    }
    let equations = side.equations(data);
    let of_side =
        pairs.into_iter().map(|(first, second)| Part { equations: equations.clone(), first, second });
    let mut parts: Vec<Part> = of_side.collect();
    if side == Side::Electrical {
        parts.extend(angle_errors(data, best, &variables));
        // A link whose voltage swings takes the same share of both axes.
        let of_link = |first| Part { equations: vec![Equation::Link], first, second: None };
        parts.extend(swings.into_iter().filter(|_| data.signals.axes == [true; 2]).map(of_link));
    }
    parts
}

/// Orders of the angle's error over the electrical turn that an effect of the catalogue holds.
const ORDERS_NAMED: usize = 2;

/// Errors of the measured angle, where one was logged beside currents: over the turn, and over the speed, where a late angle has an odd one.
/// What an effect of the set holds already is not among them: nothing would decide how much is the effect's.
fn angle_errors(data: &Data, best: &Hypothesis, variables: &[(Variable, f64, f64)]) -> Vec<Part> {
    let part = |first| Part { equations: vec![Equation::Sensor], first, second: None };
    if !data.runs().iter().all(|run| run.signals.kind == Kind::Full && run.signals.angle_known) {
        return Vec::new();
    }
    let speed = variables.iter().filter(|x| x.0 == Variable::OmegaE);
    let over_speed =
        speed.flat_map(|x| [spline(x, LINE), spline(x, CURVE), odd_curve(x, ODD[0].0, ODD[0].1)]);
    // A flaw may sit at one place of the turn, as a torque does. It has a mean, which is no wrong zero of the encoder.
    let turn = waves(data, Side::Mechanical, &[]);
    let over_turn = turn.iter().filter_map(with_mean);
    let named = best.effects().contains(&EffectId::EncoderHarmonics);
    let repeats = |factor: &Factor| match factor {
        Factor::Fourier { angle: Variable::ThetaE, count } => named && *count <= ORDERS_NAMED,
        _ => false,
    };
    over_turn.filter(|factor| !repeats(factor)).chain(over_speed).map(part).collect()
}

/// The harmonics of a turn with its mean, where it begins at the first.
fn with_mean(wave: &Factor) -> Option<Factor> {
    match *wave {
        Factor::Harmonics { angle, order: 1, count } => {
            Some(Factor::Fourier { angle, count: count.min(MOST.div_ceil(2) - 1) })
        }
        _ => None,
    }
}

/// A spline of this degree and number of uniform pieces over a variable, given with its range.
fn spline(v: &(Variable, f64, f64), (degree, pieces): (usize, usize)) -> Factor {
    Factor::Spline(Spline { variable: v.0, low: v.1, high: v.2, degree, pieces, warp: 0.0, odd: false })
}

/// Odd splines of so many pieces over a variable, given with its range, narrow within this share of its largest value.
fn odd_curve(v: &(Variable, f64, f64), pieces: usize, share: f64) -> Factor {
    let largest = v.1.abs().max(v.2.abs());
    let (variable, warp) = (v.0, share * largest);
    Factor::Spline(Spline { variable, low: -largest, high: largest, degree: 3, pieces, warp, odd: true })
}

/// Smooth voltages over speed and currents, of which one may be there, the simplest first; and voltages over the turn, of which one may: all that
/// change with speed and currents, or those that change with the command, as of an inverter whose legs differ.
pub fn lost_voltages(data: &Data, best: &Hypothesis) -> (Vec<Vec<Part>>, Vec<Vec<Part>>) {
    let equations = Side::Electrical.equations(data);
    let part = |first, second| Part { equations: equations.clone(), first, second };
    let variables = variables(data, best, Side::Electrical);
    let curves: Vec<Part> = variables.iter().map(|x| part(spline(x, CURVE), None)).collect();
    let surfaces = |size: (usize, usize)| -> Vec<Part> {
        let others = |k: usize| variables[k + 1..].iter();
        let pairs = variables.iter().enumerate().flat_map(|(k, x)| others(k).map(move |y| (x, y)));
        pairs.map(|(x, y)| part(spline(x, size), Some(spline(y, size)))).collect()
    };
    let smooth = [surfaces(LINE), curves, surfaces(SURFACE)];
    let smooth = smooth.into_iter().filter(|parts| !parts.is_empty()).collect();
    let (commands, mut over_turn, mut of_command) =
        (commands(data, Side::Electrical), Vec::new(), Vec::new());
    for wave in waves(data, Side::Electrical, &[]) {
        over_turn.push(part(wave, None));
        if let Factor::Harmonics { angle, order, count } = wave {
            let fewer = Factor::Harmonics { angle, order, count: count.min(CHANGING) };
            let with = |x: &(Variable, f64, f64)| part(fewer, Some(spline(x, LINE)));
            over_turn.extend(variables.iter().map(with));
            of_command.extend(commands.iter().map(with));
        }
    }
    (smooth, vec![over_turn, of_command])
}

/// Smooth torques over the speed, of which one may act, and torques over the turn, which may act together. Those over the speed are curves,
/// the smoothest first, and torques that level off.
///
/// Each direction of rotation has its own curve. A torque that changes sign at standstill within its shortest piece is dry friction. None is
/// over the motor's torque, which in steady motion equals any torque that it balances. Of a rotor [without
/// load](turns_one_way_without_load) the curves are odd ones: the torques that vanish at standstill.
pub fn lost_torques(data: &Data, best: &Hypothesis) -> (Vec<Vec<Part>>, Vec<Vec<Part>>) {
    let part = |first| Part { equations: vec![Equation::Mechanical], first, second: None };
    let speed = variables(data, best, Side::Mechanical).into_iter().find(|x| x.0 == Variable::OmegaE);
    let odd = turns_one_way_without_load(data);
    let ranges: Vec<(f64, f64)> = match speed {
        Some((_, low, high)) if odd => {
            let largest = low.abs().max(high.abs());
            vec![(-largest, largest)]
        }
        Some((_, low, high)) if low < 0.0 && high > 0.0 => vec![(low, 0.0), (0.0, high)],
        Some((_, low, high)) => vec![(low, high)],
        None => Vec::new(),
    };
    let curve = |(pieces, dense): (usize, f64)| -> Vec<Part> {
        let over = |(low, high): &(f64, f64)| {
            let (variable, low, high) = (Variable::OmegaE, *low, *high);
            let warp = dense * data.signals.context.omega_e_max;
            let pieces = if odd { 2 * pieces } else { pieces };
            part(Factor::Spline(Spline { variable, low, high, degree: 3, pieces, warp, odd }))
        };
        ranges.iter().map(over).collect()
    };
    let (low, high) = range(&data.signals.theta_m);
    let over_turn: Vec<Part> = if high - low > TAU || data.signals.kind == Kind::OperatingPoints {
        waves(data, Side::Mechanical, &[]).into_iter().map(part).collect()
    } else {
        // A rotor that does not turn round is held by springs, or by friction that has not broken loose yet.
        let (pieces, _) = SMOOTHNESS[2];
        let place = Factor::Spline(Spline {
            variable: Variable::ThetaM,
            low,
            high,
            degree: 3,
            pieces,
            warp: 0.0,
            odd: false,
        });
        let direction = Factor::Direction { width: DIRECTION * data.signals.context.omega_e_max };
        let second = reverses(data).then_some(direction);
        vec![Part { equations: vec![Equation::Mechanical], first: place, second }]
    };
    let levelling = |share: f64| -> Vec<Part> {
        let width = share * data.signals.context.omega_e_max;
        let steps = [width, 0.5 * width].map(|width| part(Factor::Direction { width }));
        [curve(SMOOTHNESS[0]), steps.to_vec()].concat()
    };
    let mut smooth: Vec<Vec<Part>> = SMOOTHNESS.map(curve).to_vec();
    if !ranges.is_empty() {
        smooth.extend(LEVELS_OFF.map(levelling));
    }
    (smooth, vec![over_turn])
}

/// Whether a rotor without load turns in one direction alone. What brakes it there smoothly vanishes at standstill: what does not is dry
/// friction. A load, or a second direction, would tell a constant torque by itself.
pub fn turns_one_way_without_load(data: &Data) -> bool {
    !reverses(data) && data.runs().iter().all(|run| run.signals.load == Load::None)
}

/// Harmonics of the electrical and the mechanical turn and of the located orders.
fn waves(data: &Data, side: Side, located: &[Located]) -> Vec<Factor> {
    let s = &data.signals;
    let mut waves: Vec<Factor> = Vec::new();
    if s.kind == Kind::OperatingPoints {
        return waves;
    }
    let turn = |angle: Variable| if angle == Variable::ThetaE { 1.0 } else { s.n_p };
    let mut add = |angle: Variable, order: u32| {
        // Angle by which the lowest harmonic turns between two samples at full speed.
        let step = s.context.omega_e_max / turn(angle) * f64::from(order) * s.period;
        let count = ((SAMPLED * PI / step.max(f64::MIN_POSITIVE)) as usize)
            .min(if side == Side::Mechanical { OF_A_PLACE } else { HARMONICS });
        let wave = Factor::Harmonics { angle, order, count };
        if count > 0 && !waves.contains(&wave) {
            waves.push(wave);
        }
    };
    let whole = |order: Option<f64>| order.filter(|o| *o >= 1.0 && o.fract() == 0.0).map(|o| o as u32);
    if s.angle_known {
        for place in located {
            whole(place.order_electrical).into_iter().for_each(|o| add(Variable::ThetaE, o));
            whole(place.order_mechanical).into_iter().for_each(|o| add(Variable::ThetaM, o));
        }
        add(Variable::ThetaE, 1);
        let revolved = s.theta_m.iter().fold(f64::NEG_INFINITY, |m, x| m.max(*x))
            - s.theta_m.iter().fold(f64::INFINITY, |m, x| m.min(*x));
        if side == Side::Mechanical && s.n_p > 1.0 && revolved > TAU {
            add(Variable::ThetaM, 1);
        }
    }
    waves
}

/// What the equations of one side know besides angle and time, each with its range in the recording.
fn variables(data: &Data, best: &Hypothesis, side: Side) -> Vec<(Variable, f64, f64)> {
    let s = &data.signals;
    let noise =
        |channel: Channel| data.floors.iter().find(|f| f.channel == channel).map_or(0.0, |f| f.sensor);
    let mut out = vec![(Variable::OmegaE, range(&s.omega_e), noise(Channel::OmegaE))];
    match (side, &s.i) {
        (Side::Electrical, Some([d, q])) => {
            out.push((Variable::ID, range(d), noise(Channel::ID)));
            out.push((Variable::IQ, range(q), noise(Channel::IQ)));
        }
        (Side::Mechanical, _) => {
            out.push((Variable::TauE, range(&torque(data, best)), 0.0));
        }
        _ => {}
    }
    moving(out)
}

/// The commanded voltages with their ranges. In the steady state speed and currents tell them, so that they matter only to
/// what swings. None where voltages are what is compared, as at steady points and open terminals: each would explain itself.
fn commands(data: &Data, side: Side) -> Vec<(Variable, f64, f64)> {
    let compared = data.runs().iter().flat_map(|run| &run.floors);
    let compared = compared.map(|floor| floor.channel).any(|c| matches!(c, Channel::VD | Channel::VQ));
    match (side, &data.signals.v) {
        (Side::Electrical, Some([d, q])) if !compared => {
            let noise = data.input.voltage;
            moving(vec![(Variable::VD, range(d), noise), (Variable::VQ, range(q), noise)])
        }
        _ => Vec::new(),
    }
}

/// Those variables that move, each given with its range and noise.
fn moving(all: Vec<(Variable, (f64, f64), f64)>) -> Vec<(Variable, f64, f64)> {
    all.into_iter()
        .filter(|(_, (low, high), noise)| {
            high - low > (NARROW.0 * low.abs().max(high.abs())).max(NARROW.1 * noise)
        })
        .map(|(variable, (low, high), _)| (variable, low, high))
        .collect()
}

/// Whether the rotor turns in both directions, so that what rubs shows its sign.
fn reverses(data: &Data) -> bool {
    let s = &data.signals;
    let least = REVERSED * s.context.omega_e_max;
    let beyond = |sign: f64| s.omega_e.iter().any(|w| sign * w > least);
    beyond(1.0) && beyond(-1.0)
}

/// Motor torque per sample, recorded or from the measured currents, N·m.
pub fn torque(data: &Data, best: &Hypothesis) -> Vec<f64> {
    data.torque(&best.model, best.own())
}

/// Range of a signal without its tails, where it was logged.
fn range(x: &[f64]) -> (f64, f64) {
    let mut sorted: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let tail = (TAIL * sorted.len() as f64) as usize;
    (sorted[tail], sorted[sorted.len() - 1 - tail])
}

impl Side {
    /// The equations of this side that the recording shows.
    fn equations(self, data: &Data) -> Vec<Equation> {
        match self {
            Self::Mechanical => vec![Equation::Mechanical],
            Self::Electrical => {
                let both = [Equation::D, Equation::Q].into_iter().zip(data.signals.axes);
                both.filter(|(_, shown)| *shown).map(|(equation, _)| equation).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{data, setup, speeds};
    use crate::drive::Schedule;

    /// A recording through these speeds, rad/s, under this kind of load.
    fn driven(levels: &[f64], load: &str) -> Data {
        let path: Vec<(f64, f64)> =
            levels.iter().zip(0u8..).map(|(w, k)| (0.05 + 0.3 * f64::from(k), *w)).collect();
        let mut manoeuvre = speeds(0.3 * levels.len() as f64, &path);
        if load != "none" {
            manoeuvre.tau_load = Some(Schedule::constant(1.0).unwrap());
            manoeuvre.load_kind = Some(load.into());
        }
        data(&setup(manoeuvre, Vec::new())).0
    }

    #[test]
    fn only_a_rotor_without_load_in_one_direction_needs_torques_that_vanish_at_standstill() {
        assert!(turns_one_way_without_load(&driven(&[80.0, 40.0, 90.0], "none")));
        assert!(!turns_one_way_without_load(&driven(&[80.0, -40.0, 90.0], "none")));
        assert!(!turns_one_way_without_load(&driven(&[80.0, 40.0, 90.0], "unknown_constant")));
    }

    #[test]
    fn the_curves_of_such_a_rotor_are_odd() {
        let data = driven(&[80.0, 40.0, 90.0], "none");
        let base =
            Hypothesis::unfitted(crate::model::Model::new(data.signals.context, &[]), data.start.to_vec());
        let (smooth, _) = lost_torques(&data, &base);
        assert!(!smooth.is_empty());
        for part in smooth.concat() {
            match part.first {
                Factor::Spline(s) => assert!(s.low == -s.high && s.pieces % 2 == 0, "{s:?}"),
                Factor::Direction { .. } => {}
                other => panic!("{other:?}"),
            }
            assert!(part.count() <= MOST);
        }
    }

    #[test]
    fn a_voltage_that_is_compared_explains_nothing_of_itself() {
        let mut data = driven(&[90.0, -80.0], "none");
        assert_eq!(commands(&data, Side::Electrical).len(), 2);
        for (floor, channel) in data.floors.iter_mut().zip([Channel::VD, Channel::VQ]) {
            floor.channel = channel;
        }
        assert!(commands(&data, Side::Electrical).is_empty());
    }
}
