//! The commanded voltage acts δ sample periods later than logged. Each interval then sees a mixture of this command and
//! the ones before it, and the rotor has moved on: v_k turns back by ω·T·δ/2, v_{k−1} by ω·T·(1+δ)/2.
//!
//! Source: Bae & Sul, IEEE Trans. Industry Applications 39 (2003) 802.

use crate::effect::{Context, Effect, Info, Need, Parameter, Role, Site};
use crate::real::Real;
use crate::transforms::rotate;

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
        look_alikes: &["iron_loss", "encoder_angle_offset"],
        contains: &[],
        site: Site::Electrical,
        needs: &[Need::Transients],
        parameters: &[Parameter {
            name: "extra_samples",
            unit: "1",
            meaning: "delay beyond the logged one, sample periods",
            role: Role::Amplitude,
            low: |_| 0.0,
            high: |_| 2.0,
            typical: |_| 0.2,
        }],
    };

    #[inline(always)]
    fn command<T: Real>(p: &[T], taps: &[[T; 2]; 3], turn: T, _: &Context, v: &mut [T; 2]) {
        let delay = p[0];
        let mut sum = [T::zero(); 2];
        for (back, tap) in taps.iter().enumerate() {
            // Share of the interval in which this command acts, and how far the rotor moved since it should have acted.
            let distance = (delay - back as f64).abs();
            let share = (T::one() - distance).if_positive(T::one() - distance, T::zero());
            let (s, c) = ((delay + back as f64) * turn * -0.5).sin_cos();
            let acting = rotate(*tap, c, s);
            sum[0] += share * acting[0];
            sum[1] += share * acting[1];
        }
        v[0] += sum[0] - taps[0][0];
        v[1] += sum[1] - taps[0][1];
    }
}
