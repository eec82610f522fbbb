"""The channels of an oscilloscope as space vectors: which phase each measures, and against what."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from .._core import DataError
from ..errors import refuse
from ..results.words import listed
from .formats.remark import Remark
from .rotation import Vector, vector

Columns = dict[str, NDArray[np.float64]]

VOLTAGES: Final = ("v_a", "v_b", "v_c")
CURRENTS: Final = ("i_a", "i_b", "i_c")
TOLD: Final = 0.02
"""Share of the amplitude from which a channel's gain or offset is told."""
_FEWEST_MEANS: Final = 100
"""Means of which a correlation is taken at least."""
_APART: Final = 0.25
"""Largest distance of the correlation of two channels from -1/2, or from 1/2.

Two phases a third of a turn apart have -1/2, two that are measured against the third phase have 1/2.
"""


def has_three(columns: Columns) -> bool:
    """Whether each of the three voltages has a channel of its own."""
    return all(name in columns and np.any(columns[name]) for name in VOLTAGES)


def voltage(columns: Columns, is_open: bool, file: str | None) -> tuple[Vector, list[Remark]]:
    """The space vector of the voltages, and what was taken for granted with it."""
    have: list[str] = [name for name in VOLTAGES if name in columns]
    alive: list[str] = [name for name in have if np.ptp(columns[name]) > 0.0]
    if len(alive) < 2:
        raise refuse(
            DataError,
            "neither angle nor speed was logged, and the voltage of one channel does not tell in which "
            "direction the rotor turns",
            file=file,
            column=(alive or have)[0],
            fix="record two phase voltages at least, or the speed",
        )
    if len(alive) == 3:
        return vector(*(columns[name] for name in VOLTAGES)), []
    lost = next(name for name in VOLTAGES if name not in alive)
    one, other = (columns[name] for name in alive)
    alike = _relation(one, other)
    if lost not in have:
        return _to_star_point(columns, alive, lost, alike, file)
    # Both are against the third, and a sixth of a turn apart.
    if abs(alike - 0.5) > _APART:
        raise refuse(
            DataError,
            f"{listed(alive)} are not a sixth of a turn apart, as voltages against one phase are, though "
            f"{lost} is said to be zero",
            file=file,
            column=alive[0],
            fix=f"check the probes, or leave {lost} out if the voltages are those to the star point",
        )
    remarks = [
        Remark(
            f"{listed(alive)} were measured against one phase, {lost}.",
            "What all three phases have in common, such as a third harmonic, is not in them.",
            "Measure to the star point if it can be reached.",
        )
    ]
    gains = {lost: 1.0} | dict.fromkeys(alive, 1.0)
    if is_open:
        sizes = [float(np.std(x)) for x in (one, other)]
        middle = float(np.sqrt(sizes[0] * sizes[1]))
        gains |= {name: size / middle for name, size in zip(alive, sizes, strict=True)}
        if abs(sizes[0] / sizes[1] - 1.0) > TOLD:
            remarks.append(
                Remark(
                    f"{alive[0]} is {sizes[0] / sizes[1]:.4f} times as large as {alive[1]}.",
                    "Both were brought to their mean: the phases of a motor without a fault are alike.",
                    "Check the scales of the probes.",
                )
            )
    return vector(*(columns[name] / gains[name] for name in VOLTAGES)), remarks


def _relation(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """The correlation of two channels, over the means that take out their switching ripple best: ripple
    brings it away from one half on either side.
    """
    found = []
    length = 1
    while length == 1 or len(one) // length >= _FEWEST_MEANS:
        count = len(one) // length
        means = [x[: count * length].reshape(count, length).mean(axis=1) for x in (one, other)]
        if all(np.ptp(x) > 0.0 for x in means):
            found.append(float(np.corrcoef(*means)[0, 1]))
        length *= 2
    return min(found, key=lambda alike: abs(abs(alike) - 0.5))


def _to_star_point(
    columns: Columns, alive: list[str], lost: str, alike: float, file: str | None
) -> tuple[Vector, list[Remark]]:
    names = listed(alive)
    if abs(alike - 0.5) < _APART:
        raise refuse(
            DataError,
            f"{names} are a sixth of a turn apart, as voltages against the third phase are, and not a third "
            "of one, as those of two phases",
            file=file,
            column=alive[0],
            fix=f"if they are measured against the third phase write {lost} = {{ value = 0.0 }} in "
            "[columns]; if not, turn one of the probes round with scale = -1",
        )
    if abs(alike + 0.5) > _APART:
        raise refuse(
            DataError,
            f"{names} are not a third of a turn apart, as the voltages of two phases are",
            file=file,
            column=alive[0],
            fix="check the probes, or record all three phase voltages",
        )
    whole = {name: columns[name] for name in alive}
    whole[lost] = -sum(whole.values())  # type: ignore[assignment]
    remark = Remark(
        f"{lost} was not recorded: it follows from {names}, as voltages to the star point add up to nothing.",
        "If they were measured between phases, psi_m is too large by the square root of three; a third "
        f"harmonic would be taken for one of {lost}.",
        "Record the third voltage as well.",
    )
    return vector(*(whole[name] for name in VOLTAGES)), [remark]


def current(columns: Columns, alive: list[str], file: str | None) -> Vector:
    """The space vector of the currents in A, shape (rows,), from two or three phases that are `alive`.

    Raises DataError where there is only one.
    """
    if len(alive) < 2:
        raise refuse(
            DataError,
            f"{alive[0]} is the only phase current, and neither angle nor speed was logged; the flux "
            "linkage, from which they could be taken, needs two",
            file=file,
            column=alive[0],
            fix="record two phase currents, or the angle",
        )
    whole = {name: columns[name] for name in alive}
    for lost in {*CURRENTS} - {*alive}:
        whole[lost] = -sum(whole.values())  # type: ignore[assignment]
    return vector(*(whole[name] for name in CURRENTS))
