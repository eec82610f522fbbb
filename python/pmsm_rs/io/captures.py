"""Captures of an oscilloscope: phase voltages, perhaps currents, and neither an angle nor a speed.

Both are taken from the signals themselves (see `rotation`) and put beside the measured columns. What cannot
be had of a capture is refused in a sentence.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._core import DataError, Machine
from ..errors import refuse
from ..results.words import listed
from .channels import CURRENTS, TOLD, VOLTAGES, Columns, current, has_three, voltage
from .formats.remark import Remark
from .rotation import USUAL, Rotation, Vector, Winding, phases, rotation

_MOTION: Final = frozenset({"omega_e", "omega_m", "n", "theta_e", "theta_m"})

_FEWEST_TURNS: Final = 2.0
"""Electrical turns below which the middle of the flux's circle is not sure."""
_PER_TURN: Final = 5.0
"""Samples of an electrical turn below which the integral misses too much of the voltage."""
_SLOWEST: Final = 0.1
"""Share of the usual speed below which the beginning and the end of a capture are left out."""
_UNEVEN: Final = 0.2
"""Variation of the flux linkage, share of it, from which voltages and currents do not belong to one motor."""
_VAGUE: Final = 0.2
"""Error of the angle (rad) from which it is of no use: psi_m would be off by 2 % for it alone."""
_JUMP: Final = 6.0
"""Usual changes of a voltage from sample to sample that make a jump, which noise does not reach."""
_FEWEST_JUMPS: Final = 8
_MOSTLY: Final = 0.75
"""Jumps, and the share of them, that must show a voltage to be held."""


class Completed(NamedTuple):
    """Columns with angle and speed, how many rows were cut before them, what was done, and the error of the
    angle (rad) where it is not the voltages' own.
    """

    columns: Columns
    first: int
    remarks: tuple[Remark, ...]
    angle_error: float | None


def is_capture(columns: Columns, load: str | None) -> bool:
    """Whether phase voltages are there and nothing that tells angle or speed."""
    alone = not _MOTION & {*columns} and not {"v_d", "v_q"} & {*columns}
    rotor_frame = any(np.any(columns[name]) for name in ("i_d", "i_q") if name in columns)
    return alone and not rotor_frame and load != "locked" and any(name in columns for name in VOLTAGES)


def completed(columns: Columns, machine: Machine | None, file: str | None) -> Completed:
    """`columns` (SI, of shape (rows,)) of a capture with what they lack. Raises DataError where it cannot be
    had.
    """
    currents: list[str] = [name for name in CURRENTS if name in columns and np.any(columns[name])]
    t = columns["t"]
    if len(t) < 3 or np.any(np.diff(t) <= 0.0):
        # Bad sample times are refused, with their row, where every recording is checked.
        return Completed(columns, 0, (), None)
    v, remarks = voltage(columns, not currents, file)
    if not currents:
        return _open(columns, v, remarks, file)
    i = current(columns, currents, file)
    if machine is None or (machine.l_d is None and machine.l_q is None):
        raise refuse(
            DataError,
            "no angle was logged, and l_q is not known, without which it cannot be taken from the voltages "
            "of a motor in which currents flow",
            file=file,
            fix="give r_s, l_d and l_q in [machine], log the angle, or record with open terminals",
        )
    held = _is_held(v, i)
    found = rotation(t, v, i, Winding(machine.r_s, machine.l_d, machine.l_q), held=held)
    _check(found, t, file)
    _check_currents(found, v, i, file)
    rows = _turning(found)
    acting = v if held else np.append(0.5 * (v[1:] + v[:-1]), v[-1])
    given = {name: values for name, values in columns.items() if name not in {"i_d", "i_q"}}
    out = given | dict(zip(VOLTAGES, phases(acting - found.offset), strict=True))
    out |= {"theta_e": found.theta, "omega_e": found.omega}
    remarks = [*remarks, *_offset(found, v), _flux(found, i), *_cut(rows, len(t))]
    return Completed(_cut_to(out, rows), rows.start, tuple(remarks), found.error)


