//! Whether a formula has the dimension that it should have, and is a number where it is evaluated.

use super::{Expression, Fault, Function, Kind, is_whole};
use crate::numerics::dimension::Dimension;

/// A quantity of a formula: its name and dimension, and whether it has a scale, so that its sign can be taken.
#[derive(Debug, Clone, Copy)]
pub struct Given<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its dimension.
    pub dimension: Dimension,
    /// Whether its scale is known.
    pub scaled: bool,
}

/// The dimension of a formula; none where it is zero, which has any.
///
/// # Errors
/// The first place where dimensions do not fit, with both.
pub fn dimension(expression: &Expression, given: &[Given<'_>]) -> Result<Option<Dimension>, Fault> {
    let mut known: Vec<Option<Dimension>> = Vec::with_capacity(expression.nodes.len());
    for node in &expression.nodes {
        let fault = |problem: String, fix: &str| Fault { at: node.at, problem, fix: fix.into() };
        let pure = |x: Option<Dimension>, what: &str| match x {
            Some(x) if !x.is_number() => Err(fault(
                format!("{what} is in {x}, and must be a pure number"),
                "divide it by a parameter of its unit",
            )),
            _ => Ok(Some(Dimension::NUMBER)),
        };
        let own = match node.kind {
            Kind::Number(x) => (x != 0.0).then_some(Dimension::NUMBER),
            Kind::Name(k) => Some(given[k].dimension),
            Kind::Add(a, b) | Kind::Sub(a, b) => match (known[a], known[b]) {
                (Some(x), Some(y)) if x != y => {
                    return Err(fault(
                        format!("the left side is in {x} and the right side in {y}"),
                        "give both the same unit, by a factor with the unit that is missing",
                    ));
                }
                (x, y) => x.or(y),
            },
            Kind::Mul(a, b) => known[a].zip(known[b]).map(|(x, y)| x.times(y)),
            Kind::Div(a, b) => match (known[a], known[b]) {
                (_, None) => return Err(fault("it divides by zero".into(), "divide by another quantity")),
                (x, Some(y)) => x.map(|x| x.over(y)),
            },
            Kind::Neg(a) => known[a],
            Kind::Call(Function::Abs, a) => known[a],
            Kind::Call(Function::Sqrt, a) => known[a].map(|x| x.to(0.5)),
            Kind::Call(Function::Sign, a) => {
                if !matches!(expression.nodes[a].kind, Kind::Name(k) if given[k].scaled) {
                    return Err(fault(
                        "the sign is that of no single variable, so that nothing says how fast it turns over"
                            .into(),
                        "write tanh(x/x_0) with a parameter x_0",
                    ));
                }
                Some(Dimension::NUMBER)
            }
            Kind::Call(f, a) => pure(known[a], &format!("the argument of {}", f.name()))?,
            Kind::Pow(a, b) => {
                pure(known[b], "the exponent")?;
                match (known[a], expression.number(b)) {
                    (Some(x), Some(power)) => Some(x.to(power)),
                    (Some(x), None) => pure(Some(x), "the base of a power that is no plain number")?,
                    (None, _) => None,
                }
            }
        };
        known.push(own);
    }
    Ok(known.pop().flatten())
}

/// The value of a formula where all its parts are finite numbers.
///
/// # Errors
/// The first place that has no finite value.
pub fn checked_value(expression: &Expression, x: &[f64], widths: &[f64]) -> Result<f64, Fault> {
    let mut nodes = Expression { nodes: Vec::with_capacity(expression.nodes.len()) };
    let mut values: Vec<f64> = Vec::with_capacity(expression.nodes.len());
    for node in &expression.nodes {
        nodes.nodes.push(*node);
        let value = match node.kind {
            Kind::Number(c) => c,
            Kind::Name(k) => x[k],
            Kind::Add(a, b) => values[a] + values[b],
            Kind::Sub(a, b) => values[a] - values[b],
            Kind::Mul(a, b) => values[a] * values[b],
            Kind::Div(a, b) => values[a] / values[b],
            Kind::Neg(a) => -values[a],
            // Negative numbers have whole powers alone.
            Kind::Pow(a, b) if expression.number(b).is_none_or(|p| !is_whole(p)) && values[a] < 0.0 => {
                f64::NAN
            }
            Kind::Pow(a, b) => values[a].powf(values[b]),
            Kind::Call(Function::Sign, a) => match expression.nodes[a].kind {
                Kind::Name(k) => (values[a] / widths[k]).tanh(),
                _ => values[a].tanh(),
            },
            Kind::Call(f, a) => super::called(f, values[a]),
        };
        if !value.is_finite() {
            let (problem, fix) = match node.kind {
                Kind::Div(_, b) if values[b] == 0.0 => (
                    "it divides by zero",
                    "add a positive parameter to the divisor, or raise the lower bound of what it holds",
                ),
                Kind::Pow(a, _) if values[a] < 0.0 => {
                    ("it takes a power of a negative number", "take the power of abs(...), or a whole power")
                }
                Kind::Pow(a, _) if values[a] == 0.0 => {
                    ("it takes a negative power of zero", "add a positive parameter to the base")
                }
                Kind::Call(Function::Log, _) => {
                    ("it takes the logarithm of no positive number", "take log(1 + ...) of a positive term")
                }
                Kind::Call(Function::Sqrt, _) => (
                    "it takes the root of a negative number",
                    "take the root of abs(...) or of a sum of squares",
                ),
                _ => ("it grows beyond all numbers", "narrow the bounds of the parameters"),
            };
            return Err(Fault { at: node.at, problem: problem.into(), fix: fix.into() });
        }
        values.push(value);
    }
    Ok(values.pop().unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use super::super::parse;
    use super::*;

    const NAMES: [&str; 4] = ["k", "w", "w_0", "i"];

    fn told(text: &str) -> Result<Option<Dimension>, Fault> {
        let units = ["N m s", "rad/s", "rad/s", "A"].map(|u| Dimension::parse(u).unwrap());
        let given: Vec<Given<'_>> = NAMES
            .iter()
            .zip(units)
            .map(|(name, dimension)| Given { name, dimension, scaled: *name == "w" })
            .collect();
        dimension(&parse(text, &NAMES).unwrap(), &given)
    }

    #[test]
    fn dimensions_follow_from_products_and_powers() {
        let torque = Dimension::parse("N m").unwrap();
        for text in [
            "k*w/(1+(w/w_0)**2)",
            "k*w_0*tanh(w/w_0)",
            "k*sqrt(w**2)",
            "k*w**0.5*w_0**(1/2)",
            "0+k*w*sign(w)",
            "k*w_0*abs(w/w_0)**(1+abs(w/w_0))",
        ] {
            assert_eq!(told(text).unwrap(), Some(torque), "{text}");
        }
        assert_eq!(told("0").unwrap(), None);
        assert_eq!(told("0*k").unwrap(), None);
    }

    #[test]
    fn what_does_not_fit_is_named_with_both_units() {
        for (text, at, said) in [
            ("k*w+k", 4, "in N m and the right side in N m s"),
            ("k*tanh(w)", 3, "argument of tanh is in rad/s"),
            ("k*w**i", 4, "the exponent is in A"),
            ("w**(w/w_0)", 2, "base"),
            ("k*sign(w_0)", 3, "sign"),
            ("k/0", 2, "divides by zero"),
        ] {
            let got = told(text).unwrap_err();
            assert!(got.at == at && got.problem.contains(said), "{text}: {got:?}");
        }
    }

    #[test]
    fn what_is_no_number_is_named_with_its_place() {
        for (text, x, at, said) in [
            ("k/w", [1.0, 0.0, 1.0, 1.0], 2, "divides by zero"),
            ("k*w**1.5", [1.0, -1.0, 1.0, 1.0], 4, "negative number"),
            ("w**-1", [1.0, 0.0, 1.0, 1.0], 2, "negative power of zero"),
            ("log(w)", [1.0, 0.0, 1.0, 1.0], 1, "logarithm"),
            ("sqrt(w)", [1.0, -1.0, 1.0, 1.0], 1, "root"),
            ("exp(w)", [1.0, 1e4, 1.0, 1.0], 1, "beyond"),
        ] {
            let got = checked_value(&parse(text, &NAMES).unwrap(), &x, &[1.0; 4]).unwrap_err();
            assert!(got.at == at && got.problem.contains(said), "{text}: {got:?}");
        }
        let cube = checked_value(&parse("w**3", &NAMES).unwrap(), &[1.0, -2.0, 1.0, 1.0], &[1.0; 4]);
        assert_eq!(cube, Ok(-8.0));
    }
}
