//! How a run depends on parameters and initial values, by dual numbers and the reference equations, and what rounding may do to it.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use pmsm_core::kernels::bare::POINT;
use pmsm_core::kernels::bare::copies::INITIAL;
use pmsm_core::kernels::objective::Starts;
use pmsm_core::model::Model;
use pmsm_core::numerics::dual::Dual;
use pmsm_core::numerics::real::Real;
use pmsm_core::signals::Signals;
use pmsm_core::simulate::coupled;

/// Channels of a sample: i_d, i_q, ω_e.
const CHANNELS: usize = 3;
/// Derivatives of one run; more of them at once would be a number type that nothing else uses.
const AT_ONCE: usize = 8;

/// Weighted errors of a run, stacked channel by channel, and their derivatives before anything is taken out.
pub struct Sensitivity<'a> {
    signals: &'a Signals,
    /// Model minus measurement.
    pub errors: DVector<f64>,
    /// By the entries of the point.
    pub parameters: DMatrix<f64>,
    /// By the initial i_d, i_q, ω_e.
    pub initial: DMatrix<f64>,
    /// Root of the summed squares by which two ways to compute the errors may differ.
    pub rounding: f64,
}

impl<'a> Sensitivity<'a> {
    /// A square of i_d or i_q counts `weights[0]`, one of ω_e `weights[1]`.
    pub fn new(signals: &'a Signals, weights: [f64; 2], p: &[f64], starts: &Starts) -> Self {
        let (n, rows) = (signals.len(), CHANNELS * signals.len());
        let model = Model::new(signals.context, &[]);
        let [i_d, i_q] = signals.i.as_ref().expect("currents");
        let (measured, mut largest) = ([i_d, i_q, &signals.omega_e], [0.0f64; CHANNELS]);
        let weight = [weights[0], weights[0], weights[1]].map(f64::sqrt);
        let [parameters, initial] = [POINT, INITIAL].map(|columns| DMatrix::zeros(rows, columns));
        let errors = DVector::zeros(rows);
        let mut out = Self { signals, errors, parameters, initial, rounding: 0.0 };
        for first in (0..POINT + INITIAL).step_by(AT_ONCE) {
            let seen = first..(first + AT_ONCE).min(POINT + INITIAL);
            let seeded = |x: f64, k: usize| -> Dual<AT_ONCE> {
                if seen.contains(&k) { Dual::variable(x, k - first) } else { Dual::constant(x) }
            };
            let point: Vec<Dual<AT_ONCE>> = p.iter().enumerate().map(|(k, x)| seeded(*x, k)).collect();
            let start = |sample: usize, _| {
                let number = signals.segments.iter().position(|s| s.start == sample).expect("a first sample");
                [0, 1, 2].map(|c| seeded(starts[number][c], POINT + c))
            };
            coupled::run_from(&model, signals, 0..n, &point[..6], point[6], start, |k, now| {
                for c in 0..CHANNELS {
                    let row = c * n + k;
                    largest[c] = largest[c].max(now[c].re.abs());
                    out.errors[row] = weight[c] * (now[c].re - measured[c][k]);
                    for x in seen.clone() {
                        let by = weight[c] * now[c].eps[x - first];
                        match x.checked_sub(POINT) {
                            None => out.parameters[(row, x)] = by,
                            Some(own) => out.initial[(row, own)] = by,
                        }
                    }
                }
                true
            });
        }
        // Each step rounds fluxes and speed by about ε of themselves, and a flux of the d axis holds the magnet's, too. What that
        // moves grows or dies away as what an initial value moves. N steps add up to N times as much where nothing cancels.
        let sizes = [largest[0] + p[3] / p[1], largest[1], largest[2]];
        let moved: f64 = (0..INITIAL).map(|x| sizes[x] * out.initial.column(x).amax()).sum();
        let steps = |s: &std::ops::Range<usize>| {
            s.len() * coupled::pieces(coupled::fastest_rate(signals, s), signals.period)
        };
        let most = signals.segments.iter().map(steps).max().expect("a segment");
        out.rounding = f64::EPSILON * most as f64 * (n as f64).sqrt() * moved;
        out
    }

