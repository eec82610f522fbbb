"""The terms of which formulas for an unknown torque are made.

There is friction over the speed, torque over the angle, friction that grows with the motor torque, friction
with hysteresis, and torque over time.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .weak_form import Motion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Columns = Callable[[Motion, tuple[float, ...]], list[Array]]
    Profile = Callable[[Array, tuple[float, ...]], Array]

# Orders of a torque over the angle that are tried, and the largest that is tried by direction, too.
_ORDERS, _BY_DIRECTION = (1, 2, 3, 4, 6, 8, 12, 24), 2


@dataclass(frozen=True)
class Shape:
    """A number on which a term does not depend linearly: the grid on which it is tried, and the range that a
    log resolves, both in its unit.
    """

    name: str
    unit: str
    grid: tuple[float, ...]
    low: float
    high: float


@dataclass(frozen=True)
class Term:
    """A kind of term: its text with {names} of its numbers, its columns at given shapes (one per strength),
    and name and unit of its strengths.
    """

    text: str
    columns: Columns
    strengths: tuple[tuple[str, str], ...]
    shapes: tuple[Shape, ...] = ()

    def points(self) -> Iterator[tuple[float, ...]]:
        """All shapes that are tried."""
        return itertools.product(*(shape.grid for shape in self.shapes))

    @property
    def count(self) -> int:
        """Numbers that it has."""
        return len(self.strengths) + len(self.shapes)


def terms(moved: Motion) -> list[Term]:
    """The terms that are tried, with grids that follow the scales of the motion."""
    top = float(np.abs(moved.omega_m).max()) or 1.0
    # The direction turns over within less than the noise of any log.
    width = 1e-4 * top
    return [
        *_friction(top, width),
        *_of_torque(width),
        *_hysteresis(moved),
        *_waves(width),
        *_at_one_place(width),
        *_in_time(moved),
    ]


def _odd(profile: Profile, width: float) -> Columns:
    """A torque against the motion that depends on the size of the speed."""
    return lambda m, p: [np.tanh(m.omega_m / width) * profile(np.abs(m.omega_m), p)]


def _friction(top: float, width: float) -> list[Term]:
    speeds = tuple(top * x for x in (0.01, 0.02, 0.04, 0.08, 0.15, 0.3, 0.6))
    w_0 = Shape("w_0", "rad/s", speeds, 1e-3 * top, 3.0 * top)
    # The width and the place of a hump.
    wide = Shape("w_0", "rad/s", tuple(top * x for x in (0.04, 0.08, 0.16, 0.3)), 0.01 * top, top)
    place = Shape("w_1", "rad/s", tuple(0.1 * top * k for k in range(1, 10)), 0.02 * top, top)
    exponent = Shape("a", "1", (0.15, 0.3, 0.45, 0.6, 0.75, 0.9), 0.05, 0.97)
    torque = (("k", "N m"),)
    return [
        Term("{k}·sgn(ω)", _odd(lambda w, _: np.ones_like(w), width), torque),
        Term("{k}·ω·|ω|", _odd(lambda w, _: w**2, width), (("k", "N m s^2"),)),
        Term("{k}·ω³", _odd(lambda w, _: w**3, width), (("k", "N m s^3"),)),
        Term(
            "{k}·|ω|^{a}·sgn(ω)",
            _odd(lambda w, p: w ** p[0], width),
            (("k", "N m (s/rad)^a"),),
            (exponent,),
        ),
        Term(
            "{k}·ω/(1 + (ω/{w_0})²)",
            _odd(lambda w, p: w / (1.0 + (w / p[0]) ** 2), width),
            (("k", "N m s"),),
            (w_0,),
        ),
        Term("{k}·tanh(ω/{w_0})", _odd(lambda w, p: np.tanh(w / p[0]), width), torque, (w_0,)),
        Term(
            "{k}·exp(−(ω/{w_0})²)·sgn(ω)",
            _odd(lambda w, p: np.exp(-((w / p[0]) ** 2)), width),
            torque,
            (w_0,),
        ),
        Term("{k}·exp(−|ω|/{w_0})·sgn(ω)", _odd(lambda w, p: np.exp(-w / p[0]), width), torque, (w_0,)),
        Term(
            "{k}·exp(−((|ω| − {w_1})/{w_0})²)·sgn(ω)",
            _odd(lambda w, p: np.exp(-(((w - p[1]) / p[0]) ** 2)), width),
            torque,
            (wide, place),
        ),
        Term("{k}·|ω|", lambda m, _: [np.abs(m.omega_m)], (("k", "N m s"),)),
        Term("{k}·ω²", lambda m, _: [m.omega_m**2], (("k", "N m s^2"),)),
    ]


def _of_torque(width: float) -> list[Term]:
    def direction(m: Motion) -> Array:
        return np.tanh(m.omega_m / width)

    return [
        Term("{k}·|τ_e|·sgn(ω)", lambda m, _: [np.abs(m.tau_e) * direction(m)], (("k", "1"),)),
        Term("{k}·|τ_e|·ω", lambda m, _: [np.abs(m.tau_e) * m.omega_m], (("k", "s"),)),
        Term("{k}·τ_e²·sgn(ω)", lambda m, _: [m.tau_e**2 * direction(m)], (("k", "1/(N m)"),)),
    ]


def _hysteresis(moved: Motion) -> list[Term]:
    """Friction that acts like a spring before it slides (Dahl, Aerospace Corp. TOR-158 (1968))."""
    span = float(np.ptp(moved.theta_m)) or 1.0
    # What a rotor usually turns from row to row is the least that a log resolves.
    finest = float(np.median(np.abs(np.diff(moved.theta_m)))) or 1e-3 * span
    grid = tuple(finest * x for x in (1.0, 3.0, 10.0, 30.0, 100.0) if finest * x < span)

    def columns(m: Motion, p: tuple[float, ...]) -> list[Array]:
        turned = np.diff(m.theta_m, prepend=m.theta_m[:1])
        kept = np.exp(-np.abs(turned) / p[0])
        gained = np.sign(turned) * (1.0 - kept)
        x, out = 0.0, np.empty_like(turned)
        for k, (a, b) in enumerate(zip(kept.tolist(), gained.tolist(), strict=True)):
            x = a * x + b
            out[k] = x
        return [out]

    shape = Shape("theta_0", "rad", grid, finest, span)
    return [Term("{k}·x, dx/dθ = (sgn ω − x)/{theta_0}", columns, (("k", "N m"),), (shape,))]


def _waves(width: float) -> list[Term]:
    strengths = (("c", "N m"), ("s", "N m"))

    def wave(order: int, by_direction: bool) -> Columns:
        def columns(m: Motion, _: tuple[float, ...]) -> list[Array]:
            factor = np.tanh(m.omega_m / width) if by_direction else np.ones_like(m.omega_m)
            return [np.cos(order * m.theta_m) * factor, np.sin(order * m.theta_m) * factor]

        return columns

    made = []
    for order in _ORDERS:
        k = "" if order == 1 else str(order)
        text = f"{{c}}·cos({k}θ) + {{s}}·sin({k}θ)"
        made.append(Term(text, wave(order, False), strengths))
        if order <= _BY_DIRECTION:
            made.append(Term(f"({text})·sgn(ω)", wave(order, True), strengths))
    return made


def _at_one_place(width: float) -> list[Term]:
    """A torque over part of a turn: a tight spot, or a cam."""
    place = Shape("theta_1", "rad", tuple(2.0 * np.pi * k / 12 for k in range(1, 13)), 0.05, 7.0)
    wide = Shape("w", "rad", (0.1, 0.25, 0.6), 0.03, 1.5)

    def bump(m: Motion, p: tuple[float, ...]) -> Array:
        return np.exp((np.cos(m.theta_m - p[0]) - 1.0) / p[1] ** 2)

    torque, text = (("k", "N m"),), "{k}·exp((cos(θ − {theta_1}) − 1)/{w}²)"
    return [
        Term(text, lambda m, p: [bump(m, p)], torque, (place, wide)),
        Term(
            f"{text}·sgn(ω)",
            lambda m, p: [bump(m, p) * np.tanh(m.omega_m / width)],
            torque,
            (place, wide),
        ),
    ]


def _in_time(moved: Motion) -> list[Term]:
    duration = float(np.ptp(moved.t)) or 1.0
    tau = Shape("tau", "s", tuple(duration * x for x in (0.03, 0.1, 0.3)), 0.01 * duration, duration)
    return [
        Term(
            "{c}·t + {s}·t²",
            lambda m, _: [m.t - m.t[0], (m.t - m.t[0]) ** 2],
            (("c", "N m/s"), ("s", "N m/s^2")),
        ),
        Term("{k}·exp(−t/{tau})", lambda m, p: [np.exp(-(m.t - m.t[0]) / p[0])], (("k", "N m"),), (tau,)),
    ]
