"""Numbers, units and names as people read them."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import NamedTuple

from .estimates import Estimate
from .registry import effects
from .rounding import fixed, is_finite, raised, rounded, short, significant

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
_SPELLED = re.compile(r"(?<=[\d⁰¹²³⁴-⁹] )([mµ]?)(N m s\^2|N m s|N m|V s|kg m\^2|[Oo]hm)\b(?!\^)")
"""Units as the core spells them in sentences, behind a number."""
VAGUE = "the standard error is many times the value"
"""Why a positive parameter is not determined."""
_POSITIVE = frozenset({"r_s", "l_d", "l_q", "psi_m", "j"})
"""Parameters that no motor has near zero."""
_VAGUE = 10.0
"""Standard errors over values from which a positive parameter is not determined."""
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
_SUBSCRIPT = re.compile(r"(?<!\w)([A-Za-zα-ωΑ-Ωϑ]{1,6})_([A-Za-z0-9]+)(?:_(\d+))?(?!_?\w)")
"""A symbol with its subscript, and a number behind it as in tau_cog_2; longer names stay as they are."""
_PERSONS = ("Coulomb", "Stribeck")


def unit(text: str) -> str:
    """A unit with its proper signs."""
    return _UNITS.get(text, text.replace("^2", "²").replace("^3", "³").replace(" ", "·"))


def with_signs(text: str) -> str:
    """A sentence whose units behind numbers have their proper signs, as in "0.6 Ω" and "3 N·m/A"."""
    return _SPELLED.sub(
        lambda found: found[1] + unit(found[2].lower() if found[2] == "Ohm" else found[2]), text
    )


def is_vague(name: str, entry: Estimate) -> bool:
    """Whether the standard error is so many times the value that a positive parameter is not determined."""
    known = name in _POSITIVE and entry.value is not None
    return known and (entry.stderr or 0.0) > _VAGUE * abs(entry.value or 0.0)


def channel(name: str) -> tuple[str, str]:
    """Symbol and unit of a channel."""
    return CHANNELS.get(name, (name, ""))


def number(value: float | None, digits: int = 3) -> str:
    """`value` with `digits` significant digits, without an exponent where it can be avoided."""
    return "–" if value is None else significant(value, digits)


def quantity(value: float, spelled: str, digits: int = 4) -> str:
    """A value with its unit, in a prefix or with a power of ten in which it reads well: "2.756 mV·s"."""
    factor, sign = _prefix(Estimate(value, None, None, spelled, None), unit(spelled))
    return f"{short(value * factor, digits)} {sign}{unit(spelled)}".rstrip()


class Written(NamedTuple):
    """An estimate as people read it: `value` ± `spread` times `power` in `unit`.

    `spread` is empty where there is no uncertainty, `power` where there is no power of ten.
    """

    value: str
    spread: str
    power: str
    unit: str

    def __str__(self) -> str:
        """Such as "7.3994 ± 0.0021 mH" or "(2.0998 ± 0.0001)·10⁻³ N·m·s"."""
        if self.value == "–":
            return self.value
        both = f"{self.value} ± {self.spread}" if self.spread else self.value
        if self.power:
            both = f"({both})·{self.power}" if self.spread else f"{both}·{self.power}"
        return f"{both} {self.unit}".rstrip()


def estimate(entry: Estimate) -> Written:
    """An estimate rounded to its uncertainty, in a prefix or with a power of ten in which it reads well."""
    sign = unit(entry.unit)
    if entry.value is None:
        return Written("–", "", "", sign)
    factor, prefix = _prefix(entry, sign)
    value, spread = entry.value * factor, (entry.stderr or 0.0) * factor
    if not is_finite(value, spread) or spread <= 0.0:
        whole = float(value).is_integer() and abs(value) < 1e6 and not prefix
        return Written(fixed(value, 0) if whole else number(value, 4), "", "", prefix + sign)
    found = rounded(value, spread)
    return Written(found.value, found.spread, raised(found.exponent), prefix + sign)


def estimate_like(entry: Estimate, value: float) -> str:
    """`value`, in the unit of `entry`, with the prefix and power of ten in which `estimate` writes that."""
    factor, _ = _prefix(entry, unit(entry.unit))
    scaled, own = value * factor, (entry.value or 0.0) * factor
    spread = (entry.stderr or 0.0) * factor
    exponent = rounded(own, spread).exponent if is_finite(own, spread) and spread > 0.0 else 0
    return number(scaled / 10.0**exponent, 4)


def _prefix(entry: Estimate, sign: str) -> tuple[float, str]:
    largest = max(abs(entry.value or 0.0), entry.stderr or 0.0)
    if sign not in _PREFIXED or not 0 < largest < 0.1:
        return 1.0, ""
    return (1e6, "µ") if largest < 1e-4 else (1e3, "m")


def interval(entry: Estimate) -> str:
    """The 95 % interval in the prefix and power of ten of `estimate`, an empty text where there is none."""
    if entry.ci95 is None or entry.value is None or not is_finite(entry.value, *entry.ci95):
        return ""
    factor, _ = _prefix(entry, unit(entry.unit))
    low, high = (bound * factor for bound in entry.ci95)
    # Without a standard error that of a normal distribution, whose interval is 3.92 times as wide.
    spread = (entry.stderr or 0.0) * factor or abs(high - low) / 3.92
    if spread <= 0.0 or not is_finite(spread):
        return f"{number(low, 4)} … {number(high, 4)}"
    found = rounded(entry.value * factor, spread)
    return " … ".join(fixed(bound, found.places, found.exponent) for bound in (low, high))


def percent(share: float) -> str:
    """A share in percent, never rounded up to certainty and never "-0 %"."""
    if share > 0.995 and share < 1.0:
        return "> 99 %"
    if 0.0 < share < 0.005:
        return "< 1 %"
    return f"{fixed(100 * share, 0)} %" if math.isfinite(share) else "–"


@cache
def _titles() -> dict[str, str]:
    return {entry["id"]: entry["title"] for entry in effects()}


def title(effect: str) -> str:
    """The title of an effect in the catalogue, or its id in plain words."""
    return _titles().get(effect, effect.replace("_", " "))


@cache
def _sites() -> dict[str, str]:
    return {entry["id"]: entry["acts_in"] for entry in effects()}


def acts_in(effect: str) -> str:
    """What an effect of the catalogue acts in, such as "mechanical"; empty for one of the user's own."""
    return _sites().get(effect, "")


