"""The account of what was read: which column became what, which were not used, and which questions could be
asked.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .._core import Machine
from ..config.rules import Rule, Rules
from ..errors import shown
from ..quantities.canonical import CANONICAL
from ..results.rounding import short
from ..results.words import listed
from .formats.remark import Remark

_SHOWN: Final = 6
"""Names in a sentence; more make it unreadable."""
_DIGITS: Final = 9
"""Significant digits of the sample period: a clock is not better than 1e-9, rounding of stamps is."""
_COARSE: Final = 0.5
"""Electrical time constants between rows from which the core takes voltages for too coarse."""
_WINDOW: Final = 0.25
"""Length of a window of the motion, s: rows further apart with a measured torque are steady points."""
TORQUE_POINTS: Final = "the rows are steady points of torque, which show parameters alone"
"""Why nothing else is asked of the motion in a map of torque."""
TOO_FAR_APART: Final = "the rows lie too far apart, and show parameters at most"
"""Why nothing else is asked of the voltages of a slow waveform."""
_EVERY_PERIOD: Final = 1.05
"""Control periods between rows below which each row is one period of the drive."""


@dataclass(frozen=True)
class Unused:
    """A column that was not used though its name says something: why, and the line of [columns] that would
    use it where there is one. `quantity` is what it is or looks like, `could_be` the canonical columns that
    it could be where there are several.
    """

    column: str
    quantity: str
    why: str
    use: str | None = None
    could_be: tuple[str, ...] = ()


@dataclass(frozen=True)
class Account:
    """What became of the columns of a file or frame.

    `columns` holds the rule behind each canonical column, units resolved. `ignored` are the names of all the
    others, `unused` those of them of which there is something to say. `missed` are the quantities of which
    nothing was read although a column looks like it. `what` they are columns of: a file, or a recording in
    memory. `remarks` say what was done to the data, and `first` rows were cut before the first one.
    """

    columns: Mapping[str, Rule]
    ignored: tuple[str, ...] = ()
    unused: tuple[Unused, ...] = ()
    missed: frozenset[str] = field(default_factory=frozenset)
    what: str = "recording"
    remarks: tuple[Remark, ...] = ()
    first: int = 0

    @classmethod
    def of_arrays(cls, names: Iterable[str]) -> Account:
        """Of arrays that were given under canonical names, in SI units."""
        return cls({name: Rule(name, CANONICAL[name].unit) for name in names})


def missed(have: set[str], given: Rules, unused: Sequence[Unused]) -> frozenset[str]:
    """Quantities of which nothing was read although a column looks like it, and [columns] names none of them:
    what it names was chosen.
    """
    voltage, current = {"v_d", "v_q", "v_a", "v_b", "v_c"}, {"i_d", "i_q", "i_a", "i_b", "i_c", "tau_e"}
    motion = {"theta_e", "theta_m", "omega_e", "omega_m", "n"}
    full = there(have)
    groups = {"voltage": voltage, "current": current, "angle": motion, "speed": motion}
    like = {entry.quantity for entry in unused}
    return frozenset(q for q in full if not full[q] and not groups[q] & {*given} and q in like)


def there(have: set[str]) -> dict[str, bool]:
    """Of voltage, current (or motor torque), angle and speed, which the canonical columns `have` give."""
    return {
        "voltage": {"v_d", "v_q"} <= have or {"v_a", "v_b", "v_c"} <= have,
        "current": {"i_d", "i_q"} <= have or len({"i_a", "i_b", "i_c"} & have) > 1 or "tau_e" in have,
        "angle": bool({"theta_e", "theta_m"} & have),
        "speed": bool({"omega_e", "omega_m", "n"} & have),
    }


def period_of(stamps: NDArray[np.float64]) -> float:
    """The sample period, s: the median step of the sample times `stamps` (s), shape (samples,)."""
    return float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0


def shortest_constant(kind: str | None, period: float, machine: Machine | None) -> float:
    """The electrical time constant l/r_s (s) that a motor needs for rows this `period` (s) apart to tell of
    its voltage equations; zero where any motor will do.
    """
    rate = None if machine is None else machine.f_sample
    every = rate is not None and period * rate < _EVERY_PERIOD
    return 0.0 if kind != "full" or every else period / _COARSE


def constant_of(machine: Machine | None) -> float | None:
    """The electrical time constant l/r_s (s) of the faster axis, None where the nameplate does not tell."""
    if machine is None or not machine.r_s:
        return None
    each = [inductance for inductance in (machine.l_d, machine.l_q) if inductance is not None]
    return min(each) / machine.r_s if each else None


def too_far_apart(kind: str | None, period: float, machine: Machine | None) -> str | None:
    """Why only parameters can be asked of the voltages of a waveform whose rows lie a `period` (s) apart.

    It is a clause by the nameplate, None where that does not tell or the rows are close enough.
    """
    constant = constant_of(machine)
    if constant is None or constant >= shortest_constant(kind, period, machine):
        return None
    apart, settles = short(period / constant, 3), short(1e3 * constant, 3)
    return f"rows {apart} electrical time constants (l/r_s = {settles} ms) apart show parameters at most"


def told(
    account: Account,
    stamps: NDArray[np.float64],
    kind: str | None,
    load: str | None,
    *,
    steady: bool = True,
    machine: Machine | None = None,
    spacing_told: bool = False,
) -> dict[str, Any]:
    """`read` of an answer: columns, ignored, rows, period (s), questions, `not_used` and `done`.

    `not_used` has the columns of which there is something to say, `done` what was done to the data. `stamps`
    are the sample times (s), shape (samples,); `kind` is that of the recording, None where it answers no
    question. `steady` says whether a run without v_d has steady points, as far as is known, and `machine` is
    the nameplate. `spacing_told` says that a finding tells how far apart the rows lie.
    """
    period = period_of(stamps)
    why = why_not(kind, load, account, steady=steady, period=period, machine=machine)
    if spacing_told and too_far_apart(kind, period, machine) is not None:
        why["voltages"] = TOO_FAR_APART
    return {
        "columns": {name: _origin(rule) for name, rule in account.columns.items()},
        "ignored": list(account.ignored),
        "rows": len(stamps),
        "period": float(f"{period:.{_DIGITS}g}"),
        "questions": _questions(why, q_alone=kind == "mechanical" and steady and has_q_alone(account)),
        "not_used": [
            {
                "column": entry.column,
                "quantity": entry.quantity,
                "why": entry.why,
                "use": entry.use,
                "could_be": list(entry.could_be),
                "missed": _is_missed(entry, kind, account),
            }
            for entry in account.unused
        ],
        "done": [remark._asdict() for remark in account.remarks],
    }


def warnings(read: Mapping[str, Any]) -> list[dict[str, str]]:
    """Findings on what was done to the data, and on the columns that were not used though nothing else gives
    what they look like.
    """
    missed = [entry for entry in read["not_used"] if entry["missed"]]
    out = [
        {
            "finding": f"The column '{shown(entry['column'])}' was not used: {entry['why']}.",
            "consequence": _WITHOUT[entry["quantity"]],
            "fix": _fix(entry),
        }
        for entry in missed[:_SHOWN]
    ]
    if len(missed) > _SHOWN:
        rest = [entry["column"] for entry in missed[_SHOWN:]]
        finding = f"{len(rest)} more columns like these were not used: {names(rest)}."
        out.append({**out[-1], "finding": finding, "fix": "Say in [columns] which of them to use."})
    return [*read["done"], *out]


def _fix(entry: Mapping[str, Any]) -> str:
    if not entry["use"]:
        return "Log phase values, or those of the d and q axes."
    first, *others = entry["could_be"] or [""]
    if not others:
        return f"If it is the right one, add to [columns]: {entry['use']}"
    return f"If it is {first} (or {', '.join(others)} in its place), add to [columns]: {entry['use']}"


_WITHOUT: Final = {
    "voltage": "Without it the voltage equations cannot be asked.",
    "current": "Without it no question about currents can be asked.",
    "angle": "Without it nothing that repeats over the rotor angle is looked for.",
    "speed": "Without it the speed is taken from the angle, if there is one.",
}


def _origin(rule: Rule) -> dict[str, Any]:
    out: dict[str, Any] = {"from": rule.source, "unit": rule.unit, "scale": rule.scale}
    extra = {"offset": rule.offset or None, "period": rule.period, "value": rule.value, "file": rule.file}
    return out | {name: value for name, value in extra.items() if value is not None}


def _is_missed(entry: Unused, kind: str | None, account: Account) -> bool:
    turns = kind in {"operating_points", "open_circuit"}
    return entry.quantity in account.missed and not (turns and entry.quantity == "angle")


_Q_ALONE: Final = "Of the voltages only the q equation was asked, at steady points: v_d was not read."

_NOT_MOVING: Final = {
    "locked": "the rotor is held",
    "electrical": "angle and speed were not logged but taken from the voltages",
    "operating_points": "the rows are operating points, too far apart to show it",
    "open_circuit": "the rotor was turned from outside, with open terminals",
}


def _questions(why: Mapping[str, str], *, q_alone: bool) -> dict[str, Any]:
    """Whether the electrical and the mechanical equations could be asked about, and in `why_not` a sentence
    for each that could not and for the rotor angle, None where all could.
    """
    sentences = [f"Nothing was asked of the {what}: {reason}." for what, reason in why.items()]
    if q_alone:
        sentences.insert(0, _Q_ALONE)
    return {
        "electrical": "voltages" not in why,
        "mechanical": "motion" not in why,
        "why_not": " ".join(sentences) or None,
    }


def has_q_alone(account: Account) -> bool:
    """Whether v_q was read without v_d beside both currents: its means hold the q equation alone."""
    return {"v_q", "i_d", "i_q"} <= {*account.columns} and "v_d" not in account.columns


def why_not(
    kind: str | None,
    load: str | None,
    account: Account,
    *,
    steady: bool = True,
    period: float = 0.0,
    machine: Machine | None = None,
) -> dict[str, str]:
    """Why nothing can be asked of the voltages, the motion or the rotor angle, by these words; those of which
    something can be asked are left out. `kind`, `load`, `steady` and `machine` are those of the recording, as
    in `told`; `period` is its sample period (s).
    """
    apart = too_far_apart(kind, period, machine)
    why = {} if apart is None else {"voltages": apart}
    q_alone = kind == "mechanical" and steady and has_q_alone(account)
    if kind in {"mechanical", None} and not q_alone:
        why["voltages"] = _no_voltages(account)
    has_torque = "tau_m" in account.columns and "tau_e" not in account.columns
    if kind == "mechanical" and period > _WINDOW and has_torque:
        why["motion"] = TORQUE_POINTS
    elif kind not in {"full", "mechanical"} or (q_alone and load == "locked"):
        why["motion"] = _no_motion(kind, load, account)
    elif {"theta_e", "theta_m"}.isdisjoint(account.columns):
        why["rotor angle"] = _none("angle", account, "none")
    return why


def _no_motion(kind: str | None, load: str | None, account: Account) -> str:
    if kind is None:
        lost = _none("current", account, "neither currents nor a torque of the motor")
        return f"the torque that was read is that of the load, and {lost}"
    return _NOT_MOVING["locked" if load == "locked" else kind]


def _no_voltages(account: Account) -> str:
    have = [name for name in ("v_d", "v_q", "v_a", "v_b", "v_c") if name in account.columns]
    if not have:
        return _none("voltage", account, "none")
    if {"v_d", "v_q"} <= {*have} or {"v_a", "v_b", "v_c"} <= {*have}:
        lacks = "the currents" if not _currents(account) else "the rotor angle"
        return f"{lacks} to go with them were not read"
    lost = _none("voltage", account, "no more")
    return f"{listed(have)} alone {'is' if len(have) == 1 else 'are'} no voltage vector, and {lost}"


def _currents(account: Account) -> bool:
    have = set(account.columns)
    return {"i_d", "i_q"} <= have or len({"i_a", "i_b", "i_c"} & have) > 1


def _none(quantity: str, account: Account, none: str) -> str:
    """That there is no such quantity, or none that was recognised among the columns that were not used."""
    if not account.ignored:
        return f"the {account.what} has {none}"
    lost = [entry.column for entry in account.unused if entry.quantity == quantity]
    which = f" (ignored: {names(lost)})" if lost else ""
    was = "were" if quantity in {"voltage", "current"} else "was"
    return f"the {account.what} has {none} that {was} recognised{which}"


def names(columns: Sequence[str]) -> str:
    """Names of columns as a sentence shows them."""
    first = ", ".join(shown(name) for name in columns[:_SHOWN])
    return first + (f" and {len(columns) - _SHOWN} more" if len(columns) > _SHOWN else "")
