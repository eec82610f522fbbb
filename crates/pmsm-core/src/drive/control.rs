//! The controllers of the drive: a PI speed loop gives the reference of i_q, PI current loops with decoupling give the
//! voltage. Where a limit cuts an output, the integrator behind it follows the cut by back-calculation,
//! dI/dt = k_i·(e + (y_limited − y)/k_p), so that it never winds up.
//!
//! Source: Fig. 4 of Liu, Liu & Cartes (2008); Åström & Hägglund, "PID Controllers", 2nd ed. (1995), section 3.5.

use crate::error::{Error, Result};
use crate::machine::{BaseParameter, Machine};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Default bandwidth of the current loops: this share of the sampling frequency, at most this many Hz.
const CURRENT_BANDWIDTH: (f64, f64) = (0.04, 1000.0);
/// Default bandwidth of the speed loop, Hz.
const SPEED_BANDWIDTH: f64 = 20.0;

/// What the controllers and the log see of one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Phase currents, A.
    pub abc: [f64; 3],
    /// The same in the measured rotor frame, d, q, A.
    pub i: [f64; 2],
    /// Electrical angle, rad, unwrapped.
    pub theta_e: f64,
    /// Mechanical angle, rad, unwrapped.
    pub theta_m: f64,
    /// Electrical speed, rad/s.
    pub omega_e: f64,
}

/// Controllers. Gains left out follow from the nameplate: k_p = l·ω_c, k_i = r_s·ω_c for the current loops; with the
/// torque per ampere k_t = 3/2·n_p·ψ_m, k_p = j·ω_s/k_t and k_i = k_p·ω_s/4 for the speed loop.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Control {
    /// Bandwidth of the current loops ω_c/2π, Hz.
    pub current_bandwidth: Option<f64>,
    /// Bandwidth of the speed loop ω_s/2π, Hz.
    pub speed_bandwidth: Option<f64>,
    /// Proportional gain of the speed loop, A s/rad (mechanical).
    pub kp_speed: Option<f64>,
    /// Integral gain of the speed loop, A/rad.
    pub ki_speed: Option<f64>,
    /// Proportional gain of the d-current loop, V/A.
    pub kp_d: Option<f64>,
    /// Integral gain of the d-current loop, V/(A s).
    pub ki_d: Option<f64>,
    /// Proportional gain of the q-current loop, V/A.
    pub kp_q: Option<f64>,
    /// Integral gain of the q-current loop, V/(A s).
    pub ki_q: Option<f64>,
    /// Leaves out the voltages −ω_e·l_q·i_q and ω_e·(l_d·i_d + ψ_m) that decouple the axes.
    pub coupled: bool,
}

/// Gains of the controllers, units as in [`Control`], and what the controller believes of the machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gains {
    pub speed: [f64; 2],
    pub d: [f64; 2],
    pub q: [f64; 2],
    /// l_d, l_q, ψ_m of the decoupling; zero without it.
    pub decoupling: [f64; 3],
}

impl Gains {
    pub fn new(control: &Control, nameplate: &Machine, f_sample: f64, speed: bool) -> Result<Self> {
        let (share, most) = CURRENT_BANDWIDTH;
        let omega_c = TAU * control.current_bandwidth.unwrap_or((share * f_sample).min(most));
        let omega_s = TAU * control.speed_bandwidth.unwrap_or(SPEED_BANDWIDTH);
        let known = |p: BaseParameter| {
            nameplate.get(p).ok_or_else(|| {
                Error::unusable(
                    format!("the nameplate does not tell {}, from which the controllers are set", p.name()),
                    "complete the nameplate",
                )
            })
        };
        let [r_s, l_d, l_q, psi_m] = BaseParameter::ELECTRICAL.map(known);
        let (r_s, l_d, l_q, psi_m) = (r_s?, l_d?, l_q?, psi_m?);
        let kp_speed = match control.kp_speed {
            Some(given) => given,
            None if speed => known(BaseParameter::J)? * omega_s / (1.5 * f64::from(nameplate.n_p) * psi_m),
            None => 0.0,
        };
        let gains = Self {
            speed: [kp_speed, control.ki_speed.unwrap_or(kp_speed * omega_s / 4.0)],
            d: [control.kp_d.unwrap_or(l_d * omega_c), control.ki_d.unwrap_or(r_s * omega_c)],
            q: [control.kp_q.unwrap_or(l_q * omega_c), control.ki_q.unwrap_or(r_s * omega_c)],
            decoupling: if control.coupled { [0.0; 3] } else { [l_d, l_q, psi_m] },
        };
        for (name, [kp, ki]) in [("speed", gains.speed), ("d", gains.d), ("q", gains.q)] {
            for (kind, gain) in [("kp", kp), ("ki", ki)] {
                if !(gain.is_finite() && gain >= 0.0) {
                    let expected = "it must be finite and not negative; give it, or a bandwidth above zero";
                    return Err(Error::quantity(&format!("{kind}_{name}"), gain, "", expected));
                }
            }
        }
        Ok(gains)
    }
}

/// References at one instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reference {
    /// Mechanical speed, rad/s; without it the currents are controlled alone.
    pub omega_m: Option<f64>,
    /// Current d, q, A.
    pub i: [f64; 2],
}

/// The controllers with their integrators.
#[derive(Debug, Clone)]
pub(super) struct Controller {
    gains: Gains,
    n_p: f64,
    i_limit: f64,
    v_limit: f64,
    period: f64,
    speed: f64,
    axes: [f64; 2],
}

