"""Families of manoeuvres: references over time that a few numbers between 0 and 1 describe."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .limits import Limits

    Array = NDArray[np.float64]

# Numbers that describe a manoeuvre of any family.
GENES = 16
# Share of a limit that references use; the rest is for the drive's overshoot.
_USED = 0.9
# Share of the current that may accelerate, and that i_d may take: sqrt(0.6² + 0.6²) is within the limit.
_PART = 0.6
# Rest at either end, share of the time.
_REST = 0.06
# Points of a reference: one per ms, within these bounds.
_POINTS = (400, 4000)
# Levels of the speed, and of the current at a held rotor.
_LEVELS = 5
# Least share of the current in steps of i_d: without them a recording does not determine l_d.
_LEAST = 0.15
# Corners of a ramp are rounded over this share of the time; a rest is as long.
_CORNER = 0.04
# Ramps take at most this share of a level's time.
_RAMP = 0.8


@dataclass(frozen=True)
class References:
    """References of a manoeuvre at the instants `t` (s), linear between them.

    `omega_m` is the mechanical speed (rad/s), None where the drive controls the currents alone. `i_d` and
    `i_q` are in A; with a speed, i_q is added to what the speed controller asks for. `words` say what the
    manoeuvre does.
    """

    kind: str
    t: Array
    omega_m: Array | None
    i_d: Array
    i_q: Array
    words: str


@dataclass(frozen=True)
class Scales:
    """What a family needs beside the limits: acceleration per ampere of i_q (rad/s²/A), whether steps of i_d
    tell anything, and whether the rotor is held.
    """

    agility: float
    electrical: bool
    locked: bool


@dataclass(frozen=True)
class _Room:
    """Limits with their margin, a grid of time, and the numbers."""

    t: Array
    low: float
    high: float
    current: float
    acceleration: float
    position: tuple[float, float] | None
    scales: Scales
    genes: Array

    @property
    def time(self) -> float:
        return float(self.t[-1])

    def edges(self, count: int) -> Array:
        """Beginnings and end of as many equal pieces between the rests at both ends."""
        return np.linspace(_REST, 1.0 - _REST, count + 1) * self.time


_Family = Callable[[_Room], References]


def families(scales: Scales) -> tuple[str, ...]:
    """Names of the families that make sense."""
    return ("held",) if scales.locked else tuple(name for name in _FAMILIES if name != "held")


def build(kind: str, genes: Array, limits: Limits, scales: Scales, shrink: float = 1.0) -> References:
    """The manoeuvre of a family for `genes`, shape (GENES,), with all amplitudes times `shrink`."""
    count = int(np.clip(round(limits.time / 1e-3), *_POINTS))
    size = _USED * shrink
    most = _PART * size * limits.current * scales.agility
    asked = math.inf if limits.acceleration is None else size * limits.acceleration
    position = None
    if limits.position is not None:
        position = (size * limits.position[0], size * limits.position[1])
    room = _Room(
        np.linspace(0.0, limits.time, count + 1),
        size * limits.speed[0],
        size * limits.speed[1],
        size * limits.current,
        min(most, asked),
        position,
        scales,
        np.clip(genes, 0.0, 1.0),
    )
    return _FAMILIES[kind](room)


def _log(gene: float, low: float, high: float) -> float:
    return float(low * (high / low) ** gene)


def _ramped(room: _Room, edges: Array, speeds: Array, share: float) -> tuple[Array, Array]:
    """A speed that goes from rest through `speeds`, one per piece, back to rest; scaled so that ramps fit."""
    a = room.acceleration * share
    jumps = np.abs(np.diff(np.concatenate([[0.0], speeds, [0.0]])))
    piece = _RAMP * float(np.diff(edges).min())
    factor = min(1.0, a * piece / max(float(jumps.max()), 1e-12))
    speeds = speeds * factor
    # The last piece is the way back to rest.
    targets = np.concatenate([speeds, [0.0]])
    at, now = [0.0], [0.0]
    for begin, target in zip(edges, targets, strict=True):
        at += [float(begin), float(begin) + abs(target - now[-1]) / max(a, 1e-12) + 1e-9]
        now += [now[-1], float(target)]
    return _smooth(np.interp(room.t, at, now)), speeds


def _smooth(values: Array) -> Array:
    """The values without corners, which a speed controller would overshoot; rests at both ends stay."""
    half = max(1, round(0.5 * _CORNER * len(values)))
    window = np.hanning(2 * half + 3)[1:-1]
    padded = np.pad(values, half, mode="edge")
    smooth: Array = np.convolve(padded, window / window.sum(), mode="valid")
    return smooth


def _within(room: _Room, omega: Array) -> tuple[Array, float]:
    """The speed scaled so that the angle stays within its limits, and the factor."""
    if room.position is None:
        return omega, 1.0
    step = np.diff(room.t)
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * step)])
    low, high = room.position
    over = max(float(turned.max()) / max(high, 1e-12), float(turned.min()) / min(low, -1e-12), 1.0)
    return omega / over, 1.0 / over


def _direct(room: _Room, edges: Array, genes: Array) -> tuple[Array, str]:
    """Steps of i_d, one level per piece; none for a log without currents."""
    if not room.scales.electrical:
        return np.zeros_like(room.t), ""
    size = _PART * room.current * (_LEAST + (1.0 - _LEAST) * float(genes[0]))
    levels = size * (2.0 * genes[1:] - 1.0)
    i_d = _steps(room, edges, np.resize(levels, len(edges) - 1))
    if not np.abs(i_d).max() > 1e-3 * room.current:
        return np.zeros_like(room.t), ""
    return i_d, f", i_d in steps between {_digits(i_d.min())} and {_digits(i_d.max())} A"


def _steps(room: _Room, edges: Array, levels: Array) -> Array:
    """One level per piece, zero outside."""
    values = np.concatenate([[0.0], levels, [0.0]])
    return values[np.searchsorted(edges, room.t, side="right")]


def _swing(room: _Room, genes: Array) -> tuple[Array, str]:
    """A square wave that is added to i_q: size and periods."""
    size = 0.25 * room.current * max(0.0, 2.0 * float(genes[0]) - 1.0)
    periods = _log(genes[1], 3.0, 40.0)
    inside = (room.t > _REST * room.time) & (room.t < (1.0 - _REST) * room.time)
    wave = np.where(np.floor(2.0 * periods * room.t / room.time) % 2.0 == 0.0, size, -size) * inside
    if not size > 1e-3 * room.current:
        return np.zeros_like(room.t), ""
    return wave, f", i_q swings by ±{_digits(size)} A"


def _levels(room: _Room) -> References:
    """Speeds held one after the other, of any sign that the limits allow."""
    g = room.genes
    scale = _log(g[0], 0.1, 1.0)
    speeds = scale * (room.low + g[2 : 2 + _LEVELS] * (room.high - room.low))
    return _through(room, "levels", speeds, "hold the speeds")


def _reversals(room: _Room) -> References:
    """Ramps through standstill between two speeds, at a slow and a fast amplitude."""
    g = room.genes
    first, second = _log(g[0], 0.15, 1.0), _log(g[2], 0.02, 0.6)
    sizes = np.array([first, first, second, second, first])
    sign = np.array([1.0, -1.0, 1.0, -1.0, 1.0]) * (1.0 if g[3] < 0.5 else -1.0)
    speeds = np.where(sign > 0.0, room.high, room.low) * sizes
    return _through(room, "reversals", speeds, "ramp the speed between")


def _through(room: _Room, kind: str, speeds: Array, what: str) -> References:
    g = room.genes
    edges = room.edges(_LEVELS + 1)
    omega, speeds = _ramped(room, edges[:-1], speeds, _log(g[1], 0.1, 1.0))
    omega, factor = _within(room, omega)
    i_d, steps = _direct(room, edges[:-1], g[7:13])
    i_q, swing = _swing(room, g[13:15])
    listed = ", ".join(_digits(x) for x in factor * speeds)
    return References(kind, room.t, omega, i_d, i_q, f"{what} {listed} rad/s{steps}{swing}")


def _chirp(room: _Room) -> References:
    """A speed that swings about a mean ever faster; the amplitude falls where the acceleration asks it."""
    g, t = room.genes, room.t
    middle = room.low + g[0] * (room.high - room.low)
    reach = min(room.high - middle, middle - room.low) if room.low < 0.0 else min(room.high - middle, middle)
    f_0 = _log(g[1], 1.0, 5.0) / room.time
    f_1 = min(f_0 * _log(g[2], 1.5, 40.0), 0.1 / (t[1] - t[0]))
    rise = math.log(f_1 / f_0) / room.time
    f = f_0 * np.exp(rise * t)
    phase = 2.0 * np.pi * f_0 * np.expm1(rise * t) / rise
    lead = room.time * 0.15
    approach = min(1.0, room.acceleration * lead / 1.6 / max(abs(middle), 1e-12))
    middle *= approach
    size = np.minimum(_log(g[3], 0.1, 1.0) * reach, 0.8 * room.acceleration / (2.0 * np.pi * f))
    # Smooth in and out, so that it begins and ends at rest.
    ends = np.minimum(1.0, np.minimum(t, room.time - t) / lead)
    window = 0.5 * (1.0 - np.cos(np.pi * ends))
    omega, factor = _within(room, window * (middle + size * np.sin(phase)))
    edges = room.edges(_LEVELS)
    i_d, steps = _direct(room, edges, g[7:13])
    words = (
        f"swing the speed about {_digits(factor * middle)} rad/s by up to ±{_digits(factor * size.max())} "
        f"rad/s, from {_digits(f_0)} to {_digits(f_1)} Hz{steps}"
    )
    return References("chirp", t, omega, i_d, np.zeros_like(t), words)


def _pulses(room: _Room) -> References:
    """Pulses of i_q both ways with coasting between them; no speed control."""
    g = room.genes
    strength = _PART * room.current * _log(g[0], 0.3, 1.0)
    both = room.low < -0.05 * room.high
    signs = (1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0, 0.0) if both else (1.0, 0.0, -0.8, 0.0, 1.0, 0.0, -0.8, 0.0)
    reach = min(room.high, -room.low) if both else room.high
    pulse = min(0.12 * room.time, 0.8 * reach / max(strength * room.scales.agility, 1e-12))
    pulse *= _log(g[1], 0.3, 1.0)
    coast = (1.0 - 2.0 * _REST) * room.time / 4.0 - pulse
    at = [_REST * room.time]
    for sign in signs:
        at.append(at[-1] + (coast if sign == 0.0 else pulse))
    edges = np.array(at)
    i_q = _steps(room, edges, strength * np.array(signs))
    i_d, steps = _direct(room, room.edges(_LEVELS), g[7:13])
    words = (
        f"control the currents alone: pulses of i_q of {_digits(strength)} A for {_digits(pulse)} s both "
        f"ways, and coast for {_digits(coast)} s after each{steps}"
    )
    return References("pulses", room.t, None, i_d, i_q, words)


def _held(room: _Room) -> References:
    """Steps of both currents at a held rotor."""
    g = room.genes
    edges = room.edges(7)
    size = room.current * _log(g[0], 0.2, 1.0) / math.sqrt(2.0)
    i_q = _steps(room, edges, size * (2.0 * g[1:8] - 1.0))
    i_d = _steps(room, edges, size * (2.0 * g[8:15] - 1.0))
    words = f"with the rotor held, step i_d and i_q to seven levels within ±{_digits(size)} A"
    return References("held", room.t, None, i_d, i_q, words)


_FAMILIES: dict[str, _Family] = {
    "levels": _levels,
    "reversals": _reversals,
    "chirp": _chirp,
    "pulses": _pulses,
    "held": _held,
}


def _digits(x: float) -> str:
    return f"{float(x):.3g}"
