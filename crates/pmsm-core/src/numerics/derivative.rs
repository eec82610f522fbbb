//! Derivatives of a program as operations: what [`crate::numerics::dual`] does to numbers, done once to the formula.

use crate::numerics::real::Real;
use crate::numerics::symbolic::{Operation, Program};

/// The outputs of a program where its inputs are `x`, and their derivatives along `direction`, one entry per input.
///
/// The derivative of a root at zero is zero, and that of an absolute value, as for every number type of the core.
pub fn along<T: Real>(program: &Program, x: &[T], direction: &[T]) -> (Vec<T>, Vec<T>) {
    let mut all: Vec<(T, T)> = Vec::with_capacity(program.operations.len());
    for operation in &program.operations {
        let at = |k: usize| all[k];
        let next = match *operation {
            Operation::Constant(c) => (T::constant(c), T::zero()),
            Operation::Input(k) => (x[k], direction[k]),
            Operation::Add(a, b) => (at(a).0 + at(b).0, at(a).1 + at(b).1),
            Operation::Sub(a, b) => (at(a).0 - at(b).0, at(a).1 - at(b).1),
            Operation::Mul(a, b) => {
                let ((a, da), (b, db)) = (at(a), at(b));
                (a * b, da * b + a * db)
            }
            Operation::Div(a, b) => {
                let ((a, da), (b, db)) = (at(a), at(b));
                let quotient = a / b;
                (quotient, (da - quotient * db) / b)
            }
            Operation::Neg(a) => (-at(a).0, -at(a).1),
            Operation::Sqrt(a) => {
                let (a, da) = at(a);
                let root = a.sqrt();
                (root, root.if_positive(da / (root * 2.0), T::zero()))
            }
            Operation::Sin(a) => {
                let (a, da) = at(a);
                let (sin, cos) = a.sin_cos();
                (sin, cos * da)
            }
            Operation::Cos(a) => {
                let (a, da) = at(a);
                let (sin, cos) = a.sin_cos();
                (cos, -(sin * da))
            }
            Operation::Exp(a) => {
                let (a, da) = at(a);
                let power = a.exp();
                (power, power * da)
            }
            Operation::Ln(a) => (at(a).0.ln(), at(a).1 / at(a).0),
            Operation::Tanh(a) => {
                let (a, da) = at(a);
                let tanh = a.tanh();
                (tanh, (T::one() - tanh * tanh) * da)
            }
            Operation::Abs(a) => {
                let (a, da) = at(a);
                (a.abs(), a.if_positive(da, (-a).if_positive(-da, T::zero())))
            }
            Operation::IfPositive(a, b, c) => {
                let Some(power) = Power::of(&program.operations, a, b, c) else {
                    let a = at(a).0;
                    all.push((a.if_positive(at(b).0, at(c).0), a.if_positive(at(b).1, at(c).1)));
                    continue;
                };
                let value = at(a).0.if_positive(at(b).0, at(c).0);
                let ((exponent, change), (log, _), (safe, _)) =
                    (at(power.exponent), at(power.log), at(power.safe));
                // A power of zero is zero, and so is its derivative: it needs no choice of its own.
                (value, value * (change * log + exponent * at(power.base).1 / safe))
            }
        };
        all.push(next);
    }
    program.outputs.iter().map(|(_, place)| all[*place]).unzip()
}

/// What [`Real::pow_nonnegative`] is made of: places of the operations.
struct Power {
    base: usize,
    exponent: usize,
    /// The base where it is positive, else one, and its logarithm.
    safe: usize,
    log: usize,
}

impl Power {
    /// The power that a choice by `a` between `b` and `c` is, if it is one.
    fn of(all: &[Operation], a: usize, b: usize, c: usize) -> Option<Self> {
        let (Operation::Exp(product), Operation::Constant(0.0)) = (all[b], all[c]) else { return None };
        let Operation::Mul(exponent, log) = all[product] else { return None };
        let Operation::Ln(safe) = all[log] else { return None };
        match all[safe] {
            Operation::IfPositive(again, base, one) if again == a && all[one] == Operation::Constant(1.0) => {
                Some(Self { base, exponent, safe, log })
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::dual::Dual;
    use crate::numerics::real::testing::formula;
    use crate::numerics::symbolic::trace;

    #[test]
    fn derivatives_of_a_program_are_those_of_the_numbers_that_carry_them_and_so_are_the_second_ones() {
        let names = || vec!["x".to_string(), "y".to_string()];
        let first = trace(names(), |x| vec![("f".into(), formula(x[0], x[1]))]);
        let slope = trace(names(), |x| {
            let along_x = [x[0] * 0.0 + 1.0, x[1] * 0.0];
            vec![("f'".into(), along(&first, x, &along_x).1[0])]
        });
        for (x, y) in [(0.7, -1.3), (-0.4, 0.2), (0.9, 2.0)] {
            let dual = formula(Dual::<1>::variable(x, 0), Dual::constant(y));
            let got = slope.run(&[x, y])[0];
            assert!((got - dual.eps[0]).abs() < 1e-13 * dual.eps[0].abs().max(1.0), "{got} {dual:?}");
            let (_, second) = along(&slope, &[x, y], &[1.0, 0.0]);
            let quotient = (slope.run(&[x + 1e-6, y])[0] - slope.run(&[x - 1e-6, y])[0]) / 2e-6;
            assert!((second[0] - quotient).abs() < 1e-7 * quotient.abs().max(1.0), "{second:?} {quotient}");
        }
    }
}
