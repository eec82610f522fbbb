//! What the currents show of a voltage that is lost on the way to the winding, by variation of constants.
//!
//! Over one sample a change δx of the electrical state becomes A·δx + G·δv, with the mean δv of what is lost meanwhile. One run, seeded
//! anew at each sample, tells A and G and how the currents show the state; the columns of all maps follow from them, in place of a run
//! per eight. A map's functions are looked at along that run, at Gauss's two points of each sample.

mod sensors;

pub use sensors::{LAGS, LATE, LATE_SQUARED, TURNED};

use super::{Channel, Experiment};
use crate::effect::Env;
use crate::map::{Equation, Factor, MOST, Map, Part, Point};
use crate::numerics::dual::Dual;
use crate::numerics::lanes::{self, Job, Lane, Path};
use crate::numerics::real::Real;
use crate::simulate::environment::between;
use crate::simulate::watched::{self, Watch};
use nalgebra::DMatrix;
use std::array::from_fn;

/// Electrical states that are followed, and the lost voltages d, q in the slots behind them.
const STATES: usize = 4;
const LOST: [usize; 2] = [STATES, STATES + 1];
const FOLLOWED: usize = STATES + 2;
/// Derivatives that the run carries: as many as any other.
const SLOTS: usize = super::LANES;
/// Columns side by side in the lanes of a vector.
const WIDE: usize = 8;

type Seeded = Dual<SLOTS>;

/// One sample of a run.
#[derive(Debug, Clone)]
struct Step {
    /// Its number.
    sample: usize,
    /// The states, differentiated by those at the sample before and by the voltage lost since then.
    states: [[f64; FOLLOWED]; STATES],
    /// The current d, q of the log, differentiated by the states.
    shown: [[f64; STATES]; 2],
    /// Where the machine is.
    env: Env<f64>,
    /// Its current d, q, A.
    i: [f64; 2],
    /// Voltage d, q that is held to the next sample, V, if there is one before a gap.
    held: Option<[f64; 2]>,
}

/// How the currents of one recording answer to a lost voltage.
#[derive(Debug, Clone)]
pub struct Answering {
    steps: Vec<Step>,
}

impl Experiment<'_> {
    /// How the currents answer at `p` to a voltage that is lost, if they are compared; `None` where voltages are, or the model has more
    /// electrical states than can be followed.
    pub fn answering(&self, p: &[f64]) -> Option<Answering> {
        if !self.has_electrical() {
            return Some(Answering { steps: Vec::new() });
        }
        let currents = [Channel::ID, Channel::IQ].iter().all(|c| self.row_of(*c).is_some());
        let voltages = [Channel::VD, Channel::VQ].iter().any(|c| self.row_of(*c).is_some());
        let small = 2 + self.model.electrical_states() <= STATES;
        (currents && !voltages && small).then(|| self.followed(p))
    }

    fn followed(&self, p: &[f64]) -> Answering {
        // What is lost all the time is what a swing of no frequency takes, in its cosine.
        let always = Factor::Swing { frequency: 0.0, count: 1 };
        let part = Part { equations: vec![Equation::D, Equation::Q], first: always, second: None };
        let mut map: Map = self.model.map().cloned().unwrap_or_default();
        map.parts.push(part);
        let mut seeded: Vec<Seeded> =
            p[..self.model.parameter_count()].iter().map(|x| Dual::constant(*x)).collect();
        for slot in LOST {
            seeded.extend([Dual::variable(0.0, slot), Dual::constant(0.0)]);
        }
        let mut follower = Follower::default();
        watched::run(&self.model.clone().with_map(map), self.signals, &seeded, &mut follower);
        Answering { steps: follower.steps }
    }

    /// Derivatives of the weighted residuals with respect to the coefficients of `part`, all of them zero, beside the model whose currents
    /// answer like this. Shape: as many rows as [`Self::residual`] has, one column per coefficient.
    pub fn lost_columns(&self, p: &[f64], answering: &Answering, part: &Part) -> DMatrix<f64> {
        let mut linear = super::Linearisation::zeros(self.channels.len() * self.samples(), part.count());
        let (mut electrical, _) = linear.split_rows(self.electrical_rows());
        if let (Some(d), Some(q)) = (self.row_of(Channel::ID), self.row_of(Channel::IQ)) {
            let values = answering.values(part);
            let size = part.size();
            for (equation, columns) in part.equations.iter().zip(electrical.columns.chunks_mut(size)) {
                let mut respond = |of_axes| answering.respond(of_axes, size, [d, q], columns);
                match equation {
                    Equation::Link => {
                        let each = [0, 1].map(|axis| answering.of_command(&values, size, axis));
                        respond(each.each_ref().map(|values| Some(&values[..])));
                    }
                    Equation::Q => respond([None, Some(&values)]),
                    _ => respond([Some(&values), None]),
                }
            }
            let every: Vec<usize> = (0..part.count()).collect();
            // No voltage that is lost changes an inductance.
            let rates = || vec![[0.0; 2]; part.count()];
            self.whiten_residual(p, rates, &every, &mut electrical);
        }
        self.mask(&mut linear);
        linear.jacobian
    }
}

