//! What formulas are at many points of their variables and parameters: finite, zero at zero strength, and how they answer to a strength.

use super::Formulas;
use crate::error::Result;
use crate::numerics::dual::Dual;
use crate::numerics::expression::{Fault, checked_value};
use crate::numerics::random::uniform_pair;

/// Points at which formulas are looked at; the first of them are standstill without current, at each corner of one parameter.
const POINTS: usize = 160;
/// Share of a usual value over which a sign turns over at these points.
const WIDTH: f64 = 2e-3;
/// Energy per flux squared below which a flux of zero calls for no current.
const NOTHING: f64 = 1e-9;

impl Formulas<'_> {
    /// Values of the variables and parameters at many points, with some parameters held.
    fn points(&self, held: &[(usize, f64)]) -> Vec<Vec<f64>> {
        let mut drawn = 0;
        let mut draw = |count: usize| {
            drawn += 1;
            ((uniform_pair(1, [drawn, 0, 0, 0]).0 * count as f64) as usize).min(count - 1)
        };
        (0..POINTS)
            .map(|point| {
                let still = point < 8;
                let variables = self.entries.iter().map(|(_, _, _, usual, signed)| match (signed, still) {
                    (true, true) => 0.0,
                    (false, true) => *usual,
                    (true, false) => [0.0, 1.0, -1.0, 0.3, -0.3, 1e-3, -2.0][draw(7)] * usual,
                    (false, false) => [1.0, 0.3, 2.0][draw(3)] * usual,
                });
                let mut x: Vec<f64> = variables.collect();
                for p in &self.definition.parameters {
                    let middle = if p.low > 0.0 { (p.low * p.high).sqrt() } else { 0.5 * (p.low + p.high) };
                    x.push([p.low, p.high, middle, p.low + 0.3 * (p.high - p.low)][draw(4)]);
                }
                // Names of one variable have one value.
                for k in 1..self.entries.len() {
                    if let Some(first) = (0..k).find(|j| self.entries[*j].1 == self.entries[k].1) {
                        x[k] = x[first];
                    }
                }
                for (k, value) in held {
                    x[self.entries.len() + k] = *value;
                }
                x
            })
            .collect()
    }

    /// Widths of the signs.
    fn usual_widths(&self) -> Vec<f64> {
        let mut widths: Vec<f64> = self.entries.iter().map(|(_, _, _, usual, _)| WIDTH * usual).collect();
        widths.resize(self.entries.len() + self.definition.parameters.len(), 1.0);
        widths
    }

    /// Checks that all formulas have finite values.
    pub fn stays_finite(&self) -> Result<()> {
        let widths = self.usual_widths();
        for x in self.points(&[]) {
            for (k, term) in self.terms.iter().enumerate() {
                checked_value(term, &x, &widths).map_err(|fault| self.told(k, fault, &x))?;
            }
        }
        Ok(())
    }

    /// A fault with the values at which it shows.
    fn told(&self, term: usize, fault: Fault, x: &[f64]) -> crate::error::Error {
        let names = self.entries.iter().map(|(name, ..)| *name);
        let names = names.chain(self.definition.parameters.iter().map(|p| p.name.as_str()));
        let own = &self.terms[term];
        let values: Vec<String> = names
            .zip(x)
            .enumerate()
            .filter(|(k, _)| own.uses(*k))
            .map(|(_, (n, x))| format!("{n} = {x}"))
            .collect();
        let problem = format!("{} where {}", fault.problem, values.join(", "));
        self.definition.fault(term, Fault { problem, ..fault })
    }

    /// The parameters at whose zero all formulas are zero: the first whose range includes zero, or it and the next ones.
    pub fn strengths(&self) -> Result<Vec<usize>> {
        let parameters = &self.definition.parameters;
        let able = (0..parameters.len()).filter(|k| {
            (parameters[*k].low..=parameters[*k].high).contains(&0.0) && parameters[*k].values.is_empty()
        });
        let able: Vec<usize> = able.collect();
        // One by one first, then more and more of them together.
        let alone = able.iter().map(|k| vec![*k]);
        let together = (2..=able.len()).map(|count| able[..count].to_vec());
        for set in alone.chain(together) {
            if self.vanishes(&set) {
                return Ok(set);
            }
        }
        let problem = match able.is_empty() {
            true => "no parameter may be zero, so that nothing says how strong it is".to_string(),
            false => {
                let names: Vec<&str> = able.iter().map(|k| parameters[*k].name.as_str()).collect();
                format!("it is not zero where {} is zero", names.join(" and "))
            }
        };
        Err(self.definition.wrong(
            problem,
            "give a factor on the whole formula as a parameter whose range begins with 0, such as k: [unit, 0, 1]",
        ))
    }

    fn vanishes(&self, set: &[usize]) -> bool {
        let held: Vec<(usize, f64)> = set.iter().map(|k| (*k, 0.0)).collect();
        let widths = self.usual_widths();
        self.points(&held)
            .iter()
            .all(|x| self.terms.iter().all(|term| checked_value(term, x, &widths) == Ok(0.0)))
    }

    /// Whether the formulas answer to a strength in proportion where all `strengths` are zero.
    pub fn slopes(&self, strength: usize, strengths: &[usize]) -> bool {
        let held: Vec<(usize, f64)> = strengths.iter().map(|k| (*k, 0.0)).collect();
        let widths: Vec<Dual<1>> =
            self.usual_widths().into_iter().map(|x| Dual { re: x, eps: [0.0] }).collect();
        self.points(&held).iter().any(|x| {
            let mut x: Vec<Dual<1>> = x.iter().map(|x| Dual { re: *x, eps: [0.0] }).collect();
            x[self.entries.len() + strength].eps = [1.0];
            self.terms.iter().any(|term| {
                let slope = term.value(&x, &widths).eps[0];
                slope.is_finite() && slope != 0.0
            })
        })
    }

    /// Checks that the magnet alone calls for no current from the field energy.
    pub fn calls_for_nothing(&self) -> Result<()> {
        let widths: Vec<Dual<2>> =
            self.usual_widths().into_iter().map(|x| Dual { re: x, eps: [0.0; 2] }).collect();
        for x in self.points(&[]) {
            let mut x: Vec<Dual<2>> = x.iter().map(|x| Dual { re: *x, eps: [0.0; 2] }).collect();
            for (k, (name, ..)) in self.entries.iter().enumerate() {
                match *name {
                    "lambda_d" => x[k] = Dual { re: 0.0, eps: [1.0, 0.0] },
                    "lambda_q" => x[k] = Dual { re: 0.0, eps: [0.0, 1.0] },
                    _ => {}
                }
            }
            let energy = self.terms[0].value(&x, &widths);
            let large = |slope: &f64| !slope.is_finite() || slope.abs() > NOTHING;
            if energy.eps.iter().any(large) {
                let fault = Fault {
                    at: 1,
                    problem: "the energy has a slope at a flux linkage of zero: the magnet alone would call for current"
                        .into(),
                    fix: "begin with the second power of lambda_d and lambda_q".into(),
                };
                return Err(self.definition.fault(0, fault));
            }
        }
        Ok(())
    }
}
