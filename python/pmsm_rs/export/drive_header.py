"""Compensation for a drive as a C header: single precision, no allocation, C99.

It holds the feed-forward of friction and of torques over the angle as formula and table, and the voltage that
dead time takes. It holds the flux map, the currents of most torque per ampere, and the resistance over
temperature.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .c_source import _mentions
from .common import header, not_expressed, sites
from .program import LIBM, Language, code, evaluate, needs, restricted

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..model import Model

    Array = NDArray[np.float64]

# Entries of the tables.
_SPEEDS, _ANGLES, _CURRENTS, _GRID, _TORQUES = 129, 512, 129, 17, 33
# Angles of an electrical turn over which the flux map is averaged.
_AVERAGED = 24
_COMPENSATED = {
    "saturation_d",
    "saturation_q",
    "cross_saturation",
    "dead_time",
}


def number(x: float) -> str:
    """A number in single precision as C writes it."""
    if not math.isfinite(x):
        return "NAN" if math.isnan(x) else ("INFINITY" if x > 0.0 else "-INFINITY")
    text = f"{x:.9g}"
    return (text if any(mark in text for mark in ".e") else text + ".0") + "f"


SINGLE = Language(
    functions={kind: f"{name}f" for kind, name in LIBM.items()},
    select="({test} > 0.0f ? {yes} : {no})",
    define="    const float {name} = {value};",
    number=number,
)


def text(model: Model, *, prefix: str = "motor") -> tuple[str, list[str]]:
    """The header, and what it does not compensate. `prefix` begins the names in it."""
    told, base, scales = model.equations(), model.specification["base"], model.specification["scales"]
    torque = told["torque"]
    by = {name: needs(torque, name) for name, _ in torque["outputs"]}
    friction = [name for name, inputs in by.items() if inputs and inputs <= {"omega_m", "tau_e"}]
    position = [name for name, inputs in by.items() if inputs == {"theta_m"}]
    dead = next((x["parameters"] for x in model.specification["effects"] if x["effect"] == "dead_time"), None)
    warming = next(
        (x["parameters"] for x in model.specification["effects"] if x["effect"] == "rs_thermal_drift"), None
    )
    sensor = {name for name, site in sites(model).items() if site == "sensor"}
    known = [*friction, *position, *_COMPENSATED, *(["rs_thermal_drift"] if _has_alpha(warming) else [])]
    rest = not_expressed(model, known)
    if "unmodelled" in (*friction, *position):
        rest = [name for name in rest if name != "unmodelled map"]
        if any(part["equations"] != ["mechanical"] for part in model.specification["map"]):
            rest.append("what the unmodelled map adds to voltages or angle")
    left_out = [f"Not compensated here: {', '.join(rest)}."] if rest else []
    if sensor & set(rest):
        left_out.append("Errors of sensors are corrected where they are read, with the values above.")
    upper = prefix.upper()
    omega_max = scales["omega_e_max"] / scales["n_p"]
    parts = [
        "/*\n"
        + "\n".join(f" * {line}".rstrip() for line in (*header(model), *left_out)).replace("*/", "* /")
        + "\n */",
        f"#ifndef {upper}_COMPENSATION_H\n#define {upper}_COMPENSATION_H\n\n#include <math.h>",
        _constants(upper, base, scales),
        _lookup(prefix),
        _friction(torque, friction, prefix, base["b"], omega_max),
        _position(torque, position, prefix),
        _dead_time(dead, prefix, scales["i_max"]),
        *_maps(told, scales, prefix),
        _resistance(warming, prefix, base["r_s"]),
        f"#endif /* {upper}_COMPENSATION_H */",
    ]
    return "\n\n".join(part for part in parts if part) + "\n", left_out


def _constants(upper: str, base: Mapping[str, float], scales: Mapping[str, Any]) -> str:
    lines = [f"#define {upper}_N_P {number(scales['n_p'])}"]
    lines += [f"#define {upper}_{name.upper()} {number(base[name])}" for name in base]
    return "\n".join(lines)


def _lookup(prefix: str) -> str:
    return f"""/* Linear interpolation in n entries from low to high; the ends hold outside. */
