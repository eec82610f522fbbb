//! Windows beside one another: each lane of a vector runs a window of its own, so that its steps need not wait for one another.
//!
//! That is open to a rotor without states of its own, which takes nothing along from window to window. A lane holds the bits that
//! [`super::run`] gives its window on dual numbers.

use super::between::{Fixed, Way, environment, halfway, mix, span, steps_are_coarse};
use super::load::load_over;
use super::{Nuisance, Rhs};
use crate::base::Base;
use crate::effect::Env;
use crate::model::Model;
use crate::numerics::dual::Beside;
use crate::numerics::lanes::{self, Job, Lane, Path};
use crate::numerics::real::Real;
use crate::numerics::rk4::{self, Length};
use crate::signals::Signals;
use std::ops::{Mul, Range};

/// Lanes at most.
const LANES: usize = 8;

/// Most derivatives that lanes carry: with more of them a number alone fills a vector.
const MOST: usize = 4;

/// Windows in free run, each from a given speed.
#[derive(Debug, Clone, Copy)]
pub struct Windows<'a> {
    /// The model.
    pub model: &'a Model,
    /// The recording.
    pub signals: &'a Signals,
    /// Parameters of the model.
    pub p: &'a [f64],
    /// Motor torque per sample, N·m.
    pub tau_e: &'a [f64],
    /// The load with its parameters.
    pub load: (Nuisance, &'a [f64]),
    /// The windows.
    pub windows: &'a [Range<usize>],
    /// Electrical speed with which each begins, rad/s.
    pub starts: &'a [f64],
    /// Parameters of the model, neither electrical nor a sensor's, with respect to which derivatives are wanted.
    pub varied: &'a [usize],
}

impl Windows<'_> {
    /// Hands to `sink` the sample number, the electrical speed that the log should show (rad/s), and its derivatives: first those with
    /// respect to `varied`, and as the last of `N` that with respect to the speed with which the window begins. Does nothing and returns
    /// `false` where this processor has no vectors for it, or the rotor takes more along than its speed.
    pub fn run<const N: usize>(self, sink: impl FnMut(usize, f64, &[f64; N])) -> bool {
        if const { N > MOST } {
            return false;
        }
        let alone = self.model.mechanical_states() == 0;
        let path = Path::best();
        if !alone || path < Path::Avx2 || self.windows.len() < 2 {
            return false;
        }
        let together = Together::<_, N> { run: self, sink };
        // Half-empty vectors cost as much as full ones.
        if path == Path::Avx512 && self.windows.len() > LANES / 2 {
            lanes::avx512(together);
        } else {
            lanes::avx2(together);
        }
        true
    }
}

struct Together<'a, S, const N: usize> {
    run: Windows<'a>,
    sink: S,
}

impl<S: FnMut(usize, f64, &[f64; N]), const N: usize> Job for Together<'_, S, N> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lane>(mut self) {
        let Windows { windows, varied, .. } = self.run;
        // Windows of about one length end together.
        let mut order: Vec<usize> = (0..windows.len()).collect();
        order.sort_by_key(|window| windows[*window].len());
        let mut p: Vec<Beside<V, N>> = self.run.p.iter().map(|x| Beside::constant(*x)).collect();
        for (slot, k) in varied.iter().enumerate() {
            p[*k] = Beside::variable(p[*k].values(), slot, V::one());
        }
        let base = Base::new(&p);
        for group in order.chunks(V::WIDTH) {
            self.group::<V>(&p, &base, group);
        }
    }
}

impl<S: FnMut(usize, f64, &[f64; N]), const N: usize> Together<'_, S, N> {
    #[inline(always)]
    fn group<V: Lane>(&mut self, p: &[Beside<V, N>], base: &Base<Beside<V, N>>, group: &[usize]) {
        let Windows { model, signals, windows, starts, .. } = self.run;
        let (n_p, sensed) = (signals.n_p, model.has_sensor());
        let coarse = steps_are_coarse(signals);
        let mut rows = Rows::default();
        let mut begin = [0.0; LANES];
        // Places left over stand still and show nothing.
        let mut way: [Lead; LANES] = std::array::from_fn(|_| Lead::new(&self.run, windows[group[0]].start));
        for (lane, window) in group.iter().enumerate() {
            way[lane] = Lead::new(&self.run, windows[*window].start);
            rows.scale[0][lane] = way[lane].here.1;
            begin[lane] = starts[*window];
        }
        let start = Beside::<V, N>::variable(V::load(&begin), N - 1, V::one());
        let mut state = [start * fixed(&rows.scale[0]) * (1.0 / n_p)];
        loop {
            let speed = state[0] * n_p;
            let show = Shown::of(if sensed { speed / fixed(&rows.scale[0]) } else { speed });
            let mut running = false;
            for (lane, window) in group.iter().enumerate() {
                let (lead, window) = (&mut way[lane], &windows[*window]);
                if lead.k < window.end {
                    show.hand(lane, lead.k, &mut self.sink);
                }
                lead.span = 0;
                if lead.k + 1 < window.end {
                    running = true;
                    lead.span = span(signals, lead.k, window, coarse);
                    lead.drive(&self.run, window, lane, &mut rows);
                } else {
                    lead.k = window.end;
                }
            }
            if !running {
                return;
            }
            let at = |c: usize| {
                let env = Env {
                    t: fixed(&rows.t[c]),
                    omega_e: Beside::zero(),
                    theta_e: fixed(&rows.theta_e[c]),
                    theta_m: fixed(&rows.theta_m[c]),
                    heating: 0.0,
                    magnet_heating: 0.0,
                };
                (fixed(&rows.torque[c]), env)
            };
            let rhs = Rhs { model, p, base, at: [at(0), at(1), at(2)], tau_load: fixed(&rows.load) };
            let middle;
            (middle, state) = rk4::advance_with_middle(Apart(V::load(&rows.h)), &state, &rhs);
            if way.iter().any(|lead| lead.span == 2) {
                let speed = middle[0] * n_p;
                let show = Shown::of(if sensed { speed / fixed(&rows.scale[1]) } else { speed });
                for (lane, lead) in way.iter().enumerate().take(group.len()) {
                    if lead.span == 2 {
                        show.hand(lane, lead.k + 1, &mut self.sink);
                    }
                }
            }
            for (lane, lead) in way.iter_mut().enumerate().take(group.len()) {
                lead.k += lead.span;
                rows.scale[0][lane] = lead.here.1;
            }
        }
    }
}

