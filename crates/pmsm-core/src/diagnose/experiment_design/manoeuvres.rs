//! Manoeuvres that a bench may try without leaving the speed, current and voltage that it has recorded.

use crate::drive::{Manoeuvre, Schedule, Shape};
use crate::error::Result;

/// Share of a recorded limit that a manoeuvre uses.
const USED: f64 = 0.8;
/// Ramps take this share of a manoeuvre between two speeds.
const RAMP: f64 = 0.3;
/// Time in which the controllers settle before the recording begins, share of the manoeuvre.
const SETTLE: f64 = 0.2;
/// Frequencies of the dither on i_d and i_q, in periods per manoeuvre.
const DITHER: [f64; 2] = [11.0, 17.0];

/// What a bench has shown that it can bear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest mechanical speed, rad/s.
    pub omega_m: f64,
    /// Largest current vector, A.
    pub current: f64,
    /// Acceleration per ampere of i_q, rad/s² mechanical.
    pub agility: f64,
    /// Whether the rotor is held.
    pub locked: bool,
    /// Whether currents and voltages are logged, so that steps of i_d tell something.
    pub electrical: bool,
    /// Length of a manoeuvre, s.
    pub duration: f64,
}

/// A manoeuvre and its words, which follow "To tell … apart, ".
#[derive(Debug, Clone)]
pub struct Candidate {
    /// What to do.
    pub words: String,
    /// The same for the drive.
    pub manoeuvre: Manoeuvre,
}

