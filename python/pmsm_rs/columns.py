"""From a file's own columns to the canonical ones: the [columns] table first, safe guesses for the rest."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ._core import DataError
from .errors import did_you_mean, refuse
from .formats.source import Source
from .quantities import CANONICAL, DOUBTFUL, LOGS, MECHANICAL_RPM, alias, normal
from .units import RMS, UNITS, canonical, dimension_of, suggest

_ROTOR_FRAME = frozenset({"i_d", "i_q", "v_d", "v_q"})


@dataclass(frozen=True)
class Rule:
    """How one canonical column is made: SI value of (raw · scale + offset) in `unit`, of the constant `value`
    in `unit`, or a time axis of `period` s.

    `unit` None means the unit that the file states, else the canonical one. `file` names another file, beside
    the recording, that has the column.
    """

    source: str | None = None
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    period: float | None = None
    value: float | None = None
    file: str | None = None


Rules = Mapping[str, Rule | None]
"""Rules by canonical name; None leaves the column out."""


def assemble(
    source: Source,
    rules: Rules | None = None,
    beside: Callable[[str], Source] | None = None,
    *,
    finite: bool = True,
    first: int = 0,
) -> dict[str, NDArray[np.float64]]:
    """The canonical SI columns of `source` as contiguous float64 arrays, `n` already turned into `omega_m`.
    Values that are not finite are let through where `finite` is False; `first` rows went before those of
    `source`.

    `beside` opens another file by its name next to the recording. Raises DataError on a missing, doubtful,
    empty or unreadable column, on an unknown unit, and on a file beside with other sample times.
    """
    foreign = {
        name: rule for name, rule in (rules or {}).items() if rule is not None and rule.file is not None
    }
    plan = _complete(source, dict(rules or {}), set(foreign))
    wanted = {rule.source for rule in plan.values() if rule.source is not None}
    raw = source.read(sorted(wanted))
    rows = max((len(values) for values in raw.values()), default=0)
    if rows == 0:
        raise refuse(DataError, "there are no rows", file=source.file, fix="record or export it again")
    out: dict[str, NDArray[np.float64]] = {}
    for name, rule in plan.items():
        if rule.period is not None:
            out[name] = np.arange(first, first + rows, dtype=np.float64) * rule.period
        elif rule.value is not None:
            value = _convert(np.array([rule.value]), name, rule, source)
            out["omega_m" if name == "n" else name] = np.full(rows, value[0])
        elif rule.source is not None:
            values = _convert(raw[rule.source], name, rule, source)
            if finite:
                _finite(values, raw[rule.source], name, rule.source, source)
            out["omega_m" if name == "n" else name] = values
    for name, rule in foreign.items():
        out["omega_m" if name == "n" else name] = _from_beside(
            name, rule, plan["t"], out["t"], beside, source
        )
    if "n" in {*plan, *foreign} and "omega_m" in {*plan, *foreign}:
        raise refuse(
            DataError,
            "both n and omega_m are there",
            file=source.file,
            column="n",
            fix="leave one of them out with n = false in [columns]",
        )
    return out


def _from_beside(
    name: str,
    rule: Rule,
    time: Rule,
    t: NDArray[np.float64],
    beside: Callable[[str], Source] | None,
    source: Source,
) -> NDArray[np.float64]:
    """A column of another file, whose sample times must be those of the recording, `t`."""
    assert rule.file is not None
    assert rule.source is not None
    if beside is None:
        raise refuse(
            DataError,
            f"{name} is to come from '{rule.file}', and this recording is no file",
            column=rule.source,
            fix="give all columns together",
        )
    other = beside(rule.file)
    column = other.find(rule.source, name)
    chosen = {column, *({time.source} & set(other.names))} - {None}
    raw = other.read(sorted(text for text in chosen if text is not None))
    values = _convert(raw[column], name, replace(rule, source=column), other)
    _finite(values, raw[column], name, column, other)
    stamps = _convert(raw[time.source], "t", time, other) if time.source in raw else t
    tolerance = 0.01 * float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    if len(values) != len(t) or not np.allclose(stamps, t, rtol=0.0, atol=tolerance):
        raise refuse(
            DataError,
            f"it was not sampled together with {source.file}",
            file=other.file,
            column=column,
            fix="record both together, or bring them to the same sample times",
        )
    return values


def _complete(source: Source, rules: dict[str, Rule | None], foreign: set[str]) -> dict[str, Rule]:
    """The rule of every column that can be had, the given ones checked and the rest guessed; `foreign` ones
    are not in this file.
    """
    plan: dict[str, Rule] = {}
    for name, rule in rules.items():
        if rule is None or name in foreign:
            continue
        if rule.source is not None:
            rule = replace(rule, source=source.find(rule.source, name))
            plan[name] = replace(rule, unit=_unit(name, rule, source))
        else:
            plan[name] = rule
    taken = {rule.source for rule in plan.values()}
    guesses, doubts = _guess(source, taken)
    for name, candidates in guesses.items():
        if name in rules or (name == "n" and "omega_m" in rules) or (name == "omega_m" and "n" in rules):
            continue
        if len(candidates) > 1 and name not in candidates:
            first, second = sorted(candidates)[:2]
            raise refuse(
                DataError,
                f"both '{first}' and '{second}' could be {name}",
                file=source.file,
                column=first,
                fix=f'say which in [columns]: {name} = {{ from = "{first}" }}',
            )
        chosen = name if name in candidates else next(iter(candidates))
        plan[name] = Rule(chosen, candidates[chosen])
    for column, meanings in doubts.items():
        _settle(column, meanings, plan, rules, source)
    if "t" not in plan:
        raise refuse(
            DataError,
            "there is no time column",
            file=source.file,
            column="t",
            fix='add t = { from = "...", unit = "s" } or t = { period = ... } (in s) to [columns]; '
            + f"the file has {_listed(source.names)}",
        )
    return {name: plan[name] for name in CANONICAL if name in plan}


def _guess(
    source: Source, taken: set[str | None]
) -> tuple[dict[str, dict[str, str]], dict[str, tuple[str, ...]]]:
    """Canonical name -> {file column: unit} where safe, and file column -> possible meanings where in
    doubt.
    """
    guesses: dict[str, dict[str, str]] = {}
    doubts: dict[str, tuple[str, ...]] = {}
    plain = {normal(name) for name in source.names}
    log = next((table for marks, table in LOGS.values() if marks <= plain), {})
    for column in source.names:
        if column in taken:
            continue
        key = normal(column)
        stated = source.units.get(column)
        if stated is None:
            key, stated = _suffix(key)
        if key in log:
            name, unit = log[key]
            guesses.setdefault(name, {})[column] = unit
        elif column in CANONICAL and stated is None:
            guesses.setdefault(column, {})[column] = CANONICAL[column].unit
        elif stated is not None and key in MECHANICAL_RPM and canonical(stated, "speed") in {"rpm", "krpm"}:
            guesses.setdefault("n", {})[column] = canonical(stated, "speed") or "rpm"
        elif key in MECHANICAL_RPM and "rpm" in key:
            guesses.setdefault("n", {})[column] = "rpm"
        elif (known := alias(key)) is not None:
            name, assumed = known
            if stated is not None:
                guesses.setdefault(name, {})[column] = _unit(name, Rule(column, stated), source)
            elif assumed:
                guesses.setdefault(name, {})[column] = CANONICAL[name].unit
            else:
                doubts[column] = (name,)
        elif key in DOUBTFUL:
            doubts[column] = DOUBTFUL[key]
        elif key == "column" and stated is not None and canonical(stated, "time") is not None:
            guesses.setdefault("t", {})[column] = canonical(stated, "time") or "s"
    return guesses, doubts


def _suffix(key: str) -> tuple[str, str | None]:
    """A unit at the end of a normalised name, as in `speed_rpm` or `time_ms`, where name and unit belong
    together.
    """
    head, _, tail = key.rpartition("_")
    if not head or key in CANONICAL or alias(key) is not None:
        return key, None
    known = alias(head)
    names = (known[0],) if known else DOUBTFUL.get(head, ())
    for name in names:
        dimension = CANONICAL[name].dimension
        effective = {"current": "Arms", "voltage": "Vrms"}.get(dimension) if tail == "rms" else None
        unit = canonical(tail, dimension) or effective
        if unit is not None:
            return head, unit
    return key, None


def _settle(
    column: str,
    meanings: tuple[str, ...],
    plan: dict[str, Rule],
    rules: dict[str, Rule | None],
    source: Source,
) -> None:
    """Refuses a column in doubt, unless what it could give is there already or left out on purpose."""
    dimension = CANONICAL[meanings[0]].dimension
    supplied = (
        any(CANONICAL[name].dimension == dimension for name in plan)
        if dimension in {"angle", "speed"}
        else (meanings[0] in plan)
    )
    if rules or supplied or any(name in rules for name in meanings):
        return
    units = " or ".join(f'"{unit}"' for unit in list(UNITS[dimension])[:3])
    if len(meanings) > 1:
        problem = "it may be electrical or mechanical"
        stated = source.unit(column)
        given = f', unit = "{stated}"' if stated else f", unit = {units}"
        fix = "say which in [columns]: " + " or ".join(
            f'{name} = {{ from = "{column}"{given} }}' for name in meanings
        )
    else:
        problem = f"its unit is not stated, so it cannot be taken as {meanings[0]}"
        fix = f'say it in [columns]: {meanings[0]} = {{ from = "{column}", unit = {units} }}'
    raise refuse(DataError, problem, file=source.file, column=column, fix=fix)


def _unit(name: str, rule: Rule, source: Source) -> str:
    """The unit of a rule, checked against the dimension of its canonical column."""
    quantity = CANONICAL[name]
    stated = source.unit(rule.source or "")
    text = rule.unit
    if text is None:
        # A scale turns the raw numbers into something of the user's own, so the file's unit no longer speaks.
        text = stated if stated is not None and rule.scale == 1.0 and rule.offset == 0.0 else quantity.unit
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
    return unit


def _convert(raw: NDArray[np.float64], name: str, rule: Rule, source: Source) -> NDArray[np.float64]:
    quantity = CANONICAL[name]
    factor, offset = UNITS[quantity.dimension][_unit(name, rule, source)]
    if factor == 1.0 and offset == 0.0 and rule.scale == 1.0 and rule.offset == 0.0:
        return raw
    with np.errstate(over="ignore", invalid="ignore"):
        return (raw * rule.scale + rule.offset) * factor + offset


def _finite(
    values: NDArray[np.float64], raw: NDArray[np.float64], name: str, column: str, source: Source
) -> None:
    finite = np.isfinite(values)
    if finite.all():
        return
    row = int(np.argmin(finite))
    number, words = source.place(row)
    value = float(raw[row])
    what = "not a number" if np.isnan(value) else "infinite or too large" if np.isinf(value) else "too large"
    raise refuse(
        DataError,
        f"the value is {what}",
        file=source.file,
        row=number,
        place=words,
        column=column,
        fix=f"cut the rows (gaps in time are understood), or leave it out with {name} = false in [columns]",
    )


def _listed(names: tuple[str, ...]) -> str:
    shown = ", ".join(f"'{name}'" for name in names[:12])
    return shown + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def unknown_column(name: str) -> str:
    """A clause for a name that is no canonical column."""
    return did_you_mean(name, CANONICAL)
