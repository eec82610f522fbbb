//! Currents in free run, driven by the logged voltage (held from sample to sample) and the measured speed and angle.

use super::environment::{between, measured_env, true_env};
use super::forms::{Each, Sink, beside};
use super::watched::{self, Shown};
use crate::base::Base;
use crate::effect::Env;
use crate::effects::ELECTRICAL_STATES;
use crate::model::{Known, Model, Standing};
use crate::numerics::real::{Abreast, Real, Several};
use crate::numerics::rk4::{self, Slope};
use crate::numerics::transforms::rotate;
use crate::signals::Signals;

/// Largest product of step and fastest rate; longer sample periods are divided.
const STEP_LIMIT: f64 = 0.15;
/// The same of a decimated recording.
const COARSE_LIMIT: f64 = 0.2;

/// Simulates the currents and hands to `sink` the sample number and the d, q current that the log should show, A.
/// `p` is the parameter vector of `model`. Each gap-free segment starts from its first measured current.
/// Nothing is called if the recording has no voltages or currents.
pub fn run<T: Real>(model: &Model, signals: &Signals, p: &[T], sink: impl FnMut(usize, [T; 2])) {
    watched::run(model, signals, p, &mut Shown(sink));
}

/// Simulates the currents at each of the parameter vectors `forms`, several beside one another, and hands to `sink` the number of the
/// vector and what [`run`] does. Does nothing and returns `false` where this processor has no vectors for it.
pub fn run_beside<T: Real>(
    model: &Model,
    signals: &Signals,
    forms: &[Vec<T>],
    sink: impl FnMut(usize, usize, [T; 2]),
) -> bool {
    let done = match model.electrical_states() {
        0 => T::abreast(Forms::<T, _, 2> { model, signals, forms, sink }),
        1..=2 => T::abreast(Forms::<T, _, 4> { model, signals, forms, sink }),
        _ => T::abreast(Forms::<T, _, ELECTRICAL_STATES> { model, signals, forms, sink }),
    };
    done.is_some()
}

/// Runs with `N` states.
struct Forms<'a, T, S, const N: usize> {
    model: &'a Model,
    signals: &'a Signals,
    forms: &'a [Vec<T>],
    sink: S,
}

impl<T: Real, S: FnMut(usize, usize, [T; 2]), const N: usize> Abreast<T> for Forms<'_, T, S, N> {
    type Output = ();
    const FEWEST: usize = 1;
    #[inline(always)]
    fn run<W: Several<T>>(mut self) {
        for (group, forms) in self.forms.chunks(W::COUNT).enumerate() {
            let p: Vec<W> = beside(forms);
            let mut sink = Each::new(&mut self.sink, group * W::COUNT, forms.len());
            run_sized::<W, N>(self.model, self.signals, &p, &mut sink);
        }
    }
}

/// Largest product of step and rate of a steep characteristic: the method stays stable up to 2.78 (Hairer & Wanner, Solving Ordinary
/// Differential Equations II, 1996, section IV.2).
pub(crate) const STABLE: f64 = 2.0;

/// What goes along with a run.
pub(super) trait Along<W> {
    /// At the state `[λ_d, λ_q, extra …]` of the next sample, which may be changed before the run goes on from it.
    #[inline(always)]
    fn arrive<const N: usize>(&mut self, _: &mut [W; N]) {}
    /// At sample `k`, with where the machine is, its current d, q and that which the log should show, A.
    fn stand(&mut self, k: usize, env: &Env<W>, i: [W; 2], shown: [W; 2]);
    /// Behind it, with the voltage d, q that is held to the next sample, V.
    #[inline(always)]
    fn leave(&mut self, _: [W; 2]) {}
}

impl<W, T, S> Along<W> for Each<'_, T, S>
where
    Self: Sink<W, 2>,
{
    #[inline(always)]
    fn stand(&mut self, k: usize, _: &Env<W>, _: [W; 2], shown: [W; 2]) {
        self.take(0, k, shown);
    }
}

