//! The load torque of a run: what the recording tells of it, and levels that are fitted.

use crate::numerics::real::Real;
use crate::recording::Load;
use crate::signals::Signals;

/// What a run leaves open beside the model's parameters: an unknown load torque, constant between instants that are
/// themselves parameters, and the initial values of the mechanical extra states. Its parameters are the load levels
/// (N·m), the instants at which they change (s from the first sample, ascending), and the deviation of each extra
/// state from its quasi-static start, where the recording begins and behind each gap. What the recording tells of the load comes on top.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Nuisance {
    /// Number of unknown levels; zero if the load is known.
    pub levels: usize,
    /// Number of initial values of the model's mechanical extra states: theirs where the recording begins, and as many for each later
    /// [beginning](super::beginnings); where they are fewer the later ones are quasi-static.
    pub initial: usize,
}

impl Nuisance {
    /// A load that is known or absent.
    pub fn known(initial: usize) -> Self {
        Self { levels: 0, initial }
    }

    /// A load of unknown level that changes `steps` times.
    pub fn unknown(steps: usize, initial: usize) -> Self {
        Self { levels: steps + 1, initial }
    }

    /// Number of instants at which the level changes.
    pub fn steps(&self) -> usize {
        self.levels.saturating_sub(1)
    }

    /// Number of parameters: levels, instants, initial values.
    pub fn parameter_count(&self) -> usize {
        self.levels + self.steps() + self.initial
    }
}

/// Mean load torque over the interval of length `h` (s) from sample `k` to `next`; `level` is a cursor into the profile. It is
/// smooth in the instants, so that they can be fitted like any parameter.
#[inline(always)]
pub(super) fn load_over<T: Real>(
    load: Nuisance,
    own: &[T],
    signals: &Signals,
    k: usize,
    next: usize,
    h: f64,
    level: &mut usize,
) -> T {
    let known = match signals.load {
        Load::KnownConstant(value) => value,
        Load::Measured => signals
            .tau_m
            .as_ref()
            .map_or(0.0, |tau| if next < tau.len() { mean(&tau[k..=next]) } else { tau[k] }),
        _ => 0.0,
    };
    if load.levels == 0 {
        return T::constant(known);
    }
    let (levels, rest) = own.split_at(load.levels);
    let steps = &rest[..load.steps()];
    let end = T::constant(signals.t[k] + h);
    // Share of the interval behind the next instant: negative before it, above one once it lies in the past.
    while *level < steps.len() && ((end - steps[*level]) * (1.0 / h) - 1.0).positive() {
        *level += 1;
    }
    let mean = levels[*level] + known;
    match steps.get(*level) {
        Some(step) if (end - *step).positive() => {
            mean + (levels[*level + 1] - levels[*level]) * ((end - *step) * (1.0 / h))
        }
        _ => mean,
    }
}

/// Mean of a piecewise linear signal given at equal distances.
fn mean(x: &[f64]) -> f64 {
    let inner: f64 = x[1..x.len() - 1].iter().sum();
    (inner + 0.5 * (x[0] + x[x.len() - 1])) / (x.len() - 1) as f64
}
