"""Inspection: what a file is, as far as can be told before anything is diagnosed."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .. import atomic
from .._core import DataError, Machine, UsageError
from ..config.machine_file import MachineFile
from ..config.rules import Rule
from ..errors import fact, refuse
from ..io.columns import converted
from ..io.formats.source import MISSING_FIX, Source
from ..io.loader import described_by, readable, recorded, source_of
from ..io.motion import of_frames, of_motion, settled, stands
from ..io.planning import Survey, surveyed
from ..io.reading import (
    constant_of,
    period_of,
    shortest_constant,
    there,
    told,
    warnings,
    why_not,
)
from ..io.recording import DEFAULT_MAX_BYTES, Recording
from ..io.sampling import Sampling, gap_of
from ..io.signals import Signal, as_read, signals
from ..messages import coded
from ..quantities.poles import pole_pairs
from ..view.readout import origin
from .starting import machine_file
from .values import InspectionValues, Task

Columns = Mapping[str, NDArray[np.float64]]

_POINTS: Final = 0.05
"""Sample time, s, from which rows are operating points, as the core has it."""


class Inspection(InspectionValues):
    """What a file is; `print` shows it, `to_json` gives all of it.

    Attributes
    ----------
    file : str or None
        Name of the file, None for a recording in memory.
    columns : tuple of Signal
        Columns of the file in its order.
    made : mapping of str to str
        Canonical columns that no column of it gives, each with a clause on where it comes from.
    sampling : tuple of Sampling
        One entry for each time base, the first that of the recording; empty where there is no time.
    kind : str or None
        full, electrical, mechanical, operating_points or open_circuit, and None where the recording cannot be
        diagnosed yet.
    load : str or None
        What is known of the load.
    why_not : mapping of str to str
        Why nothing can be asked of the voltages, the motion or the rotor angle, by these words.
    shortest_constant : float
        Electrical time constant l/r_s in s that the motor needs, so that the rows are close enough for its
        voltage equations. Zero where any motor will do, or the nameplate tells.
    tasks : tuple of Task
        What to settle before a diagnosis.
    findings : tuple of mapping
        What was done to the data and seen in it: finding, consequence, fix and code.
    machine_file : str
        Text of a machine file to start from.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> pm.inspect(run).tasks
    ()
    """

    def __repr__(self) -> str:
        used = sum(bool(signal.names) for signal in self.columns)
        what = f"{len(self.tasks)} to settle" if self.kind is None else self.kind
        of = "" if self.file is None else f" of {self.file}"
        return f"<Inspection{of}: {used} of {len(self.columns)} columns used, {what}>"

    def __str__(self) -> str:
        from .text import text

        return text(self)

    def write_machine(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Writes the machine file to start from, whole or not at all.

        Parameters
        ----------
        path : path
            Where it goes.
        force : bool, default False
            Whether a file that is there is replaced.

        Raises
        ------
        UsageError
            Where there is such a file already, unless `force` is set, and where it cannot be written.
        """
        expect_new(path, force=force)
        atomic.write_text(path, self.machine_file)


def expect_new(path: str | os.PathLike[str], *, force: bool) -> None:
    """Raises UsageError where there is a file at `path` already, unless `force` is set."""
    if not force and Path(path).is_file():
        raise refuse(
            UsageError,
            "there is such a file already",
            file=str(path),
            fix="name another one, or write over it by --force (in Python force=True)",
        )


def inspect(
    data: Any,
    machine: str | os.PathLike[str] | MachineFile | Machine | None = None,
    *,
    max_bytes: int = DEFAULT_MAX_BYTES,
    allow_outside: bool = False,
) -> Inspection:
    """Shows what a file or frame is: columns, sampling, questions, and a machine file to start from.

    A recording that cannot be diagnosed yet is inspected as far as possible, and `tasks` of the answer say
    what is missing.

    Parameters
    ----------
    data : path, Recording, mapping of arrays, or frame
        What `load` takes.
    machine : path, MachineFile, Machine or None, default None
        What is known already: nameplate, load, names of columns.
    max_bytes : int, default 2 GiB
        Nothing larger is unpacked.
    allow_outside : bool, default False
        Whether columns may come from files outside the recording's folder.

    Returns
    -------
    Inspection
        What it is.

    Raises
    ------
    UsageError
        Where there is no such file.
    MachineError
        For a bad machine file.
    DataError
        Where no table can be found in the data.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> pm.inspect(run, machine).is_ready
    True
    """
    described = described_by(machine, allow_outside=allow_outside)
    with readable(data):
        return _inspected(source_of(data, max_bytes, described), described, max_bytes)


