//! A motor of the textbook, written in currents and integrated by an adaptive Dormand–Prince 5(4) pair to tight
//! tolerance: independent of the crate's equations (flux linkages, fixed-step RK4) and of its number types.

// Each test file uses its own part of this module.
#![allow(dead_code)]

use pmsm_core::machine::{BaseParameter, Machine};
use pmsm_core::recording::{Load, Recording};

/// Parameters of the motor, SI, with an optional elastic shaft and a winding that heats itself.
#[derive(Debug, Clone, Copy)]
pub struct Plant {
    /// Stator resistance, Ω.
    pub r_s: f64,
    /// Inductance of the d axis, H.
    pub l_d: f64,
    /// Inductance of the q axis, H.
    pub l_q: f64,
    /// Flux linkage of the magnets, V·s.
    pub psi_m: f64,
    /// Pole pairs.
    pub n_p: f64,
    /// Inertia of all that turns, kg·m².
    pub j: f64,
    /// Viscous friction, N·m·s/rad.
    pub b: f64,
    /// Constant load, N·m.
    pub tau_load: f64,
    /// Share of the inertia behind the shaft, stiffness N·m/rad, damping N·m·s/rad.
    pub shaft: Option<[f64; 3]>,
    /// Relative rise of resistance per joule, thermal time constant s.
    pub heating: Option<[f64; 2]>,
}

/// i_d, i_q, ω_m, θ_e, twist of the shaft, ω_m of the load, relative rise of resistance.
pub type State = [f64; 7];

impl Plant {
    /// A salient servo motor of a few hundred watts.
    pub fn servo() -> Self {
        Self {
            r_s: 0.9,
            l_d: 6e-3,
            l_q: 9e-3,
            psi_m: 0.19,
            n_p: 3.0,
            j: 4e-3,
            b: 2e-3,
            tau_load: 1.5,
            shaft: None,
            heating: None,
        }
    }

    /// The machine of Table 1 of Liu, Liu & Cartes (2008) at 3 N·m.
    pub fn liu() -> Self {
        let machine = Machine::liu_2008();
        let [r_s, l_d, l_q, psi_m, j, b] = machine.base.map(|x| x.expect("Table 1 is complete"));
        Self { r_s, l_d, l_q, psi_m, n_p: 4.0, j, b, tau_load: 3.0, shaft: None, heating: None }
    }

    /// The nameplate with every base parameter off by these factors.
    pub fn nameplate(&self, factors: [f64; 6]) -> Machine {
        let truth = [self.r_s, self.l_d, self.l_q, self.psi_m, self.j, self.b];
        let mut machine = Machine::new(self.n_p as u32).expect("pole pairs");
        for p in BaseParameter::ALL {
            machine = machine.with(p, truth[p.index()] * factors[p.index()]).expect("a sane nameplate");
        }
        machine
    }

    /// Time derivative under the rotor-frame voltage `v`.
    pub fn slope(&self, x: &State, v: [f64; 2]) -> State {
        let [i_d, i_q, w_m, _, twist, w_l, rise] = *x;
        let (w, r) = (self.n_p * w_m, self.r_s * (1.0 + rise));
        let torque = 1.5 * self.n_p * (i_q * self.psi_m + (self.l_d - self.l_q) * i_q * i_d);
        let mut out = [0.0; 7];
        out[0] = (v[0] - r * i_d + w * self.l_q * i_q) / self.l_d;
        out[1] = (v[1] - r * i_q - w * self.l_d * i_d - w * self.psi_m) / self.l_q;
        out[3] = w;
        if let Some([share, stiffness, damping]) = self.shaft {
            let shaft = stiffness * twist + damping * (w_m - w_l);
            out[2] = (torque - self.b * w_m - shaft) / (self.j * (1.0 - share));
            out[4] = w_m - w_l;
            out[5] = (shaft - self.tau_load) / (self.j * share);
        } else {
            out[2] = (torque - self.b * w_m - self.tau_load) / self.j;
        }
        if let Some([rate, time]) = self.heating {
            out[6] = rate * 1.5 * r * (i_d * i_d + i_q * i_q) - rise / time;
        }
        out
    }

    /// The state `h` seconds later under a held voltage.
    pub fn advance(&self, x: &State, v: [f64; 2], h: f64) -> State {
        dormand_prince(h, x, |_, x| self.slope(x, v))
    }

