"""What the motion in a file tells before a diagnosis: a rotor that stands, pole pairs, doubtful columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ._core import Machine
from .config import MachineFile
from .errors import shown
from .formats.source import Source
from .poles import PolePairs, frame_of
from .signals import Signal
from .units import UNITS

Columns = Mapping[str, NDArray[np.float64]]

_STILL: Final = 0.05
"""rad within which a rotor stands."""


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


def settled(found: Iterable[Signal], source: Source, raw: Columns, columns: Columns) -> list[dict[str, str]]:
    """Findings on columns that may be electrical or mechanical, where another motion tells which.

    `raw` has the values of the file by the names in `source`, `columns` the canonical SI columns; all are of
    shape (rows,).
    """
    out = []
    names = {source.header(column): column for column in raw}
    for signal in found:
        for quantity, stem in (("angle", "theta"), ("speed", "omega")):
            lines = {line.partition(" =")[0]: line for line in signal.use}
            unit = UNITS[quantity].get(signal.unit or "")
            if {*lines} != {f"{stem}_e", f"{stem}_m"} or unit is None or signal.column not in names:
                continue
            told = frame_of(raw[names[signal.column]] * unit.factor, quantity, columns)
            if told is None:
                continue
            column, fast = f"'{shown(signal.column)}'", f"{told.ratio:.4g} times as fast as"
            slower = told.name.endswith("_m")
            one, other = (told.beside, column) if slower else (column, told.beside)
            pairs = "" if told.n_p is None else f", with {told.n_p} pole pairs"
            out.append(
                {
                    "finding": f"{one} turns {fast} {other}."
                    if told.n_p is not None
                    else f"{column} turns as fast as {told.beside}.",
                    "consequence": f"{column} is {'mechanical' if slower else 'electrical'}{pairs}.",
                    "fix": f"Take this line in [columns]: {lines[told.name]}",
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
