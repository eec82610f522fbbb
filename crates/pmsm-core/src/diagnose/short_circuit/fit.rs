//! The fit of currents and torque of shorted terminals over speed, by maximum likelihood with errors of Student's t.

use super::DRAGS;
use crate::monitor::Silent;
use crate::numerics::{robust, student};
use crate::optimise::least_squares::{Normal, Problem, Settings, minimise};
use crate::signals::Signals;
use nalgebra::{DMatrix, DVector};

/// Most rounds of weighting.
const ROUNDS: usize = 200;
/// Change of an unknown, share of it, within which they have settled.
const SETTLED: f64 = 1e-8;
/// Step of the difference quotients, share of an unknown.
const STEP: f64 = 1e-6;
/// Residual of both currents, over that of their size alone, and as a share of the current, above both of which the angle is not used.
const ANGLE: (f64, f64) = (3.0, 0.02);
/// Residual, relative to each measured value, beyond which the fit is no model of the points: it misses half of them.
const NO_MODEL: f64 = 0.5;
/// Share of the largest value below which no scatter is believed.
const ROUNDING: f64 = 1e-9;
/// Ratios to the flux of the magnet.
const RATIOS: usize = 3;

/// Currents, and torque where it is measured, over speed.
pub(super) struct Points<'a> {
    pub(super) omega: &'a [f64],
    pub(super) i: [&'a [f64]; 2],
    pub(super) size: Vec<f64>,
    torque: Option<&'a [f64]>,
    pub(super) n_p: f64,
}

/// Ratios of r_s, l_d and l_q to ψ_m, and their scale.
pub(super) struct Fit {
    pub(super) ratios: [f64; RATIOS],
    /// Standard errors of their logarithms.
    pub(super) error: [f64; RATIOS],
    /// ψ_m by the torque, and the standard errors of the logarithms of r_s, l_d, l_q and ψ_m.
    pub(super) scale: Option<(f64, [f64; RATIOS + 1])>,
    /// Scale of what the currents leave, share of the current.
    pub(super) rms: f64,
    /// Whether the size of the current alone was compared.
    pub(super) of_size: bool,
    /// The chance of each point's largest error, by its number among all points.
    pub(super) chance: Vec<(usize, f64)>,
}

/// i_d and i_q of shorted terminals at the ratios (r_s, l_d, l_q)/ψ_m.
pub(super) fn currents([r_s, l_d, l_q]: [f64; RATIOS], w: f64) -> [f64; 2] {
    let d = r_s * r_s + w * w * l_d * l_q;
    [-w * w * l_q / d, -w * r_s / d]
}

impl<'a> Points<'a> {
    pub(super) fn new(signals: &'a Signals) -> Self {
        let [d, q] = signals.i.as_ref().expect("steady points hold both currents");
        let size = d.iter().zip(q).map(|(d, q)| d.hypot(*q)).collect();
        let torque = signals.tau_m.as_deref();
        Self { omega: &signals.omega_e, i: [d, q], size, torque, n_p: signals.n_p }
    }

    /// The fit to both currents, or to their size where the angle contradicts it, and to the torque where one is measured and follows.
    pub(super) fn as_far_as_believed(&self) -> Option<Fit> {
        let of_size = self.fit(true)?;
        match self.fit(false) {
            Some(both) if both.rms <= (ANGLE.0 * of_size.rms).max(ANGLE.1) => Some(both),
            _ => Some(of_size),
        }
    }

    /// The points at which a current flows and the rotor turns.
    fn counted(&self) -> Vec<usize> {
        (0..self.size.len()).filter(|k| self.size[*k] > 0.0 && self.omega[*k] != 0.0).collect()
    }

