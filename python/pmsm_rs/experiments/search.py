"""The search for a manoeuvre: random members of each family, then small changes of the best."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import numpy as np

from .._core import NotIdentifiableError, PmsmError
from ..errors import refuse
from .bench import MARGIN, Trial
from .references import GENES, References, Scales, build, families

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..progress import Progress
    from .limits import Limits

    Array = NDArray[np.float64]

# Manoeuvres that are kept for changes, and share of all that is drawn afresh.
_PARENTS, _FRESH = 4, 0.5
# Sizes of the changes in turn, and share of the numbers that a change touches.
_CHANGES, _TOUCHED = (0.2, 0.08), 0.4
# A manoeuvre that breaks a limit is tried again with smaller amplitudes, so often and by this factor.
_AGAIN, _SMALLER = 3, 0.75

_Found = TypeVar("_Found")
_Answer = TypeVar("_Answer", covariant=True)


class Question(Protocol[_Answer]):
    """What a manoeuvre is to answer. Raises PmsmError where a drive cannot run it with one of the motors."""

    def trials(self, references: References) -> list[Trial]:
        """The trials of all rivals up to the first that breaks a limit."""

    def worth(self, trials: Sequence[Trial]) -> tuple[float, _Answer]:
        """What the trials are worth in nats, and what they show."""


@dataclass(frozen=True)
class Tried(Generic[_Found]):
    """A manoeuvre within the limits: what it is worth in nats, and what it shows."""

    references: References
    trials: tuple[Trial, ...]
    worth: float
    found: _Found
    kind: str
    genes: Array
    shrink: float


class _Refused:
    """How far the manoeuvres that were tried break a limit at least, and why one cannot be run."""

    def __init__(self) -> None:
        self.least: dict[str, float] = {}
        self.reason = ""

    def add(self, trial: Trial) -> None:
        name = trial.broken
        if name is not None:
            self.least[name] = min(self.least.get(name, math.inf), trial.peaks[name])


def search(
    question: Question[_Found],
    limits: Limits,
    scales: Scales,
    *,
    tries: int,
    seed: int,
    progress: Progress | None = None,
) -> list[Tried[_Found]]:
    """The manoeuvres within the limits, best first.

    `tries` are made: half of them random, the rest changes of the best. The same `seed` gives the same
    manoeuvres. Raises NotIdentifiableError naming the limit that none keeps.
    """
    rng = np.random.default_rng(seed)
    kinds = families(scales)
    refused = _Refused()
    found: list[Tried[_Found]] = []

    def attempt(kind: str, genes: Array, done: int) -> None:
        if progress is not None:
            progress("manoeuvres", done / tries)
        tried = _attempt(question, limits, scales, kind, genes, refused)
        if tried is not None:
            found.append(tried)

    fresh = max(1, round(_FRESH * tries))
    for k in range(fresh):
        attempt(kinds[k % len(kinds)], rng.random(GENES), k)
    found.sort(key=lambda x: -x.worth)
    done = fresh
    for number, size in enumerate(_CHANGES):
        if not found:
            break
        end = tries if number + 1 == len(_CHANGES) else fresh + (tries - fresh) // len(_CHANGES)
        parents = found[:_PARENTS]
        for k in range(done, end):
            parent = parents[k % len(parents)]
            change = size * rng.standard_normal(GENES) * (rng.random(GENES) < _TOUCHED)
            attempt(parent.kind, np.clip(parent.genes + change, 0.0, 1.0), k)
        done = end
        found.sort(key=lambda x: -x.worth)
    if not found:
        raise _none(refused, limits)
    return found


def _attempt(
    question: Question[_Found],
    limits: Limits,
    scales: Scales,
    kind: str,
    genes: Array,
    refused: _Refused,
) -> Tried[_Found] | None:
    shrink = 1.0
    for _ in range(_AGAIN + 1):
        references = build(kind, genes, limits, scales, shrink)
        try:
            trials = question.trials(references)
            if trials[-1].broken is None:
                worth = question.worth(trials)
                return Tried(references, tuple(trials), *worth, kind, genes, shrink)
        except PmsmError as error:
            # What the drive cannot run with this motor is no manoeuvre; the reason is told if none is left.
            refused.reason = str(error)
            return None
        refused.add(trials[-1])
        shrink *= _SMALLER
    return None


def _none(refused: _Refused, limits: Limits) -> NotIdentifiableError:
    if not refused.least:
        return refuse(
            NotIdentifiableError,
            f"no manoeuvre within the limits can be run by the simulated drive ({refused.reason})",
            fix="check f_sample and the bandwidths under [drive], and the limits themselves",
        )
    name = max(refused.least, key=lambda limit: refused.least[limit])
    share = refused.least[name] / MARGIN
    return refuse(
        NotIdentifiableError,
        f"no manoeuvre keeps the limit of {name}: the closest of them takes {100.0 * share:.0f} % of what is "
        "allowed in simulation",
        fix=f"raise limits.{name}, lengthen limits.time, or lower the other limits",
    )
