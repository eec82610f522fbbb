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
//! is evaluated, y' = (y_2 + 2y_3 + y_4 − y + F(y_4))/3, with 2W_3 and W_4/3 in place of W_3 and W_4, so that products come out as
//! large as they are needed: two multiplications and additions in a row per stage and nothing else, as what the last value does
//! not decide is summed up beforehand. A single vector waits for them, not for its arithmetic. Form [`ROUND`] is the same where K_1 is
//! zero. Form [`INCREMENTS`] adds the small increments instead, y' = y + (F_1 + 2F_2 + 2F_3 + F_4)/3, and rounds less.

use crate::numerics::lanes::Lane;

/// The fast form.
pub const STAGES: u8 = 0;
/// The fast form where every l_d = l_q, as with magnets on the surface: the torque is λ·K_2, of the same bits for less work.
pub const ROUND: u8 = 1;
/// The accurate form.
pub const INCREMENTS: u8 = 2;

/// Numbers per parameter set in [`Coefficients`].
pub const COEFFICIENTS: usize = 27;
/// Which of them is K_1, zero without saliency.
pub const K_1: usize = 9;

/// What a parameter set contributes to the equations, one vector each.
#[derive(Debug, Clone, Copy)]
pub struct Coefficients<V> {
    u_0: V,
    t: V,
    load: V,
    show_d: V,
    show_q: V,
    zero_d: V,
    /// F itself.
    once: Rates<V>,
    /// y + F(y), 2(y + F), (y + 2F)/3 and (y + F)/3 with what of y stands in the linear part, for ψ, λ and W each as the next
    /// stage wants it.
    stages: [Rates<V>; 4],
}

/// The constants of one evaluation of the equations.
#[derive(Debug, Clone, Copy)]
struct Rates<V> {
    d: V,
    q: V,
    w: V,
    k_1: V,
    k_2: V,
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
    let per_load = -g * g * n_p * inverse_j;
    let (k_1, k_2) = (kappa * (inverse_q - inverse_d), kappa * psi_m * inverse_d);
    let third = 1.0 / 3.0;
    [
        a_d * psi_m,
        per_load * tau_load,
        per_load,
        current * inverse_d,
        current * inverse_q,
        -current * psi_m * inverse_d,
        a_d,
        a_q,
        c,
        k_1,
        k_2,
        // W_2 = W + F(W): y is in the linear part.
        a_d - 1.0,
        a_q - 1.0,
        c - 1.0,
        // 2·W_3 = 2(W + F(W_2)), of ψ and λ the same but once.
        2.0 * c,
        2.0 * k_1,
        2.0 * k_2,
        // W_4/3 = (W + 2F(W_3))/3, with 2·W_3 in the linear part; ψ and λ thrice that.
        2.0 * a_d,
        2.0 * a_q,
        c * third,
        2.0 * k_1 * third,
        2.0 * k_2 * third,
        // (y_4 + F(y_4))/3, with W_4/3 in the linear part.
        (a_d - 1.0) * third,
        (a_q - 1.0) * third,
        c - 1.0,
        k_1 * third,
        k_2 * third,
    ]
}

/// The scaled state of a parameter set at given i_d, i_q (A), ω_e (rad/s).
pub fn state(scale: &Scale, p: &[f64], i: [f64; 2], omega_e: f64) -> [f64; 3] {
    [p[1] * i[0] + p[3], p[2] * i[1], scale.g * omega_e]
}

/// One sample as the kernel reads it: g·v_d, g·v_q of the interval that begins here, the weighted measurements −i_d, −i_q, −ω_e,
/// and the load torque known from the recording, N·m. In memory the last one is left out where nothing is known of a load.
pub type Sample<V> = [V; 6];

/// Numbers per sample in memory.
pub const fn fields(has_load: bool) -> usize {
    if has_load { 6 } else { 5 }
}

