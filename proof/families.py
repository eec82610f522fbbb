"""What the cases of each family amount to: one column a family."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from .score import Judged
from .summary import Rate, Value, median, rate, statistic, worst_bin

VERDICTS = ("named", "partial", "ambiguous", "unknown", "no_mismatch", "undetermined", "no answer")
GROUPS = (
    "singles",
    "pairs",
    "whole",
    "foreign alone",
    "foreign beside known",
    "unknown",
    "clean",
    "limits, sound",
    "limits, one effect",
    "bench",
    "poor",
)


def within(share: float) -> Callable[[list[float]], float]:
    """The value that so great a share of the values does not exceed."""
    return lambda x: float(np.quantile(x, share))


def summed(rows: Iterable[Judged], count: Callable[[Judged], int], of: Callable[[Judged], int]) -> Rate:
    """Counts within cases, added up."""
    held = list(rows)
    return Rate(sum(map(count, held)), sum(map(of, held)))


def family(rows: Sequence[Judged]) -> dict[str, Rate | Value]:
    """What the cases of one family amount to, in the order of the table."""
    verdicts = {v: rate(rows, lambda r, v=v: r.verdict == v) for v in VERDICTS}
    return {
        "right": rate(rows, lambda r: r.right),
        "parts of 2 times the noise and more, found": summed(rows, lambda r: r.found, lambda r: r.strong),
        "names that are right": summed(rows, lambda r: r.names_right, lambda r: r.names),
        "cases with a wrong name of p > 0.5": rate(rows, lambda r: r.wrong_confident),
        "false alarms": rate(rows, lambda r: r.false_alarm),
        "verdict named or partial": rate(rows, lambda r: r.verdict in ("named", "partial")),
        **{f"verdict {name.replace('_', ' ')}": share for name, share in verdicts.items()},
        "remaining over noise, median": statistic(rows, lambda r: r.remaining, median, "{:.2f}"),
        "remaining over noise, 90 % below": statistic(rows, lambda r: r.remaining, within(0.9), "{:.2f}"),
        "with a map, remaining over noise, median": statistic(
            rows, lambda r: r.remaining if r.mapped else None, median, "{:.2f}"
        ),
        "share of a map, largest difference from its fit": statistic(
            rows, lambda r: r.share_off, max, "{:.4f}"
        ),
        "foreign form put into the right equation": rate(rows, lambda r: r.foreign_equation),
        "… and over the right variable": rate(rows, lambda r: r.foreign_variable),
        "95 % intervals of effects that cover": summed(
            rows, lambda r: sum(r.intervals), lambda r: len(r.intervals)
        ),
        "95 % intervals of the base that cover": summed(
            rows, lambda r: sum(r.base_intervals), lambda r: len(r.base_intervals)
        ),
        "calibration, worst bin": worst_bin(rows),
        "run time, median, s of processor": statistic(rows, lambda r: r.cpu_seconds, median, "{:.1f}"),
        "run time, longest, s of processor": statistic(rows, lambda r: r.cpu_seconds, max, "{:.1f}"),
        "memory, greatest, MB": statistic(rows, lambda r: r.memory_mb, max, "{:.0f}"),
    }


def families(rows: Sequence[Judged]) -> dict[str, dict[str, Rate | Value]]:
    """The same per family, clean and limited cases of a limited log and foreign forms alone and beside known
    effects apart, then all together."""
    groups: dict[str, list[Judged]] = {}
    for row in rows:
        groups.setdefault(group_of(row), []).append(row)
    found = {name: family(groups[name]) for name in GROUPS if name in groups}
    return (
        found
        | {name: family(groups[name]) for name in sorted(groups) if name not in GROUPS}
        | {"all": family(rows)}
    )


def group_of(row: Judged) -> str:
    """Column of a case in the table of families."""
    if row.family == "limits":
        return "limits, sound" if row.kind == "clean" else "limits, one effect"
    if row.family == "foreign":
        return "foreign beside known" if row.known else "foreign alone"
    return row.family
