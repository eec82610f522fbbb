//! How large the residual of a perfect model would be: the sensors' own noise, measured without any model, plus what
//! noise on the driving signals does to a free-running simulation.

use crate::experiment::{Channel, Experiment};
use crate::noise::input::InputNoise;
use crate::noise::wander::Wander;
use crate::numerics::differences::white_noise;
use crate::numerics::extent::peak;
use crate::numerics::random::normal;
use crate::numerics::real::Real;
use crate::numerics::transforms::{inverse_clarke, rotate};
use crate::recording::Kind;
use crate::signals::Signals;
use crate::simulate::inductances::incremental_inductances;
use std::f64::consts::SQRT_2;

/// Share of driven noise in the square of a floor from which a speed's residual is whitened, and a current's may lie above it by chance.
const WANDERS: f64 = 0.05;
/// Largest bias of an inertia by whitening, standard errors; beyond it the residual is not whitened.
const HARMLESS: f64 = 0.3;
/// Mean square, over the floor's, beyond which it is not whitened either. A large model error is slow, and innovations hardly show it: the
/// parameters would fit the fast part alone.
const NEAR: f64 = 50.0;
/// Share of a channel's range that its noise is taken to have at least, as a log without any has none: two ways to integrate the same
/// equations differ by that.
pub const RESOLUTION: f64 = 2e-5;
/// How far the square of a speed's error may be off, share of it, where the log bounds rather than measures it: of a derived or held speed
/// by how two estimates differ, and under currents that are known only from row to row.
const BOUNDED: f64 = 0.5;
/// Samples over which the steps of a wandering speed are taken.
const LAG: usize = 8;

/// Runs over which the effect of noisy inputs is averaged, two at a time.
const DRAWS: usize = 2 * PAIRS;
const PAIRS: usize = 2;
/// Seed of the noise that is added to see what noise does.
const SEED: u64 = 0x006d_6f74_6f72;

/// Noise of one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Floor {
    /// The channel.
    pub channel: Channel,
    /// Standard deviation of the sensor's own noise.
    pub sensor: f64,
    /// Standard deviation that noise on the inputs of the simulation adds.
    pub driven: f64,
    /// How far the mean square may be off, share of it: two standard errors, where few samples tell of it.
    pub unsure: f64,
    /// How far the square of the driven part may be off, share of the mean square: two standard errors, by what the draws of that noise
    /// differ. Zero where it is no good part of the whole.
    pub swing: f64,
    /// How the driven part makes a speed wander, where it is a good part of the whole: the residual is then compared by its innovations.
    pub wander: Option<Wander>,
}

impl Floor {
    /// What remains of a perfect model: both parts together.
    pub fn total(&self) -> f64 {
        self.sensor.hypot(self.driven)
    }

    /// How far a mean square may lie above the floor's by chance, share of it. The floor itself is uncertain. Driven noise adds up in a speed,
    /// and lasts in the currents of a machine of little resistance; it counts where it is not taken out.
    pub fn chance(&self) -> f64 {
        let speed = !self.channel.is_electrical() && self.wander.is_none();
        self.unsure + if speed { self.share() } else { self.swing }
    }

    /// Whether it is that of a speed with driven noise that is not whitened.
    pub fn unfiltered(&self) -> bool {
        self.channel == Channel::OmegaE && self.wander.is_none() && self.share() > WANDERS
    }

    /// Brings the floor to at most the `variation` of its signal: a machine that noise would move further than its signal moved is not this
    /// one, and noise beyond that would explain everything.
    pub fn limit(&mut self, variation: f64) {
        self.sensor = self.sensor.min(variation.max(f64::MIN_POSITIVE));
        self.driven = self.driven.min((variation * variation - self.sensor * self.sensor).max(0.0).sqrt());
    }

    /// Share of the driven noise in the square of both parts.
    pub fn share(&self) -> f64 {
        (self.driven / self.total()).powi(2)
    }
}

