//! What a simulated recording is the recording of: the machine's parameters and what its sensors did not see.

use super::cycle::{Motor, Sample};
use crate::base::{BASE, Base};
use crate::effect::Context;
use crate::machine::{BaseParameter, Machine};
use serde::Serialize;
use std::collections::BTreeMap;

/// A value with its unit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Value {
    /// SI.
    pub value: f64,
    /// SI unit, "1" for a pure number.
    pub unit: &'static str,
}

/// An effect of the machine.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EffectTruth {
    /// Identifier of the catalogue.
    pub effect: &'static str,
    /// Its parameters in the equations.
    pub parameters: BTreeMap<&'static str, Value>,
    /// What an identification reports of it.
    pub outputs: BTreeMap<&'static str, Value>,
}

/// The truth behind a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Truth {
    /// Base parameters at the start.
    pub base: BTreeMap<&'static str, Value>,
    /// Effects.
    pub effects: Vec<EffectTruth>,
    /// Scales at which the effects' parameters are meant: a saturation's `k`, for one, refers to `psi_max`.
    pub scales: Context,
    /// True signals, each of one entry per sample: `i_d`, `i_q` (A), `theta_m` (rad), `omega_m` (rad/s), `tau_e`,
    /// `tau_load` (N·m), every base parameter that drifts, and `tau_load_disturbed` (N·m).
    #[serde(skip)]
    pub traces: BTreeMap<&'static str, Vec<f64>>,
}

impl Truth {
    /// Before the first sample.
    pub(super) fn new(motor: &Motor) -> Self {
        let base = BaseParameter::ALL.map(|p| (p.name(), value(motor.p[p.index()], p.unit())));
        let own = Base::new(&motor.p[..BASE]);
        let effects = motor.model.slots().iter().map(|slot| {
            let p = &motor.p[slot.parameters.clone()];
            let info = slot.effect.info();
            let outputs = slot.effect.outputs(p, &own, motor.model.context());
            EffectTruth {
                effect: info.id,
                parameters: info.parameters.iter().zip(p).map(|(i, x)| (i.name, value(*x, i.unit))).collect(),
                outputs: outputs.into_iter().map(|(name, unit, x)| (name, value(x, unit))).collect(),
            }
        });
        Self {
            base: base.into(),
            effects: effects.collect(),
            scales: *motor.model.context(),
            traces: BTreeMap::new(),
        }
    }

    /// Takes a sample.
    pub(super) fn push(&mut self, motor: &Motor, sample: &Sample) {
        let state = &sample.truth;
        let mut put = |name, x| self.traces.entry(name).or_default().push(x);
        put("i_d", state.i[0]);
        put("i_q", state.i[1]);
        put("theta_m", state.theta_m);
        put("omega_m", state.omega_m);
        put("tau_e", state.tau_e);
        put("tau_load", state.tau_load);
        for p in BaseParameter::ALL {
            // The disturbed load needs j and b whether they drift or not; `finish` drops them again.
            let kept = BaseParameter::MECHANICAL.contains(&p) || motor.drift[p.index()].is_some();
            if kept {
                put(p.name(), state.base[p.index()]);
            }
        }
    }

    /// Behind the last sample: adds T_Ld = T_L + (j − j_0)·dω_m/dt + (b − b_0)·ω_m, equation (4) of Liu, Liu & Cartes
    /// (2008), where the nameplate has j_0 and b_0: what an identification that believes the nameplate sees. The
    /// acceleration is the mean over the sampling period that begins with the sample.
    pub(super) fn finish(&mut self, motor: &Motor, nameplate: &Machine, period: f64) {
        if let [Some(j_0), Some(b_0)] = BaseParameter::MECHANICAL.map(|p| nameplate.get(p)) {
            let trace = |name: &str| &self.traces[name];
            let (omega, load, j, b) = (trace("omega_m"), trace("tau_load"), trace("j"), trace("b"));
            let last = omega.len() - 1;
            let disturbed = (0..=last).map(|k| {
                let (a, c) = if k < last { (k, k + 1) } else { (k - 1, k) };
                let acceleration = (omega[c] - omega[a]) / period;
                load[k] + (j[k] - j_0) * acceleration + (b[k] - b_0) * omega[k]
            });
            let disturbed = disturbed.collect();
            self.traces.insert("tau_load_disturbed", disturbed);
        }
        for p in BaseParameter::MECHANICAL {
            if motor.drift[p.index()].is_none() {
                self.traces.remove(p.name());
            }
        }
    }
}

fn value(value: f64, unit: &'static str) -> Value {
    Value { value, unit }
}
