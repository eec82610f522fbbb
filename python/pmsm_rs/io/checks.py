"""Contradictions between columns that would make every later answer wrong, found before anything is
computed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .._core import DataError
from ..errors import refuse

_FEW = 32
_LARGEST_STEP = math.pi / 2
# rad: a rotor that moves less says nothing of its speed
_LEAST_TURN = 0.05
# nor does one that moves no more than noise adds up to, per median step of it and root of their number
_NOISE_WALK = 8.0
# share of rows with a new angle below which it is held for several rows
_HELD = 0.5
# updates of a held angle that a step spans, the first that decide
_UPDATES = (8, 4, 2, 1)
# a turn in degrees, rounded up, and jumps by it that are no fault of a few samples
_TURN = 360.5
_WRAPS = 2
# share of the logged d and q values that may not follow from the phases before nothing is said of them
_FOREIGN = 0.1
# logarithm of the size and turn (rad) from which it is another convention and no error of a sensor
_OTHER_SIZE = 0.15
_OTHER_TURN = 0.5
# pole pairs at most, and the share by which their number may miss a whole one
_MOST_PAIRS, _WHOLE = 60, 0.01


def angle_against_speed(
    columns: Mapping[str, NDArray[np.float64]], n_p: int | None, file: str | None
) -> None:
    """Raises DataError where the logged angle turns at another rate or in another direction than the logged
    speed.

    The ratio of the two is 1 if both are what their names say. It is n_p or 1/n_p if electrical and
    mechanical were mixed up, and π/180 or 2π if a unit is wrong. Too slow a sampling to follow the angle
    decides nothing.
    """
    for angle, speed, pairs in (
        ("theta_e", "omega_e", 1.0),
        ("theta_m", "omega_m", 1.0),
        ("theta_e", "omega_m", float(n_p or 0)),
        ("theta_m", "omega_e", 1.0 / n_p if n_p else 0.0),
    ):
        if angle in columns and speed in columns and pairs:
            ratio = _ratio(columns["t"], columns[angle], columns[speed] * pairs)
            if ratio is not None and not 0.8 < ratio < 1.25:
                raise _explain(angle, speed, ratio, n_p, file)


def angle_in_radians(columns: Mapping[str, NDArray[np.float64]], file: str | None) -> None:
    """Raises DataError where a logged angle wraps at 360 and not at 2π."""
    for angle in ("theta_e", "theta_m"):
        x = columns.get(angle, np.empty(0))
        x = x[np.isfinite(x)]
        if not x.size or np.ptp(x) > _TURN:
            continue
        jumps = np.abs(np.diff(x))
        if np.sum((jumps > 0.75 * _TURN) & (jumps <= _TURN)) >= _WRAPS:
            raise refuse(
                DataError,
                f"{angle} wraps at 360, as if it were in degrees",
                file=file,
                column=angle,
                fix=f'give {angle} its unit in [columns]: unit = "deg"',
            )


def rotor_frame_against_phases(columns: Mapping[str, NDArray[np.float64]], file: str | None) -> None:
    """Raises DataError where logged d and q values are those of the logged phases in another convention.

    Both are compared at the logged electrical angle: √(3/2) is the power-invariant transformation, 1/√2 root
    mean squares, −1 a turned sign. Where one is filtered or sampled otherwise, so that neither
    follows from the other, nothing is refused. Nor is a turn of the voltages, which some drives log at the
    angle of another instant.
    """
    for sign, turns in (("i", True), ("v", False)):
        names = [f"{sign}_{axis}" for axis in "dqab"]
        if "theta_e" not in columns or any(name not in columns for name in names):
            continue
        d, q, a, b = (columns[name] for name in names)
        c = columns.get(f"{sign}_c", -a - b)
        if not len(d) == len(q) == len(a) == len(b) == len(c) == len(columns["theta_e"]):
            continue
        phases = ((2.0 * a - b - c) / 3.0 + 1j * (b - c) / math.sqrt(3.0)) * np.exp(-1j * columns["theta_e"])
        logged = d + 1j * q
        known = np.isfinite(phases) & np.isfinite(logged)
        phases, logged = phases[known], logged[known]
        power = float(np.vdot(phases, phases).real)
        if power == 0.0 or not np.any(logged):
            continue
        gain = complex(np.vdot(phases, logged)) / power
        rest = np.abs(logged - gain * phases)
        if float(rest @ rest) > _FOREIGN * float(np.vdot(logged, logged).real):
            continue
        if abs(math.log(abs(gain))) > _OTHER_SIZE or (turns and abs(np.angle(gain)) > _OTHER_TURN):
            raise _other_convention(sign, gain, file)


def _other_convention(sign: str, gain: complex, file: str | None) -> DataError:
    known = (
        (math.sqrt(1.5), "power-invariant"),
        (math.sqrt(0.5), "root mean square"),
        (math.sqrt(2.0), "peak values beside root mean square ones"),
        (1.0 / math.sqrt(1.5), "amplitude-invariant beside power-invariant ones"),
    )
    words = next((f", as if {word}" for size, word in known if abs(abs(gain) / size - 1.0) < 0.03), "")
    turn = math.degrees(np.angle(gain))
    turned = f" and turned by {turn:.0f}°" if abs(turn) > math.degrees(_OTHER_TURN) else ""
    fix = (
        f"give {sign}_d and {sign}_q scale = {1.0 / abs(gain):.4g} in [columns]"
        if not turned
        else f"correct theta_e, or leave {sign}_d and {sign}_q out by false in [columns]"
    )
    return refuse(
        DataError,
        f"{sign}_d and {sign}_q are {abs(gain):.4g} times what {sign}_a, {sign}_b and theta_e say"
        f"{turned}{words}",
        file=file,
        column=f"{sign}_d",
        fix=fix,
    )


def _ratio(t: NDArray[np.float64], angle: NDArray[np.float64], speed: NDArray[np.float64]) -> float | None:
    """Median of measured over expected angle step, over the samples that turn fast enough to tell."""
    if not len(t) == len(angle) == len(speed):
        return None
    expected = 0.5 * (speed[1:] + speed[:-1]) * np.diff(t)
    fresh = np.flatnonzero(np.diff(angle)) + 1
    if _FEW < len(fresh) < _HELD * len(angle):
        # An angle that is held for several rows is compared where it is new, and over several updates, as
        # the speed may be held, too.
        for updates in _UPDATES:
            rows = fresh[::updates]
            held = _of_steps(np.add.reduceat(expected[: rows[-1]], rows[:-1]), angle[rows])
            if held is not None:
                return held
    return _of_steps(expected, angle)


def _of_steps(expected: NDArray[np.float64], angle: NDArray[np.float64]) -> float | None:
    """Median of the steps of `angle` over those that are `expected`."""
    size = np.abs(expected)
    usable = (size < _LARGEST_STEP) & (size > 0.3 * np.max(size, initial=0.0, where=size < _LARGEST_STEP))
    if usable.sum() < _FEW or np.median(size[usable]) < 1e-4:
        return None
    # The noise of a rotor that is held adds up to no more than a walk at random.
    known = expected[np.isfinite(expected)]
    noise = float(np.median(np.abs(np.diff(known))))
    if np.ptp(np.cumsum(known)) < max(_LEAST_TURN, _NOISE_WALK * noise * math.sqrt(len(known))):
        return None
    # Steps of logged angles wrap at 2π; unwrapped ones do not, and for both this gives the short way round.
    step = np.remainder(np.diff(angle)[usable] + math.pi, 2.0 * math.pi) - math.pi
    return float(np.median(step / expected[usable]))


def _explain(angle: str, speed: str, ratio: float, n_p: int | None, file: str | None) -> DataError:
    def near(target: float) -> bool:
        return abs(ratio / target - 1.0) < 0.12

    other = {"theta_e": "theta_m", "theta_m": "theta_e"}[angle]
    twin = {"omega_e": "omega_m", "omega_m": "omega_e"}[speed]
    if ratio < 0:
        problem = f"{angle} turns against {speed}"
        fix = f"give {angle} or {speed} scale = -1 in [columns], whichever does not agree with the currents"
    elif n_p and n_p > 1 and (near(1.0 / n_p) or near(float(n_p))):
        problem = (
            f"{angle} turns {ratio:.3g} times as fast as {speed} says, "
            f"as if electrical and mechanical were mixed up (n_p = {n_p})"
        )
        fix = f"map the angle to {other}, or the speed to {twin}, in [columns], or correct n_p"
    elif near(math.pi / 180.0) or near(180.0 / math.pi):
        problem = f"{angle} and {speed} differ by 180/π, as if one were in degrees"
        fix = f'give {angle if ratio > 1 else speed} its unit in [columns], such as unit = "deg" or "deg/s"'
    elif near(math.pi / 30.0) or near(30.0 / math.pi):
        problem = (
            f"{angle} turns {ratio:.3g} times as fast as {speed} says, as if rpm and rad/s were mixed up"
        )
        unit = "rpm" if ratio < 1 else "rad/s"
        fix = f'give {speed} its unit in [columns]: unit = "{unit}"'
    elif near(2.0 * math.pi) or near(0.5 / math.pi):
        problem = (
            f"{angle} turns {ratio:.3g} times as fast as {speed} says, as if turns and rad were mixed up"
        )
        unit = 'unit = "Hz"' if ratio > 1 else 'unit = "rad/s"'
        fix = f'give {speed} its unit in [columns], {unit}, or {angle} unit = "rev"'
    elif (other_pairs := _pole_pairs(angle, speed, ratio, n_p)) is not None:
        problem = f"{angle} turns {ratio:.3g} times as fast as {speed} and n_p = {n_p} say"
        fix = f"check n_p, which would be {other_pairs}, and the units of both"
    else:
        problem = f"{angle} turns {ratio:.3g} times as fast as {speed} says"
        fix = "check the units of both, n_p, and which is electrical and which mechanical"
    return refuse(DataError, problem, file=file, column=angle, fix=fix)


def _pole_pairs(angle: str, speed: str, ratio: float, n_p: int | None) -> int | None:
    """The pole pairs with which an electrical and a mechanical column agree, None where none do."""
    if not n_p or angle[-1] == speed[-1]:
        return None
    pairs = n_p * ratio if angle == "theta_e" else n_p / ratio
    whole = round(pairs)
    return whole if 1 <= whole <= _MOST_PAIRS and abs(pairs - whole) < _WHOLE * whole else None
