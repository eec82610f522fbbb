//! A model as JSON text: refused, or one that responds to a step of the voltage and has equations.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pmsm_core::equations::Equations;
use pmsm_core::monitor::Silent;
use pmsm_core::simulate::response::{Begin, Heating, Inputs, respond};
use pmsm_core::specification::Specification;

fuzz_target!(|text: &str| {
    let Ok(specification) = serde_json::from_str::<Specification>(text) else { return };
    let _ = specification.machine();
    let Ok((model, p)) = specification.model() else { return };
    let t = [0.0, 1e-4, 2e-4];
    let (v, tau_load) = ([1.0, 1.0, 0.0], [0.0; 3]);
    let inputs = Inputs { t: &t, v: [&v, &v], tau_load: &tau_load };
    let _ = respond(&model, &p, inputs, Begin::default(), Heating::default(), 1, &Silent);
    let _ = Equations::of(&model, &p, Heating::default());
});
