//! Missing voltage or torque, or the error of the logged angle, as a map over operating variables: what no effect of the catalogue explains,
//! modelled without a name.
//!
//! A map is a sum of parts. A part acts on the voltage equations, on the equation of motion, or on the measured angle. It is a tensor product
//! of one or two [`Factor`]s with one coefficient per product and equation:
//!
//! > v_lost,d += Σ_ab c_ab f_a(x) g_b(y)  (q alike),  τ_loss += Σ_ab c_ab f_a(x) g_b(y),  θ_measured = θ_e + Σ_ab c_ab f_a(x) g_b(y).
//!
//! What is lost of the voltage may be a share of the command, as where the voltage of the DC link is not what was logged:
//!
//! > v_lost += v_command · Σ_ab c_ab f_a(x) g_b(y).
//!
//! It is linear in its coefficients, and with all of them at zero the model is the same bit for bit.

mod factor;

pub use factor::{Factor, MOST, Point, Spline, Variable};

use crate::effect::{Env, Site};
use crate::numerics::real::Real;
use serde::{Deserialize, Serialize};

/// An equation that a map adds to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Equation {
    /// Voltage equation of the d axis, V.
    D,
    /// Voltage equation of the q axis, V.
    Q,
    /// Both voltage equations, as a share of the commanded voltage.
    Link,
    /// Equation of motion, N·m against positive rotation.
    Mechanical,
    /// Rotor angle that is measured, electrical rad ahead of the true one.
    Sensor,
}

impl Equation {
    /// Where it acts.
    pub fn site(self) -> Site {
        match self {
            Self::D | Self::Q | Self::Link => Site::Electrical,
            Self::Mechanical => Site::Mechanical,
            Self::Sensor => Site::Sensor,
        }
    }

    /// SI unit of what the map adds.
    pub fn unit(self) -> &'static str {
        match self {
            Self::D | Self::Q => "V",
            Self::Link => "1",
            Self::Mechanical => "N m",
            Self::Sensor => "rad",
        }
    }
}

/// One tensor product with its coefficients' equations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Equations it adds to, with coefficients of their own: voltage equations, or that of motion, or the angle.
    pub equations: Vec<Equation>,
    /// The first factor; its functions count slowest among the coefficients.
    pub first: Factor,
    /// The second factor, if it depends on two variables.
    #[serde(default)]
    pub second: Option<Factor>,
}

impl Part {
    /// Coefficients per equation.
    pub fn size(&self) -> usize {
        self.first.count() * self.second.as_ref().map_or(1, Factor::count)
    }

    /// All coefficients: those of the first equation, then those of the second.
    pub fn count(&self) -> usize {
        self.equations.len() * self.size()
    }

    /// Where it acts: the equations of a part are all of one kind.
    pub fn site(&self) -> Site {
        self.equations.first().map_or(Site::Electrical, |equation| equation.site())
    }

    /// Its factors.
    pub fn factors(&self) -> impl Iterator<Item = &Factor> {
        std::iter::once(&self.first).chain(&self.second)
    }

    /// Adds its values at a point: d and q voltage, V, or in the first place torque, N·m, or angle, rad.
    #[inline(always)]
    pub fn add<T: Real>(&self, p: &[T], at: &Point<T>, out: &mut [T; 2]) {
        let (mut first, mut second) = ([T::zero(); MOST], [T::zero(); MOST]);
        second[0] = T::one();
        let n = self.first.fill(at, &mut first);
        let m = match &self.second {
            Some(factor) => factor.fill(at, &mut second),
            None => 1,
        };
        for (own, equation) in p.chunks_exact(n * m).zip(&self.equations) {
            let mut sum = T::zero();
            for (row, f) in own.chunks_exact(m).zip(&first) {
                let mut inner = T::zero();
                for (c, g) in row.iter().zip(&second) {
                    inner += *c * *g;
                }
                sum += inner * *f;
            }
            match equation {
                Equation::Q => out[1] += sum,
                Equation::Link => {
                    out[0] += sum * at.v[0];
                    out[1] += sum * at.v[1];
                }
                Equation::D | Equation::Mechanical | Equation::Sensor => out[0] += sum,
            }
        }
    }

