"""Units at the border: what a file may be in, and how it becomes SI.

A unit is a factor and an offset: SI value = value · factor + offset.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import Final, NamedTuple

from ..errors import did_you_mean


class Unit(NamedTuple):
    """SI value = value · factor + offset."""

    factor: float
    offset: float = 0.0


_TURN: Final = 2.0 * math.pi
_ROOT2: Final = math.sqrt(2.0)

UNITS: Final[dict[str, dict[str, Unit]]] = {
    "time": {
        "s": Unit(1.0),
        "ms": Unit(1e-3),
        "us": Unit(1e-6),
        "ns": Unit(1e-9),
        "min": Unit(60.0),
        "h": Unit(3600.0),
    },
    "voltage": {"V": Unit(1.0), "mV": Unit(1e-3), "kV": Unit(1e3), "Vrms": Unit(_ROOT2)},
    "current": {"A": Unit(1.0), "mA": Unit(1e-3), "kA": Unit(1e3), "Arms": Unit(_ROOT2)},
    "angle": {
        "rad": Unit(1.0),
        "mrad": Unit(1e-3),
        "deg": Unit(math.pi / 180.0),
        "rev": Unit(_TURN),
    },
    "speed": {
        "rad/s": Unit(1.0),
        "deg/s": Unit(math.pi / 180.0),
        "rpm": Unit(_TURN / 60.0),
        "krpm": Unit(_TURN * 1e3 / 60.0),
        "Hz": Unit(_TURN),
    },
    "torque": {
        "N·m": Unit(1.0),
        "mN·m": Unit(1e-3),
        "cN·m": Unit(1e-2),
        "kN·m": Unit(1e3),
        "lbf·ft": Unit(1.3558179483314004),
        "lbf·in": Unit(0.1129848290276167),
        "ozf·in": Unit(0.00706155181422604),
        "kgf·cm": Unit(0.0980665),
        "gf·cm": Unit(9.80665e-5),
    },
    "temperature": {
        "°C": Unit(1.0),
        "K": Unit(1.0, -273.15),
        "°F": Unit(5.0 / 9.0, -160.0 / 9.0),
    },
}
"""Per dimension, the units a column may be given in. Temperatures become °C, everything else SI."""

RMS: Final = frozenset({"Vrms", "Arms"})
"""Units that state an effective value: for rotor-frame components the amplitude is √2 times as large."""

_SPELLINGS: Final = {
    **dict.fromkeys(("sec", "second", "seconds"), "s"),
    "msec": "ms",
    **dict.fromkeys(("usec", "µs", "μs"), "us"),
    **dict.fromkeys(("v", "volt", "volts"), "V"),
    **dict.fromkeys(("vrms", "v_rms"), "Vrms"),
    **dict.fromkeys(("a", "amp", "amps", "ampere", "amperes"), "A"),
    **dict.fromkeys(("arms", "a_rms", "aeff"), "Arms"),
    **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("°", "degree", "degrees"), "deg"),
    **dict.fromkeys(("turn", "turns", "revolution", "revolutions"), "rev"),
    **dict.fromkeys(("r/min", "1/min", "u/min", "rev/min", "min-1", "min^-1", "min⁻¹", "upm"), "rpm"),
    **dict.fromkeys(("rev/s", "turns/s", "turn/s", "rps"), "Hz"),
    **dict.fromkeys(("r/s", "rads", "radps", "rads-1", "rads^-1", "rads⁻¹", "rad/sec", "radian/s"), "rad/s"),
    "°/s": "deg/s",
    **dict.fromkeys(("nm", "newtonmeter"), "N·m"),
    **dict.fromkeys(("mnm", "nmm"), "mN·m"),
    **dict.fromkeys(("cnm", "ncm"), "cN·m"),
    "knm": "kN·m",
    **dict.fromkeys(("lbft", "lbfft", "ftlb"), "lbf·ft"),
    **dict.fromkeys(("lbin", "lbfin", "inlb", "inlbf"), "lbf·in"),
    **dict.fromkeys(("ozin", "ozfin", "inoz", "inozf"), "ozf·in"),
    "kgfcm": "kgf·cm",
    "gfcm": "gf·cm",
    **dict.fromkeys(("c", "degc", "celsius"), "°C"),
    **dict.fromkeys(("f", "degf", "fahrenheit"), "°F"),
    **dict.fromkeys(("k", "kelvin"), "K"),
}


_WRITTEN: Final = frozenset(_SPELLINGS) | {unit.lower() for units in UNITS.values() for unit in units}
"""In small letters, all that a unit of any dimension may be written as."""


_SIGNS_OF_A_PRODUCT: Final = re.compile(
    r"[\s*·.⋅]|(?<=[a-z])-(?=(?:in|ft|m|mm|cm|lbf?|ozf?)$)", re.IGNORECASE
)


def _squeezed(plain: str) -> str:
    """`plain` without the signs of a product, among them the hyphen of `oz-in`."""
    return plain if plain.isalnum() else _SIGNS_OF_A_PRODUCT.sub("", plain)


@lru_cache(maxsize=1024)
def canonical(text: str, dimension: str) -> str | None:
    """The name under which UNITS knows what `text` says for a column of `dimension`, None where it says
    nothing known.
    """
    units = UNITS[dimension]
    plain = text.strip()
    if plain in units:
        return plain
    for candidate in (plain.lower(), _squeezed(plain).lower()):
        name = _SPELLINGS.get(candidate, candidate)
        if name in units:
            return name
        # Case carries meaning only in prefixes (mV, MV), and no mega-unit is known here.
        hits = [unit for unit in units if unit.lower() == name]
        if len(hits) == 1:
            return hits[0]
    return None


@lru_cache(maxsize=4096)
def is_unit(text: str) -> bool:
    """Whether `text` is a unit of any dimension."""
    plain = text.strip()
    # Most names of columns hold none, and there may be many.
    if plain.lower() not in _WRITTEN and _squeezed(plain).lower() not in _WRITTEN:
        return False
    return any(canonical(text, dimension) is not None for dimension in UNITS)


def dimension_of(text: str) -> str | None:
    """The first dimension that has a unit `text`, None where none has."""
    return next((dimension for dimension in UNITS if canonical(text, dimension) is not None), None)


def suggest(text: str, dimension: str) -> str:
    """A clause on which units a column of `dimension` may have, nearest first."""
    return did_you_mean(text, UNITS[dimension])


def to_si(value: float, unit: str, dimension: str) -> float:
    """`value` in `unit` as SI (temperatures as °C). Raises KeyError on a unit that UNITS does not have."""
    factor, offset = UNITS[dimension][unit]
    return value * factor + offset