def _open(columns: Columns, v: Vector, remarks: list[Remark], file: str | None) -> Completed:
    t = columns["t"]
    found = rotation(t, v, np.zeros(len(t), dtype=np.complex128), Winding())
    _check(found, t, file)
    rows = _whole_turns(found, _turning(found))
    out = {**columns, "omega_e": found.omega}
    if not has_three(columns):
        out |= dict(zip(VOLTAGES, phases(v - found.offset), strict=True))
        remarks = [*remarks, *_offset(found, v)]
    low, high = sorted(np.abs(np.quantile(found.omega[rows], (0.05, 0.95))) / (2.0 * np.pi))
    turns = abs(np.ptp(found.theta[rows])) / (2.0 * np.pi)
    speed = Remark(
        f"No speed was logged: it was taken from the voltages, which go through {turns:.1f} electrical turns "
        f"at {low:.4g} to {high:.4g} Hz.",
        "An error of the time base goes into psi_m by the same share.",
        "Log the speed as well if it is known better.",
    )
    return Completed(_cut_to(out, rows), rows.start, (*remarks, speed, *_cut(rows, len(t))), None)


def _is_held(v: Vector, i: Vector) -> bool:
    """Whether a voltage acts from its sample to the next, as that of a drive's log.

    Where such a voltage jumps, the slope of the current changes at once. In a capture of the voltage the
    slope follows the mean of the samples at both ends.
    """
    # The bend of the current about a sample comes from the voltage behind it less the one before it.
    bend, step = np.diff(i, 2), np.diff(v)
    held, ends = step[:-1], 0.5 * (step[:-1] + step[1:])
    jumps = np.abs(held) > _JUMP * float(np.median(np.abs(step)))
    if np.count_nonzero(jumps) < _FEWEST_JUMPS:
        return False
    rest = [np.abs(bend - _gain(x[jumps], bend[jumps]) * x)[jumps] for x in (held, ends)]
    return bool(np.mean(rest[0] < rest[1]) > _MOSTLY)


def _gain(x: Vector, y: Vector) -> float:
    """The factor on `x` that comes nearest to `y`."""
    size = float(np.vdot(x, x).real)
    return float(np.vdot(x, y).real) / size if size else 0.0


def _check(found: Rotation, t: NDArray[np.float64], file: str | None) -> None:
    """Raises DataError where the flux linkage does not tell the angle."""
    turns = float(np.ptp(found.theta)) / (2.0 * np.pi)
    if turns < _FEWEST_TURNS or not np.isfinite(found.error):
        raise refuse(
            DataError,
            f"neither angle nor speed was logged, and the voltages show {turns:.1f} electrical turns in one "
            f"direction, too few to take them from",
            file=file,
            column="v_a",
            fix=f"record at least {_FEWEST_TURNS:g} electrical turns, or log the angle",
        )
    per_turn = 2.0 * np.pi / (float(np.quantile(np.abs(found.omega), USUAL)) * float(np.median(np.diff(t))))
    if per_turn < _PER_TURN:
        raise refuse(
            DataError,
            f"the voltages are sampled {per_turn:.1f} times per electrical turn",
            file=file,
            column="v_a",
            fix=f"sample at least {_PER_TURN:g} times per electrical turn",
        )
    if found.uneven > _UNEVEN or found.psi_m <= 0.0:
        raise refuse(
            DataError,
            "neither angle nor speed was logged, and the voltages (and currents) give no flux linkage of "
            f"constant length: it varies by {100.0 * found.uneven:.0f} %",
            file=file,
            column="v_a",
            fix="check the order of the channels, their scales and signs, or log the angle",
        )
    if found.error > _VAGUE:
        raise refuse(
            DataError,
            "neither angle nor speed was logged, and the voltages tell the angle to "
            f"{np.degrees(found.error):.0f} degrees only",
            file=file,
            column="v_a",
            fix="record more electrical turns at a higher speed, or log the angle",
        )


