"""Answers as plain frozen values over the JSON that is written to files."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self, overload

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from .notebook import Page
    from .unmodelled import Unmodelled

Traces = Mapping[str, "Mapping[str, NDArray[np.float64]]"]


@dataclass(frozen=True)
class Estimate:
    """An estimated parameter: `value` and `stderr` in `unit`, the 95 % interval, or why there is no
    uncertainty.
    """

    value: float | None
    stderr: float | None
    ci95: tuple[float, float] | None
    unit: str
    why_none: str | None

    @classmethod
    def of(cls, entry: Mapping[str, Any]) -> Self:
        """From its JSON object."""
        interval = entry.get("ci95")
        return cls(
            entry.get("value"),
            entry.get("stderr"),
            (interval[0], interval[1]) if interval else None,
            entry["unit"],
            entry.get("why_none"),
        )


def estimates(entries: Mapping[str, Any]) -> dict[str, Estimate]:
    """Estimates by name from their JSON objects."""
    return {name: Estimate.of(entry) for name, entry in entries.items()}


def json_text(data: object) -> str:
    """An answer as the text of its file."""
    return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


@dataclass(frozen=True)
class Fit:
    """What every search for parameters answers, be it for a motor or for a system of one's own."""

    parameters: Mapping[str, Estimate]
    cost: float
    history: tuple[float, ...]
    method: str
    evaluations: int
    converged: bool
    interrupted: bool
    rms: Mapping[str, float | None]
    cannot_show: tuple[Mapping[str, Any], ...]
    data: Mapping[str, Any] = field(repr=False, compare=False, kw_only=True)

    @classmethod
    def _of(cls, data: Mapping[str, Any], **own: Any) -> Self:
        """From the JSON object, with the fields that only this kind of answer has."""
        return cls(
            parameters=estimates(data["parameters"]),
            cost=math.inf if data["cost"] is None else data["cost"],
            history=tuple(data["history"]),
            method=data["method"],
            evaluations=data["evaluations"],
            converged=data["converged"],
            interrupted=data["interrupted"],
            rms=data["rms"],
            cannot_show=tuple(data["cannot_show"]),
            data=data,
            **own,
        )

    def to_json(self) -> str:
        """The whole answer as JSON text."""
        return json_text(self.data)


@dataclass(frozen=True)
class Identification(Fit):
    """Estimated parameters of the dq-model.

    `history` holds the best cost of each generation, `rms` measured minus model per channel in its SI unit,
    and `cannot_show` the parameters that this recording does not determine, with the reason.
    """

    rms: Mapping[str, float]
    seed: int
    version: str

    @classmethod
    def from_json(cls, text: str) -> Self:
        """From what `to_json` writes."""
        data = json.loads(text)
        return cls._of(data, seed=data["seed"], version=data["version"])

    def __str__(self) -> str:
        from .summary import identification

        return identification(self)

    def _repr_html_(self) -> str:
        from .notebook import identification

        return identification(self)


@dataclass(frozen=True)
class Location:
    """Where a mismatch sits: the equation (d, q, mechanical, sensor), its share, and the operating points.

    `recordings` are the numbers, from 1, of those that show it where not all of several do.
    """

    equation: str
    share: float
    sentence: str
    where: tuple[Mapping[str, Any], ...]
    order_electrical: float | None
    order_mechanical: float | None
    frequency_hz: float | None
    trend: str | None
    p_value: float | None
    recordings: tuple[int, ...] = ()


@dataclass(frozen=True)
class Candidate:
    """An omitted effect that would explain the mismatch, with its probability, parameters and look-alikes."""

    effect: str
    probability: float
    sentence: str
    equation: str
    parameters: Mapping[str, Estimate]
    equivalent_to: tuple[str, ...]
    gain_held_out: float | None


