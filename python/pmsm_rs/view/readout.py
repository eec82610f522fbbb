"""What was read of a recording, as people read it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from ..errors import shown
from ..quantities.canonical import CANONICAL
from ..results.rounding import short
from ..results.words import quantity

_NAMED: Final = 12
"""Ignored columns that are named; files of thousands of columns exist."""
_TOGETHER: Final = 4
"""Columns that are named with one reason."""


def origin(name: str, entry: Mapping[str, Any]) -> str:
    """Where one canonical column came from, without its unit."""
    if entry.get("period") is not None:
        return f"every {entry['period']:.6g} s"
    if entry.get("value") is not None:
        return f"the constant {entry['value']:.6g}"
    source = shown(str(entry["from"]))
    if entry.get("file"):
        source += f" of {shown(entry['file'])}"
    if entry["scale"] != 1.0:
        source += f" times {entry['scale']:.6g}"
    if entry.get("offset"):
        source += f" plus {entry['offset']:.6g}"
    return source


def origins(read: Mapping[str, Any]) -> list[str]:
    """A clause for each canonical column: `v_d from Vd_ref (V)`."""
    out = []
    for name, entry in read["columns"].items():
        given = origin(name, entry)
        if entry.get("period") is not None:
            out.append(f"{name} {given}")
            continue
        if entry.get("value") is not None:
            out.append(f"{name} as {given} {entry['unit']}")
            continue
        plain = given == name and entry["unit"] == CANONICAL[name].unit
        source = "" if plain else f" from {given}"
        out.append(f"{name}{source} ({entry['unit']})")
    return out


def converted(nameplate: Sequence[Mapping[str, Any]]) -> list[str]:
    """A clause for each entry of a nameplate that was converted: `psi_m = 0.192 V·s from k_t = 1.629 N·m/A
    rms`, or why it was not taken.
    """
    out = []
    for entry in nameplate:
        given = f"{entry['value']:g} {shown(entry['unit'])}".rstrip()
        gives = [f"{name} = {quantity(of['value'], of['unit'])}" for name, of in entry["gives"].items()]
        named = given if [*entry["gives"]] == [entry["from"]] else f"{entry['from']} = {given}"
        if entry["taken"]:
            out.append(f"{' and '.join(gives)} from {named}")
        else:
            comes = f" ({', '.join(gives)})" if gives else ""
            out.append(f"{named}{comes} not taken: {entry['why']}")
    return out


def extent(read: Mapping[str, Any]) -> str:
    """Rows and sample period."""
    period = read["period"]
    every = f"{short(period)} s" if period >= 1 else f"{short(1e3 * period)} ms"
    return f"{read['rows']} rows, one every {every}"


def ignored(read: Mapping[str, Any]) -> str:
    """Names of the columns that were not used, those of which there is something to say first."""
    told = {entry["column"] for entry in read["not_used"]}
    names = sorted(read["ignored"], key=lambda name: name not in told)
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(shown(name) for name in names[:_NAMED]) + more


def reasons(read: Mapping[str, Any]) -> list[str]:
    """Why columns were not used, one entry for each reason; those that the findings name are left out."""
    grouped: dict[str, list[str]] = {}
    for entry in read["not_used"]:
        if not entry["missed"]:
            grouped.setdefault(entry["why"], []).append(shown(entry["column"]))
    return [f"{_some(names)}: {why}" for why, names in grouped.items()]


def _some(names: list[str]) -> str:
    return ", ".join(names[:_TOGETHER]) + (
        f" and {len(names) - _TOGETHER} more" if len(names) > _TOGETHER else ""
    )
