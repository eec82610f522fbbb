//! Numbers in sentences: a few significant digits, a power of ten only where the number is very small or large, and never "-0".
//!
//! The rule is that of the tables of the Python package.

/// Decimal exponents of numbers that are written without a power of ten.
const PLAIN: std::ops::Range<i32> = -2..6;
/// Units that take a prefix.
const PREFIXED: [&str; 7] = ["H", "ohm", "V s", "s", "V", "A", "N m"];
/// Below this value such a unit takes a prefix.
const SMALL: f64 = 0.1;

/// `x` with so many significant `digits`, as in "0.0312" and "3.12·10⁻⁵".
pub fn figure(x: f64, digits: usize) -> String {
    if x == 0.0 {
        return "0".to_string();
    }
    if !x.is_finite() {
        return format!("{x}");
    }
    let behind = digits.saturating_sub(1);
    // The exponent behind rounding: 0.9996 with three digits is 1.00.
    let text = format!("{x:.behind$e}");
    let Some((mantissa, exponent)) = text.split_once('e') else { return text };
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if PLAIN.contains(&exponent) {
        let decimals = usize::try_from(behind as i32 - exponent).unwrap_or(0);
        format!("{x:.decimals$}")
    } else {
        format!("{mantissa}·10{}", raised(exponent))
    }
}

/// [`figure`] without the zeros at the end of its decimals, as in "20" and "1.55".
pub fn short(x: f64, digits: usize) -> String {
    let text = figure(x, digits);
    if text.contains('.') && !text.contains('·') {
        text.trim_end_matches('0').trim_end_matches('.').to_string()
    } else {
        text
    }
}

/// `x` with its `unit`, in a prefix where it is small, as in "2.76 mV s".
pub fn quantity(x: f64, digits: usize, unit: &str) -> String {
    let (factor, prefix) = match x.abs() {
        size if !PREFIXED.contains(&unit) || size == 0.0 || size >= SMALL => (1.0, ""),
        size if size < 1e-4 => (1e6, "µ"),
        _ => (1e3, "m"),
    };
    format!("{} {prefix}{unit}", figure(factor * x, digits))
}

/// `x` with so many decimals, and never "-0".
pub fn fixed(x: f64, decimals: usize) -> String {
    let text = format!("{x:.decimals$}");
    match text.strip_prefix('-') {
        Some(size) if size.chars().all(|c| c == '0' || c == '.') => size.to_string(),
        _ => text,
    }
}

/// An exponent in raised digits.
fn raised(exponent: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let sign = |c: char| c.to_digit(10).map_or('⁻', |d| DIGITS[d as usize]);
    exponent.to_string().chars().map(sign).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_of_ten_is_written_only_where_it_is_needed() {
        let told = [3.12e-5, 0.0312, 14.4, 9.76, 616.0, 0.9996, -0.004, 1.23e7].map(|x| figure(x, 3));
        assert_eq!(told, ["3.12·10⁻⁵", "0.0312", "14.4", "9.76", "616", "1.00", "-4.00·10⁻³", "1.23·10⁷"]);
        assert_eq!([figure(0.0, 3), figure(-0.0, 3)], ["0", "0"]);
    }

    #[test]
    fn small_values_take_a_prefix_where_their_unit_has_one() {
        assert_eq!(quantity(2.756e-3, 4, "V s"), "2.756 mV s");
        assert_eq!(quantity(1.9e-5, 3, "H"), "19.0 µH");
        assert_eq!(quantity(3.12e-5, 3, "N m s"), "3.12·10⁻⁵ N m s");
        assert_eq!(quantity(14.4, 3, "ohm"), "14.4 ohm");
    }

    #[test]
    fn zeros_at_the_end_and_signs_of_zero_are_left_out() {
        assert_eq!([short(20.0, 4), short(1.55, 4), short(4.28571, 4)], ["20", "1.55", "4.286"]);
        assert_eq!([fixed(-0.4, 0), fixed(-506.3, 0), fixed(-0.001, 2)], ["0", "-506", "0.00"]);
    }
}