/// Numbers without derivatives.
#[inline(always)]
fn fixed<V: Lane, const N: usize>(x: &[f64; LANES]) -> Beside<V, N> {
    Beside::fixed(V::load(x))
}

/// Where a lane is in its window.
struct Lead {
    k: usize,
    /// Samples that the step from there spans; none behind the end.
    span: usize,
    /// Cursor into the load's profile.
    level: usize,
    /// Environment and sensor's share at sample `k`, see [`environment`].
    here: (Env<f64>, f64),
}

impl Lead {
    #[inline(always)]
    fn new(run: &Windows, k: usize) -> Self {
        Self { k, span: 0, level: 0, here: environment(run.model, run.signals, run.p, k) }
    }

    /// Writes what drives the next step, and moves [`Lead::here`] to its end.
    #[inline(always)]
    fn drive(&mut self, run: &Windows, window: &Range<usize>, lane: usize, rows: &mut Rows) {
        let (k, span, t) = (self.k, self.span, &run.signals.t);
        let h = t[k + span] - t[k];
        let (load, own) = run.load;
        let begin = self.here;
        let end = environment(run.model, run.signals, run.p, k + span);
        let (half, half_scale) = if span == 2 {
            environment(run.model, run.signals, run.p, k + 1)
        } else {
            (mix(0.5, (begin.1, begin.0), (begin.1, end.0)).1, begin.1)
        };
        let torque = if span == 2 { run.tau_e[k + 1] } else { halfway(&Fixed(run.tau_e), k, window) };
        let way = Way { torque: [run.tau_e[k], torque, run.tau_e[k + span]], env: [begin.0, half, end.0] };
        for c in 0..3 {
            rows.torque[c][lane] = way.torque[c];
            rows.t[c][lane] = way.env[c].t;
            rows.theta_e[c][lane] = way.env[c].theta_e;
            rows.theta_m[c][lane] = way.env[c].theta_m;
        }
        rows.h[lane] = h;
        rows.load[lane] = load_over(load, own, run.signals, k, k + span, h, &mut self.level);
        rows.scale[1][lane] = half_scale;
        self.here = end;
    }
}

/// What drives a step, one number per lane; at its beginning, in its middle and at its end where there are three.
#[derive(Default)]
struct Rows {
    torque: [[f64; LANES]; 3],
    t: [[f64; LANES]; 3],
    theta_e: [[f64; LANES]; 3],
    theta_m: [[f64; LANES]; 3],
    h: [f64; LANES],
    load: [f64; LANES],
    /// The sensor's share at the beginning and in the middle.
    scale: [[f64; LANES]; 2],
}

/// Speeds and their derivatives, one number per lane.
struct Shown<const N: usize> {
    values: [f64; LANES],
    slopes: [[f64; LANES]; N],
}

impl<const N: usize> Shown<N> {
    #[inline(always)]
    fn of<V: Lane>(speed: Beside<V, N>) -> Self {
        let mut shown = Self { values: [0.0; LANES], slopes: [[0.0; LANES]; N] };
        speed.values().store(&mut shown.values);
        for slot in 0..N {
            speed.slopes(slot).store(&mut shown.slopes[slot]);
        }
        shown
    }

    #[inline(always)]
    fn hand(&self, lane: usize, k: usize, sink: &mut impl FnMut(usize, f64, &[f64; N])) {
        let mut slopes = [0.0; N];
        for slot in 0..N {
            slopes[slot] = self.slopes[slot][lane];
        }
        sink(k, self.values[lane], &slopes);
    }
}

/// Lengths of a step, one per lane.
#[derive(Clone, Copy)]
struct Apart<V>(V);

impl<V: Lane> Length for Apart<V> {
    #[inline(always)]
    fn times(self, c: f64) -> Self {
        Self(V::constant(c) * self.0)
    }
    #[inline(always)]
    fn over(self, n: f64) -> Self {
        Self(self.0 / V::constant(n))
    }
}

impl<V: Lane, const N: usize> Mul<Apart<V>> for Beside<V, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, h: Apart<V>) -> Self {
        self.scaled(h.0)
    }
}