static inline float {prefix}_lookup(const float *table, int n, float low, float high, float x)
{{
    float at = (x - low) * (float)(n - 1) / (high - low);
    int k;
    if (!(at > 0.0f)) return table[0];
    if (at >= (float)(n - 1)) return table[n - 1];
    k = (int)at;
    return table[k] + (at - (float)k) * (table[k + 1] - table[k]);
}}"""


def _function(
    program: Mapping[str, Any], wanted: Sequence[str], name: str, arguments: Sequence[str], more: str = ""
) -> str:
    """A function whose value is the sum of some outputs, and of one term more."""
    fixed = {x: "0.0f" for x in program["inputs"]}
    written = code(restricted(program, wanted), SINGLE, {**fixed, **{x: x for x in arguments}}, prefix="y")
    terms = [f"({written.outputs[x]})" for x in wanted] + ([more] if more else [])
    value = " + ".join(terms) or "0.0f"
    used = "\n".join([*written.lines, value])
    unused = [f"    (void){x};" for x in arguments if not _mentions(used, x)]
    signature = ", ".join(f"float {x}" for x in arguments)
    return "\n".join(
        [
            f"static inline float {name}({signature})",
            "{",
            *unused,
            *written.lines,
            f"    return {value};",
            "}",
        ]
    )


def _table(name: str, values: Array, said: str) -> str:
    rows = [", ".join(number(float(x)) for x in values[k : k + 8]) for k in range(0, len(values), 8)]
    body = ",\n    ".join(rows)
    return f"/* {said} */\nstatic const float {name}[{len(values)}] = {{\n    {body}\n}};"


def _friction(
    torque: Mapping[str, Any],
    friction: Sequence[str],
    prefix: str,
    b: float,
    omega_max: float,
) -> str:
    parts = ", ".join(friction) or "viscous alone"
    said = f"/* Friction and drag, N m, against the motion: add it to the torque reference. {parts}. */"
    name = f"{prefix}_friction"
    function = _function(torque, friction, name, ["omega_m", "tau_e"], f"{number(b)} * omega_m")
    omega = np.linspace(-omega_max, omega_max, _SPEEDS)
    at: dict[str, Any] = {"omega_m": omega, "theta_m": 0.0, "tau_e": 0.0, "t": 0.0}
    found = evaluate(torque, at) if friction else {}
    values = b * omega + sum((np.broadcast_to(found[x], omega.shape) for x in friction), np.zeros_like(omega))
    return "\n".join(
        [
            said,
            function,
            _table(
                f"{name}_table",
                values,
                f"The same at no torque over omega_m from {-omega_max:.6g} to {omega_max:.6g} rad/s.",
            ),
            f"#define {prefix.upper()}_FRICTION_LOW {number(-omega_max)}",
            f"#define {prefix.upper()}_FRICTION_HIGH {number(omega_max)}",
        ]
    )


def _position(torque: Mapping[str, Any], position: Sequence[str], prefix: str) -> str:
    if not position:
        return ""
    name = f"{prefix}_position_torque"
    theta = np.linspace(0.0, 2.0 * math.pi, _ANGLES)
    found = evaluate(torque, {"omega_m": 0.0, "theta_m": theta, "tau_e": 0.0, "t": 0.0})
    values = sum((np.broadcast_to(found[x], theta.shape) for x in position), np.zeros_like(theta))
    return "\n".join(
        [
            "/* Torque over the mechanical angle, N m, against positive rotation: add it to the reference.",
            f"   {', '.join(position)}. */",
            _function(torque, position, name, ["theta_m"]),
            _table(f"{name}_table", values, "The same over theta_m from 0 to 2 pi."),
        ]
    )


def _dead_time(dead: Mapping[str, float] | None, prefix: str, i_max: float) -> str:
    if dead is None:
        return ""
    v_err, i_th = dead["v_err"], dead["i_th"]
    current = np.linspace(-i_max, i_max, _CURRENTS)
    values = v_err * current / np.sqrt(current**2 + i_th**2)
    name = f"{prefix}_dead_time_voltage"
    return "\n".join(
        [
            "/* Voltage that dead time and devices take from a phase, V, over its current in A: add it to",
            "   the phase's command. */",
            f"static inline float {name}(float i)",
            "{",
            f"    return {number(v_err)} * i / sqrtf(i * i + {number(i_th**2)});",
            "}",
            _table(f"{name}_table", values, f"The same over the current from {-i_max:.6g} to {i_max:.6g} A."),
        ]
    )


def _flux(told: Mapping[str, Any], i_d: Array, i_q: Array) -> tuple[Array, Array, Array]:
    """Flux linkages (V s) and torque (N m) at currents, averaged over an electrical turn."""
    n_p = told["n_p"]
    sums = [np.zeros(np.broadcast_shapes(i_d.shape, i_q.shape)) for _ in range(3)]
    for k in range(_AVERAGED):
        theta = 2.0 * math.pi * k / _AVERAGED / n_p
        begin = {"i_d": i_d, "i_q": i_q, "omega_m": 0.0, "theta_m": theta, "tau_load": 0.0, "t": 0.0}
        state = evaluate(told["start"], begin)
        shown = evaluate(told["output"], {"t": 0.0, **state})
        for total, x in zip(sums, (state["lambda_d"], state["lambda_q"], shown["tau_e"]), strict=True):
            total += x / _AVERAGED
    return sums[0], sums[1], sums[2]


def _maps(told: Mapping[str, Any], scales: Mapping[str, Any], prefix: str) -> list[str]:
    """The flux map on a grid of currents, and the currents of most torque per ampere."""
    i_max = scales["i_max"]
    axis = np.linspace(-i_max, i_max, _GRID)
    lambda_d, lambda_q, _ = _flux(told, axis[:, None], axis[None, :])
    upper = prefix.upper()
    grid = [
        f"#define {upper}_FLUX_GRID {_GRID}\n#define {upper}_FLUX_I_MAX {number(i_max)}",
        _table(
            f"{prefix}_lambda_d_table",
            lambda_d.ravel(),
            "lambda_d, V s, over i_d (slow) and i_q (fast) from -I_MAX to I_MAX.",
        ),
        _table(f"{prefix}_lambda_q_table", lambda_q.ravel(), "lambda_q, V s, likewise."),
        f"""/* Value of a flux map at currents in A, linear between the entries. */
