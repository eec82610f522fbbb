//! The currents in free run, for whoever looks on from sample to sample.

use super::electrical::{Along, run_sized};
use crate::effect::Env;
use crate::effects::ELECTRICAL_STATES;
use crate::model::Model;
use crate::numerics::real::{Carries, Loop, Real};
use crate::signals::Signals;
use std::marker::PhantomData;

/// What looks on as the currents run from sample to sample.
pub trait Watch<T> {
    /// Whether it looks at more than what the log should show.
    fn closely(&self) -> bool {
        true
    }
    /// At sample `k`, the d, q current that the log should show there, A.
    fn show(&mut self, k: usize, shown: [T; 2]);
    /// The state `[λ_d, λ_q, extra …]` at the next sample, which may be changed before the run goes on from it.
    fn arrive(&mut self, _state: &mut [T]) {}
    /// Where the machine is at the sample that is shown next, and its current d, q, A.
    fn stand(&mut self, _env: &Env<T>, _i: [T; 2]) {}
    /// The voltage d, q that is held from there to the next sample, V. Not called at the last sample before a gap.
    fn leave(&mut self, _v: [T; 2]) {}
}

/// Takes what the log should show and nothing else.
pub(super) struct Shown<S>(pub S);

impl<T, S: FnMut(usize, [T; 2])> Watch<T> for Shown<S> {
    fn closely(&self) -> bool {
        false
    }
    fn show(&mut self, k: usize, shown: [T; 2]) {
        (self.0)(k, shown);
    }
}

/// Simulates the currents as [`super::electrical::run`] does, watched at every sample.
pub fn run<T: Real>(model: &Model, signals: &Signals, p: &[T], watch: &mut dyn Watch<T>) {
    match model.electrical_states() {
        0 => T::fastest(Watched::<T, 2> { model, signals, p, watch }),
        1..=2 => T::fastest(Watched::<T, 4> { model, signals, p, watch }),
        _ => T::fastest(Watched::<T, ELECTRICAL_STATES> { model, signals, p, watch }),
    }
}

/// A run with `N` states. Whoever looks on does so through a pointer, so that it is compiled once.
struct Watched<'a, T, const N: usize> {
    model: &'a Model,
    signals: &'a Signals,
    p: &'a [T],
    watch: &'a mut dyn Watch<T>,
}

impl<T: Real, const N: usize> Loop<T> for Watched<'_, T, N> {
    type Output = ();
    #[inline(always)]
    fn run<W: Carries<T>>(self) {
        let p: Vec<W> = self.p.iter().map(|x| W::carry(*x)).collect();
        let closely = self.watch.closely();
        let mut along = Onlooker { watch: self.watch, closely, number: PhantomData };
        run_sized::<W, N>(self.model, self.signals, &p, &mut along);
    }
}

/// Hands what it takes to somebody who watches.
struct Onlooker<'a, T> {
    watch: &'a mut dyn Watch<T>,
    closely: bool,
    number: PhantomData<T>,
}

impl<T: Real, W: Carries<T>> Along<W> for Onlooker<'_, T> {
    #[inline(always)]
    fn arrive<const N: usize>(&mut self, state: &mut [W; N]) {
        if !self.closely {
            return;
        }
        let mut own = [T::zero(); N];
        for n in 0..N {
            own[n] = state[n].give();
        }
        self.watch.arrive(&mut own);
        for n in 0..N {
            state[n] = W::carry(own[n]);
        }
    }
    #[inline(always)]
    fn stand(&mut self, k: usize, env: &Env<W>, i: [W; 2], shown: [W; 2]) {
        if self.closely {
            let env = Env {
                t: env.t.give(),
                omega_e: env.omega_e.give(),
                theta_e: env.theta_e.give(),
                theta_m: env.theta_m.give(),
                heating: env.heating,
                magnet_heating: env.magnet_heating,
            };
            self.watch.stand(&env, [i[0].give(), i[1].give()]);
        }
        self.watch.show(k, [shown[0].give(), shown[1].give()]);
    }
    #[inline(always)]
    fn leave(&mut self, v: [W; 2]) {
        if self.closely {
            self.watch.leave([v[0].give(), v[1].give()]);
        }
    }
}
