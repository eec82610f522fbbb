"""Own systems: the parameters of any x' = f(t, x, u, p) from a recording of its inputs and outputs."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core
from ._core import DataError, UsageError
from .config.swarm import METHODS, ORDINARY, Swarm
from .errors import bounds_of, did_you_mean, expect_whole, refuse
from .progress import Progress
from .results.estimates import Fit

Array = NDArray[np.float64]
Rhs = Callable[[float, Array, Any, dict[str, Any]], Sequence[Any]]


@dataclass(frozen=True)
class SystemFit(Fit):
    """Estimated parameters of a system of one's own; units are those of its equations.

    Attributes
    ----------
    parameters : mapping of str to Estimate
        Value, standard error and 95 % interval by name.
    cost : float
        Weighted sum of squares.
    history : tuple of float
        Its best value after each generation of the swarm and each step of least squares.
    method : str
        How it was searched.
    evaluations : int
        Number of simulations.
    converged : bool
        Whether the search came to rest.
    interrupted : bool
        Whether Ctrl-C ended it.
    rms : mapping of str to float or None
        Weighted error of each output; None if interrupted.
    cannot_show : tuple of mapping
        Parameters that the recording does not determine, each with the reason.
    data : mapping
        The JSON object.

    Examples
    --------
    >>> import numpy as np
    >>> import pmsm_rs as pm
    >>> t = np.linspace(0.0, 1.0, 100)
    >>> found = pm.identify_system(
    ...     lambda t, x, u, p: [-p["rate"] * x[0]],
    ...     t, None, np.exp(-3.0 * t), parameters={"rate": (0.1, 10.0)}, x0=[1.0],
    ... )
    >>> round(found.parameters["rate"].value, 3)
    3.0
    """

    @classmethod
    def of(cls, text: str, outputs: Sequence[str]) -> Self:
        """Reads the core's answer.

        Parameters
        ----------
        text : str
            The JSON text.
        outputs : sequence of str
            Names of the outputs.

        Returns
        -------
        SystemFit
            The answer.
        """
        data = json.loads(text)
        return cls._of({**data, "rms": dict(zip(outputs, data["rms"], strict=True))})

    def __repr__(self) -> str:
        state = "interrupted" if self.interrupted else "converged" if self.converged else "not converged"
        return f"<SystemFit by {self.method}, {state}: {', '.join(self.parameters)}>"

    def __str__(self) -> str:
        state = "interrupted" if self.interrupted else "converged" if self.converged else "not converged"
        lines = [f"{self.method}: {state} after {self.evaluations} evaluations, cost {self.cost:.6g}", ""]
        width = max(map(len, self.parameters))
        for name, entry in self.parameters.items():
            value = "–" if entry.value is None else f"{entry.value:.6g}"
            spread = f"± {entry.stderr:.2g}" if entry.stderr is not None else f"({entry.why_none})"
            lines.append(f"  {name:<{width}}  {value} {spread}")
        lines += [f"  {item['why']}" for item in self.cannot_show]
        return "\n".join(lines)


def identify_system(
    rhs: Rhs,
    t: ArrayLike,
    inputs: ArrayLike | Mapping[str, ArrayLike] | None,
    measured: ArrayLike | Mapping[str, ArrayLike],
    *,
    parameters: Mapping[str, tuple[float, float]],
    x0: Sequence[float | str],
    output: Rhs | None = None,
    method: str = "pso+lm",
    swarm: Swarm | None = None,
    seed: int = 1,
    start: Mapping[str, float] | None = None,
    weights: Sequence[float] | None = None,
    substeps: int = 1,
    linear_inputs: bool = False,
    vectorised: bool = True,
    progress: Progress | None = None,
) -> SystemFit:
    """Finds the parameters with which a system of one's own reproduces a recording.

    The same swarm and least squares as for a motor do the search, with derivatives by differences. The
    function is called for many candidates at once: `x[0]` and `p["r"]` are arrays, so write it with numpy
    (`np.where`, not `if`), or pass `vectorised=False`, which is slower still. The same system in Rust
    (`pmsm_core::system`) is faster by orders of magnitude. On Ctrl-C the best so far is returned, marked
    `interrupted`.

    Parameters
    ----------
    rhs : callable
        Called as rhs(t, x, u, p), it returns dx/dt, one entry per state. `x` are the states, `p` the
        parameters by name, `u` the inputs at time `t`, by position, or by name where `inputs` is a mapping.
    t : array_like of shape (samples,)
        Times, increasing.
    inputs : array_like, mapping of array_like, or None
        Inputs of shape (samples,) or (samples, inputs), finite.
    measured : array_like or mapping of array_like
        Outputs of shape (samples,) or (samples, outputs), NaN where there is no value.
    parameters : mapping of str to (float, float)
        Bounds by name.
    x0 : sequence of float or str
        The first state, each entry a number or the name of a parameter.
    output : callable or None, default None
        Returns with the same arguments what is measured; None takes the first states.
    method : str, default "pso+lm"
        "pso", "lm" or "pso+lm".
    swarm : Swarm or None, default None
        Settings of the swarm.
    seed : int, default 1
        From 0 on.
    start : mapping of str to float or None, default None
        Where the search starts, a value for every parameter.
    weights : sequence of float or None, default None
        Of the outputs' errors, above zero; None takes the reciprocals of the outputs' standard deviations.
    substeps : int, default 1
        Runge-Kutta steps between two samples.
    linear_inputs : bool, default False
        Whether inputs go in straight lines, not in steps.
    vectorised : bool, default True
        Whether `rhs` takes many candidates at once.
    progress : callable or None, default None
        Is called as progress(stage, fraction) from time to time.

    Returns
    -------
    SystemFit
        Parameters with standard errors, in the units of the equations.

    Raises
    ------
    UsageError
        For names, bounds and shapes that do not go together.
    DataError
        For a recording that cannot be used. What `rhs` raises is raised, too.

    Examples
    --------
    >>> import numpy as np
    >>> import pmsm_rs as pm
    >>> t = np.linspace(0.0, 1.0, 100)
    >>> found = pm.identify_system(
    ...     lambda t, x, u, p: [-p["rate"] * x[0]],
    ...     t, None, np.exp(-3.0 * t), parameters={"rate": (0.1, 10.0)}, x0=[1.0],
    ... )
    >>> round(found.parameters["rate"].value, 3)
    3.0
    """
    if method not in METHODS:
        raise refuse(UsageError, f"there is no method '{method}'", fix=did_you_mean(method, METHODS))
    names, bounds = list(parameters), [bounds_of(name, pair) for name, pair in parameters.items()]
    for name in [*(start or {}), *(entry for entry in x0 if isinstance(entry, str))]:
        if name not in parameters:
            raise refuse(UsageError, f"there is no parameter '{name}'", fix=did_you_mean(name, names))
    if start is not None and set(start) != set(names):
        raise refuse(
            UsageError, "the start does not name every parameter", fix="give all of them, or no start"
        )
    if substeps < 1:
        raise refuse(UsageError, f"substeps is {substeps}", fix="give at least 1")
    expect_whole(seed=seed)
    run = _Run(rhs, output, t, inputs, measured, weights, names, list(x0), substeps, linear_inputs)
    answer = _core.identify_system(
        run.errors if vectorised else run.errors_one_by_one,
        names,
        bounds,
        outputs=len(run.outputs),
        samples=len(run.t),
        start=None if start is None else [float(start[name]) for name in names],
        method=method,
        swarm=(swarm or ORDINARY).settings,
        seed=seed,
        progress=progress,
    )
    return SystemFit.of(answer, run.outputs)


def _columns(data: object, what: str, samples: int) -> tuple[list[str], Array]:
    """Names and an array of shape (columns, samples)."""
    if isinstance(data, Mapping):
        names, rows = [str(name) for name in data], [np.asarray(x, dtype=np.float64) for x in data.values()]
    else:
        array = np.atleast_2d(np.asarray(data, dtype=np.float64).T)
        names, rows = [str(k) for k in range(len(array))], list(array)
    for name, row in zip(names, rows, strict=True):
        if row.shape != (samples,):
            raise refuse(
                DataError,
                f"{what} {name} has shape {row.shape} while t has {samples} samples",
                column=name,
                fix="give one value per sample",
            )
    return names, np.array(rows).reshape(len(rows), samples)


class _Run:
    """A recording and the system that should reproduce it, for many candidates at once."""

    def __init__(
        self,
        rhs: Rhs,
        output: Rhs | None,
        t: ArrayLike,
        inputs: object,
        measured: object,
        weights: Sequence[float] | None,
        names: list[str],
        x0: list[float | str],
        substeps: int,
        linear: bool,
    ) -> None:
        self.rhs, self.output, self.names, self.x0 = rhs, output, names, x0
        self.substeps, self.linear = substeps, linear
        self.t = np.asarray(t, dtype=np.float64)
        if self.t.ndim != 1 or len(self.t) < 8 or not np.all(np.diff(self.t) > 0.0):
            raise refuse(
                DataError,
                "t is no list of times that increase",
                column="t",
                fix="give at least 8 of them, in s",
            )
        keys, self.inputs = _columns({} if inputs is None else inputs, "input", len(self.t))
        self.keys = keys if isinstance(inputs, Mapping) else None
        if not np.all(np.isfinite(self.inputs)):
            raise refuse(DataError, "an input is not finite", fix="an input must be known at every sample")
        self.outputs, self.measured = _columns(measured, "output", len(self.t))
        known = np.isfinite(self.measured)
        if not len(self.outputs) or not known.any(axis=1).all():
            raise refuse(
                DataError, "an output has no value", fix="give at least one output, and leave that out"
            )
        if output is None and len(self.outputs) > len(x0):
            raise refuse(
                UsageError,
                f"{len(self.outputs)} outputs were measured and there are {len(x0)} states",
                fix="say by output(t, x, u, p) what is measured",
            )
        spread = np.array([np.std(row[k]) for row, k in zip(self.measured, known, strict=True)])
        self.weights = np.where(spread > 0.0, 1.0 / np.where(spread > 0.0, spread, 1.0), 1.0)
        if weights is not None:
            self.weights = np.asarray(weights, dtype=np.float64)
            if self.weights.shape != spread.shape or not np.all(self.weights > 0.0):
                raise refuse(UsageError, "the weights do not fit", fix="give one above zero per output")

    def errors_one_by_one(self, points: Array) -> Array:
        """As `errors`, each candidate by itself, in plain numbers."""
        return np.stack([self._errors(point) for point in points])

    def errors(self, points: Array) -> Array:
        """Weighted errors (points, outputs, samples) for candidates (points, parameters)."""
        try:
            return np.ascontiguousarray(np.moveaxis(self._errors(points.T), -1, 0))
        except ValueError as error:
            if "truth value" not in str(error):
                raise
            raise refuse(
                UsageError,
                "the function branches on a value, which holds many candidates",
                fix="write it with np.where, or pass vectorised=False",
            ) from error

    def _errors(self, candidates: Array) -> Array:
        """From candidates of shape (parameters, ...) errors of shape (outputs, samples, ...)."""
        p: dict[str, Any] = dict(zip(self.names, candidates, strict=True))
        shape = candidates.shape[1:]
        x = np.stack([np.broadcast_to(p[x] if isinstance(x, str) else float(x), shape) for x in self.x0])
        shown = np.empty((len(self.outputs), len(self.t), *shape))
        with np.errstate(all="ignore"):
            for k, now in enumerate(self.t):
                shown[:, k] = self._output(now, x, self._u(k, 0.0), p)
                if k + 1 < len(self.t):
                    x = self._step(k, x, p)
        error = (shown.T - self.measured.T).T
        error = (error.T * self.weights).T
        error[~np.isfinite(self.measured)] = 0.0
        return error

    def _output(self, t: float, x: Array, u: Any, p: dict[str, Any]) -> Array:
        if self.output is None:
            return x[: len(self.outputs)]
        return self._stacked(self.output(t, x, u, p), len(self.outputs), x.shape[1:], "output")

    def _step(self, k: int, x: Array, p: dict[str, Any]) -> Array:
        """The classical Runge-Kutta method from sample k to the next."""
        h = (self.t[k + 1] - self.t[k]) / self.substeps
        for step in range(self.substeps):

            def slope(c: float, x: Array, step: int = step) -> Array:
                share = (step + c) / self.substeps
                at = self.t[k] + share * (self.t[k + 1] - self.t[k])
                found = self.rhs(at, x, self._u(k, share), p)
                return self._stacked(found, len(self.x0), x.shape[1:], "rhs")

            k1 = slope(0.0, x)
            k2 = slope(0.5, x + 0.5 * h * k1)
            k3 = slope(0.5, x + 0.5 * h * k2)
            k4 = slope(1.0, x + h * k3)
            x = x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        return x

    def _u(self, k: int, share: float) -> Any:
        values = self.inputs[:, k]
        if self.linear and share > 0.0:
            values = values + share * (self.inputs[:, k + 1] - values)
        return values if self.keys is None else dict(zip(self.keys, values, strict=True))

    def _stacked(self, found: Sequence[Any], count: int, shape: tuple[int, ...], what: str) -> Array:
        if len(found) != count:
            raise refuse(
                UsageError,
                f"{what} returned {len(found)} values in place of {count}",
                fix="return one of each",
            )
        return np.stack([np.broadcast_to(np.asarray(x, dtype=np.float64), shape) for x in found])
