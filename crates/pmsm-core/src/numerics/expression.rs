//! Formulas as text: what a person writes becomes a list of nodes, operands before what uses them.
//!
//! ```text
//! sum     = product {("+" | "-") product}
//! product = signed {("*" | "/") signed}
//! signed  = ("+" | "-") signed | power
//! power   = atom [("**" | "^") signed]
//! atom    = number | name | function "(" sum {"," sum} ")" | "(" sum ")"
//! ```
//!
//! Length, nesting and the number of nodes are bounded before anything is computed, so that no text exhausts stack or time.

mod check;
mod parse;

pub use check::{Given, checked_value, dimension};
pub(crate) use parse::nearest;
pub use parse::parse;

use crate::numerics::real::Real;

/// Characters of a formula at most.
pub const LONGEST: usize = 2000;
/// Brackets, signs and powers within one another at most.
pub const DEEPEST: usize = 48;

/// What is wrong with a formula, and where.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// Place in the text: the number of the character, from one.
    pub at: usize,
    /// What is wrong there.
    pub problem: String,
    /// What would be right.
    pub fix: String,
}

/// A function of one number; a power is a node of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Function {
    /// Sine.
    Sin,
    /// Cosine.
    Cos,
    /// Hyperbolic tangent.
    Tanh,
    /// Exponential.
    Exp,
    /// Natural logarithm.
    Log,
    /// Square root.
    Sqrt,
    /// Absolute value.
    Abs,
    /// Inverse tangent.
    Atan,
    /// −1 or 1, turned over smoothly around zero over a small share of the variable's scale.
    Sign,
}

impl Function {
    /// All, with their names.
    pub const ALL: [(&'static str, Self); 10] = [
        ("sin", Self::Sin),
        ("cos", Self::Cos),
        ("tanh", Self::Tanh),
        ("exp", Self::Exp),
        ("log", Self::Log),
        ("ln", Self::Log),
        ("sqrt", Self::Sqrt),
        ("abs", Self::Abs),
        ("atan", Self::Atan),
        ("sign", Self::Sign),
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, f)| *f == self).map_or("", |(name, _)| name)
    }
}

/// What a node does; operands are places of earlier nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// A number.
    Number(f64),
    /// The quantity of this number in the list of names.
    Name(usize),
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
    /// Power.
    Pow(usize, usize),
    /// Function of one number.
    Call(Function, usize),
}

/// A node and where it stands in the text.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// What it does.
    pub kind: Kind,
    /// The number of its character, from one.
    pub at: usize,
}

/// A formula; its last node is its value.
#[derive(Debug, Clone, PartialEq)]
pub struct Expression {
    /// Its nodes.
    pub nodes: Vec<Node>,
}

impl Expression {
    /// Whether it uses the quantity of this number.
    pub fn uses(&self, name: usize) -> bool {
        self.nodes.iter().any(|node| node.kind == Kind::Name(name))
    }

    /// Whether it calls this function.
    pub fn calls(&self, function: Function) -> bool {
        self.nodes.iter().any(|node| matches!(node.kind, Kind::Call(f, _) if f == function))
    }

    /// Its value where the quantities have these values; `widths` are those over which the sign of each turns over.
    pub fn value<T: Real>(&self, x: &[T], widths: &[T]) -> T {
        let mut values: Vec<T> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let value = match node.kind {
                Kind::Number(c) => T::constant(c),
                Kind::Name(k) => x[k],
                Kind::Add(a, b) => values[a] + values[b],
                Kind::Sub(a, b) => values[a] - values[b],
                Kind::Mul(a, b) => values[a] * values[b],
                Kind::Div(a, b) => values[a] / values[b],
                Kind::Neg(a) => -values[a],
                Kind::Pow(a, b) => self.power(values[a], values[b], b),
                Kind::Call(Function::Sign, a) => match self.nodes[a].kind {
                    Kind::Name(k) => (values[a] / widths[k]).tanh(),
                    _ => values[a].tanh(),
                },
                Kind::Call(f, a) => called(f, values[a]),
            };
            values.push(value);
        }
        values.pop().unwrap_or_else(T::zero)
    }

    /// The number that a node is, if it is one.
    pub fn number(&self, node: usize) -> Option<f64> {
        match self.nodes[node].kind {
            Kind::Number(x) => Some(x),
            Kind::Neg(a) => self.number(a).map(|x| -x),
            Kind::Div(a, b) => Some(self.number(a)? / self.number(b)?),
            _ => None,
        }
    }

    fn power<T: Real>(&self, base: T, exponent: T, node: usize) -> T {
        match self.number(node) {
            Some(0.5) => base.sqrt(),
            Some(x) if is_whole(x) => {
                let mut power = T::one();
                let (mut square, mut rest) = (base, x.abs() as u32);
                let mut first = true;
                while rest > 0 {
                    if rest & 1 == 1 {
                        power = if first { square } else { power * square };
                        first = false;
                    }
                    rest >>= 1;
                    if rest > 0 {
                        square = square.squared();
                    }
                }
                if x < 0.0 { T::one() / power } else { power }
            }
            _ => base.pow_nonnegative(exponent),
        }
    }
}

