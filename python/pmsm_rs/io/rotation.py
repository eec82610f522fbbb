"""The turning of a rotor from the voltages and currents of its stator, where no sensor told it.

The flux linkage that an integral of v - r_s i gives, less l_q i, is the active flux. It lies on the d axis
for salient machines, too, and has the length psi_m + (l_d - l_q) i_d (Boldea, Paicu & Andreescu, IEEE Trans.
Power Electronics 23 (2008) 2612). Least squares over the whole capture, with
the nameplate as prior, fit that length. They find the drift of the integral, r_s, l_d, l_q and the voltage
lost in the dead time. Open terminals are the case i = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
Vector = NDArray[np.complex128]

THIRD: Final = np.exp(2j * np.pi / 3.0)
_TURN: Final = 2.0 * np.pi
_TINY: Final = float(np.finfo(np.float64).tiny)

_TURNS_PER_PIECE: Final = 8.0
"""Electrical turns over which the drift of the integral is a straight line."""
_MOST_PIECES: Final = 40
_PASSES: Final = 3
"""Fits, each of which lays the pieces by the turns that the last one saw."""
_MOST_SAMPLES: Final = 6_000
"""Samples of a fit at most, evenly spread."""
_ROUNDS: Final = 40
_SETTLED: Final = 1e-8
_OF_NAMEPLATE: Final = {"r_s": 0.5, "l": 0.3}
"""Standard deviations of what a nameplate says, share of it: windings warm up and leads add to them, and iron
saturates.
"""
_LOST: Final = 0.1
"""Standard deviation of the voltage that an inverter loses, share of the rms voltage."""
_COASTING: Final = 2.0 * np.pi
_DRIVEN: Final = 0.5 * np.pi
"""Electrical angle to each side, at the usual speed, over which the angle is smoothed.

