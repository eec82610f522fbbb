//! The nameplate of a permanent-magnet synchronous motor: what is known before anything is measured.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// The electrical and mechanical parameters of the dq-model, in the order used everywhere.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BaseParameter {
    /// Stator resistance per phase, Ω.
    RS,
    /// d-axis inductance, H.
    LD,
    /// q-axis inductance, H.
    LQ,
    /// Magnet flux linkage, peak per phase, V s.
    PsiM,
    /// Inertia of everything that turns, kg m².
    J,
    /// Viscous friction, N m s per mechanical rad/s.
    B,
}

impl BaseParameter {
    /// All base parameters in order.
    pub const ALL: [Self; 6] = [Self::RS, Self::LD, Self::LQ, Self::PsiM, Self::J, Self::B];
    /// The electrical ones.
    pub const ELECTRICAL: [Self; 4] = [Self::RS, Self::LD, Self::LQ, Self::PsiM];
    /// The mechanical ones.
    pub const MECHANICAL: [Self; 2] = [Self::J, Self::B];

    /// Index in the parameter vector.
    pub fn index(self) -> usize {
        self as usize
    }

    /// Name used in files and results.
    pub fn name(self) -> &'static str {
        ["r_s", "l_d", "l_q", "psi_m", "j", "b"][self.index()]
    }

    /// SI unit.
    pub fn unit(self) -> &'static str {
        ["ohm", "H", "H", "V s", "kg m^2", "N m s"][self.index()]
    }

    /// Range in which a real machine can lie.
    pub fn physical_range(self) -> (f64, f64) {
        [(1e-6, 1e4), (1e-8, 1e2), (1e-8, 1e2), (0.0, 1e3), (1e-10, 1e6), (0.0, 1e5)][self.index()]
    }
}

/// Nameplate of a machine and its drive; what is unknown is `None`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// Pole pairs.
    pub n_p: u32,
    /// Base parameters in the order of [`BaseParameter::ALL`], SI.
    pub base: [Option<f64>; 6],
    /// Nominal DC-link voltage, V.
    pub v_dc: Option<f64>,
    /// Rated current, A peak.
    pub i_rated: Option<f64>,
    /// Sampling (and switching) frequency of the drive, Hz.
    pub f_sample: Option<f64>,
}

impl Machine {
    /// A machine of which only the pole pairs are known.
    ///
    /// # Errors
    /// [`Error::Quantity`] unless 1 ≤ `n_p` ≤ 200.
    pub fn new(n_p: u32) -> Result<Self> {
        if !(1..=200).contains(&n_p) {
            return Err(Error::quantity(
                "n_p",
                f64::from(n_p),
                "pole pairs",
                "give the number of pole pairs, 1 to 200 (half the number of poles)",
            ));
        }
        Ok(Self { n_p, base: [None; 6], v_dc: None, i_rated: None, f_sample: None })
    }

    /// Sets a base parameter.
    ///
    /// # Errors
    /// [`Error::Quantity`] if the value is not finite or outside [`BaseParameter::physical_range`].
    pub fn with(mut self, parameter: BaseParameter, value: f64) -> Result<Self> {
        let (low, high) = parameter.physical_range();
        if !(value.is_finite() && (low..=high).contains(&value)) {
            let expected = format!("give a value between {low:e} and {high:e} {}", parameter.unit());
            return Err(Error::quantity(parameter.name(), value, parameter.unit(), &expected));
        }
        self.base[parameter.index()] = Some(value);
        Ok(self)
    }

    /// Sets what is known of the drive: DC-link voltage (V), rated peak current (A), sampling frequency (Hz).
    ///
    /// # Errors
    /// [`Error::Quantity`] for a value that is not positive and finite.
    pub fn with_drive(
        mut self,
        v_dc: Option<f64>,
        i_rated: Option<f64>,
        f_sample: Option<f64>,
    ) -> Result<Self> {
        for (name, value, unit, high) in
            [("v_dc", v_dc, "V", 1e6), ("i_rated", i_rated, "A", 1e6), ("f_sample", f_sample, "Hz", 1e9)]
        {
            if let Some(x) = value.filter(|x| !(x.is_finite() && *x > 0.0 && *x <= high)) {
                return Err(Error::quantity(name, x, unit, &format!("give a positive value up to {high:e}")));
            }
        }
        (self.v_dc, self.i_rated, self.f_sample) = (v_dc, i_rated, f_sample);
        Ok(self)
    }

    /// The nameplate value of a base parameter, if known.
    pub fn get(&self, parameter: BaseParameter) -> Option<f64> {
        self.base[parameter.index()]
    }

    /// Machine of Table 1 of Liu, Liu & Cartes (2008): 19.8 kW, 1700 rpm servo motor. `psi_m` follows from the
    /// torque constant k_t = 1.629 N·m per A rms: ψ = k_t / (3/2 · n_p · √2), the peak current being √2 times
    /// the rms value.
    pub fn liu_2008() -> Self {
        let psi_m = 1.629 / (1.5 * 4.0 * std::f64::consts::SQRT_2);
        Self {
            n_p: 4,
            base: [Some(0.17), Some(1.9e-3), Some(1.9e-3), Some(psi_m), Some(0.008), Some(0.00115)],
            v_dc: Some(560.0),
            i_rated: Some(41.56 * std::f64::consts::SQRT_2),
            f_sample: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absurd_values_are_refused_by_name_and_unit() {
        let machine = Machine::new(3).unwrap();
        let error = machine.clone().with(BaseParameter::J, -0.1).unwrap_err();
        assert!(error.to_string().contains("j is -0.1 kg m^2"), "{error}");
        assert!(machine.clone().with(BaseParameter::RS, f64::NAN).is_err());
        assert!(machine.with_drive(Some(0.0), None, None).is_err());
        assert!(Machine::new(0).is_err());
    }

    #[test]
    fn table_1_gives_its_rated_torque() {
        let machine = Machine::liu_2008();
        let psi = machine.get(BaseParameter::PsiM).unwrap();
        let torque = 1.5 * 4.0 * psi * 41.56 * std::f64::consts::SQRT_2;
        assert!((torque / 67.27 - 1.0).abs() < 0.01, "{torque}");
    }
}
