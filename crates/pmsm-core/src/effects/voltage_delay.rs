//! The commanded voltage acts δ sample periods later than logged. Each interval then sees a mixture of this command and
//! the ones before it, and the rotor has moved on: v_k turns back by ω·T·δ/2, v_{k−1} by ω·T·(1+δ)/2.
//!
//! Source: Bae & Sul, IEEE Trans. Industry Applications 39 (2003) 802.

use crate::effect::{Context, Effect, Info, Need, Parameter, Role, Site};
use crate::numerics::real::Real;
use crate::numerics::transforms::rotate;

/// See the module's documentation.
pub struct VoltageDelay;

impl Effect for VoltageDelay {
    const INFO: Info = Info {
        id: "voltage_delay",
        title: "Voltage delay",
        sentence: "The commanded voltage acts later than the log says.",
        equation: "v(t) = v*(t − δ·T_s)",
        source: "Bae & Sul, IEEE Trans. Industry Applications 39 (2003) 802",
        fingerprint: "Voltage turned against the rotation by ω·T_s·δ; nothing at standstill but a shifted ripple",
        look_alikes: &["iron_loss", "encoder_angle_offset", "encoder_delay"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Transients, Need::Current],
        parameters: &[Parameter {
            name: "extra_samples",
            unit: "1",
            meaning: "delay beyond the logged one, sample periods",
            role: Role::Amplitude,
            low: &|_| 0.0,
            high: &|_| 2.0,
            typical: &|_| 0.2,
        }],
    };
    const TURNS: bool = false;

    #[inline(always)]
    fn command<T: Real>(p: &[T], taps: &[[T; 2]; 3], turn: T, _: &Context, v: &mut [T; 2]) {
        let delay = p[0];
        let mut sum = [T::zero(); 2];
        for (back, tap) in taps.iter().enumerate() {
            // Share of the interval in which this command acts, and how far the rotor moved since it should have acted.
            let share = overlap(delay - back as f64);
            let (s, c) = ((delay + back as f64) * turn * -0.5).sin_cos();
            let acting = rotate(*tap, c, s);
            sum[0] += share * acting[0];
            sum[1] += share * acting[1];
        }
        v[0] += sum[0] - taps[0][0];
        v[1] += sum[1] - taps[0][1];
    }
}

/// Share that an interval has of one shifted by `x` of its lengths, 1 − |x| or nothing. At its kinks, of which no
/// delay at all is one, it carries the derivative towards more delay.
#[inline(always)]
fn overlap<T: Real>(x: T) -> T {
    let none = T::zero();
    let before = (-x - 1.0).if_positive(none, x + 1.0);
    let behind = (T::one() - x).if_positive(T::one() - x, none);
    (-x).if_positive(before, behind)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, close};
    use crate::numerics::dual::Dual;

    /// Mean over the interval [0, 1) of the rotor-frame voltage when stator-frame commands, held over [k, k+1) and
    /// logged in the rotor frame of their middle, act `delay` later; the rotor turns `turn` per interval.
    fn delayed(commands: &[[f64; 2]; 3], turn: f64, delay: f64) -> [f64; 2] {
        let n = 200_000;
        let mut sum = [0.0; 2];
        for m in 0..n {
            let at = (f64::from(m) + 0.5) / f64::from(n);
            let back = (delay - at).ceil().max(0.0) as usize;
            // From the rotor frame in the middle of its own interval to that of now.
            let angle = (at - (0.5 - back as f64)) * turn;
            let acting = rotate(commands[back], angle.cos(), -angle.sin());
            sum = [sum[0] + acting[0], sum[1] + acting[1]];
        }
        sum.map(|x| x / f64::from(n))
    }

    #[test]
    fn it_shifts_a_held_stator_voltage_up_to_second_order_in_the_turn() {
        let commands = [[-20.0, 100.0], [-15.0, 90.0], [-30.0, 80.0]];
        for delay in [0.0, 0.3, 1.0, 1.6] {
            let error = |turn: f64| {
                let mut v = commands[0];
                VoltageDelay::command(&[delay], &commands, turn, &CX, &mut v);
                let exact = delayed(&commands, turn, delay);
                (v[0] - exact[0]).hypot(v[1] - exact[1])
            };
            // A constant times the turn squared, which is the sinc of a held vector, times its 110 V.
            assert!(error(0.04) < 110.0 * 0.04f64.powi(2) / 20.0, "{delay}: {}", error(0.04));
            assert!(error(0.04) < error(0.08) / 3.0 || error(0.08) < 1e-2, "{delay}");
        }
    }

    #[test]
    fn whole_samples_of_delay_are_the_commands_before() {
        let commands = [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]];
        for (delay, tap) in [(0.0, 0), (1.0, 1), (2.0, 2)] {
            let mut v = commands[0];
            VoltageDelay::command(&[delay], &commands, 0.0, &CX, &mut v);
            assert_eq!(v, commands[tap]);
        }
    }

    #[test]
    fn the_first_bit_of_delay_already_mixes_in_the_command_before() {
        let taps = [[1.0, 2.0], [3.0, 5.0], [9.0, 9.0]].map(|x: [f64; 2]| x.map(Dual::<1>::constant));
        let mut v = taps[0];
        VoltageDelay::command(&[Dual::variable(0.0, 0)], &taps, Dual::zero(), &CX, &mut v);
        close(v[0].eps[0], 3.0 - 1.0, 1e-15);
        close(v[1].eps[0], 5.0 - 2.0, 1e-15);
    }
}
