"""What a log of a healthy machine can lack: coarse angle and currents, held, averaged or thinned rows,
filters, coloured noise.

None of it is physics of the motor.  Both runs of a case come from the same logger: its settings are drawn
from the case's seed.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from .parameters import Machine
from .plant import Run
from .reference import park

KINDS = ("coarse_angle", "counts", "held", "averaged", "thinned", "filtered", "coloured")
# rows that telemetry takes together or leaves out
ROWS = (2, 20)
# full scale of the current converter over the rated current: drives allow 1.5 times that current
FULL_SCALE = 2.0

Settings = dict[str, float]


def drawn(kind: str, seed: int) -> Settings:
    """Settings of a logger.  Raises ValueError for an unknown kind.

    coarse_angle: bits per mechanical turn, and the period in s of the difference that is the speed;
    counts: bits of the current converter; held, averaged, thinned: rows, and for held whether the speed
    alone is held; filtered: corners in Hz of the low pass of the speed and, where not zero, of the axis
    currents; coloured: correlation time in rows, and its rms over that of the white noise.
    """
    rng = np.random.default_rng([seed, 37])

    def log_uniform(low: float, high: float) -> float:
        return math.exp(rng.uniform(math.log(low), math.log(high)))

    if kind == "coarse_angle":
        return {"bits": float(rng.integers(8, 15)), "period": log_uniform(0.5e-3, 10e-3)}
    if kind == "counts":
        return {"bits": float(rng.integers(8, 13))}
    if kind == "held":
        return {"rows": float(rng.integers(*ROWS, endpoint=True)), "speed_alone": float(rng.integers(2))}
    if kind in ("averaged", "thinned"):
        return {"rows": float(rng.integers(*ROWS, endpoint=True))}
    if kind == "filtered":
        corner = log_uniform(10.0, 300.0)
        return {"speed_hz": corner, "current_hz": log_uniform(300.0, 3000.0) * float(rng.integers(2))}
    if kind == "coloured":
        return {"rows": log_uniform(3.0, 100.0), "times_noise": log_uniform(1.0, 5.0)}
    raise ValueError(f"no limit {kind!r}; there are {', '.join(KINDS)}")


def turn(v_d: np.ndarray, v_q: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same vector (n,) in a frame that is ahead by `angle` (n,) in rad."""
    c, s = np.cos(angle), np.sin(angle)
    return c * v_d + s * v_q, c * v_q - s * v_d


def first_order(x: np.ndarray, corner: float, f_sample: float) -> np.ndarray:
    """x (n,) through a first-order low pass with its corner in Hz, at rest on the first value."""
    a = math.exp(-2.0 * math.pi * corner / f_sample)
    return lfilter([1.0 - a], [1.0, -a], x, zi=np.array([a * x[0]]))[0]


def in_axes(log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The log with i_d and i_q in place of the phase currents, as telemetry of a drive has them."""
    i_d, i_q = park(log["i_a"], log["i_b"], log["i_c"], log["theta_e"])
    return {k: v for k, v in log.items() if k not in ("i_a", "i_b", "i_c")} | {"i_d": i_d, "i_q": i_q}


def limit(run: Run, kind: str, machine: Machine, seed: int, run_seed: int) -> Run:
    """The run as a limited logger would have kept it; its truth keeps the rows of the log.

    seed draws the logger, run_seed the noise of this run.  Voltages of a coarse angle are the same vectors in
    the coarse frame.  Raises ValueError for an unknown kind.
    """
    how = drawn(kind, seed)
    log, n, t_s = dict(run.log), len(run.t), 1.0 / machine.f_sample
    every = int(how.get("rows", 1))
    rows = np.arange(n)
    if kind == "coarse_angle":
        angle = np.unwrap(log["theta_e"]) / machine.n_p
        step = 2.0 * math.pi / 2 ** int(how["bits"])
        coarse = step * np.rint(angle / step)
        apart = max(1, round(how["period"] / t_s))
        at = rows - rows % apart
        before = np.maximum(at - apart, 0)
        # before the first difference the speed is that of the good sensor
        speed = np.where(
            at > 0, machine.n_p * (coarse[at] - coarse[before]) / (apart * t_s), log["omega_e"][0]
        )
        log["v_d"], log["v_q"] = turn(log["v_d"], log["v_q"], machine.n_p * (coarse - angle))
        theta = machine.n_p * coarse
        log["theta_e"] = theta - 2.0 * math.pi * np.rint(theta / (2.0 * math.pi))
        log["omega_e"] = speed
    elif kind == "counts":
        step = 2.0 * FULL_SCALE * machine.i_rated / 2 ** int(how["bits"])
        for name in ("i_a", "i_b", "i_c"):
            log[name] = step * np.rint(log[name] / step)
    elif kind == "held":
        at = rows - rows % every
        for name in ("omega_e",) if how["speed_alone"] else tuple(log):
            log[name] = log[name][at]
    elif kind == "averaged":
        log = in_axes(log)
        rows = rows[: n - n % every : every]
        for name in log:
            x = np.unwrap(log[name]) if name == "theta_e" else log[name]
            mean = x[: len(rows) * every].reshape(-1, every).mean(axis=1)
            if name == "theta_e":
                mean -= 2.0 * math.pi * np.rint(mean / (2.0 * math.pi))
            log[name] = np.repeat(mean, every)
    elif kind == "thinned":
        rows = rows[::every]
    elif kind == "filtered":
        log["omega_e"] = first_order(log["omega_e"], how["speed_hz"], machine.f_sample)
        if how["current_hz"]:
            log = in_axes(log)
            for name in ("i_d", "i_q"):
                log[name] = first_order(log[name], how["current_hz"], machine.f_sample)
    else:
        rng = np.random.default_rng([run_seed, 41])
        a = math.exp(-1.0 / how["rows"])
        noise = {
            "i_a": machine.noise_i,
            "i_b": machine.noise_i,
            "i_c": machine.noise_i,
            "omega_e": machine.noise_w,
        }
        for name, size in noise.items():
            drive = rng.standard_normal(n) * np.where(rows == 0, 1.0, math.sqrt(1.0 - a * a))
            log[name] = log[name] + how["times_noise"] * size * lfilter([1.0], [1.0, -a], drive)
    return replace(
        run,
        t=run.t[rows],
        log={k: v[rows] for k, v in log.items()},
        truth={k: v[rows] for k, v in run.truth.items()},
    )