/// Sensor noise of the currents in the rotor frame, A, from i_a + i_b + i_c, which is zero but for noise, offsets and
/// gain errors. `None` unless three currents were logged.
pub fn current_noise(signals: &Signals) -> Option<f64> {
    if let Some(lasting) = &signals.limits.current_noise {
        return Some(lasting.rms);
    }
    let phases = signals.phases.as_ref().filter(|_| signals.three_currents)?;
    let sum: Vec<f64> = (0..signals.len()).map(|k| phases[0][k] + phases[1][k] + phases[2][k]).collect();
    let noise = white_noise(&sum) / 3f64.sqrt() * (2.0f64 / 3.0).sqrt();
    (noise > 0.0).then_some(noise)
}

/// What an angle in steps adds to the noise of a current seen from the rotor, A: the other axis times the error of the angle.
fn turned_noise(signals: &Signals, channel: Channel) -> f64 {
    let Some(i) = signals.i.as_ref().filter(|_| signals.phase_currents) else { return 0.0 };
    let other = &i[usize::from(channel == Channel::ID)];
    let square: f64 = signals.limits.angle.iter().zip(other).map(|(error, i)| (error * i).powi(2)).sum();
    (square / signals.len() as f64).sqrt()
}

/// Noise of the speed, rad/s: that of its sensor, or the error of one that the log rounds or holds, or that was derived.
pub fn speed_noise(signals: &Signals) -> f64 {
    let error = signals.limits.speed_error();
    if let Some(lasting) = &signals.limits.speed_noise {
        return lasting.rms.max(error);
    }
    if signals.speed_known { white_noise(&signals.omega_e).max(error) } else { error }
}

/// The floors of the channels of `experiment`, whose own noise figures are ignored, and the noise of the voltages. `p` is a fitted
/// parameter vector: where noise cannot be read from the log itself it is read from what the model leaves.
pub fn floors(experiment: &Experiment, p: &[f64]) -> (Vec<Floor>, InputNoise) {
    let signals = experiment.signals;
    let prediction = experiment.predict(p);
    let rest = |at: usize| -> Vec<f64> {
        let measured = experiment.measured(experiment.channels[at].0);
        measured.iter().zip(&prediction[at]).map(|(m, x)| m - x).collect()
    };
    let mut floors: Vec<Floor> = experiment
        .channels
        .iter()
        .enumerate()
        .map(|(at, (channel, _))| {
            let (sensor, unsure) = match channel {
                Channel::ID | Channel::IQ => {
                    let seen = current_noise(signals).unwrap_or_else(|| white_noise(&rest(at)));
                    let unsure = signals.limits.current_noise.as_ref().map_or(0.0, |noise| noise.unsure);
                    (seen.max(signals.limits.current).hypot(turned_noise(signals, *channel)), unsure)
                }
                Channel::OmegaE => {
                    let unsure = signals.limits.speed_noise.as_ref().map_or(0.0, |noise| noise.unsure);
                    (speed_noise(signals), unsure)
                }
                Channel::VD | Channel::VQ if signals.kind == Kind::OpenCircuit => {
                    (white_noise(&rest(at)), 0.0)
                }
                Channel::VD | Channel::VQ if signals.limits.coarse.is_some() => (rms(&rest(at)), 0.0),
                Channel::VD | Channel::VQ => neighbour_noise(&rest(at), signals),
            };
            let scale = peak(experiment.measured(*channel));
            let sensor = sensor.max(RESOLUTION * scale).max(f64::MIN_POSITIVE);
            let bounded = *channel == Channel::OmegaE && signals.limits.bounded();
            let unsure = if bounded { BOUNDED } else { unsure };
            Floor { channel: *channel, sensor, driven: 0.0, unsure, swing: 0.0, wander: None }
        })
        .collect();
    let input = voltage_noise(experiment, p, &rest, &mut floors);
    if !matches!(signals.kind, Kind::OperatingPoints | Kind::OpenCircuit) {
        add_driven(experiment, p, &prediction, &input, &mut floors);
    }
    for floor in &mut floors {
        floor.limit(experiment.variation(floor.channel));
    }
    (floors, input)
}

