"""What `inspect` says of a file, as plain values over the JSON that is written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from ..io.sampling import Sampling
from ..io.signals import Signal
from ..results.estimates import json_text

SCHEMA: Final = "pmsm-rs.inspection/1"


@dataclass(frozen=True)
class Task:
    """Something to settle before a diagnosis: what it is, the way out, and the column where it is one's."""

    problem: str
    fix: str
    column: str | None = None


@dataclass(frozen=True)
class InspectionValues:
    """The values of an `Inspection`.

    `file` is None for a recording in memory. `columns` are those of the file in its order, and `made` the
    canonical ones that no column of it gives, each with a clause on where it comes from. `sampling` has one
    entry for each time base, the first of them that of the recording; it is empty where there is no time.

    `kind` is full, electrical, mechanical, operating_points or open_circuit as in a diagnosis, and None where
    the recording cannot be diagnosed yet: `tasks` say why. `load` is what is known of the load. `why_not`
    says why nothing can be asked of the voltages, the motion or the rotor angle, by these words.
    `shortest_constant` is the electrical time constant l/r_s (s) that the motor needs, so that the rows are
    close enough for its voltage equations. It is zero where any motor will do, or the nameplate tells.
    `findings` are what was done to the data and what was seen in it: finding, consequence and fix.
    `machine_file` is the text of a machine file to start from.
    """

    file: str | None
    columns: tuple[Signal, ...]
    made: Mapping[str, str]
    sampling: tuple[Sampling, ...]
    kind: str | None
    load: str | None
    why_not: Mapping[str, str]
    shortest_constant: float
    tasks: tuple[Task, ...]
    findings: tuple[Mapping[str, str], ...]
    machine_file: str

    @property
    def is_ready(self) -> bool:
        """Whether the columns can be diagnosed as they are."""
        return self.kind is not None

    def to_json(self) -> str:
        """Gives all of it as JSON text, schema pmsm-rs.inspection/1.

        Returns
        -------
        str
            The text of its file.
        """
        return json_text(
            {
                "schema": SCHEMA,
                "file": self.file,
                "ready": self.is_ready,
                "kind": self.kind,
                "load": self.load,
                "sampling": [entry.to_dict() for entry in self.sampling],
                "columns": [_column(signal) for signal in self.columns],
                "made": dict(self.made),
                "questions": {
                    "electrical": self.is_ready and "voltages" not in self.why_not,
                    "mechanical": self.is_ready and "motion" not in self.why_not,
                    "why_not": dict(self.why_not),
                },
                "shortest_constant": self.shortest_constant,
                "tasks": [vars(task) for task in self.tasks],
                "findings": [dict(finding) for finding in self.findings],
                "machine_file": self.machine_file,
            }
        )


def _column(signal: Signal) -> dict[str, Any]:
    # JSON has no NaN.
    return {**vars(signal), "course": [None if value != value else value for value in signal.course]}
