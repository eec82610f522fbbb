"""The readings of the constants on a nameplate, and the flux linkage that each gives.

Park components keep amplitudes (Krishnan, Permanent Magnet Synchronous and Brushless DC Motor Drives, 2010).
The torque is 3/2 n_p psi_m i_q, where i_q is the peak of the phase current. The peak of the phase voltage at
open terminals is n_p psi_m omega_m. So

    k_t per A peak        = 3/2 n_p psi_m               k_t per A rms         = 3/2 sqrt(2) n_p psi_m
    k_e phase peak        = n_p psi_m                   k_e phase rms         = n_p psi_m / sqrt(2)
    k_e line-to-line peak = sqrt(3) n_p psi_m           k_e line-to-line rms  = sqrt(3/2) n_p psi_m
    1/kv                  = k_e line-to-line peak
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

from ..quantities.compound import compound
from ..results.words import listed, number

_ROOT2, _ROOT3 = math.sqrt(2.0), math.sqrt(3.0)

READINGS: Final[dict[str, dict[str, float]]] = {
    "k_t": {"rms": 1.0 / (1.5 * _ROOT2), "peak": 1.0 / 1.5},
    "k_e": {
        "line-to-line rms": _ROOT2 / _ROOT3,
        "line-to-line peak": 1.0 / _ROOT3,
        "phase rms": _ROOT2,
        "phase peak": 1.0,
    },
    "kv": {"line-to-line peak": 1.0 / _ROOT3, "line-to-line rms": _ROOT2 / _ROOT3},
    "i_rated": {"rms": _ROOT2, "peak": 1.0},
    "i_0": {"rms": _ROOT2, "peak": 1.0},
}
"""Per key of a nameplate its readings, and the factor to n_p psi_m, of a current to its peak."""
USUAL: Final = {"kv": "line-to-line peak"}
"""The reading of what does not say one; others must say it."""
BARE: Final = {
    "k_t": ("N·m/A",),
    "k_e": ("V/krpm", "V s/rad"),
    "kv": ("rpm/V",),
    "i_rated": ("A",),
    "i_0": ("A",),
}
"""Per key the units that a number without one may have."""
FLUX: Final = ("k_e", "kv", "k_t")
"""Keys that give the flux linkage, the one that is measured with the least doubt first."""
AGREE: Final = 1.5**0.25
"""Ratio up to which two values agree: half-way, on a logarithmic scale, to the smallest factor between
conventions of these constants, sqrt(3/2).
"""


class Given(NamedTuple):
    """An entry of a nameplate: `si` is its value in SI units, by `reading`, the key of READINGS."""

    key: str
    value: float
    unit: str
    si: float
    reading: str | None = None

    def __str__(self) -> str:
        """As a sentence shows it."""
        return f"{self.key} = {self.value:g} {self.unit}"


def flux(given: Given, n_p: int, reading: str | None = None) -> float:
    """psi_m, V s, of a constant by `reading`, else by its own; psi_m is itself. Raises KeyError on a wrong
    reading.
    """
    if given.key == "psi_m":
        return given.si
    factor = READINGS[given.key][reading or given.reading or ""]
    return (factor / given.si if given.key == "kv" else factor * given.si) / n_p


def peak(current: Given) -> float:
    """The peak, A, of a current by its reading. Raises KeyError where it has none."""
    return READINGS[current.key][current.reading or ""] * current.si


def matching(key: str, words: frozenset[str]) -> list[str]:
    """The readings of a key that the words beside its unit leave open."""
    if not words and key in USUAL:
        return [USUAL[key]]
    return [reading for reading in READINGS.get(key, ()) if words <= {*reading.split()}]


def ambiguous(
    key: str, value: float, units: Iterable[str], words: frozenset[str], quantity: str, n_p: int | None
) -> str:
    """The clause that refuses an entry which could be read in several ways, with what each gives.

    `units` are those of `quantity`, a key of compound.EXAMPLES, that the number may have; `words` are the
    ones in them.
    """
    readings = matching(key, words)
    choices = []
    for unit in units:
        known = compound(unit, quantity)
        assert known is not None
        for reading in readings:
            given = Given(key, value, unit, value * known.factor, reading)
            missing = [word for word in reading.split() if word not in words]
            choices.append((" ".join([unit, *missing]), _outcome(given, n_p)))
    what = "the current" if key not in FLUX else "psi_m" if n_p else "n_p psi_m"
    clauses = listed([f"{outcome} by {unit}" for unit, outcome in choices], "or")
    line = f'{key} = {{ value = {value:g}, unit = "{choices[0][0]}" }}'
    return (
        f"{value:g} can be read in {len(choices)} ways, and {what} is {clauses}; "
        f"say which in the unit, as in {line}"
    )


def _outcome(given: Given, n_p: int | None) -> str:
    if given.key not in FLUX:
        return f"{number(peak(given), 4)} A peak"
    return f"{number(flux(given, n_p or 1), 4)} V s"


def agree(one: float, other: float) -> bool:
    """Whether two positive values are the same but for rounding and tolerances of a nameplate."""
    return one < AGREE * other and other < AGREE * one


def contradiction(one: Given, other: Given, n_p: int) -> str:
    """The clause that refuses two constants whose flux linkages differ, with the readings that agree."""
    pair = (one, other)
    told = listed(
        [
            str(given) if given.key == "psi_m" else f"{given} gives psi_m = {number(flux(given, n_p), 4)} V s"
            for given in pair
        ]
    )
    ways = [
        f"{given.key} as {reading} ({number(flux(given, n_p, reading), 4)} V s)"
        for given, against in ((one, other), (other, one))
        for reading in READINGS.get(given.key, ())
        if reading != given.reading and agree(flux(given, n_p, reading), flux(against, n_p))
    ]
    way = f"they would agree with {listed(ways, 'or')}" if ways else "no other reading makes them agree"
    return f"{one.key} and {other.key} contradict each other: {told}; {way}"