A rotor turned from outside changes its speed slowly, and the magnets of its poles differ. A motor may reverse
within a few turns. The half turn takes out what repeats twice or six times in one.
"""
USUAL: Final = 0.9
"""Share of the samples that turn no faster than the usual speed."""
_LASTING: Final = 50.0
"""Independent residuals of a turn at most: harmonics and drift make neighbours alike."""


@dataclass(frozen=True)
class Winding:
    """What a nameplate says of the winding: r_s (ohm), l_d and l_q (H), None where it says nothing."""

    r_s: float | None = None
    l_d: float | None = None
    l_q: float | None = None


@dataclass(frozen=True)
class Rotation:
    """How the rotor turned.

    `theta` is the electrical angle (rad, unwrapped) and `omega` its rate (rad/s), both of shape (samples,)
    and without what repeats within a turn. `psi_m` (V s), `r_s` (ohm), `l_d` and `l_q` (H) are those of the
    fit. `lost` is the voltage (V) that the phases lose against the sign of their currents, `offset` that of
    the channels as a space vector (V). `uneven` is the share by which the length of the active flux misses
    its model, and `error` the rms error of the angle (rad) after the fit and the smoothing.
    """

    theta: Real
    omega: Real
    psi_m: float
    r_s: float
    l_d: float
    l_q: float
    lost: float
    offset: complex
    uneven: float
    error: float


def vector(a: Real, b: Real, c: Real) -> Vector:
    """The space vector of three phase values, amplitude-invariant and without their zero sequence."""
    whole: Vector = (2.0 / 3.0) * (a + THIRD * b + THIRD**2 * c)
    return whole


def phases(x: Vector) -> tuple[Real, Real, Real]:
    """The phase values of a space vector, which add up to nothing."""
    return x.real, (x * THIRD**2).real, (x * THIRD).real


def integral(t: Real, x: Vector, *, held: bool = False) -> Vector:
    """Of `x` over time from the first sample on, by trapezoids or of values held to the next sample."""
    steps = x[:-1] if held else 0.5 * (x[1:] + x[:-1])
    return np.concatenate(([0.0j], np.cumsum(np.diff(t) * steps)))


def rotation(t: Real, v: Vector, i: Vector, winding: Winding, *, held: bool = False) -> Rotation:
    """How the rotor turned while the terminals had the space vectors `v` (V) and `i` (A).

    All are of shape (samples,), `t` in s; the voltages are `held` from each sample to the next or of that
    moment.
    """
    fit = _Circle(t, v, i, winding, held)
    reach = _DRIVEN if fit.flows else _COASTING
    course = t
    pieces = 1
    for _ in range(_PASSES):
        fit.solve(course, pieces)
        smooth = smoothed(np.unwrap(np.angle(fit.active())), reach)
        course = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(smooth)))))
        pieces = int(np.clip(course[-1] / _TURN / _TURNS_PER_PIECE, 1, _MOST_PIECES))
        course = course + 1e-6 * course[-1] * (t - t[0]) / (t[-1] - t[0])
    angle = np.unwrap(np.angle(fit.active()))
    theta = _driven(t, angle, fit.torque(), reach) if fit.flows else smoothed(angle, reach)
    # What was smoothed away is in part what a fast change of the speed bends.
    bent = float(np.sqrt(np.mean((angle - theta) ** 2)))
    psi, r_s, l_d, l_q, lost = fit.found
    return Rotation(
        theta,
        np.gradient(theta, t),
        psi,
        r_s,
        l_d,
        l_q,
        lost,
        fit.offset(t),
        fit.noise / max(abs(psi), _TINY),
        float(np.hypot(fit.error(), bent)),
    )


class _Circle:
    """The fit of the active flux's length. `found` are psi_m, r_s, l_d, l_q and the lost voltage."""

    def __init__(self, t: Real, v: Vector, i: Vector, winding: Winding, held: bool) -> None:
        self.used = np.arange(0, len(t), max(1, -(-len(t) // _MOST_SAMPLES)))
        self.flux, self.charge, self.i = integral(t, v, held=held), integral(t, i), i
        self.flows = bool(np.any(i))
        sign = vector(*(_sign(x) for x in phases(i))) if self.flows else i
        self.signs = integral(t, sign)
        level = float(np.sqrt(np.mean(np.abs(v) ** 2)))
        ohms = level / max(float(np.sqrt(np.mean(np.abs(i) ** 2))), _TINY)
        l_d = winding.l_d if winding.l_d is not None else winding.l_q
        l_q = winding.l_q if winding.l_q is not None else winding.l_d
        self.given = np.array([0.0, winding.r_s or 0.0, l_d or 0.0, l_q or 0.0, 0.0])
        r_spread = _OF_NAMEPLATE["r_s"] * winding.r_s if winding.r_s else ohms
        of_l = _OF_NAMEPLATE["l"]
        self.spread = np.array([np.inf, r_spread, of_l * self.given[2], of_l * self.given[3], _LOST * level])
        self.found = self.given.copy()
        self.noise = 0.0

    def solve(self, course: Real, pieces: int) -> None:
        """Gauss-Newton steps over the drift, by `pieces` lines over `course`, and all that is `found`."""
        use = self.used
        knots = np.linspace(course[0], course[-1], pieces + 1)
        self.hats = np.column_stack([np.interp(course, knots, unit) for unit in np.eye(pieces + 1)])
        hats = self.hats[use]
        # At first the drift is the line about which the flux turns.
        self.drift: Vector = np.zeros(pieces + 1, dtype=np.complex128)
        self.drift = np.linalg.lstsq(hats, self.active()[use], rcond=None)[0].astype(np.complex128)
        self.found[0] = np.sqrt(np.mean(np.abs(self.active()[use]) ** 2))
        count = 2 * hats.shape[1]
        for _ in range(_ROUNDS):
            slopes, rest = self._linear()
            self.noise = float(np.sqrt(np.mean(rest**2)))
            prior, off = self._prior(slopes.shape[1])
            step = np.linalg.lstsq(np.concatenate([slopes, prior]), np.append(-rest, off), rcond=None)[0]
            self.drift = self.drift + step[: count // 2] + 1j * step[count // 2 : count]
            self.found = self.found + step[count:]
            if np.abs(step[: count + 1]).max() < _SETTLED * abs(self.found[0]):
                break

    def active(self) -> Vector:
        """The active flux (V s), shape (samples,)."""
        _, r_s, _, l_q, lost = self.found
        active: Vector = self.flux - r_s * self.charge - lost * self.signs - l_q * self.i
        return active - self.hats @ self.drift

    def torque(self) -> Real:
        """The torque over 3/2 n_p (V s A), shape (samples,)."""
        psi, _, l_d, l_q, _ = self.found
        active = self.active()
        seen = self.i * active.conj() / np.maximum(np.abs(active), _TINY)
        product: Real = (psi + (l_d - l_q) * seen.real) * seen.imag
        return product

    def offset(self, t: Real) -> complex:
        """The voltage (V) that makes the flux drift on the whole."""
        drift = self.hats @ self.drift
        away = t - t.mean()
        return complex(np.sum(away * drift) / np.sum(away**2))

    def error(self) -> float:
        """The rms error of the angle (rad) by the standard errors of drift and parameters together."""
        slopes, _ = self._linear()
        prior, _ = self._prior(slopes.shape[1])
        rows = np.concatenate([slopes, prior])
        spread = np.linalg.pinv(rows.T @ rows) * (max(self.noise, _TINY) ** 2 * self._alike())
        unit, size, i = self._seen()
        across = self._parts((1j * unit).conj() / size, i)
        return float(np.sqrt(max(np.mean(np.einsum("ij,jk,ik->i", across, spread, across)), 0.0)))

    def _seen(self) -> tuple[Vector, Real, Vector]:
        z = self.active()[self.used]
        size = np.maximum(np.abs(z), _TINY)
        return z / size, size, self.i[self.used]

    def _parts(self, onto: Vector, i: Vector) -> Real:
        """How the active flux changes along the direction conj(`onto`) with drift, psi_m (not at all), r_s,
        l_d (not at all), l_q and lost voltage.
        """
        hats, none = self.hats[self.used], np.zeros((len(i), 1))
        along = [-(onto * x[self.used]).real[:, None] for x in (self.charge, self.i, self.signs)]
        return np.concatenate(
            [-onto.real[:, None] * hats, onto.imag[:, None] * hats, none, along[0], none, along[1], along[2]],
            axis=1,
        )

    def _linear(self) -> tuple[Real, Real]:
        """The slopes of the length's misfit and the misfit itself (V s)."""
        unit, size, i = self._seen()
        psi, _, l_d, l_q, _ = self.found
        seen = i * unit.conj()
        rest = size - psi - (l_d - l_q) * seen.real
        slopes = self._parts(unit.conj(), i)
        # The saliency's part moves with the angle as well; that is of second order but for l_q itself.
        slopes[:, -5] = -1.0
        slopes[:, -3] = -seen.real
        slopes[:, -2] += seen.real + (l_d - l_q) * seen.imag**2 / size
        if not self.flows:
            slopes[:, -4:] = 0.0
        return slopes, rest

    def _prior(self, count: int) -> tuple[Real, Real]:
        """What the nameplate says as rows beside those of the samples."""
        weight = np.sqrt(self._alike()) * max(self.noise, _TINY) / np.maximum(self.spread, _TINY)
        if not self.flows:
            weight = np.where(np.isinf(self.spread), 0.0, 1.0)
        rows = np.zeros((4, count))
        rows[:, -4:] = np.diag(weight[1:])
        return rows, (weight * (self.given - self.found))[1:]

    def _alike(self) -> float:
        """Samples that count as one independent sample."""
        turns = max(1.0, np.ptp(np.unwrap(np.angle(self.active()))) / _TURN)
        return max(1.0, len(self.used) / (_LASTING * turns))


def _sign(x: Real) -> Real:
    """The sign of a current, which goes over within its noise."""
    bend = np.diff(x, 2)
    noise = float(np.sqrt(np.mean(bend**2) / 6.0)) if len(bend) else 0.0
    width = max(2.0 * noise, 1e-2 * float(np.max(np.abs(x), initial=0.0)), _TINY)
    return x / np.hypot(x, width)


def smoothed(angle: Real, reach: float) -> Real:
    """`angle` (rad) without what repeats within `reach` to each side of a sample, at the usual speed."""
    return _even(angle, _window(angle, reach))


def _window(angle: Real, reach: float) -> int:
    """Samples in which the angle goes on by `reach` at the usual speed."""
    total = float(np.sum(np.abs(np.diff(angle))))
    if len(angle) < 3 or total == 0.0:
        return 0
    # The mean speed lays a first window, and the speed seen through it the one that counts.
    rough = _mean(angle, max(1, round(reach * len(angle) / total)))
    usual = float(np.quantile(np.abs(np.diff(rough)), USUAL))
    return min(max(1, round(reach / usual)), len(angle)) if usual > 0.0 else 0


def _even(x: Real, half: int) -> Real:
    """Means over `half` samples to each side, twice, so that an even acceleration does not change them."""
    once = _mean(x, half)
    return 2.0 * once - _mean(once, half)


def _driven(t: Real, angle: Real, torque: Real, reach: float) -> Real:
    """`smoothed` without changing what the torque of the motor does to the speed.

    That course, twice integrated, is subtracted before and added behind, as large as it is seen in the angle.
    """
    twice = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(t) * (torque[1:] + torque[:-1]))))
    twice = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(t) * (twice[1:] + twice[:-1]))))
    # The window of the angle serves for both: smoothing is linear in what it smooths.
    half = _window(angle, reach)
    bend, bent = twice - _even(twice, half), angle - _even(angle, half)
    size = float(bend @ bend)
    share = max(float(bend @ bent) / size, 0.0) if size > 0.0 else 0.0
    return _even(angle - share * twice, half) + share * twice


def _mean(x: Real, half: int) -> Real:
    """Means of `x` over `half` samples to each side, fewer towards the ends so that both sides are alike."""
    at = np.arange(len(x))
    reach = np.minimum(half, np.minimum(at, len(x) - 1 - at))
    sums = np.concatenate(([0.0], np.cumsum(x)))
    means: Real = (sums[at + reach + 1] - sums[at - reach]) / (2 * reach + 1)
    return means
