//! One Runge–Kutta step of the bare machine in scaled flux states, for a vector of parameter sets.
//!
//! With g half a step, the states are the flux linkages ψ = λ_d and λ = λ_q (V s) and W = g·ω_e; then g times each
//! derivative of the dq-model (1)–(3) needs no division:
//!
//! ```text
//! g·dψ/dt = u_d − a_d·ψ + W·λ          u_d = g·v_d + a_d·ψ_m,  a_d = g·r_s/l_d
//! g·dλ/dt = u_q − a_q·λ − W·ψ          u_q = g·v_q,            a_q = g·r_s/l_q
//! g·dW/dt = λ·(K_1·ψ + K_2) − c·W − t   K_1 = κ·(1/l_q − 1/l_d), K_2 = κ·ψ_m/l_d, κ = g²·3/2·n_p²/j,
//!                                       c = g·b/j,  t = g²·n_p·τ_load/j
//! ```
//!
//! Form [`STAGES`] writes the classical method in the values y_2 = y + F(y), y_3 = y + F(y_2), y_4 = y + 2F(y_3) at which F = g·dy/dt
//! is evaluated, y' = (y_2 + 2y_3 + y_4 − y + F(y_4))/3: two multiplications and additions in a row per stage. Form
//! [`INCREMENTS`] adds the small increments instead, y' = y + (F_1 + 2F_2 + 2F_3 + F_4)/3, and rounds less.

use crate::lanes::Lane;

/// The fast form.
pub const STAGES: bool = false;
/// The accurate form.
pub const INCREMENTS: bool = true;

/// Numbers per parameter set in [`Coefficients`].
pub const COEFFICIENTS: usize = 17;

/// What a parameter set contributes to the equations, one vector each.
#[derive(Debug, Clone, Copy)]
pub struct Coefficients<V> {
    u_0: V,
    a_d: V,
    a_q: V,
    k_1: V,
    k_2: V,
    c: V,
    t: V,
    a_d2: V,
    a_q2: V,
    c_2: V,
    e_d: V,
    e_q: V,
    e_w: V,
    show_d: V,
    show_q: V,
    zero_d: V,
    load: V,
}

/// Scales that all parameter sets share.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    /// Half a step, s.
    pub g: f64,
    /// Pole pairs.
    pub n_p: f64,
    /// Square root of what a squared error of i_d, i_q counts.
    pub current: f64,
}

/// The coefficients of one parameter set: r_s, l_d, l_q, psi_m, j, b, tau_load.
pub fn coefficients(scale: &Scale, p: &[f64]) -> [f64; COEFFICIENTS] {
    let [r_s, l_d, l_q, psi_m, j, b, tau_load] = [p[0], p[1], p[2], p[3], p[4], p[5], p[6]];
    let Scale { g, n_p, current } = *scale;
    let (inverse_d, inverse_q, inverse_j) = (1.0 / l_d, 1.0 / l_q, 1.0 / j);
    let (a_d, a_q, c) = (g * r_s * inverse_d, g * r_s * inverse_q, g * b * inverse_j);
    let kappa = g * g * 1.5 * n_p * n_p * inverse_j;
    let per_load = g * g * n_p * inverse_j;
    [
        a_d * psi_m,
        a_d,
        a_q,
        kappa * (inverse_q - inverse_d),
        kappa * psi_m * inverse_d,
        c,
        per_load * tau_load,
        2.0 * a_d,
        2.0 * a_q,
        2.0 * c,
        (1.0 - a_d) / 3.0,
        (1.0 - a_q) / 3.0,
        (1.0 - c) / 3.0,
        current * inverse_d,
        current * inverse_q,
        -current * psi_m * inverse_d,
        per_load,
    ]
}

/// The scaled state of a parameter set at given i_d, i_q (A), ω_e (rad/s).
pub fn state(scale: &Scale, p: &[f64], i: [f64; 2], omega_e: f64) -> [f64; 3] {
    [p[1] * i[0] + p[3], p[2] * i[1], scale.g * omega_e]
}

/// One sample as the kernel reads it: g·v_d, g·v_q of the interval that begins here, the weighted measurements −i_d, −i_q, −ω_e,
/// and the load torque known from the recording, N·m.
pub type Sample<V> = [V; 6];

impl<V: Lane> Coefficients<V> {
    /// From [`COEFFICIENTS`] rows of numbers, each `stride` long, of which the columns from `at` are taken.
    #[inline(always)]
    pub fn load(rows: &[f64], stride: usize, at: usize) -> Self {
        macro_rules! row {
            ($n:literal) => {
                V::load(&rows[$n * stride + at..])
            };
        }
        Self {
            u_0: row!(0),
            a_d: row!(1),
            a_q: row!(2),
            k_1: row!(3),
            k_2: row!(4),
            c: row!(5),
            t: row!(6),
            a_d2: row!(7),
            a_q2: row!(8),
            c_2: row!(9),
            e_d: row!(10),
            e_q: row!(11),
            e_w: row!(12),
            show_d: row!(13),
            show_q: row!(14),
            zero_d: row!(15),
            load: row!(16),
        }
    }

