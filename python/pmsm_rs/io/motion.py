"""What the motion in a file tells before a diagnosis: a rotor that stands, pole pairs, doubtful columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .._core import Machine
from ..config.machine_file import MachineFile
from ..errors import shown
from ..quantities.poles import Frame, PolePairs, frame_of
from ..quantities.units import UNITS
from .formats.source import Source
from .signals import Signal

Columns = Mapping[str, NDArray[np.float64]]

_STILL: Final = 0.05
"""rad within which a rotor stands."""
_DOUBTS: Final = {
    frozenset({"theta_e", "theta_m"}): "angle",
    frozenset({"omega_e", "omega_m"}): "speed",
}
"""What a column is that may be one of two."""


def stands(columns: Columns) -> bool:
    """Whether the rotor stands, as far as angle or speed tell."""
    for name in ("theta_m", "theta_e"):
        values = columns.get(name, np.empty(0))
        values = values[np.isfinite(values)]
        if values.size:
            return bool(np.ptp(np.unwrap(values)) < _STILL)
    for name in ("omega_m", "omega_e"):
        if name in columns and len(columns[name]) == len(columns.get("t", ())) > 1:
            speed = np.nan_to_num(columns[name])
            return bool(np.ptp(np.cumsum(speed[:-1] * np.diff(columns["t"]))) < _STILL)
    return False


def settled(found: Iterable[Signal], source: Source, raw: Columns, columns: Columns) -> dict[str, Frame]:
    """What columns of the file are that may be electrical or mechanical, by their names, where another motion
    tells.

    `raw` has the values of the file by the names in `source`, `columns` the canonical SI columns; all are of
    shape (rows,).
    """
    out = {}
    names = {source.header(column): column for column in raw}
    for signal in found:
        quantity = _DOUBTS.get(frozenset(line.partition(" =")[0] for line in signal.use))
        if quantity is None or signal.column not in names:
            continue
        unit = UNITS[quantity].get(signal.unit or "")
        if unit is not None:
            frame = frame_of(raw[names[signal.column]] * unit.factor, quantity, columns)
            if frame is not None:
                out[signal.column] = frame
    return out


def of_frames(frames: Mapping[str, Frame]) -> list[dict[str, str]]:
    """Findings on the columns that are `settled`."""
    out = []
    for name, frame in frames.items():
        column, is_slower = f"'{shown(name)}'", frame.name.endswith("_m")
        one, other = (frame.beside, column) if is_slower else (column, frame.beside)
        fast = f"{frame.ratio:.4g} times as fast as"
        pairs = "" if frame.n_p is None else f", with {frame.n_p} pole pairs"
        out.append(
            {
                "finding": f"{column} turns as fast as {frame.beside}."
                if frame.n_p is None
                else f"{one} turns {fast} {other}.",
                "consequence": f"{column} is {'mechanical' if is_slower else 'electrical'}{pairs}.",
                "fix": f"Take its line {frame.name} in [columns] of the machine file.",
            }
        )
    return out


def of_motion(
    described: MachineFile | Machine | None,
    pairs: PolePairs | None,
    load: str | None,
    *,
    still: bool,
) -> list[dict[str, str]]:
    """Findings on the motion: a rotor that stands, and pole pairs that are not those of the machine file."""
    out = []
    known = described.machine if isinstance(described, MachineFile) else described
    if still and load != "locked":
        out.append(
            {
                "finding": f"The rotor turns by less than {_STILL:g} rad in all.",
                "consequence": "No question about the motion can be answered.",
                "fix": 'If the rotor was held, write kind = "locked" in [load].',
            }
        )
    if known is not None and pairs is not None and pairs.n_p != known.n_p:
        out.append(
            {
                "finding": f"{pairs.electrical} turns {pairs.ratio:.4g} times as fast as {pairs.mechanical}, "
                f"and the machine file says n_p = {known.n_p}.",
                "consequence": "Every electrical quantity would be wrong by that factor.",
                "fix": f"Write n_p = {pairs.n_p}, or correct the unit of one of the two.",
            }
        )
    return out