    /// Its value (rad) as one of the measured angle, and how that changes with the electrical angle of a rotor with `n_p` pole pairs.
    #[inline(always)]
    fn angle<T: Real>(&self, p: &[T], at: &Point<T>, n_p: f64) -> [T; 2] {
        let (mut first, mut slope) = ([T::zero(); MOST], [T::zero(); MOST]);
        let n = self.first.fill(at, &mut first);
        self.first.slope(&first, n_p, &mut slope);
        let mut second = [T::zero(); MOST];
        second[0] = T::one();
        let m = self.second.as_ref().map_or(1, |factor| factor.fill(at, &mut second));
        let mut out = [T::zero(); 2];
        for (row, (f, df)) in p.chunks_exact(m).zip(first.iter().zip(&slope)).take(n) {
            let mut inner = T::zero();
            for (c, g) in row.iter().zip(&second) {
                inner += *c * *g;
            }
            out[0] += inner * *f;
            out[1] += inner * *df;
        }
        out
    }

    /// Writes what each coefficient multiplies at a point, in the order of the coefficients.
    pub fn functions(&self, at: &Point<f64>, out: &mut [f64]) {
        let (mut first, mut second) = ([0.0; MOST], [0.0; MOST]);
        second[0] = 1.0;
        let n = self.first.fill(at, &mut first);
        let m = self.second.as_ref().map_or(1, |factor| factor.fill(at, &mut second));
        for own in out.chunks_exact_mut(n * m) {
            for (row, f) in own.chunks_exact_mut(m).zip(&first) {
                row.iter_mut().zip(&second).for_each(|(value, g)| *value = f * g);
            }
        }
    }

    /// Turns its coefficients to a mechanical zero that lies `shift` (rad) further; says whether that changes them.
    fn turned(&self, p: &mut [f64], shift: f64) -> bool {
        let m = self.second.as_ref().map_or(1, Factor::count);
        let (order, count, first) = match self.first {
            Factor::Harmonics { angle: Variable::ThetaM, order, count } => (f64::from(order), count, 0),
            Factor::Fourier { angle: Variable::ThetaM, count } => (1.0, count, 1),
            _ => return false,
        };
        for own in p.chunks_exact_mut(self.size()) {
            for k in 0..count {
                let (s, c) = Real::sin_cos(order * (k + 1) as f64 * shift);
                for b in 0..m {
                    let x = (first + 2 * k) * m + b;
                    let y = x + m;
                    (own[x], own[y]) = (own[x] * c - own[y] * s, own[x] * s + own[y] * c);
                }
            }
        }
        true
    }
}

/// A sum of parts.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Map {
    /// Its parts, whose coefficients follow one another.
    pub parts: Vec<Part>,
}

impl Map {
    /// Number of coefficients.
    pub fn count(&self) -> usize {
        self.parts.iter().map(Part::count).sum()
    }

    /// Each part with the place of its coefficients.
    pub fn places(&self) -> impl Iterator<Item = (&Part, std::ops::Range<usize>)> {
        self.parts.iter().scan(0, |at, part| {
            let from = *at;
            *at += part.count();
            Some((part, from..*at))
        })
    }

    /// Where coefficient `index` acts.
    pub fn site(&self, index: usize) -> Option<Site> {
        self.places().find(|(_, place)| place.contains(&index)).map(|(part, _)| part.site())
    }

    /// Whether it holds an error of the measured angle.
    pub fn has_angle(&self) -> bool {
        self.parts.iter().any(|part| part.site() == Site::Sensor)
    }