/// Whether a power is a product.
pub(crate) fn is_whole(x: f64) -> bool {
    x.fract() == 0.0 && x.abs() <= 32.0
}

fn called<T: Real>(f: Function, x: T) -> T {
    match f {
        Function::Sin => x.sin_cos().0,
        Function::Cos => x.sin_cos().1,
        Function::Tanh | Function::Sign => x.tanh(),
        Function::Exp => x.exp(),
        Function::Log => x.ln(),
        Function::Sqrt => x.sqrt(),
        Function::Abs => x.abs(),
        Function::Atan => atan(x),
    }
}

/// Inverse tangent: atan x = 16·atan y for y = x/(1 + √(1 + x²)), taken four times, which is below 0.1, and then its series.
fn atan<T: Real>(x: T) -> T {
    // Beyond it the tangent is π/2 to the last bit, and squares are finite before it.
    const FAR: f64 = 1e100;
    const TERMS: i32 = 8;
    let far = T::constant(FAR);
    let mut y = (x - far).if_positive(far, (-x - far).if_positive(-far, x));
    for _ in 0..4 {
        y = y / ((y.squared() + 1.0).sqrt() + 1.0);
    }
    let square = y.squared();
    let mut sum = T::constant(1.0 / f64::from(2 * TERMS + 1));
    for k in (0..TERMS).rev() {
        sum = -(sum * square) + 1.0 / f64::from(2 * k + 1);
    }
    y * sum * 16.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::dual::Dual;

    #[test]
    fn a_formula_has_the_value_and_the_derivative_that_it_says() {
        let names = ["x", "y"];
        let (x, y) = (0.7f64, -1.3f64);
        for (text, value, slope) in [
            ("x*y + 2", x * y + 2.0, y),
            ("-x**2", -x * x, -2.0 * x),
            ("2**-x", 2f64.powf(-x), -2f64.ln() * 2f64.powf(-x)),
            ("x^3/(1+y^2)", x.powi(3) / (1.0 + y * y), 3.0 * x * x / (1.0 + y * y)),
            ("x**-2", x.powi(-2), -2.0 * x.powi(-3)),
            ("sqrt(x)*abs(y)", x.sqrt() * 1.3, 0.5 / x.sqrt() * 1.3),
            ("abs(y*x)**1.5", (1.3 * x).powf(1.5), 1.5 * (1.3 * x).sqrt() * 1.3),
            ("atan(3*x)", (3.0 * x).atan(), 3.0 / (1.0 + 9.0 * x * x)),
            ("atan(-900*x)", (-900.0 * x).atan(), -900.0 / (1.0 + (900.0 * x).powi(2))),
            ("pow(x, 2.5)+log(x)", x.powf(2.5) + x.ln(), 2.5 * x.powf(1.5) + 1.0 / x),
            ("tanh(x)-exp(-x)", x.tanh() - (-x).exp(), 1.0 - x.tanh().powi(2) + (-x).exp()),
            ("sin(x)*cos(x)", x.sin() * x.cos(), (2.0 * x).cos()),
            ("sign(x)", (x / 0.5).tanh(), 2.0 * (1.0 - (x / 0.5).tanh().powi(2))),
            ("1.5e-1*x - .5", 0.15 * x - 0.5, 0.15),
            ("2*x/4*2", x, 1.0),
            ("2-x-1", 1.0 - x, -1.0),
        ] {
            let expression = parse(text, &names).unwrap();
            let got =
                expression.value(&[Dual::<1>::variable(x, 0), Dual::constant(y)], &[Dual::constant(0.5); 2]);
            assert!((got.re - value).abs() < 1e-14, "{text}: {} {value}", got.re);
            assert!(
                (got.eps[0] - slope).abs() < 1e-13 * slope.abs().max(1.0),
                "{text}: {} {slope}",
                got.eps[0]
            );
        }
    }

    #[test]
    fn the_inverse_tangent_is_exact_and_ends_at_a_right_angle() {
        for x in [0.0, 1e-9, 0.1, 0.5, 1.0, 7.0, 1e5, 1e99, 1e200, f64::MAX] {
            for x in [x, -x] {
                assert!(
                    (atan(x) - x.atan()).abs() <= 4.0 * f64::EPSILON * x.atan().abs(),
                    "{x}: {}",
                    atan(x)
                );
            }
        }
    }
}
