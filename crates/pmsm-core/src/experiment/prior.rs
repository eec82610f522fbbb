//! What is known of a parameter before a recording is looked at.
//!
//! A positive quantity that a nameplate states is off by a factor, not by a difference: its logarithm is normal. A parameter that may be
//! zero or change its sign is normal itself. Each counts as one observation beside the thousands of a recording: it decides what the
//! recording shows weakly, and leaves alone what it shows well.
//!
//! Far out the logarithm is sinh-normal (Rieck & Nedelman, "A log-linear model for the Birnbaum–Saunders distribution", Technometrics 33,
//! 1991): no machine has a thousand times the inductance that is stated, and a normal logarithm would let a fit walk there.

/// Share of the standard deviation of a logarithm by which the hyperbolic sine takes over: within three of them both are the same to 6 %.
const TAIL: f64 = 0.2;

/// Distribution of a parameter before the recording is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Index in the parameter vector.
    pub index: usize,
    /// Mean, or median of a lognormal distribution, in the parameter's unit.
    pub value: f64,
    /// Standard deviation in the parameter's unit, or that of the logarithm.
    spread: f64,
    lognormal: bool,
}

impl Prior {
    /// A normal distribution of standard deviation `spread`, in the parameter's unit.
    pub fn normal(index: usize, value: f64, spread: f64) -> Self {
        Self { index, value, spread, lognormal: false }
    }

    /// A lognormal distribution about the positive `value`, whose logarithm has the standard deviation `spread`.
    pub fn lognormal(index: usize, value: f64, spread: f64) -> Self {
        debug_assert!(value > 0.0, "a lognormal quantity is positive");
        Self { index, value, spread, lognormal: true }
    }

    /// By how many standard deviations `x` lies off, and by how many more it would per unit of the parameter.
    pub fn off(&self, x: f64) -> (f64, f64) {
        if self.lognormal {
            // Infinitely far at zero: a fit does not go there.
            let x = x.max(f64::MIN_POSITIVE);
            let z = TAIL * (x / self.value).ln() / self.spread;
            (z.sinh() / TAIL, z.cosh() / (x * self.spread))
        } else {
            ((x - self.value) / self.spread, 1.0 / self.spread)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_factor_either_way_is_as_far_off() {
        let prior = Prior::lognormal(0, 3.0, 0.2);
        assert!((prior.off(6.0).0 + prior.off(1.5).0).abs() < 1e-12);
        assert!(prior.off(0.0).0 < -1e100 && prior.off(3.0).0 == 0.0);
        for prior in [prior, Prior::normal(0, 3.0, 0.6)] {
            let step = 1e-6;
            let slope = (prior.off(3.3 + step).0 - prior.off(3.3 - step).0) / (2.0 * step);
            assert!((slope / prior.off(3.3).1 - 1.0).abs() < 1e-6);
        }
    }
}
