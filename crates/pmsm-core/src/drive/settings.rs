//! The settings of the drive: inverter, controllers, sensors.

use super::control::{Control, Gains};
use super::manoeuvre::Manoeuvre;
use crate::error::{Error, Result};
use crate::machine::Machine;
use crate::recording::Load;
use serde::{Deserialize, Serialize};

/// Sampling frequency where neither settings nor nameplate name one, Hz.
const F_SAMPLE: f64 = 10e3;
/// Default current limit in rated currents.
const OVERLOAD: f64 = 2.0;
/// Most samples of a simulation.
const MOST_SAMPLES: f64 = 5e7;
/// Most carrier periods per sampling period.
const MOST_CARRIERS: f64 = 1000.0;

/// In which frame the commanded voltage stands still during a sampling period.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hold {
    /// In the rotor's: what is logged is exactly what acts.
    #[default]
    Rotor,
    /// In the stator's, as a real modulator holds it; logged is its mean as the rotor sees it.
    Stator,
}

/// How the voltage is made.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Inverter {
    /// The mean voltage over each sampling period.
    Averaged {
        /// In which frame it is held.
        #[serde(default)]
        hold: Hold,
    },
    /// Legs switched by comparison of the duty cycles with a triangular carrier, space-vector modulation (common voltage
    /// at the mean of the largest and the smallest phase).
    Switching {
        /// Carrier frequency, Hz: a whole multiple of the sampling frequency, or half of it. The sampling frequency
        /// where it is left out.
        #[serde(default)]
        f_sw: Option<f64>,
    },
}

/// Where the speed comes from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SpeedSensor {
    /// A tachometer: the speed itself.
    Tachometer,
    /// A phase-locked loop on the encoder's angle with this bandwidth in Hz.
    Encoder {
        /// Bandwidth, Hz.
        bandwidth: f64,
    },
}

/// The sensors. Zero means ideal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sensors {
    /// Noise of each phase current, A rms.
    pub noise_i: f64,
    /// Step of the converter that reads the currents, A.
    pub step_i: f64,
    /// Noise of the speed, rad/s electrical, rms.
    pub noise_omega_e: f64,
    /// Noise of a measured load torque, N·m rms.
    pub noise_tau: f64,
    /// Counts of the encoder per mechanical revolution.
    pub encoder_counts: u32,
    /// Where the speed comes from.
    pub speed: SpeedSensor,
    /// Whether the mechanical angle is logged, too.
    pub log_theta_m: bool,
}

impl Default for Sensors {
    fn default() -> Self {
        Self {
            noise_i: 0.0,
            step_i: 0.0,
            noise_omega_e: 0.0,
            noise_tau: 0.0,
            encoder_counts: 0,
            speed: SpeedSensor::Tachometer,
            log_theta_m: false,
        }
    }
}

/// The drive around the machine. What is left out comes from the nameplate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DriveSettings {
    /// DC-link voltage, V.
    pub v_dc: Option<f64>,
    /// Limit of the current reference, A peak.
    pub i_limit: Option<f64>,
    /// Sampling and control frequency, Hz.
    pub f_sample: Option<f64>,
    /// Sampling periods between a sample and the voltage computed from it: 1, or 0 for an ideal computer.
    pub delay: u8,
    /// How the voltage is made.
    pub inverter: Inverter,
    /// Controllers.
    pub control: Control,
    /// Sensors.
    pub sensors: Sensors,
    /// Least number of integration steps per sampling period (or piece of it between switching edges); more are taken
    /// where the machine is fast.
    pub substeps: u16,
}

impl Default for DriveSettings {
    fn default() -> Self {
        Self {
            v_dc: None,
            i_limit: None,
            f_sample: None,
            delay: 1,
            inverter: Inverter::Averaged { hold: Hold::Rotor },
            control: Control::default(),
            sensors: Sensors::default(),
            substeps: 1,
        }
    }
}

/// Settings with every gap filled and every number checked.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Resolved {
    pub v_dc: f64,
    pub i_limit: f64,
    pub period: f64,
    pub delay: bool,
    /// Carrier periods per sampling period where legs switch.
    pub carriers: Option<f64>,
    pub hold: Hold,
    pub gains: Gains,
    pub sensors: Sensors,
    pub substeps: usize,
    pub load: Load,
    /// Samples before the recording, and of the recording.
    pub samples: (usize, usize),
}

