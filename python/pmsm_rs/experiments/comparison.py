"""How far apart rivals are on a manoeuvre, after each has adjusted its parameters (T-optimality).

For a manoeuvre on which one rival is true, the other is fitted to what the first would log. What it cannot
take up, in times the noise, is the separation: Atkinson & Fedorov, Biometrika 62 (1975) 57. A recording that
is already there holds the parameters as far as it shows them. The fit is linear within the search, and
repeated for the manoeuvre that is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from .. import _core

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .._core import Machine, Recording
    from .bench import Trial
    from .rivals import Rival

    Array = NDArray[np.float64]
    Blocks = dict[str, Array]

# Samples of a channel that count as independent at most: as in the diagnosis, on whose scale nats are.
MOST_WORTH = 200.0
# A prediction that runs away is this many times the noise off: far beyond any log, and finite when squared.
_LOST = 1e9
# Step of a difference quotient, share of the value.
_STEP = 1e-3
# Share of a trial over which a place is told.
_PLACE = 0.04
# Residual of the dq-model that is allowed, share of the variation of a channel.
_EXPLAINED = 0.5
# Fits of the manoeuvre that is chosen, and halvings of a step that leads nowhere.
_ROUNDS, _HALVINGS = 3, 3


@dataclass(frozen=True)
class Known:
    """A recording that is already there, with the machine by which it is read."""

    recording: Recording
    machine: Machine


@dataclass(frozen=True)
class Separation:
    """The residual of `rival` on a manoeuvre on which `truth` is true.

    `nats` is the evidence against it, `times` the residual by channel in times the noise. It is largest in
    `channel`, and there at the row `at`. `gained` is what the trial tells of the parameters of the rival: the
    entropy that they lose, in nats.
    """

    truth: str
    rival: str
    nats: float
    times: Mapping[str, float]
    channel: str
    at: int
    gained: float = 0.0


class Comparison:
    """Compares rivals by the predictions of the core, in channels with the noise `noise` by their names.

    `known` are recordings that hold the parameters of all.
    """

    def __init__(self, noise: Mapping[str, float], known: Sequence[Known], threads: int) -> None:
        self._noise = {name: x for name, x in noise.items() if x and math.isfinite(x)}
        self._known = tuple(known)
        self._pool = ThreadPoolExecutor(threads)
        self._seen: dict[str, list[Blocks]] = {}

    def close(self) -> None:
        """Ends the threads."""
        self._pool.shutdown()

    def predicted(self, rival: Rival, recording: Recording, machine: Machine) -> Blocks:
        """The prediction of each channel in units of its noise, arrays of shape (rows,)."""
        told = _core.predict(recording, machine, rival.text, one_step=False, threads=1, progress=None)
        return {
            name: np.clip(np.nan_to_num(told[f"{name}_model"] / sigma, nan=_LOST), -_LOST, _LOST)
            for name, sigma in self._noise.items()
            if f"{name}_model" in told
        }

    def jacobian(self, rival: Rival, recording: Recording, machine: Machine) -> tuple[Blocks, Array]:
        """The prediction, and its derivatives by the free parameters in units of their spreads, of shape
        (rows of all channels, parameters).
        """

        def one(k: int | None) -> Blocks:
            if k is None:
                return self.predicted(rival, recording, machine)
            values = rival.values
            values[k] += steps[k]
            return self.predicted(rival.at(values), recording, machine)

        steps = [_STEP * (abs(p.value) if p.value else p.spread) for p in rival.free]
        jobs: list[int | None] = [None, *range(len(steps))]
        first, *moved = self._pool.map(one, jobs)
        at = stacked(first)
        columns = [
            (stacked(x) - at) * (p.spread / h) for x, p, h in zip(moved, rival.free, steps, strict=True)
        ]
        return first, np.column_stack(columns) if columns else np.empty((len(at), 0))

    def separation(self, truth: Rival, rival: Rival, trial: Trial, *, rounds: int = 1) -> Separation:
        """The residual of `rival` on the trial of `truth`.

        One round is the linear adjustment; with more the fit is repeated from there. Raises PmsmError where
        the trial cannot be predicted.
        """
        return self._fitted(truth, rival, trial, self._targets(truth, trial), rounds)

    def explains(self, truth: Rival, plain: Rival, trial: Trial) -> bool:
        """Whether the dq-model `plain` stays a model of the trial of `truth`: a diagnosis begins with it, and
        says nothing of a recording of which it explains next to nothing. Its parameters are those of the
        recording that is there, with which it has to agree, too.
        """
        target = self._targets(truth, trial)[0]
        told = self.predicted(plain, trial.recording, trial.machine)
        return all(
            float(np.sqrt(np.mean((x - told[k]) ** 2))) <= _EXPLAINED * float(np.std(x))
            for k, x in target.items()
        )

    def _runs(self, trial: Trial) -> list[tuple[Recording, Machine]]:
        return [(trial.recording, trial.machine), *((k.recording, k.machine) for k in self._known)]

    def _targets(self, truth: Rival, trial: Trial) -> list[Blocks]:
        """What `truth` predicts of the trial and of the recordings that are there."""
        own = self.predicted(truth, trial.recording, trial.machine)
        if truth.text not in self._seen:
            self._seen[truth.text] = [self.predicted(truth, k.recording, k.machine) for k in self._known]
        return [own, *self._seen[truth.text]]

    def _fitted(
        self, truth: Rival, rival: Rival, trial: Trial, target: Sequence[Blocks], rounds: int
    ) -> Separation:
        now, moved = rival, np.zeros(len(rival.free))
        left, cost = self._left(now, trial, target, moved)
        best = left
        for number in range(rounds):
            parts = [self.jacobian(now, *run) for run in self._runs(trial)]
            matrix = np.vstack([j for _, j in parts] + [np.eye(len(rival.free))])
            y = np.concatenate(
                [stacked(t) - stacked(p) for t, (p, _) in zip(target, parts, strict=True)] + [-moved]
            )
            step = np.linalg.lstsq(matrix, y, rcond=1e-12)[0]
            if rounds == 1:
                rows = len(stacked(target[0]))
                left_over = _blocks(target[0], (y - matrix @ step)[:rows])
                own = matrix[:rows]
                gained = 0.5 * float(np.linalg.slogdet(np.eye(own.shape[1]) + own.T @ own)[1])
                return replace(separation_of(truth.name, rival.name, left_over), gained=gained)
            spreads = np.array([p.spread for p in rival.free])
            for _ in range(_HALVINGS + 1):
                other = rival.at(rival.values + (moved + step) * spreads)
                there = (other.values - rival.values) / spreads
                found, worth = self._left(other, trial, target, there)
                if worth < cost:
                    break
                step = 0.5 * step
            else:
                break
            gained, cost = cost - worth, worth
            now, moved, best = other, there, found
            if gained < 1e-4 * cost and number:
                break
        return separation_of(truth.name, rival.name, best)

    def _left(
        self, rival: Rival, trial: Trial, target: Sequence[Blocks], moved: Array
    ) -> tuple[Blocks, float]:
        """The residual of the trial, and the whole cost."""
        told = [self.predicted(rival, *run) for run in self._runs(trial)]
        left = [{name: t[name] - p[name] for name in t} for t, p in zip(target, told, strict=True)]
        cost = sum(float(x @ x) for block in left for x in block.values()) + float(moved @ moved)
        return left[0], cost


def stacked(blocks: Blocks) -> Array:
    """All channels one after the other."""
    return np.concatenate(list(blocks.values()))


def _blocks(like: Blocks, values: Array) -> Blocks:
    ends = np.cumsum([len(x) for x in like.values()])[:-1]
    return dict(zip(like, np.split(values, ends), strict=True))


def separation_of(truth: str, rival: str, left: Blocks) -> Separation:
    """The separation of a residual in times the noise, by channel."""
    squares = {name: float(np.mean(x**2)) for name, x in left.items()}
    nats = sum(0.5 * min(MOST_WORTH, len(left[name])) * math.log1p(x) for name, x in squares.items())
    channel = max(squares, key=lambda name: squares[name])
    x = left[channel] ** 2
    width = max(1, round(_PLACE * len(x)))
    at = int(np.argmax(np.convolve(x, np.ones(width), mode="same")))
    times = {name: math.sqrt(1.0 + square) for name, square in squares.items()}
    return Separation(truth, rival, nats, times, channel, at)


ROUNDS = _ROUNDS
