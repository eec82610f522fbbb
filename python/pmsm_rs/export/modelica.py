"""The model as Modelica text (Modelica language specification 3.5)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from .common import header
from .program import LIBM, Code, Language, code

if TYPE_CHECKING:
    from ..model import Model

MODELICA = Language(
    functions=LIBM | {"abs": "abs"},
    select="noEvent(if {test} > 0.0 then {yes} else {no})",
    define="  {name} = {value};",
)
_UNITS = {"lambda_d": "Wb", "lambda_q": "Wb", "omega_m": "rad/s", "theta_m": "rad"}
_OUTPUTS = {
    "i_d": "A",
    "i_q": "A",
    "tau_e": "N.m",
    "omega_e": "rad/s",
    "theta_e": "rad",
    "i_d_shown": "A",
    "i_q_shown": "A",
    "theta_e_shown": "rad",
}


def text(model: Model, name: str, *, temperature: float = 20.0) -> str:
    """The text of the model `name`, at a temperature of winding and magnets in degC."""
    told = model.equations(temperature=temperature, temperature_magnet=temperature)
    states = told["states"]
    begin = {"i_d": "i_d_start", "i_q": "i_q_start", "omega_m": "omega_m_start", "theta_m": "theta_m_start"}
    # At the beginning, what acts is not known yet.
    start = _program(told["start"], {**begin, "tau_load": "tau_load", "t": "time"}, "s")
    slope = _program(told["derivative"], {"t": "time"}, "a")
    shown = _program(told["output"], {"t": "time"}, "o")
    hidden = [line.split("=")[0].strip() for part in (start, slope, shown) for line in part.lines]
    said = " ".join(header(model)).replace("\\", "\\\\").replace('"', "'")
    lines = [
        f"model {name}",
        f'  "{said}"',
        *(
            f'  parameter Real {x}_start = 0 "{x} at the beginning";'
            for x in ("i_d", "i_q", "omega_m", "theta_m")
        ),
        '  input Real v_d(unit = "V") "voltage d that acts, rotor frame";',
        '  input Real v_q(unit = "V") "voltage q that acts, rotor frame";',
        '  input Real tau_load(unit = "N.m") "load torque against positive rotation";',
        *(f'  output Real {x}(unit = "{unit}");' for x, unit in _OUTPUTS.items()),
        *(f"  Real {x}{_unit(x)};" for x in states),
        *(["protected"] if hidden else []),
        *(f"  Real {x};" for x in hidden),
        "initial equation",
        *(f"  {x} = {start.outputs[x]};" for x in states),
        "equation",
        *start.lines,
        *slope.lines,
        *shown.lines,
        *(f"  der({x}) = {slope.outputs[x]};" for x in states),
        *(f"  {x} = {shown.outputs[x]};" for x in _OUTPUTS),
        f"end {name};",
    ]
    return "\n".join(lines) + "\n"


def _unit(state: str) -> str:
    return f'(unit = "{_UNITS[state]}")' if state in _UNITS else ""


def _program(program: Mapping[str, Any], names: Mapping[str, str], prefix: str) -> Code:
    return code(program, MODELICA, {x: names.get(x, x) for x in program["inputs"]}, prefix=f"{prefix}_")
