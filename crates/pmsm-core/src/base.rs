//! The base parameters of a machine as the equations use them.

use crate::numerics::real::Real;

/// Base parameters unpacked, with the reciprocals that the inner loop needs.
#[derive(Debug, Clone, Copy)]
pub struct Base<T> {
    /// Stator resistance, Ω.
    pub r_s: T,
    /// d-axis inductance, H.
    pub l_d: T,
    /// q-axis inductance, H.
    pub l_q: T,
    /// 1/l_d, 1/H.
    pub inverse_l_d: T,
    /// 1/l_q, 1/H.
    pub inverse_l_q: T,
    /// Magnet flux linkage, V s.
    pub psi_m: T,
    /// Inertia, kg m².
    pub j: T,
    /// 1/j, 1/(kg m²).
    pub inverse_j: T,
    /// Viscous friction, N m s.
    pub b: T,
}

impl<T: Real> Base<T> {
    /// From a parameter vector whose first six entries are in the order of [`crate::machine::BaseParameter::ALL`].
    pub fn new(p: &[T]) -> Self {
        let [r_s, l_d, l_q, psi_m, j, b] = [p[0], p[1], p[2], p[3], p[4], p[5]];
        let one = T::one();
        Self {
            r_s,
            l_d,
            l_q,
            inverse_l_d: one / l_d,
            inverse_l_q: one / l_q,
            psi_m,
            j,
            inverse_j: one / j,
            b,
        }
    }
}

/// Number of base parameters at the head of every parameter vector.
pub const BASE: usize = 6;
