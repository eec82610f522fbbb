"""What online identification says of one window of samples."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from ..errors import written_by
from ..results.estimates import Estimate, estimates
from ..results.words import estimate, number
from ..view.summary import hung


@dataclass(frozen=True)
class Drift:
    """What moved since earlier windows.

    Attributes
    ----------
    looks_like : tuple of str or None
        Any of "thermal", "load" and "mismatch". Empty where all stayed within its uncertainty, and None for a
        skipped window.
    sentence : str
        The same in words.
    """

    looks_like: tuple[str, ...] | None
    sentence: str


@dataclass(frozen=True)
class WindowEstimate:
    """The result of one window.

    Attributes
    ----------
    window : int
        Number of the window, from 0.
    t_start, t_end : float
        Begin and end in s of the log's own time.
    samples : int
        Number of samples in it.
    status : str
        "estimated" or "skipped".
    why : str or None
        Why it was skipped.
    notes : tuple of mapping
        Gaps, lost rows, restarts and short windows: finding, consequence, fix.
    parameters : mapping of str to Estimate
        Values with standard errors in SI units.
    disturbed_load_torque : float or None
        Eq. (4) in N·m: what the load seems to be with the nameplate's J and B.
    cost_first : float or None
        Fitness (9) at the start.
    cost : float or None
        Fitness (9) at the answer.
    history : tuple of float
        Best cost per generation or step.
    evaluations : int
        Number of simulations.
    converged : bool
        Whether the search came to rest.
    widened : bool
        Whether the range of the search was widened.
    cannot_show : tuple of mapping
        Parameters that the window does not determine, each with the reason.
    rms : mapping of str to float
        Measured minus model per channel, in its SI unit.
    noise : mapping of str to float
        White noise of the measurement per channel, in its SI unit.
    drift : Drift
        What moved since earlier windows.
    data : mapping
        The JSON object.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> first = next(pm.track(run, machine, window=0.1))
    >>> pm.WindowEstimate.from_json(first.to_json()) == first
    True
    """

    window: int
    t_start: float
    t_end: float
    samples: int
    status: str
    why: str | None
    notes: tuple[Mapping[str, str], ...]
    parameters: Mapping[str, Estimate]
    disturbed_load_torque: float | None
    cost_first: float | None
    cost: float | None
    history: tuple[float, ...]
    evaluations: int
    converged: bool
    widened: bool
    cannot_show: tuple[Mapping[str, Any], ...]
    rms: Mapping[str, float]
    noise: Mapping[str, float]
    drift: Drift
    data: Mapping[str, Any] = field(repr=False, compare=False)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Reads what `to_json` writes.

        Parameters
        ----------
        text : str
            The JSON text.

        Returns
        -------
        WindowEstimate
            The result.

        Raises
        ------
        DataError
            For anything else.
        """
        with written_by("to_json"):
            return cls._of(json.loads(text))

    @classmethod
    def _of(cls, data: Mapping[str, Any]) -> Self:
        plain = {
            name: data[name]
            for name in (
                *("window", "t_start", "t_end", "samples", "status", "why", "disturbed_load_torque"),
                *("cost_first", "cost", "evaluations", "converged", "widened", "rms", "noise"),
            )
        }
        causes = data["drift"]["looks_like"]
        return cls(
            notes=tuple(data["notes"]),
            parameters=estimates(data["parameters"]),
            history=tuple(data["history"]),
            cannot_show=tuple(data["cannot_show"]),
            drift=Drift(None if causes is None else tuple(causes), data["drift"]["sentence"]),
            data=data,
            **plain,
        )

    def to_json(self) -> str:
        """Gives the whole result as JSON text on one line.

        Returns
        -------
        str
            The line.
        """
        return json.dumps(self.data, ensure_ascii=False, allow_nan=False)

    def __repr__(self) -> str:
        found = ", ".join(
            " ".join([name, *filter(None, estimate(entry)[::2])]) for name, entry in self.parameters.items()
        )
        what = found if self.status == "estimated" else self.status
        return f"<WindowEstimate {self.window}, {self.t_start:.6g} .. {self.t_end:.6g} s: {what}>"

    def __str__(self) -> str:
        """One window of a tracker in one line, with further lines for what happened in it."""
        span = f"{self.t_start:9.4f} .. {self.t_end:.4f} s"
        if self.status != "estimated":
            lines = [f"{span}  skipped: {self.why}"]
        else:
            cells = []
            for name, entry in self.parameters.items():
                cells.append(f"{name} {estimate(entry)}")
            if self.disturbed_load_torque is not None and {"j", "b"} & set(self.parameters):
                cells.append(f"T_Ld {number(self.disturbed_load_torque, 4)} N·m")
            looks = ", ".join(self.drift.looks_like or ()) or "steady"
            rest = "" if self.converged else "  (not at rest)"
            lines = [f"{span}  {'  '.join(cells)}  {looks}{rest}"]
        lines += [hung("             ", f"{note['finding']}: {note['consequence']}") for note in self.notes]
        return "\n".join(lines)
