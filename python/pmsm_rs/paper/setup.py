"""The paper's experiment, and what had to be chosen because the paper does not say it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from ..config.swarm import Swarm

SAMPLES: Final = 3300
"""Samples of a window."""
WINDOWS: Final = 9
"""Windows of Fig. 8."""
RATE: Final = 100e3
"""Sampling frequency, Hz."""
WINDOW: Final = SAMPLES / RATE
"""Length of a window, s."""
SWARM: Final = Swarm(particles=10, iterations=30, inertia=0.8, cognitive=2.0, social=2.0, velocity_limit=0.05)
"""The paper's swarm; the velocity limit is a choice."""
SEARCH: Final = 0.2
"""Share of the last window's result within which the next one seeks."""
OFFLINE: Final = {"r_s": (0.085, 0.255), "tau_load": (2.4, 3.6)}
"""Bounds of the search without a result to start from."""
CONVERGED: Final = 0.01
"""A search has converged once its cost is within this share of its last."""
PAPER_GENERATIONS: Final = 20
"""Generations within which the paper's search converges."""
SEEDS: Final = 100
"""Searches from which the share of successes is counted."""

_TURN = 2.0 * math.pi / 0.3


def _schedule(f: Callable[[float], float]) -> dict[str, list[float]]:
    t = [0.0005 * k for k in range(601)]
    return {"t": t, "value": [f(x) for x in t]}


def _speed(t: float) -> float:
    return 80.0 + 8.0 * math.sin(_TURN * t) + 3.0 * math.sin(2.0 * math.pi * 27.0 * t)


def drive() -> dict[str, Any]:
    """The configuration of the drive of Fig. 4, as `pmsm_rs.simulate` takes it."""
    return {
        "duration": WINDOWS * WINDOW,
        "settle": 0.3,
        "seed": 1,
        "machine": "liu_2008",
        "drive": {"f_sample": RATE, "inverter": "averaged"},
        "control": {"speed_bandwidth": 40.0},
        "sensors": {"noise_i": 0.05, "noise_omega_e": 0.1},
        "reference": {"omega_m": _schedule(_speed)},
        "load": {"tau": 3.0, "kind": "unknown_constant"},
        "drift": {
            "r_s": _schedule(lambda t: 0.185 - 0.023 * math.cos(0.5 * _TURN * t)),
            "j": _schedule(lambda t: 0.008 * (1.0 + 0.005 * math.sin(0.5 * _TURN * t))),
            "b": _schedule(lambda t: 0.00115 * (1.0 + 0.4 * math.sin(_TURN * t))),
        },
    }
