"""The two questions one can ask: which parameters, and what does the model leave out."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from . import _core
from ._core import Machine, Recording, UsageError
from .errors import did_you_mean, refuse
from .results import Diagnosis, Identification

METHODS = ("pso", "lm", "pso+lm")
PARAMETERS = ("r_s", "l_d", "l_q", "psi_m", "j", "b", "tau_load")
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Swarm:
    """Settings of the particle swarm, eq. (5) of Liu, Liu & Cartes (2008).

    `inertia` weighs a particle's own velocity, `cognitive` the way back to its own best, `social` the way to
    the best of all; all three are pure numbers.
    """

    particles: int = 30
    iterations: int = 100
    inertia: float = 0.72
    cognitive: float = 1.49
    social: float = 1.49


def identify(
    recording: Recording,
    machine: Machine,
    *,
    fit: Mapping[str, tuple[float, float] | None] | Iterable[str] | None = None,
    method: str = "pso+lm",
    swarm: Swarm | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Estimates parameters of the dq-model from a recording.

    `fit` names the parameters, with bounds in SI units or None for a wide range around the nameplate; left
    out, every parameter that the recording can show is fitted. `method` is "pso" (particle swarm), "lm"
    (Levenberg-Marquardt from the nameplate) or "pso+lm". `threads` None uses every processor; the answer does
    not depend on it. `progress(stage, fraction)` is called from time to time. On Ctrl-C the best so far is
    returned, marked `interrupted`.

    Raises UsageError for unknown names or bounds, DataError and NotIdentifiableError where the recording
    cannot give what is asked for.
    """
    if method not in METHODS:
        raise refuse(UsageError, f"there is no method '{method}'", fix=did_you_mean(method, METHODS))
    settings = swarm or Swarm()
    answer = _core.identify(
        recording,
        machine,
        fit=_bounds(fit),
        method=method,
        particles=settings.particles,
        iterations=settings.iterations,
        inertia=settings.inertia,
        cognitive=settings.cognitive,
        social=settings.social,
        seed=seed,
        threads=threads,
        progress=progress,
    )
    return Identification.from_json(answer)


def diagnose(
    recording: Recording | Sequence[Recording],
    machine: Machine,
    validation: Recording | None = None,
    *,
    seed: int = 1,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Finds out which physics the dq-model leaves out, from one recording or several of the same machine.

    Everything is estimated on `recording`; `validation`, another run of the same machine, only judges.
    `threads` None uses every processor; the answer does not depend on it. On Ctrl-C the best so far is
    returned, marked `interrupted`.

    Raises DataError where the recordings cannot be used.
    """
    recordings = [recording] if isinstance(recording, Recording) else list(recording)
    if not recordings:
        raise refuse(UsageError, "no recording was given", fix="give at least one")
    answer, traces = _core.diagnose(
        recordings, machine, validation, seed=seed, threads=threads, progress=progress
    )
    return Diagnosis.from_json(answer, traces)


def effects() -> list[dict[str, Any]]:
    """The catalogue: per effect id, title, sentence, equation, acts_in, source, parameters, look_alikes,
    fingerprint.
    """
    catalogue: list[dict[str, Any]] = json.loads(_core.effects())
    return catalogue


def effect(name: str) -> dict[str, Any]:
    """One entry of the catalogue by its id. Raises UsageError naming the nearest ids."""
    known = {entry["id"]: entry for entry in effects()}
    if name not in known:
        raise refuse(UsageError, f"there is no effect '{name}'", fix=did_you_mean(name, known))
    return known[name]


def _bounds(
    fit: Mapping[str, tuple[float, float] | None] | Iterable[str] | None,
) -> dict[str, tuple[float, float] | None]:
    if fit is None:
        return {}
    given = dict(fit) if isinstance(fit, Mapping) else dict.fromkeys([fit] if isinstance(fit, str) else fit)
    if not given:
        raise refuse(UsageError, "no parameter to fit was named", fix=f"name some of {', '.join(PARAMETERS)}")
    checked: dict[str, tuple[float, float] | None] = {}
    for name, bounds in given.items():
        if name not in PARAMETERS:
            raise refuse(UsageError, f"there is no parameter '{name}'", fix=did_you_mean(name, PARAMETERS))
        if bounds is None:
            checked[name] = None
            continue
        try:
            low, high = (float(bound) for bound in bounds)
        except (TypeError, ValueError):
            raise refuse(
                UsageError, f"the bounds of {name} are {bounds!r}", fix="give (low, high) in SI units"
            ) from None
        if not -float("inf") < low < high < float("inf"):
            raise refuse(
                UsageError,
                f"the bounds of {name} are ({low}, {high})",
                fix="give two finite numbers, the lower one first",
            )
        checked[name] = (low, high)
    return checked
