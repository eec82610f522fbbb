//! Derivatives of the speed with respect to an unknown load, where the rotor has states of its own.
//!
//! Over one step a change δx of all its states becomes A·δx + g·δτ, with the mean change δτ of the load meanwhile. One run, seeded
//! anew at each step, tells A and g; the columns of all levels and instants follow from them, in place of a run per seven.

use super::Experiment;
use super::load::{Profile, Pushes};
use crate::numerics::dual::Dual;
use crate::numerics::real::Real;
use crate::simulate::mechanical::{self, Restart};
use std::ops::Range;

/// States of the rotor, its speed among them, and the load in the slot behind them.
const STATES: usize = 3;
const SLOTS: usize = STATES + 1;
const LOAD: usize = STATES;

type Seeded = Dual<SLOTS>;

/// The beginning of a step.
struct Step {
    /// Its samples.
    samples: Range<usize>,
    /// Whether its states are set there, by the speed and the load of the step, and not carried over.
    begins: bool,
    /// The states there, differentiated by those at the beginning of the step before and by its load.
    states: [[f64; SLOTS]; STATES],
}

impl Experiment<'_> {
    /// Whether parameter `index` is a level or an instant of the load, on a rotor with states that this module can carry along.
    pub(super) fn passes_on(&self, index: usize) -> bool {
        let Some(own) = index.checked_sub(self.model.parameter_count()) else { return false };
        let states = self.model.mechanical_states();
        states > 0 && states < STATES && own < self.nuisance.levels + self.nuisance.steps()
    }

    /// Derivatives of the speed with respect to those `columns` of the parameters `free`, each with its `rows`, which are levels and
    /// instants of the load.
    pub(super) fn load_passed_on(
        &self,
        (p, free, columns): (&[f64], &[usize], &[usize]),
        torque: &[f64],
        starts: &[f64],
        mut rows: Vec<&mut [f64]>,
    ) {
        let weight = self.speed_weight();
        let (steps, speed) = self.steps(p, torque, starts);
        let mut profile = Profile::new(self, p, free, columns);
        let mut responses = vec![[0.0; STATES]; columns.len()];
        let mut pushes: Pushes = [None; 3];
        for step in &steps {
            let before = pushes;
            pushes = profile.pushes(self.time(step.samples.start), self.time(step.samples.end));
            for x in &mut responses {
                *x = if step.begins { [0.0; STATES] } else { step.states.map(|by| along(&by, x)) };
            }
            let arrived = if step.begins { pushes } else { before };
            for (column, push) in arrived.into_iter().flatten() {
                for (x, state) in responses[column].iter_mut().zip(&step.states) {
                    *x += state[LOAD] * push;
                }
            }
            for k in step.samples.clone() {
                for (rows, response) in rows.iter_mut().zip(&responses) {
                    rows[k] = along(&speed[k], response) * weight;
                }
                for (column, push) in pushes.into_iter().flatten() {
                    rows[column][k] += speed[k][LOAD] * push * weight;
                }
            }
        }
    }

    /// The steps of a run, and how the speed at each sample answers to the states at the beginning of its step and to its load.
    fn steps(&self, p: &[f64], torque: &[f64], starts: &[f64]) -> (Vec<Step>, Vec<[f64; SLOTS]>) {
        let count = self.model.parameter_count();
        let mut seeded: Vec<Seeded> = p.iter().map(|x| Dual::constant(*x)).collect();
        for level in &mut seeded[count..count + self.nuisance.levels] {
            *level = Dual::variable(level.re, LOAD);
        }
        let torque: Vec<Seeded> = torque.iter().map(|x| Dual::constant(*x)).collect();
        let (mut steps, mut speed) = (Vec::with_capacity(self.samples()), vec![[0.0; SLOTS]; self.samples()]);
        let load = (self.nuisance, &seeded[count..]);
        let anew = Anew { starts, steps: &mut steps };
        let (model, signals, windows) = (self.model, self.signals, self.windows);
        mechanical::run(model, signals, &seeded[..count], &torque, load, windows, anew, |_, k, shown| {
            speed[k] = shown.eps;
        });
        (steps, speed)
    }

    /// Time at sample `k`, s, or one period after the last.
    fn time(&self, k: usize) -> f64 {
        let t = &self.signals.t;
        t.get(k).copied().unwrap_or_else(|| t[t.len() - 1] + self.signals.period)
    }
}