    /// Weighted errors of i_d, i_q, ω_e against a sample; `show_w` is the weight of ω_e over g.
    #[inline(always)]
    pub fn errors(&self, [psi, lambda, w]: [V; 3], sample: &Sample<V>, show_w: V) -> [V; 3] {
        [
            psi.mul_add(self.show_d, self.zero_d + sample[2]),
            lambda.mul_add(self.show_q, sample[3]),
            w.mul_add(show_w, sample[4]),
        ]
    }

    /// One step in the form `FORM`; with `LOAD` the sample's load torque counts.
    #[inline(always)]
    pub fn step<const FORM: bool, const LOAD: bool>(&self, y: [V; 3], sample: &Sample<V>) -> [V; 3] {
        let t = if LOAD { sample[5].mul_add(self.load, self.t) } else { self.t };
        let u_d = self.u_0 + sample[0];
        if FORM == INCREMENTS {
            self.increments(y, [u_d, sample[1], t])
        } else {
            self.stages(y, [u_d, sample[1], t])
        }
    }

    #[inline(always)]
    fn stages(&self, [psi, lambda, w]: [V; 3], [u_d, u_q, t]: [V; 3]) -> [V; 3] {
        let third = V::constant(1.0 / 3.0);
        // y + F(y) with the sum of what does not change begun beforehand.
        let (b_d, b_q, b_w) = (psi + u_d, lambda + u_q, w - t);
        let d2 = w.mul_add(lambda, self.a_d.neg_mul_add(psi, b_d));
        let q2 = w.neg_mul_add(psi, self.a_q.neg_mul_add(lambda, b_q));
        let w2 = lambda.mul_add(self.k_1.mul_add(psi, self.k_2), self.c.neg_mul_add(w, b_w));
        let d3 = w2.mul_add(q2, self.a_d.neg_mul_add(d2, b_d));
        let q3 = w2.neg_mul_add(d2, self.a_q.neg_mul_add(q2, b_q));
        let w3 = q2.mul_add(self.k_1.mul_add(d2, self.k_2), self.c.neg_mul_add(w2, b_w));
        let (twice_d, twice_q, twice_w) = (d3 + d3, q3 + q3, w3 + w3);
        let d4 = twice_w.mul_add(q3, self.a_d2.neg_mul_add(d3, b_d + u_d));
        let q4 = twice_w.neg_mul_add(d3, self.a_q2.neg_mul_add(q3, b_q + u_q));
        let w4 = twice_q.mul_add(self.k_1.mul_add(d3, self.k_2), self.c_2.neg_mul_add(w3, b_w - t));
        let z_d = ((d2 - psi) + (twice_d + u_d)) * third;
        let z_q = ((q2 - lambda) + (twice_q + u_q)) * third;
        let z_w = ((w2 - w) + (twice_w - t)) * third;
        let (third_w, third_q) = (w4 * third, q4 * third);
        [
            third_w.mul_add(q4, self.e_d.mul_add(d4, z_d)),
            third_w.neg_mul_add(d4, self.e_q.mul_add(q4, z_q)),
            third_q.mul_add(self.k_1.mul_add(d4, self.k_2), self.e_w.mul_add(w4, z_w)),
        ]
    }

    #[inline(always)]
    fn increments(&self, [psi, lambda, w]: [V; 3], u: [V; 3]) -> [V; 3] {
        let (two, third) = (V::constant(2.0), V::constant(1.0 / 3.0));
        let f1 = self.slope([psi, lambda, w], u);
        let f2 = self.slope([psi + f1[0], lambda + f1[1], w + f1[2]], u);
        let f3 = self.slope([psi + f2[0], lambda + f2[1], w + f2[2]], u);
        let f4 = self.slope([psi + f3[0] * two, lambda + f3[1] * two, w + f3[2] * two], u);
        [
            psi + ((f1[0] + f4[0]) + (f2[0] + f3[0]) * two) * third,
            lambda + ((f1[1] + f4[1]) + (f2[1] + f3[1]) * two) * third,
            w + ((f1[2] + f4[2]) + (f2[2] + f3[2]) * two) * third,
        ]
    }

    /// F = g·dy/dt.
    #[inline(always)]
    fn slope(&self, [psi, lambda, w]: [V; 3], [u_d, u_q, t]: [V; 3]) -> [V; 3] {
        [
            w.mul_add(lambda, self.a_d.neg_mul_add(psi, u_d)),
            w.neg_mul_add(psi, self.a_q.neg_mul_add(lambda, u_q)),
            lambda.mul_add(self.k_1.mul_add(psi, self.k_2), self.c.neg_mul_add(w, -t)),
        ]
    }
}
