//! White noise of the channels of a window.

use crate::numerics::differences::white_noise;
use crate::numerics::extent::peak;
use crate::signals::Signals;

/// White noise of a measured channel and the largest value of it.
#[derive(Debug, Clone, Copy)]
pub struct Noise {
    /// Name of the channel.
    pub channel: &'static str,
    /// Standard deviation.
    pub sigma: f64,
    /// Largest magnitude.
    pub peak: f64,
}

/// Read from the longest stretch without a gap. A speed that was differentiated from an angle has no white noise.
pub fn noise(signals: &Signals) -> Vec<Noise> {
    let Some(longest) = signals.segments.iter().max_by_key(|s| s.len()) else { return Vec::new() };
    let of = |channel, x: &[f64]| Noise { channel, sigma: white_noise(&x[longest.clone()]), peak: peak(x) };
    let mut noise = Vec::new();
    if let Some([d, q]) = &signals.i {
        noise.extend([of("i_d", d), of("i_q", q)]);
    }
    if signals.speed_known {
        noise.push(of("omega_e", &signals.omega_e));
    }
    noise
}
