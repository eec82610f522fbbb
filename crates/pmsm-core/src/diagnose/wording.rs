//! Numbers and lists as an answer words them.

/// Words as one lists them: "a, b and c".
pub fn enumerated<S: AsRef<str>>(words: &[S]) -> String {
    let words: Vec<&str> = words.iter().map(S::as_ref).collect();
    match words.split_last() {
        Some((last, [])) => (*last).to_string(),
        Some((last, before)) => format!("{} and {last}", before.join(", ")),
        None => String::new(),
    }
}

/// Multiples of the noise below which only that is said.
pub const NOTHING: f64 = 0.01;

/// A multiple of the noise in words of two digits, near one of three.
pub fn times(x: f64) -> String {
    if x < NOTHING {
        "less than 0.01".into()
    } else if x < 1.995 {
        format!("{x:.2}")
    } else if x < 9.95 {
        format!("{x:.1}")
    } else {
        format!("{x:.0}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_ends_with_and() {
        assert_eq!(enumerated(&["a", "b", "c"]), "a, b and c");
        assert_eq!(
            [enumerated(&["a", "b"]), enumerated(&["a"]), enumerated::<&str>(&[])],
            ["a and b", "a", ""]
        );
    }
}
