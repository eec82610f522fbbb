"""How much better a manoeuvre makes the least certain parameters known (D-optimality).

The gain is the entropy that the estimates of these parameters lose: half the logarithm of the ratio of the
determinants of their covariance, in nats (Lindley, Ann. Math. Stat. 27 (1956) 986).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .comparison import Comparison

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .bench import Trial
    from .rivals import Rival

    Array = NDArray[np.float64]

# A parameter whose standard error is a larger share of its value is not certain.
_CERTAIN = 0.05
# Standard errors below this share of the spread are no information on how certain a parameter is.
_TINY = 1e-12


@dataclass(frozen=True)
class Known:
    """A parameter before and after a manoeuvre: standard errors in its unit."""

    name: str
    value: float
    before: float
    after: float


@dataclass(frozen=True)
class Gain:
    """What a manoeuvre would add: nats over all open parameters, and each of them."""

    nats: float
    known: tuple[Known, ...]


def information(rival: Rival, names: Sequence[str], covariance: Array) -> Array:
    """Information of an answer on the free parameters of its model, in units of their spreads, shape (n, n).

    `covariance` is that of the parameters `names`; NaN on the diagonal for one that the recording does not
    show.
    """
    size = len(rival.free)
    found = np.zeros((size, size))
    place = {p.name: k for k, p in enumerate(rival.free)}
    shown = [
        k
        for k, name in enumerate(names)
        if name in place and math.isfinite(covariance[k, k]) and covariance[k, k] > 0.0
    ]
    if not shown:
        return found
    at = [place[names[k]] for k in shown]
    spreads = np.array([rival.free[k].spread for k in at])
    inner = covariance[np.ix_(shown, shown)] / np.outer(spreads, spreads)
    found[np.ix_(at, at)] = np.linalg.pinv(inner, rcond=_TINY, hermitian=True)
    return found


def open_parameters(rival: Rival, before: Array) -> list[int]:
    """Places of the free parameters that are not certain; the least certain one where all are."""
    errors = np.sqrt(np.diag(_covariance(before)))
    shares = [
        error * p.spread / max(abs(p.value), 1e-300) for p, error in zip(rival.free, errors, strict=True)
    ]
    found = [k for k, share in enumerate(shares) if share > _CERTAIN]
    return found or [int(np.argmax(shares))]


def gain(
    comparison: Comparison, rival: Rival, trial: Trial, before: Array, asked: Sequence[int], weight: float
) -> Gain:
    """What a trial adds to the information `before` on the parameters in the places `asked`.

    `weight` is the number of logged rows for which one row of the trial stands.
    """
    _, jacobian = comparison.jacobian(rival, trial.recording, trial.machine)
    first, then = _covariance(before), _covariance(before + weight * jacobian.T @ jacobian)
    rows = np.ix_(asked, asked)
    nats = 0.5 * (np.linalg.slogdet(first[rows])[1] - np.linalg.slogdet(then[rows])[1])
    known = tuple(
        Known(
            rival.free[k].name,
            rival.free[k].value,
            math.sqrt(first[k, k]) * rival.free[k].spread,
            math.sqrt(then[k, k]) * rival.free[k].spread,
        )
        for k in asked
    )
    return Gain(float(nats), known)


def _covariance(information: Array) -> Array:
    """Covariance with the spreads as what is known beforehand."""
    inverse = np.linalg.inv(information + np.eye(len(information)))
    symmetric: Array = 0.5 * (inverse + inverse.T)
    return symmetric


def noise_of(floor: Mapping[str, float | None]) -> dict[str, float]:
    """The noise of the channels that have one."""
    return {name: float(x) for name, x in floor.items() if x}
