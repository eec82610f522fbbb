"""A designed manoeuvre with what is expected of it, in words, in numbers and as files."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _core, atomic
from ..results import tabular

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .references import References

    Array = NDArray[np.float64]

HEAD = "This writes files and moves no motor."


@dataclass(frozen=True)
class Outcome:
    """What is expected where `truth` is true: the residual of `rival` after it has adjusted its parameters.

    `nats` is the evidence against the rival on the scale of the diagnosis, `times_noise` the residual by
    channel. It is largest in `channel`, around the time `at` (s). There the speed is `omega_m` (rad/s) and
    the currents are `i_d` and `i_q` (A).
    """

    truth: str
    rival: str
    nats: float
    times_noise: Mapping[str, float]
    channel: str
    at: float
    omega_m: float
    i_d: float
    i_q: float

    def __str__(self) -> str:
        times = _digits(self.times_noise[self.channel])
        return (
            f"If {self.truth} is true, {self.rival} has a residual of {times} times the noise in "
            f"{self.channel}, however it is refitted: {self.nats:.0f} nats against it. It is largest at "
            f"{_digits(self.at)} s, where the speed is {_digits(self.omega_m)} rad/s and i_q is "
            f"{_digits(self.i_q)} A."
        )


@dataclass(frozen=True)
class Certainty:
    """A parameter that the recording leaves open: its value, and its standard errors before the manoeuvre and
    after it, in its unit.
    """

    name: str
    value: float
    stderr_before: float
    stderr_after: float

    def __str__(self) -> str:
        before, after = _digits(self.stderr_before), _digits(self.stderr_after)
        return f"{self.name} = {_digits(self.value)}, known to ±{before}, would be known to ±{after}."


@dataclass(frozen=True)
class Design:
    """A manoeuvre for the next recording.

    Attributes
    ----------
    task : str
        "tell apart" or "pin down".
    words : str
        What the manoeuvre does.
    references : mapping of array
        Columns of shape (points,), linear between the points: `t` (s), `omega_m_ref` (rad/s, mechanical)
        where the speed is controlled, `i_d_ref` and `i_q_ref` (A). With a speed, `i_q_ref` is added to the
        current for which the speed controller asks.
    rivals : tuple of str
        The models or formulas in question.
    outcomes : tuple of Outcome
        The expected separation of each ordered pair.
    certainties : tuple of Certainty
        The open parameters of a task "pin down".
    nats : float
        Worth of the manoeuvre, of its worst pair.
    decisive : float
        What a verdict asks, nats.
    reached : mapping
        Peaks in simulation as shares of the limits, the largest of all rivals.
    limits : mapping
        What was allowed, in SI units.
    seed : int
        Of the search.
    explained : bool
        False where friction or the like rules every manoeuvre: the dq-model then explains next to nothing,
        and a diagnosis may not begin.

    Examples
    --------
    >>> from pmsm_rs.experiments.outcome import Design
    >>> Design.__name__
    'Design'
    """

    task: str
    words: str
    references: Mapping[str, Array]
    rivals: tuple[str, ...]
    outcomes: tuple[Outcome, ...]
    certainties: tuple[Certainty, ...]
    nats: float
    decisive: float
    reached: Mapping[str, float]
    limits: Mapping[str, Any]
    seed: int
    explained: bool = True

    @property
    def settles(self) -> bool:
        """Whether the manoeuvre is expected to decide between all rivals."""
        return self.task == "tell apart" and self.nats >= self.decisive and self.explained

    @property
    def tables(self) -> dict[str, Any]:
        """The manoeuvre for `pmsm_rs.simulate`: `pm.simulate(**design.tables, effects=answer.model)`."""
        t = [float(x) for x in self.references["t"]]
        named = {"omega_m_ref": "omega_m", "i_d_ref": "i_d", "i_q_ref": "i_q"}
        reference = {
            name: {"t": t, "value": [float(x) for x in self.references[column]]}
            for column, name in named.items()
            if column in self.references
        }
        return {"duration": t[-1], "reference": reference}

    def to_dict(self) -> dict[str, Any]:
        """As its JSON object, without the references.

        Returns
        -------
        dict
            Plain values.
        """
        return {
            "schema": "pmsm-rs.design/1",
            "moves_no_motor": True,
            "task": self.task,
            "manoeuvre": self.words,
            "rivals": list(self.rivals),
            "nats": self.nats,
            "decisive": self.decisive,
            "settles": self.settles,
            "explained": self.explained,
            "outcomes": [
                {
                    "truth": x.truth,
                    "rival": x.rival,
                    "nats": x.nats,
                    "times_noise": dict(x.times_noise),
                    "channel": x.channel,
                    "largest_at": {"t": x.at, "omega_m": x.omega_m, "i_d": x.i_d, "i_q": x.i_q},
                    "sentence": str(x),
                }
                for x in self.outcomes
            ],
            "certainties": [
                {
                    "parameter": x.name,
                    "value": x.value,
                    "stderr_before": x.stderr_before,
                    "stderr_after": x.stderr_after,
                }
                for x in self.certainties
            ],
            "reached": dict(self.reached),
            "limits": dict(self.limits),
            "seed": self.seed,
            "version": _core.__version__,
        }

    def to_json(self) -> str:
        """The JSON object as text.

        Returns
        -------
        str
            JSON text.
        """
        return json.dumps(self.to_dict(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"

    def write(self, path: str | os.PathLike[str]) -> tuple[Path, Path]:
        """Writes the references, and the expected outcomes to a .json beside them.

        Parameters
        ----------
        path : path
            File of the references, .csv or .parquet; its header has units.

        Returns
        -------
        tuple of Path
            Both names.

        Raises
        ------
        UsageError
            Where they cannot be written.
        """
        units = {"t": "s", "omega_m_ref": "rad/s", "i_d_ref": "A", "i_q_ref": "A"}
        columns = {f"{name} ({units[name]})": x for name, x in self.references.items()}
        beside = beside_of(path)
        atomic.expect(str(beside))
        tabular.write(path, columns)
        atomic.write_text(beside, self.to_json())
        return Path(path), beside

    def __repr__(self) -> str:
        return f"<Design to {self.task}: {', '.join(self.rivals)}, {self.nats:.0f} nats>"

    def __str__(self) -> str:
        t = float(self.references["t"][-1])
        names = " from ".join(self.rivals[:2]) + "".join(f" and {x}" for x in self.rivals[2:])
        what = f"to tell {names}"
        if self.task == "pin down":
            what = "to pin down what the recording leaves open"
        lines = [f"A manoeuvre of {_digits(t)} s {what}. {HEAD}", "", f"Manoeuvre: {self.words}."]
        shares = ", ".join(f"{name} {100.0 * x:.0f} %" for name, x in self.reached.items())
        lines += [f"Of the limits it takes in simulation, at most: {shares}.", ""]
        lines += [str(x) for x in (*self.outcomes, *self.certainties)]
        if not self.explained:
            lines += [
                "",
                "The dq-model explains next to nothing of any manoeuvre within these limits, so that a "
                "diagnosis may say nothing of it. Allow more speed, current or time where it is safe.",
            ]
        elif self.task == "tell apart" and not self.settles:
            lines += [
                "",
                f"This does not decide: the worst pair is {self.nats:.1f} nats apart, and a verdict takes "
                f"{self.decisive:.1f}. Allow more speed, current or time where it is safe.",
            ]
        lines += ["", "Record it with the same logger, and give both recordings to the diagnosis."]
        return "\n".join(lines)


def beside_of(path: str | os.PathLike[str]) -> Path:
    """The file of the expected outcomes beside that of the references."""
    return Path(path).with_suffix(".json")


def columns_of(references: References) -> dict[str, Array]:
    """The references as columns."""
    columns = {"t": references.t}
    if references.omega_m is not None:
        columns["omega_m_ref"] = references.omega_m
    return {**columns, "i_d_ref": references.i_d, "i_q_ref": references.i_q}


def _digits(x: float) -> str:
    return f"{x:.3g}"