static inline float {prefix}_flux(const float *table, float i_d, float i_q)
{{
    const float n = (float)({upper}_FLUX_GRID - 1);
    float a = (i_d / {upper}_FLUX_I_MAX + 1.0f) * 0.5f * n;
    float b = (i_q / {upper}_FLUX_I_MAX + 1.0f) * 0.5f * n;
    int j, k;
    const float *p;
    a = a > 0.0f ? (a < n ? a : n) : 0.0f;
    b = b > 0.0f ? (b < n ? b : n) : 0.0f;
    j = (int)a < {upper}_FLUX_GRID - 2 ? (int)a : {upper}_FLUX_GRID - 2;
    k = (int)b < {upper}_FLUX_GRID - 2 ? (int)b : {upper}_FLUX_GRID - 2;
    a -= (float)j;
    b -= (float)k;
    p = table + j * {upper}_FLUX_GRID + k;
    return (1.0f - a) * ((1.0f - b) * p[0] + b * p[1])
        + a * ((1.0f - b) * p[{upper}_FLUX_GRID] + b * p[{upper}_FLUX_GRID + 1]);
}}""",
    ]
    return [*grid, *_most_torque(told, i_max, prefix)]


def _most_torque(told: Mapping[str, Any], i_max: float, prefix: str) -> list[str]:
    size = np.linspace(0.0, i_max, 65)
    angle = np.radians(np.linspace(0.0, 180.0, 181))
    i_d, i_q = size[:, None] * np.cos(angle), size[:, None] * np.sin(angle)
    torque = _flux(told, i_d, i_q)[2]
    best = torque.argmax(axis=1)
    # A parabola through the best angle and its neighbours finds the top between them.
    inner = np.clip(best, 1, len(angle) - 2)
    rows = np.arange(len(size))
    low, top, high = (torque[rows, inner + k] for k in (-1, 0, 1))
    bend = low - 2.0 * top + high
    shift = np.where(np.abs(bend) > 0.0, 0.5 * (low - high) / np.where(bend == 0.0, 1.0, bend), 0.0)
    gamma = angle[inner] + np.clip(shift, -1.0, 1.0) * (angle[1] - angle[0])
    most = np.maximum.accumulate(torque.max(axis=1))
    levels = np.linspace(0.0, most[-1], _TORQUES)
    amps = np.interp(levels, most, size)
    at = np.interp(amps, size[1:], gamma[1:])
    upper = prefix.upper()
    return [
        f"#define {upper}_MTPA_TORQUE_MAX {number(float(most[-1]))}",
        _table(
            f"{prefix}_mtpa_i_d_table",
            amps * np.cos(at),
            "i_d, A, of most torque per ampere over the torque from 0 to MTPA_TORQUE_MAX.",
        ),
        _table(
            f"{prefix}_mtpa_i_q_table",
            amps * np.sin(at),
            "i_q, A, likewise; for negative torque it changes its sign.",
        ),
    ]


def _has_alpha(warming: Mapping[str, float] | None) -> bool:
    return warming is not None and warming.get("alpha", 0.0) > 0.0


def _resistance(warming: Mapping[str, float] | None, prefix: str, r_s: float) -> str:
    if warming is None or not _has_alpha(warming):
        return ""
    return "\n".join(
        [
            "/* Stator resistance, ohm, at a winding temperature in degC. */",
            f"static inline float {prefix}_r_s(float temperature)",
            "{",
            f"    return {number(r_s)} * (1.0f + {number(warming['alpha'])} * (temperature - 20.0f));",
            "}",
        ]
    )
