//! Presliding friction, the model of Dahl: contacts bend like a spring before they slide. With x = z/θ_0, the bend z over the one at which
//! the contacts slide,
//!
//! > τ_f = τ_c·x,  dx/dt = (ω_m − |ω_m|·x)/θ_0.
//!
//! Turned on in one direction x settles at ±1 within a few θ_0, and the friction is that of Coulomb.
//! Source: Dahl, "A solid friction model", Aerospace Corp. TOR-0158 (1968); Canudas de Wit et al., IEEE Trans. Automatic Control 40 (1995) 419.

use crate::effect::{Context, Effect, Info, Mechanical, Need, Parameter, Role, Rotor, Site};
use crate::numerics::real::Real;

/// See the module's documentation.
pub struct PreslidingFriction;

/// Smallest angle, rad: that of one sample at the highest speed, below which the state would move faster than it is simulated.
fn smallest(cx: &Context) -> f64 {
    (cx.omega_m_max() * cx.period).max(1e-5)
}

/// Largest angle, rad: half of how far the shaft moves, beyond which it is a spring that never slides.
fn largest(cx: &Context) -> f64 {
    (0.5 * cx.swing).clamp(2.0 * smallest(cx), 1.0f64.max(2.0 * smallest(cx)))
}

impl Effect for PreslidingFriction {
    const INFO: Info = Info {
        id: "presliding_friction",
        title: "Presliding friction",
        sentence: "Before it slides friction acts like a spring: its torque follows the angle since the last reversal.",
        equation: "τ_f = τ_c·x, dx/dt = (ω_m − |ω_m|·x)/θ_0",
        source: "Dahl, A solid friction model, Aerospace Corp. TOR-0158 (1968)",
        fingerprint: "Torque that turns over within an angle θ_0 after each reversal, and not within a speed; hysteresis in position",
        look_alikes: &["coulomb_friction", "stribeck_friction", "two_mass_shaft"],
        contains: &["coulomb_friction"],
        site: Site::Mechanical,
        needs: &[Need::Transients],
        parameters: &[
            Parameter {
                name: "tau_c",
                unit: "N m",
                meaning: "friction torque once it slides",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|cx| cx.tau_max,
                typical: &|cx| 0.03 * cx.tau_max,
            },
            Parameter {
                name: "theta_0",
                unit: "rad",
                meaning: "angle over which the friction turns over after a reversal",
                role: Role::Shape,
                low: &smallest,
                high: &largest,
                typical: &|cx| (0.02f64).clamp(2.0 * smallest(cx), largest(cx)),
            },
        ],
    };
    const MECHANICAL_STATES: usize = 1;
    const JUMPS: bool = true;

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        let (low, high) = (2.0 * smallest(cx), largest(cx));
        let steps = ((high / low).ln() / 3f64.ln()).ceil().max(1.0) as i32;
        let at = |k: i32| low * (high / low).powf(f64::from(k) / f64::from(steps));
        (0..=steps).map(|k| vec![0.0, at(k)]).collect()
    }

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], x: &[T], _: &Mechanical<T>, _: &Context, out: &mut Rotor<T>) {
        out.loss += p[0] * x[0];
    }

    #[inline(always)]
    fn mechanical_states<T: Real>(
        p: &[T],
        x: &[T],
        at: &Mechanical<T>,
        _: T,
        _: &Context,
        dx: &mut [T],
    ) {
        dx[0] = (at.omega_m - at.omega_m.abs() * x[0]) / p[1];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, close, shaft};

    /// The state after turning through `angle` from `x`, in small steps.
    fn turned(x: f64, angle: f64, theta_0: f64) -> f64 {
        let (steps, mut x) = (20_000, x);
        for _ in 0..steps {
            let mut dx = [0.0];
            PreslidingFriction::mechanical_states(&[1.0, theta_0], &[x], &shaft(0.0, angle, 0.0), 0.0, &CX, &mut dx);
            x += dx[0] / f64::from(steps);
        }
        x
    }

    #[test]
    fn friction_is_a_spring_after_a_reversal_and_that_of_coulomb_after_some_angles() {
        let theta_0 = 0.05;
        close(turned(0.0, 1e-4, theta_0), 1e-4 / theta_0, 1e-5);
        close(turned(0.0, 0.05, theta_0), 1.0 - (-1f64).exp(), 1e-3);
        close(turned(0.3, 1.0, theta_0), 1.0, 1e-6);
        // Once it slides one way, the way back begins at the other end: the loop of a hysteresis.
        close(turned(1.0, -0.05, theta_0), 2.0 * (-1f64).exp() - 1.0, 1e-3);
        let mut rotor = Rotor { inverse_inertia: 1.0, loss: 0.0, load: 0.0 };
        PreslidingFriction::rotor(&[0.2, theta_0], &[-0.5], &shaft(0.0, 1.0, 0.0), &CX, &mut rotor);
        close(rotor.loss, -0.1, 1e-15);
    }
}
