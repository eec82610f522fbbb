//! Numbers that write down what is done to them. The equations of the core are generic over the number type. On such numbers they become a list
//! of elementary operations, from which programs in other languages are made.
//!
//! Each operation is kept once: equal operations on equal operands are the same entry. Operations on constants alone are carried out, with
//! the bits that `f64` gives. Entries stand in the order in which they can be computed.

use crate::numerics::real::Real;
use serde::Serialize;
use std::cell::RefCell;
use std::collections::HashMap;
use std::fmt;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// An elementary operation; operands are places of earlier entries.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Operation {
    /// A number.
    Constant(f64),
    /// The input of this number.
    Input(usize),
    /// Sum.
    Add(usize, usize),
    /// Difference.
    Sub(usize, usize),
    /// Product.
    Mul(usize, usize),
    /// Quotient.
    Div(usize, usize),
    /// Negative.
    Neg(usize),
    /// Square root.
    Sqrt(usize),
    /// Sine.
    Sin(usize),
    /// Cosine.
    Cos(usize),
    /// Exponential.
    Exp(usize),
    /// Natural logarithm.
    Ln(usize),
    /// Hyperbolic tangent.
    Tanh(usize),
    /// Absolute value.
    Abs(usize),
    /// The second where the first is greater than zero, else the third.
    IfPositive(usize, usize, usize),
}

impl Operation {
    /// What tells it from all others: its kind, and its operands or the bits of its number.
    fn key(&self) -> (u8, [u64; 3]) {
        let at = |x: usize| x as u64;
        match *self {
            Self::Constant(x) => (0, [x.to_bits(), 0, 0]),
            Self::Input(k) => (1, [at(k), 0, 0]),
            Self::Add(a, b) => (2, [at(a), at(b), 0]),
            Self::Sub(a, b) => (3, [at(a), at(b), 0]),
            Self::Mul(a, b) => (4, [at(a), at(b), 0]),
            Self::Div(a, b) => (5, [at(a), at(b), 0]),
            Self::Neg(a) => (6, [at(a), 0, 0]),
            Self::Sqrt(a) => (7, [at(a), 0, 0]),
            Self::Sin(a) => (8, [at(a), 0, 0]),
            Self::Cos(a) => (9, [at(a), 0, 0]),
            Self::Exp(a) => (10, [at(a), 0, 0]),
            Self::Ln(a) => (11, [at(a), 0, 0]),
            Self::Tanh(a) => (12, [at(a), 0, 0]),
            Self::Abs(a) => (13, [at(a), 0, 0]),
            Self::IfPositive(a, b, c) => (14, [at(a), at(b), at(c)]),
        }
    }

    /// Its operands.
    pub fn operands(&self) -> Vec<usize> {
        match *self {
            Self::Constant(_) | Self::Input(_) => Vec::new(),
            Self::Add(a, b) | Self::Sub(a, b) | Self::Mul(a, b) | Self::Div(a, b) => vec![a, b],
            Self::IfPositive(a, b, c) => vec![a, b, c],
            Self::Neg(a)
            | Self::Sqrt(a)
            | Self::Sin(a)
            | Self::Cos(a)
            | Self::Exp(a)
            | Self::Ln(a)
            | Self::Tanh(a)
            | Self::Abs(a) => vec![a],
        }
    }

    /// The same on other places.
    fn moved(self, to: impl Fn(usize) -> usize) -> Self {
        match self {
            Self::Constant(_) | Self::Input(_) => self,
            Self::Add(a, b) => Self::Add(to(a), to(b)),
            Self::Sub(a, b) => Self::Sub(to(a), to(b)),
            Self::Mul(a, b) => Self::Mul(to(a), to(b)),
            Self::Div(a, b) => Self::Div(to(a), to(b)),
            Self::Neg(a) => Self::Neg(to(a)),
            Self::Sqrt(a) => Self::Sqrt(to(a)),
            Self::Sin(a) => Self::Sin(to(a)),
            Self::Cos(a) => Self::Cos(to(a)),
            Self::Exp(a) => Self::Exp(to(a)),
            Self::Ln(a) => Self::Ln(to(a)),
            Self::Tanh(a) => Self::Tanh(to(a)),
            Self::Abs(a) => Self::Abs(to(a)),
            Self::IfPositive(a, b, c) => Self::IfPositive(to(a), to(b), to(c)),
        }
    }

