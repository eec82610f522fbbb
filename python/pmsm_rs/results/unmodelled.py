"""What a diagnosis could not name but still models: missing voltage or torque, or the error of the angle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from .._core import UsageError
from ..errors import refuse

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray


_QUANTITIES = {
    "d": "missing v_d",
    "q": "missing v_q",
    "mechanical": "missing torque",
    "sensor": "angle error",
}


@dataclass(frozen=True)
class Term:
    """What a map adds to one equation.

    Attributes
    ----------
    equation : str
        d, q, mechanical or sensor.
    sentence : str
        The same in words.
    formula : str
        Where it enters.
    variables : tuple of mapping
        The factors, as in the JSON answer.
    coefficients : ndarray
        One axis per factor, in `unit`.
    unit : str
        SI unit of the term.
    peak : float
        Largest absolute value over the recording, in `unit`.
    """

    equation: str
    sentence: str
    formula: str
    variables: tuple[Mapping[str, Any], ...]
    coefficients: NDArray[np.float64]
    unit: str
    peak: float

    @property
    def quantity(self) -> str:
        """What it is, as an axis of a plot has it."""
        return _QUANTITIES[self.equation]

    @classmethod
    def of(cls, entry: Mapping[str, Any]) -> Self:
        """Reads its JSON object.

        Parameters
        ----------
        entry : mapping
            The object.

        Returns
        -------
        Term
            The term.
        """
        import numpy as np

        variables = tuple(entry["variables"])
        shape = [_count(variable) for variable in variables]
        return cls(
            entry["equation"],
            entry["sentence"],
            entry["formula"],
            variables,
            np.asarray(entry["coefficients"], dtype=float).reshape(shape),
            entry["unit"],
            entry["peak"],
        )

    def __call__(self, **signals: ArrayLike) -> NDArray[np.float64]:
        """The term at the given values of its variables, arrays of one shape in SI units.

        Raises UsageError naming a variable that is missing.
        """
        import numpy as np

        missing = [v["variable"] for v in self.variables if v["variable"] not in signals]
        if missing:
            raise refuse(UsageError, f"the term depends on {' and '.join(missing)}", fix="give it as well")
        factors = [functions(v, np.asarray(signals[v["variable"]], dtype=float)) for v in self.variables]
        axes = "ab"[: len(factors)]
        product = f"{axes},{','.join(f'{axis}...' for axis in axes)}->..."
        return np.asarray(np.einsum(product, self.coefficients, *factors), dtype=float)


@dataclass(frozen=True)
class Unmodelled:
    """A map of what no candidate explains.

    Attributes
    ----------
    sentence : str
        The same in words.
    gain_held_out : float or None
        Share of the residual's squares above the noise that it removes: on the validation run, or on the
        recording itself without one. None without a map.
    terms : tuple of Term
        Its terms; none if no map improves the prediction.
    """

    sentence: str
    gain_held_out: float | None
    terms: tuple[Term, ...]

    @classmethod
    def of(cls, entry: Mapping[str, Any]) -> Self:
        """Reads its JSON object.

        Parameters
        ----------
        entry : mapping
            The object.

        Returns
        -------
        Unmodelled
            The map.
        """
        return cls(entry["sentence"], entry["gain_held_out"], tuple(Term.of(t) for t in entry["terms"]))


def _count(variable: Mapping[str, Any]) -> int:
    if variable["basis"] == "harmonic":
        return 2 * len(variable["orders"])
    if variable["basis"] == "direction":
        return 2
    return int(variable["pieces"] + variable["degree"])


def functions(variable: Mapping[str, Any], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """The functions of one factor at `x`, shape (functions, *x.shape).

    They are cos and sin of each order in turn, one function for either direction of rotation, or uniform
    B-splines (de Boor 1978) whose ends hold outside.
    """
    import numpy as np

    if variable["basis"] == "harmonic":
        turns = np.multiply.outer(np.asarray(variable["orders"], dtype=float), x)
        waves = np.stack([np.cos(turns), np.sin(turns)], axis=1)
        return waves.reshape(-1, *x.shape)
    if variable["basis"] == "direction":
        half = 0.5 * np.tanh(x / variable["width"])
        return np.stack([0.5 + half, 0.5 - half])
    degree, pieces = variable["degree"], variable["pieces"]
    warp = float(variable.get("warp", 0.0))
    low, high, at = (v / (warp + abs(v)) if warp > 0.0 else v for v in (variable["low"], variable["high"], x))
    place = np.clip((at - low) * pieces / (high - low), 0.0, pieces)
    # Cox–de Boor from the interval in which a value lies; the last interval is closed.
    cell = np.minimum(np.floor(place), pieces - 1)
    values = np.stack([(cell == k - degree).astype(float) for k in range(pieces + 2 * degree)])
    knots = np.arange(-degree, pieces + degree + 1, dtype=float)
    for size in range(1, degree + 1):
        rows = len(values) - 1
        values = np.stack(
            [
                ((place - knots[k]) * values[k] + (knots[k + size + 1] - place) * values[k + 1]) / size
                for k in range(rows)
            ]
        )
    return values


def reach(variable: Mapping[str, Any]) -> tuple[float, float]:
    """The range of a factor that is worth a picture: one turn of an angle, a few swings in time, both
    sides of standstill, or the range of its splines.
    """
    import math

    if variable["basis"] == "b_spline":
        return variable["low"], variable["high"]
    if variable["basis"] == "direction":
        return -3 * variable["width"], 3 * variable["width"]
    if variable["variable"] == "t":
        return 0.0, 6 * math.pi / min(variable["orders"])
    return 0.0, 2 * math.pi
