//! Voltages that stand still in the stator, as inverters hold them, while the rotor turns on.

use super::Signals;
use super::angle::slopes;
use crate::numerics::transforms::rotate;

/// Control periods from the sample at which angle and speed are known to the middle of the period in which a voltage acts: of a command,
/// which was computed from the sample before, and of logged phase voltages, which are seen from the rotor by the row's own.
const AHEAD: (f64, f64) = (1.5, 0.5);
/// Samples to either side from which an acceleration is taken.
const GAINS: usize = 8;
/// Half the angle (rad) that a rotor turns in a control period at most: beyond it no drive controls a current.
const FARTHEST: f64 = 1.5;

/// What a log holds of a voltage that stands still in the stator over a control period.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Logged {
    /// The vector that stands there, seen from where the rotor is in the middle of the period: a drive's own command.
    Command,
    /// Its mean in the rotor's frame, which is shorter, as the vector turns back meanwhile.
    Mean,
}

impl Signals {
    /// Takes the voltages as held in the stator's frame over each control period h. Seen from the rotor they turn back meanwhile about
    /// their middle, by x = ω_e·h/2 to either side; the flux at the end is that of a voltage held in the rotor's frame which is larger by
    /// x/sin x than the vector, and by that once more than its mean. What the resistance changes of it is up to
    /// [`crate::simulate::electrical`], and what the currents do in between to [`crate::simulate::mechanical::torque`].
    ///
    /// A drive turns its command to where the rotor will be in the middle of the period, 1.5 periods after the sample that it is computed
    /// from, at the speed of that sample; a rotor that gains speed meanwhile is farther by (1.5·h)²/2·dω_e/dt, and the voltage lags. Of
    /// phase voltages, which the row's own angle turns, half a period is left of that.
    pub fn hold_in_stator(&mut self, logged: Logged) {
        let held = self.held_period();
        let gains = slopes(&self.t, &self.omega_e, &self.segments, GAINS);
        let ahead = if self.phase_voltages { AHEAD.1 } else { AHEAD.0 };
        if let (Some([v_d, v_q]), None) = (&mut self.v, self.stator_held) {
            for ((d, q), (omega, gain)) in v_d.iter_mut().zip(v_q).zip(self.omega_e.iter().zip(gains)) {
                let x = (0.5 * omega * held).abs().min(FARTHEST);
                let longer = if x > 0.0 { x / x.sin() } else { 1.0 };
                let longer = if logged == Logged::Mean { longer * longer } else { longer };
                let (sin, cos) = (-0.5 * (ahead * held).powi(2) * gain).sin_cos();
                [*d, *q] = rotate([*d, *q], longer * cos, longer * sin);
            }
        }
        self.stator_held = Some(logged);
    }

    /// Takes the voltage of each row for that of its instant, or for its mean about that: what acts up to the next row is the mean of both. A
    /// voltage acts for a control period from its sample on, half a period later than a current is seen; so the first of both counts more.
    pub fn draw_voltages_through(&mut self) {
        let first = 0.5 + 0.5 * self.control_period.map_or(0.0, |own| (own / self.period).min(1.0));
        let Some(v) = &mut self.v else { return };
        for segment in &self.segments {
            for k in segment.start..segment.end.saturating_sub(1) {
                v.iter_mut().for_each(|x| x[k] = first * x[k] + (1.0 - first) * x[k + 1]);
            }
        }
        self.voltages_drawn = true;
    }

    /// For how long a voltage is held, s.
    pub fn held_period(&self) -> f64 {
        self.control_period.unwrap_or(self.period).min(self.period)
    }
}

#[cfg(test)]
mod tests {
    use super::Logged;
    use crate::machine::Machine;
    use crate::recording::Recording;
    use crate::signals::Signals;

    #[test]
    fn a_voltage_held_in_the_stator_lags_where_the_rotor_gains_speed() {
        // Electrical angle of a rotor that gains 10⁵ rad/s² from 200 rad/s.
        let (h, gain) = (1e-4, 1e5);
        let angle = |t: f64| (200.0 + 0.5 * gain * t) * t;
        let t: Vec<f64> = (0..40).map(|k| h * f64::from(k)).collect();
        let column =
            |name: &str, f: &dyn Fn(f64) -> f64| (name.to_string(), t.iter().map(|t| f(*t)).collect());
        let command = [3.0, 40.0];
        let columns = vec![
            column("t", &|t| t),
            column("theta_e", &angle),
            column("omega_e", &|t| 200.0 + gain * t),
            column("v_d", &|_| command[0]),
            column("v_q", &|_| command[1]),
            column("i_d", &|_| 3.0),
            column("i_q", &|_| 4.0),
        ];
        let machine = Machine::new(4).unwrap();
        let mut signals = Signals::new(&Recording::new(columns, None).unwrap(), &machine).unwrap();
        let mut by_phases = Signals { phase_voltages: true, ..signals.clone() };
        let mut vector = signals.clone();
        signals.hold_in_stator(Logged::Mean);
        by_phases.hold_in_stator(Logged::Mean);
        vector.hold_in_stator(Logged::Command);
        let ([d, q], [_, less]) = (signals.v.unwrap(), by_phases.v.unwrap());
        let [vector_d, vector_q] = vector.v.unwrap();
        for k in 1..39 {
            // Where the drive put it, seen from where the rotor is in the mean over the period.
            let put = angle(t[k - 1]) + 1.5 * h * (200.0 + gain * t[k - 1]);
            let mean = (0..100).map(|n| angle(t[k] + h * (f64::from(n) + 0.5) / 100.0)).sum::<f64>() / 100.0;
            let lag = q[k].atan2(d[k]) - command[1].atan2(command[0]);
            assert!(
                (lag - (put - mean)).abs() < 0.05 * lag.abs() && lag < -1e-3,
                "{k}: {lag} {}",
                put - mean
            );
            assert!(less[k] > q[k], "{k}: half a period is less than one and a half");
            // Constant in the stator, against the mean of what turns with the rotor.
            let x = signals.omega_e[k] * h;
            let turning =
                (0..1000).map(|n| (x * ((f64::from(n) + 0.5) / 1000.0 - 0.5)).cos()).sum::<f64>() / 1e3;
            let length = command[0].hypot(command[1]);
            let of_vector = vector_d[k].hypot(vector_q[k]) / length - 1.0;
            let of_mean = d[k].hypot(q[k]) / length - 1.0;
            assert!((of_vector / (1.0 / turning - 1.0) - 1.0).abs() < 1e-4, "{k}: {of_vector} {turning}");
            assert!((of_mean / (of_vector * (2.0 + of_vector)) - 1.0).abs() < 1e-9, "{k}");
        }
    }
}