impl Answering {
    /// These products of each step, `size` of them, times the voltage of one axis that is held over it.
    fn of_command(&self, values: &[f64], size: usize, axis: usize) -> Vec<f64> {
        let held = self.steps.iter().map(|step| step.held.map_or(0.0, |v| v[axis]));
        values.chunks_exact(size).zip(held).flat_map(|(own, v)| own.iter().map(move |x| x * v)).collect()
    }

    /// Adds to `columns` what the currents show of voltages that are lost on each axis: `size` products for each step. With the first row and
    /// the weight of i_d and of i_q.
    fn respond(
        &self,
        of_axes: [Option<&[f64]>; 2],
        size: usize,
        rows: [(usize, f64); 2],
        columns: &mut [&mut [f64]],
    ) {
        let height = columns.first().map_or(0, |column| column.len());
        let mut part = DMatrix::zeros(height, WIDE);
        for first in (0..size).step_by(WIDE) {
            let own = first..size.min(first + WIDE);
            for (axis, values) in of_axes.into_iter().enumerate() {
                let Some(values) = values else { continue };
                let mut of_axis: Vec<&mut [f64]> =
                    part.as_mut_slice().chunks_exact_mut(height).take(own.len()).collect();
                let (values, columns_here) = ((values, first, size), &mut of_axis[..]);
                let job = Response { steps: &self.steps, axis, values, rows, columns: columns_here };
                lanes::reproducible(Path::best(), job);
                for (sum, own) in columns[own.clone()].iter_mut().zip(&of_axis) {
                    sum.iter_mut().zip(own.iter()).for_each(|(sum, x)| *sum += x);
                }
            }
        }
    }

    /// Means of a part's products over each step, step by step.
    fn values(&self, part: &Part) -> Vec<f64> {
        let size = part.size();
        let mut out = vec![0.0; self.steps.len() * size];
        let mut values = [[0.0; MOST]; 2];
        values[1][0] = 1.0;
        for (pair, out) in self.steps.windows(2).zip(out.chunks_exact_mut(size)) {
            let (here, next) = (&pair[0], &pair[1]);
            let Some(v) = here.held else { continue };
            for node in [0.5 - 0.5 / 3f64.sqrt(), 0.5 + 0.5 / 3f64.sqrt()] {
                let i = [0, 1].map(|x: usize| here.i[x] + node * (next.i[x] - here.i[x]));
                let point = Point { env: between(&here.env, &next.env, node), i, v, tau_e: 0.0 };
                let [first, second] = &mut values;
                let n = part.first.fill(&point, first);
                let m = part.second.as_ref().map_or(1, |factor| factor.fill(&point, second));
                for (row, f) in out.chunks_exact_mut(m).zip(&first[..n]) {
                    for (x, g) in row.iter_mut().zip(&second[..m]) {
                        *x += 0.5 * f * g;
                    }
                }
            }
        }
        out
    }
}

/// Keeps each sample of a run, and seeds its states anew.
#[derive(Default)]
struct Follower {
    steps: Vec<Step>,
    /// How the states came to be where they are.
    arrived: [[f64; SLOTS]; STATES],
    /// Where the machine is, and its current.
    here: Option<(Env<f64>, [f64; 2])>,
}

impl Watch<Seeded> for Follower {
    fn arrive(&mut self, state: &mut [Seeded]) {
        for (slot, (x, arrived)) in state.iter_mut().zip(&mut self.arrived).enumerate() {
            *arrived = x.eps;
            *x = Dual::variable(x.re, slot);
        }
    }

    fn stand(&mut self, env: &Env<Seeded>, i: [Seeded; 2]) {
        let env = Env {
            t: env.t.re,
            omega_e: env.omega_e.re,
            theta_e: env.theta_e.re,
            theta_m: env.theta_m.re,
            heating: env.heating,
            magnet_heating: env.magnet_heating,
        };
        self.here = Some((env, i.map(|x| x.re)));
    }

    fn show(&mut self, sample: usize, shown: [Seeded; 2]) {
        let states = self.arrived.map(|by| from_fn(|slot| by[slot]));
        let shown = shown.map(|x| from_fn(|slot| x.eps[slot]));
        let (env, i) = self.here.expect("one stands where one is shown");
        self.steps.push(Step { sample, states, shown, env, i, held: None });
    }

    fn leave(&mut self, v: [Seeded; 2]) {
        let step = self.steps.last_mut().expect("a step has begun before it ends");
        step.held = Some(v.map(|x| x.re));
    }
}

/// What up to [`WIDE`] products, lost on one axis, do to the currents.
struct Response<'a, 'c> {
    steps: &'a [Step],
    axis: usize,
    /// All products of each step, the first of these, and their number.
    values: (&'a [f64], usize, usize),
    /// First row and weight of i_d and i_q.
    rows: [(usize, f64); 2],
    columns: &'a mut [&'c mut [f64]],
}

