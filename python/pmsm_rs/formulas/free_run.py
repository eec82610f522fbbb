"""Free runs: the speed that torques make over short windows, each from an initial speed of its own.

The torques are those along the recorded motion. Friction that falls with the speed makes a motor unstable,
and its drive holds it. A simulation that follows its own speed without that drive would run away there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Length of a free run, s, as in the diagnosis, and its rows at least.
_WINDOW, _ROWS = 0.25, 8


def free_runs(t: Array) -> Sequence[NDArray[np.intp]]:
    """The rows of each free run."""
    usual = float(np.median(np.diff(t)))
    number = np.floor((t - t[0]) / max(_WINDOW, _ROWS * usual)).astype(int)
    return np.split(np.arange(len(t)), np.flatnonzero(np.diff(number)) + 1)


def gained(t: Array, acceleration: Array) -> Array:
    """The speed gained in each free run, its mean taken out as the initial speed is estimated."""
    steps: Array = 0.5 * (acceleration[1:] + acceleration[:-1]) * np.diff(t)
    return centred(t, np.concatenate([[0.0], np.cumsum(steps)]))


def centred(t: Array, values: Array) -> Array:
    """The values without the mean of each free run."""
    out = np.empty_like(values)
    for rows in free_runs(t):
        out[rows] = values[rows] - values[rows].mean()
    return out