/// The noise of the logged voltages; the floors of the currents are corrected where they were read from the same residuals.
fn voltage_noise(
    experiment: &Experiment,
    p: &[f64],
    rest: &impl Fn(usize) -> Vec<f64>,
    floors: &mut [Floor],
) -> InputNoise {
    let signals = experiment.signals;
    let place = |channel| floors.iter().position(|f: &Floor| f.channel == channel);
    let (Some(d), Some(q)) = (place(Channel::ID), place(Channel::IQ)) else { return InputNoise::default() };
    let (in_d, in_q) = (rest(d), rest(q));
    let mut sensor = [floors[d].sensor, floors[q].sensor];
    let known = current_noise(signals).is_some();
    let l = incremental_inductances(experiment.model, signals, &p[..experiment.model.parameter_count()]);
    let input = InputNoise::estimate(signals, l, [&in_d, &in_q], &mut sensor, known);
    for (at, sensor) in [d, q].into_iter().zip(sensor) {
        let rounded = signals.limits.current.hypot(turned_noise(signals, floors[at].channel));
        floors[at].sensor = sensor.max(rounded).max(RESOLUTION * signals.context.i_max);
    }
    input
}

/// Runs the model on inputs with as much noise again, a few times over, and takes the mean square of the difference: noise that adds
/// up differs much from one draw to the next. How far a speed wanders from one sample to the next hardly does.
fn add_driven(
    experiment: &Experiment,
    p: &[f64],
    clean: &[Vec<f64>],
    input: &InputNoise,
    floors: &mut [Floor],
) {
    let mut squares = vec![Vec::with_capacity(DRAWS); floors.len()];
    let speed = floors.iter().position(|f| f.channel == Channel::OmegaE);
    let mut steps = (0.0, 0);
    let noise = input_noise(experiment.signals, floors);
    // Only the inputs are noisy: the initial currents and speeds come from the clean log.
    let run = |draw: usize| {
        let noisy = disturbed(experiment.signals, noise, input, draw);
        Experiment { signals: &noisy, ..experiment.clone() }.predict(p)
    };
    let two = |pair: usize| rayon::join(|| run(2 * pair), || run(2 * pair + 1));
    let drawn = (0..PAIRS).map(two).flat_map(|(first, second)| [first, second]);
    for again in drawn {
        for (at, square) in squares.iter_mut().enumerate() {
            let difference = clean[at].iter().zip(&again[at]).map(|(a, b)| (a - b).powi(2));
            square.push(difference.sum::<f64>() / (clean[at].len() * DRAWS) as f64);
        }
        if let Some(at) = speed {
            let off = |k: usize| again[at][k] - clean[at][k];
            for k in experiment.windows.iter().flat_map(|w| w.clone().take(w.len().saturating_sub(LAG))) {
                steps = (steps.0 + (off(k + LAG) - off(k)).powi(2), steps.1 + LAG);
            }
        }
    }
    // Half of what rows twice as far apart change of the speed: the error of a straight line falls at least in proportion to its length.
    let between = speed.filter(|_| experiment.signals.limits.coarse.is_some()).map_or(0.0, |at| {
        let sparse = every_other_row(experiment.signals);
        let seen = Experiment { signals: &sparse, ..experiment.clone() }.predict(p);
        let difference = clean[at].iter().zip(&seen[at]).map(|(a, b)| (0.5 * (a - b)).powi(2));
        difference.sum::<f64>() / clean[at].len() as f64
    });
    for (floor, squares) in floors.iter_mut().zip(squares) {
        // In the speed the fitted initial value answers to the added sensor noise, too; that part is small.
        let between = if floor.channel == Channel::OmegaE { between } else { 0.0 };
        let square = squares.iter().sum::<f64>() + between;
        floor.driven = if square.is_finite() { square.sqrt() } else { 0.0 };
        if floor.channel.is_electrical() && floor.share() > WANDERS {
            let draws = DRAWS as f64;
            let spread = squares.iter().map(|x| (draws * x - square).powi(2)).sum::<f64>() / (draws - 1.0);
            // Of what is left, and of the mean of the draws.
            floor.swing = 2.0 * (spread * (1.0 + 1.0 / draws)).sqrt() / floor.total().powi(2);
        }
    }
    let step = (steps.0 / steps.1.max(1) as f64).sqrt();
    // The error of a speed that was derived or held lasts itself, and so does that of a torque between rows far apart: no filter tells these
    // from what white noise does to the rotor.
    let speed = speed.filter(|_| !experiment.signals.limits.bounded());
    if let Some(at) = speed.filter(|at| step.is_finite() && floors[*at].share() > WANDERS) {
        let floor = &mut floors[at];
        let wander = Wander::new(floor.sensor, step);
        let signals = experiment.signals;
        let bias = wander.bias(&signals.omega_e, experiment.windows);
        let off = signals.omega_e.iter().zip(&clean[at]).map(|(m, x)| (m - x).powi(2));
        let square = off.sum::<f64>() / signals.len() as f64 / floor.total().powi(2);
        floor.wander = Some(wander).filter(|_| bias < HARMLESS && square < NEAR);
    }
}