/// A derivative by the states along a change of them.
fn along(by: &[f64; SLOTS], change: &[f64; STATES]) -> f64 {
    by.iter().zip(change).map(|(d, x)| d * x).sum()
}

/// Keeps how the states at the beginning of each step came from those before, and seeds them anew.
struct Anew<'a> {
    starts: &'a [f64],
    steps: &'a mut Vec<Step>,
}

impl Restart<Seeded> for Anew<'_> {
    const WATCHES: bool = true;

    fn speed(&mut self, number: usize, _: usize) -> Seeded {
        Dual::constant(self.starts[number])
    }

    fn forget(&self, _: &mut Seeded) {}

    fn step<const N: usize>(&mut self, samples: Range<usize>, begins: bool, state: &mut [Seeded; N]) {
        let mut states = [[0.0; SLOTS]; STATES];
        for (slot, (x, kept)) in state.iter_mut().zip(&mut states).enumerate() {
            *kept = x.eps;
            *x = Dual::variable(x.re, slot);
        }
        self.steps.push(Step { samples, begins, states });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::experiment::testing::{of_speed, reversing};
    use crate::model::Model;
    use crate::simulate::mechanical::Nuisance;
    use nalgebra::DMatrix;

    #[test]
    fn columns_are_those_of_a_run_that_carries_derivatives_along() {
        // In steps of two samples and of one, divided or not where the shaft rings fast.
        for (h, f_antires) in [(1e-4, 40.0), (1e-4, 900.0), (4e-4, 40.0)] {
            let signals = reversing(h, &(0.5..0.52));
            let windows = mechanical::windows(&signals);
            let model = Model::new(signals.context, &[EffectId::TwoMassShaft, EffectId::EncoderEccentricity]);
            let shaft = [0.4, f_antires, 0.02];
            let p = [&[0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3], &shaft[..], &[0.02, 0.3]].concat();
            let count = p.len();
            assert_eq!(count, model.parameter_count());
            // Of the instants one lies in the gap; then the two states of the shaft.
            let load = [0.3, -0.2, 0.5, 0.1, 0.0, 0.12, 0.31003, 0.51, 0.7, 0.01, 0.02];
            let p = [&p[..], &load].concat();
            let experiment = of_speed(&model, &signals, Nuisance::unknown(4, 2), &windows);
            let free: Vec<usize> = (count..count + 9).collect();
            assert!(free.iter().all(|k| experiment.passes_on(*k)) && !experiment.passes_on(count + 9));
            let (torque, starts) = (experiment.torque_at(&p), experiment.starts.clone().unwrap());
            let columns: Vec<usize> = (0..free.len()).collect();
            let n = signals.len();
            let mut passed = DMatrix::zeros(n, free.len());
            let rows = passed.as_mut_slice().chunks_exact_mut(n).collect();
            experiment.load_passed_on((&p, &free, &columns), &torque, &starts, rows);
            for (column, k) in free.into_iter().enumerate() {
                let mut run = DMatrix::zeros(n, 1);
                let rows = vec![run.as_mut_slice()];
                experiment.mechanical_pass::<4>((&p, &[k], &[0]), || &torque, &starts, None, rows);
                let off = (passed.column(column) - run.column(0)).norm();
                assert!(off <= 1e-10 * run.norm(), "{h} {k}: {off} of {}", run.norm());
                assert_eq!(run.norm() == 0.0, p[k] == 0.51, "{k}");
            }
        }
    }
}
