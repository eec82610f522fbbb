"""The model as a Rust program on the crate pmsm-core."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from .common import commented, header

if TYPE_CHECKING:
    from ..model import Model

_TEXT = """{header}
//
// Cargo.toml: pmsm-core and serde_json.

use pmsm_core::model::Model;
use pmsm_core::monitor::Silent;
use pmsm_core::simulate::response::{{self, Begin, Heating, Inputs}};
use pmsm_core::specification::Specification;

/// The model and its parameter vector.
pub fn motor() -> Result<(Model, Vec<f64>), Box<dyn std::error::Error>> {{
    Ok(serde_json::from_str::<Specification>(SPECIFICATION)?.model()?)
}}

/// The response from standstill to a voltage of {volts} V on the q axis.
fn main() -> Result<(), Box<dyn std::error::Error>> {{
    let (model, p) = motor()?;
    let period = {period};
    let t: Vec<f64> = (0..1000).map(|k| f64::from(k) * period).collect();
    let (v_d, v_q, tau_load) = (vec![0.0; t.len()], vec![{volts}; t.len()], vec![0.0; t.len()]);
    let inputs = Inputs {{ t: &t, v: [&v_d, &v_q], tau_load: &tau_load }};
    let steps = response::steps(&model, &p, period);
    let run = response::respond(&model, &p, inputs, Begin::default(), Heating::default(), steps, &Silent)?;
    println!("omega_m = {{}} rad/s after {{}} s", run["omega_m"][t.len() - 1], t[t.len() - 1]);
    Ok(())
}}

const SPECIFICATION: &str = r##"{specification}"##;
"""


def text(model: Model) -> str:
    """The source of the program."""
    specification = model.specification
    scales = specification["scales"]
    return _TEXT.format(
        header=commented(header(model), "//!"),
        volts=repr(round(0.1 * (scales["v_max"] or 1.0), 3)),
        period=repr(float(scales["period"])),
        specification=json.dumps(specification, indent=1, allow_nan=False),
    )
