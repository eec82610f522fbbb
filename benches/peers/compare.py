"""Measures the installed package against its strongest peers in one run, in turns, and prints the ratios.

    python benches/peers/compare.py [J1 J2 J3 LS tracker import JAX field] [--rounds N]

JAX and field, the field's own simulators, need `jax`, and `motulator` and `gym-electric-motor`.

Every time is CPU time of the whole process, the median over the rounds; peers take turns within a round, so
that whatever else the computer does hits all of them. Short jobs are called several times in a row as well.
The package is called as a user calls it: arrays in, answer out.
"""

from __future__ import annotations

import argparse
import gc
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import fast_numba
import numpy as np
import pmsm_rs as pm
from scipy.optimize import least_squares
from window import (
    HIGH,
    INERTIA,
    ITERATIONS,
    J1,
    J2,
    LOW,
    NAMES,
    PERIOD,
    PULL,
    SAMPLES,
    TRUTH,
    Array,
    Job,
    measured,
)

MACHINE = pm.Machine(n_p=4, **dict(zip(NAMES[:6], map(float, TRUTH[:6]), strict=True)))
LONG = 10_000_000
WINDOWS = 30


def bounds(job: Job) -> dict[str, tuple[float, float]]:
    """What `identify` is to fit, with its bounds."""
    return {NAMES[k]: (float(LOW[k]), float(HIGH[k])) for k in job.fitted}


def swarm(
    job: Job, columns: dict[str, Array], threads: int, *, uncertainties: bool = True
) -> Callable[[], float]:
    """The package's swarm, from arrays to the answer, with its uncertainties or without them."""
    settings = pm.Swarm(job.particles, ITERATIONS, inertia=INERTIA, cognitive=PULL, social=PULL)

    def call() -> float:
        recording = pm.Recording(columns, load="unknown_constant")
        fit = pm.identify(
            recording,
            MACHINE,
            fit=bounds(job),
            method="pso",
            swarm=settings,
            seed=1,
            uncertainties=uncertainties,
            threads=threads,
        )
        return fit.cost

    return call


def descent(columns: dict[str, Array], *, uncertainties: bool = True) -> Callable[[], float]:
    """The package's least squares, from arrays to the answer, with its uncertainties or without."""
    middle = {NAMES[k]: float(LOW[k] + HIGH[k]) / 2 for k in J1.fitted if k < 6}
    machine = pm.Machine(n_p=4, **{name: middle.get(name, getattr(MACHINE, name)) for name in NAMES[:6]})

    def call() -> float:
        recording = pm.Recording(columns, load="unknown_constant")
        fit = pm.identify(
            recording, machine, fit=bounds(J1), method="lm", uncertainties=uncertainties, threads=1
        )
        return fit.cost

    return call


def scipy_descent(columns: dict[str, Array]) -> Callable[[], float]:
    """scipy.optimize.least_squares on the compiled residual."""
    fitted = np.array(J1.fitted)
    low, high = LOW[fitted], HIGH[fitted]
    rest = (fitted, TRUTH, *fast_numba.data(columns))

    def call() -> float:
        found = least_squares(
            fast_numba.residual, (low + high) / 2, bounds=(low, high), x_scale=high - low, args=rest
        )
        return 2 * float(found.cost)

    return call


def long_run(columns: dict[str, Array]) -> Callable[[], float]:
    """One parameter set on a long recording that is already loaded."""
    fitness = pm.Fitness(pm.Recording(columns, load="unknown_constant"), MACHINE, NAMES, threads=1)
    return lambda: float(fitness(TRUTH[None, :])[0])


def long_numba(columns: dict[str, Array]) -> Callable[[], float]:
    """The same, compiled by numba."""
    rest = fast_numba.data(columns)
    return lambda: float(fast_numba.trajectory(TRUTH, *rest))


def summed(columns: dict[str, Array]) -> Callable[[], float]:
    """About what memory takes to bring the numbers that such a run reads."""
    read = [column for name, column in columns.items() if name != "t"]
    return lambda: float(sum(column.sum() for column in read))


def tracked(columns: dict[str, Array], method: str) -> Callable[[], float]:
    """The package's tracker over a log: windows cut, identified from the last one's result, and compared."""
    length = SAMPLES * PERIOD

    def call() -> float:
        log = pm.Recording(columns, load="unknown_constant")
        windows = list(pm.track(log, MACHINE, fit=bounds(J1), method=method, window=length, threads=1))
        return windows[WINDOWS - 1].cost or float("nan")

    return call


def every_window(
    columns: dict[str, Array], run: Callable[[dict[str, Array]], Callable[[], float]]
) -> Callable[[], float]:
    """A peer's search on each window of a log by itself, its arrays cut beforehand."""
    cuts = (slice(k * SAMPLES, (k + 1) * SAMPLES) for k in range(WINDOWS))
    calls = [run({name: column[cut].copy() for name, column in columns.items()}) for cut in cuts]
    return lambda: [call() for call in calls][-1]


def alternate(title: str, contestants: dict[str, Callable[[], float]], rounds: int) -> None:
    """Runs all in turn and prints CPU time, wall time and the ratio of the last to each."""
    for call in contestants.values():
        call()
    cpu: dict[str, list[float]] = {name: [] for name in contestants}
    wall: dict[str, list[float]] = {name: [] for name in contestants}
    answer: dict[str, float] = {}
    gc.disable()
    for _ in range(rounds):
        for name, call in contestants.items():
            begun, began = time.process_time(), time.perf_counter()
            answer[name] = call()
            cpu[name].append(time.process_time() - begun)
            wall[name].append(time.perf_counter() - began)
    gc.enable()
    reference = list(contestants)[-1]
    print(f"{title}, {rounds} rounds")
    for name in contestants:
        own = statistics.median(cpu[name])
        ratios = (theirs / ours for theirs, ours in zip(cpu[reference], cpu[name], strict=True))
        print(
            f"  {name:44} {1e3 * own:10.3f} ms CPU {1e3 * statistics.median(wall[name]):10.3f} ms wall"
            f"  {statistics.median(ratios):6.2f}x  cost {answer[name]:.6g}"
        )


