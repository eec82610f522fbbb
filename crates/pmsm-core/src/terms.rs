//! Terms and parameters that several effects share, so that no formula stands twice.

use crate::effect::{Context, Parameter, Role};
use crate::numerics::real::Real;

/// Share of the top speed over which a friction's sign turns over, where nothing better is known.
pub const SMOOTHING: f64 = 2e-3;

/// sgn ω_m, smoothed around standstill over a fixed share of the top speed.
#[inline(always)]
pub fn direction<T: Real>(omega_m: T, cx: &Context) -> T {
    (omega_m * (1.0 / (SMOOTHING * cx.omega_m_max()))).tanh()
}

/// The whole number that says which phase (0, 1, 2 for a, b, c).
pub const PHASE: Parameter = Parameter {
    name: "phase",
    unit: "1",
    meaning: "phase concerned: 0, 1, 2 for a, b, c",
    role: Role::Fixed,
    low: &|_| 0.0,
    high: &|_| 2.0,
    typical: &|_| 0.0,
};

/// 1 where `phase` is `index`, else 0.
#[inline(always)]
pub fn chosen<T: Real>(phase: T, index: usize) -> T {
    let off = (phase - index as f64).abs() - 0.5;
    off.if_positive(T::zero(), T::one())
}

/// Parameters shared by the saturations of both axes.
pub const SATURATION: [Parameter; 2] = [
    Parameter {
        name: "k",
        unit: "1",
        meaning: "extra current at the largest flux linkage, share of the linear one",
        role: Role::Amplitude,
        low: &|_| 0.0,
        // An axis that the magnet leaves empty fills to a small share of the largest flux linkage, which counts by the power s.
        high: &|_| 1e5,
        typical: &|_| 0.2,
    },
    Parameter {
        name: "s",
        unit: "1",
        meaning: "exponent: how sharp the knee is",
        role: Role::Shape,
        low: &|_| 0.5,
        high: &|_| 10.0,
        typical: &|_| 2.0,
    },
];

/// Current Δi = (k/l)·(|λ|/λ_0)^s·λ and its derivative with respect to λ.
#[inline(always)]
pub fn extra_current<T: Real>(p: &[T], inverse_l: T, flux: T, cx: &Context) -> (T, T) {
    let reach = (flux.abs() * (1.0 / cx.psi_max)).pow_nonnegative(p[1]);
    let slope = p[0] * inverse_l * reach;
    (slope * flux, slope * (p[1] + 1.0))
}
