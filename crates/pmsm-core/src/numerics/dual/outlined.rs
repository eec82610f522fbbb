//! Dual numbers whose arithmetic is called and not inlined: the same bits in a tenth of the machine code.
//!
//! A model's right-hand side on wide dual numbers, inlined, is most of what there is to compile. On x86-64 it serves
//! processors without AVX2 alone, and what is not hot; both may be slower for it.

use super::Dual;
use crate::numerics::real::{Carries, Real};
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// A dual number that stands for itself, or for one of fewer derivatives.
#[derive(Debug, Clone, Copy)]
pub struct Outlined<const N: usize>(Dual<N>);

impl<const N: usize, const FEWER: usize> Carries<Dual<FEWER>> for Outlined<N> {
    #[inline(always)]
    fn carry(x: Dual<FEWER>) -> Self {
        let mut own = Dual::constant(x.re);
        own.eps[..FEWER].copy_from_slice(&x.eps);
        Self(own)
    }
    #[inline(always)]
    fn give(self) -> Dual<FEWER> {
        Dual { re: self.0.re, eps: std::array::from_fn(|k| self.0.eps[k]) }
    }
}

macro_rules! called {
    ($trait:ident, $method:ident) => {
        impl<const N: usize> $trait for Outlined<N> {
            type Output = Self;
            #[inline(never)]
            fn $method(self, other: Self) -> Self {
                Self(self.0.$method(other.0))
            }
        }
    };
    ($trait:ident, $method:ident, f64) => {
        impl<const N: usize> $trait<f64> for Outlined<N> {
            type Output = Self;
            #[inline(never)]
            fn $method(self, other: f64) -> Self {
                Self(self.0.$method(other))
            }
        }
    };
    ($trait:ident, $method:ident, mut) => {
        impl<const N: usize> $trait for Outlined<N> {
            #[inline(never)]
            fn $method(&mut self, other: Self) {
                self.0.$method(other.0);
            }
        }
    };
}
called!(Add, add);
called!(Sub, sub);
called!(Mul, mul);
called!(Div, div);
called!(Add, add, f64);
called!(Sub, sub, f64);
called!(Mul, mul, f64);
called!(AddAssign, add_assign, mut);
called!(SubAssign, sub_assign, mut);

impl<const N: usize> Neg for Outlined<N> {
    type Output = Self;
    #[inline(never)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl<const N: usize> Real for Outlined<N> {
    const CALLED: bool = true;
    #[inline(never)]
    fn constant(x: f64) -> Self {
        Self(Dual::constant(x))
    }
    #[inline(never)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }
    #[inline(never)]
    fn sin_cos(self) -> (Self, Self) {
        let (s, c) = self.0.sin_cos();
        (Self(s), Self(c))
    }
    #[inline(never)]
    fn exp(self) -> Self {
        Self(self.0.exp())
    }
    #[inline(never)]
    fn ln(self) -> Self {
        Self(self.0.ln())
    }
    #[inline(never)]
    fn tanh(self) -> Self {
        Self(self.0.tanh())
    }
    #[inline(never)]
    fn abs(self) -> Self {
        Self(self.0.abs())
    }
    #[inline(never)]
    fn if_positive(self, yes: Self, no: Self) -> Self {
        Self(self.0.if_positive(yes.0, no.0))
    }
    #[inline(never)]
    fn pow_nonnegative(self, exponent: Self) -> Self {
        Self(self.0.pow_nonnegative(exponent.0))
    }
    fn positive(self) -> bool {
        self.0.positive()
    }
    fn size(self) -> f64 {
        self.0.size()
    }
}
