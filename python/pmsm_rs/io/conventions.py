"""Scales of another convention, as the values of a diagnosis show them beside the nameplate.

No misfit shows such a scale, as the values make up for it. Currents k times too large make r_s, l_d and
l_q come out 1/k times as large, and j k times. Voltages scale r_s, l_d, l_q, psi_m and j by k. Both together
scale psi_m by k and j by k².
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple

from ..config.rules import Rule
from ..results.words import listed
from .notes import entry

_POWERS: Final[dict[str, dict[str, int]]] = {
    "currents": {"r_s": -1, "l_d": -1, "l_q": -1, "psi_m": 0, "j": 1},
    "voltages": {"r_s": 1, "l_d": 1, "l_q": 1, "psi_m": 1, "j": 1},
    "voltages and currents": {"r_s": 0, "l_d": 0, "l_q": 0, "psi_m": 1, "j": 2},
}
"""Per quantity that was scaled by k the power of k by which each value comes out larger."""
_SCALES: Final = {
    math.sqrt(1.5): ("√(3/2)", "as a power-invariant transformation makes them"),
    math.sqrt(2.0): ("√2", "as where peak values were taken for root mean squares"),
    math.sqrt(3.0): ("√3", "as where values between lines were taken for those of a phase"),
}
"""Scales up and down, and how they come about."""
_AXES: Final = {
    "currents": ("i_a", "i_b", "i_c", "i_d", "i_q"),
    "voltages": ("v_a", "v_b", "v_c", "v_d", "v_q"),
}
_FEWEST: Final = 4
"""Values that have to agree: fewer are off by chance, as a nameplate may be 20 % off."""
_NEAR: Final = 0.04
"""Largest rms of the logarithms by which the values may miss what the scale makes of the nameplate."""
_FAR: Final = 3.0
"""Times as much by which they have to miss the nameplate as it is, and half as much any other scale."""


class _Scale(NamedTuple):
    what: str
    factor: float
    name: str
    reason: str
    miss: float


def scaled(
    base: Mapping[str, float], plate: Mapping[str, float], columns: Mapping[str, Rule], v_dc: float | None
) -> dict[str, str] | None:
    """The finding that voltages or currents are in another convention, with the lines of [columns] that
    convert them. None where no scale explains the values of `base` by those of `plate`.

    `columns` are the rules by which the recording was read, and `v_dc` (V) the link of the nameplate.
    """
    logs = {
        name: math.log(base[name] / plate[name])
        for name in _POWERS["currents"]
        if base.get(name, 0.0) > 0.0 and plate.get(name, 0.0) > 0.0
    }
    if len(logs) < _FEWEST or not {"r_s", "psi_m"} <= {*logs}:
        return None
    choices = sorted(_choices(logs, v_dc), key=lambda scale: scale.miss)
    best, other = choices[0], choices[1]
    as_it_is = _rms([*logs.values()])
    if best.miss > _NEAR or as_it_is < _FAR * best.miss or 2.0 * other.miss < _FAR * best.miss:
        return None
    names = [n for part in best.what.split(" and ") for n in _AXES[part] if n in columns]
    rules = {n: columns[n] for n in names if columns[n].value is None}
    away = [f"{name} {math.exp(value):.3g}" for name, value in logs.items()]
    size = f"{best.name} times as large as they were" if best.factor > 1.0 else f"divided by {best.name}"
    lines = "; ".join(f"{name} = {entry(_by(rule, 1.0 / best.factor))}" for name, rule in rules.items())
    return {
        "finding": f"the values come out as if the {best.what} were logged {size}, {best.reason}: "
        f"{listed(away)} times the nameplate",
        "consequence": "where that is so, what this answer says of torque, friction and load does not hold",
        "fix": f"if the nameplate is right, convert them by these lines of [columns]: {lines}",
    }


def _choices(logs: Mapping[str, float], v_dc: float | None) -> list[_Scale]:
    scales = [(k**sign, *told) for k, told in _SCALES.items() for sign in (1, -1)]
    out = [(what, *scale) for what in _POWERS for scale in scales]
    if v_dc is not None:
        duty = "as a duty cycle is, in place of volts"
        out += [("voltages", factor / v_dc, f"{v_dc / factor:.4g} V", duty) for factor in (1.0, 2.0)]
    return [
        _Scale(
            *choice, _rms([x - _POWERS[choice[0]][name] * math.log(choice[1]) for name, x in logs.items()])
        )
        for choice in out
    ]


def _rms(values: list[float]) -> float:
    return math.sqrt(sum(value * value for value in values) / len(values))


def _by(rule: Rule, factor: float) -> Rule:
    return replace(
        rule, scale=float(f"{rule.scale * factor:.6g}"), offset=float(f"{rule.offset * factor:.6g}")
    )
