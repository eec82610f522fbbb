//! Play between rotor and load, as of a gear or a coupling. The load hangs on the rotor by an elastic contact on either side of a gap. With the
//! load's share κ of the inertia J, the frequency ω_c at which it swings on its contact, the damping ζ of the contact and the gap α,
//!
//! > dx_1/dt = J·ω_c²·x_2,  dx_2/dt = κ·dω_m/dt − (τ_s − τ_load)/J,  J(1−κ)·dω_m/dt = τ_e − b·ω_m − τ_s,
//!
//! x_1 = k·φ with the stiffness k = κJω_c² and the twist φ, and x_2 = κ·(ω_m − ω_load). The contact pushes and never pulls. Beyond half the gap,
//! h = k·α/2, it has the torque |τ_s| = max(0, |x_1| − h ± 2ζω_c·J·x_2); within the gap it has none. At κ = 0 and a constant load this is the
//! rigid machine, at α = 0 the elastic shaft. Source: Nordin & Gutman, "Controlling mechanical systems with backlash — a survey", Automatica 38
//! (2002) 1633.

use crate::base::Base;
use crate::effect::{Context, Derived, Effect, Info, Mechanical, Need, Output, Parameter, Role, Rotor, Site};
use crate::numerics::real::Real;
use std::f64::consts::TAU;

/// See the module's documentation.
pub struct Backlash;

/// Places of the parameters.
const SHARE: usize = 0;
const GAP: usize = 1;
const CONTACT: usize = 2;
const ZETA: usize = 3;

/// Smallest gap, rad: that of a good gear, seen through none.
const SMALLEST: f64 = 1e-4;

/// Largest gap, rad: half of how far the shaft moves, beyond which the load is never carried along.
fn largest(cx: &Context) -> f64 {
    (0.5 * cx.swing).clamp(2.0 * SMALLEST, TAU)
}

/// Torque of the contact, N·m.
#[inline(always)]
fn contact<T: Real>(p: &[T], x: &[T], j: T) -> T {
    let omega = p[CONTACT] * TAU;
    let half = p[SHARE] * j * omega.squared() * p[GAP] * 0.5;
    let side = x[0].if_positive(T::one(), T::zero() - T::one());
    let pressed = x[0] * side - half;
    let pushes = pressed + p[ZETA] * omega * j * x[1] * side * 2.0;
    let none = T::zero();
    // Without a gap the contact is a shaft, which pulls as well as it pushes.
    let pushes = half.if_positive(pushes.if_positive(pushes, none), pushes);
    half.if_positive(pressed.if_positive(pushes, none), pushes) * side
}

