//! The number type over which every equation of the core is written once: plain `f64`, [`crate::numerics::dual::Dual`], which
//! carries exact derivatives along, or a vector of numbers ([`crate::numerics::lanes::Lane`]).

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// A real number as the model equations need it. Equations never branch on a value, so that a type
/// may stand for many particles at once; choices are made with [`Real::if_positive`].
pub trait Real:
    Copy
    + Debug
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
{
    /// Whether its arithmetic is called and not inlined, so that equations are better called, too.
    const CALLED: bool = false;
    /// The constant `x`.
    fn constant(x: f64) -> Self;
    /// Zero.
    #[inline(always)]
    fn zero() -> Self {
        Self::constant(0.0)
    }
    /// One.
    #[inline(always)]
    fn one() -> Self {
        Self::constant(1.0)
    }
    /// Square root; the derivative at zero is taken as zero.
    fn sqrt(self) -> Self;
    /// Sine and cosine.
    fn sin_cos(self) -> (Self, Self);
    /// Exponential.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Hyperbolic tangent.
    fn tanh(self) -> Self;
    /// Absolute value; the derivative at zero is zero.
    fn abs(self) -> Self;
    /// `yes` where the number is greater than zero, else `no`.
    fn if_positive(self, yes: Self, no: Self) -> Self;
    /// Whether the number is greater than zero; for choices outside the inner loops, where a number is one number.
    fn positive(self) -> bool;
    /// Absolute value as a plain number, the largest of several; for choices outside the inner loops.
    fn size(self) -> f64;
    /// `self` to the power `exponent` for a non-negative base; zero (with zero derivative) at base zero.
    #[inline(always)]
    fn pow_nonnegative(self, exponent: Self) -> Self {
        let safe = (self - 1e-300).if_positive(self, Self::one());
        let power = (exponent * safe.ln()).exp();
        (self - 1e-300).if_positive(power, Self::zero())
    }
    /// Square.
    #[inline(always)]
    fn squared(self) -> Self {
        self * self
    }
    /// Runs a long loop over numbers of this type on the type that holds the same numbers, bit for bit, and that this
    /// processor computes fastest.
    #[inline(always)]
    fn fastest<L: Loop<Self>>(task: L) -> L::Output {
        task.run::<Self>()
    }
    /// Runs a loop that is not hot on the type that holds the same numbers, bit for bit, and takes the least machine code.
    #[inline(always)]
    fn compact<L: Loop<Self>>(task: L) -> L::Output {
        task.run::<Self>()
    }
    /// Runs a task whose parts do not wait for one another on vectors of several parts each, with the bits of one at a
    /// time; nothing where this processor has no vectors for numbers of this type.
    #[inline(always)]
    fn abreast<L: Abreast<Self>>(_: L) -> Option<L::Output> {
        None
    }
    /// Runs a task as a function of its own that is compiled with this type's instructions, for what is too long to be inlined wherever it
    /// is asked for.
    #[inline(always)]
    fn apart<K: Task<U>, U: Real>(task: K) -> K::Output {
        #[inline(never)]
        fn called<K: Task<U>, U: Real>(task: K) -> K::Output {
            task.run()
        }
        called(task)
    }
}

/// A task on numbers of type `T`, run by [`Real::apart`].
pub trait Task<T> {
    /// What it returns.
    type Output;
    /// The task. Implementations are `#[inline(always)]`.
    fn run(self) -> Self::Output;
}

/// A number type that stands for `T` in an inner loop: conversions there and back change no bit.
pub trait Carries<T>: Real {
    /// The same number in this type.
    fn carry(x: T) -> Self;
    /// The same number in the type that it stands for.
    fn give(self) -> T;
}

impl<T: Real> Carries<T> for T {
    #[inline(always)]
    fn carry(x: T) -> Self {
        x
    }
    #[inline(always)]
    fn give(self) -> T {
        self
    }
}

/// A long loop over numbers of type `T`, run by [`Real::fastest`].
pub trait Loop<T> {
    /// What it returns.
    type Output;
    /// The loop over the type that stands for `T`. Implementations are `#[inline(always)]`.
    fn run<W: Carries<T>>(self) -> Self::Output;
}

/// [`Self::COUNT`] numbers of type `T` side by side.
pub trait Several<T>: Real {
    /// How many.
    const COUNT: usize;
    /// The first of a slice.
    ///
    /// # Panics
    /// If there are fewer than [`Self::COUNT`].
    fn of(from: &[T]) -> Self;
    /// The first of a slice of plain numbers.
    ///
    /// # Panics
    /// If there are fewer than [`Self::COUNT`].
    fn plain(from: &[f64]) -> Self;
    /// The same number everywhere.
    fn all(x: T) -> Self;
    /// Writes them to the head of a slice.
    ///
    /// # Panics
    /// If there is no room.
    fn put(self, to: &mut [T]);
}

/// A task whose parts do not wait for one another, run by [`Real::abreast`].
pub trait Abreast<T> {
    /// What it returns.
    type Output;
    /// Derivatives that a number must carry for several at a time to be worth it.
    const FEWEST: usize;
    /// The task, several at a time. Implementations are `#[inline(always)]`.
    fn run<W: Several<T>>(self) -> Self::Output;
}

#[cfg(test)]
pub(crate) mod testing {
    use super::Real;

    /// A formula that uses every operation.
    #[inline(always)]
    pub(crate) fn formula<T: Real>(x: T, y: T) -> T {
        let (s, c) = (x * y).sin_cos();
        let a = (x.squared() + 1.0).sqrt() / (y.squared() + 2.0);
        let b = (x - y).tanh() * s - (c * 0.3).exp() + (y.squared() + 1.5).ln();
        (x - 0.2).if_positive(a, -a) + b + x.abs().pow_nonnegative(y.abs() + 1.0) - 0.7
    }
}
