//! Torque that effects and a map take from a rotor along a known course of its speed. Without states of their own they take it beside one
//! another, so that one can be asked without the others, and what they are asked at is found once for all of them.

use super::acceleration::{Drive, Point, Rotor};
use super::between::steps_are_coarse;
use crate::base::Base;
use crate::effect::{Env, Mechanical};
use crate::machine::BaseParameter;
use crate::model::{Model, Slot};
use crate::numerics::real::{Abreast, Carries, Loop, Real, Several};
use std::ops::Range;

/// Stations taken together at most.
const LANES: usize = 8;

/// Where the rotor's acceleration is asked for, in the order of time: at each sample of its windows, and behind it in the middle of the
/// step to the next, where a step has its middle there.
#[derive(Debug, Clone, Default)]
pub struct Stations {
    t: Vec<f64>,
    theta_e: Vec<f64>,
    theta_m: Vec<f64>,
    omega_m: Vec<f64>,
    tau_e: Vec<f64>,
    tau_load: Vec<f64>,
    /// Acceleration as the log shows it per torque that is lost, rad/s² (electrical) per N·m.
    gain: Vec<f64>,
    /// The station of each sample.
    of_sample: Vec<usize>,
}

impl Stations {
    /// Those of a rotor.
    pub fn new(rotor: &Rotor<'_, f64>) -> Self {
        let Rotor { signals, windows, p, .. } = *rotor;
        let (coarse, inverse_j) = (steps_are_coarse(signals), Base::new(p).inverse_j);
        let (mut drive, mut level) = (Drive::of(windows), 0);
        let mut own = Self { of_sample: vec![0; signals.len()], ..Self::default() };
        for window in windows {
            rotor.drive(window, coarse, &mut level, &mut drive);
            rotor.visit(window, p, &drive, |k, inside, Point { speed, torque, load, env: (env, scale) }| {
                if !inside {
                    own.of_sample[k] = own.t.len();
                }
                own.t.push(env.t);
                own.theta_e.push(env.theta_e);
                own.theta_m.push(env.theta_m);
                own.omega_m.push(scale * speed);
                own.tau_e.push(torque);
                own.tau_load.push(load);
                own.gain.push(-inverse_j * signals.n_p / scale);
            });
        }
        own
    }

    /// The station of a sample.
    pub fn at(&self, sample: usize) -> usize {
        self.of_sample[sample]
    }

    /// That in the middle of the step from a sample to the next of its window, if the step has its middle there.
    pub fn behind(&self, sample: usize) -> Option<usize> {
        let at = self.at(sample);
        (self.at(sample + 1) > at + 1).then_some(at + 1)
    }

    /// Those of a window.
    fn within(&self, window: &Range<usize>) -> Range<usize> {
        self.at(window.start)..self.at(window.end - 1) + 1
    }

    fn len(&self) -> usize {
        self.t.len()
    }

    #[inline(always)]
    fn point<W: Real>(&self, model: &Model, j: W, plain: impl Fn(&[f64]) -> W) -> Mechanical<W> {
        let omega_m = plain(&self.omega_m);
        let env = Env {
            t: plain(&self.t),
            omega_e: omega_m * model.context().n_p,
            theta_e: plain(&self.theta_e),
            theta_m: plain(&self.theta_m),
            heating: 0.0,
            magnet_heating: 0.0,
        };
        Mechanical { env, omega_m, tau_e: plain(&self.tau_e), tau_load: plain(&self.tau_load), j }
    }
}

/// Some effects of a model and its map beside others; none has mechanical states.
#[derive(Debug, Clone, Copy)]
pub struct Losses<'a, T> {
    /// The model.
    pub model: &'a Model,
    /// Those that are asked.
    pub asked: &'a [&'a Slot],
    /// Whether the model's map is asked, too.
    pub map: bool,
    /// Parameters of the model.
    pub p: &'a [T],
    /// Where they are asked.
    pub stations: &'a Stations,
    /// The windows of the stations.
    pub windows: &'a [Range<usize>],
}

impl<T: Real> Losses<'_, T> {
    /// Hands to `sink`, for each of the windows, the number of its first station and what those that are asked add at each of its
    /// stations to the acceleration that the log shows, rad/s² (electrical).
    pub fn accelerations(self, mut sink: impl FnMut(&Range<usize>, usize, &[T])) {
        let wide = self.stations.len() >= LANES;
        if !wide || T::abreast(Asked { losses: self, sink: &mut sink }).is_none() {
            T::fastest(Asked { losses: self, sink: &mut sink });
        }
    }
}

struct Asked<'a, 's, T, S> {
    losses: Losses<'a, T>,
    sink: &'s mut S,
}

impl<T: Real, S: FnMut(&Range<usize>, usize, &[T])> Loop<T> for Asked<'_, '_, T, S> {
    type Output = ();
    #[inline(always)]
    fn run<W: Carries<T>>(self) {
        let Losses { model, asked, map, p, stations, windows } = self.losses;
        let p = p.iter().map(|x| W::carry(*x)).collect::<Vec<W>>();
        let (j, mut out) = (p[BaseParameter::J.index()], Vec::new());
        for window in windows {
            out.clear();
            let own = stations.within(window);
            for station in own.clone() {
                let at = stations.point(model, j, |x| W::constant(x[station]));
                let loss = model.torque_lost((asked, map), &p, &at).give();
                out.push(loss * stations.gain[station]);
            }
            (self.sink)(window, own.start, &out);
        }
    }
}

