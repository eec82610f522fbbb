//! Whitens the current residual of a free run whose driving voltage is itself noisy, or that starts from noisy currents.
//!
//! Noise on the voltage adds up in the simulated currents, so that a correct model leaves a slow, strong residual e. With the
//! bare machine's dynamics it is the output of
//!
//! > x_{k+1} = A_k·x_k + w_k,  e_k = x_k + n_k,  A_k = exp(h·[[−r_s/l_d, ω·l_q/l_d], [−ω·l_d/l_q, −r_s/l_q]]),
//!
//! w the voltage noise times h/l, n the sensors' noise. Where the voltage is clean w is what the noise of the logged speed does,
//! h·(l_q·i_q/l_d, −(ψ_m + l_d·i_d)/l_q) times it. A Kalman filter with these covariances turns e into innovations, and their
//! Cholesky factor into white noise of unit variance (Anderson & Moore, "Optimal filtering", 1979, chapters 3 and 5). The filter
//! depends on the machine and the log alone: it is one fixed linear map for derivatives of every model.
//!
//! The inductances decide how much of the voltage's noise a simulation shows. Under one fixed filter larger ones, which show less,
//! would fit better than the true ones; so the residual passes a filter that follows them, as the weights do when a straight line is
//! laid through points with errors in both coordinates (Deming, "Statistical adjustment of data", 1943).

use crate::noise::input::InputNoise;
use crate::numerics::extent::peak;
use crate::signals::Signals;
use std::borrow::Cow;
use std::ops::Range;

/// Relative step of an inductance for the derivative of the filter.
const STEP: f64 = 0.01;
/// Distance (ln) of an inductance from that of the filter up to which the filter is taken to first order, and none is made anew.
const NEAR: f64 = 0.01;

/// Distance (ln) up to which the filter follows: inductances near zero would drown every misfit in the noise that they let through.
const REACH: f64 = 0.25;

/// Share of what is new in a residual by which the filter corrects what it expects next, in the mean, from which the currents wander.
const CORRECTS: f64 = 0.02;

/// What the noise of the speed does in one interval counts up to this many times the noise of a current sensor. A sample of the speed drives
/// the intervals on either side of it, which white noise does not; where that matters the filter would expect too much.
const QUICK: f64 = 0.25;

/// A whitening filter over one recording.
#[derive(Debug, Clone)]
pub struct Whitening {
    segments: Vec<Range<usize>>,
    here: Filter,
    /// What the filter was made of, and those for a slightly larger l_d and l_q, where noise of the voltage lets the currents wander.
    wander: Option<Wander>,
}

/// What a filter depends on that follows the inductances.
#[derive(Debug, Clone)]
struct Wander {
    bench: Bench,
    l: [f64; 2],
    beside: Option<[Filter; 2]>,
}

/// What is noisy on a bench, and what of the machine decides how much of it shows.
#[derive(Debug, Clone)]
pub struct Bench {
    /// Resistance, Ω.
    pub r_s: f64,
    /// Flux linkage of the magnet, V·s.
    pub psi_m: f64,
    /// Noise of the current sensors, A per axis.
    pub sensor: [f64; 2],
    /// Noise of the electrical speed, rad/s; zero where it does not drive the model.
    pub speed: f64,
    /// Noise of the voltages.
    pub input: InputNoise,
}

/// What a residual of d and q turns into when the filter changes with ln l_d and with ln l_q.
pub type Bend = [[Vec<f64>; 2]; 2];

/// A Kalman filter, sample by sample.
#[derive(Debug, Clone)]
struct Filter {
    /// A_k, row by row.
    transition: Vec<[f64; 4]>,
    /// Kalman gain, row by row.
    gain: Vec<[f64; 4]>,
    /// Inverse Cholesky factor of the innovations' covariance: (0,0), (1,0), (1,1).
    root: Vec<[f64; 3]>,
}

impl Whitening {
    /// The filter for a machine with the inductances `l` (d, q), H.
    pub fn new(signals: &Signals, l: [f64; 2], bench: Bench) -> Self {
        Self::made(signals, l, &bench, true)
    }

    fn made(signals: &Signals, l: [f64; 2], bench: &Bench, beside: bool) -> Self {
        let bench = Bench { r_s: bench.r_s.max(1e-12), ..bench.clone() };
        let l = l.map(|l| l.max(1e-12));
        let at = |l: [f64; 2]| Filter::new(signals, l, &bench);
        let (here, more) = (at(l), 1.0 + STEP);
        let wander = (bench.input.voltage > 0.0).then(|| Wander {
            l,
            beside: beside.then(|| [at([l[0] * more, l[1]]), at([l[0], l[1] * more])]),
            bench: bench.clone(),
        });
        Self { segments: signals.segments.clone(), here, wander }
    }

    /// The nearest inductances (d, q), H, to which the filter follows.
    pub fn within(&self, l: [f64; 2]) -> [f64; 2] {
        let near = |w: &Wander, axis: usize| w.l[axis] * self.away(l)[axis].clamp(-REACH, REACH).exp();
        self.wander.as_ref().map_or(l, |w| [0, 1].map(|axis| near(w, axis)))
    }

