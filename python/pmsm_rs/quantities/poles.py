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


_ELECTRICAL: Final = ("theta_e", "omega_e")
_MECHANICAL: Final = ("theta_m", "omega_m")
_DOUBTFUL: Final = "doubtful"
"""Name of a column of which it is to be found what it is."""


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
            found = _compared(columns, electrical, mechanical)
            if found is not None:
                return found
    return None


class Frame(NamedTuple):
    """What a doubtful column is: the canonical name, and the motion that tells.

    With them come how many times as fast the electrical one of the two turns, and the pole pairs, None where
    both are of one kind.
    """

    name: str
    beside: str
    ratio: float
    n_p: int | None


def frame_of(
    values: NDArray[np.float64], quantity: str, columns: Mapping[str, NDArray[np.float64]]
) -> Frame | None:
    """Whether a `quantity`, angle or speed, of SI `values`, shape (samples,), is electrical or mechanical, by
    the motion in the canonical SI `columns`. None where they do not tell.
    """
    stem = "theta" if quantity == "angle" else "omega"
    for beside in (name for name in (*_ELECTRICAL, *_MECHANICAL) if {name, "t"} <= {*columns}):
        own, other = ("e", "m") if beside in _ELECTRICAL else ("m", "e")
        pair = (beside, _DOUBTFUL) if own == "e" else (_DOUBTFUL, beside)
        found = _compared({**columns, _DOUBTFUL: values}, *pair, angle=quantity == "angle")
        if found is not None:
            same = found.n_p == 1
            return Frame(f"{stem}_{own if same else other}", beside, found.ratio, None if same else found.n_p)
    return None


def _compared(
    columns: Mapping[str, NDArray[np.float64]], electrical: str, mechanical: str, *, angle: bool = False
) -> PolePairs | None:
    """The pole pairs by two columns; `angle` says whether a doubtful one is an angle."""
    given = (columns[electrical], columns[mechanical], columns["t"])
    if len({len(values) for values in given}) > 1 or len(given[0]) < 2:
        return None
    known = np.logical_and.reduce([np.isfinite(values) for values in given])
    t = given[2][known]
    turns = [
        _turn(values[known], t, angle=angle if name == _DOUBTFUL else name.startswith("theta"))
        for name, values in zip((electrical, mechanical), given, strict=False)
    ]
    ratio = _ratio(*turns)
    if ratio is None or not 1 <= round(ratio) <= _MOST:
        return None
    n_p = round(ratio)
    close = abs(ratio - n_p) <= min(_WHOLE * n_p, 0.25)
    return PolePairs(electrical, mechanical, ratio, n_p) if close else None


def _turn(values: NDArray[np.float64], t: NDArray[np.float64], *, angle: bool) -> NDArray[np.float64]:
    """The angle turned, rad, of an angle or else of a speed."""
    if angle:
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
