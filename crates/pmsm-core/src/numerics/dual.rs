//! Numbers that carry exact derivatives along.

mod beside;
mod outlined;
mod plain;
mod tangent;

pub use beside::Beside;

use crate::numerics::real::{Abreast, Loop, Real};
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// A value with its derivatives with respect to `N` parameters (forward-mode differentiation).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<const N: usize> {
    /// The value.
    pub re: f64,
    /// The derivatives.
    pub eps: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// The value `re` of parameter number `slot`: derivative one in that slot, zero elsewhere.
    pub fn variable(re: f64, slot: usize) -> Self {
        let mut eps = [0.0; N];
        eps[slot] = 1.0;
        Self { re, eps }
    }

    /// `f(self)` from the value and the derivative of `f` there.
    #[inline(always)]
    fn chain(self, value: f64, slope: f64) -> Self {
        let mut eps = self.eps;
        for e in &mut eps {
            *e *= slope;
        }
        Self { re: value, eps }
    }
}

macro_rules! componentwise {
    ($trait:ident, $method:ident, $op:tt) => {
        impl<const N: usize> $trait for Dual<N> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let eps = std::array::from_fn(|k| self.eps[k] $op other.eps[k]);
                Self { re: self.re $op other.re, eps }
            }
        }
        impl<const N: usize> $trait<f64> for Dual<N> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                Self { re: self.re $op other, eps: self.eps }
            }
        }
    };
}
componentwise!(Add, add, +);
componentwise!(Sub, sub, -);

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let mut eps = [0.0; N];
        for k in 0..N {
            eps[k] = self.eps[k] * other.re + self.re * other.eps[k];
        }
        Self { re: self.re * other.re, eps }
    }
}

impl<const N: usize> Mul<f64> for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: f64) -> Self {
        self.chain(self.re * other, other)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    // The quotient rule: (f/g)' = (f' − (f/g)·g')/g.
    #[allow(clippy::suspicious_arithmetic_impl)]
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let inverse = 1.0 / other.re;
        let value = self.re / other.re;
        let mut eps = [0.0; N];
        for k in 0..N {
            eps[k] = (self.eps[k] - value * other.eps[k]) * inverse;
        }
        Self { re: value, eps }
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.re, -1.0)
    }
}

impl<const N: usize> AddAssign for Dual<N> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<const N: usize> SubAssign for Dual<N> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<const N: usize> Real for Dual<N> {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Self { re: x, eps: [0.0; N] }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.re.sqrt();
        self.chain(root, if root > 0.0 { 0.5 / root } else { 0.0 })
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (s, c) = Real::sin_cos(self.re);
        (self.chain(s, c), self.chain(c, -s))
    }
    #[inline(always)]
    fn exp(self) -> Self {
        let e = self.re.exp();
        self.chain(e, e)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.chain(self.re.ln(), 1.0 / self.re)
    }
    #[inline(always)]
    fn tanh(self) -> Self {
        let t = self.re.tanh();
        self.chain(t, 1.0 - t * t)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        let slope = if self.re > 0.0 {
            1.0
        } else if self.re < 0.0 {
            -1.0
        } else {
            0.0
        };
        self.chain(self.re.abs(), slope)
    }
    #[inline(always)]
    fn if_positive(self, yes: Self, no: Self) -> Self {
        if self.re > 0.0 { yes } else { no }
    }
    #[inline(always)]
    fn positive(self) -> bool {
        self.re > 0.0
    }
    #[inline(always)]
    fn size(self) -> f64 {
        self.re.abs()
    }
    #[inline(always)]
    fn fastest<L: Loop<Self>>(task: L) -> L::Output {
        tangent::run(task)
    }
    #[inline(always)]
    fn compact<L: Loop<Self>>(task: L) -> L::Output {
        tangent::compact(task)
    }
    #[inline(always)]
    fn abreast<L: Abreast<Self>>(task: L) -> Option<L::Output> {
        beside::run(task)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::real::testing::formula;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn duals_agree_with_difference_quotients(x in -2.0..2.0f64, y in -2.0..2.0f64) {
            prop_assume!((x - 0.2).abs() > 1e-3 && x.abs() > 1e-2 && y.abs() > 1e-2);
            let d = formula(Dual::<2>::variable(x, 0), Dual::<2>::variable(y, 1));
            prop_assert_eq!(d.re, formula(x, y));
            let along = |h: f64| [formula(x + h, y) - formula(x - h, y), formula(x, y + h) - formula(x, y - h)].map(|d| d / (2.0 * h));
            let h = 1e-5;
            let (near, far) = (along(h), along(2.0 * h));
            for k in 0..2 {
                // A central quotient is off by a third of what it changes by where the step is doubled, and by the rounding of a
                // formula whose terms reach 16 and take some roundings each, over the step.
                let allowed = (far[k] - near[k]).abs() + 64.0 * f64::EPSILON / h;
                prop_assert!((d.eps[k] - near[k]).abs() <= allowed, "{k}: {} {}", d.eps[k], near[k]);
            }
        }
    }

    #[test]
    fn power_of_zero_is_zero_with_finite_derivatives() {
        let p = Dual::<2>::variable(0.0, 0).pow_nonnegative(Dual::<2>::variable(2.5, 1));
        assert_eq!((p.re, p.eps), (0.0, [0.0, 0.0]));
    }
}
