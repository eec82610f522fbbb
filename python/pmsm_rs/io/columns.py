"""The canonical columns of a file or frame, in SI units."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .._core import DataError
from ..config.rules import Rule, Rules
from ..errors import did_you_mean, refuse, shown
from ..quantities.canonical import CANONICAL
from ..quantities.units import UNITS
from .bases import bases_of, lined_up, names_to_read
from .formats.remark import Remark
from .formats.source import Source
from .planning import planned
from .reading import Account, Unused
from .stated import unit_of
from .timing import spread, unwrapped

Columns = dict[str, NDArray[np.float64]]


def assemble(source: Source, rules: Rules | None = None, *, finite: bool = True, first: int = 0) -> Columns:
    """The canonical SI columns of `source` as contiguous float64 arrays, `n` already turned into `omega_m`.
    Values that are not finite are let through where `finite` is False; `first` rows went before those of
    `source`.

    Raises DataError on a missing, doubtful, empty or unreadable column and on an unknown unit.
    """
    return taken(source, rules, finite=finite, first=first, streamed=True)[0]


def taken(
    source: Source,
    rules: Rules | None = None,
    beside: Callable[[str], Source] | None = None,
    *,
    finite: bool = True,
    first: int = 0,
    whole: bool = False,
    locked: bool = False,
    streamed: bool = False,
) -> tuple[Columns, Account]:
    """The columns as `assemble` gives them, and the account of what became of the columns of `source`.

    `beside` opens another file by its name next to the recording. With `whole` the columns must answer a
    question by themselves, and of a `locked` rotor the speed is zero; where they are `streamed`, the time is
    taken as it is. Raises DataError as `assemble`, on a file beside with other sample times, and on groups
    that cannot be brought together.
    """
    plan, account = planned(source, rules or {}, whole=whole, locked=locked)
    raw = source.read(names_to_read(source, plan))
    bases = bases_of(source, plan, raw)
    if bases is not None and bases.left_out:
        plan, account = _without(bases.left_out, plan, account, source)
    if not streamed:
        _mend_time(raw, plan["t"], source)
    read: Columns = {}
    for name, rule in plan.items():
        if rule.source is None:
            continue
        if bases is not None and rule.source == source.common:
            raw[rule.source] = bases.stamps[bases.lead]
        read[name] = converted(raw[rule.source], name, rule, source)
        if finite:
            _finite(read[name], raw[rule.source], name, rule.source, source)
    if bases is not None:
        read, cut = lined_up(read, bases, source, plan)
        account = replace(account, first=cut)
    rows = max((len(values) for values in read.values()), default=0)
    if rows == 0:
        raise refuse(DataError, "there are no rows", file=source.file, fix="record or export it again")
    out: Columns = {}
    for name, rule in plan.items():
        key = "omega_m" if name == "n" else name
        if rule.period is not None:
            out[key] = np.arange(first, first + rows, dtype=np.float64) * rule.period
        elif rule.value is not None:
            out[key] = np.full(rows, converted(np.array([rule.value]), name, rule, source)[0])
        elif rule.source is not None:
            out[key] = read[name]
    for name, given in (rules or {}).items():
        if given is not None and given.file is not None:
            key = "omega_m" if name == "n" else name
            out[key] = _from_beside(name, given, plan["t"], out["t"], beside, source)
    return out, replace(account, remarks=tuple(dict.fromkeys(source.remarks)))


def _without(
    left_out: Mapping[str, str], plan: Mapping[str, Rule], account: Account, source: Source
) -> tuple[dict[str, Rule], Account]:
    """Plan and account without columns that go with no others, which is told of each."""
    headers = {name: source.header(plan[name].source or "") for name in left_out}
    for name, why in left_out.items():
        source.remarks.append(
            Remark(
                f"'{shown(headers[name])}' was left out: {why}.",
                "The answer does not rest on it.",
                "Record it at the rate of the others to have it used.",
            )
        )
    unused = [Unused(headers[name], CANONICAL[name].dimension, why) for name, why in left_out.items()]
    kept = {name: rule for name, rule in account.columns.items() if name not in left_out}
    return {name: rule for name, rule in plan.items() if name not in left_out}, replace(
        account,
        columns=kept,
        ignored=(*account.ignored, *headers.values()),
        unused=(*account.unused, *unused),
    )


def _mend_time(raw: Columns, rule: Rule, source: Source) -> None:
    """Makes time go on where its counter wraps, and spreads stamps that several rows share."""
    if rule.source is None or rule.source not in raw:
        return
    column, unit = source.header(rule.source), rule.unit or "s"
    stamps, wrapped = unwrapped(raw[rule.source], column, source.place)
    others = [values for name, values in raw.items() if name != rule.source]
    raw[rule.source], shared = spread(stamps, others, column, unit)
    source.remarks.extend(remark for remark in (wrapped, shared) if remark is not None)


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
    clock = time.source if time.source in other.names else None
    if clock is not None and clock == other.common:
        clock = other.stamps[other.bases[column]] if column in other.bases else None
    raw = other.read(sorted({column, *([clock] if clock is not None else [])}))
    values = converted(raw[column], name, replace(rule, source=column), other)
    _finite(values, raw[column], name, column, other)
    stamps = t if clock is None else converted(raw[clock], "t", time, other)
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


def converted(raw: NDArray[np.float64], name: str, rule: Rule, source: Source) -> NDArray[np.float64]:
    """The values of a file, shape (rows,), as those of the canonical column `name` in SI units. Raises
    DataError on an unknown unit.
    """
    quantity = CANONICAL[name]
    factor, offset = UNITS[quantity.dimension][unit_of(name, rule, source)]
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


def unknown_column(name: str) -> str:
    """A clause for a name that is no canonical column."""
    return did_you_mean(name, CANONICAL)