    /// The filter for other inductances `l` (d, q), H; with derivatives, if wanted.
    pub fn at(&self, signals: &Signals, l: [f64; 2], derivatives: bool) -> Cow<'_, Self> {
        match &self.wander {
            Some(w) if self.away(l).iter().any(|x| x.abs() > NEAR) => {
                Cow::Owned(Self::made(signals, l, &w.bench, derivatives))
            }
            _ => Cow::Borrowed(self),
        }
    }

    /// Whether noise of the voltage or of the speed lets the currents wander all along, so that a plain residual hides what lasts.
    pub fn wanders(&self) -> bool {
        self.follows() || self.here.corrects() > CORRECTS
    }

    /// Whether the filter follows the inductances of a model.
    pub fn follows(&self) -> bool {
        self.wander.is_some()
    }

    /// How far (d, q) inductances are from those of the filter, ln.
    pub fn away(&self, l: [f64; 2]) -> [f64; 2] {
        let away = |w: &Wander| [0, 1].map(|axis| (l[axis].max(1e-12) / w.l[axis]).ln());
        self.wander.as_ref().map_or([0.0; 2], away)
    }

    /// Turns a current residual (A, one value per sample and axis) into one of unit variance.
    pub fn apply(&self, d: &mut [f64], q: &mut [f64]) {
        self.here.apply(&self.segments, d, q);
    }

    /// The same for the residual of a model with the inductances `l` near those of the filter, which follows them; with the derivatives
    /// through the filter, if it has them.
    pub fn follow(&self, l: [f64; 2], d: &mut [f64], q: &mut [f64]) -> Option<Bend> {
        let Some(filters) = self.wander.as_ref().and_then(|w| w.beside.as_ref()) else {
            self.apply(d, q);
            return None;
        };
        let mut bend: Bend = [[d.to_vec(), q.to_vec()], [d.to_vec(), q.to_vec()]];
        self.apply(d, q);
        for (filter, [along_d, along_q]) in filters.iter().zip(&mut bend) {
            filter.apply(&self.segments, along_d, along_q);
            for (along, here) in along_d.iter_mut().zip(&*d).chain(along_q.iter_mut().zip(&*q)) {
                *along = (*along - here) / STEP.ln_1p();
            }
        }
        for (away, [along_d, along_q]) in self.away(l).into_iter().zip(&bend) {
            d.iter_mut()
                .zip(along_d)
                .chain(q.iter_mut().zip(along_q))
                .for_each(|(x, along)| *x += away * along);
        }
        Some(bend)
    }
}

