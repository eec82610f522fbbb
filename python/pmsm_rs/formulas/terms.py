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
# Share of the path that counts as turning the other way, too.
_OTHER_WAY = 0.02
# Largest order of a pulsation in the catalogue; what is above it is cogging.
_PULSATION = 4


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
    """A form of term: its text with {names} of its numbers, its columns at given shapes (one per strength),
    and name and unit of its strengths.

    `kind` is the physics: what the torque follows, and how. Terms of one kind differ by their curve alone.
    `effect` is the effect of the catalogue whose law it is, if any. `loaded` says that it depends on the
    motor torque, and `by_direction` that another term is the same torque where the machine turns one way.
    """

    text: str
    columns: Columns
    strengths: tuple[tuple[str, str], ...]
    kind: str
    shapes: tuple[Shape, ...] = ()
    effect: str | None = None
    loaded: bool = False
    by_direction: bool = False

    def points(self) -> Iterator[tuple[float, ...]]:
        """All shapes that are tried."""
        return itertools.product(*(shape.grid for shape in self.shapes))

    @property
    def count(self) -> int:
        """Numbers that it has."""
        return len(self.strengths) + len(self.shapes)


def reverses(moved: Motion) -> bool:
    """Whether a motion turns both ways for more than a fiftieth of its path."""
    ways = [float(np.sum(np.maximum(way * moved.omega_m, 0.0))) for way in (1.0, -1.0)]
    return min(ways) > _OTHER_WAY * sum(ways)


def terms(moved: Motion, both_ways: bool = True) -> list[Term]:
    """The terms that are tried, with grids that follow the scales of the motion.

    Where the machine did not turn `both_ways`, nothing tells a torque that follows the direction from one
    that does not. Then friction over the speed is taken to follow it, and a torque over the angle not to.
    """
    top = float(np.abs(moved.omega_m).max()) or 1.0
    # A shaft that does not turn round may hold a weight; else a load of order 1 is a pulsation.
    turns = float(np.ptp(moved.theta_m)) >= 2.0 * np.pi
    # The direction turns over within less than the noise of any log.
    width = 1e-4 * top
    made = [
        *_friction(top, width),
        *_of_torque(width),
        *_hysteresis(moved),
        *_waves(width, turns),
        *_at_one_place(width),
        *_in_time(moved),
    ]
    return [term for term in made if both_ways or not term.by_direction]


def _odd(profile: Profile, width: float) -> Columns:
    """A torque against the motion that depends on the size of the speed."""
    return lambda m, p: [np.tanh(m.omega_m / width) * profile(np.abs(m.omega_m), p)]


def _friction(top: float, width: float) -> list[Term]:
    speeds = tuple(top * x for x in (0.01, 0.02, 0.04, 0.08, 0.15, 0.3, 0.6))
    w_0 = Shape("w_0", "rad/s", speeds, 1e-3 * top, 3.0 * top)
    # Within a hundredth of the top speed a friction that turns over is a sign, as in the catalogue.
    rise = Shape("w_0", "rad/s", speeds, 0.01 * top, 3.0 * top)
    # The width and the place of a hump.
    wide = Shape("w_0", "rad/s", tuple(top * x for x in (0.04, 0.08, 0.16, 0.3)), 0.01 * top, top)
    place = Shape("w_1", "rad/s", tuple(0.1 * top * k for k in range(1, 10)), 0.02 * top, top)
    exponent = Shape("a", "1", (0.15, 0.3, 0.45, 0.6, 0.75, 0.9), 0.05, 0.97)
    torque = (("k", "N m"),)
    return [
        Term(
            "{k}·sgn(ω)",
            _odd(lambda w, _: np.ones_like(w), width),
            torque,
            "constant friction",
            effect="coulomb_friction",
        ),
        Term(
            "{k}·ω·|ω|",
            _odd(lambda w, _: w**2, width),
            (("k", "N m s^2"),),
            "drag",
            effect="quadratic_drag",
        ),
        Term("{k}·ω³", _odd(lambda w, _: w**3, width), (("k", "N m s^3"),), "drag"),
        Term(
            "{k}·|ω|^{a}·sgn(ω)",
            _odd(lambda w, p: w ** p[0], width),
            (("k", "N m (s/rad)^a"),),
            "drag of a lower power",
            (exponent,),
        ),
        Term(
            "{k}·ω/(1 + (ω/{w_0})²)",
            _odd(lambda w, p: w / (1.0 + (w / p[0]) ** 2), width),
            (("k", "N m s"),),
            "eddy-current brake",
            (w_0,),
        ),
        Term(
            "{k}·tanh(ω/{w_0})",
            _odd(lambda w, p: np.tanh(w / p[0]), width),
            torque,
            "constant friction",
            (rise,),
        ),
        Term(
            "{k}·exp(−(ω/{w_0})²)·sgn(ω)",
            _odd(lambda w, p: np.exp(-((w / p[0]) ** 2)), width),
            torque,
            "falling friction",
            (w_0,),
            effect="stribeck_friction",
        ),
        Term(
            "{k}·exp(−|ω|/{w_0})·sgn(ω)",
            _odd(lambda w, p: np.exp(-w / p[0]), width),
            torque,
            "falling friction",
            (w_0,),
        ),
        Term(
            "{k}·exp(−((|ω| − {w_1})/{w_0})²)·sgn(ω)",
            _odd(lambda w, p: np.exp(-(((w - p[1]) / p[0]) ** 2)), width),
            torque,
            "hump of friction",
            (wide, place),
        ),
        Term(
            "{k}·|ω|",
            lambda m, _: [np.abs(m.omega_m)],
            (("k", "N m s"),),
            "difference of directions",
            effect="asymmetric_friction",
            by_direction=True,
        ),
        Term(
            "{k}·ω²",
            lambda m, _: [m.omega_m**2],
            (("k", "N m s^2"),),
            "difference of directions",
            by_direction=True,
        ),
    ]


