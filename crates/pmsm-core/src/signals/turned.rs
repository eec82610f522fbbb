//! Columns of phase values as the rotor sees them, and the way back, as many samples at a time as a vector holds. The bits are those of
//! one sample at a time.

use crate::numerics::lanes::{self, Job, Lane, Path};
use crate::numerics::real::Real;
use crate::numerics::transforms::{inverse_park, park};
use std::marker::PhantomData;

/// Phase values seen from the rotor at the angles `theta`, rad.
pub fn to_rotor(abc: [&[f64]; 3], theta: &[f64]) -> [Vec<f64>; 2] {
    turned::<Park, 3, 2>(Path::best(), abc, theta)
}

/// Rotor-frame values at the angles `theta`, rad, seen from the three phases.
pub fn to_phases(dq: [&[f64]; 2], theta: &[f64]) -> [Vec<f64>; 3] {
    turned::<InversePark, 2, 3>(Path::best(), dq, theta)
}

/// A transform at one angle.
trait Transform<const IN: usize, const OUT: usize> {
    fn apply<T: Real>(x: [T; IN], cos: T, sin: T) -> [T; OUT];
}

struct Park;

impl Transform<3, 2> for Park {
    #[inline(always)]
    fn apply<T: Real>(x: [T; 3], cos: T, sin: T) -> [T; 2] {
        park(x, cos, sin)
    }
}

struct InversePark;

impl Transform<2, 3> for InversePark {
    #[inline(always)]
    fn apply<T: Real>(x: [T; 2], cos: T, sin: T) -> [T; 3] {
        inverse_park(x, cos, sin)
    }
}

fn turned<X: Transform<IN, OUT>, const IN: usize, const OUT: usize>(
    path: Path,
    from: [&[f64]; IN],
    theta: &[f64],
) -> [Vec<f64>; OUT] {
    let mut to: [Vec<f64>; OUT] = std::array::from_fn(|_| vec![0.0; theta.len()]);
    let columns = to.each_mut().map(Vec::as_mut_slice);
    let job = Turn::<X, IN, OUT> { from, theta, to: columns, by: PhantomData };
    lanes::reproducible(path, job);
    to
}

struct Turn<'a, X, const IN: usize, const OUT: usize> {
    from: [&'a [f64]; IN],
    theta: &'a [f64],
    to: [&'a mut [f64]; OUT],
    by: PhantomData<X>,
}

impl<X: Transform<IN, OUT>, const IN: usize, const OUT: usize> Job for Turn<'_, X, IN, OUT> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(mut self) {
        let full = self.theta.len() - self.theta.len() % V::WIDTH;
        for at in (0..full).step_by(V::WIDTH) {
            self.turn::<V>(at);
        }
        for at in full..self.theta.len() {
            self.turn::<f64>(at);
        }
    }
}

impl<X: Transform<IN, OUT>, const IN: usize, const OUT: usize> Turn<'_, X, IN, OUT> {
    /// As many samples as a vector holds, from number `at` on.
    #[inline(always)]
    fn turn<V: Lane>(&mut self, at: usize) {
        let (sin, cos) = V::load(&self.theta[at..]).sin_cos();
        let x = X::apply(self.from.map(|column| V::load(&column[at..])), cos, sin);
        for (column, x) in self.to.iter_mut().zip(x) {
            x.store(&mut column[at..]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_turned_with_the_bits_of_one_sample_at_a_time_and_back() {
        let column =
            |shift: f64| -> Vec<f64> { (0..37).map(|k| (0.3 * f64::from(k) + shift).sin() * 5.0).collect() };
        let (a, b, c) = (column(0.0), column(2.0), column(4.0));
        let theta: Vec<f64> = (0..37).map(|k| 1e3 * (0.1 * f64::from(k)).sin()).collect();
        for path in Path::ALL {
            let dq = turned::<Park, 3, 2>(path, [&a, &b, &c], &theta);
            let abc = turned::<InversePark, 2, 3>(path, [&dq[0], &dq[1]], &theta);
            for k in 0..37 {
                let (sin, cos) = Real::sin_cos(theta[k]);
                let [d, q] = park([a[k], b[k], c[k]], cos, sin).map(f64::to_bits);
                assert_eq!([dq[0][k].to_bits(), dq[1][k].to_bits()], [d, q], "{path:?}");
                let back = inverse_park([dq[0][k], dq[1][k]], cos, sin).map(f64::to_bits);
                assert_eq!(abc.each_ref().map(|x| x[k].to_bits()), back, "{path:?}");
                let zero = (a[k] + b[k] + c[k]) / 3.0;
                assert!((abc[0][k] + zero - a[k]).abs() < 1e-14);
            }
        }
    }
}
