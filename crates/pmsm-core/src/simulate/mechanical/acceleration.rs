//! The acceleration of the rotor along a known course of its speed.

use super::between::{
    Fixed, Lifted, behind_sensors, environment, halfway, measured, mix, span, steps_are_coarse,
};
use super::load::{Nuisance, load_over};
use crate::base::Base;
use crate::effect::Env;
use crate::model::Model;
use crate::numerics::real::{Abreast, Carries, Loop, Real, Several};
use crate::signals::Signals;
use std::ops::Range;

/// Samples taken together at most.
const LANES: usize = 8;

/// Motor torque per sample, N·m: it may change with what derivatives are taken by.
#[derive(Debug, Clone, Copy)]
pub enum Torque<'a, T> {
    /// It does not.
    Fixed(&'a [f64]),
    /// It does.
    Varied(&'a [T]),
}

/// A rotor without states of its own whose speed is known.
#[derive(Debug, Clone, Copy)]
pub struct Rotor<'a, T> {
    /// The model.
    pub model: &'a Model,
    /// The recording.
    pub signals: &'a Signals,
    /// Parameters of the model.
    pub p: &'a [T],
    /// What drives it.
    pub tau_e: Torque<'a, T>,
    /// The load with its parameters.
    pub load: (Nuisance, &'a [f64]),
    /// The windows.
    pub windows: &'a [Range<usize>],
    /// Its electrical speed as the log shows it, rad/s.
    pub shown: &'a [f64],
}

impl<T: Real> Rotor<'_, T> {
    /// Evaluates its acceleration (rad/s², electrical, as the log shows it) and hands to `sink`, for each of the windows, that at its
    /// samples and that in the middle of the step from each of them to the next. [`super::run`] takes two samples in one step where
    /// they follow one another closely: of such a step the sample between is the middle, and none is given.
    pub fn accelerations(self, mut sink: impl FnMut(&Range<usize>, &[T], &[Option<T>])) {
        let wide = self.signals.len() > LANES;
        if !wide || T::abreast(Along { rotor: self, sink: &mut sink }).is_none() {
            T::fastest(Along { rotor: self, sink: &mut sink });
        }
    }

    /// Fills in what the window's steps are driven by.
    pub(super) fn drive(&self, window: &Range<usize>, coarse: bool, level: &mut usize, drive: &mut Drive<T>) {
        let Self { signals, load: (load, own), .. } = *self;
        let t = &signals.t;
        drive.load.clear();
        drive.middle.clear();
        let mut whole = window.start;
        for k in window.clone() {
            let last = k + 1 >= window.end;
            let h = if last { signals.period } else { t[k + 1] - t[k] };
            drive.load.push(load_over(load, own, signals, k, k + 1, h, level));
            let inside = k < whole;
            if !inside {
                whole = k + span(signals, k, window, coarse);
            }
            let single = !(inside || whole == k + 2 || last);
            drive.middle.push(single.then(|| {
                let torque = match self.tau_e {
                    Torque::Fixed(tau) => halfway(&Fixed(tau), k, window),
                    Torque::Varied(tau) => halfway(&Lifted(tau), k, window),
                };
                (torque, 0.5 * (self.shown[k] + self.shown[k + 1]) / signals.n_p)
            }));
        }
    }

    /// Hands to `visit` where the acceleration is asked for along a window whose steps are driven so: at each sample, and with `true`
    /// behind it in the middle of the step to the next, if there is one.
    #[inline(always)]
    pub(super) fn visit<W: Carries<T>>(
        &self,
        window: &Range<usize>,
        p: &[W],
        drive: &Drive<T>,
        mut visit: impl FnMut(usize, bool, Point<W>),
    ) {
        let Self { model, signals, shown, .. } = *self;
        let mut env = environment(model, signals, p, window.start);
        for k in window.clone() {
            let last = k + 1 >= window.end;
            let next = if last { env } else { environment(model, signals, p, k + 1) };
            let load = W::constant(drive.load[k - window.start]);
            let torque = match self.tau_e {
                Torque::Fixed(tau) => W::constant(tau[k]),
                Torque::Varied(tau) => W::carry(tau[k]),
            };
            visit(k, false, Point { speed: W::constant(shown[k] / signals.n_p), torque, load, env });
            if let Some((torque, speed)) = drive.middle[k - window.start] {
                let env = (mix(0.5, (env.1, env.0), (next.1, next.0)).1, env.1);
                visit(k, true, Point { speed: W::constant(speed), torque: W::carry(torque), load, env });
            }
            env = next;
        }
    }

    #[inline(always)]
    fn acceleration<W: Real>(
        &self,
        (p, base): (&[W], &Base<W>),
        omega_m: W,
        (torque, load): (W, W),
        (env, scale): (Env<W>, W),
    ) -> W {
        let state = [scale * omega_m];
        let [slope] = self.model.mechanical_rhs(p, base, &state, torque, load, &env);
        slope * self.signals.n_p / scale
    }
}

/// Where the acceleration is asked for.
pub(super) struct Point<W> {
    /// Mechanical speed as the log shows it, rad/s.
    pub(super) speed: W,
    /// Motor torque and mean load of the step, N·m.
    pub(super) torque: W,
    pub(super) load: W,
    /// The true environment, and the measured over the true speed's share that the sensor leaves.
    pub(super) env: (Env<W>, W),
}