impl Controller {
    /// At rest. `v_limit` is the longest voltage vector that the inverter gives, V.
    pub fn new(gains: Gains, n_p: f64, i_limit: f64, v_limit: f64, period: f64) -> Self {
        Self { gains, n_p, i_limit, v_limit, period, speed: 0.0, axes: [0.0; 2] }
    }

    /// The voltage that meets a machine without current at electrical speed `omega_e`, V.
    pub fn first(&self, omega_e: f64) -> [f64; 2] {
        self.within([0.0, omega_e * self.gains.decoupling[2]])
    }

    /// The voltage command (d, q, V) from what was measured, one sampling period after the call before.
    pub fn step(&mut self, measured: &Measured, reference: &Reference) -> [f64; 2] {
        let i_d = reference.i[0].clamp(-self.i_limit, self.i_limit);
        let room = (self.i_limit * self.i_limit - i_d * i_d).max(0.0).sqrt();
        let i_q = match reference.omega_m {
            None => reference.i[1].clamp(-room, room),
            Some(omega_m) => {
                let error = omega_m - measured.omega_e / self.n_p;
                let [kp, ki] = self.gains.speed;
                let wish = kp * error + self.speed + reference.i[1];
                let cut = wish.clamp(-room, room);
                self.speed += ki * self.period * follow(error, wish, cut, kp);
                cut
            }
        };
        let error = [i_d - measured.i[0], i_q - measured.i[1]];
        let axes = [self.gains.d, self.gains.q];
        let [l_d, l_q, psi_m] = self.gains.decoupling;
        let w = measured.omega_e;
        let ahead = [-w * l_q * measured.i[1], w * (l_d * measured.i[0] + psi_m)];
        let wish = [0, 1].map(|x| axes[x][0] * error[x] + self.axes[x] + ahead[x]);
        let cut = self.within(wish);
        for x in 0..2 {
            let [kp, ki] = axes[x];
            self.axes[x] += ki * self.period * follow(error[x], wish[x], cut[x], kp);
        }
        cut
    }

    /// The vector, shortened to what the inverter gives.
    fn within(&self, v: [f64; 2]) -> [f64; 2] {
        let share = self.v_limit / v[0].hypot(v[1]);
        if share < 1.0 { v.map(|x| x * share) } else { v }
    }
}

/// What the integrator of a PI controller is fed where its output is cut from `wish` to `cut`.
fn follow(error: f64, wish: f64, cut: f64, kp: f64) -> f64 {
    if kp > 0.0 {
        error + (cut - wish) / kp
    } else if wish == cut {
        error
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn controller() -> Controller {
        let gains = Gains::new(&Control::default(), &Machine::liu_2008(), 1e4, true).unwrap();
        Controller::new(gains, 4.0, 100.0, 300.0, 1e-4)
    }

    fn measured(i: [f64; 2], omega_e: f64) -> Measured {
        Measured { abc: [0.0; 3], i, theta_e: 0.0, theta_m: 0.0, omega_e }
    }

    #[test]
    fn a_long_unreachable_reference_leaves_no_memory() {
        let mut c = controller();
        for _ in 0..10_000 {
            let v = c.step(&measured([0.0, 0.0], 0.0), &Reference { omega_m: None, i: [60.0, 60.0] });
            assert!(v[0].hypot(v[1]) <= 300.0 * (1.0 + 1e-12));
        }
        // Within a step of the reference being met, the voltage has left its limit.
        let v = c.step(&measured([60.0, 60.0], 0.0), &Reference { omega_m: None, i: [60.0, 60.0] });
        assert!(v[0].hypot(v[1]) < 300.0, "{v:?}");
        let mut free = controller();
        free.gains.q[1] = 0.0;
        let first = free.step(&measured([0.0; 2], 100.0), &Reference { omega_m: None, i: [0.0; 2] });
        assert_eq!(first, c.first(100.0));
    }

    #[test]
    fn speed_loop_gives_no_more_than_the_current_limit() {
        let mut c = controller();
        c.gains.q = [1.0, 0.0];
        c.gains.d = [1.0, 0.0];
        c.gains.decoupling = [0.0; 3];
        let reference = Reference { omega_m: Some(1e6), i: [-60.0, 0.0] };
        for _ in 0..100 {
            let v = c.step(&measured([0.0; 2], 0.0), &reference);
            assert_eq!(v, [-60.0, 80.0]);
        }
        assert!(c.speed.abs() < 1e-6 + 100.0, "{}", c.speed);
    }

    #[test]
    fn gains_come_from_the_nameplate_unless_given() {
        let gains = |control: Control| Gains::new(&control, &Machine::liu_2008(), 1e4, true);
        let tuned = gains(Control { current_bandwidth: Some(100.0), ..Control::default() }).unwrap();
        assert!(
            (tuned.d[0] - 1.9e-3 * TAU * 100.0).abs() < 1e-12
                && (tuned.q[1] - 0.17 * TAU * 100.0).abs() < 1e-9
        );
        let given = gains(Control { kp_q: Some(3.0), coupled: true, ..Control::default() }).unwrap();
        assert_eq!((given.q[0], given.decoupling), (3.0, [0.0; 3]));
        let wrong = gains(Control { ki_speed: Some(-1.0), ..Control::default() }).unwrap_err();
        assert!(wrong.to_string().contains("ki_speed is -1"), "{wrong}");
        let bare = Machine::new(3).unwrap();
        assert!(Gains::new(&Control::default(), &bare, 1e4, true).is_err());
    }
}
