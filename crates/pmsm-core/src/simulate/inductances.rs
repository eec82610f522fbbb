//! Incremental inductances of a model along a recording.

use super::environment::measured_env;
use crate::base::Base;
use crate::effects::ELECTRICAL_STATES;
use crate::model::Model;
use crate::numerics::real::{Carries, Loop, Real};
use crate::signals::Signals;

/// Samples of a recording at which its inductances are looked at.
const POINTS: usize = 64;

/// The inductances (d, q), H, that noise of the voltage meets: those of small changes, at the measured currents of samples all over
/// the recording, so that their mean square is that of the slopes ∂i/∂λ.
pub fn incremental_inductances<T: Real>(model: &Model, signals: &Signals, p: &[T]) -> [T; 2] {
    T::compact(Incremental { model, signals, p })
}

struct Incremental<'a, T> {
    model: &'a Model,
    signals: &'a Signals,
    p: &'a [T],
}

impl<T: Real> Loop<T> for Incremental<'_, T> {
    type Output = [T; 2];
    #[inline(always)]
    fn run<W: Carries<T>>(self) -> [T; 2] {
        let Self { model, signals, .. } = self;
        let p: Vec<W> = self.p.iter().map(|x| W::carry(*x)).collect();
        let base = Base::new(&p);
        let Some(i) = &signals.i else { return [base.l_d.give(), base.l_q.give()] };
        let stride = signals.len().div_ceil(POINTS).max(1);
        let (mut squares, mut count) = ([W::zero(); 2], 0.0);
        for k in (0..signals.len()).step_by(stride) {
            let env = measured_env(signals, k);
            let now = [0, 1].map(|axis: usize| W::constant(i[axis][k]));
            let state: [W; ELECTRICAL_STATES] = model.steady_state(&p, &base, now, &env).0;
            let [d, _, q] = model.state_current(&p, &base, &state, &env).inverse;
            squares = [squares[0] + d * d, squares[1] + q * q];
            count += 1.0;
        }
        squares.map(|square| (W::one() / (square * (1.0 / count)).sqrt()).give())
    }
}