impl<V: Lane> Coefficients<V> {
    /// From [`COEFFICIENTS`] rows of numbers, each `stride` long, of which the columns from `at` are taken.
    #[inline(always)]
    pub fn load(rows: &[f64], stride: usize, at: usize) -> Self {
        macro_rules! row {
            ($n:literal) => {
                V::load(&rows[$n * stride + at..])
            };
        }
        macro_rules! rates {
            ($d:literal $q:literal $w:literal $k_1:literal $k_2:literal) => {
                Rates { d: row!($d), q: row!($q), w: row!($w), k_1: row!($k_1), k_2: row!($k_2) }
            };
        }
        Self {
            u_0: row!(0),
            t: row!(1),
            load: row!(2),
            show_d: row!(3),
            show_q: row!(4),
            zero_d: row!(5),
            once: rates!(6 7 8 9 10),
            stages: [
                rates!(11 12 13 9 10),
                rates!(6 7 14 15 16),
                rates!(17 18 19 20 21),
                rates!(22 23 24 25 26),
            ],
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
    pub fn step<const FORM: u8, const LOAD: bool>(&self, y: [V; 3], sample: &Sample<V>) -> [V; 3] {
        let t = if LOAD { sample[5].mul_add(self.load, self.t) } else { self.t };
        let u = [self.u_0 + sample[0], sample[1], t];
        if FORM == INCREMENTS { self.increments(y, u) } else { self.stages::<FORM>(y, u) }
    }

    #[inline(always)]
    fn stages<const FORM: u8>(&self, y: [V; 3], u: [V; 3]) -> [V; 3] {
        let (third, two_thirds) = (V::constant(1.0 / 3.0), V::constant(2.0 / 3.0));
        // y + F(y) with y in the linear part, so that it need not be added first.
        let y2 = Self::slope::<FORM>(y, &self.stages[0], u);
        let b = [y[0] + u[0], y[1] + u[1], y[2] + u[2]];
        let y3 = Self::slope::<FORM>(y2, &self.stages[1], [b[0], b[1], b[2] + b[2]]);
        let y4 = Self::slope::<FORM>(y3, &self.stages[2], [b[0] + u[0], b[1] + u[1], (b[2] + u[2]) * third]);
        let z = [
            y3[0].mul_add(two_thirds, ((y2[0] - y[0]) + u[0]) * third),
            y3[1].mul_add(two_thirds, ((y2[1] - y[1]) + u[1]) * third),
            (((y2[2] - y[2]) + u[2]) + y3[2]) * third,
        ];
        Self::slope::<FORM>(y4, &self.stages[3], z)
    }

    #[inline(always)]
    fn increments(&self, y: [V; 3], u: [V; 3]) -> [V; 3] {
        let (two, third) = (V::constant(2.0), V::constant(1.0 / 3.0));
        let f1 = Self::slope::<INCREMENTS>(y, &self.once, u);
        let y2 = [y[0] + f1[0], y[1] + f1[1], y[2] + f1[2]];
        let f2 = Self::slope::<INCREMENTS>(y2, &self.once, u);
        let y3 = [y[0] + f2[0], y[1] + f2[1], y[2] + f2[2]];
        let f3 = Self::slope::<INCREMENTS>(y3, &self.once, u);
        let y4 = [y[0] + f3[0] * two, y[1] + f3[1] * two, y[2] + f3[2] * two];
        let f4 = Self::slope::<INCREMENTS>(y4, &self.once, u);
        [
            y[0] + ((f1[0] + f4[0]) + (f2[0] + f3[0]) * two) * third,
            y[1] + ((f1[1] + f4[1]) + (f2[1] + f3[1]) * two) * third,
            y[2] + ((f1[2] + f4[2]) + (f2[2] + f3[2]) * two) * third,
        ]
    }

    /// The equations, written here alone: `plus` and, of a multiple of F = g·dy/dt at y = ψ, λ, W, all but the constants. The
    /// multiple is in the rates; that of W·λ and W·ψ is in W.
    #[inline(always)]
    fn slope<const FORM: u8>([psi, lambda, w]: [V; 3], with: &Rates<V>, plus: [V; 3]) -> [V; 3] {
        let torque = if FORM == ROUND { with.k_2 } else { with.k_1.mul_add(psi, with.k_2) };
        [
            w.mul_add(lambda, with.d.neg_mul_add(psi, plus[0])),
            w.neg_mul_add(psi, with.q.neg_mul_add(lambda, plus[1])),
            lambda.mul_add(torque, with.w.neg_mul_add(w, plus[2])),
        ]
    }
}