/// The signals with the currents of every other row drawn straight from those beside it.
fn every_other_row(signals: &Signals) -> Signals {
    let mut sparse = signals.clone();
    let (Some(phases), Some(i)) = (&mut sparse.phases, &mut sparse.i) else { return sparse };
    for segment in &signals.segments {
        for k in (segment.start + 1..segment.end.saturating_sub(1)).step_by(2) {
            i.iter_mut().for_each(|x| x[k] = 0.5 * (x[k - 1] + x[k + 1]));
            let (s, c) = Real::sin_cos(sparse.theta_e[k]);
            let abc = inverse_clarke(rotate([i[0][k], i[1][k]], c, s));
            (0..3).for_each(|x| phases[x][k] = abc[x]);
        }
    }
    sparse
}

/// Standard deviations of i_d, i_q (A) and of the speed (rad/s) as inputs. Currents that no equation simulates tell their noise themselves.
fn input_noise(signals: &Signals, floors: &[Floor]) -> ([f64; 2], f64) {
    let sensor = |channel: Channel| floors.iter().find(|f| f.channel == channel).map(|f| f.sensor);
    let own = |axis: usize| signals.i.as_ref().map_or(0.0, |i| white_noise(&i[axis]));
    let axes = [(Channel::ID, 0), (Channel::IQ, 1)];
    let currents = axes.map(|(channel, axis)| sensor(channel).unwrap_or_else(|| own(axis)));
    (currents, sensor(Channel::OmegaE).unwrap_or(0.0))
}

