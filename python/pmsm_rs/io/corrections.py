"""The lines of [columns] that undo a mistake which the log was made with, where there are such lines."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Final

from ..config.rules import Rule
from ..quantities.canonical import CANONICAL
from ..quantities.units import UNITS
from .notes import entry

Columns = Mapping[str, Rule]

_FOUND: Final = "the log reads as if "
_LOAD: Final = re.compile(r"a load that is ([0-9.eE+-]+) N·m (more|less) than the log")
_SAME: Final = 0.05
"""Share by which two torques that are the same may differ."""
_CURRENTS: Final = ("i_a", "i_b", "i_c", "i_d", "i_q")
_VOLTAGES: Final = ("v_a", "v_b", "v_c", "v_d", "v_q")
_SPEEDS: Final = ("omega_e", "omega_m", "n")
_TURNS: Final = ("theta_e", "theta_m", *_SPEEDS)
_ALL: Final = {
    "all currents": _CURRENTS,
    "all voltages": _VOLTAGES,
    "the speed": _SPEEDS,
    "the angle and the speed": _TURNS,
}
_SCALED: Final = {
    "the currents": _CURRENTS,
    "the voltages": _VOLTAGES,
    "currents and voltages": (*_CURRENTS, *_VOLTAGES),
}
_PAIRS: Final = (("i_d", "i_q"), ("v_d", "v_q"))


def corrected(finding: Mapping[str, str], columns: Columns) -> dict[str, str]:
    """A finding of `data_quality` with the lines of [columns] in its `fix`; as it is where it tells of no
    mistake that lines undo. `columns` are the rules by which the recording was read.
    """
    text = finding["finding"]
    if not text.startswith(_FOUND):
        return dict(finding)
    words = text.removeprefix(_FOUND).partition(": with that undone")[0]
    for mistake in words.split(", or "):
        if rules := undoing(mistake, columns):
            lines = "; ".join(f"{name} = {entry(rule)}" for name, rule in rules.items())
            return {
                **finding,
                "fix": f"{finding['fix']}; these lines of [columns] undo it in the log: {lines}",
            }
    return dict(finding)


def of_load(finding: Mapping[str, str], load: float, columns: Columns) -> dict[str, str]:
    """A finding that a constant load would do what friction that differs by direction does.

    Where twice the mean logged `load` (N·m) is that much, it gets the line that turns the sign of `tau_m`.
    """
    told = _LOAD.match(finding["finding"])
    if told is None or "tau_m" not in columns:
        return dict(finding)
    more = float(told[1]) * (1.0 if told[2] == "more" else -1.0)
    if abs(more + 2.0 * load) > _SAME * abs(more):
        return dict(finding)
    line = f"tau_m = {entry(_negated(columns['tau_m']))}"
    return {
        **finding,
        "finding": f"{finding['finding']}; that is twice the logged tau_m, as if it had the opposite sign",
        "fix": f"{finding['fix']}; tau_m opposes positive speed: if it was logged the other way round, write "
        f"{line} in [columns]",
    }


def undoing(mistake: str, columns: Columns) -> dict[str, Rule]:
    """The rules that undo a mistake in the words of a diagnosis, by canonical column; none where no line of
    [columns] can, as of a shift by a row.
    """
    if found := re.fullmatch(r"(.+) had the opposite sign", mistake):
        names = _ALL.get(found[1]) or found[1].split(" and ")
        return _signs(names, columns)
    if found := re.fullmatch(r"(.+) and (.+) were interchanged", mistake):
        one, other = found[1].removeprefix("the phases "), found[2]
        pairs = [(one, other)] if one in CANONICAL else [(f"{x}_{one}", f"{x}_{other}") for x in "iv"]
        return _moved({a: b for pair in pairs for a, b in (pair, pair[::-1])}, columns)
    if found := re.fullmatch(r"the (current|voltage)s of the phases (.), (.), (.) were in .*", mistake):
        letter = found[1][0].replace("c", "i")
        return _moved({f"{letter}_{found[k]}": f"{letter}_{'abc'[k - 2]}" for k in (2, 3, 4)}, columns)
    if found := re.fullmatch(r"(.+) were (√?)([0-9.]+) times too (large|small)", mistake):
        factor = math.sqrt(float(found[3])) if found[2] else float(found[3])
        scale = float(f"{1.0 / factor if found[4] == 'large' else factor:.10g}")
        return {name: _scaled(columns[name], scale) for name in _SCALED[found[1]] if name in columns}
    if mistake == "the speed was in rpm and not in rad/s":
        return {name: _in_rpm(name, columns[name]) for name in _SPEEDS if name in columns}
    if found := re.fullmatch(r"omega_e was the mechanical speed and not (\d+) times that", mistake):
        return {name: _scaled(columns[name], float(found[1])) for name in _SPEEDS[:1] if name in columns}
    if found := re.fullmatch(r"omega_m was the electrical speed, (\d+) times the mechanical one", mistake):
        return {
            name: _scaled(columns[name], 1.0 / float(found[1])) for name in _SPEEDS[1:] if name in columns
        }
    if found := re.fullmatch(r"theta_e was (\d+)° too (large|small)", mistake):
        return _shifted(
            "theta_e", math.radians(float(found[1])) * (-1 if found[2] == "large" else 1), columns
        )
    if found := re.fullmatch(
        r"d and q were those of an axis (90|180)° (ahead of|behind) the magnet", mistake
    ):
        if found[1] == "180":
            return _signs([name for pair in _PAIRS for name in pair], columns)
        moved = _moved({a: b for pair in _PAIRS for a, b in (pair, pair[::-1])}, columns)
        turned = [pair[0 if found[2] == "ahead of" else 1] for pair in _PAIRS]
        return {name: _negated(rule) if name in turned else rule for name, rule in moved.items()}
    return {}


def _signs(names: Iterable[str], columns: Columns) -> dict[str, Rule]:
    return {name: _negated(columns[name]) for name in names if name in columns}


def _moved(sources: Mapping[str, str], columns: Columns) -> dict[str, Rule]:
    """The columns that are to be taken from where others were; none unless all of a pair are there."""
    present = {name: other for name, other in sources.items() if name in columns or other in columns}
    if not all(name in columns and other in columns for name, other in present.items()):
        return {}
    return {name: columns[other] for name, other in present.items()}


def _negated(rule: Rule) -> Rule:
    return _scaled(rule, -1.0)


def _scaled(rule: Rule, factor: float) -> Rule:
    if rule.value is not None:
        return replace(rule, value=factor * rule.value)
    return replace(rule, scale=factor * rule.scale, offset=factor * rule.offset or 0.0)


def _in_rpm(name: str, rule: Rule) -> Rule:
    """A speed whose values were 60/(2π) times as large as its unit says."""
    if (rule.unit or CANONICAL[name].unit) == "rad/s":
        return replace(rule, unit="rpm")
    return _scaled(rule, float(f"{math.tau / 60.0:.10g}"))


def _shifted(name: str, by: float, columns: Columns) -> dict[str, Rule]:
    """A column moved by an angle (rad)."""
    if name not in columns:
        return {}
    rule = columns[name]
    factor = UNITS[CANONICAL[name].dimension][rule.unit or CANONICAL[name].unit].factor
    return {name: replace(rule, offset=float(f"{rule.offset + by / factor:.10g}"))}
