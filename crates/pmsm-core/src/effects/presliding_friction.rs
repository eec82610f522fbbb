//! Friction that acts like a spring before it slides: τ_f = τ_c·x with dx/dt = |ω_m|·(sgn ω_m − x)/θ_0. In steady motion x is the
//! direction and friction is constant; behind a reversal the contact is first bent back over a few θ_0. The sign turns over as in
//! [`super::coulomb_friction`], which this is at θ_0 = 0.
//!
//! A contact that slides within less than a sample cannot be told from one that slides at once: there its angle is the one that the shaft
//! turns by in a sample.
//! Source: Dahl, A solid friction model, Aerospace Corp. TOR-0158 (1968); its stiffness at rest is τ_c/θ_0.

use crate::base::Base;
use crate::effect::{Context, Derived, Effect, Info, Mechanical, Need, Output, Parameter, Role, Rotor, Site};
use crate::real::Real;
use crate::terms::SMOOTHING;

/// See the module's documentation.
pub struct PreslidingFriction;

/// Largest angle of bending, rad: a fifth of a turn is more than any bearing, seal or gear bends by.
const LARGEST: f64 = 1.2;

impl Effect for PreslidingFriction {
    const INFO: Info = Info {
        id: "presliding_friction",
        title: "Presliding friction",
        sentence: "Friction acts like a spring before it slides: behind every reversal the contact is bent first.",
        equation: "τ_f = τ_c·x, dx/dt = |ω_m|·(sgn(ω_m) − x)/θ_0",
        source: "Dahl, A solid friction model, Aerospace Corp. TOR-0158 (1968)",
        fingerprint: "Friction that builds up over a small angle behind every reversal: hysteresis over position",
        look_alikes: &["coulomb_friction", "stribeck_friction", "two_mass_shaft"],
        contains: &["coulomb_friction"],
        site: Site::Mechanical,
        needs: &[Need::Transients, Need::Motion],
        parameters: &[
            Parameter {
                name: "tau_c",
                unit: "N m",
                meaning: "friction torque once it slides",
                role: Role::Amplitude,
                low: |_| 0.0,
                high: |cx| cx.tau_max,
                typical: |cx| 0.02 * cx.tau_max,
            },
            Parameter {
                name: "theta_0",
                unit: "rad",
                meaning: "angle behind a reversal within which friction turns over, to 1/e",
                role: Role::Shape,
                low: |_| 1e-5,
                high: |_| LARGEST,
                typical: |_| 0.02,
            },
            Parameter {
                name: "w_0",
                unit: "rad/s",
                meaning: "mechanical speed over which the friction turns over",
                role: Role::Shape,
                low: |cx| 2e-4 * cx.omega_m_max(),
                high: |cx| 0.02 * cx.omega_m_max(),
                typical: |cx| SMOOTHING * cx.omega_m_max(),
            },
        ],
    };
    const MECHANICAL_STATES: usize = 1;
    const JUMPS: bool = true;
    const DERIVED: &'static [Derived] = &[("sigma", "N m/rad", "stiffness of the contact at rest")];

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        [0.003, 0.02, 0.1, 0.4].map(|theta_0| vec![0.0, theta_0, SMOOTHING * cx.omega_m_max()]).to_vec()
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
        cx: &Context,
        dx: &mut [T],
    ) {
        let speed = at.omega_m.abs();
        dx[0] = speed * ((at.omega_m / p[2]).tanh() - x[0]) / (p[1] + speed * cx.period);
    }

    fn mechanical_start<T: Real>(p: &[T], at: &Mechanical<T>, _: T, _: &Context, x: &mut [T]) {
        // Whether a rotor at rest came from the left or from the right is not known.
        x[0] = (at.omega_m / p[2]).tanh();
    }

    fn outputs<T: Real>(p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        vec![("tau_c", "N m", p[0]), ("theta_0", "rad", p[1]), ("w_0", "rad/s", p[2]), ("sigma", "N m/rad", p[0] / p[1])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, base, close, shaft};

    /// Friction torque over a path of speeds, each held for a step of the time.
    fn along(p: &[f64], start: f64, step: f64, speeds: impl Iterator<Item = f64>) -> f64 {
        let mut x = [start];
        for speed in speeds {
            let mut dx = [0.0];
            PreslidingFriction::mechanical_states(p, &x, &shaft(0.0, speed, 0.0), 0.0, &CX, &mut dx);
            x[0] += step * dx[0];
        }
        let mut rotor = Rotor { inverse_inertia: 1.0, loss: 0.0, load: 0.0 };
        PreslidingFriction::rotor(p, &x, &shaft(0.0, 0.0, 0.0), &CX, &mut rotor);
        rotor.loss
    }

    #[test]
    fn friction_turns_over_exponentially_with_the_angle_and_stays_where_the_shaft_rests() {
        let p = [0.3, 0.05, 0.01];
        // From sliding backwards over an angle of θ forwards: τ_c·(1 − 2·exp(−θ/θ_0)).
        let friction = |angle: f64| along(&p, -1.0, 1e-5, (0..(angle * 1e5) as usize).map(|_| 1.0));
        for angle in [0.01, 0.05, 0.2] {
            let slip = p[1] + CX.period;
            close(friction(angle), 0.3 * (1.0 - 2.0 * f64::exp(-angle / slip)), 1e-3);
        }
        close(along(&p, 0.4, 1e-3, (0..500).map(|_| 0.0)), 0.12, 1e-15);
    }

    #[test]
    fn at_high_speed_the_contact_follows_within_a_sample_and_no_faster() {
        let p = [0.3, 1e-3, 0.01];
        let mut dx = [0.0];
        PreslidingFriction::mechanical_states(&p, &[-1.0], &shaft(0.0, 1e4, 0.0), 0.0, &CX, &mut dx);
        assert!(dx[0] * CX.period <= 2.0 && dx[0] * CX.period > 1.9, "{}", dx[0] * CX.period);
        close(PreslidingFriction::outputs(&p, &base(), &CX)[3].2, 300.0, 1e-9);
    }
}
