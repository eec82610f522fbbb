"""Real-time factor and memory of the tracker, through the Python call of the installed wheel.

    python benches/track.py

10 000 windows are fed one by one and the resident memory is read on the way. Then ten seconds of the drive of
Fig. 4 of Liu, Liu & Cartes (2008) at 100 kHz are tracked by warm least squares and two of them by the paper's
swarm. Wall time is that of this machine as it is loaded now.
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np
import pmsm_rs as pm
from numpy.typing import NDArray

RATE = 100e3
WINDOW = 0.033
ROUNDS = 10_000
SLOW_RATE = 10e3

Columns = dict[str, NDArray[np.float64]]


def drive(duration: float, rate: float) -> tuple[pm.Machine, Columns]:
    """A log of the drive with a speed that swings and a winding that warms up."""
    t = np.linspace(0.0, duration, int(20 * duration) + 2)
    done = pm.simulate(
        duration=duration,
        settle=0.3,
        seed=1,
        machine="liu_2008",
        drive={"f_sample": rate},
        sensors={"noise_i": 0.05, "noise_omega_e": 0.1},
        reference={"omega_m": {"t": t.tolist(), "value": (80.0 + 8.0 * np.sin(20.0 * t)).tolist()}},
        load={"tau": 3.0, "kind": "unknown_constant"},
        drift={"r_s": {"t": [0.0, duration], "value": [0.17, 0.20]}},
    )
    return done.machine, {name: done.recording.column(name) for name in done.recording.names}


def speed(machine: pm.Machine, columns: Columns, method: str, duration: float) -> None:
    """Prints the real-time factor of one pass."""
    rows = int(duration * RATE)
    part = {name: column[:rows] for name, column in columns.items()}
    for threads in (1, None):
        begin, cpu = time.perf_counter(), time.process_time()
        windows = [w for w in pm.track(part, machine, method=method, threads=threads) if w.parameters]
        wall, cpu = time.perf_counter() - begin, time.process_time() - cpu
        print(
            f"{method:4}  {threads or 'all':>3} threads  {len(windows):4} windows  per window "
            f"{1e3 * wall / len(windows):6.2f} ms wall, {1e3 * cpu / len(windows):6.2f} ms processor  "
            f"real-time factor {duration / wall:6.2f} ({duration / cpu:.2f} by processor time)"
        )


def memory(machine: pm.Machine, columns: Columns) -> None:
    """Prints the largest resident memory on the way through many windows."""
    per = int(WINDOW * SLOW_RATE)
    tracker = pm.Tracker(machine, window=WINDOW)
    whole = len(columns["t"]) // per
    for k in range(ROUNDS):
        rows = slice(k % whole * per, (k % whole + 1) * per)
        batch = {name: column[rows].copy() for name, column in columns.items()}
        batch["t"] = (np.arange(per) + k * per) / SLOW_RATE
        tracker.update(batch)
        if k + 1 in (100, 1000, ROUNDS // 2, ROUNDS):
            largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (
                1 << (20 if sys.platform == "darwin" else 10)
            )
            state = len(tracker.state())
            print(f"{k + 1:6} windows  largest resident memory {largest:7.1f} MiB  state {state} bytes")


def main() -> None:
    """Both."""
    machine, columns = drive(3.3, SLOW_RATE)
    memory(machine, columns)
    machine, columns = drive(10.0, RATE)
    speed(machine, columns, "lm", 10.0)
    speed(machine, columns, "pso", 2.0)


if __name__ == "__main__":
    main()
