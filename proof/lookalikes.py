"""Which frictions a recording cannot tell from the one that was put in.

Friction laws are nested in one another, and over the speeds of one recording a simpler one may do. The plain
machine is fitted with the true law's torques added, and with a rival's; what counts is what they leave.
"""

from __future__ import annotations

import numpy as np

from .effects import Effects, effect_values
from .manoeuvres import Manoeuvre
from .parameters import Machine
from .plant import Run
from .reference import fit_plain, park, torque_of

# a rival that leaves no more than this times what the true law leaves is a look-alike
CLOSE = 1.02


def shapes(name: str, values: dict[str, float], w: np.ndarray, torque: np.ndarray) -> tuple[np.ndarray, ...]:
    """Torques (n,) whose sum with free sizes is the friction `name`; () for an effect that is none.

    w (n,) mechanical rad/s, torque (n,) of the motor in N·m.
    """
    sign = np.tanh(w / values.get("w_smooth", 0.05))
    if name == "coulomb_friction":
        return (sign,)
    if name == "stribeck_friction":
        return sign, sign * np.exp(-((w / values["w_s"]) ** 2))
    if name == "asymmetric_friction":
        return sign * (w > 0.0), sign * (w <= 0.0), w * (w > 0.0)
    if name == "load_dependent_friction":
        return (np.abs(torque) * sign,)
    if name == "quadratic_drag":
        return (w * np.abs(w),)
    return ()


def lookalikes(
    machine: Machine, effects: Effects, manoeuvre: Manoeuvre, run: Run, base: dict[str, float]
) -> list[str]:
    """Frictions with one size that this run cannot tell from the only effect, itself a friction.

    base: true base parameters, where the fits start.
    """
    if len(effects) != 1 or manoeuvre.locked:
        return []
    (name, values), *_ = effect_values(effects).items()
    w = run.log["omega_e"] / machine.n_p
    i_d, i_q = park(run.log["i_a"], run.log["i_b"], run.log["i_c"], run.log["theta_e"])
    torque = torque_of(base, i_d, i_q)

    def left(added: tuple[np.ndarray, ...]) -> float:
        fit = fit_plain(base, run.log, 1.0 / machine.f_sample, **manoeuvre.known_load, shapes=added)
        return fit.rms()["omega_e"]

    true = shapes(name, values, w, torque)
    if not true:
        return []
    own = left(true)
    rivals = ("coulomb_friction", "load_dependent_friction", "quadratic_drag")
    return [r for r in rivals if r != name and left(shapes(r, {}, w, torque)) <= CLOSE * own]
