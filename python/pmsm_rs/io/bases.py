"""Columns of several time bases brought to one: groups of a file that were sampled at other rates or times.

The lead is the fastest base that holds a voltage, a current or the motor torque. What is sampled as fast is
lined up with it. A slow speed or angle is left out where the lead has the other one. A slow load torque, DC
link or temperature is interpolated. What is too slow for either is refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .._core import DataError
from ..config.rules import Rule
from ..errors import refuse, shown
from ..quantities.units import to_si
from ..results.words import listed
from .formats.remark import Remark
from .formats.source import Source
from .stated import unit_of

Columns = dict[str, NDArray[np.float64]]

_ELECTRICAL: Final = frozenset({"v_d", "v_q", "v_a", "v_b", "v_c", "i_d", "i_q", "i_a", "i_b", "i_c"})
_PHASES: Final = frozenset({"v_a", "v_b", "v_c", "i_a", "i_b", "i_c"})
_SPEEDS: Final = frozenset({"omega_e", "omega_m", "n"})
_ANGLES: Final = frozenset({"theta_e", "theta_m"})
_SLOW: Final = 1.5
"""Times the period of the lead from which a base is slow."""
_ON_TIME: Final = 1e-3
"""Share of the period within which stamps are the same."""


@dataclass(frozen=True)
class Bases:
    """The time bases of a plan: sample times (s) by base, the base of each canonical column, and the lead.

    What was left out is listed by canonical name with the reason.
    """

    stamps: Mapping[str, NDArray[np.float64]]
    of: Mapping[str, str]
    lead: str
    period: Mapping[str, float]
    left_out: Mapping[str, str] = field(default_factory=dict)


def bases_of(source: Source, plan: Mapping[str, Rule], raw: Columns) -> Bases | None:
    """The bases of `plan` by the sample times in `raw`, None where no column has one.

    Raises DataError on sample times that do not rise, and on a column that is too slow for the lead.
    """
    every = _each(source, plan)
    if not every:
        return None
    used = list(dict.fromkeys(every.values()))
    if len(used) > 1:
        _check_lengths(source, plan, raw)
    stamps = {base: _seconds(source, base, raw[source.stamps[base]], len(used) > 1) for base in used}
    period = {base: float(np.median(np.diff(t))) if len(t) > 1 else np.inf for base, t in stamps.items()}
    lead = every.get("t") or (_lead(every, period) if len(used) > 1 else used[0])
    every["t"] = lead
    found = Bases(stamps, every, lead, period)
    slow = {name for name, base in every.items() if period[base] > _SLOW * period[lead]}
    out = {name: why for name in slow if (why := _fate(name, slow, plan, found, source))}
    return Bases(stamps, every, lead, period, out)


def names_to_read(source: Source, plan: Mapping[str, Rule]) -> list[str]:
    """Names of what `source` is asked for: the columns of `plan`, and the sample times of their bases."""
    names = {rule.source for rule in plan.values() if rule.source is not None}
    stamps = {source.stamps[base] for base in _each(source, plan).values()}
    return sorted((names - {source.common} if stamps else names) | stamps)


def _each(source: Source, plan: Mapping[str, Rule]) -> dict[str, str]:
    """The base of each column of `plan` that has one, that of the time only where it is chosen."""
    of_stamps = {name: base for base, name in source.stamps.items()}
    found = {name: source.bases.get(rule.source or "") for name, rule in plan.items()}
    found["t"] = found["t"] or of_stamps.get(plan["t"].source or "")
    return {name: base for name, base in found.items() if base is not None}


def _seconds(source: Source, base: str, raw: NDArray[np.float64], compared: bool) -> NDArray[np.float64]:
    """The sample times of a base; where they are `compared` with others they must rise."""
    name = source.stamps[base]
    unit = unit_of("t", Rule(name), source)
    steps = np.diff(raw)
    if compared and not np.all(steps > 0.0):
        row = int(np.argmin(steps > 0.0)) + 1
        number, words = source.place(row)
        raise refuse(
            DataError,
            "the sample times of its group do not rise",
            file=source.file,
            row=number,
            place=words,
            column=name,
            fix="export the group again with its sample times in order",
        )
    factor = to_si(1.0, unit, "time")
    return raw if factor == 1.0 else raw * factor


def _check_lengths(source: Source, plan: Mapping[str, Rule], raw: Columns) -> None:
    for rule in plan.values():
        base = source.bases.get(rule.source or "")
        if base is not None and len(raw[rule.source or ""]) != len(raw[source.stamps[base]]):
            raise refuse(
                DataError,
                f"it has {len(raw[rule.source or ''])} values, and its group {len(raw[source.stamps[base]])} "
                "sample times",
                file=source.file,
                column=rule.source,
                fix="export the group again; it may be cut short or damaged",
            )


def _lead(of: Mapping[str, str], period: Mapping[str, float]) -> str:
    electrical = [base for name, base in of.items() if name in _ELECTRICAL]
    choices = electrical or [base for name, base in of.items() if name == "tau_e"] or list(of.values())
    fastest = min(period[base] for base in choices)
    equal = [base for base in choices if period[base] <= _SLOW * fastest]
    counts = {base: sum(other == base for other in of.values()) for base in dict.fromkeys(equal)}
    return max(counts, key=lambda base: counts[base])


def _fate(name: str, slow: set[str], plan: Mapping[str, Rule], bases: Bases, source: Source) -> str | None:
    """Why a slow column is left out, None where it is interpolated. Raises DataError where neither will
    do.
    """
    have = {*plan} - slow
    rate, lead = (_rate(bases.period[base]) for base in (bases.of[name], bases.lead))
    column = shown(source.header(plan[name].source or ""))
    what = f"it is sampled at {rate}, the others at {lead}"
    if name in _SPEEDS and have & _ANGLES:
        return f"{what}, and the speed is taken from the angle"
    if name in _ANGLES and have & _SPEEDS and not {*plan} & _PHASES:
        return f"{what}, and the speed is there"
    currents = {"i_d", "i_q"} <= have or len({"i_a", "i_b", "i_c"} & have) > 1
    if name == "tau_e" and currents:
        return f"{what}, and the currents are there"
    if name in _ELECTRICAL or name in _ANGLES or name == "tau_e":
        raise refuse(
            DataError,
            f"it is sampled at other times than the others, at {rate}, too slow to go with their {lead}",
            file=source.file,
            column=column,
            fix=f"record them at one rate, or leave it out with {name} = false in [columns]",
        )
    return None


def _rate(period: float) -> str:
    return f"{1.0 / period:.4g} Hz" if np.isfinite(period) else "one value"


def lined_up(columns: Columns, bases: Bases, source: Source, plan: Mapping[str, Rule]) -> tuple[Columns, int]:
    """The canonical SI `columns` at the sample times of the lead that all bases cover, and how many rows of
    the lead were cut before them. Adds to the remarks of `source`.

    Raises DataError where the bases do not overlap.
    """
    lead = bases.stamps[bases.lead]
    groups: dict[str, list[str]] = {}
    for name in columns:
        if bases.of.get(name, bases.lead) != bases.lead:
            groups.setdefault(bases.of[name], []).append(name)
    keep = np.ones(len(lead), dtype=np.bool_)
    for base in groups:
        slack = bases.period[base] if _is_slow(base, bases) else _ON_TIME * bases.period[bases.lead]
        keep &= (lead >= bases.stamps[base][0] - slack) & (lead <= bases.stamps[base][-1] + slack)
    if not groups:
        return columns, 0
    if not keep.any():
        raise _apart(groups, bases, source, plan)
    first, times = int(np.argmax(keep)), lead[keep]
    own_base = {name for name, base in bases.of.items() if base == bases.lead}
    out = {name: values[keep] if name in own_base else values for name, values in columns.items()}
    for base, names in groups.items():
        own = bases.stamps[base]
        near = np.clip(np.searchsorted(own, times), 1, max(len(own) - 1, 1)) - 1
        near += (near + 1 < len(own)) & (times - own[near] > own[np.minimum(near + 1, len(own) - 1)] - times)
        exact = bool(np.all(np.abs(times - own[near]) <= _ON_TIME * bases.period[base]))
        for name in names:
            values = columns[name]
            out[name] = values[near] if exact else _between(times, own, values, near, name in _ANGLES)
        if _is_slow(base, bases) or not exact or len(own) != len(lead) or not keep.all():
            source.remarks.append(_remark(base, names, bases, source, plan, keep, exact))
    return out, first


def _is_slow(base: str, bases: Bases) -> bool:
    return bases.period[base] > _SLOW * bases.period[bases.lead]


def _between(
    times: NDArray[np.float64],
    own: NDArray[np.float64],
    values: NDArray[np.float64],
    near: NDArray[np.int64],
    turns: bool,
) -> NDArray[np.float64]:
    """`values` at `times`, by straight lines between those at `own`; an angle goes the short way round."""
    known = np.isfinite(values)
    if not known.any():
        return values[near]
    held = np.unwrap(values[known]) if turns else values[known]
    return np.where(known[near], np.interp(times, own[known], held), values[near])


def _apart(
    groups: Mapping[str, Sequence[str]], bases: Bases, source: Source, plan: Mapping[str, Rule]
) -> DataError:
    told = []
    for base in (bases.lead, *groups):
        names = [name for name, own in bases.of.items() if own == base and name != "t"]
        low, high = bases.stamps[base][[0, -1]]
        told.append(f"{_named(names, source, plan)} from {low:.6g} s to {high:.6g} s")
    return refuse(
        DataError,
        f"its groups were not recorded at the same time: {', '.join(told)}",
        file=source.file,
        fix="record them together, or correct the start times in the file if they are wrong",
    )


def _remark(
    base: str,
    names: Sequence[str],
    bases: Bases,
    source: Source,
    plan: Mapping[str, Rule],
    keep: NDArray[np.bool_],
    exact: bool,
) -> Remark:
    own, period, lead = bases.stamps[base], bases.period[base], bases.stamps[bases.lead]
    columns, were = _named(names, source, plan), "was" if len(names) == 1 else "were"
    if _is_slow(base, bases):
        return Remark(
            f"{columns} {were} sampled at {_rate(period)}, and interpolated to the "
            f"{_rate(bases.period[bases.lead])} of the others.",
            f"Nothing faster than {0.5 / period:.3g} Hz is seen in {'it' if len(names) == 1 else 'them'}.",
            "Record all at one rate if faster changes matter.",
        )
    if _SLOW * period < bases.period[bases.lead]:
        own_rate, rate = _rate(period), _rate(bases.period[bases.lead])
        return Remark(
            f"{columns} {were} sampled at {own_rate}, and taken at the {rate} of the others.",
            f"What changes faster than {0.5 / bases.period[bases.lead]:.3g} Hz in it looks slower.",
            "Record all at one rate if faster changes matter.",
        )
    away, cut = own[0] - lead[0], len(lead) - int(keep.sum())
    start, have = ("starts", "has") if len(names) == 1 else ("start", "have")
    if away != 0.0:
        what = f"{start} {abs(away):.6g} s {'later' if away > 0 else 'earlier'} than the others"
    else:
        what = f"{have} sample times of {'its' if len(names) == 1 else 'their'} own"
    return Remark(
        f"{columns} {what}, and {were} lined up with the others on the common time base, "
        f"{'sample by sample' if exact else 'by interpolation'}.",
        f"{cut} of {len(lead)} rows were cut, as not all columns have them." if cut else "No row was cut.",
        "If the start times in the file are wrong, correct them there.",
    )


def _named(names: Sequence[str], source: Source, plan: Mapping[str, Rule]) -> str:
    told = [f"'{shown(source.header(plan[name].source or name))}'" for name in names if name in plan]
    return listed([*told[:4], f"{len(told) - 4} more"] if len(told) > 5 else told)
