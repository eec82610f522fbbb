"""One axis beside the phases, or one phase beside the axes: it is not used, and that is told."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import shown
from ..results.words import listed
from .formats.remark import Remark
from .reading import Account, Unused, period_of
from .rotation import phases, vector

Columns = Mapping[str, NDArray[np.float64]]

_WAVEFORM: Final = 0.05
"""Sample period (s) up to which the rows are a waveform, in which an axis has no equation by itself."""
_FOREIGN: Final = 0.1
"""Share of the power of a column that may not follow from the others before it contradicts them."""
_OTHER_SIZE: Final = 0.15
"""Logarithm of the size from which it contradicts them as well."""


class Lone(NamedTuple):
    """A column that is not used: its name, those that are used, and whether it contradicts them."""

    name: str
    others: tuple[str, ...]
    contradicts: bool


def without_lone(
    columns: Columns, account: Account, n_p: int | None
) -> tuple[dict[str, NDArray[np.float64]], Account]:
    """Columns and account without what one axis or phase adds to others that give both axes."""
    kept = dict(columns)
    for found in lone(columns, n_p):
        del kept[found.name]
        account = _without(account, found)
    return kept, account


def lone(columns: Columns, n_p: int | None) -> list[Lone]:
    """The columns that others make needless; `n_p` is the number of pole pairs, where it is known."""
    angle = _angle(columns, n_p)
    if angle is None:
        return []
    found = []
    for sign, fewest in (("i", 2), ("v", 3)):
        if sign == "v" and period_of(columns["t"]) > _WAVEFORM:
            continue
        axes = tuple(name for name in (f"{sign}_d", f"{sign}_q") if name in columns)
        logged = tuple(name for name in (f"{sign}_{phase}" for phase in "abc") if name in columns)
        if len(axes) == 1 and len(logged) >= fewest:
            whole = _phases(columns, sign)
            seen = vector(*whole) * np.exp(-1j * angle)
            expected = seen.real if axes[0].endswith("d") else seen.imag
            found.append(Lone(axes[0], logged, _contradicts(columns[axes[0]], expected)))
        elif len(axes) == 2 and len(logged) == 1:
            seen = (columns[axes[0]] + 1j * columns[axes[1]]) * np.exp(1j * angle)
            expected = phases(seen)["abc".index(logged[0][-1])]
            found.append(Lone(logged[0], axes, _contradicts(columns[logged[0]], expected)))
    return found


def _angle(columns: Columns, n_p: int | None) -> NDArray[np.float64] | None:
    if "theta_e" in columns:
        return columns["theta_e"]
    return columns["theta_m"] * n_p if "theta_m" in columns and n_p else None


def _phases(columns: Columns, sign: str) -> list[NDArray[np.float64]]:
    """The three phases, of which one that is missing is what the others add up to."""
    logged = [columns.get(f"{sign}_{phase}") for phase in "abc"]
    rest = -sum(values for values in logged if values is not None)
    return [np.asarray(rest if values is None else values) for values in logged]


def _contradicts(logged: NDArray[np.float64], expected: NDArray[np.float64]) -> bool:
    """Whether a column is neither what the others say nor nearly so."""
    known = np.isfinite(logged) & np.isfinite(expected)
    logged, expected = logged[known], expected[known]
    power = float(expected @ expected)
    if power == 0.0 or not np.any(logged):
        return bool(np.any(logged))
    gain = float(expected @ logged) / power
    rest = logged - gain * expected
    foreign = float(rest @ rest) > _FOREIGN * float(logged @ logged)
    return foreign or gain <= 0.0 or abs(math.log(gain)) > _OTHER_SIZE


def _without(account: Account, found: Lone) -> Account:
    """The account without a column, which is told, and as a finding where it contradicts the others."""
    name, others = found.name, listed([*found.others])
    quantity = "current" if name.startswith("i") else "voltage"
    rule = account.columns.get(name)
    column = name if rule is None or rule.source is None else rule.source
    origin = f" from '{shown(column)}'" if column != name else ""
    each = "give both axes"
    remarks = account.remarks
    if found.contradicts:
        remark = Remark(
            f"{name}{origin} is not used beside {others}, which {each}.",
            f"Its values contradict theirs, and the answer rests on {others}.",
            f"Check {name} in [columns], or leave it out by {name} = false.",
        )
        remarks = (*remarks, remark)
    why = f"{others} {each} of the {quantity}, {name} only a part of it"
    return replace(
        account,
        columns={key: value for key, value in account.columns.items() if key != name},
        ignored=(*account.ignored, column),
        unused=(*account.unused, Unused(column, quantity, why)),
        remarks=remarks,
    )
