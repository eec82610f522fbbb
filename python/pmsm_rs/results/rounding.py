"""Numbers rounded to their uncertainty, and numbers without one to a few digits.

The uncertainty keeps one or two digits by the rule of the Particle Data Group (Review of Particle Physics,
section 5.3), which the package `uncertainties` uses too. The value ends at the same place.
"""

from __future__ import annotations

import math
from decimal import ROUND_HALF_EVEN, Context, Decimal
from typing import Final, NamedTuple

_ENOUGH: Final = Context(prec=400, rounding=ROUND_HALF_EVEN)
_PLAIN: Final = range(-2, 6)
"""Decimal exponents of numbers that are written without a power of ten."""


class Rounded(NamedTuple):
    """`value` and `spread` are to be multiplied by ten to the power `exponent`; both end after `places`
    decimals, which are negative where tens are the last digit.
    """

    value: str
    spread: str
    exponent: int
    places: int


def last_place(spread: float) -> int:
    """Decimals to which a value of standard deviation `spread` (positive) is given, negative for tens."""
    digits, exponent = f"{spread:.2e}".split("e")
    lead = int(digits.replace(".", ""))
    # 100 to 354 keep two digits, 355 to 949 one, and 950 to 999 become 1000 with two.
    return 1 - int(exponent) if lead < 355 else -int(exponent)


def rounded(value: float, spread: float) -> Rounded:
    """`value` rounded to its standard deviation `spread`, both finite and `spread` positive."""
    exponent = size(max(abs(value), spread))
    exponent = 0 if exponent in _PLAIN else exponent
    places = last_place(spread) + exponent
    return Rounded(fixed(value, places, exponent), fixed(spread, places, exponent), exponent, places)


def significant(value: float, digits: int) -> str:
    """`value` with so many significant digits, as sentences and tables write it: "0.0312", "3.12·10⁻⁵", "-0"
    never.
    """
    if value == 0 or not math.isfinite(value):
        return f"{abs(value) if value == 0 else value:g}"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    if int(exponent) in _PLAIN:
        return f"{value:.{max(digits - 1 - int(exponent), 0)}f}"
    return f"{mantissa}·{raised(int(exponent))}"


def short(value: float, digits: int = 4) -> str:
    """`significant` without the zeros at the end of its decimals: "20", "1.55"."""
    text = significant(value, digits)
    return text.rstrip("0").rstrip(".") if "." in text and "·" not in text else text


def size(value: float) -> int:
    """The decimal exponent of a number other than zero."""
    return int(f"{value:e}".split("e")[1])


def fixed(value: float, places: int, exponent: int = 0) -> str:
    """`value` divided by ten to the power `exponent` with `places` decimals, and never "-0"."""
    scaled = Decimal(repr(float(value))).scaleb(-exponent, _ENOUGH)
    text = f"{scaled.quantize(Decimal(1).scaleb(-places), context=_ENOUGH):f}"
    return text.removeprefix("-") if not text.strip("-0.") else text


def raised(exponent: int) -> str:
    """ "10⁻³", empty for 0."""
    digits = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{digits}" if exponent else ""


def is_finite(*values: float | None) -> bool:
    """Whether all are finite numbers."""
    return all(value is not None and math.isfinite(value) for value in values)