impl Job for Response<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(self) {
        let Self { steps, axis, values: (values, first, size), rows, columns } = self;
        let mut state = [[0.0; WIDE]; STATES];
        let mut lost = [0.0; WIDE];
        for (step, products) in steps.iter().zip(values.chunks_exact(size)) {
            let before = state;
            for (x, by) in state.iter_mut().zip(&step.states) {
                for lane in 0..WIDE {
                    let mut sum = by[LOST[axis]] * lost[lane];
                    for n in 0..STATES {
                        sum += by[n] * before[n][lane];
                    }
                    x[lane] = sum;
                }
            }
            for ((row, weight), by) in rows.iter().zip(&step.shown) {
                let mut shown = [0.0; WIDE];
                for lane in 0..WIDE {
                    let mut sum = 0.0;
                    for n in 0..STATES {
                        sum += by[n] * state[n][lane];
                    }
                    shown[lane] = sum * weight;
                }
                for (column, x) in columns.iter_mut().zip(shown) {
                    column[row + step.sample] = x;
                }
            }
            for (lane, x) in lost.iter_mut().zip(&products[first..]) {
                *lane = *x;
            }
        }
    }
}

#[cfg(test)]
mod testing {
    use crate::experiment::testing::of_speed;
    use crate::experiment::{Channel, Experiment};
    use crate::model::Model;
    use crate::signals::Signals;
    use crate::simulate::mechanical::Nuisance;
    use std::ops::Range;

    /// The currents of a recording beside a model.
    pub fn of_currents<'a>(
        model: &'a Model,
        signals: &'a Signals,
        windows: &'a [Range<usize>],
    ) -> Experiment<'a> {
        let channels = vec![(Channel::ID, 0.05), (Channel::IQ, 0.02)];
        Experiment { channels, ..of_speed(model, signals, Nuisance::known(0), windows) }
    }
}

#[cfg(test)]
mod tests {
    use super::testing::of_currents;
    use super::*;
    use crate::effects::EffectId;
    use crate::experiment::testing::reversing;
    use crate::map::{Spline, Variable};
    use crate::model::Model;
    use crate::simulate::mechanical;

    fn parts() -> [Part; 3] {
        let line = |variable, low, high| {
            Factor::Spline(Spline { variable, low, high, degree: 1, pieces: 1, warp: 0.0, odd: false })
        };
        let wave = |order, count| Factor::Harmonics { angle: Variable::ThetaE, order, count };
        let part =
            |equations: &[Equation], first, second| Part { equations: equations.to_vec(), first, second };
        let both = [Equation::D, Equation::Q];
        let curve = Spline {
            variable: Variable::IQ,
            low: -4.0,
            high: 4.0,
            degree: 3,
            pieces: 4,
            warp: 0.0,
            odd: false,
        };
        [
            part(&both, wave(1, 5), None),
            part(&[Equation::Q], Factor::Spline(curve), None),
            part(&both, wave(6, 1), Some(line(Variable::VQ, -40.0, 40.0))),
        ]
    }

    #[test]
    fn columns_are_close_to_those_of_a_run_that_carries_derivatives_along() {
        // With no states beside the fluxes, with one, with two, and with sensors; a map that has strength beside them.
        let sets: [&[EffectId]; 4] = [
            &[EffectId::DeadTime, EffectId::SaturationQ],
            &[EffectId::DcLinkSag, EffectId::EncoderAngleOffset],
            &[EffectId::IronLoss],
            &[EffectId::CurrentGainImbalance, EffectId::VoltageDelay],
        ];
        let signals = reversing(1e-4, &(0.31..0.32));
        let windows = mechanical::windows(&signals);
        for effects in sets {
            let [found, ..] = parts();
            let model = Model::new(signals.context, effects).with_map(Map { parts: vec![found.clone()] });
            let mut p = vec![0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3];
            for effect in effects {
                p.extend(effect.info().parameters.iter().map(|x| (x.typical)(&signals.context)));
            }
            p.resize(model.parameter_count(), 0.2);
            let answering = of_currents(&model, &signals, &windows).answering(&p).unwrap();
            for part in parts() {
                let columns = of_currents(&model, &signals, &windows).lost_columns(&p, &answering, &part);
                let map = Map { parts: vec![found.clone(), part.clone()] };
                let richer = model.clone().with_map(map);
                let mut all = p.clone();
                all.resize(p.len() + part.count(), 0.0);
                let free: Vec<usize> = (p.len()..all.len()).collect();
                let run = of_currents(&richer, &signals, &windows).linearise(&all, &free).jacobian;
                for (column, exact) in columns.column_iter().zip(run.column_iter()) {
                    let off = (column - exact).norm() / exact.norm();
                    assert!(off < 0.01, "{effects:?} {off} of {}", exact.norm());
                }
            }
        }
    }

    #[test]
    fn more_states_than_can_be_followed_are_left_to_a_run() {
        let signals = reversing(1e-3, &(0.0..0.0));
        let windows = mechanical::windows(&signals);
        let effects = [EffectId::IronLoss, EffectId::DcLinkSag];
        let model = Model::new(signals.context, &effects);
        let experiment = of_currents(&model, &signals, &windows);
        assert!(experiment.answering(&vec![0.1; model.parameter_count()]).is_none());
    }
}
