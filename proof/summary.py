"""Counts judged cases: rates with their numbers, breakdowns, calibration."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from .score import Judged

SEVERITIES = ((0.0, 3.0, "below 3"), (3.0, 6.0, "3 to 6"), (6.0, float("inf"), "6 and more"))
BINS = 10
# fewer effects than these in a bin say little about it
FULL_BIN = 20
# acceptable held-out residual over the least that true equations leave
HELD_OUT = 1.1


@dataclass(frozen=True)
class Rate:
    """`count` of `of` cases; nothing to say where `of` is 0."""

    count: int
    of: int

    @property
    def share(self) -> float | None:
        """Share of the cases, or None."""
        return self.count / self.of if self.of else None

    def __str__(self) -> str:
        return f"{self.count} of {self.of} ({100.0 * self.count / self.of:.1f} %)" if self.of else "–"


@dataclass(frozen=True)
class Value:
    """A statistic of `of` cases with the digits worth printing."""

    value: float | None
    of: int
    form: str = "{:.3g}"

    def __str__(self) -> str:
        return f"{self.form.format(self.value)} ({self.of})" if self.value is not None else "–"


@dataclass(frozen=True)
class Bin:
    """Effects whose probability lies between `low` and `high`: their number, the mean of what was stated, and
    the share that was there."""

    low: float
    high: float
    count: int
    stated: float
    observed: float


def rate(rows: Iterable[Judged], question: Callable[[Judged], bool | None]) -> Rate:
    """How often a question is answered by yes, where it arises."""
    said = [x for x in map(question, rows) if x is not None]
    return Rate(sum(said), len(said))


def statistic(
    rows: Iterable[Judged],
    question: Callable[[Judged], float | None],
    of: Callable[[list[float]], float],
    form: str = "{:.3g}",
) -> Value:
    """A statistic of what the cases say, where they say something."""
    said = [float(x) for x in map(question, rows) if x is not None]
    return Value(float(of(said)) if said else None, len(said), form)


def median(x: list[float]) -> float:
    """The middle value."""
    return float(np.median(x))


def brier(rows: Iterable[Judged]) -> Value:
    """Mean squared difference of the first probability and what came true; 0 is best, 0.25 a coin."""
    x = [(r.probability - float(r.first_right)) ** 2 for r in rows if r.first_right is not None]
    return Value(float(np.mean(x)) if x else None, len(x), "{:.4f}")


def calibration(rows: Sequence[Judged], bins: int = BINS) -> list[Bin]:
    """Stated against observed in bins of equal width, every effect of every ranking; empty bins are left
    out."""
    asked = [x for r in rows for x in r.posteriors]
    out = []
    for k in range(bins):
        low, high = k / bins, (k + 1) / bins
        # the last bin takes probability 1
        held = [(p, there) for p, there in asked if min(int(p * bins), bins - 1) == k]
        if held:
            stated, observed = (float(np.mean([x[c] for x in held])) for c in (0, 1))
            out.append(Bin(low, high, len(held), stated, observed))
    return out


def worst_bin(rows: Sequence[Judged]) -> Value:
    """Greatest difference of stated and observed over the bins that hold at least FULL_BIN effects."""
    off = [abs(b.stated - b.observed) for b in calibration(rows) if b.count >= FULL_BIN]
    return Value(max(off) if off else None, sum(len(r.posteriors) for r in rows), "{:.3f}")


def headline(rows: Sequence[Judged]) -> dict[str, Rate | Value]:
    """What the cases of one kind of log amount to, in the order of the table."""

    def of(*kinds: str) -> list[Judged]:
        return [r for r in rows if r.kind in kinds]

    singles = of("single")
    clear = [r for r in singles if r.identifiable]
    right = [r for r in of("single", "pair") if r.right]
    inside = [x for r in singles if r.identifiable for x in r.intervals]
    return {
        "identifiable single effects named": rate(clear, lambda r: r.right),
        "… first": rate(clear, lambda r: r.named_first),
        "… in the first two": rate(clear, lambda r: r.first_two),
        "all single effects named": rate(singles, lambda r: r.right),
        "pairs, both named": rate(of("pair"), lambda r: r.right),
        "pairs, at least one": rate(of("pair"), lambda r: r.one_of_two),
        "clean cases, false alarms": rate(of("clean"), lambda r: r.false_alarm),
        "outside the catalogue, called unknown": rate(of("unknown"), lambda r: r.right),
        "outside the catalogue, named with p > 0.5": rate(of("unknown"), lambda r: r.wrong_confident),
        "wrong name with p > 0.5, any case": rate(rows, lambda r: r.wrong_confident),
        "poor manoeuvres, honest answer": rate(of("poor"), lambda r: r.right),
        "ambiguous answers that hold the truth": rate(rows, lambda r: r.ambiguity_honest),
        "right equation located first": rate(rows, lambda r: r.equation_right),
        "parameter error, median": statistic(singles, lambda r: r.parameter_error, median, "{:.2%}"),
        "95 % intervals that cover (identifiable singles)": Rate(sum(inside), len(inside)),
        "held-out residual / least possible, before, median (right ones)": statistic(
            right, lambda r: r.held_out_before, median, "{:.2f}"
        ),
        "held-out residual / least possible, after, median (right ones)": statistic(
            right, lambda r: r.held_out_after, median, "{:.3f}"
        ),
        f"… after within {HELD_OUT:g} (right ones)": rate(
            right, lambda r: None if r.held_out_after is None else r.held_out_after <= HELD_OUT
        ),
        "trajectories flagged as copied": rate(rows, lambda r: r.copied),
        "Brier score of the first probability": brier(rows),
        "calibration of all probabilities, worst bin": worst_bin(rows),
        "run time on one thread, median, s of processor": statistic(
            rows, lambda r: r.cpu_seconds, median, "{:.1f}"
        ),
        "run time on one thread, longest, s of processor": statistic(
            rows, lambda r: r.cpu_seconds, max, "{:.1f}"
        ),
        "memory, greatest, MB": statistic(rows, lambda r: r.memory_mb, max, "{:.0f}"),
    }


def breakdown(
    rows: Iterable[Judged], of: Callable[[Judged], str], order: Sequence[str] = ()
) -> list[tuple[str, Rate, Rate, Rate]]:
    """(group, right, wrong with confidence, false alarms) by what `of` says, in `order`, then by name."""
    groups: dict[str, list[Judged]] = {}
    for row in rows:
        groups.setdefault(of(row), []).append(row)
    names = [k for k in order if k in groups] + sorted(k for k in groups if k not in order)
    return [
        (
            k,
            rate(groups[k], lambda r: r.right),
            rate(groups[k], lambda r: r.wrong_confident),
            rate(groups[k], lambda r: r.false_alarm),
        )
        for k in names
    ]


def severity_of(row: Judged) -> str:
    """The severity's class."""
    return next(name for low, high, name in SEVERITIES if low <= row.severity < high)
