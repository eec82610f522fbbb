"""Numbers, units and names as people read them."""

from __future__ import annotations

import math
import re
from functools import cache

from .registry import effects
from .results import Estimate

_UNITS = {
    "ohm": "Ω",
    "V s": "V·s",
    "N m": "N·m",
    "N m s": "N·m·s",
    "kg m^2": "kg·m²",
    "N m s^2": "N·m·s²",
    "degC": "°C",
    "1": "",
}
_PREFIXED = {"H", "Ω", "V·s", "s", "V", "A", "N·m"}
EQUATIONS = {
    "d": "d-axis voltage equation",
    "q": "q-axis voltage equation",
    "mechanical": "equation of motion",
    "sensor": "measurement or its frame",
    "electrical": "voltage equations",
}
CHANNELS = {
    "i_d": ("i_d", "A"),
    "i_q": ("i_q", "A"),
    "omega_e": ("ω_e", "rad/s"),
    "v_d": ("v_d", "V"),
    "v_q": ("v_q", "V"),
}
"""Symbol and unit of the channels that are compared with the model."""
_GREEK = {"psi": "ψ", "tau": "τ", "omega": "ω", "theta": "θ", "phi": "φ", "lambda": "λ"}
_SUBSCRIPT = re.compile(r"(?<![\w])([A-Za-zα-ωΑ-Ωϑ]{1,6})_([A-Za-z0-9]+)")
_PERSONS = ("Coulomb", "Stribeck")


def unit(text: str) -> str:
    """A unit with its proper signs."""
    return _UNITS.get(text, text.replace("^2", "²").replace("^3", "³").replace(" ", "·"))


def channel(name: str) -> tuple[str, str]:
    """Symbol and unit of a channel."""
    return CHANNELS.get(name, (name, ""))


def number(value: float | None, digits: int = 3) -> str:
    """`value` with `digits` significant digits, without an exponent where it can be avoided."""
    if value is None:
        return "–"
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    size = math.floor(math.log10(abs(value)))
    if -5 < size < 6:
        return f"{value:.{max(digits - 1 - size, 0)}f}"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}·10{_raised(int(exponent))}"


def _raised(value: int) -> str:
    return str(value).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def estimate(entry: Estimate) -> tuple[str, str, str]:
    """Value, uncertainty (or an empty text) and unit of an estimate, in a prefix in which the value reads
    well.
    """
    sign = unit(entry.unit)
    if entry.value is None:
        return "–", "", sign
    factor, prefix = _prefix(entry.value, sign)
    value, spread = entry.value * factor, None if entry.stderr is None else entry.stderr * factor
    if not spread or not math.isfinite(spread):
        return number(value, 4), "", prefix + sign
    # Two digits of the uncertainty, and the value to the same place; more would be noise.
    places = max(1 - math.floor(math.log10(spread)), 0)
    if places > 9 or abs(value) >= 1e6:
        return number(value, 6), number(spread, 2), prefix + sign
    return f"{value:.{places}f}", f"{spread:.{places}f}", prefix + sign


def _prefix(value: float, sign: str) -> tuple[float, str]:
    if sign not in _PREFIXED or not 0 < abs(value) < 0.1:
        return 1.0, ""
    return (1e6, "µ") if abs(value) < 1e-4 else (1e3, "m")


def interval(entry: Estimate) -> str:
    """The 95 % interval in the unit of `estimate`, an empty text where there is none."""
    if entry.ci95 is None or entry.value is None:
        return ""
    sign = unit(entry.unit)
    scale, _ = _prefix(entry.value, sign)
    width = abs(entry.ci95[1] - entry.ci95[0]) * scale
    places = min(max(1 - math.floor(math.log10(width)), 0), 9) if width > 0 else 4
    return " … ".join(f"{bound * scale:.{places}f}" for bound in entry.ci95)


def percent(share: float) -> str:
    """A share in percent, never rounded up to certainty."""
    if share > 0.995 and share < 1.0:
        return "> 99 %"
    if 0.0 < share < 0.005:
        return "< 1 %"
    return f"{100 * share:.0f} %"


@cache
def _titles() -> dict[str, str]:
    return {entry["id"]: entry["title"] for entry in effects()}


def title(effect: str) -> str:
    """The title of an effect in the catalogue, or its id in plain words."""
    return _titles().get(effect, effect.replace("_", " "))


def lower_first(text: str) -> str:
    """`text` with a small first letter unless that starts an abbreviation or the name of a person."""
    return text if text[1:2].isupper() or text.startswith(_PERSONS) else text[:1].lower() + text[1:]


def probability(value: float) -> str:
    """A p-value: small ones as a power of ten, since their digits mean nothing."""
    if value <= 0.0:
        return "p < 10⁻³⁰⁰"
    return f"p = {value:.2g}" if value >= 1e-3 else f"p ≈ 10{_raised(round(math.log10(value)))}"


def subscripted(text: str, opening: str, closing: str) -> str:
    """`text` with the part behind the underscore of its symbols (i_d, psi_m, tau_load) between two marks."""
    return _SUBSCRIPT.sub(lambda part: f"{_GREEK.get(part[1], part[1])}{opening}{part[2]}{closing}", text)


def listed(items: list[str], last: str = "and") -> str:
    """'a, b and c'."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {last} {items[-1]}" if items else ""
