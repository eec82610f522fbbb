//! Dimensions of physical quantities: what the name of an SI unit stands for, and the rules of products and powers.
//!
//! The radian counts as a pure number, as in SI, so N·m·s and N·m·s/rad are one unit. Units with a factor, such as mm or rpm, are refused: all values
//! of the core are SI.

use std::fmt;

/// Characters of the name of a unit at most.
const LONGEST: usize = 40;
/// Largest power of a unit or of a quantity.
const LARGEST_POWER: f64 = 24.0;
/// Powers that differ by less are equal: they are sums of a few fractions.
const EQUAL: f64 = 1e-9;

/// Powers of kilogram, metre, second, ampere and kelvin.
#[derive(Debug, Clone, Copy)]
pub struct Dimension([f64; 5]);

/// Symbols, and the powers of kg, m, s, A and K that they stand for.
const UNITS: [(&str, [f64; 5]); 21] = [
    ("1", [0.0, 0.0, 0.0, 0.0, 0.0]),
    ("rad", [0.0, 0.0, 0.0, 0.0, 0.0]),
    ("kg", [1.0, 0.0, 0.0, 0.0, 0.0]),
    ("m", [0.0, 1.0, 0.0, 0.0, 0.0]),
    ("s", [0.0, 0.0, 1.0, 0.0, 0.0]),
    ("A", [0.0, 0.0, 0.0, 1.0, 0.0]),
    ("K", [0.0, 0.0, 0.0, 0.0, 1.0]),
    ("Hz", [0.0, 0.0, -1.0, 0.0, 0.0]),
    ("N", [1.0, 1.0, -2.0, 0.0, 0.0]),
    ("J", [1.0, 2.0, -2.0, 0.0, 0.0]),
    ("W", [1.0, 2.0, -3.0, 0.0, 0.0]),
    ("V", [1.0, 2.0, -3.0, -1.0, 0.0]),
    ("ohm", [1.0, 2.0, -3.0, -2.0, 0.0]),
    ("Ohm", [1.0, 2.0, -3.0, -2.0, 0.0]),
    ("Ω", [1.0, 2.0, -3.0, -2.0, 0.0]),
    ("H", [1.0, 2.0, -2.0, -2.0, 0.0]),
    ("Wb", [1.0, 2.0, -2.0, -1.0, 0.0]),
    ("T", [1.0, 0.0, -2.0, -1.0, 0.0]),
    ("F", [-1.0, -2.0, 4.0, 2.0, 0.0]),
    ("C", [0.0, 0.0, 1.0, 1.0, 0.0]),
    ("Pa", [1.0, -1.0, -2.0, 0.0, 0.0]),
];

/// How a dimension is told where such a unit is the usual one.
const TOLD: [(&str, [f64; 5]); 16] = [
    ("a pure number", [0.0, 0.0, 0.0, 0.0, 0.0]),
    ("N m", [1.0, 2.0, -2.0, 0.0, 0.0]),
    ("N m s", [1.0, 2.0, -1.0, 0.0, 0.0]),
    ("kg m^2", [1.0, 2.0, 0.0, 0.0, 0.0]),
    ("V", [1.0, 2.0, -3.0, -1.0, 0.0]),
    ("V s", [1.0, 2.0, -2.0, -1.0, 0.0]),
    ("V/A", [1.0, 2.0, -3.0, -2.0, 0.0]),
    ("H", [1.0, 2.0, -2.0, -2.0, 0.0]),
    ("1/H", [-1.0, -2.0, 2.0, 2.0, 0.0]),
    ("A", [0.0, 0.0, 0.0, 1.0, 0.0]),
    ("A^2", [0.0, 0.0, 0.0, 2.0, 0.0]),
    ("W", [1.0, 2.0, -3.0, 0.0, 0.0]),
    ("rad/s", [0.0, 0.0, -1.0, 0.0, 0.0]),
    ("rad/s^2", [0.0, 0.0, -2.0, 0.0, 0.0]),
    ("s", [0.0, 0.0, 1.0, 0.0, 0.0]),
    ("K", [0.0, 0.0, 0.0, 0.0, 1.0]),
];

impl Dimension {
    /// That of a pure number.
    pub const NUMBER: Self = Self([0.0; 5]);