impl Resolved {
    pub fn new(drive: &DriveSettings, nameplate: &Machine, manoeuvre: &Manoeuvre) -> Result<Self> {
        let positive = |name: &str, value: f64, unit: &'static str| {
            if value.is_finite() && value > 0.0 {
                Ok(value)
            } else {
                Err(Error::quantity(name, value, unit, "give a positive finite value"))
            }
        };
        let missing = |name: &str, what: &str| {
            Error::unusable(
                format!("neither the drive nor the nameplate tells {name}"),
                format!("give {what}"),
            )
        };
        let v_dc =
            drive.v_dc.or(nameplate.v_dc).ok_or_else(|| missing("v_dc", "the DC-link voltage in V"))?;
        let v_dc = positive("v_dc", v_dc, "V")?;
        let i_limit = drive
            .i_limit
            .or(nameplate.i_rated.map(|i| OVERLOAD * i))
            .ok_or_else(|| missing("i_limit", "the current limit in A peak, or i_rated"))?;
        let i_limit = positive("i_limit", i_limit, "A")?;
        let f_sample = drive.f_sample.or(nameplate.f_sample).unwrap_or(F_SAMPLE);
        let f_sample = positive("f_sample", f_sample, "Hz")?;
        if drive.delay > 1 {
            let expected = "give 0 or 1; longer delays are the effect voltage_delay";
            return Err(Error::quantity("delay", f64::from(drive.delay), "sampling periods", expected));
        }
        if drive.substeps == 0 {
            return Err(Error::quantity("substeps", 0.0, "", "give at least 1"));
        }
        let (carriers, hold) = match drive.inverter {
            Inverter::Averaged { hold } => (None, hold),
            Inverter::Switching { f_sw } => {
                let ratio = positive("f_sw", f_sw.unwrap_or(f_sample), "Hz")? / f_sample;
                let whole = if ratio < 0.75 { 0.5 } else { ratio.round() };
                if (ratio / whole - 1.0).abs() > 1e-6 || whole > MOST_CARRIERS {
                    let expected = format!(
                        "give half of f_sample or a whole multiple of it, such as {} Hz",
                        whole.min(MOST_CARRIERS) * f_sample
                    );
                    return Err(Error::quantity("f_sw", ratio * f_sample, "Hz", &expected));
                }
                (Some(whole), Hold::Stator)
            }
        };
        let s = &drive.sensors;
        for (name, value, unit) in [
            ("noise_i", s.noise_i, "A"),
            ("step_i", s.step_i, "A"),
            ("noise_omega_e", s.noise_omega_e, "rad/s"),
            ("noise_tau", s.noise_tau, "N m"),
            ("settle", manoeuvre.settle, "s"),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(Error::quantity(name, value, unit, "give zero or a positive finite value"));
            }
        }
        if let SpeedSensor::Encoder { bandwidth } = s.speed
            && positive("bandwidth", bandwidth, "Hz")? > 0.1 * f_sample
        {
            let expected = "give at most a tenth of the sampling frequency";
            return Err(Error::quantity("bandwidth", bandwidth, "Hz", expected));
        }
        for (name, value, unit) in [
            ("start_theta_e", manoeuvre.start_theta_e, "rad"),
            ("start_omega_m", manoeuvre.start_omega_m, "rad/s"),
        ] {
            if !value.is_finite() {
                return Err(Error::quantity(name, value, unit, "give a finite value"));
            }
        }
        positive("duration", manoeuvre.duration, "s")?;
        let samples = [manoeuvre.settle, manoeuvre.duration].map(|t| (t * f_sample).round());
        if samples[0] + samples[1] > MOST_SAMPLES {
            let expected = format!("at {f_sample} Hz, {} s are the most", MOST_SAMPLES / f_sample);
            return Err(Error::quantity("duration", manoeuvre.duration, "s", &expected));
        }
        let load = manoeuvre.load()?;
        let speed = manoeuvre.omega_m.is_some();
        Ok(Self {
            v_dc,
            i_limit,
            period: 1.0 / f_sample,
            delay: drive.delay == 1,
            carriers,
            hold,
            gains: Gains::new(&drive.control, nameplate, f_sample, speed)?,
            sensors: s.clone(),
            substeps: usize::from(drive.substeps),
            load,
            samples: (samples[0] as usize, samples[1] as usize),
        })
    }
}
