//! Settings as JSON text, as Python hands them over: refused, or they pass their own checks.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pmsm_core::diagnose::DiagnosisOptions;
use pmsm_core::optimise::swarm::SwarmSettings;
use pmsm_core::recording::Load;

fuzz_target!(|data: (&str, &str, Option<f64>)| {
    let (text, kind, value) = data;
    if let Ok(options) = serde_json::from_str::<DiagnosisOptions>(text) {
        let _ = options.check();
    }
    if let Ok(settings) = serde_json::from_str::<SwarmSettings>(text) {
        let _ = settings.validate();
    }
    let _ = Load::parse(kind, value);
});
