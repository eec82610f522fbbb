"""Estimated parameters, and what a search for them answers."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

from ..errors import written_by


@dataclass(frozen=True)
class Estimate:
    """An estimated parameter.

    Attributes
    ----------
    value : float or None
        In `unit`; None where the recording does not show it.
    stderr : float or None
        Standard error in `unit`.
    ci95 : tuple of (float, float) or None
        The 95 % interval in `unit`.
    unit : str
        SI unit, "1" for a pure number.
    why_none : str or None
        Why there is no uncertainty.
    """

    value: float | None
    stderr: float | None
    ci95: tuple[float, float] | None
    unit: str
    why_none: str | None

    @classmethod
    def of(cls, entry: Mapping[str, Any]) -> Self:
        """Reads its JSON object.

        Parameters
        ----------
        entry : mapping
            The object.

        Returns
        -------
        Estimate
            The value.
        """
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
        """Gives the whole answer as JSON text.

        Returns
        -------
        str
            The text of its file.
        """
        return json_text(self.data)


@dataclass(frozen=True)
class IdentificationValues(Fit):
    """The values of an `Identification`."""

    rms: Mapping[str, float]
    seed: int
    version: str

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Reads what `to_json` writes.

        Parameters
        ----------
        text : str
            The JSON text.

        Returns
        -------
        Identification
            The answer.

        Raises
        ------
        DataError
            For anything else.
        """
        with written_by("to_json"):
            return cls.of(json.loads(text))

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Self:
        """Reads the JSON object of an answer.

        Parameters
        ----------
        data : mapping
            The object.

        Returns
        -------
        Identification
            The answer.
        """
        return cls._of(data, seed=data["seed"], version=data["version"])

    @property
    def nameplate(self) -> Sequence[Mapping[str, Any]]:
        """What was converted of the nameplate in a machine file, one JSON object for each entry."""
        entries: Sequence[Mapping[str, Any]] = self.data.get("nameplate", ())
        return entries