    fn fit(&self, of_size: bool) -> Option<Fit> {
        let most = self.size.iter().copied().fold(0.0, f64::max);
        let slope =
            (0..self.size.len()).map(|k| self.size[k] / self.omega[k].abs()).filter(|x| x.is_finite());
        // At low speed the resistance limits the current, at high speed l_d does.
        let (l_d, r_s) = (1.0 / most, 1.0 / slope.fold(0.0, f64::max));
        let start = [r_s, l_d, 1.5 * l_d].map(f64::ln);
        if !start.iter().all(|x| x.is_finite()) {
            return None;
        }
        let alone = self.settled(&start, of_size)?;
        let torque = self.torque_line(&alone.x);
        let both = torque.and_then(|line| self.settled(&[&alone.x[..], &line].concat(), of_size));
        let settled = both.filter(|both| both.x[RATIOS] > 0.0).unwrap_or(alone);
        self.told(&settled, of_size)
    }

    /// Torque for a flux of one, and of each drag, at these ratios.
    fn torque_terms(&self, x: &[f64]) -> Vec<Vec<f64>> {
        let ratios @ [_, l_d, l_q] = [x[0].exp(), x[1].exp(), x[2].exp()];
        let per_flux = |w: &f64| {
            let [d, q] = currents(ratios, *w);
            1.5 * self.n_p * (q + (l_d - l_q) * d * q)
        };
        let mut terms =
            vec![self.omega.iter().map(per_flux).collect(), self.omega.iter().map(|w| -w.signum()).collect()];
        if self.omega.len() >= DRAGS {
            terms.push(self.omega.iter().map(|w| -w / self.n_p).collect());
        }
        terms
    }

    /// Flux and drags that the torque shows at these ratios, where it follows the currents.
    fn torque_line(&self, x: &[f64]) -> Option<Vec<f64>> {
        let line = robust::line(&self.torque_terms(x), self.torque?)?;
        (line.found[0] > 0.0).then_some(line.found)
    }

    /// What is left at the unknowns `x`: of the currents as a share of each, then of the torque as a share of the largest.
    fn errors(&self, x: &[f64], of_size: bool) -> [Vec<f64>; 2] {
        let ratios = [x[0].exp(), x[1].exp(), x[2].exp()];
        let of_current = |k: usize| {
            let [d, q] = currents(ratios, self.omega[k]);
            let size = self.size[k];
            match of_size {
                true => vec![d.hypot(q) / size - 1.0],
                false => vec![(d - self.i[0][k]) / size, (q - self.i[1][k]) / size],
            }
        };
        let current = self.counted().into_iter().flat_map(of_current).collect();
        let Some(torque) = self.torque.filter(|_| x.len() > RATIOS) else { return [current, Vec::new()] };
        let terms = self.torque_terms(x);
        let largest = torque.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let of_torque = |k: usize| {
            let model: f64 = terms.iter().zip(&x[RATIOS..]).map(|(term, by)| by * term[k]).sum();
            (model - torque[k]) / largest
        };
        [current, self.counted().into_iter().map(of_torque).collect()]
    }

    /// The unknowns of the largest likelihood, by the EM algorithm from those of least squares.
    fn settled(&self, start: &[f64], of_size: bool) -> Option<Settled> {
        let weights = self.errors(start, of_size).map(|errors| vec![1.0; errors.len()]);
        let mut weighted = Weighted { points: self, of_size, weights, dim: start.len() };
        let free = vec![(f64::NEG_INFINITY, f64::INFINITY); start.len()];
        let mut x = start.to_vec();
        let mut scales = None;
        for _ in 0..ROUNDS {
            let fit = minimise(&weighted, &x, &free, &Settings::default(), &Silent).ok()?;
            let errors = self.errors(&fit.parameters, of_size);
            let last = scales.unwrap_or_else(|| [0, 1].map(|c| median(&errors[c])));
            let next = [0, 1].map(|c| student::next_scale(&errors[c], last[c]).max(ROUNDING));
            weighted.weights = [0, 1]
                .map(|c| errors[c].iter().map(|e| student::weight(e / next[c]).sqrt() / next[c]).collect());
            let moved = x.iter().zip(&fit.parameters).map(|(a, b)| (a - b).abs() / (1.0 + b.abs()));
            let rests = scales.is_some() && moved.fold(0.0, f64::max) <= SETTLED;
            (x, scales) = (fit.parameters, Some(next));
            if rests {
                break;
            }
        }
        let information = weighted.normal(&x).jtj;
        let covariance = information.try_inverse().filter(|c| c.iter().all(|c| c.is_finite()))?;
        Some(Settled { x, scales: scales?, covariance: covariance * student::of_variance() })
    }