def titled(text: str) -> str:
    """`text` with the titles of effects in the place of their ids, as in sentences of the core."""
    return _ids().sub(lambda found: lower_first(title(found[0])), text)


@cache
def _ids() -> re.Pattern[str]:
    names = sorted(_titles(), key=len, reverse=True)
    return re.compile(rf"(?<![\w.])(?:{'|'.join(map(re.escape, names))})(?![\w.])")


def sentence(text: str) -> str:
    """`text` with a capital first letter, unless that is of a symbol such as i_d, and a full stop."""
    if not text:
        return text
    begun = text if re.match(r"[A-Za-z]{1,6}_", text) else text[0].upper() + text[1:]
    return begun if begun.endswith((".", "!", "?")) else f"{begun}."


def lower_first(text: str) -> str:
    """`text` with a small first letter unless that starts an abbreviation or the name of a person."""
    return text if text[1:2].isupper() or text.startswith(_PERSONS) else text[:1].lower() + text[1:]


def probability(value: float) -> str:
    """A p-value: small ones as a power of ten, since their digits mean nothing."""
    if value <= 0.0:
        return "p < 10⁻³⁰⁰"
    return f"p = {value:.2g}" if value >= 1e-3 else f"p ≈ {raised(round(math.log10(value)))}"


def subscripted(text: str, opening: str, closing: str) -> str:
    """`text` with the part behind the underscore of its symbols (i_d, psi_m, tau_load) between two marks."""

    def symbol(part: re.Match[str]) -> str:
        below = f"{part[2]},{part[3]}" if part[3] else part[2]
        return f"{_GREEK.get(part[1], part[1])}{opening}{below}{closing}"

    return _SUBSCRIPT.sub(symbol, text)


def listed(items: list[str], last: str = "and") -> str:
    """'a, b and c'."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {last} {items[-1]}" if items else ""
