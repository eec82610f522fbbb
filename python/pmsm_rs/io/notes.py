"""What is said of a column that is not taken: why, and the line of [columns] that would take it."""

from __future__ import annotations

from typing import Any, Final

from ..config.rules import Rule
from ..quantities.canonical import CANONICAL
from ..quantities.units import canonical
from ..quantities.vocabulary import COMMANDED, ESTIMATED
from .formats.source import Source
from .naming import Meaning, candidates
from .reading import Unused

SUPPLY_VOLTAGE: Final = "supply voltage"
"""The quantity of a note on a voltage of the supply."""


def look_alike(source: Source, column: str, found: Meaning) -> Unused:
    """A column that looks like a quantity but is not taken for it: some word of its name is not known, or no
    column can be made of it.
    """
    article = "an" if found.quantity == "angle" else "a"
    if found.sure:
        why = (
            f"it is a {found.quantity} of the stator frame (α, β), and d and q or phase values are needed"
            if found.quantity in {"voltage", "current"}
            else f"it is {article} {found.quantity} of which no column is made"
        )
        return Unused(column, found.quantity, why)
    looks = f"it looks like {article} {found.quantity}"
    if found.unit is not None and canonical(found.unit, found.quantity) is None:
        why = f"{looks}, but its unit '{found.unit}' is none of {article} {found.quantity}"
    elif found.columns:
        why = f"{looks}, but not every word of its name is known"
    else:
        why = f"{looks}, but its name does not say which"
    could_be = candidates(found)
    use = line_for(source, column, found, could_be[0])
    return Unused(column, _quantity(found), why, use, could_be if len(could_be) > 1 else ())


def of_supply(source: Source, column: str, found: Meaning) -> Unused:
    """A voltage of the supply."""
    why = "it is the voltage of the supply, which may be that of the DC link"
    return Unused(column, SUPPLY_VOLTAGE, why, line_for(source, column, found, "v_dc"))


def never_taken(source: Source, column: str, found: Meaning) -> Unused:
    """A column whose role keeps it from being taken."""
    if found.quantity == "torque":
        kind = "command" if found.role == COMMANDED else "estimate"
        return Unused(column, "torque", f"it is a torque {kind}, never the measured load torque")
    quantity = _quantity(found)
    kind = {COMMANDED: "a reference", ESTIMATED: "an estimate"}.get(found.role or "", "no plain value")
    why = f"it is {kind} of the {quantity}, not the {quantity} itself"
    return Unused(column, quantity, why, line_for(source, column, found, found.columns[0]))


def _quantity(found: Meaning) -> str:
    """The quantity by which a note is told; the DC link is no voltage of the motor."""
    return "DC-link voltage" if found.columns == ("v_dc",) else found.quantity


def line_for(source: Source, column: str, found: Meaning, name: str) -> str:
    """The line of [columns] that would use a column."""
    quantity = CANONICAL[name]
    known = canonical(found.unit, quantity.dimension) if found.unit else None
    return f'{name} = {{ from = {quoted(source.header(column))}, unit = "{known or quantity.unit}" }}'


def quoted(text: str) -> str:
    """`text` as a basic string of TOML."""
    plain = text.replace("\\", "\\\\").replace('"', '\\"')
    escaped = (f"\\U{ord(c):08x}" if ord(c) > 0xFFFF else f"\\u{ord(c):04x}" for c in plain)
    return '"' + "".join(c if c.isprintable() else e for c, e in zip(plain, escaped, strict=True)) + '"'


def entry(rule: Rule | None) -> str:
    """An entry of [columns] as TOML."""
    if rule is None:
        return "false"
    plain: dict[str, Any] = {"from": rule.source, "unit": rule.unit, "file": rule.file}
    texts = {key: quoted(value) for key, value in plain.items() if value is not None}
    numbers = {"period": rule.period, "value": rule.value}
    changed = {"scale": rule.scale if rule.scale != 1.0 else None, "offset": rule.offset or None}
    entries = texts | {k: repr(float(v)) for k, v in (numbers | changed).items() if v is not None}
    return "{ " + ", ".join(f"{key} = {value}" for key, value in entries.items()) + " }"