def _check_currents(found: Rotation, v: Vector, i: Vector, file: str | None) -> None:
    """Raises DataError on currents that turn against the voltages or flow the other way round."""
    level = float(np.sqrt(np.mean(np.abs(i) ** 2)))
    turn = np.exp(1j * found.theta)
    along, against = abs(np.mean(i / turn)), abs(np.mean(i * turn))
    if against > 2.0 * along and against > 0.3 * level:
        raise refuse(
            DataError,
            "the phase currents follow each other in the opposite order of the voltages",
            file=file,
            column="i_a",
            fix="exchange two of the currents in [columns]",
        )
    wrong = found.r_s * level < -0.01 * float(np.sqrt(np.mean(np.abs(v) ** 2)))
    if wrong or found.l_d <= 0.0 or found.l_q <= 0.0:
        raise refuse(
            DataError,
            f"voltages and currents give r_s = {found.r_s:.4g} ohm, l_d = {1e3 * found.l_d:.4g} mH and "
            f"l_q = {1e3 * found.l_q:.4g} mH, of which none can be negative",
            file=file,
            column="i_a",
            fix="count the currents into the motor: turn the clamps round with scale = -1 in [columns]",
        )


def _turning(found: Rotation) -> slice:
    """The rows from the first to the last in which the rotor turns fast enough."""
    speed = np.abs(found.omega)
    fast = np.flatnonzero(speed > _SLOWEST * float(np.quantile(speed, USUAL)))
    return slice(int(fast[0]), int(fast[-1]) + 1)


def _whole_turns(found: Rotation, rows: slice) -> slice:
    """`rows` without the half turn at each end, where the harmonics of the back-EMF are not taken out of the
    speed; all of them where there are few.
    """
    theta = np.abs(found.theta[rows] - found.theta[rows.start])
    inner = np.flatnonzero((theta > np.pi) & (theta < theta[-1] - np.pi))
    if theta[-1] < (_FEWEST_TURNS + 1.0) * 2.0 * np.pi or not inner.size:
        return rows
    return slice(rows.start + int(inner[0]), rows.start + int(inner[-1]) + 1)


def _cut_to(columns: Columns, rows: slice) -> Columns:
    return {name: np.ascontiguousarray(values[rows]) for name, values in columns.items()}


def _cut(rows: slice, count: int) -> list[Remark]:
    left = count - (rows.stop - rows.start)
    if left == 0:
        return []
    return [
        Remark(
            f"{left} of {count} rows were left out at the beginning and the end.",
            "Where the rotor hardly turns no angle can be had, and the ends of a capture show its speed "
            "with the harmonics in it.",
            "Log the angle if these rows matter.",
        )
    ]


def _offset(found: Rotation, v: Vector) -> list[Remark]:
    size = float(np.sqrt(np.mean(np.abs(v) ** 2)))
    if abs(found.offset) < TOLD * size:
        return []
    each = listed([f"{float(x):.3g} V" for x in phases(np.asarray(found.offset))])
    return [
        Remark(
            f"The voltages have offsets, of {each} in the three phases.",
            "They were subtracted.",
            "Zero the channels before recording.",
        )
    ]


def _flux(found: Rotation, i: Vector) -> Remark:
    i_q = float(np.sqrt(np.mean((i * np.exp(-1j * found.theta)).imag ** 2)))
    at_best = abs(found.psi_m) * found.error / max(i_q, np.finfo(np.float64).tiny)
    lost = f", and {found.lost:.3g} V lost against the sign of each current" if found.lost > 0.0 else ""
    return Remark(
        "No angle was logged: angle and speed were taken from the flux linkage of voltages and currents, the "
        f"angle to about {max(np.degrees(found.error), 0.1):.1f} degrees. With it go "
        f"r_s = {found.r_s:.4g} ohm, l_d = {1e3 * found.l_d:.4g} mH, l_q = {1e3 * found.l_q:.4g} mH and "
        f"psi_m = {found.psi_m:.4g} V s{lost}.",
        "Nothing was asked of the motion, of sensor offsets, and of what is the same all around a turn, "
        "such as saturation: each could be an error of this angle. l_d and l_q depend on it, too, "
        f"l_q to within {1e3 * at_best:.2g} mH.",
        "Log the angle to have all of it asked.",
    )