@dataclass(frozen=True)
class Diagnosis:
    """What the dq-model leaves out; fields are those of the JSON answer, of which `effects` and `base` stand
    under `model` there.

    Channels are i_d, i_q (A), omega_e (rad/s, electrical), of operating points v_d, v_q (V). `noise_floor`
    is what a perfect model would leave in each, `fit["recording" or "validation"]["before" or "after"]`
    what is left, both as root mean square in the channel's unit. `data_quality` has finding, consequence
    and fix; `cannot_see` effect, why, and power, the probability that it would have been found.
    `data["path"]` is the way to the model, one effect more at each step.

    `traces["recording"]` and, where a validation run was given, `traces["validation"]` hold arrays of shape
    (samples,): `t` in s, per channel `NAME_measured`, `NAME_before`, `NAME_after`, and the operating point
    `op_omega_e` (rad/s), `op_i_d`, `op_i_q` (A), `op_theta_e`, `op_theta_m` (rad) as far as they are known.
    Several recordings lie end to end there, numbered by `recording`; `recordings` says of each its file,
    samples, duration in s, kind, load, noise_floor and fit, and is empty for a single one.
    """

    verdict: str
    data_quality: tuple[Mapping[str, str], ...]
    located: tuple[Location, ...]
    ranking: tuple[Candidate, ...]
    effects: tuple[str, ...]
    base: Mapping[str, Estimate]
    cannot_see: tuple[Mapping[str, Any], ...]
    next_experiment: str | None
    noise_floor: Mapping[str, float]
    fit: Mapping[str, Mapping[str, Mapping[str, float]]]
    recording_kind: str | None
    recordings: tuple[Mapping[str, Any], ...]
    interrupted: bool
    seed: int
    version: str
    data: Mapping[str, Any] = field(repr=False, compare=False)
    traces: Traces = field(repr=False, compare=False, default_factory=dict)

    @classmethod
    def from_json(cls, text: str, traces: Traces | None = None) -> Self:
        """From what `to_json` writes, with the traces where they are at hand."""
        data = json.loads(text)
        return cls(
            verdict=data["verdict"],
            data_quality=tuple(data["data_quality"]),
            located=tuple(_location(entry) for entry in data["located"]),
            ranking=tuple(_candidate(entry) for entry in data["ranking"]),
            effects=tuple(data["model"]["effects"]),
            base=estimates(data["model"]["base"]),
            cannot_see=tuple(data["cannot_see"]),
            next_experiment=data["next_experiment"],
            noise_floor=data["noise_floor"],
            fit=data["fit"],
            recording_kind=data.get("recording_kind"),
            recordings=tuple(data.get("recordings", ())),
            interrupted=bool(data.get("interrupted", False)),
            seed=data["seed"],
            version=data["version"],
            data=data,
            traces={name: trace for name, trace in (traces or {}).items() if len(trace)},
        )

    @property
    def model(self) -> Mapping[str, Any]:
        """The model that was settled on: `effects` and `base`, and `unmodelled` where the verdict is
        unknown, as in the JSON answer.
        """
        model: Mapping[str, Any] = self.data["model"]
        return model

    @property
    def unmodelled(self) -> Unmodelled | None:
        """Where the verdict is unknown, the map of what no candidate explains; else None."""
        from .unmodelled import Unmodelled

        entry = self.model.get("unmodelled")
        return None if entry is None else Unmodelled.of(entry)

    @property
    def shown(self) -> str | None:
        """Which traces are judged and drawn: "validation" where there is one, else "recording", None
        without traces.
        """
        return next((name for name in ("validation", "recording") if name in self.traces), None)

    def to_json(self) -> str:
        """The whole answer as JSON text, schema pmsm-rs.diagnosis/1."""
        return json_text(self.data)

    @overload
    def report(self, path: str | os.PathLike[str], title: str | None = None) -> None: ...
    @overload
    def report(self, path: None = None, title: str | None = None) -> Page: ...
    def report(self, path: str | os.PathLike[str] | None = None, title: str | None = None) -> Page | None:
        """One self-contained HTML page: written to `path`, or returned for a notebook to show.

        The same answer gives the same bytes. Raises UsageError if it cannot be written.
        """
        from .notebook import Page
        from .report import render

        page = Page(render(self, title))
        if path is None:
            return page
        page.save(path)
        return None

    def trajectories(self, path: str | os.PathLike[str]) -> None:
        """Writes t and the measured, before and after values per channel as Parquet.

        Raises UsageError if it cannot.
        """
        from .trajectories import write

        write(self, path)

    def plot(self) -> Figure:
        """A matplotlib figure: measured minus model before and after over time, and over the operating
        points.
        """
        from .plot import overview

        return overview(self)

    def __str__(self) -> str:
        from .summary import diagnosis

        return diagnosis(self)

    def _repr_html_(self) -> str:
        from .notebook import diagnosis

        return diagnosis(self)


def _location(entry: Mapping[str, Any]) -> Location:
    return Location(
        entry["equation"],
        entry["share"],
        entry["sentence"],
        tuple(entry.get("where") or ()),
        entry.get("order_electrical"),
        entry.get("order_mechanical"),
        entry.get("frequency_hz"),
        entry.get("trend"),
        entry.get("p_value"),
        tuple(entry.get("recordings", ())),
    )


def _candidate(entry: Mapping[str, Any]) -> Candidate:
    return Candidate(
        entry["effect"],
        entry["probability"],
        entry["sentence"],
        entry["equation"],
        estimates(entry["parameters"]),
        tuple(entry["equivalent_to"]),
        entry.get("gain_held_out"),
    )
