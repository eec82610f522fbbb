"""What a trajectory file leaves on the validation run, computed here and never taken from the answer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from .reference import park

CHANNELS = ("i_d", "i_q", "omega_e")
# a free run below the noise, or one that follows it, was not simulated
COPIED_BELOW, COPIED_CORRELATION = 0.9, 0.15


@dataclass(frozen=True)
class HeldOut:
    """Residual of the worst channel before and after over the least that true equations leave, after over the
    noise, and whether measurements were copied; None where the trajectories have no channel of them."""

    before: float | None
    after: float | None
    remaining: float | None
    copied: bool


def columns(path: Path) -> dict[str, np.ndarray]:
    """A parquet file as float64 arrays (n,)."""
    table = pq.read_table(path)
    return {name: table[name].to_numpy().astype(float) for name in table.column_names}


def held_out(
    trajectories: dict[str, np.ndarray],
    measured: dict[str, np.ndarray],
    clean: dict[str, np.ndarray],
    least: dict[str, float],
    noise: dict[str, float],
) -> HeldOut:
    """Judge trajectories of a validation run.

    measured: the validation log; clean: its a, b, c and omega without noise; least: the rms that true
    equations leave per channel; noise: that of the sensors.
    """
    theta = measured["theta_e"]
    truth = dict(zip(CHANNELS[:2], park(clean["a"], clean["b"], clean["c"], theta), strict=True))
    seen = dict(
        zip(CHANNELS[:2], park(measured["i_a"], measured["i_b"], measured["i_c"], theta), strict=True)
    )
    truth["omega_e"], seen["omega_e"] = clean["omega"], measured["omega_e"]
    worst: dict[str, float | None] = {"before": None, "after": None}
    remaining: float | None = None
    copied = False
    for when in worst:
        for channel in CHANNELS:
            model = trajectories.get(f"{channel}_{when}")
            if model is None or not np.isfinite(model).any():
                continue
            if len(model) != len(theta):
                model = np.interp(measured["t"], trajectories["t"], model, left=np.nan, right=np.nan)
            ok = np.isfinite(model)
            rms = float(np.sqrt(np.mean((seen[channel] - model)[ok] ** 2)))
            worst[when] = max(rms / least[channel], worst[when] or 0.0)
            if when == "after":
                remaining = max(rms / noise[channel], remaining or 0.0)
            if when == "after" and ok.mean() > 0.5:
                error_of_sensor, error = (seen[channel] - truth[channel])[ok], (model - truth[channel])[ok]
                follows = error.std() > 0.0 and (
                    np.corrcoef(error_of_sensor, error)[0, 1] > COPIED_CORRELATION
                )
                below = rms < COPIED_BELOW * np.sqrt(np.mean(error_of_sensor**2))
                copied = copied or bool(below or follows)
    return HeldOut(worst["before"], worst["after"], remaining, copied)