impl<T: Real, S: FnMut(&Range<usize>, usize, &[T])> Abreast<T> for Asked<'_, '_, T, S> {
    type Output = ();
    const FEWEST: usize = 1;
    #[inline(always)]
    fn run<W: Several<T>>(self) {
        let Losses { model, asked, map, p, stations, windows } = self.losses;
        let p = p.iter().map(|x| W::all(*x)).collect::<Vec<W>>();
        let (j, mut out) = (p[BaseParameter::J.index()], Vec::new());
        let (mut lanes, last) = ([T::zero(); LANES], stations.len() - W::COUNT);
        for window in windows {
            out.clear();
            let own = stations.within(window);
            let mut station = own.start;
            while station < own.end {
                // The last ones reach back, and those of a short window beyond it.
                let from = station.min(last);
                let end = own.end.min(from + W::COUNT);
                let at = stations.point(model, j, |x| W::plain(&x[from..]));
                model.torque_lost((asked, map), &p, &at).put(&mut lanes);
                let found = lanes[station - from..end - from].iter().zip(&stations.gain[station..end]);
                out.extend(found.map(|(loss, gain)| *loss * *gain));
                station = end;
            }
            (self.sink)(window, own.start, &out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::machine::Machine;
    use crate::numerics::dual::Dual;
    use crate::recording::Recording;
    use crate::signals::Signals;
    use crate::simulate::mechanical::{Nuisance, Torque};

    /// Cogging of amplitude one at six periods per turn beside another effect, asked along a speed that is known, sampled every `h` seconds.
    fn cogging(h: f64, windows: &[Range<usize>]) -> Vec<(usize, f64, f64)> {
        let t: Vec<f64> = (0..40).map(|k| h * f64::from(k)).collect();
        let columns = [
            ("t", t.clone()),
            ("omega_e", vec![30.0; 40]),
            ("theta_e", t.iter().map(|t| 30.0 * t).collect()),
            ("i_d", vec![0.0; 40]),
            ("i_q", vec![1.0; 40]),
            ("v_d", vec![0.0; 40]),
            ("v_q", vec![1.0; 40]),
        ];
        let columns = columns.map(|(name, x)| (name.to_owned(), x)).to_vec();
        let signals =
            Signals::new(&Recording::new(columns, None).unwrap(), &Machine::new(3).unwrap()).unwrap();
        let model = Model::new(signals.context, &[EffectId::CoulombFriction, EffectId::CoggingTorque]);
        let p = [0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3, 0.3, 1.0, 0.0, 0.0, 0.0, 0.0, 6.0];
        let rotor = Rotor {
            model: &model,
            signals: &signals,
            p: &p,
            tau_e: Torque::Fixed(&[0.45; 40]),
            load: (Nuisance::known(0), &[]),
            windows,
            shown: &[30.0; 40],
        };
        let stations = Stations::new(&rotor);
        let seeded: Vec<Dual<1>> = (0..p.len())
            .map(|k| if k == 8 { Dual::variable(p[k], 0) } else { Dual::constant(p[k]) })
            .collect();
        let asked: Vec<&Slot> =
            model.slots().iter().filter(|s| s.effect == EffectId::CoggingTorque).collect();
        let mut found = Vec::new();
        let losses =
            Losses { model: &model, asked: &asked, map: false, p: &seeded, stations: &stations, windows };
        losses.accelerations(|window, first, own| {
            for k in window.clone() {
                let mut keep = |t: f64, station: usize| {
                    let angle = 6.0 * 30.0 * t / 3.0;
                    let expected = -angle.cos() * signals.n_p / p[BaseParameter::J.index()];
                    found.push((k, own[station - first].eps[0], expected));
                };
                keep(signals.t[k], stations.at(k));
                let inside = (k + 1 < window.end).then(|| stations.behind(k)).flatten();
                if let Some(station) = inside {
                    keep(0.5 * (signals.t[k] + signals.t[k + 1]), station);
                }
            }
        });
        found
    }

    #[test]
    fn an_effect_is_asked_at_each_sample_and_in_the_middle_of_steps_of_one() {
        // Windows that no vector divides, and one that none fills; steps of two samples, and of one.
        let windows = [0..13, 13..16, 16..40];
        for (h, between) in [(1e-3, 0), (3e-3, 37)] {
            let found = cogging(h, &windows);
            let last = windows.iter().filter(|w| w.len() % 2 == 0).count();
            let inside = if between == 0 { last } else { between };
            assert_eq!(found.len(), 40 + inside, "{h}");
            for (k, slope, expected) in found {
                assert!((slope - expected).abs() < 1e-9 * 3000.0, "{h} {k}: {slope} {expected}");
            }
        }
    }
}