    /// Samples at 1/`period` from `x` under `voltage(t)`, held over each period.
    pub fn run(&self, n: usize, period: f64, mut x: State, voltage: impl Fn(f64) -> [f64; 2]) -> Run {
        let mut run = Run { period, x: Vec::with_capacity(n), v: Vec::with_capacity(n), n_p: self.n_p };
        for k in 0..n {
            let v = voltage(k as f64 * period);
            run.x.push(x);
            run.v.push(v);
            x = self.advance(&x, v, period);
        }
        run
    }

    /// The state at rest relative to the rotor: constant currents at a mechanical speed, and the voltage for them.
    pub fn steady(&self, i: [f64; 2], w_m: f64) -> (State, [f64; 2]) {
        let w = self.n_p * w_m;
        let v_d = self.r_s * i[0] - w * self.l_q * i[1];
        let v_q = self.r_s * i[1] + w * (self.l_d * i[0] + self.psi_m);
        ([i[0], i[1], w_m, 0.3, 0.0, w_m, 0.0], [v_d, v_q])
    }
}

/// A simulated run.
#[derive(Debug, Clone)]
pub struct Run {
    /// Time between two samples, s.
    pub period: f64,
    /// State at each sample.
    pub x: Vec<State>,
    /// Voltages v_d, v_q from each sample to the next, V.
    pub v: Vec<[f64; 2]>,
    /// Pole pairs.
    pub n_p: f64,
}

impl Run {
    /// What a bench would log, with noise of these standard deviations on currents (A) and electrical speed (rad/s).
    /// `memory` is the share of a noise value that stays until the next sample.
    pub fn log(&self, noise: [f64; 2], memory: f64, seed: u64, load: Load) -> Recording {
        let mut gauss = Gauss(seed);
        let mut coloured = |sd: f64| -> Vec<f64> {
            let fresh = (1.0 - memory * memory).sqrt() * sd;
            let mut last = sd * gauss.draw();
            let values = self.x.iter().map(|_| {
                let now = last;
                last = memory * last + fresh * gauss.draw();
                now
            });
            values.collect()
        };
        let (e_d, e_q, e_w) = (coloured(noise[0]), coloured(noise[0]), coloured(noise[1]));
        let column = |f: &dyn Fn(usize) -> f64| (0..self.x.len()).map(f).collect::<Vec<f64>>();
        let given = vec![
            ("t".into(), column(&|k| k as f64 * self.period)),
            ("v_d".into(), column(&|k| self.v[k][0])),
            ("v_q".into(), column(&|k| self.v[k][1])),
            ("i_d".into(), column(&|k| self.x[k][0] + e_d[k])),
            ("i_q".into(), column(&|k| self.x[k][1] + e_q[k])),
            ("omega_e".into(), column(&|k| self.x[k][2] * self.n_p + e_w[k])),
            ("theta_e".into(), column(&|k| self.x[k][3])),
        ];
        Recording::new(given, Some(load)).expect("a sane recording")
    }
}

/// Integrates over `h` with local errors of about 1e-14 of the state's size.
pub fn dormand_prince<const N: usize>(
    h: f64,
    start: &[f64; N],
    slope: impl Fn(f64, &[f64; N]) -> [f64; N],
) -> [f64; N] {
    const A: [[f64; 6]; 6] = [
        [0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
        [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
        [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
        [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
        [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
    ];
    const C: [f64; 7] = [0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0];
    const E: [f64; 7] =
        [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0];
    let (mut t, mut x, mut step) = (0.0, *start, h);
    while t < h {
        step = step.min(h - t);
        let mut k = [[0.0; N]; 7];
        k[0] = slope(t, &x);
        let mut next = x;
        for stage in 0..6 {
            next = x;
            for n in 0..N {
                for (m, a) in A[stage].iter().enumerate().take(stage + 1) {
                    next[n] += step * a * k[m][n];
                }
            }
            k[stage + 1] = slope(t + C[stage + 1] * step, &next);
        }
        let error = (0..N)
            .map(|n| {
                let e: f64 = (0..7).map(|m| E[m] * k[m][n]).sum();
                (step * e / (1e-14 + 1e-14 * x[n].abs().max(next[n].abs()))).abs()
            })
            .fold(0.0, f64::max);
        if error <= 1.0 || step < 1e-9 * h {
            t = if step >= h - t { h } else { t + step };
            x = next;
        }
        step *= (0.9 * error.max(1e-10).powf(-0.2)).clamp(0.2, 5.0);
    }
    x
}

/// Normal deviates from a counter.
#[derive(Debug)]
pub struct Gauss(pub u64);

impl Gauss {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// The next one.
    pub fn draw(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}
