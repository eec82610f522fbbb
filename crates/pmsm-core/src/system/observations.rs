//! What was recorded of a system: times, inputs, outputs.

use super::System;
use super::simulated::run;
use crate::error::{Error, Result};

/// What an input does between two samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Between {
    /// It keeps the value of the sample before.
    #[default]
    Held,
    /// It goes in a straight line.
    Linear,
}

/// A recording of a system. Values that were not measured are NaN; they are left out of the comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct Observations {
    t: Vec<f64>,
    inputs: Vec<Vec<f64>>,
    outputs: Vec<Vec<f64>>,
    weights: Vec<f64>,
    between: Between,
    substeps: usize,
}

impl Observations {
    /// Sample times (s), one column per input and one per output. Each output weighs by the reciprocal of its standard
    /// deviation, so that all count alike.
    ///
    /// # Errors
    /// [`Error::Sample`] for times that do not increase and inputs that are not finite; [`Error::Column`] for fewer than 8
    /// samples, lengths that differ, no output, or an output without a single value.
    pub fn new(t: Vec<f64>, inputs: Vec<Vec<f64>>, outputs: Vec<Vec<f64>>) -> Result<Self> {
        let n = t.len();
        let column = |column: String, problem: String, fix: &str| {
            Err(Error::Column { column, problem, fix: fix.into() })
        };
        if n < 8 {
            return column("t".into(), format!("has {n} samples"), "at least 8 are needed");
        }
        if let Some(row) = (0..n).find(|k| !t[*k].is_finite() || (*k > 0 && t[*k] <= t[k - 1])) {
            return Err(Error::Sample {
                column: "t".into(),
                row,
                problem: format!("the time is {} s", t[row]),
                fix: "give finite times that increase".into(),
            });
        }
        if outputs.is_empty() {
            return column("measured".into(), "is empty".into(), "give at least one output");
        }
        for (kind, columns) in [("input", &inputs), ("output", &outputs)] {
            if let Some((k, values)) = columns.iter().enumerate().find(|(_, x)| x.len() != n) {
                let problem = format!("has {} values while t has {n}", values.len());
                return column(format!("{kind} {k}"), problem, "give every column the same number of rows");
            }
        }
        for (k, values) in inputs.iter().enumerate() {
            if let Some(row) = values.iter().position(|x| !x.is_finite()) {
                return Err(Error::Sample {
                    column: format!("input {k}"),
                    row,
                    problem: format!("the value is {}", values[row]),
                    fix: "an input must be known at every sample".into(),
                });
            }
        }
        let mut weights = Vec::with_capacity(outputs.len());
        for (k, values) in outputs.iter().enumerate() {
            let known: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
            if known.is_empty() {
                return column(format!("output {k}"), "has no value".into(), "leave it out");
            }
            let mean = known.iter().sum::<f64>() / known.len() as f64;
            let spread = (known.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / known.len() as f64).sqrt();
            weights.push(if spread > 0.0 { 1.0 / spread } else { 1.0 });
        }
        Ok(Self { t, inputs, outputs, weights, between: Between::Held, substeps: 1 })
    }

    /// With these weights of the outputs' errors, one over a unit that counts as one.
    ///
    /// # Errors
    /// [`Error::Quantity`] unless there is one positive finite weight per output.
    pub fn with_weights(mut self, weights: Vec<f64>) -> Result<Self> {
        if weights.len() != self.outputs.len() {
            let expected = format!("give {}, one per output", self.outputs.len());
            return Err(Error::quantity("number of weights", weights.len() as f64, "", &expected));
        }
        if let Some(bad) = weights.iter().find(|w| !(w.is_finite() && **w > 0.0)) {
            return Err(Error::quantity("weight of an output", *bad, "", "give a positive finite number"));
        }
        self.weights = weights;
        Ok(self)
    }

    /// With inputs that do this between two samples.
    pub fn with_inputs(mut self, between: Between) -> Self {
        self.between = between;
        self
    }

    /// With this many Runge–Kutta steps from sample to sample, at least one.
    pub fn with_substeps(mut self, substeps: usize) -> Self {
        self.substeps = substeps.max(1);
        self
    }

    /// The outputs, one column each, that `system` shows with parameters `p` under these inputs.
    pub fn simulate<const N: usize, const M: usize>(
        &self,
        system: &impl System<N, M>,
        p: &[f64],
    ) -> Vec<Vec<f64>> {
        let mut columns = vec![Vec::with_capacity(self.len()); M];
        run(system, self, p, |_, y: [f64; M]| {
            for (column, x) in columns.iter_mut().zip(y) {
                column.push(x);
            }
            true
        });
        columns
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Never true.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// Sample times, s.
    pub fn t(&self) -> &[f64] {
        &self.t
    }

    /// One column per input.
    pub fn inputs(&self) -> &[Vec<f64>] {
        &self.inputs
    }

    /// One column per output.
    pub fn outputs(&self) -> &[Vec<f64>] {
        &self.outputs
    }

    /// Weight of each output's error.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Runge–Kutta steps from sample to sample.
    pub fn substeps(&self) -> usize {
        self.substeps
    }

    /// Writes the inputs at share `c` of the interval that begins at sample `k`.
    pub(super) fn input(&self, k: usize, c: f64, u: &mut [f64]) {
        for (u, column) in u.iter_mut().zip(&self.inputs) {
            *u = match self.between {
                Between::Held => column[k],
                Between::Linear => column[k] + c * (column[(k + 1).min(column.len() - 1)] - column[k]),
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_recording_is_refused_with_its_place() {
        let t: Vec<f64> = (0..10).map(f64::from).collect();
        let flat = vec![1.0; 10];
        let refused = |t: &[f64], u: Vec<Vec<f64>>, y: Vec<Vec<f64>>| {
            Observations::new(t.to_vec(), u, y).unwrap_err().to_string()
        };
        assert!(refused(&t[..3], vec![], vec![]).contains("3 samples"));
        let mut back = t.clone();
        back[4] = 2.0;
        assert!(refused(&back, vec![], vec![flat.clone()]).contains("row 4"));
        assert!(refused(&t, vec![], vec![]).contains("'measured'"));
        assert!(refused(&t, vec![vec![f64::NAN; 10]], vec![flat.clone()]).contains("'input 0', row 0"));
        assert!(refused(&t, vec![], vec![flat.clone(), vec![0.0; 9]]).contains("'output 1'"));
        assert!(refused(&t, vec![], vec![vec![f64::NAN; 10]]).contains("no value"));
        let run = Observations::new(t, vec![], vec![flat]).unwrap();
        assert_eq!(run.weights(), [1.0]);
        assert!(run.clone().with_weights(vec![0.0]).is_err() && run.with_weights(vec![]).is_err());
    }
}