def in_a_row(title: str, contestants: dict[str, Callable[[], float]], blocks: int, calls: int) -> None:
    """Runs each several times in a row, in turns of such blocks, and prints wall time and the ratio of the
    last to each.

    The first call of a block does not count: it finds the caches as another one left them, and after a pause
    the system may take as long as a short call to put a second thread on a processor of its own.
    """
    wall: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(blocks):
        for name, call in contestants.items():
            call()
            for _ in range(calls):
                began = time.perf_counter()
                call()
                wall[name].append(time.perf_counter() - began)
    reference = statistics.median(wall[list(contestants)[-1]])
    print(f"{title}, called in a row, {blocks} blocks of {calls} calls")
    for name in contestants:
        own = statistics.median(wall[name])
        print(f"  {name:44} {1e3 * own:31.3f} ms wall  {reference / own:6.2f}x")


def startup() -> None:
    """Time to import the package and to print the help."""
    for title, command in (
        ("python -c pass", [sys.executable, "-c", "pass"]),
        ("import pmsm_rs", [sys.executable, "-c", "import pmsm_rs"]),
        ("pmsm-rs --help", [str(Path(sys.executable).with_name("pmsm-rs")), "--help"]),
    ):
        cpu, wall = [], []
        for _ in range(11):
            before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            wall.append(time.perf_counter() - began)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            cpu.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        least, middle = 1e3 * min(wall), 1e3 * statistics.median(cpu)
        print(f"  {title:44} {middle:10.3f} ms CPU {least:10.3f} ms wall (least)")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("jobs", nargs="*", default=["J1", "J2", "J3", "LS", "tracker", "import"])
    parser.add_argument("--rounds", type=int, default=0, help="repetitions (default: enough for a median)")
    asked = parser.parse_args()
    columns = measured()
    if "J1" in asked.jobs:
        contestants = {
            "pmsm_rs.identify, one thread": swarm(J1, columns, 1),
            "the same without uncertainties": swarm(J1, columns, 1, uncertainties=False),
            "numba, whole swarm compiled": fast_numba.run(J1, columns),
        }
        alternate("J1: 10 particles x 31, 2 parameters, 3300 samples", contestants, asked.rounds or 51)
        in_a_row("J1", contestants, asked.rounds or 5, calls=40)
    if "J2" in asked.jobs:
        own = {
            "pmsm_rs.identify, two threads": swarm(J2, columns, 2),
            "pmsm_rs.identify, one thread": swarm(J2, columns, 1),
        }
        numba = {"numba, whole swarm compiled": fast_numba.run(J2, columns)}
        alternate("J2: 1000 particles x 31, 7 parameters, 3300 samples", own | numba, asked.rounds or 11)
        in_a_row("J2", own, asked.rounds or 5, calls=4)
    if "LS" in asked.jobs:
        contestants = {
            "pmsm_rs.identify, one thread": descent(columns),
            "the same without uncertainties": descent(columns, uncertainties=False),
            "scipy.optimize.least_squares, numba residual": scipy_descent(columns),
        }
        alternate("Least squares, 2 parameters, 3300 samples", contestants, asked.rounds or 51)
        in_a_row("Least squares", contestants, asked.rounds or 5, calls=40)
    if "tracker" in asked.jobs:
        log = measured(WINDOWS * SAMPLES)
        for method, name, peer in (
            ("lm", "scipy.optimize.least_squares, numba residual", scipy_descent),
            ("pso", "numba, whole swarm compiled", lambda cut: fast_numba.run(J1, cut)),
        ):
            alternate(
                f"Tracker, {WINDOWS * SAMPLES * PERIOD:.2f} s in {WINDOWS} windows",
                {f"pmsm_rs.track, {method}, one thread": tracked(log, method), name: every_window(log, peer)},
                asked.rounds or 11,
            )
    if "J3" in asked.jobs:
        long = measured(LONG)
        contestants = {
            "pmsm_rs.Fitness, one thread": long_run(long),
            "numpy, its five columns merely summed": summed(long),
            "numba, fastmath": long_numba(long),
        }
        alternate("J3: one parameter set, ten million samples", contestants, asked.rounds or 7)
    if "JAX" in asked.jobs:
        import jax_swarm

        for job, title, rounds in ((J1, "J1 against JAX", 11), (J2, "J2 against JAX", 3)):
            alternate(
                title,
                {
                    "pmsm_rs.identify, one thread": swarm(job, columns, 1),
                    "JAX, whole swarm compiled": jax_swarm.run(job, columns),
                },
                asked.rounds or rounds,
            )
    if "field" in asked.jobs:
        import field

        for title, call in (
            ("motulator 0.5, scipy's solve_ivp", field.motulator(columns)),
            ("gym-electric-motor 3, its scipy solver", field.gym(columns)),
        ):
            alternate(
                "One parameter set, 3300 samples",
                {"pmsm_rs.Fitness, one thread": long_run(columns), title: call},
                asked.rounds or 5,
            )
    if "import" in asked.jobs:
        print("Start-up, 11 rounds")
        startup()


if __name__ == "__main__":
    main()
