//! The catalogue of effects for Python.

use crate::errors::{InternalError, UsageError, to_usage};
use pmsm_core::effect::{Context, Role};
use pmsm_core::effects::text::{Definition, TextId};
use pmsm_core::effects::{ALL, EffectId};
use pyo3::prelude::*;
use serde_json::{Value, json};

/// The machine for which the catalogue shows ranges: the 19.8 kW, 1700 rpm servo motor of Liu, Liu & Cartes (2008)
/// at rated current, one second at 10 kHz.
const SERVO: Context = Context {
    n_p: 4.0,
    i_max: 58.8,
    v_max: 290.0,
    omega_e_max: 712.0,
    tau_max: 67.0,
    psi_max: 0.3,
    swing: 178.0,
    duration: 1.0,
    period: 1e-4,
    zero_sequence: 0.0,
    completed_phase: None,
    load_known: false,
    v_dc: 560.0,
    electrical_rate: 90.0,
    steady: false,
    has_temperature: false,
    has_magnet_temperature: false,
};

/// The catalogue as JSON text: a list of effects with their equations, parameters, signatures and look-alikes.
/// Ranges of parameters are those for a 20 kW servo motor, as they depend on the machine.
#[pyfunction]
pub fn effects() -> PyResult<String> {
    let list: Vec<_> = ALL.iter().map(|effect| entry(*effect)).collect();
    serde_json::to_string(&list).map_err(|error| InternalError::new_err(error.to_string()))
}

/// The entry of an effect given as text, as JSON text, with its `definition` as the core keeps it. `definition` is JSON text.
#[pyfunction]
pub fn effect_of_text(py: Python<'_>, definition: &str) -> PyResult<String> {
    let given: Definition = serde_json::from_str(definition)
        .map_err(|error| UsageError::new_err(format!("this effect cannot be used: {error}")))?;
    let id = TextId::new(&given).map_err(|error| to_usage(py, &error))?;
    let mut value = entry(EffectId::Text(id));
    value["definition"] = json!(id.definition());
    serde_json::to_string(&value).map_err(|error| InternalError::new_err(error.to_string()))
}

fn entry(effect: EffectId) -> Value {
    let info = effect.info();
    let parameters: Vec<_> = info
        .parameters
        .iter()
        .map(|p| {
            json!({
                "name": p.name, "symbol": p.name, "unit": p.unit, "meaning": p.meaning,
                "low": (p.low)(&SERVO), "high": (p.high)(&SERVO), "typical": (p.typical)(&SERVO),
                "strength": p.role == Role::Amplitude,
            })
        })
        .collect();
    let derived: Vec<_> = effect
        .derived()
        .iter()
        .map(|(name, unit, meaning)| json!({ "name": name, "unit": unit, "meaning": meaning }))
        .collect();
    json!({
        "id": info.id, "title": info.title, "sentence": info.sentence, "equation": info.equation,
        "acts_in": info.site, "source": info.source, "parameters": parameters, "derived": derived,
        "look_alikes": info.look_alikes, "fingerprint": info.fingerprint,
    })
}