impl Filter {
    fn new(signals: &Signals, [l_d, l_q]: [f64; 2], bench: &Bench) -> Self {
        let Bench { r_s, sensor, input, .. } = bench;
        // What passes for noise of the voltages was found in the currents, with what the speed's noise does.
        let speed = if input.voltage > 0.0 { 0.0 } else { bench.speed };
        let n = signals.len();
        let mut out =
            Self { transition: vec![[0.0; 4]; n], gain: vec![[0.0; 4]; n], root: vec![[0.0; 3]; n] };
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
                let m = transition(h, omega, *r_s, l_d, l_q);
                out.transition[k] = m;
                let sigma = input.at(k, h * (r_s / l_d.min(l_q)).hypot(omega));
                let [a, b, c] = covariance;
                let [i_d, i_q] = signals.i.as_ref().map_or([0.0; 2], |[d, q]| [d[k], q[k]]);
                let swing = [l_q * i_q / l_d, -(bench.psi_m + l_d * i_d) / l_q].map(|x| x * h * speed);
                let swing = [0, 1].map(|a| swing[a].clamp(-QUICK * sensor[a], QUICK * sensor[a]));
                let q = [sigma * h / l_d, sigma * h / l_q].map(|x| x * x);
                let q = [q[0] + swing[0] * swing[0], q[1] + swing[1] * swing[1]];
                covariance = [
                    m[0] * (m[0] * a + m[1] * b) + m[1] * (m[0] * b + m[1] * c) + q[0],
                    m[0] * (m[2] * a + m[3] * b) + m[1] * (m[2] * b + m[3] * c) + swing[0] * swing[1],
                    m[2] * (m[2] * a + m[3] * b) + m[3] * (m[2] * b + m[3] * c) + q[1],
                ];
            }
        }
        out
    }

    /// Mean gain.
    fn corrects(&self) -> f64 {
        self.gain.iter().map(|g| 0.5 * (g[0] + g[3])).sum::<f64>() / self.gain.len().max(1) as f64
    }

    fn apply(&self, segments: &[Range<usize>], d: &mut [f64], q: &mut [f64]) {
        for segment in segments {
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
    let size = h * peak(&f);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Machine;
    use crate::numerics::random::normal_pair;
    use crate::recording::Recording;

    const P: [f64; 6] = [0.9, 9.6e-3, 21e-3, 0.19, 0.01, 0.001];
    const H: f64 = 1e-4;

    fn signals(n: usize) -> Signals {
        let t: Vec<f64> = (0..n).map(|k| k as f64 * H).collect();
        let omega: Vec<f64> = t.iter().map(|t| 400.0 * (9.0 * t).sin()).collect();
        let theta = t.iter().map(|t| 400.0 / 9.0 * (1.0 - (9.0 * t).cos())).collect();
        let level = |x: f64| vec![x; n];
        let columns = vec![
            ("t".into(), t),
            ("omega_e".into(), omega),
            ("theta_e".into(), theta),
            ("v_d".into(), level(1.0)),
            ("v_q".into(), level(2.0)),
            ("i_d".into(), level(3.0)),
            ("i_q".into(), level(4.0)),
        ];
        Signals::new(&Recording::new(columns, None).unwrap(), &Machine::new(3).unwrap()).unwrap()
    }

    fn bench(sensor: f64, speed: f64, voltage: f64) -> Bench {
        let input = InputNoise { voltage, ..InputNoise::default() };
        Bench { r_s: P[0], psi_m: P[3], sensor: [sensor; 2], speed, input }
    }

    /// What a correct model leaves in free run from a noisy start under a noisy voltage and at a noisy speed.
    fn residual(signals: &Signals, sensor: f64, voltage: f64, speed: f64) -> [Vec<f64>; 2] {
        let noise = |k: usize, what: u32| normal_pair(7, [k as u32, what, 0, 0]);
        let mut x = [0.0; 2];
        let mut out = [Vec::new(), Vec::new()];
        for k in 0..signals.len() {
            let n = noise(k, 0);
            if k == 0 {
                x = [-sensor * n.0, -sensor * n.1];
            }
            out[0].push(x[0] + sensor * n.0);
            out[1].push(x[1] + sensor * n.1);
            let m = transition(H, signals.omega_e[k], P[0], P[1], P[2]);
            let w = noise(k, 1);
            let swing = speed * noise(k, 2).0;
            let [i_d, i_q] = signals.i.as_ref().map(|i| [i[0][k], i[1][k]]).unwrap();
            x = [
                m[0] * x[0] + m[1] * x[1] + H / P[1] * (voltage * w.0 + P[2] * i_q * swing),
                m[2] * x[0] + m[3] * x[1] + H / P[2] * (voltage * w.1 - (P[3] + P[1] * i_d) * swing),
            ];
        }
        out
    }

    #[test]
    fn what_noise_alone_leaves_becomes_white_with_unit_variance() {
        let signals = signals(30_000);
        for (sensor, voltage, speed) in [(0.02, 1.5, 0.0), (0.02, 0.0, 4.5)] {
            let [mut d, mut q] = residual(&signals, sensor, voltage, speed);
            let plain = d.iter().map(|x| x * x).sum::<f64>() / d.len() as f64;
            assert!(plain > 2.0 * sensor * sensor, "{plain}");
            // A row that stands for several control periods takes nothing of this away.
            let mut bench = bench(sensor, speed, voltage);
            bench.input.hidden = vec![0.0; signals.len()];
            let filter = Whitening::new(&signals, [P[1], P[2]], bench);
            assert!(filter.wanders());
            filter.apply(&mut d, &mut q);
            for x in [&d, &q] {
                let square = x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64;
                assert!((square - 1.0).abs() < 0.03, "{square}");
                for lag in [1, 3, 20] {
                    let rho = x.windows(lag + 1).map(|w| w[0] * w[lag]).sum::<f64>() / x.len() as f64;
                    assert!(rho.abs() < 0.025, "{lag}: {rho}");
                }
            }
            let cross = d.iter().zip(&q).map(|(a, b)| a * b).sum::<f64>() / d.len() as f64;
            assert!(cross.abs() < 0.025, "{cross}");
        }
        assert!(!Whitening::new(&signals, [P[1], P[2]], bench(0.02, 0.0, 0.0)).wanders());
    }

    #[test]
    fn the_noise_is_found_in_such_a_residual() {
        let signals = signals(30_000);
        let (sensor, voltage) = (0.02, 1.5);
        let [d, q] = residual(&signals, sensor, voltage, 0.0);
        let mut known = [sensor; 2];
        let found = InputNoise::estimate(&signals, [P[1], P[2]], [&d, &q], &mut known, true);
        assert!((found.voltage / voltage - 1.0).abs() < 0.1, "{}", found.voltage);
        assert!(found.hidden.is_empty());
        // Smooth physics on top is none.
        let bent = |x: &[f64]| -> Vec<f64> {
            x.iter().zip(&signals.t).map(|(x, t)| x + 0.1 * (150.0 * t).sin()).collect()
        };
        let [quiet_d, quiet_q] = residual(&signals, sensor, 0.0, 0.0).map(|x| bent(&x));
        let found = InputNoise::estimate(&signals, [P[1], P[2]], [&quiet_d, &quiet_q], &mut known, true);
        assert_eq!(found.voltage, 0.0);
    }
}