/// What drives the steps of one window.
pub(super) struct Drive<T> {
    /// Mean load from each sample to the next, N·m.
    load: Vec<f64>,
    /// Motor torque (N·m) and speed as the log shows it (rad/s, mechanical) halfway to the next sample, where a step has its middle there.
    middle: Vec<Option<(T, f64)>>,
}

impl<T> Drive<T> {
    pub(super) fn of(windows: &[Range<usize>]) -> Self {
        let longest = windows.iter().map(Range::len).max().unwrap_or(0);
        Self { load: Vec::with_capacity(longest), middle: Vec::with_capacity(longest) }
    }
}

struct Along<'a, 's, T, S> {
    rotor: Rotor<'a, T>,
    sink: &'s mut S,
}

impl<T: Real, S: FnMut(&Range<usize>, &[T], &[Option<T>])> Loop<T> for Along<'_, '_, T, S> {
    type Output = ();
    #[inline(always)]
    fn run<W: Carries<T>>(self) {
        let Self { rotor, sink } = self;
        let p = rotor.p.iter().map(|x| W::carry(*x)).collect::<Vec<W>>();
        let base = Base::new(&p);
        let at = (&p[..], &base);
        let coarse = steps_are_coarse(rotor.signals);
        let (mut drive, mut level) = (Drive::of(rotor.windows), 0);
        let (mut here, mut between) = (Vec::new(), Vec::new());
        for window in rotor.windows {
            rotor.drive(window, coarse, &mut level, &mut drive);
            here.clear();
            between.clear();
            rotor.visit(window, &p, &drive, |_, inside, Point { speed, torque, load, env }| {
                let acceleration = rotor.acceleration(at, speed, (torque, load), env).give();
                if inside {
                    let last: Option<&mut Option<T>> = between.last_mut();
                    *last.expect("a sample comes before what is behind it") = Some(acceleration);
                } else {
                    here.push(acceleration);
                    between.push(None);
                }
            });
            sink(window, &here, &between);
        }
    }
}

impl<T: Real, S: FnMut(&Range<usize>, &[T], &[Option<T>])> Abreast<T> for Along<'_, '_, T, S> {
    type Output = ();
    const FEWEST: usize = 1;
    #[inline(always)]
    fn run<W: Several<T>>(self) {
        let Self { rotor, sink } = self;
        let Rotor { model, signals, shown, .. } = rotor;
        let p = rotor.p.iter().map(|x| W::all(*x)).collect::<Vec<W>>();
        let base = Base::new(&p);
        let at = (&p[..], &base);
        let coarse = steps_are_coarse(signals);
        let (mut drive, mut level) = (Drive::of(rotor.windows), 0);
        let (mut here, mut between) = (Vec::new(), Vec::new());
        let (mut lanes, last) = ([T::zero(); LANES], signals.len() - W::COUNT);
        for window in rotor.windows {
            rotor.drive(window, coarse, &mut level, &mut drive);
            here.clear();
            between.clear();
            let mut k = window.start;
            while k < window.end {
                // The last ones reach back, and those of a short window beyond it.
                let from = k.min(last);
                let end = window.end.min(from + W::COUNT);
                let own = k - window.start..end - window.start;
                let (mut load, mut speed) = ([0.0; LANES], [0.0; LANES]);
                load[k - from..end - from].copy_from_slice(&drive.load[own.clone()]);
                for lane in 0..W::COUNT {
                    speed[lane] = shown[from + lane] / signals.n_p;
                }
                let env = behind_sensors(model, signals, &p, measured(signals, from));
                let torque = match rotor.tau_e {
                    Torque::Fixed(tau) => W::plain(&tau[from..]),
                    Torque::Varied(tau) => W::of(&tau[from..]),
                };
                let given = (torque, W::plain(&load));
                rotor.acceleration(at, W::plain(&speed), given, env).put(&mut lanes);
                here.extend_from_slice(&lanes[k - from..end - from]);

                let middle = &drive.middle[own];
                if middle.iter().any(Option::is_some) {
                    // Behind each of these there is one sample more.
                    let first = k.min(last - 1);
                    let env = if first == from {
                        env
                    } else {
                        behind_sensors(model, signals, &p, measured(signals, first))
                    };
                    let next = behind_sensors(model, signals, &p, measured(signals, first + 1));
                    let half = (mix(0.5, (env.1, env.0), (next.1, next.0)).1, env.1);
                    let (mut load, mut speed) = ([0.0; LANES], [0.0; LANES]);
                    let mut torque = [T::zero(); LANES];
                    for (place, asked) in middle.iter().enumerate() {
                        if let Some((own, shown)) = asked {
                            let lane = k - first + place;
                            (torque[lane], speed[lane]) = (*own, *shown);
                            load[lane] = drive.load[k - window.start + place];
                        }
                    }
                    let given = (W::of(&torque), W::plain(&load));
                    rotor.acceleration(at, W::plain(&speed), given, half).put(&mut lanes);
                    let found = middle.iter().enumerate();
                    between.extend(found.map(|(n, asked)| asked.map(|_| lanes[k - first + n])));
                } else {
                    between.resize(between.len() + middle.len(), None);
                }
                k = end;
            }
            sink(window, &here, &between);
        }
    }
}
