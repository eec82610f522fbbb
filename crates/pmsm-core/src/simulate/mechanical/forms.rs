//! A rotor with states of its own at several parameter vectors beside one another.

use super::between::Fixed;
use super::{Nuisance, Restart, run_sized};
use crate::effects::MECHANICAL_STATES;
use crate::model::Model;
use crate::numerics::dual::Dual;
use crate::numerics::real::{Abreast, Real, Several};
use crate::signals::Signals;
use crate::simulate::forms::{Each, LANES, beside};
use std::ops::Range;

/// By what the derivative is taken that a run in several forms carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum By {
    /// What is seeded in the parameter vectors.
    Parameter,
    /// The electrical speed with which each window begins.
    Start,
}

/// The speed in free run at several parameter vectors, each with a derivative.
#[derive(Debug, Clone, Copy)]
pub struct Forms<'a> {
    /// The model.
    pub model: &'a Model,
    /// The recording.
    pub signals: &'a Signals,
    /// Parameter vectors of the model, each followed by those of the load.
    pub forms: &'a [Vec<Dual<1>>],
    /// Motor torque per sample, N·m.
    pub tau_e: &'a [f64],
    /// The load.
    pub load: Nuisance,
    /// The windows.
    pub windows: &'a [Range<usize>],
    /// Electrical speed with which each begins, rad/s.
    pub starts: &'a [f64],
    /// What the derivative is taken by.
    pub by: By,
}

impl Forms<'_> {
    /// Hands to `sink` the number of the vector, that of the sample and the electrical speed that the log should show, rad/s. Does nothing
    /// and returns `false` where this processor has no vectors for it, or the rotor has no states: then its windows run beside one
    /// another instead.
    pub fn run(self, mut sink: impl FnMut(usize, usize, Dual<1>)) -> bool {
        let sink = |form, k, [shown]: [Dual<1>; 1]| sink(form, k, shown);
        let done = match self.model.mechanical_states() {
            0 => None,
            _ => Dual::abreast(Sized::<_, MECHANICAL_STATES> { run: self, sink }),
        };
        done.is_some()
    }
}

/// Runs with `N` states.
struct Sized<'a, S, const N: usize> {
    run: Forms<'a>,
    sink: S,
}

impl<S: FnMut(usize, usize, [Dual<1>; 1]), const N: usize> Abreast<Dual<1>> for Sized<'_, S, N> {
    type Output = ();
    const FEWEST: usize = 1;
    #[inline(always)]
    fn run<W: Several<Dual<1>>>(mut self) {
        let Forms { model, signals, forms, tau_e, load, windows, starts, by } = self.run;
        let count = model.parameter_count();
        for (group, forms) in forms.chunks(W::COUNT).enumerate() {
            let all: Vec<W> = beside(forms);
            let (p, own) = all.split_at(count);
            let (load, restart) = ((load, own), Given { starts, by });
            let mut sink = Each::new(&mut self.sink, group * W::COUNT, forms.len());
            run_sized::<W, _, N>(model, signals, p, &Fixed(tau_e), load, windows, restart, &mut sink);
        }
    }
}

/// Restarts from given electrical speeds (rad/s).
struct Given<'a> {
    starts: &'a [f64],
    by: By,
}

impl<W: Several<Dual<1>>> Restart<W> for Given<'_> {
    fn speed(&mut self, number: usize, _: usize) -> W {
        W::all(match self.by {
            By::Parameter => Dual::constant(self.starts[number]),
            By::Start => Dual::variable(self.starts[number], 0),
        })
    }
    fn forget(&self, state: &mut W) {
        if self.by == By::Start {
            // The derivative belongs to the start of its own window.
            let mut lanes = [Dual::zero(); LANES];
            state.put(&mut lanes);
            *state = W::of(&lanes.map(|x| Dual::constant(x.re)));
        }
    }
}
