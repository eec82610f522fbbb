//! Whether what nobody explains may be chance.

use super::locate::Located;
use crate::signals::Finding;

/// Probability of so much excess by chance from which nothing is said to be missing.
const LIKELY: f64 = 0.05;

/// A finding where each of the places that leave more than the noise may do so by chance.
pub fn alone(located: &[Located]) -> Option<Finding> {
    let least = located.iter().map(|place| place.p_value).reduce(f64::min)?;
    (least >= LIKELY).then(|| Finding {
        finding: format!(
            "more than the sensors' noise is left over, but noise that lasts as long leaves as much with a probability of {:.0} %",
            100.0 * least
        ),
        consequence: "neither is anything shown to be missing, nor that nothing is".into(),
        fix: "record the same manoeuvre again, and longer: what is missing comes again, chance does not".into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(p_value: f64) -> Located {
        Located {
            equation: "d".into(),
            share: 1.0,
            sentence: String::new(),
            regions: Vec::new(),
            order_electrical: None,
            order_mechanical: None,
            frequency_hz: None,
            trend: None,
            p_value,
            recordings: Vec::new(),
        }
    }

    #[test]
    fn one_place_beyond_chance_is_enough() {
        let finding = alone(&[place(0.53), place(0.08)]).unwrap().finding;
        assert!(finding.contains("of 8 %"), "{finding}");
        assert!(alone(&[place(0.08), place(0.01)]).is_none() && alone(&[]).is_none());
    }
}