impl Effect for Backlash {
    const INFO: Info = Info {
        id: "backlash",
        title: "Backlash",
        sentence: "There is play between rotor and load: after each reversal of the torque the rotor moves alone until the play is taken up.",
        equation: "|τ_s| = max(0, k·(|φ| − α/2) + d·|φ|˙) for |φ| > α/2, else 0; dφ/dt = ω_m − ω_L, J_L·dω_L/dt = τ_s − τ_load",
        source: "Nordin & Gutman, Controlling mechanical systems with backlash, Automatica 38 (2002) 1633",
        fingerprint: "The speed jumps ahead where the torque changes its sign, then comes an impact that rings",
        look_alikes: &["two_mass_shaft", "time_varying_load", "coulomb_friction"],
        contains: &["two_mass_shaft"],
        site: Site::Mechanical,
        needs: &[Need::Transients],
        parameters: &[
            Parameter {
                name: "inertia_ratio",
                unit: "1",
                meaning: "the load's share of the whole inertia",
                role: Role::Amplitude,
                low: &|_| 0.0,
                high: &|_| 0.97,
                typical: &|_| 0.5,
            },
            Parameter {
                name: "gap",
                unit: "rad",
                meaning: "whole play, as an angle of the rotor",
                role: Role::Shape,
                low: &|_| 0.0,
                high: &largest,
                typical: &|cx| 0.02f64.min(largest(cx)),
            },
            Parameter {
                name: "f_contact",
                unit: "Hz",
                meaning: "frequency at which the load swings on its contact, the rotor held",
                role: Role::Shape,
                low: &|cx| 2.0 / cx.duration,
                high: &|cx| (0.1 / cx.period).max(2.0 / cx.duration),
                typical: &|cx| 100f64.min(0.1 / cx.period).max(2.0 / cx.duration),
            },
            Parameter {
                name: "zeta",
                unit: "1",
                meaning: "damping of that swing",
                role: Role::Shape,
                low: &|_| 2e-3,
                high: &|_| 1.0,
                typical: &|_| 0.1,
            },
        ],
    };
    const MECHANICAL_STATES: usize = 2;
    // The rotor alone moves another way than with its load.
    const FIRST_ORDER: bool = false;
    const MULTIMODAL: bool = true;
    const DERIVED: &'static [Derived] = &[("k_contact", "N m/rad", "stiffness of the contact")];

    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        let (low, high) = (2.0 / cx.duration, (0.1 / cx.period).max(2.0 / cx.duration));
        let gaps = [3e-3, 0.01, 0.03, 0.1, 0.3].map(|gap: f64| gap.min(largest(cx)));
        let mut probes: Vec<Vec<f64>> = Vec::new();
        for f in [25.0, 80.0, 250.0].map(|f: f64| f.clamp(low, high)) {
            for gap in gaps {
                let probe = vec![0.5, gap, f, 0.1];
                if !probes.contains(&probe) {
                    probes.push(probe);
                }
            }
        }
        probes
    }

    #[inline(always)]
    fn rotor<T: Real>(p: &[T], x: &[T], at: &Mechanical<T>, _: &Context, out: &mut Rotor<T>) {
        out.inverse_inertia = out.inverse_inertia / (T::one() - p[SHARE]);
        out.load = contact(p, x, at.j);
    }

    #[inline(always)]
    fn mechanical_states<T: Real>(
        p: &[T],
        x: &[T],
        at: &Mechanical<T>,
        acceleration: T,
        _: &Context,
        dx: &mut [T],
    ) {
        dx[0] = at.j * (p[CONTACT] * TAU).squared() * x[1];
        dx[1] = p[SHARE] * acceleration - (contact(p, x, at.j) - at.tau_load) / at.j;
    }

    fn mechanical_start<T: Real>(p: &[T], at: &Mechanical<T>, acceleration: T, _: &Context, x: &mut [T]) {
        let torque = at.tau_load + p[SHARE] * at.j * acceleration;
        let half = p[SHARE] * at.j * (p[CONTACT] * TAU).squared() * p[GAP] * 0.5;
        // On the side that carries the load.
        x[0] = torque + torque.if_positive(half, T::zero() - half);
        x[1] = T::zero();
    }

    fn ringing<T: Real>(p: &[T]) -> T {
        p[SHARE].if_positive(p[CONTACT] / (T::one() - p[SHARE]).sqrt(), T::zero())
    }

    fn outputs<T: Real>(p: &[T], base: &Base<T>, _: &Context) -> Vec<Output<T>> {
        let stiffness = p[SHARE] * base.j * (p[CONTACT] * TAU).squared();
        vec![
            ("inertia_ratio", "1", p[SHARE]),
            ("gap", "rad", p[GAP]),
            ("f_contact", "Hz", p[CONTACT]),
            ("zeta", "1", p[ZETA]),
            ("k_contact", "N m/rad", stiffness),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{CX, MACHINE, close, shaft};
    use crate::effects::two_mass_shaft::TwoMassShaft;

    const P: [f64; 4] = [0.4, 0.05, 60.0, 0.1];

    fn stiffness() -> f64 {
        P[SHARE] * MACHINE[4] * (TAU * P[CONTACT]).powi(2)
    }

    /// d/dt of [ω_m, x_1, x_2] without friction.
    fn slope(p: &[f64], state: [f64; 3], tau_e: f64, tau_load: f64) -> [f64; 3] {
        let at = Mechanical { tau_load, ..shaft(0.0, state[0], tau_e) };
        let mut rotor = Rotor { inverse_inertia: 1.0 / at.j, loss: 0.0, load: tau_load };
        Backlash::rotor(p, &state[1..], &at, &CX, &mut rotor);
        let acceleration = (tau_e - rotor.load) * rotor.inverse_inertia;
        let mut dx = [0.0; 2];
        Backlash::mechanical_states(p, &state[1..], &at, acceleration, &CX, &mut dx);
        [acceleration, dx[0], dx[1]]
    }

    #[test]
    fn within_the_play_the_rotor_moves_alone_and_a_contact_never_pulls() {
        let j = MACHINE[4];
        let k = stiffness();
        close(slope(&P, [10.0, 0.4 * P[GAP] * k, 0.0], 2.0, 0.0)[0], 2.0 / (j * (1.0 - P[SHARE])), 1e-12);
        let pressed = |beyond: f64, x_2: f64| contact(&P, &[(0.5 * P[GAP] + beyond) * k, x_2], j);
        close(pressed(0.001, 0.0), 0.001 * k, 1e-9);
        close(contact(&P, &[-(0.5 * P[GAP] + 0.001) * k, 0.0], j), -0.001 * k, 1e-9);
        assert_eq!(pressed(0.001, -100.0), 0.0);
        assert!(pressed(0.001, 1.0) > pressed(0.001, 0.0));
    }

    #[test]
    fn without_a_gap_it_is_an_elastic_shaft() {
        let (state, tau_e, tau_load) = ([20.0, 1.5, 0.8], 3.0, 1.2);
        let at = Mechanical { tau_load, ..shaft(0.0, state[0], tau_e) };
        let mut rotor = Rotor { inverse_inertia: 1.0 / at.j, loss: 0.0, load: tau_load };
        TwoMassShaft::rotor(&[P[SHARE], P[CONTACT], P[ZETA]], &state[1..], &at, &CX, &mut rotor);
        let expected = (tau_e - rotor.load) * rotor.inverse_inertia;
        let own = slope(&[P[SHARE], 0.0, P[CONTACT], P[ZETA]], state, tau_e, tau_load);
        close(own[0], expected, 1e-12);
    }

    #[test]
    fn energy_of_both_masses_and_the_contact_leaves_only_through_the_damper() {
        let (j, k) = (MACHINE[4], stiffness());
        let state = [20.0, 1.5 + 0.5 * P[GAP] * k, 0.8];
        let (tau_e, tau_load) = (3.0, 1.2);
        let d = slope(&P, state, tau_e, tau_load);
        let (load_speed, d_load) = (state[0] - state[2] / P[SHARE], d[0] - d[2] / P[SHARE]);
        // The contact stores (x_1 − h)²/2k.
        let stored = j * (1.0 - P[SHARE]) * state[0] * d[0]
            + j * P[SHARE] * load_speed * d_load
            + (state[1] - 0.5 * P[GAP] * k) * d[1] / k;
        let damping = 2.0 * P[ZETA] * TAU * P[CONTACT] * P[SHARE] * j;
        let lost = damping * (state[0] - load_speed).powi(2);
        close(stored, tau_e * state[0] - tau_load * load_speed - lost, 1e-10);
    }

    #[test]
    fn the_start_is_pressed_on_the_side_that_carries_the_load() {
        for (tau_e, tau_load) in [(3.0, 1.2), (-3.0, -1.2)] {
            let rigid = (tau_e - tau_load) / MACHINE[4];
            let at = Mechanical { tau_load, ..shaft(0.0, 20.0, tau_e) };
            let mut x = [0.0; 2];
            Backlash::mechanical_start(&P, &at, rigid, &CX, &mut x);
            let d = slope(&P, [20.0, x[0], x[1]], tau_e, tau_load);
            close(d[0], rigid, 1e-9);
            close(d[2], 0.0, 1e-7);
        }
    }
}