    /// By how much a sum of squares may differ by rounding (Cauchy and Schwarz): |‖e + δ‖² − ‖e‖²| ≤ 2·‖e‖·‖δ‖ + ‖δ‖².
    pub fn rounding_of_cost(&self, cost: f64) -> f64 {
        self.rounding * (2.0 * cost.sqrt() + self.rounding)
    }

    /// Where the derivatives by initial values, of unit length each, are least independent: their condition number.
    pub fn condition(&self) -> f64 {
        let of = |gram: Matrix3<f64>| {
            let unit = Matrix3::from_fn(|a, b| gram[(a, b)] / (gram[(a, a)] * gram[(b, b)]).sqrt());
            let squares = unit.symmetric_eigenvalues();
            (squares.max() / squares.min()).sqrt()
        };
        self.segments().map(|part| of(gram(&part))).fold(1.0, f64::max)
    }

    /// How far a `column`, of which `rest` is left without the initial values, is off after they are taken out where their own
    /// derivatives are off by `off`, in length.
    ///
    /// As much of that as the column holds of each comes along with it. The space that is taken out is turned by their relative error
    /// times their condition, which leaves that share of the rest.
    pub fn carried(&self, column: &[f64], rest: f64, off: [f64; INITIAL]) -> f64 {
        let (mut along, mut turned) = (0.0f64, 0.0f64);
        for (part, rows) in self.segments().zip(self.rows()) {
            let own = DVector::from_fn(rows.len(), |r, _| column[rows[r]]);
            let shares = gram(&part)
                .cholesky()
                .expect("independent")
                .solve(&(part.tr_mul(&own)).fixed_rows::<INITIAL>(0));
            along += shares.iter().zip(off).map(|(share, off)| share.abs() * off).sum::<f64>();
            turned = (0..INITIAL).map(|x| off[x] / part.column(x).norm()).fold(turned, f64::max);
        }
        along + turned * self.condition() * rest
    }

    /// A Gauss–Newton step of the initial values of each segment, and how far another way to compute it may be off where its
    /// derivatives are off by `off`, in length: each changes its product with the error by as much of the error.
    pub fn steps(&self, off: [f64; INITIAL]) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let of = |(part, rows): (DMatrix<f64>, Vec<usize>)| {
            let error = DVector::from_fn(rows.len(), |r, _| self.errors[rows[r]]);
            let inverse = gram(&part).try_inverse().expect("independent");
            let step = -inverse * part.tr_mul(&error).fixed_rows::<INITIAL>(0);
            let product =
                Vector3::from_fn(|x, _| off[x] * error.norm() + self.rounding * part.column(x).norm());
            (step, inverse.abs() * product)
        };
        self.segments().zip(self.rows()).map(of).collect()
    }

    /// The rows of each segment.
    fn rows(&self) -> impl Iterator<Item = Vec<usize>> {
        let n = self.signals.len();
        let of = move |s: &std::ops::Range<usize>| -> Vec<usize> {
            (0..CHANNELS).flat_map(|c| s.clone().map(move |k| c * n + k)).collect()
        };
        self.signals.segments.iter().map(of)
    }

    /// The derivatives by initial values, segment by segment.
    fn segments(&self) -> impl Iterator<Item = DMatrix<f64>> {
        self.rows().map(|rows| DMatrix::from_fn(rows.len(), INITIAL, |r, x| self.initial[(rows[r], x)]))
    }
}

fn gram(part: &DMatrix<f64>) -> Matrix3<f64> {
    part.tr_mul(part).fixed_view::<INITIAL, INITIAL>(0, 0).into_owned()
}
