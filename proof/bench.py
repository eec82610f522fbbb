"""What a real bench does to a log: noisy voltages, slow loggers, missing channels, filters, gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from .parameters import Machine
from .plant import Run

KINDS = ("voltage_noise", "noisy", "decimated", "two_currents", "speed_filter", "gaps", "short")
# share of v_dc, rms per axis: a measured instead of a commanded voltage
VOLTAGE_NOISE = 0.0025
EXTRA_NOISE = 3.0
EVERY = 5
FILTER_HZ = 250.0


def degrade(run: Run, kind: str, machine: Machine, seed: int) -> Run:
    """The run as a lesser logger would have kept it; its truth keeps the rows of the log.

    voltage_noise: white noise of 0.25 % of v_dc on both axes; noisy: √10 times the currents' and the speed's
    noise; decimated: every fifth row, voltages averaged over the rows left out; two_currents: no i_c;
    speed_filter: first-order low pass of 250 Hz; gaps: three stretches of 2 % each are missing; short: the
    first fifth.  Raises ValueError for an unknown kind.
    """
    rng = np.random.default_rng([seed, 31])
    log, n = dict(run.log), len(run.t)
    rows = np.arange(n)
    if kind == "voltage_noise":
        for name in ("v_d", "v_q"):
            log[name] = log[name] + VOLTAGE_NOISE * machine.v_dc * rng.standard_normal(n)
    elif kind == "noisy":
        for name in ("i_a", "i_b", "i_c"):
            log[name] = log[name] + EXTRA_NOISE * machine.noise_i * rng.standard_normal(n)
        log["omega_e"] = log["omega_e"] + EXTRA_NOISE * machine.noise_w * rng.standard_normal(n)
    elif kind == "decimated":
        rows = rows[: n - n % EVERY : EVERY]
        for name in ("v_d", "v_q"):
            mean = log[name][: len(rows) * EVERY].reshape(-1, EVERY).mean(axis=1)
            log[name] = np.repeat(mean, EVERY)
    elif kind == "two_currents":
        del log["i_c"]
    elif kind == "speed_filter":
        a = np.exp(-2.0 * np.pi * FILTER_HZ / machine.f_sample)
        start = np.array([a * log["omega_e"][0]])
        log["omega_e"] = lfilter([1.0 - a], [1.0, -a], log["omega_e"], zi=start)[0]
    elif kind == "gaps":
        keep = np.ones(n, bool)
        for at in rng.uniform(0.1, 0.9, 3):
            keep[int(at * n) : int((at + 0.02) * n)] = False
        rows = rows[keep]
    elif kind == "short":
        rows = rows[: n // 5]
    else:
        raise ValueError(f"no bench {kind!r}; there are {', '.join(KINDS)}")
    return replace(
        run,
        t=run.t[rows],
        log={k: v[rows] for k, v in log.items()},
        truth={k: v[rows] for k, v in run.truth.items()},
    )