    /// Its value, the operands having these.
    fn value(&self, inputs: &[f64], x: impl Fn(usize) -> f64) -> f64 {
        match *self {
            Self::Constant(c) => c,
            Self::Input(k) => inputs[k],
            Self::Add(a, b) => x(a) + x(b),
            Self::Sub(a, b) => x(a) - x(b),
            Self::Mul(a, b) => x(a) * x(b),
            Self::Div(a, b) => x(a) / x(b),
            Self::Neg(a) => -x(a),
            Self::Sqrt(a) => Real::sqrt(x(a)),
            Self::Sin(a) => Real::sin_cos(x(a)).0,
            Self::Cos(a) => Real::sin_cos(x(a)).1,
            Self::Exp(a) => Real::exp(x(a)),
            Self::Ln(a) => Real::ln(x(a)),
            Self::Tanh(a) => Real::tanh(x(a)),
            Self::Abs(a) => Real::abs(x(a)),
            Self::IfPositive(a, b, c) => x(a).if_positive(x(b), x(c)),
        }
    }
}

/// What has been written down so far.
#[derive(Default)]
struct Tape {
    operations: Vec<Operation>,
    places: HashMap<(u8, [u64; 3]), usize>,
}

impl Tape {
    fn constant(&self, place: usize) -> Option<f64> {
        match self.operations[place] {
            Operation::Constant(x) => Some(x),
            _ => None,
        }
    }

    /// The place of an operation, which is carried out where all operands are constants, or left out where it changes nothing.
    fn put(&mut self, operation: Operation) -> usize {
        let operands = operation.operands();
        if !operands.is_empty() && operands.iter().all(|a| self.constant(*a).is_some()) {
            let value = operation.value(&[], |a| self.constant(a).unwrap_or(f64::NAN));
            return self.put(Operation::Constant(value));
        }
        let is = |place: usize, x: f64| self.constant(place) == Some(x);
        match operation {
            Operation::Add(a, b) if is(b, 0.0) => return a,
            Operation::Add(a, b) if is(a, 0.0) => return b,
            Operation::Sub(a, b) if is(b, 0.0) => return a,
            Operation::Mul(a, b) | Operation::Div(a, b) if is(b, 1.0) => return a,
            Operation::Mul(a, b) if is(a, 1.0) => return b,
            Operation::Mul(a, b) if is(a, 0.0) || is(b, 0.0) => return self.put(Operation::Constant(0.0)),
            Operation::Div(a, _) if is(a, 0.0) => return a,
            Operation::IfPositive(_, b, c) if b == c => return b,
            Operation::IfPositive(a, b, c) => {
                if let Some(x) = self.constant(a) {
                    return if x > 0.0 { b } else { c };
                }
                // What is asked again within a branch has been answered there.
                match (self.operations[b], self.operations[c]) {
                    (Operation::IfPositive(again, yes, _), _) if again == a => {
                        return self.put(Operation::IfPositive(a, yes, c));
                    }
                    (_, Operation::IfPositive(again, _, no)) if again == a => {
                        return self.put(Operation::IfPositive(a, b, no));
                    }
                    _ => {}
                }
            }
            _ => {}
        }
        let key = operation.key();
        if let Some(place) = self.places.get(&key) {
            return *place;
        }
        self.operations.push(operation);
        self.places.insert(key, self.operations.len() - 1);
        self.operations.len() - 1
    }
}

thread_local! {
    static TAPE: RefCell<Tape> = RefCell::default();
}

/// A number that writes down what is done to it, within [`trace`].
#[derive(Clone, Copy)]
pub struct Symbol(u32);

impl fmt::Debug for Symbol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "#{}", self.0)
    }
}

impl Symbol {
    fn put(operation: Operation) -> Self {
        let place = TAPE.with(|tape| tape.borrow_mut().put(operation));
        Self(u32::try_from(place).expect("equations have fewer than 2³² operations"))
    }

    fn at(self) -> usize {
        self.0 as usize
    }
}

/// Elementary operations that lead from inputs to outputs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Program {
    /// Names of the inputs.
    pub inputs: Vec<String>,
    /// The operations, in an order in which they can be carried out.
    pub operations: Vec<Operation>,
    /// Names of the outputs and the places of the operations that yield them.
    pub outputs: Vec<(String, usize)>,
}

impl Program {
    /// The outputs where the inputs have these values.
    ///
    /// # Panics
    /// If there are fewer values than inputs.
    pub fn run(&self, inputs: &[f64]) -> Vec<f64> {
        let mut values = Vec::with_capacity(self.operations.len());
        for operation in &self.operations {
            let value = operation.value(inputs, |a| values[a]);
            values.push(value);
        }
        self.outputs.iter().map(|(_, place)| values[*place]).collect()
    }
}

