//! Steady operating points and open terminals: what voltage the model calls for at each measured current and speed.
//!
//! With a constant current dλ/dt = ω·∂λ_m/∂θ, the turning magnet's alone: the right-hand side of the electrical equation at the
//! flux linkage that belongs to the measured current, less this, is the unexplained voltage. At operating points, where
//! nothing is known of the angle, the magnet's flux does not depend on it.

use super::environment::{measured_env, true_env};
use crate::base::Base;
use crate::effects::ELECTRICAL_STATES;
use crate::model::Model;
use crate::numerics::real::{Carries, Loop, Real};
use crate::numerics::transforms::rotate;
use crate::signals::Signals;

/// Hands to `sink` the sample number and the d, q voltage that the model calls for there, V, in the logged frame.
pub fn run<T: Real>(model: &Model, signals: &Signals, p: &[T], mut sink: impl FnMut(usize, [T; 2])) {
    T::compact(Run { model, signals, p, sink: &mut sink });
}

struct Run<'a, T> {
    model: &'a Model,
    signals: &'a Signals,
    p: &'a [T],
    sink: &'a mut dyn FnMut(usize, [T; 2]),
}

impl<T: Real> Loop<T> for Run<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Carries<T>>(self) {
        let Self { model, signals, sink, .. } = self;
        let (Some(v), Some(phases)) = (&signals.v, &signals.phases) else { return };
        let p: Vec<W> = self.p.iter().map(|x| W::carry(*x)).collect();
        let base = Base::new(&p);
        for k in 0..signals.len() {
            let measured = measured_env(signals, k);
            let sensor = model.sensor(&p, &measured);
            let env = true_env(&sensor, &measured, signals.n_p);
            let abc = [0, 1, 2].map(|x: usize| W::constant(phases[x][k]));
            let i = model.true_current(&sensor, abc, measured.theta_e);
            let state: [W; ELECTRICAL_STATES] = model.steady_state(&p, &base, i, &env).0;
            let (s, c) = sensor.angle.sin_cos();
            let command = rotate([W::constant(v[0][k]), W::constant(v[1][k])], c, s);
            let rest = model.electrical_rhs(&p, &base, &state, command, &env);
            let turning = model.magnet_slope(&p, &base, &state, &env);
            let rest = rotate([0, 1].map(|x| rest[x] - env.omega_e * turning[x]), c, -s);
            sink(k, [0, 1].map(|x: usize| (W::constant(v[x][k]) - rest[x]).give()));
        }
    }
}