def _inspected(source: Source, described: MachineFile | Machine | None, max_bytes: int) -> Inspection:
    rules = described.columns if isinstance(described, MachineFile) else {}
    locked = isinstance(described, MachineFile) and described.load == "locked"
    survey = surveyed(source, rules, whole=True, locked=locked)
    found, raw = signals(source, survey)
    recording: Recording | None = None
    refusal: DataError | None = None
    try:
        recording = recorded(source, described, max_bytes)
    except DataError as error:
        refusal = error
    known = described.machine if isinstance(described, MachineFile) else described
    columns = _canonical(recording, source, survey, raw)
    sampling = _sampling(recording, columns, source)
    pairs, still = pole_pairs(columns), stands(columns)
    if recording is not None:
        kind, load, account = recording.kind, recording.load, recording.account
        found = [as_read(signal, account, source) for signal in found]
        findings = warnings(told(account, columns["t"], kind, load))
        period = period_of(columns["t"])
        reasons = why_not(kind, load, account, period=period, machine=known)
        needed = shortest_constant(kind, period, known) if constant_of(known) is None else 0.0
    else:
        kind, load, reasons, needed = None, None, {}, 0.0
        findings = [remark._asdict() for remark in dict.fromkeys(source.remarks)]
    waveform = sampling[0].period if sampling and (sampling[0].period or np.inf) <= _POINTS else None
    frames = settled(found, source, raw, columns)
    made = _made(survey, described)
    have = there({*survey.plan} | {*made})
    motion = have["angle"] or have["speed"]
    incomplete = "t" not in columns or not (have["voltage"] and have["current"] and motion)
    return Inspection(
        source.file,
        tuple(found),
        made,
        tuple(sampling),
        kind,
        load,
        reasons,
        needed,
        tuple(_tasks(survey, found, refusal)),
        tuple(
            coded([*findings, *of_frames(frames), *of_motion(described, pairs, load, still=still)]),
        ),
        machine_file(
            source.file,
            columns,
            found,
            described,
            pairs=pairs,
            frames=frames,
            period=waveform,
            still=still,
            open_lines=survey.problems,
            incomplete=incomplete and (recording is None or not rules),
        ),
    )


def _canonical(
    recording: Recording | None, source: Source, survey: Survey, raw: Columns
) -> dict[str, NDArray[np.float64]]:
    """The canonical SI columns: those of the recording, else those that could be read by themselves."""
    if recording is not None:
        return {name: recording.column(name) for name in recording.names}
    out = {}
    for name, rule in survey.plan.items():
        if rule.source in raw:
            key = "omega_m" if name == "n" else name
            out[key] = converted(raw[rule.source or ""], name, rule, source)
    if "t" in survey.plan and survey.plan["t"].source == source.common and len(source.stamps) == 1:
        # No column of the one group is known, but its times are.
        [name] = source.stamps.values()
        out["t"] = converted(source.read([name])[name], "t", Rule(name), source)
    rows = max((len(values) for values in out.values()), default=0)
    period = survey.plan["t"].period if "t" in survey.plan else None
    if period is not None:
        out["t"] = np.arange(rows, dtype=np.float64) * period
    return out


def _sampling(recording: Recording | None, columns: Columns, source: Source) -> list[Sampling]:
    """The sampling of the recording, and of each group of the file where there are several."""
    out = [Sampling.of(columns["t"], gap=gap_of(columns))] if "t" in columns else []
    if len(source.stamps) > 1 or not out:
        try:
            stamps = source.read(source.stamps.values())
        except DataError:
            # What is wrong with them stands with their columns.
            return out
        for base, name in source.stamps.items():
            out.append(Sampling.of(converted(stamps[name], "t", Rule(name), source), base))
    return out


def _made(survey: Survey, described: MachineFile | Machine | None) -> dict[str, str]:
    """The canonical columns that no column of the file gives, and where they come from."""
    rules = described.columns if isinstance(described, MachineFile) else {}
    beside = {name: rule for name, rule in rules.items() if rule is not None and rule.file is not None}
    made = {name: rule for name, rule in survey.plan.items() if rule.source is None} | beside
    return {name: origin(name, {**vars(rule), "from": rule.source}) for name, rule in made.items()}


def _tasks(survey: Survey, found: Iterable[Signal], refusal: DataError | None) -> list[Task]:
    """What is to be settled before a diagnosis: what the names leave open, then what the values do."""
    if refusal is None:
        return []
    tasks = [Task(each.problem, each.brief or each.fix, each.column) for each in survey.problems]
    at = fact(refusal, "column")
    faulty = [signal for signal in found if signal.names and (signal.missing or signal.why)]
    if at is not None:
        tasks += [_faulty(signal) for signal in faulty]
    if survey.problems or at in {signal.column for signal in faulty}:
        return tasks
    place = fact(refusal, "place")
    problem = str(fact(refusal, "problem") or refusal)
    fix = str(fact(refusal, "fix") or "see what a recording needs in the documentation")
    return [
        *tasks,
        Task(f"{problem}{f' ({place})' if place else ''}", fix, at if isinstance(at, str) else None),
    ]


def _faulty(signal: Signal) -> Task:
    if signal.missing:
        what = "1 value is" if signal.missing == 1 else f"{signal.missing} values are"
        which = "" if signal.missing == 1 else ", the first"
        fix = MISSING_FIX.replace("NAME", signal.names[0])
        return Task(f"{what} missing{which} at {signal.first_missing}", fix, signal.column)
    return Task(
        str(signal.why),
        f"correct it, or leave it out with {signal.names[0]} = false in [columns]",
        signal.column,
    )