/// The program that a function of its inputs is: `equations` gets one number per name in `inputs` and returns the outputs with their names.
pub fn trace(inputs: Vec<String>, equations: impl FnOnce(&[Symbol]) -> Vec<(String, Symbol)>) -> Program {
    TAPE.with(|tape| tape.take());
    let given: Vec<Symbol> = (0..inputs.len()).map(|k| Symbol::put(Operation::Input(k))).collect();
    let outputs = equations(&given);
    let all = TAPE.with(|tape| tape.take()).operations;
    // What no output needs goes.
    let mut needed = vec![false; all.len()];
    outputs.iter().for_each(|(_, symbol)| needed[symbol.at()] = true);
    for place in (0..all.len()).rev().filter(|place| all[*place].operands().iter().any(|a| a < place)) {
        if needed[place] {
            all[place].operands().into_iter().for_each(|a| needed[a] = true);
        }
    }
    let mut places = vec![usize::MAX; all.len()];
    let mut operations = Vec::new();
    for (place, operation) in all.into_iter().enumerate().filter(|(place, _)| needed[*place]) {
        places[place] = operations.len();
        operations.push(operation.moved(|a| places[a]));
    }
    let outputs = outputs.into_iter().map(|(name, symbol)| (name, places[symbol.at()])).collect();
    Program { inputs, operations, outputs }
}

macro_rules! binary {
    ($($trait:ident $method:ident),+) => {$(
        impl $trait for Symbol {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                Self::put(Operation::$trait(self.at(), other.at()))
            }
        }
        impl $trait<f64> for Symbol {
            type Output = Self;
            fn $method(self, other: f64) -> Self {
                $trait::$method(self, Self::constant(other))
            }
        }
    )+};
}

binary!(Add add, Sub sub, Mul mul, Div div);

impl Neg for Symbol {
    type Output = Self;
    fn neg(self) -> Self {
        Self::put(Operation::Neg(self.at()))
    }
}

impl AddAssign for Symbol {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Symbol {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Real for Symbol {
    const CALLED: bool = true;
    fn constant(x: f64) -> Self {
        Self::put(Operation::Constant(x))
    }
    fn sqrt(self) -> Self {
        Self::put(Operation::Sqrt(self.at()))
    }
    fn sin_cos(self) -> (Self, Self) {
        (Self::put(Operation::Sin(self.at())), Self::put(Operation::Cos(self.at())))
    }
    fn exp(self) -> Self {
        Self::put(Operation::Exp(self.at()))
    }
    fn ln(self) -> Self {
        Self::put(Operation::Ln(self.at()))
    }
    fn tanh(self) -> Self {
        Self::put(Operation::Tanh(self.at()))
    }
    fn abs(self) -> Self {
        Self::put(Operation::Abs(self.at()))
    }
    fn if_positive(self, yes: Self, no: Self) -> Self {
        Self::put(Operation::IfPositive(self.at(), yes.at(), no.at()))
    }
    /// Its value is not known yet: a loop that ends by it goes on.
    fn positive(self) -> bool {
        true
    }
    /// Its value is not known yet: a loop that ends by it goes on.
    fn size(self) -> f64 {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::real::testing::formula;

    fn traced() -> Program {
        trace(vec!["x".into(), "y".into()], |x| vec![("f".into(), formula(x[0], x[1])), ("x".into(), x[0])])
    }

    #[test]
    fn a_program_has_the_bits_of_the_formula() {
        let program = traced();
        for (x, y) in [(0.7, -1.3), (-0.4, 0.2), (0.2, 2.0), (0.0, 0.0)] {
            let got = program.run(&[x, y]);
            let expected: f64 = formula(x, y);
            assert_eq!((got[0].to_bits(), got[1]), (expected.to_bits(), x), "{x} {y}");
        }
    }

    #[test]
    fn what_is_equal_is_kept_once_and_what_is_not_needed_goes() {
        let program = trace(vec!["x".into(), "unused".into()], |x| {
            let _ = x[1].exp() * 3.0;
            let once = x[0] * 2.0 + 0.0;
            vec![("a".into(), once), ("b".into(), x[0] * 2.0 * Symbol::one())]
        });
        assert_eq!(program.operations.len(), 3, "{:?}", program.operations);
        assert_eq!(program.outputs[0].1, program.outputs[1].1);
        assert_eq!(program.run(&[1.5, 0.0]), [3.0, 3.0]);
    }
}
