//! A system written in Rust as residuals: simulated over plain numbers for the cost, over duals for derivatives.

use super::{Observations, Residuals, System};
use crate::error::{Error, Result};
use crate::experiment::Linearisation;
use crate::numerics::dual::Dual;
use crate::numerics::real::Real;
use crate::numerics::rk4;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Parameters differentiated in one pass.
const LANES: usize = 4;

/// Largest number of inputs.
const MOST_INPUTS: usize = 16;

/// A system with what it should reproduce.
pub(super) struct Simulated<'a, S, const N: usize, const M: usize> {
    system: &'a S,
    observations: &'a Observations,
    parameters: usize,
}

impl<'a, S: System<N, M>, const N: usize, const M: usize> Simulated<'a, S, N, M> {
    pub fn new(system: &'a S, observations: &'a Observations, parameters: usize) -> Result<Self> {
        let (outputs, inputs) = (observations.outputs().len(), observations.inputs().len());
        if outputs != M {
            return Err(Error::unusable(
                format!("{outputs} outputs were measured and the system has {M}"),
                "give one column per output",
            ));
        }
        if inputs > MOST_INPUTS {
            return Err(Error::unusable(
                format!("there are {inputs} inputs"),
                format!("at most {MOST_INPUTS} are read"),
            ));
        }
        Ok(Self { system, observations, parameters })
    }

    fn cost(&self, p: &[f64], bound: f64) -> f64 {
        let (outputs, weights) = (self.observations.outputs(), self.observations.weights());
        let mut sum = 0.0;
        run(self.system, self.observations, p, |k, y: [f64; M]| {
            for (c, value) in y.into_iter().enumerate() {
                let measured = outputs[c][k];
                if measured.is_finite() {
                    sum += ((value - measured) * weights[c]).powi(2);
                }
            }
            // False for NaN, too.
            sum <= bound
        });
        if sum <= bound && sum.is_finite() { sum } else { f64::INFINITY }
    }
}

impl<S: System<N, M>, const N: usize, const M: usize> Residuals for Simulated<'_, S, N, M> {
    fn parameters(&self) -> usize {
        self.parameters
    }

    fn samples(&self) -> usize {
        self.observations.len()
    }

    fn costs(&self, points: &[f64], bounds: &[f64]) -> Vec<f64> {
        points.par_chunks(self.parameters).zip(bounds).map(|(p, bound)| self.cost(p, *bound)).collect()
    }

    fn linearise(&self, p: &[f64]) -> Linearisation {
        let (n, dim) = (self.observations.len(), self.parameters);
        let (outputs, weights) = (self.observations.outputs(), self.observations.weights());
        let mut residual = DVector::zeros(M * n);
        let mut jacobian = DMatrix::zeros(M * n, dim);
        for first in (0..dim).step_by(LANES) {
            let columns = first..(first + LANES).min(dim);
            let seeded: Vec<Dual<LANES>> = (0..dim)
                .map(|k| {
                    if columns.contains(&k) { Dual::variable(p[k], k - first) } else { Dual::constant(p[k]) }
                })
                .collect();
            run(self.system, self.observations, &seeded, |k, y: [Dual<LANES>; M]| {
                for (c, value) in y.into_iter().enumerate() {
                    let (row, measured) = (c * n + k, outputs[c][k]);
                    if measured.is_finite() {
                        residual[row] = (value.re - measured) * weights[c];
                        for column in columns.clone() {
                            jacobian[(row, column)] = value.eps[column - first] * weights[c];
                        }
                    }
                }
                true
            });
        }
        Linearisation { residual, jacobian }
    }
}

/// Simulates and hands sample number and outputs to `sink`, until that returns false.
pub(super) fn run<T: Real, const N: usize, const M: usize>(
    system: &impl System<N, M>,
    observations: &Observations,
    p: &[T],
    mut sink: impl FnMut(usize, [T; M]) -> bool,
) {
    let t = observations.t();
    let inputs = observations.inputs().len();
    let steps = observations.substeps();
    let mut state = system.start(p);
    for k in 0..t.len() {
        let at = |c: f64| {
            let mut u = [0.0; MOST_INPUTS];
            observations.input(k, c, &mut u[..inputs]);
            u
        };
        if !sink(k, system.output(p, t[k], &state, &at(0.0)[..inputs])) {
            return;
        }
        if k + 1 == t.len() {
            return;
        }
        let h = t[k + 1] - t[k];
        for step in 0..steps {
            state = rk4::step(h / steps as f64, &state, |c, x| {
                let c = (step as f64 + c) / steps as f64;
                system.rhs(p, t[k] + c * h, x, &at(c)[..inputs])
            });
        }
    }
}
