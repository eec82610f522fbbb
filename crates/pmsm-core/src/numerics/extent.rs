//! How far long columns reach: the largest magnitude, found in several values at a time. A value that is no number is passed over.

/// Values that are compared side by side.
const SIDE: usize = 8;
/// Squares that are kept at a time.
const PART: usize = 256;

/// The larger one; `most` where `x` is no number.
#[inline(always)]
fn larger(most: f64, x: f64) -> f64 {
    if x > most { x } else { most }
}

/// The largest of the magnitudes of `x`, zero of nothing.
pub fn peak(x: &[f64]) -> f64 {
    let (groups, rest) = x.as_chunks::<SIDE>();
    let mut most = [0.0; SIDE];
    for group in groups {
        for k in 0..SIDE {
            most[k] = larger(most[k], group[k].abs());
        }
    }
    rest.iter().map(|x| x.abs()).chain(most).fold(0.0, larger)
}

/// The largest length of the vectors `d`, `q`, of one length each, zero of nothing.
pub fn longest([d, q]: [&[f64]; 2]) -> f64 {
    let square = |(d, q): (&f64, &f64)| d * d + q * q;
    let (mut squares, mut most) = ([0.0; PART], 0.0);
    for (d, q) in d.chunks(PART).zip(q.chunks(PART)) {
        squares.iter_mut().zip(d.iter().zip(q)).for_each(|(to, pair)| *to = square(pair));
        most = larger(most, peak(&squares[..d.len()]));
    }
    let at = d.iter().zip(q).map(square).position(|square| square == most);
    at.map_or(0.0, |k| d[k].hypot(q[k]))
}

/// From the smallest of `x` to the largest, zero of nothing.
pub fn span(x: &[f64]) -> f64 {
    let ends = |[low, high]: [f64; 2], x: &f64| [low.min(*x), high.max(*x)];
    let [low, high] = x.iter().fold([f64::INFINITY, f64::NEG_INFINITY], ends);
    (high - low).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn nothing_and_what_is_no_number_reach_nowhere() {
        assert_eq!((peak(&[]), peak(&[f64::NAN; 11])), (0.0, 0.0));
        assert_eq!((longest([&[], &[]]), longest([&[f64::NAN; 3], &[1.0; 3]])), (0.0, 0.0));
        let mut x = [1.0; 20];
        (x[3], x[13]) = (f64::NAN, -4.0);
        assert_eq!((peak(&x), span(&x)), (4.0, 5.0));
        assert_eq!((span(&[]), span(&[f64::NAN]), span(&[2.0])), (0.0, 0.0, 0.0));
    }

    proptest! {
        #[test]
        fn it_is_the_largest_wherever_it_stands(x in prop::collection::vec(-1e9..1e9f64, 0..600)) {
            prop_assert_eq!(peak(&x), x.iter().fold(0.0, |most: f64, x| most.max(x.abs())));
            let q: Vec<f64> = x.iter().map(|x| x.sin() * 1e9).collect();
            let lengths = x.iter().zip(&q).map(|(d, q)| d.hypot(*q));
            let expected = lengths.fold(0.0, f64::max);
            // Two squares, their sum and its root round by half an ε each, halved by the root; `hypot` rounds once.
            prop_assert!((longest([&x, &q]) - expected).abs() <= 2.0 * f64::EPSILON * expected);
        }
    }
}