def _of_torque(width: float) -> list[Term]:
    def direction(m: Motion) -> Array:
        return np.tanh(m.omega_m / width)

    def load(text: str, columns: Columns, unit: str, effect: str | None = None) -> Term:
        return Term(text, columns, (("k", unit),), "friction of the load", effect=effect, loaded=True)

    return [
        load(
            "{k}·|τ_e|·sgn(ω)",
            lambda m, _: [np.abs(m.tau_e) * direction(m)],
            "1",
            "load_dependent_friction",
        ),
        load("{k}·|τ_e|·ω", lambda m, _: [np.abs(m.tau_e) * m.omega_m], "s"),
        load("{k}·τ_e²·sgn(ω)", lambda m, _: [m.tau_e**2 * direction(m)], "1/(N m)"),
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
    text = "{k}·x, dx/dθ = (sgn ω − x)/{theta_0}"
    return [Term(text, columns, (("k", "N m"),), "presliding", (shape,))]


def _periodic(order: int, turns: bool) -> str:
    """The effect of the catalogue with a torque of this order over the angle."""
    if order == 1 and not turns:
        return "gravity_torque"
    return "load_torque_pulsation" if order <= _PULSATION else "cogging_torque"


def _waves(width: float, turns: bool) -> list[Term]:
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
        kind = f"torque of order {order} over the angle"
        effect = _periodic(order, turns)
        made.append(Term(text, wave(order, False), strengths, kind, effect=effect))
        if order <= _BY_DIRECTION:
            kind = f"friction of order {order} over the angle"
            made.append(Term(f"({text})·sgn(ω)", wave(order, True), strengths, kind, by_direction=True))
    return made


def _at_one_place(width: float) -> list[Term]:
    """A torque over part of a turn: a tight spot, or a cam."""
    place = Shape("theta_1", "rad", tuple(2.0 * np.pi * k / 12 for k in range(1, 13)), 0.05, 7.0)
    wide = Shape("w", "rad", (0.1, 0.25, 0.6), 0.03, 1.5)

    def bump(m: Motion, p: tuple[float, ...]) -> Array:
        return np.exp((np.cos(m.theta_m - p[0]) - 1.0) / p[1] ** 2)

    torque, text = (("k", "N m"),), "{k}·exp((cos(θ − {theta_1}) − 1)/{w}²)"
    return [
        Term(text, lambda m, p: [bump(m, p)], torque, "torque at one place", (place, wide)),
        Term(
            f"{text}·sgn(ω)",
            lambda m, p: [bump(m, p) * np.tanh(m.omega_m / width)],
            torque,
            "friction at one place",
            (place, wide),
            by_direction=True,
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
            "drift",
        ),
        Term(
            "{k}·exp(−t/{tau})",
            lambda m, p: [np.exp(-(m.t - m.t[0]) / p[0])],
            (("k", "N m"),),
            "drift",
            (tau,),
        ),
    ]