/// The signals with noise added to what drives the models, that of one draw after the other's.
fn disturbed(
    signals: &Signals,
    (sigma_i, sigma_w): ([f64; 2], f64),
    input: &InputNoise,
    draw: usize,
) -> Signals {
    let numbers = drawn_numbers(signals, input);
    let mut random = Gaussian { count: (draw * numbers) as u32 };
    let mut noisy = signals.clone();
    // Noise that has a colour of its own is taken as it was seen, from elsewhere in the log.
    let n = signals.len();
    let shift = (draw + 1) * n / (DRAWS + 1);
    if let Some(noise) = &signals.limits.speed_noise {
        let elsewhere = noise.series.iter().cycle().skip(shift);
        noisy.omega_e.iter_mut().zip(elsewhere).for_each(|(w, error)| *w += error);
    } else if noisy.speed_known {
        for w in &mut noisy.omega_e {
            *w += sigma_w * random.next();
        }
    } else if !signals.limits.speed.is_empty() {
        // The error of a derived speed comes where the rotor moves so.
        let elsewhere = signals.limits.speed.iter().cycle().skip(shift);
        noisy.omega_e.iter_mut().zip(elsewhere).for_each(|(w, error)| *w += error);
    }
    if let (Some(phases), Some(i), Some(clean)) = (&mut noisy.phases, &mut noisy.i, &signals.i) {
        for k in 0..phases[0].len() {
            // Between rows that stand for several control periods the current is known only as far as it is straight.
            let unseen = |x: &[f64]| {
                let apart = !input.hidden.is_empty() || signals.limits.coarse.is_some();
                let inner = apart && k > 0 && k + 1 < x.len();
                if inner { (x[k + 1] - 2.0 * x[k] + x[k - 1]) / 12.0 } else { 0.0 }
            };
            let elsewhere = |axis: usize| (k + shift + axis * n / (2 * DRAWS + 2)) % n;
            let dq = [0, 1].map(|axis| match &signals.limits.current_noise {
                Some(noise) => noise.series[elsewhere(axis)],
                None => sigma_i[axis].hypot(unseen(&clean[axis])) * random.next(),
            });
            let (s, c) = Real::sin_cos(noisy.theta_e[k]);
            let abc = inverse_clarke(rotate(dq, c, s));
            for x in 0..3 {
                phases[x][k] += abc[x];
            }
            for axis in 0..2 {
                i[axis][k] += dq[axis];
            }
        }
    }
    if let (Some(v), true) = (&mut noisy.v, signals.angle_from_voltages) {
        misturn(v, signals, draw);
    }
    if let (Some(v), false) = (&mut noisy.v, input.is_none()) {
        let mut last = [0.0; 2];
        for k in 0..v[0].len() {
            let turn = signals.period * signals.context.electrical_rate.hypot(signals.omega_e[k]);
            let (sigma, between) = (input.at(k, turn), input.between_means(k));
            let drawn = [random.next(), random.next()];
            for axis in 0..2 {
                // What one interval gets too much the next one gets too little.
                v[axis][k] += sigma * drawn[axis] + between * drawn[axis] - last[axis];
                last[axis] = between * drawn[axis];
            }
        }
    }
    for torque in [&mut noisy.tau_e, &mut noisy.tau_m].into_iter().flatten() {
        let sigma = white_noise(torque);
        torque.iter_mut().for_each(|x| *x += sigma * random.next());
    }
    debug_assert_eq!(random.count as usize, (draw + 1) * numbers, "numbers of a draw");
    noisy
}

/// Turns the voltages by the error of an angle that was taken from them. It lasts: from the half turn over which such an angle is smoothed
/// up to the turns over which the integral of a voltage drifts; each draw takes it twice as slow as the one before, from one turn on.
fn misturn(v: &mut [Vec<f64>; 2], signals: &Signals, draw: usize) {
    let turns = f64::from(1u32 << draw.min(DRAWS - 1));
    for (k, error) in signals.limits.angle.iter().enumerate() {
        let off = SQRT_2 * error * (signals.theta_e[k] / turns).sin();
        let (s, c) = Real::sin_cos(off);
        [v[0][k], v[1][k]] = rotate([v[0][k], v[1][k]], c, s);
    }
}

/// How many random numbers one draw takes.
fn drawn_numbers(signals: &Signals, input: &InputNoise) -> usize {
    let currents = signals.phases.is_some() && signals.i.is_some();
    let voltages = signals.v.is_some() && !input.is_none();
    let torques = [&signals.tau_e, &signals.tau_m].into_iter().flatten().count();
    let white = [&signals.limits.speed_noise, &signals.limits.current_noise].map(Option::is_none);
    let columns = usize::from(signals.speed_known && white[0])
        + 2 * usize::from(currents && white[1])
        + 2 * usize::from(voltages)
        + torques;
    columns * signals.len()
}