#[inline(always)]
pub(super) fn run_sized<W: Real, const N: usize>(
    model: &Model,
    signals: &Signals,
    p: &[W],
    along: &mut impl Along<W>,
) {
    let (Some(v), Some(_), Some(phases)) = (&signals.v, &signals.i, &signals.phases) else { return };
    let base = Base::new(p);
    let (n_p, sensed) = (signals.n_p, model.has_sensor());
    // Effects' own states may follow the voltage from one sample of the log to the next.
    let closely = signals.within.as_ref().filter(|_| model.electrical_states() > 0);
    let limit = if signals.decimation() > 1 { COARSE_LIMIT } else { STEP_LIMIT };
    let steep = model.steep_rate(p, &base) * (limit / STABLE);
    let mut state = [W::zero(); N];
    for segment in &signals.segments {
        let mut measured = measured_env(signals, segment.start);
        let mut sensor = model.sensor(p, &measured);
        let mut env = true_env(&sensor, &measured, n_p);
        for k in segment.clone() {
            if k == segment.start {
                let abc = [0, 1, 2].map(|x: usize| W::constant(phases[x][k]));
                let i = model.true_current(&sensor, abc, measured.theta_e);
                state = model.temperatures(&state);
                model.state_under(p, &base, i, Known::default(), &mut state, &env);
            }
            along.arrive(&mut state);
            let standing = model.standing(p, &base, &state, &env);
            let i = standing.i;
            let shown = if sensed { model.measured_current(&sensor, i, measured.theta_e) } else { i };
            along.stand(k, &env, i, shown);
            if k + 1 == segment.end {
                break;
            }
            let h = signals.t[k + 1] - signals.t[k];
            let logged = h / signals.decimation() as f64;
            let next_measured = measured_env(signals, k + 1);
            let (next_sensor, next_env) = if sensed {
                let next_sensor = model.sensor(p, &next_measured);
                (next_sensor, true_env(&next_sensor, &next_measured, n_p))
            } else {
                (sensor, next_measured)
            };
            let rate = (signals.omega_e[k].abs() + signals.context.electrical_rate).max(steep);
            let pieces = match closely {
                Some(within) => within.factor,
                None => ((h * rate / limit).ceil() as usize).clamp(1, 64),
            };
            let mut command = [W::zero(); 2];
            for piece in 0..pieces {
                if piece == 0 || closely.is_some() {
                    let taps = match closely {
                        Some(within) => taps_of_log(&within.v, 0, k * within.factor + piece),
                        None => taps(signals, v, segment.start, k),
                    };
                    command = model.command(p, &taps, env.omega_e * logged);
                    if sensed {
                        let (s, c) = sensor.angle.sin_cos();
                        command = rotate(command, c, s);
                    }
                    if signals.stator_held.is_some() {
                        command = fading(command, env.omega_e, signals.held_period(), &base);
                    }
                }
                if piece == 0 {
                    along.leave(command);
                }
                let known = (piece == 0).then_some(&standing);
                let (piece, pieces) = (piece as f64, pieces as f64);
                let rhs = Rhs {
                    known,
                    model,
                    p,
                    base: &base,
                    v: command,
                    start: between(&env, &next_env, piece / pieces),
                    middle: between(&env, &next_env, (piece + 0.5) / pieces),
                    end: between(&env, &next_env, (piece + 1.0) / pieces),
                };
                state = rk4::advance(h / pieces, &state, &rhs);
            }
            (measured, sensor, env) = (next_measured, next_sensor, next_env);
        }
    }
}

/// The voltage, held in the rotor's frame, by which the currents end where they do under `v` (d, q), V, that is held in the stator's for
/// `held` s: while it turns back about its middle by ω_e·t, the winding forgets what came first, v + ω_e·r_s·h²/12·(v_q/l_d, −v_d/l_q)
/// to first order in r_s·h/l.
#[inline(always)]
fn fading<T: Real>(v: [T; 2], omega_e: T, held: f64, base: &Base<T>) -> [T; 2] {
    let fade = omega_e * base.r_s * (held * held / 12.0);
    [v[0] + fade * v[1] * base.inverse_l_d, v[1] - fade * v[0] * base.inverse_l_q]
}

/// The right-hand side within one step.
struct Rhs<'a, T> {
    model: &'a Model,
    p: &'a [T],
    base: &'a Base<T>,
    v: [T; 2],
    /// What the state at its beginning tells, where that is known.
    known: Option<&'a Standing<T>>,
    /// Where the machine is at its beginning, in its middle, and at its end.
    start: Env<T>,
    middle: Env<T>,
    end: Env<T>,
}

impl<T: Real, const N: usize> Slope<T, N> for Rhs<'_, T> {
    #[inline(always)]
    fn at(&self, c: f64, state: &[T; N]) -> [T; N] {
        let env = if c == 0.0 {
            &self.start
        } else if c == 0.5 {
            &self.middle
        } else {
            &self.end
        };
        let standing = match self.known {
            Some(known) if c == 0.0 => *known,
            _ => self.model.standing(self.p, self.base, state, env),
        };
        self.model.electrical_slope(self.p, state, &standing, self.v, env)
    }
}