/// A quantity of three digits.
pub fn digits(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return format!("{x}");
    }
    let decimals = (2.0 - x.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    let text = format!("{x:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

impl Limits {
    /// Speed that is reached from standstill within half of a ramp by part of the current that the manoeuvres use.
    fn reach(&self) -> f64 {
        0.5 * RAMP * self.duration * 0.6 * USED * self.current * self.agility
    }

    /// The manoeuvres.
    ///
    /// # Errors
    /// Those of [`Schedule::new`], for limits that are not finite.
    pub fn candidates(&self) -> Result<Vec<Candidate>> {
        let mut out = Vec::new();
        let (t, i, top) = (self.duration, USED * self.current, USED * self.omega_m);
        let w = top.min(self.reach());
        let mut add = |words: String, change: &dyn Fn(&mut Manoeuvre) -> Result<()>| -> Result<()> {
            let mut manoeuvre = Manoeuvre::new(t);
            manoeuvre.settle = SETTLE * t;
            change(&mut manoeuvre)?;
            if let Some(speed) = &manoeuvre.omega_m {
                manoeuvre.start_omega_m = speed.at(0.0);
            }
            out.push(Candidate { words, manoeuvre });
            Ok(())
        };
        let line = |points: &[(f64, f64)]| {
            Schedule::new(points.iter().map(|(share, x)| (share * t, *x)).collect(), Shape::Linear)
        };
        let steps = |points: &[(f64, f64)]| {
            Schedule::new(points.iter().map(|(share, x)| (share * t, *x)).collect(), Shape::Steps)
        };
        let reversal = |w: f64| line(&[(0.1, w), (0.1 + RAMP, -w), (0.6, -w), (0.6 + RAMP, w)]);
        let square = |size: f64, periods: f64| {
            let half = (0..(2.0 * periods) as usize)
                .map(|k| (k as f64 / (2.0 * periods), if k % 2 == 0 { size } else { -size }));
            steps(&half.collect::<Vec<_>>())
        };
        if self.locked {
            let (low, high) = (digits(0.4 * i), digits(i));
            add(format!("with the rotor held, step i_d between ±{low} A and ±{high} A"), &|m| {
                let levels = [(0.0, 0.4 * i), (0.25, -0.4 * i), (0.5, i), (0.75, -i)];
                m.i_d = Some(steps(&levels)?);
                Ok(())
            })?;
            add(format!("with the rotor held, step i_q between ±{low} A and ±{high} A"), &|m| {
                let levels = [(0.0, 0.4 * i), (0.25, -0.4 * i), (0.5, i), (0.75, -i)];
                m.i_q = Some(steps(&levels)?);
                Ok(())
            })?;
            let each = 0.5 * i;
            add(format!("with the rotor held, swing i_d and i_q by ±{} A each", digits(each)), &|m| {
                (m.i_d, m.i_q) = (Some(square(each, DITHER[0])?), Some(square(each, DITHER[1])?));
                Ok(())
            })?;
            return Ok(out);
        }
        if self.omega_m * t < 1e-6 || w <= 0.0 {
            return Ok(out);
        }
        let low = (top / 3.0).max(top - 2.0 * self.reach());
        let (fast, slow, middle) = (digits(w), digits(0.1 * w), digits(0.5 * top));
        add(format!("reverse the speed between ±{fast} rad/s"), &|m| {
            m.omega_m = Some(reversal(w)?);
            Ok(())
        })?;
        add(format!("reverse the speed slowly through standstill between ±{slow} rad/s"), &|m| {
            m.omega_m = Some(reversal(0.1 * w)?);
            Ok(())
        })?;
        add(format!("hold the speed at {} rad/s and then at {} rad/s", digits(low), digits(top)), &|m| {
            m.omega_m = Some(line(&[(0.35, low), (0.65, top)])?);
            Ok(())
        })?;
        add(format!("spin up to {} rad/s, then command zero current and let it coast", digits(top)), &|m| {
            (m.start_omega_m, m.settle) = (top, 0.0);
            Ok(())
        })?;
        let (weak, strong) = (0.4 * i, 0.8 * i);
        let rise = 0.8 * w / (weak * self.agility);
        add(
            format!(
                "accelerate and brake both ways with i_q of {} A and of {} A",
                digits(weak),
                digits(strong)
            ),
            &|m| {
                let (mut at, mut points) = (0.0, Vec::new());
                while at < t {
                    for (length, level) in [(1.0, weak), (1.0, -weak), (0.5, -strong), (0.5, strong)] {
                        points.push((at, level));
                        at += length * rise.max(0.05 * t);
                    }
                }
                m.settle = 0.0;
                m.i_q = Some(Schedule::new(points, Shape::Steps)?);
                Ok(())
            },
        )?;
        if !self.electrical {
            return Ok(out);
        }
        let d = digits(0.5 * i);
        let around = [(0.0, 0.0), (0.2, -0.5 * i), (0.45, 0.0), (0.6, 0.5 * i), (0.8, 0.0)];
        add(format!("hold {middle} rad/s and step i_d to -{d} A, zero and +{d} A"), &|m| {
            m.omega_m = Some(Schedule::constant(0.5 * top)?);
            m.i_d = Some(steps(&around)?);
            Ok(())
        })?;
        add(format!("at standstill, step i_d to -{d} A, zero and +{d} A"), &|m| {
            m.omega_m = Some(Schedule::constant(0.0)?);
            m.i_d = Some(steps(&around)?);
            Ok(())
        })?;
        add(
            format!("reverse the speed between ±{fast} rad/s, first with i_d = 0 and then with -{d} A"),
            &|m| {
                m.omega_m = Some(reversal(w)?);
                m.i_d = Some(steps(&[(0.0, 0.0), (0.5, -0.5 * i)])?);
                Ok(())
            },
        )?;
        let swing = 0.25 * i;
        add(format!("hold {middle} rad/s and swing i_d and i_q by ±{} A", digits(swing)), &|m| {
            m.omega_m = Some(Schedule::constant(0.5 * top)?);
            (m.i_d, m.i_q) = (Some(square(swing, DITHER[0])?), Some(square(swing, DITHER[1])?));
            Ok(())
        })?;
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits {
        omega_m: 200.0,
        current: 10.0,
        agility: 300.0,
        locked: false,
        electrical: true,
        duration: 0.5,
    };

    #[test]
    fn references_stay_within_what_the_bench_has_borne() {
        for candidate in LIMITS.candidates().unwrap() {
            let m = &candidate.manoeuvre;
            for speed in m.omega_m.iter().map(Schedule::peak).chain([m.start_omega_m]) {
                assert!(speed <= LIMITS.omega_m, "{}", candidate.words);
            }
            let peak = |x: &Option<Schedule>| x.as_ref().map_or(0.0, Schedule::peak);
            assert!(peak(&m.i_d).hypot(peak(&m.i_q)) <= LIMITS.current, "{}", candidate.words);
        }
    }

    #[test]
    fn a_held_rotor_is_not_asked_to_turn_nor_a_log_without_currents_for_i_d() {
        let held = Limits { locked: true, ..LIMITS }.candidates().unwrap();
        assert!(!held.is_empty() && held.iter().all(|c| c.manoeuvre.omega_m.is_none()));
        let blind = Limits { electrical: false, ..LIMITS }.candidates().unwrap();
        assert!(!blind.is_empty() && blind.iter().all(|c| c.manoeuvre.i_d.is_none()));
    }

    #[test]
    fn quantities_have_three_digits() {
        assert_eq!(
            [digits(183.74), digits(0.5), digits(-12.3456), digits(0.0)],
            ["184", "0.5", "-12.3", "0"]
        );
    }
}
