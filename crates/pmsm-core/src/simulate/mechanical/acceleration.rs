//! The acceleration of the rotor along a known course of its speed.

use super::between::{environment, halfway, mix, span, steps_are_coarse};
use super::load::{Nuisance, load_over};
use crate::base::Base;
use crate::effect::Env;
use crate::model::Model;
use crate::real::{Carries, Loop, Real};
use crate::signals::Signals;
use std::ops::Range;

/// Evaluates the acceleration (rad/s², electrical, as the log shows it) that a rotor without states of its own has where its speed is
/// `shown` (rad/s, likewise), and hands to `sink`, for each of the `windows`, that at its samples and that in the middle of the step
/// from each of them to the next. [`super::run`] takes two samples in one step where they follow one another closely: of such a step
/// the sample between is the middle, and none is given. `tau_e` is the motor torque per sample, and `load` comes with its parameters.
pub fn accelerations<T: Real>(
    model: &Model,
    signals: &Signals,
    p: &[T],
    tau_e: &[T],
    load: (Nuisance, &[T]),
    windows: &[Range<usize>],
    shown: &[f64],
    sink: impl FnMut(&Range<usize>, &[T], &[Option<T>]),
) {
    T::fastest(Along { model, signals, p, tau_e, load, windows, shown, sink });
}

struct Along<'a, T, S> {
    model: &'a Model,
    signals: &'a Signals,
    p: &'a [T],
    tau_e: &'a [T],
    load: (Nuisance, &'a [T]),
    windows: &'a [Range<usize>],
    shown: &'a [f64],
    sink: S,
}

impl<T: Real, S: FnMut(&Range<usize>, &[T], &[Option<T>])> Loop<T> for Along<'_, T, S> {
    type Output = ();
    #[inline(always)]
    fn run<W: Carries<T>>(mut self) {
        let Self { model, signals, tau_e, windows, shown, .. } = self;
        let carry = |x: &[T]| x.iter().map(|x| W::carry(*x)).collect::<Vec<W>>();
        let (p, own) = (carry(self.p), carry(self.load.1));
        let (base, load) = (Base::new(&p), self.load.0);
        let coarse = steps_are_coarse(signals);
        let longest = windows.iter().map(Range::len).max().unwrap_or(0);
        let (mut here, mut between) = (Vec::with_capacity(longest), Vec::with_capacity(longest));
        let mut level = 0;
        for window in windows {
            here.clear();
            between.clear();
            let mut at = environment(model, signals, &p, window.start);
            let mut whole = window.start;
            for k in window.clone() {
                let last = k + 1 >= window.end;
                let next = if last { at } else { environment(model, signals, &p, k + 1) };
                let h = if last { signals.period } else { signals.t[k + 1] - signals.t[k] };
                let tau_load = load_over(load, &own, signals, k, k + 1, h, &mut level);
                let rotor = Rotor { model, p: &p, base: &base, n_p: signals.n_p, tau_load };
                here.push(rotor.acceleration(shown[k], W::carry(tau_e[k]), at).give());
                let inside = k < whole;
                if !inside {
                    whole = k + span(signals, k, window, coarse);
                }
                between.push(if inside || whole == k + 2 || last {
                    None
                } else {
                    let env = mix(0.5, (at.1, at.0), (next.1, next.0)).1;
                    let speed = 0.5 * (shown[k] + shown[k + 1]);
                    Some(rotor.acceleration(speed, halfway(tau_e, k, window), (env, at.1)).give())
                });
                at = next;
            }
            (self.sink)(window, &here, &between);
        }
    }
}

/// The rotor during one step. A type of its own insists on being inlined, which a closure does not.
struct Rotor<'a, T> {
    model: &'a Model,
    p: &'a [T],
    base: &'a Base<T>,
    n_p: f64,
    tau_load: T,
}

impl<T: Real> Rotor<'_, T> {
    #[inline(always)]
    fn acceleration(&self, shown: f64, torque: T, (env, scale): (Env<T>, T)) -> T {
        let state = [scale * (shown / self.n_p)];
        let [slope] = self.model.mechanical_rhs(self.p, self.base, &state, torque, self.tau_load, &env);
        slope * self.n_p / scale
    }
}