/// Voltage commands of sample `k` and of the two samples of the log before, none from before the segment that begins at `start`.
#[inline(always)]
pub fn taps<T: Real>(signals: &Signals, v: &[Vec<f64>; 2], start: usize, k: usize) -> [[T; 2]; 3] {
    let of = |v: &[Vec<f64>; 2], k: usize| [T::constant(v[0][k]), T::constant(v[1][k])];
    match &signals.within {
        Some(within) => [of(v, k), of(&within.later[0], k), of(&within.later[1], k)],
        None => taps_of_log(v, start, k),
    }
}

/// The same of sample `k` of the log.
#[inline(always)]
fn taps_of_log<T: Real>(v: &[Vec<f64>; 2], start: usize, k: usize) -> [[T; 2]; 3] {
    let mut taps = [[T::zero(); 2]; 3];
    for (back, tap) in taps.iter_mut().enumerate() {
        let k = k.saturating_sub(back).max(start);
        *tap = [T::constant(v[0][k]), T::constant(v[1][k])];
    }
    taps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectId;
    use crate::effects::dead_time::DeadTime;
    use crate::effects::testing::{lost, winding};
    use crate::machine::Machine;
    use crate::numerics::dual::Dual;
    use crate::recording::Recording;
    use crate::signals::Logged;

    /// A log of these currents, a row every `h` s, at a speed and under a voltage d, q that stay as they are.
    fn logged(h: f64, omega: f64, v: [f64; 2], currents: &[[f64; 2]]) -> Signals {
        let of = |f: &dyn Fn(usize) -> f64| (0..currents.len()).map(f).collect::<Vec<_>>();
        let columns = vec![
            ("t".to_string(), of(&|k| h * k as f64)),
            ("theta_e".to_string(), of(&|k| omega * h * k as f64)),
            ("omega_e".to_string(), of(&|_| omega)),
            ("v_d".to_string(), of(&|_| v[0])),
            ("v_q".to_string(), of(&|_| v[1])),
            ("i_d".to_string(), of(&|k| currents[k][0])),
            ("i_q".to_string(), of(&|k| currents[k][1])),
        ];
        Signals::new(&Recording::new(columns, None).unwrap(), &Machine::new(4).unwrap()).unwrap()
    }

    #[test]
    fn samples_that_stand_for_several_show_the_currents_of_all() {
        // A voltage that jumps about from sample to sample, at a speed that grows.
        let n = 2000;
        let of = |f: &dyn Fn(f64) -> f64| (0..n).map(|k| f(f64::from(k))).collect::<Vec<f64>>();
        let columns = vec![
            ("t".to_string(), of(&|k| 5e-5 * k)),
            ("theta_e".to_string(), of(&|k| 0.01 * k + 1e-5 * k * k)),
            ("omega_e".to_string(), of(&|k| 200.0 + 0.4 * k)),
            ("v_d".to_string(), of(&|k| -20.0 + 15.0 * (2.3 * k).sin())),
            ("v_q".to_string(), of(&|k| 60.0 + 0.05 * k + 15.0 * (1.9 * k).cos())),
            ("i_d".to_string(), of(&|_| 1.0)),
            ("i_q".to_string(), of(&|_| 5.0)),
        ];
        let machine = Machine::new(4).unwrap().with_drive(Some(400.0), None, None).unwrap();
        let signals = Signals::new(&Recording::new(columns, None).unwrap(), &machine).unwrap();
        let fewer = signals.decimated_by(4);
        // What depends on the sign of a current is only followed from one of the fewer samples to the next.
        for (effects, most) in [
            (&[][..], 5e-3),
            (&[EffectId::VoltageDelay], 5e-3),
            (&[EffectId::IronLoss], 5e-3),
            (&[EffectId::DeadTime], 0.05),
        ] {
            let model = Model::new(signals.context, effects);
            let typical =
                effects.iter().flat_map(|e| e.info().parameters).map(|p| (p.typical)(&signals.context));
            let p: Vec<f64> = [0.4, 3e-3, 4e-3, 0.1, 0.01, 0.01].into_iter().chain(typical).collect();
            let currents = |signals: &Signals| {
                let mut out = Vec::new();
                run(&model, signals, &p, |_, i| out.push(i));
                out
            };
            let (all, few) = (currents(&signals), currents(&fewer));
            assert_eq!(few.len(), 500);
            for (k, i) in few.iter().enumerate() {
                let off = (i[0] - all[4 * k][0]).hypot(i[1] - all[4 * k][1]);
                assert!(off < most, "{effects:?} {k}: {i:?} {:?}", all[4 * k]);
            }
        }
    }

    #[test]
    fn a_voltage_held_in_the_stator_leads_to_the_currents_that_it_makes_there() {
        let (h, omega, v, n) = (1e-4, 1500.0, [-40.0, 190.0], 60);
        let p = [0.05, 2e-4, 3e-4, 0.07, 0.06, 0.01];
        let [r_s, l_d, l_q, psi_m, ..] = p;
        // The rotor-frame equations in steps of a thousandth, under a vector that turns back.
        const STEPS: usize = 1000;
        let slope = |i: [f64; 2], t: f64| {
            let (s, c) = Real::sin_cos(omega * (t - 0.5 * h));
            let v = [v[0] * c + v[1] * s, v[1] * c - v[0] * s];
            [
                (v[0] - r_s * i[0] + omega * l_q * i[1]) / l_d,
                (v[1] - r_s * i[1] - omega * (l_d * i[0] + psi_m)) / l_q,
            ]
        };
        let mut i = [3.0, 20.0];
        let mut log = vec![i];
        for _ in 1..n {
            for k in 0..STEPS {
                let (t, dt) = (h * k as f64 / STEPS as f64, h / STEPS as f64);
                let first = slope(i, t);
                let middle = slope([0, 1].map(|x: usize| i[x] + 0.5 * dt * first[x]), t + 0.5 * dt);
                i = [0, 1].map(|x: usize| i[x] + dt * middle[x]);
            }
            log.push(i);
        }
        let mut signals = logged(h, omega, v, &log);
        let model = Model::new(signals.context, &[]);
        let worst = |signals: &Signals| {
            let mut worst = 0.0f64;
            run(&model, signals, &p, |k, now| {
                worst = worst.max((now[0] - log[k][0]).hypot(now[1] - log[k][1]));
            });
            worst
        };
        let in_rotor = worst(&signals);
        signals.hold_in_stator(Logged::Command);
        let in_stator = worst(&signals);
        // Without the fading a twentieth of it would be left.
        assert!(in_rotor > 1.0 && in_stator < 0.01 * in_rotor, "{in_rotor} {in_stator}");
    }

    #[test]
    fn a_dead_time_whose_sign_turns_within_a_step_stays_stable() {
        let (h, omega, v, n) = (1.25e-4, 700.0, [-0.07, 3.9], 400);
        let (v_err, i_th) = (0.17, 0.03);
        let p = [0.045, 2e-5, 2.4e-5, 5e-3, 1e-4, 1e-4, v_err, i_th];
        // The rate of the sign, v_err/(i_th·l) = 2.8e5 1/s, is 35 of its own steps in one of the log.
        const STEPS: usize = 2000;
        let mut i = [0.0, 4.0];
        let mut log = vec![i];
        for k in 0..(n - 1) * STEPS {
            let dt = h / STEPS as f64;
            let lost = lost::<DeadTime>(&[v_err, i_th], &[], &winding(i, omega * dt * k as f64, omega));
            i = [
                i[0] + dt * (v[0] - lost[0] - p[0] * i[0] + omega * p[2] * i[1]) / p[1],
                i[1] + dt * (v[1] - lost[1] - p[0] * i[1] - omega * (p[1] * i[0] + p[3])) / p[2],
            ];
            if (k + 1) % STEPS == 0 {
                log.push(i);
            }
        }
        let signals = logged(h, omega, v, &log);
        let model = Model::new(signals.context, &[EffectId::DeadTime]);
        let seeded: Vec<Dual<2>> = p
            .iter()
            .enumerate()
            .map(|(k, x)| if k < 6 { Dual::constant(*x) } else { Dual::variable(*x, k - 6) })
            .collect();
        let largest = log.iter().map(|i| i[0].hypot(i[1])).fold(0.0, f64::max);
        run(&model, &signals, &seeded, |k, now| {
            let off = (now[0].re - log[k][0]).hypot(now[1].re - log[k][1]);
            assert!(off < 0.01 * largest, "row {k}: {off} of {largest}");
            assert!(
                now.iter().all(|i| i.eps.iter().all(|e| e.abs() < 1e3)),
                "row {k}: {:?}",
                now.map(|i| i.eps)
            );
        });
    }
}
