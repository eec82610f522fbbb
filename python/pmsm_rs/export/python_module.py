"""The model as a Python module that needs numpy alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from .common import commented, header
from .program import Language, code

if TYPE_CHECKING:
    from ..model import Model

# Python raises where arithmetic of computers gives infinity or no number.
_HELPERS = """
def _div(a, b):
    try:
        return a / b
    except ZeroDivisionError:
        return nan if a == 0.0 or a != a else copysign(inf, a) * copysign(1.0, b)


def _exp(x):
    try:
        return exp(x)
    except OverflowError:
        return inf


def _ln(x):
    return log(x) if x > 0.0 else (-inf if x == 0.0 else nan)


def _sqrt(x):
    return sqrt(x) if x >= 0.0 else nan
"""

PYTHON = Language(
    functions={
        "sqrt": "_sqrt",
        "sin": "sin",
        "cos": "cos",
        "exp": "_exp",
        "ln": "_ln",
        "tanh": "tanh",
        "abs": "abs",
    },
    select="({yes} if {test} > 0.0 else {no})",
    define="    {name} = {value}",
    replaced={"div": "_div({a}, {b})"},
)

_RESPOND = '''
def respond(t, v_d, v_q, tau_load=0.0, *, i_d=0.0, i_q=0.0, omega_m=0.0, theta_m=0.0, steps=STEPS):
    """The open-loop response to voltages d, q (V, rotor frame) and a load torque (N m), which hold from each
    instant of t (s) to the next: a dict of arrays t, i_d, i_q, tau_e, omega_m, theta_m. The motor begins at
    the given currents (A), speed (rad/s) and angle (rad).
    """
    t = np.asarray(t, dtype=float)
    v_d, v_q, tau_load = (np.broadcast_to(np.asarray(x, dtype=float), t.shape) for x in (v_d, v_q, tau_load))
    times, d, q, load = t.tolist(), v_d.tolist(), v_q.tolist(), tau_load.tolist()
    x = start(i_d, i_q, omega_m, theta_m, load[0], times[0])
    names = ("i_d", "i_q", "tau_e", "omega_m", "theta_m")
    out = {name: np.empty(len(times)) for name in names}
    for k, now in enumerate(times):
        y = output(now, x)
        out["i_d"][k], out["i_q"][k], out["tau_e"][k] = y["i_d"], y["i_q"], y["tau_e"]
        out["omega_m"][k], out["theta_m"][k] = x[2], x[3]
        if k + 1 == len(times):
            break
        h = times[k + 1] - now
        one, two = max(k - 1, 0), max(k - 2, 0)
        v = command(d[k], q[k], d[one], q[one], d[two], q[two], x[2] * N_P * h)
        x = advance(now, x, h, v[0], v[1], load[k], steps)
    return {"t": t, **out}


def advance(t, x, h, v_d, v_q, tau_load, steps=STEPS):
    """The state after h seconds of constant voltage and load, by that many Runge-Kutta steps."""
    s = h / steps
    for piece in range(steps):
        at = t + piece * s
        a = derivative(at, x, v_d, v_q, tau_load)
        b = derivative(at + 0.5 * s, [p + 0.5 * s * k for p, k in zip(x, a)], v_d, v_q, tau_load)
        c = derivative(at + 0.5 * s, [p + 0.5 * s * k for p, k in zip(x, b)], v_d, v_q, tau_load)
        e = derivative(at + s, [p + s * k for p, k in zip(x, c)], v_d, v_q, tau_load)
        x = [p + s / 6.0 * (k + 2.0 * l + 2.0 * m + n) for p, k, l, m, n in zip(x, a, b, c, e)]
    return x
'''


def text(model: Model, *, temperature: float = 20.0) -> str:
    """The source of the module, at a temperature of winding and magnets in degC."""
    equations = model.equations(temperature=temperature, temperature_magnet=temperature)
    states = equations["states"]
    unpacked = {name: f"x[{k}]" for k, name in enumerate(states)}
    body = "\n".join(
        [
            _function(
                equations["start"],
                "start(i_d=0.0, i_q=0.0, omega_m=0.0, theta_m=0.0, tau_load=0.0, t=0.0)",
                "The steady state with these currents (A), this speed (rad/s) and angle (rad).",
                {},
                "list",
            ),
            _function(
                equations["derivative"],
                "derivative(t, x, v_d, v_q, tau_load)",
                "Time derivative of the state x under voltages d, q (V) and a load torque (N m).",
                unpacked,
                "list",
            ),
            _function(
                equations["output"],
                "output(t, x)",
                "Currents (A), torque (N m), electrical speed and angle, and what the sensors show.",
                unpacked,
                "dict",
            ),
            _function(
                equations["command"],
                "command(v_d, v_q, v_d_1, v_q_1, v_d_2, v_q_2, turn)",
                "The voltage that acts, from the commands of this interval and the two before.",
                {},
                "list",
            ),
            _function(
                equations["torque"],
                "torque_lost(omega_m, theta_m, tau_e=0.0, t=0.0)",
                "Torque (N m) of each effect against positive rotation, beyond b*omega_m.",
                {},
                "dict",
            ),
        ]
    )
    return (
        '"""' + "\n".join(header(model)).replace("\\", "\\\\") + '\n"""\n\n'
        "from math import copysign, cos, exp, inf, log, nan, sin, sqrt, tanh\n\nimport numpy as np\n\n"
        f"# Pole pairs, and the names of the states.\nN_P = {int(equations['n_p'])}\n"
        f"STATES = {tuple(states)!r}\n"
        f"{commented([_STEPS_SAID], '#')}\nSTEPS = {equations['steps']}\n"
        f"\n{_HELPERS}\n{body}\n{_RESPOND}"
    )


_STEPS_SAID = "Runge-Kutta steps in each sample period of the recording that the model was found on."


def _function(
    program: Mapping[str, Any], signature: str, said: str, names: Mapping[str, str], gives: str
) -> str:
    inputs = {name: names.get(name, name) for name in program["inputs"]}
    written = code(program, PYTHON, inputs, prefix="y")
    items = [
        f"        {repr(name) + ': ' if gives == 'dict' else ''}{term},"
        for name, term in written.outputs.items()
    ]
    opening, closing = ("{", "}") if gives == "dict" else ("[", "]")
    lines = [f"\ndef {signature}:", f'    """{said}"""', *written.lines]
    lines += [f"    return {opening}", *items, f"    {closing}", ""]
    return "\n".join(lines)