    /// What that tells.
    fn told(&self, settled: &Settled, of_size: bool) -> Option<Fit> {
        let Settled { x, scales, covariance } = settled;
        let [current, torque] = self.errors(x, of_size);
        let rows = (current.len() + torque.len()) as f64;
        let small = rows / (rows - x.len() as f64);
        if !(small > 0.0 && small.is_finite() && scales[0] < NO_MODEL) {
            return None;
        }
        let error = |k: usize| (small * covariance[(k, k)]).sqrt();
        let scale = (x.len() > RATIOS).then(|| {
            let psi = x[RATIOS];
            let of_psi = covariance[(RATIOS, RATIOS)] / (psi * psi);
            // The logarithm of a parameter is that of its ratio and of the flux.
            let of = |k: usize| covariance[(k, k)] + of_psi + 2.0 * covariance[(k, RATIOS)] / psi;
            let variances = [of(0), of(1), of(2), of_psi];
            (psi, variances.map(|variance| (small * variance.max(0.0)).sqrt()))
        });
        let each = if of_size { 1 } else { 2 };
        let chance = |(place, k): (usize, usize)| {
            let own = &current[each * place..each * (place + 1)];
            let largest = own.iter().map(|e| (e / scales[0]).abs()).fold(0.0, f64::max);
            let of_torque = torque.get(place).map_or(0.0, |e| (e / scales[1]).abs());
            (k, student::two_sided(largest.max(of_torque)))
        };
        let chance = self.counted().into_iter().enumerate().map(chance).collect();
        let ratios = [x[0].exp(), x[1].exp(), x[2].exp()];
        Some(Fit { ratios, error: [error(0), error(1), error(2)], scale, rms: scales[0], of_size, chance })
    }
}

/// Unknowns of the largest likelihood, the scales of currents and torque, and the covariance for many points.
struct Settled {
    x: Vec<f64>,
    scales: [f64; 2],
    covariance: DMatrix<f64>,
}

/// Median size of errors, as the scale that the EM algorithm starts from.
fn median(errors: &[f64]) -> f64 {
    let mut size: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
    size.sort_by(f64::total_cmp);
    size.get(size.len() / 2).copied().unwrap_or(0.0).max(ROUNDING)
}

/// The sum of squares of weighted errors.
struct Weighted<'a> {
    points: &'a Points<'a>,
    of_size: bool,
    weights: [Vec<f64>; 2],
    dim: usize,
}

impl Weighted<'_> {
    fn rest(&self, x: &[f64]) -> DVector<f64> {
        let errors = self.points.errors(x, self.of_size);
        let both = errors.iter().flatten().zip(self.weights.iter().flatten());
        DVector::from_iterator(errors[0].len() + errors[1].len(), both.map(|(e, w)| e * w))
    }
}

impl Problem for Weighted<'_> {
    fn dim(&self) -> usize {
        self.dim
    }

    fn cost(&self, p: &[f64]) -> f64 {
        self.rest(p).norm_squared()
    }

    fn normal(&self, p: &[f64]) -> Normal {
        let rest = self.rest(p);
        let slope = |k: usize| {
            let (mut near, step) = (p.to_vec(), STEP * p[k].abs().max(STEP));
            near[k] += step;
            (self.rest(&near) - &rest) / (near[k] - p[k])
        };
        let columns: Vec<DVector<f64>> = (0..self.dim).map(slope).collect();
        let j = DMatrix::from_columns(&columns);
        Normal { cost: rest.norm_squared(), jtj: j.tr_mul(&j), jtr: j.tr_mul(&rest) }
    }
}