    /// What the name of a unit such as `N m s^2/rad` stands for: symbols with powers, side by side or with `*`; a `/` divides by the next symbol
    /// or bracket.
    ///
    /// # Errors
    /// What is wrong with it, and the fix.
    pub fn parse(unit: &str) -> Result<Self, (String, String)> {
        let fix = || "write SI symbols such as N m s^2, V/A or rad/s, and 1 for a pure number".to_string();
        let signs: Vec<char> = unit.chars().collect();
        if signs.is_empty() || signs.len() > LONGEST {
            return Err((format!("a unit of {} characters is none", signs.len()), fix()));
        }
        let (mut own, mut at, mut over, mut inside) = (Self::NUMBER, 0, false, None);
        while at < signs.len() {
            match signs[at] {
                ' ' | '*' | '·' => at += 1,
                '/' if !over => (over, at) = (true, at + 1),
                '(' if inside.is_none() => (inside, over, at) = (Some(over), false, at + 1),
                ')' if inside.is_some() => (inside, at) = (None, at + 1),
                _ => {
                    let begin = at;
                    while at < signs.len() && (signs[at].is_alphabetic() || signs[at] == '1' && at == begin) {
                        at += 1;
                    }
                    let symbol: String = signs[begin..at].iter().collect();
                    let known = UNITS.iter().find(|(name, _)| *name == symbol);
                    let Some((_, powers)) = known else {
                        let shown = if symbol.is_empty() { signs[begin].to_string() } else { symbol };
                        return Err((format!("the unit '{unit}' has no SI symbol '{shown}'"), fix()));
                    };
                    let (power, after) = power(&signs, at)
                        .filter(|(x, _)| x.abs() <= LARGEST_POWER)
                        .ok_or_else(|| (format!("a power in the unit '{unit}' is no small number"), fix()))?;
                    at = after;
                    let below = over != inside.unwrap_or(false);
                    own = own.times(Self(*powers).to(if below { -power } else { power }));
                    over = false;
                }
            }
        }
        if over || inside.is_some() {
            return Err((format!("the unit '{unit}' is not complete"), fix()));
        }
        Ok(own)
    }

    /// That of a product.
    pub fn times(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] + other.0[k]))
    }

    /// That of a quotient.
    pub fn over(self, other: Self) -> Self {
        self.times(other.to(-1.0))
    }

    /// That of a power.
    pub fn to(self, power: f64) -> Self {
        Self(self.0.map(|x| x * power))
    }

    /// Whether it is a pure number.
    pub fn is_number(self) -> bool {
        self == Self::NUMBER
    }
}

impl PartialEq for Dimension {
    fn eq(&self, other: &Self) -> bool {
        self.0.iter().zip(other.0).all(|(a, b)| (a - b).abs() < EQUAL)
    }
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((name, _)) = TOLD.iter().find(|(_, powers)| Self(*powers) == *self) {
            return f.write_str(name);
        }
        let mut between = "";
        for (symbol, power) in ["kg", "m", "s", "A", "K"].iter().zip(self.0) {
            if power.abs() < EQUAL {
                continue;
            }
            write!(f, "{between}{symbol}")?;
            if (power - 1.0).abs() > EQUAL {
                write!(f, "^{}", (power * 1e6).round() / 1e6)?;
            }
            between = " ";
        }
        Ok(())
    }
}

/// The power that stands at a place, and the place behind it.
fn power(signs: &[char], at: usize) -> Option<(f64, usize)> {
    let raised = |c: char| "⁰¹²³⁴⁵⁶⁷⁸⁹".chars().position(|x| x == c).map(|x| x as f64);
    let mut at = at;
    if at < signs.len() && (signs[at] == '⁻' || raised(signs[at]).is_some()) {
        let negative = signs[at] == '⁻';
        at += usize::from(negative);
        let digit = raised(*signs.get(at)?)?;
        return Some((if negative { -digit } else { digit }, at + 1));
    }
    match signs.get(at) {
        Some('^') => at += 1,
        Some('*') if signs.get(at + 1) == Some(&'*') => at += 2,
        _ => return Some((1.0, at)),
    }
    let begin = at;
    while at < signs.len() && (signs[at].is_ascii_digit() || matches!(signs[at], '.' | '-' | '+')) {
        at += 1;
    }
    let text: String = signs[begin..at].iter().collect();
    text.parse().ok().map(|x| (x, at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_one_quantity_are_equal_however_they_are_written() {
        let of = |unit: &str| Dimension::parse(unit).unwrap();
        for (a, b) in [
            ("N m s", "N*m*s/rad"),
            ("N m s²", "kg m^2"),
            ("V s", "Wb"),
            ("V/A", "ohm"),
            ("N m/(rad/s)", "N m s"),
            ("1/s", "rad/s"),
            ("V s/A", "H"),
            ("A^-1", "1/A"),
            ("m⁻²", "1/m**2"),
            ("J", "N m"),
        ] {
            assert_eq!(of(a), of(b), "{a} {b}");
        }
        assert_ne!(of("N m"), of("N m s"));
        assert!(of("1").is_number() && of("rad").is_number() && !of("K").is_number());
        assert_eq!(of("N m s").over(of("s")).to(2.0), of("N^2 m^2"));
    }

    #[test]
    fn what_is_no_si_unit_is_refused_with_the_symbol() {
        for unit in ["", "mm", "rpm", "N m /", "(N", "N)", "m^99", "m^x", "s//s", "((s))", "N-m", "🙂", "1.5"]
        {
            assert!(Dimension::parse(unit).is_err(), "{unit}");
        }
        assert!(Dimension::parse(&"m ".repeat(300)).is_err());
        assert!(Dimension::parse("rpm").unwrap_err().0.contains("'rpm'"));
    }

    #[test]
    fn a_dimension_is_told_by_the_usual_unit_or_by_base_units() {
        let told = |unit: &str| Dimension::parse(unit).unwrap().to_string();
        for (unit, expected) in
            [("N m/rad", "N m"), ("1/s", "rad/s"), ("V/A", "V/A"), ("1", "a pure number"), ("A K", "A K")]
        {
            assert_eq!(told(unit), expected);
        }
        assert_eq!(told("N m s^3"), "kg m^2 s");
    }
}
