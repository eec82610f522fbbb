"""The paper's runs: one window searched from scratch, nine windows one after the other, and many seeds."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .._core import Machine
from ..config.swarm import Swarm
from ..live.tracker import Tracker
from ..live.window import WindowEstimate
from ..progress import Progress
from ..simulation.drive import simulate
from . import setup

Column = NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """The simulated run: the drive's log by column and the truth, arrays of shape (samples,)."""

    machine: Machine
    columns: dict[str, Column]
    t: Column
    r_s: Column
    load: Column

    def window(self, k: int) -> dict[str, Column]:
        """The columns of window `k`."""
        rows = slice(k * setup.SAMPLES, (k + 1) * setup.SAMPLES)
        return {name: column[rows] for name, column in self.columns.items()}

    def truth(self, k: int) -> tuple[float, float]:
        """Mean r_s (ohm) and mean disturbed load torque (N·m) of window `k`."""
        rows = slice(k * setup.SAMPLES, (k + 1) * setup.SAMPLES)
        return float(self.r_s[rows].mean()), float(self.load[rows].mean())


@dataclass(frozen=True)
class Search:
    """Fig. 5: one window searched from scratch; after each generation the best cost, r_s (ohm) and load
    torque (N·m), arrays of shape (generations,) from generation 1.
    """

    cost: Column
    r_s: Column
    load: Column
    truth: tuple[float, float]


@dataclass(frozen=True)
class Following:
    """Figs. 6 to 8: the windows, and the seconds that each took by the clock and of all processors.

    With them come the true means of r_s (ohm) and disturbed load torque (N·m) in each.
    """

    method: str
    windows: tuple[WindowEstimate, ...]
    seconds: tuple[float, ...]
    processor: tuple[float, ...]
    truth: tuple[tuple[float, float], ...]

    def errors(self, name: str) -> Column:
        """Relative errors of `r_s` or `tau_load`, window by window."""
        at = ("r_s", "tau_load").index(name)
        found = [window.parameters[name].value or np.nan for window in self.windows]
        return np.array([x / true[at] - 1.0 for x, true in zip(found, self.truth, strict=True)])

    def real_time_factor(self, seconds: tuple[float, ...]) -> float:
        """How many times faster than the drive ran, by `seconds` per window."""
        return setup.WINDOW * len(self.windows) / sum(seconds)


@dataclass(frozen=True)
class Seeds:
    """Searches of one window that differ in the seed alone: the generations until within
    `setup.CONVERGED` of the search's own last cost and of the best of all searches (-1: never).
    """

    velocity_limit: float
    own: tuple[int, ...]
    best: tuple[int, ...]

    def share(self, which: str) -> float:
        """Share of searches that got there by the paper's generation 20."""
        found = self.own if which == "own" else self.best
        return sum(0 <= g <= setup.PAPER_GENERATIONS for g in found) / len(found)


def run() -> Run:
    """Simulates the drive."""
    done = simulate(setup.drive())
    rows = setup.SAMPLES * setup.WINDOWS
    columns = {name: done.recording.column(name)[:rows] for name in done.recording.names}
    truth = done.truth.traces
    return Run(done.machine, columns, columns["t"], truth["r_s"][:rows], truth["tau_load_disturbed"][:rows])


def search(data: Run, seed: int = 1) -> Search:
    """Fig. 5. A swarm of fewer iterations is the beginning of the same swarm, so that the best point after
    each generation is the result of one.
    """
    steps = range(1, setup.SWARM.iterations + 1)
    found = [_one(data, replace(setup.SWARM, iterations=k), seed) for k in steps]
    return Search(
        np.array([window.cost for window in found]),
        np.array([window.parameters["r_s"].value for window in found]),
        np.array([window.parameters["tau_load"].value for window in found]),
        data.truth(0),
    )


def follow(data: Run, method: str) -> Following:
    """Figs. 6 to 8 by `method`."""
    tracker = _tracker(data, setup.SWARM, 1, method)
    windows: list[WindowEstimate] = []
    seconds, processor = [], []
    first = 0
    for k in range(setup.WINDOWS):
        # A window is complete once the first sample behind it has come.
        last = (k + 1) * setup.SAMPLES + 1
        batch = {name: column[first:last] for name, column in data.columns.items()}
        begin, used, first = time.perf_counter(), time.process_time(), last
        windows += tracker.update(batch)
        if k + 1 == setup.WINDOWS:
            windows += tracker.finish()
        seconds.append(time.perf_counter() - begin)
        processor.append(time.process_time() - used)
    truth = tuple(data.truth(k) for k in range(setup.WINDOWS))
    return Following(method, tuple(windows), tuple(seconds), tuple(processor), truth)


def seeds(data: Run, velocity_limit: float, progress: Progress | None = None) -> Seeds:
    """Searches the first window from scratch with many seeds."""
    swarm = replace(setup.SWARM, velocity_limit=velocity_limit)
    histories = []
    for seed in range(1, setup.SEEDS + 1):
        histories.append(_one(data, swarm, seed).history)
        if progress is not None:
            progress(f"swarms with velocity limit {velocity_limit:g}", seed / setup.SEEDS)
    best = min(history[-1] for history in histories)
    return Seeds(
        velocity_limit,
        tuple(generations(history, history[-1]) for history in histories),
        tuple(generations(history, best) for history in histories),
    )


def generations(history: tuple[float, ...], final: float) -> int:
    """Generations until the cost is within `setup.CONVERGED` of `final`; -1 if it never is."""
    near = (k for k, cost in enumerate(history) if cost <= (1.0 + setup.CONVERGED) * final)
    return next(near, -1)


def _one(data: Run, swarm: Swarm, seed: int) -> WindowEstimate:
    tracker = _tracker(data, swarm, seed, "pso")
    (window,) = [*tracker.update(data.window(0)), *tracker.finish()]
    return window


def _tracker(data: Run, swarm: Swarm, seed: int, method: str) -> Tracker:
    return Tracker(
        data.machine,
        fit=setup.OFFLINE,
        window=setup.WINDOW,
        method=method,
        swarm=swarm,
        search=setup.SEARCH,
        seed=seed,
        load="unknown_constant",
    )