    /// Adds the voltage (d, q) that is lost between command and winding, V.
    #[inline(always)]
    pub fn voltage<T: Real>(&self, p: &[T], at: &Point<T>, lost: &mut [T; 2]) {
        let mut from = 0;
        for part in &self.parts {
            let to = from + part.count();
            if part.site() == Site::Electrical {
                part.add(&p[from..to], at, lost);
            }
            from = to;
        }
    }

    /// By how much (electrical rad) the measured angle is ahead of the true one, and how that changes with the electrical angle of a rotor with
    /// `n_p` pole pairs.
    #[inline(always)]
    pub fn angle<T: Real>(&self, p: &[T], env: &Env<T>, n_p: f64) -> [T; 2] {
        let at = Point { env: *env, i: [T::zero(); 2], v: [T::zero(); 2], tau_e: T::zero() };
        let mut sum = [T::zero(); 2];
        for (part, place) in self.places().filter(|(part, _)| part.site() == Site::Sensor) {
            let [angle, slope] = part.angle(&p[place], &at, n_p);
            sum[0] += angle;
            sum[1] += slope;
        }
        sum
    }

    /// The torque that is lost against positive rotation, N·m.
    #[inline(always)]
    pub fn torque<T: Real>(&self, p: &[T], at: &Point<T>) -> T {
        let mut loss = [T::zero(); 2];
        let mut from = 0;
        for part in &self.parts {
            let to = from + part.count();
            if part.site() == Site::Mechanical {
                part.add(&p[from..to], at, &mut loss);
            }
            from = to;
        }
        loss[0]
    }

