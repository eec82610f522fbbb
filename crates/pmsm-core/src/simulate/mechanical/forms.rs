//! A rotor with states of its own at several parameter vectors beside one another.

use super::between::Fixed;
use super::{Nuisance, Restart, run_sized};
use crate::effects::MECHANICAL_STATES;
use crate::model::Model;
use crate::numerics::real::{Abreast, Real, Several};
use crate::signals::Signals;
use crate::simulate::forms::{Each, beside};
use std::ops::Range;

/// The speed in free run at several parameter vectors.
#[derive(Debug, Clone, Copy)]
pub struct Forms<'a, T> {
    /// The model.
    pub model: &'a Model,
    /// The recording.
    pub signals: &'a Signals,
    /// Parameter vectors of the model, each followed by those of the load.
    pub forms: &'a [Vec<T>],
    /// Motor torque per sample, N·m.
    pub tau_e: &'a [f64],
    /// The load.
    pub load: Nuisance,
    /// The windows.
    pub windows: &'a [Range<usize>],
    /// Electrical speed with which each begins, rad/s.
    pub starts: &'a [f64],
}

impl<T: Real> Forms<'_, T> {
    /// Hands to `sink` the number of the vector, that of the sample and the electrical speed that the log should show, rad/s. Does nothing
    /// and returns `false` where this processor has no vectors for it, or the rotor has no states: then its windows run beside one
    /// another instead.
    pub fn run(self, mut sink: impl FnMut(usize, usize, T)) -> bool {
        let sink = |form, k, [shown]: [T; 1]| sink(form, k, shown);
        let done = match self.model.mechanical_states() {
            0 => None,
            _ => T::abreast(Sized::<T, _, MECHANICAL_STATES> { run: self, sink }),
        };
        done.is_some()
    }
}

/// Runs with `N` states.
struct Sized<'a, T, S, const N: usize> {
    run: Forms<'a, T>,
    sink: S,
}

impl<T: Real, S: FnMut(usize, usize, [T; 1]), const N: usize> Abreast<T> for Sized<'_, T, S, N> {
    type Output = ();
    const FEWEST: usize = 1;
    #[inline(always)]
    fn run<W: Several<T>>(mut self) {
        let Forms { model, signals, forms, tau_e, load, windows, starts } = self.run;
        let count = model.parameter_count();
        for (group, forms) in forms.chunks(W::COUNT).enumerate() {
            let all: Vec<W> = beside(forms);
            let (p, own) = all.split_at(count);
            let (load, restart) = ((load, own), Given { starts });
            let mut sink = Each::new(&mut self.sink, group * W::COUNT, forms.len());
            run_sized::<W, _, N>(model, signals, p, &Fixed(tau_e), load, windows, restart, &mut sink);
        }
    }
}

/// Restarts from given electrical speeds (rad/s) that do not change.
struct Given<'a> {
    starts: &'a [f64],
}

impl<W: Real> Restart<W> for Given<'_> {
    fn speed(&mut self, number: usize, _: usize) -> W {
        W::constant(self.starts[number])
    }
    fn forget(&self, _: &mut W) {}
}