/// Root mean square: all that the dq-model leaves of points between whose rows the voltage did what no log tells counts as noise.
fn rms(rest: &[f64]) -> f64 {
    (rest.iter().map(|x| x * x).sum::<f64>() / rest.len().max(1) as f64).sqrt()
}

/// Noise of operating points, and two standard errors of its square, share of it: what rows differ in although they were taken at nearly
/// the same point. Of all pairs of nearest neighbours in speed and currents the closest fifth counts.
fn neighbour_noise(rest: &[f64], signals: &Signals) -> (f64, f64) {
    let Some([d, q]) = &signals.i else { return (0.0, 0.0) };
    let spread = |x: &[f64]| {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        (x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / x.len() as f64).sqrt().max(1e-12)
    };
    let axes: [(&[f64], f64); 3] =
        [(&signals.omega_e, spread(&signals.omega_e)), (d, spread(d)), (q, spread(q))];
    let distance = |a: usize, b: usize| axes.iter().map(|(x, s)| ((x[a] - x[b]) / s).powi(2)).sum::<f64>();
    let n = rest.len();
    let stride = n.div_ceil(600);
    let mut pairs: Vec<(f64, f64, usize)> = (0..n)
        .step_by(stride)
        .filter_map(|a| {
            let near =
                (0..n).filter(|b| *b != a).min_by(|x, y| distance(a, *x).total_cmp(&distance(a, *y)))?;
            Some((distance(a, near), (rest[a] - rest[near]).powi(2), a.min(near)))
        })
        .collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let closest = &mut pairs[..(n.div_ceil(stride) / 5).max(3).min(n.div_ceil(stride) - 1)];
    let mut first: Vec<usize> = closest.iter().map(|pair| pair.2).collect();
    first.sort_unstable();
    // Two that are each other's nearest are one pair.
    first.dedup();
    closest.sort_by(|a, b| a.1.total_cmp(&b.1));
    // The median of a squared normal difference is 2·0.455·σ², and 1.65 times as uncertain as the mean.
    let sigma = (closest[closest.len() / 2].1 / (2.0 * 0.4549)).sqrt();
    (sigma, 2.0 * 1.65 * (2.0 / first.len() as f64).sqrt())
}

/// Normal deviates in a fixed order, the same on every machine.
struct Gaussian {
    count: u32,
}

impl Gaussian {
    fn next(&mut self) -> f64 {
        self.count += 1;
        normal(SEED, [self.count, 0, 0, 0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::testing::{of_speed, reversing};
    use crate::model::Model;
    use crate::numerics::random::normal_pair;
    use crate::simulate::mechanical::Nuisance;
    use std::ops::Range;

    #[test]
    fn noise_of_currents_that_are_not_simulated_moves_the_speed_as_far_as_it_does_in_theory() {
        let (h, noise, length) = (1e-3, 0.5, 200);
        let driven = |noise: f64| {
            let mut signals = reversing(h, &(0.0..0.0));
            for (k, i_q) in signals.i.as_mut().unwrap()[1].iter_mut().enumerate() {
                *i_q += noise * normal_pair(5, [k as u32, 0, 0, 0]).0;
            }
            let model = Model::new(signals.context, &[]);
            let windows: Vec<Range<usize>> =
                (0..signals.len() / length).map(|w| w * length..(w + 1) * length).collect();
            let experiment = of_speed(&model, &signals, Nuisance::known(0), &windows);
            floors(&experiment, &[0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3]).0[0].driven
        };
        // A torque off by δ for one row leaves the speed off by n_p·h·δ/j; half a window of such steps adds up, in the mean.
        let step = 4.0 * h * (1.5 * 4.0 * 0.1 * noise) / 2e-3;
        let expected = step * (0.5 * length as f64).sqrt();
        let found = driven(noise);
        assert!((0.5..1.8).contains(&(found / expected)), "{found} {expected}");
        assert!(driven(0.0) < 0.1 * found, "{}", driven(0.0));
    }
}
