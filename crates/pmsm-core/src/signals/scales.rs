//! Scales of a run: the largest values that it takes, and the fastest electrical rate.

use super::Signals;
use crate::machine::{BaseParameter, Machine};
use crate::numerics::extent::{longest, peak, span};

impl Signals {
    /// Fills the scales of the context.
    pub(super) fn set_scales(&mut self, machine: &Machine, n: usize) {
        let largest = |x: &Option<[Vec<f64>; 2]>| x.as_ref().map_or(0.0, |[d, q]| longest([d, q]));
        let cx = &mut self.context;
        cx.i_max = largest(&self.i).max(1e-9);
        cx.v_max = largest(&self.v).max(1e-9);
        if cx.v_dc <= 0.0 {
            cx.v_dc = 3f64.sqrt() * cx.v_max;
        }
        cx.omega_e_max = peak(&self.omega_e).max(1e-6);
        cx.swing = span(&self.theta_m);
        // Without a nameplate the back-EMF at the highest speed bounds the flux.
        let psi_m = machine.get(BaseParameter::PsiM).unwrap_or(cx.v_max / cx.omega_e_max.max(1.0));
        let l = machine.get(BaseParameter::LQ).or(machine.get(BaseParameter::LD)).unwrap_or(0.0);
        cx.psi_max = psi_m.max(1e-9).hypot(l * cx.i_max);
        cx.tau_max = match &self.tau_e {
            Some(tau) => peak(tau),
            None => 1.5 * self.n_p * cx.psi_max * cx.i_max,
        }
        .max(1e-12);
        if let (Some([a, b, c]), true) = (&self.phases, self.three_currents) {
            cx.zero_sequence = (0..n).map(|k| a[k] + b[k] + c[k]).sum::<f64>() / (3.0 * n as f64);
        }
    }
}

/// r_s/l of the faster axis; where the nameplate is silent, that of a small servo motor.
pub(crate) fn electrical_rate(machine: &Machine) -> f64 {
    stated_rate(machine).unwrap_or(1000.0)
}

/// r_s/l of the faster axis, 1/s, if the nameplate states both.
pub(super) fn stated_rate(machine: &Machine) -> Option<f64> {
    let r_s = machine.get(BaseParameter::RS);
    let l = [BaseParameter::LD, BaseParameter::LQ].iter().filter_map(|p| machine.get(*p)).reduce(f64::min);
    Some(r_s? / l?)
}
