"""The formulas for a torque without a name, as people read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..results.estimates import Estimate
from ..results.words import estimate, listed


def numbers(entry: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Name and value of each number of a formula, the value with its standard error where it has one."""
    return [(name, str(estimate(Estimate.of(number)))) for name, number in entry["parameters"].items()]


def order(entries: Sequence[Mapping[str, Any]]) -> str:
    """Why the formulas stand in this order, which is not that of their errors; empty for a single one."""
    if len(entries) < 2:
        return ""
    alike = 1 + sum(entry["equivalent"] for entry in entries)
    parts = ["They stand in the order of their evidence, which counts their numbers as well as their error."]
    which = "all" if alike == len(entries) else f"the first {alike}"
    if alike > 1:
        parts.append(f"The evidence does not tell {which} apart, and the simplest of them stands first.")
    if alike < len(entries):
        others = "The others have" if len(entries) - alike > 1 else "The last has"
        parts.append(f"{others} less evidence, but may predict as well.")
    return " ".join(parts)


def of_form(entry: Mapping[str, Any]) -> str:
    """That a formula has the form of effects of the catalogue; empty where it has not."""
    effects = list(dict.fromkeys(name for name in entry["has_form_of"] if name))
    if not effects:
        return ""
    whole = all(entry["has_form_of"])
    return f"{'has' if whole else 'one part has'} the form of {listed(effects)}"
