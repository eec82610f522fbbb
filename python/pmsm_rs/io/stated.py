"""The unit of a column: what [columns], the file or the name of the column states."""

from __future__ import annotations

from typing import Final

from .._core import DataError
from ..config.rules import Rule
from ..errors import refuse
from ..quantities.canonical import CANONICAL
from ..quantities.units import RMS, canonical, dimension_of, suggest
from ..quantities.wording import unit_and_words
from .formats.source import Source
from .naming import meaning

_ROTOR_FRAME: Final = frozenset({"i_d", "i_q", "v_d", "v_q"})


def unit_of(name: str, rule: Rule, source: Source) -> str:
    """The unit of a rule, checked against the dimension of its canonical column. Raises DataError."""
    quantity = CANONICAL[name]
    text = rule.unit
    if text is None:
        # A scale turns the raw numbers into something of the user's own, so the file's unit no longer speaks.
        plain = rule.scale == 1.0 and rule.offset == 0.0
        text = (_stated(rule.source or "", name, source) if plain else None) or quantity.unit
    unit = canonical(text, quantity.dimension)
    if unit is None:
        other = dimension_of(text)
        what = (
            f"'{text}' is a unit of {other}, not of {quantity.dimension}"
            if other
            else f"the unit '{text}' is not known"
        )
        raise refuse(
            DataError,
            f"{what} ({name} is a {quantity.dimension})",
            file=source.file,
            column=rule.source,
            fix=f"{suggest(text, quantity.dimension)}, or convert with scale in [columns]",
        )
    if unit in RMS and name not in _ROTOR_FRAME:
        raise refuse(
            DataError,
            f"{name} is needed sample by sample, and '{text}' states an effective value",
            file=source.file,
            column=rule.source,
            fix="log the instantaneous value",
        )
    if rule.source in source.clocks and unit != "s":
        raise refuse(
            DataError,
            "it holds times of day, which are read as seconds",
            file=source.file,
            column=rule.source,
            fix=f'leave its unit "{unit}" out of [columns]',
        )
    return unit


def _stated(column: str, name: str, source: Source) -> str | None:
    """The unit that the file states for a column, or that its name ends with."""
    stated = unit_and_words(source.unit(column))[0]
    if stated is not None:
        return stated
    found = meaning(column)
    right = found is not None and CANONICAL[name].dimension == found.quantity
    return found.unit if found is not None and right else None
