"""The equations of a model as C functions in double precision."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .program import LIBM, Language, code


def number(x: float) -> str:
    """A number as C writes it."""
    if math.isnan(x):
        return "NAN"
    if math.isinf(x):
        return "INFINITY" if x > 0.0 else "-INFINITY"
    return repr(x)


C = Language(
    functions=LIBM,
    select="({test} > 0.0 ? {yes} : {no})",
    define="    const double {name} = {value};",
    number=number,
)


def function(
    program: Mapping[str, Any],
    name: str,
    arguments: str,
    names: Mapping[str, str],
    result: str,
    language: Language = C,
) -> str:
    """A C function without a value that writes the outputs of a program to the array `result`."""
    inputs = {x: names.get(x, x) for x in program["inputs"]}
    written = code(program, language, inputs, prefix="y")
    used = "\n".join([*written.lines, *written.outputs.values()])
    unused = [f"    (void){x};" for x in _arguments(arguments) if not _mentions(used, x) and x != result]
    lines = [f"static void {name}({arguments})", "{", *unused, *written.lines]
    lines += [f"    {result}[{k}] = {term};" for k, term in enumerate(written.outputs.values())]
    return "\n".join([*lines, "}", ""])


def _arguments(text: str) -> list[str]:
    return [part.split()[-1].lstrip("*") for part in text.split(",")]


def _mentions(text: str, name: str) -> bool:
    import re

    return re.search(rf"\b{re.escape(name)}\b", text) is not None


def equations(all_of: Mapping[str, Any]) -> str:
    """The functions motor_start, motor_derivative, motor_output and motor_command of a model."""
    states = {name: f"x[{k}]" for k, name in enumerate(all_of["states"])}
    return "\n".join(
        [
            function(
                all_of["start"],
                "motor_start",
                "double i_d, double i_q, double omega_m, double theta_m, double tau_load, double t, "
                "double *x",
                {},
                "x",
            ),
            function(
                all_of["derivative"],
                "motor_derivative",
                "double t, const double *x, double v_d, double v_q, double tau_load, double *dx",
                states,
                "dx",
            ),
            function(all_of["output"], "motor_output", "double t, const double *x, double *y", states, "y"),
            function(
                all_of["command"],
                "motor_command",
                "double v_d, double v_q, double v_d_1, double v_q_1, double v_d_2, double v_q_2, "
                "double turn, double *v",
                {},
                "v",
            ),
        ]
    )


ADVANCE = """
static void motor_advance(double t, double *x, double h, double v_d, double v_q, double tau_load, int steps)
{
    const double s = h / steps;
    double a[STATES], b[STATES], c[STATES], e[STATES], p[STATES];
    int piece, k;
    for (piece = 0; piece < steps; piece++) {
        const double at = t + piece * s;
        motor_derivative(at, x, v_d, v_q, tau_load, a);
        for (k = 0; k < STATES; k++) p[k] = x[k] + 0.5 * s * a[k];
        motor_derivative(at + 0.5 * s, p, v_d, v_q, tau_load, b);
        for (k = 0; k < STATES; k++) p[k] = x[k] + 0.5 * s * b[k];
        motor_derivative(at + 0.5 * s, p, v_d, v_q, tau_load, c);
        for (k = 0; k < STATES; k++) p[k] = x[k] + s * c[k];
        motor_derivative(at + s, p, v_d, v_q, tau_load, e);
        for (k = 0; k < STATES; k++) x[k] += s / 6.0 * (a[k] + 2.0 * b[k] + 2.0 * c[k] + e[k]);
    }
}
"""
