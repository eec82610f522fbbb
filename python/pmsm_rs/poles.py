"""The number of pole pairs, where electrical and mechanical motion are both recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

_PAIRS: Final = (
    ("theta_e", "theta_m"),
    ("omega_e", "omega_m"),
    ("theta_e", "omega_m"),
    ("omega_e", "theta_m"),
)
"""Which electrical column is compared with which mechanical one, the surest first."""
_LEAST: Final = 0.5
"""rad that the rotor must turn electrically before the two are compared."""
_FITS: Final = 0.02
"""Share of the electrical turn that the mechanical one may leave unexplained, rms."""
_WHOLE: Final = 0.03
"""Share of itself by which a number of pole pairs may miss a whole one."""
_MOST: Final = 200


class PolePairs(NamedTuple):
    """How many times as fast `electrical` turns as `mechanical`, and the whole number that this is."""

    electrical: str
    mechanical: str
    ratio: float
    n_p: int


def pole_pairs(columns: Mapping[str, NDArray[np.float64]]) -> PolePairs | None:
    """The pole pairs that the canonical SI `columns`, each of shape (samples,), show; None where they do not,
    or where the ratio is not close to a whole number.
    """
    for electrical, mechanical in _PAIRS:
        if {electrical, mechanical, "t"} <= {*columns}:
            given = (columns[electrical], columns[mechanical], columns["t"])
            if len({len(values) for values in given}) > 1 or len(given[0]) < 2:
                continue
            known = np.logical_and.reduce([np.isfinite(values) for values in given])
            t = given[2][known]
            ratio = _ratio(_turn(electrical, given[0][known], t), _turn(mechanical, given[1][known], t))
            if ratio is not None and 1 <= round(ratio) <= _MOST:
                n_p = round(ratio)
                if abs(ratio - n_p) <= min(_WHOLE * n_p, 0.25):
                    return PolePairs(electrical, mechanical, ratio, n_p)
    return None


def _turn(name: str, values: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """The angle turned, rad, of an angle or a speed."""
    if name.startswith("theta"):
        return np.unwrap(values)
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(t)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _ratio(electrical: NDArray[np.float64], mechanical: NDArray[np.float64]) -> float | None:
    """How many times as far the first turns as the second, None where one does not follow the other."""
    if len(electrical) < 2:
        return None
    e, m = electrical - electrical.mean(), mechanical - mechanical.mean()
    power = float(m @ m)
    if power == 0.0 or not np.isfinite(power) or np.ptp(e) < _LEAST:
        return None
    ratio = float(e @ m) / power
    rest = e - ratio * m
    return ratio if float(rest @ rest) <= _FITS**2 * float(e @ e) else None
