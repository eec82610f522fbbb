//! Whitens the current residual of a free run whose driving voltage is itself noisy, or that starts from noisy currents.
//!
//! Noise on the voltage adds up in the simulated currents, so that a correct model leaves a slow, strong residual e. With the
//! bare machine's dynamics it is the output of
//!
//! > x_{k+1} = A_k·x_k + w_k,  e_k = x_k + n_k,  A_k = exp(h·[[−r_s/l_d, ω·l_q/l_d], [−ω·l_d/l_q, −r_s/l_q]]),
//!
//! w the voltage noise times h/l, n the sensors' noise. A Kalman filter with these covariances turns e into innovations, and their
//! Cholesky factor into white noise of unit variance (Anderson & Moore, "Optimal filtering", 1979, chapters 3 and 5). The filter
//! depends on the machine and the log alone: it is one fixed linear map for residuals and derivatives of every model.

use crate::base::BASE;
use crate::input_noise::InputNoise;
use crate::machine::BaseParameter;
use crate::signals::Signals;
use std::ops::Range;

/// A whitening filter over one recording.
#[derive(Debug, Clone)]
pub struct Whitening {
    segments: Vec<Range<usize>>,
    wanders: bool,
    /// A_k, row by row.
    transition: Vec<[f64; 4]>,
    /// Kalman gain, row by row.
    gain: Vec<[f64; 4]>,
    /// Inverse Cholesky factor of the innovations' covariance: (0,0), (1,0), (1,1).
    root: Vec<[f64; 3]>,
}

impl Whitening {
    /// The filter for a machine with base parameters `p` whose current sensors have the noise `sensor` (A per axis).
    pub fn new(signals: &Signals, p: &[f64], sensor: [f64; 2], input: &InputNoise) -> Self {
        debug_assert!(p.len() >= BASE);
        let [r_s, l_d, l_q] =
            [BaseParameter::RS, BaseParameter::LD, BaseParameter::LQ].map(|b| p[b.index()].max(1e-12));
        let n = signals.len();
        let mut out = Self {
            segments: signals.segments.clone(),
            wanders: input.voltage > 0.0,
            transition: vec![[0.0; 4]; n],
            gain: vec![[0.0; 4]; n],
            root: vec![[0.0; 3]; n],
        };
        let noise = [sensor[0] * sensor[0], sensor[1] * sensor[1]];
        for segment in &signals.segments {
            // The simulation starts from the measured current: the state is that sensor's error, and the first residual is zero.
            let mut covariance = [noise[0], 0.0, noise[1]];
            for k in segment.clone() {
                let first = k == segment.start;
                let [a, b, c] = covariance;
                let s = [a + noise[0], b, c + noise[1]];
                let determinant = s[0] * s[2] - s[1] * s[1];
                let inverse = [s[2] / determinant, -s[1] / determinant, s[0] / determinant];
                let gain = [
                    a * inverse[0] + b * inverse[1],
                    a * inverse[1] + b * inverse[2],
                    b * inverse[0] + c * inverse[1],
                    b * inverse[1] + c * inverse[2],
                ];
                let l00 = s[0].sqrt();
                let l10 = s[1] / l00;
                let l11 = (s[2] - l10 * l10).sqrt();
                out.root[k] = [1.0 / l00, -l10 / (l00 * l11), 1.0 / l11];
                if first {
                    out.root[k] = [0.0; 3];
                } else {
                    out.gain[k] = gain;
                    covariance = [
                        (1.0 - gain[0]) * a - gain[1] * b,
                        (1.0 - gain[0]) * b - gain[1] * c,
                        (1.0 - gain[3]) * c - gain[2] * b,
                    ];
                }
                if k + 1 == segment.end {
                    break;
                }
                let h = signals.t[k + 1] - signals.t[k];
                let omega = signals.omega_e[k];
                let m = transition(h, omega, r_s, l_d, l_q);
                out.transition[k] = m;
                let sigma = input.at(k, h * (r_s / l_d.min(l_q)).hypot(omega));
                let [a, b, c] = covariance;
                let q = [(sigma * h / l_d).powi(2), (sigma * h / l_q).powi(2)];
                covariance = [
                    m[0] * (m[0] * a + m[1] * b) + m[1] * (m[0] * b + m[1] * c) + q[0],
                    m[0] * (m[2] * a + m[3] * b) + m[1] * (m[2] * b + m[3] * c),
                    m[2] * (m[2] * a + m[3] * b) + m[3] * (m[2] * b + m[3] * c) + q[1],
                ];
            }
        }
        out
    }

    /// Whether noise of the voltage lets the currents wander all along, so that a plain residual hides what lasts.
    pub fn wanders(&self) -> bool {
        self.wanders
    }

    /// Turns a current residual (A, one value per sample and axis) into one of unit variance.
    pub fn apply(&self, d: &mut [f64], q: &mut [f64]) {
        for segment in &self.segments {
            let mut x = [0.0; 2];
            for k in segment.clone() {
                let (g, m, root) = (&self.gain[k], &self.transition[k], &self.root[k]);
                let new = [d[k] - x[0], q[k] - x[1]];
                d[k] = root[0] * new[0];
                q[k] = root[1] * new[0] + root[2] * new[1];
                let y = [x[0] + g[0] * new[0] + g[1] * new[1], x[1] + g[2] * new[0] + g[3] * new[1]];
                x = [m[0] * y[0] + m[1] * y[1], m[2] * y[0] + m[3] * y[1]];
            }
        }
    }
}

/// exp(h·[[−r_s/l_d, ω·l_q/l_d], [−ω·l_d/l_q, −r_s/l_q]]) to third order in small pieces.
fn transition(h: f64, omega: f64, r_s: f64, l_d: f64, l_q: f64) -> [f64; 4] {
    let f = [-r_s / l_d, omega * l_q / l_d, -omega * l_d / l_q, -r_s / l_q];
    let size = h * f.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let pieces = (size / 0.25).ceil().clamp(1.0, 4096.0);
    let f = f.map(|x| x * h / pieces);
    let f2 = product(&f, &f);
    let f3 = product(&f2, &f);
    let mut one = [1.0, 0.0, 0.0, 1.0];
    for k in 0..4 {
        one[k] += f[k] + f2[k] / 2.0 + f3[k] / 6.0;
    }
    let mut out = one;
    for _ in 1..pieces as usize {
        out = product(&out, &one);
    }
    out
}

fn product(a: &[f64; 4], b: &[f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] + a[1] * b[2],
        a[0] * b[1] + a[1] * b[3],
        a[2] * b[0] + a[3] * b[2],
        a[2] * b[1] + a[3] * b[3],
    ]
}