    /// Turns the coefficients `p` to a mechanical zero that lies `shift` (rad) further; says whether that changes any.
    pub fn turned(&self, p: &mut [f64], shift: f64) -> bool {
        let mut any = false;
        for (part, place) in self.places() {
            any |= part.turned(&mut p[place], shift);
        }
        any
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::env;

    fn point(theta_e: f64, omega_e: f64, i_q: f64) -> Point<f64> {
        Point { env: env(theta_e, omega_e), i: [0.0, i_q], v: [0.0; 2], tau_e: 0.0 }
    }

    fn harmonics(angle: Variable) -> Factor {
        Factor::Harmonics { angle, order: 2, count: 2 }
    }

    #[test]
    fn a_product_of_two_factors_adds_to_each_equation_its_own_sum() {
        let line = Spline {
            variable: Variable::IQ,
            low: -4.0,
            high: 4.0,
            degree: 1,
            pieces: 1,
            warp: 0.0,
            odd: false,
        };
        let part = Part {
            equations: vec![Equation::D, Equation::Q],
            first: harmonics(Variable::ThetaE),
            second: Some(Factor::Spline(line)),
        };
        assert_eq!((part.size(), part.count()), (8, 16));
        let mut p = vec![0.0; 16];
        // d: cos 2θ, rising from 1 to 3 with i_q; q: sin 4θ at any i_q.
        (p[0], p[1]) = (1.0, 3.0);
        (p[8 + 6], p[8 + 7]) = (0.5, 0.5);
        let mut lost = [0.0; 2];
        Map { parts: vec![part] }.voltage(&p, &point(0.3, 10.0, 2.0), &mut lost);
        assert!((lost[0] - 2.5 * 0.6f64.cos()).abs() < 1e-12);
        assert!((lost[1] - 0.5 * 1.2f64.sin()).abs() < 1e-12);
    }

    #[test]
    fn parts_keep_to_their_equations() {
        let wave = |equations, angle| Part { equations, first: harmonics(angle), second: None };
        let map = Map {
            parts: vec![
                wave(vec![Equation::Q], Variable::ThetaE),
                wave(vec![Equation::Mechanical], Variable::ThetaM),
            ],
        };
        let p = [1.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0];
        assert_eq!([3, 4, 8].map(|k| map.site(k)), [Some(Site::Electrical), Some(Site::Mechanical), None]);
        let at = point(0.6, 10.0, 0.0);
        let mut lost = [0.0; 2];
        map.voltage(&p, &at, &mut lost);
        assert_eq!(lost, [0.0, 1.2f64.cos()]);
        assert!((map.torque(&p, &at) - 2.0 * (2.0 * at.env.theta_m).sin()).abs() < 1e-12);
    }

    #[test]
    fn a_share_of_the_command_takes_as_much_of_both_axes() {
        let first = Factor::Swing { frequency: 50.0, count: 2 };
        let map = Map { parts: vec![Part { equations: vec![Equation::Link], first, second: None }] };
        let mut at = point(0.3, 10.0, 2.0);
        (at.v, at.env.t) = ([10.0, -4.0], 0.002);
        let mut lost = [0.0; 2];
        map.voltage(&[0.1, 0.0, 0.0, 0.02], &at, &mut lost);
        let turn = std::f64::consts::TAU * 50.0 * 0.002;
        let share = 0.1 * turn.cos() + 0.02 * (2.0 * turn).sin();
        assert!((lost[0] - 10.0 * share).abs() < 1e-12 && (lost[1] + 4.0 * share).abs() < 1e-12);
        assert_eq!((map.site(3), Equation::Link.unit()), (Some(Site::Electrical), "1"));
    }

    #[test]
    fn an_angle_error_comes_with_its_slope_over_the_electrical_angle() {
        let first = Factor::Fourier { angle: Variable::ThetaM, count: 2 };
        let part = Part { equations: vec![Equation::Sensor], first, second: None };
        let map = Map { parts: vec![part] };
        let (p, n_p, h) = ([0.1, 0.03, -0.02, 0.01, 0.04], 3.0, 1e-6);
        let at = |theta_e: f64| {
            let mut here = env(theta_e, 100.0);
            here.theta_m = theta_e / n_p;
            map.angle(&p, &here, n_p)
        };
        let difference = (at(1.7 + h)[0] - at(1.7 - h)[0]) / (2.0 * h);
        assert!((at(1.7)[1] - difference).abs() < 1e-9);
        assert!(map.has_angle() && map.site(0) == Some(Site::Sensor));
        let mut lost = [0.0; 2];
        map.voltage(&p, &point(1.7, 100.0, 0.0), &mut lost);
        assert_eq!((lost, map.torque(&p, &point(1.7, 100.0, 0.0))), ([0.0; 2], 0.0));
    }

    #[test]
    fn a_map_over_the_revolution_turns_with_its_zero() {
        let part =
            Part { equations: vec![Equation::Mechanical], first: harmonics(Variable::ThetaM), second: None };
        let map = Map { parts: vec![part] };
        let (p, mut q) = ([0.3, -0.2, 0.1, 0.4], [0.3, -0.2, 0.1, 0.4]);
        assert!(map.turned(&mut q, 0.7));
        let mut behind = point(3.0, 0.0, 0.0);
        behind.env.theta_m -= 0.7;
        assert!((map.torque(&q, &point(3.0, 0.0, 0.0)) - map.torque(&p, &behind)).abs() < 1e-12);
        let first = Factor::Fourier { angle: Variable::ThetaM, count: 2 };
        let angle = Map { parts: vec![Part { equations: vec![Equation::Sensor], first, second: None }] };
        let (p, mut q) = ([0.1, 0.3, -0.2, 0.1, 0.4], [0.1, 0.3, -0.2, 0.1, 0.4]);
        assert!(angle.turned(&mut q, 0.7));
        let error = |p: &[f64], at: &Point<f64>| angle.angle(p, &at.env, 1.0)[0];
        assert!((error(&q, &point(3.0, 0.0, 0.0)) - error(&p, &behind)).abs() < 1e-12);
        let mut q = [0.3, -0.2, 0.1, 0.4];
        let electrical =
            Part { equations: vec![Equation::Q], first: harmonics(Variable::ThetaE), second: None };
        assert!(!Map { parts: vec![electrical] }.turned(&mut q, 0.7));
    }
}
