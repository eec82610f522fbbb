"""The two questions one can ask: which parameters, and what does the model leave out."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _core
from ._core import DataError, Machine, NotIdentifiableError, PmsmError, Recording, UsageError
from .answers import Diagnosis, Identification
from .completion import completed, file_of, with_read
from .config.effect_text import Effect, together
from .config.options import DiagnosisOptions
from .config.swarm import ORDINARY, Swarm, expect_method, swarm_settings
from .errors import NothingToAsk, bounds_of, did_you_mean, expect, expect_whole, fact, of_run, refuse
from .given import machine_of, recording_of
from .messages import coded
from .progress import Progress
from .quantities.parameters import BASE
from .results.provenance import stated

if TYPE_CHECKING:
    from .config.machine_file import MachineFile
    from .given import Described, Run

PARAMETERS = (*BASE, "tau_load")


def _nameplate(described: Machine | MachineFile) -> tuple[Machine, dict[str, Any]]:
    """The machine itself, and what an answer adds on conversions."""
    if isinstance(described, Machine):
        return described, {}
    converted = [entry.entry() for entry in described.converted]
    return described.machine, {"nameplate": converted} if converted else {}


def identify(
    recording: Run,
    machine: Described,
    *,
    fit: Mapping[str, tuple[float, float] | None] | Iterable[str] | None = None,
    method: str = "pso+lm",
    swarm: Swarm | None = None,
    seed: int = 1,
    uncertainties: bool = True,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Estimates parameters of the dq-model from a recording.

    On Ctrl-C the best so far is returned, marked `interrupted`.

    Parameters
    ----------
    recording : Recording or path
        The run. A file is read as `machine` says.
    machine : Machine, MachineFile or path
        The nameplate, or a machine file that holds it.
    fit : mapping, iterable of str or None, default None
        Names of parameters, of r_s, l_d, l_q, psi_m, j, b and tau_load. A mapping gives each its bounds (low,
        high) in SI units, or None for a wide range around the nameplate. None fits all that the recording can
        show.
    method : str, default "pso+lm"
        "pso" (particle swarm), "lm" (Levenberg-Marquardt from a regression), or both in turn.
    swarm : Swarm or None, default None
        Settings of the swarm.
    seed : int, default 1
        From 0 on. The same seed gives the same answer.
    uncertainties : bool, default True
        False gives values and cost alone, for a search that is repeated many times. The answer has no
        `stderr`, no `ci95` and an empty `rms`, and `cannot_show` only lists what cannot be fitted at all.
    threads : int or None, default None
        None uses every processor; the answer does not depend on it.
    progress : callable or None, default None
        Is called as progress(stage, fraction) from time to time.

    Returns
    -------
    Identification
        Values with standard errors in SI units, cost, and the rms of measured minus model.

    Raises
    ------
    UsageError
        For what is no recording and for unknown names or bounds.
    MachineError
        For a wrong machine file.
    DataError
        Where the recording cannot be read or used.
    NotIdentifiableError
        Where the recording does not show what is asked for.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> found = pm.identify(run, machine, fit={"r_s": (0.2, 4.0)}, method="lm")
    >>> found.parameters["r_s"].unit
    'ohm'
    """
    expect_method(method)
    expect_whole(seed=seed, threads=threads)
    settings = swarm_settings(swarm or ORDINARY)
    described = machine_of(machine)
    known, converted = _nameplate(described)
    answer = _core.identify(
        recording_of(recording, described),
        known,
        fit=fit_bounds(fit),
        method=method,
        swarm=settings,
        seed=seed,
        uncertainties=bool(uncertainties),
        threads=threads,
        progress=progress,
    )
    return Identification.of(json.loads(answer) | converted)


def diagnose(
    recording: Run | Sequence[Run],
    machine: Described,
    validation: Run | None = None,
    *,
    options: DiagnosisOptions | None = None,
    effects: Iterable[Effect] = (),
    seed: int = 1,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Finds out which physics the dq-model leaves out.

    Everything is estimated on `recording`. Several are fitted together by one machine with the same effects,
    each with its own clock, noise, load and initial values. On Ctrl-C the best so far is returned, marked
    `interrupted`.

    Parameters
    ----------
    recording : Recording, path, or sequence of them
        One run of the machine, or several. A file is read as `machine` says.
    machine : Machine, MachineFile or path
        The nameplate, or a machine file that holds it.
    validation : Recording, path or None, default None
        Another run of the same machine, to check the prediction. Nothing is fitted to it but initial values
        and an unknown load.
    options : DiagnosisOptions or None, default None
        The constants on which the verdict rests.
    effects : sequence of Effect, default ()
        Effects given as text, see `effect`, which are asked about besides the catalogue and those of the
        machine file.
    seed : int, default 1
        From 0 on. The answer records it and does not depend on it: a diagnosis draws no random numbers.
    threads : int or None, default None
        None uses every processor; the answer does not depend on it.
    progress : callable or None, default None
        Is called as progress(stage, fraction) from time to time.

    Returns
    -------
    Diagnosis
        Verdict, effects with parameters and standard errors in SI units, budget of the mismatch, and what the
        recording does not show.

    Raises
    ------
    UsageError
        Without a recording, for what is none, for an option out of range, and for a validation run that is
        one of the recordings.
    MachineError
        For a wrong machine file.
    DataError
        Where a recording cannot be read or used. Of several the message names the one, and so do the
        attributes `recording`, counted from 1, and `file`.
    NotIdentifiableError
        Where the recordings do not determine the dq-model.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> answer = pm.diagnose(run, machine, validation=other)
    >>> answer.verdict
    'named'
    >>> answer.effects
    ('dead_time',)
    """
    several = isinstance(recording, Sequence) and not isinstance(recording, str)
    runs: list[Any] = list(recording) if several else [recording]  # type: ignore[arg-type]
    if not runs:
        raise refuse(UsageError, "no recording was given", fix="give at least one")
    expect_whole(seed=seed, threads=threads)
    constants = DiagnosisOptions() if options is None else options
    expect(DiagnosisOptions, options=constants)
    described = machine_of(machine)
    known, converted = _nameplate(described)
    own = together(effects, () if isinstance(described, Machine) else described.effects)
    recordings = [recording_of(run, described) for run in runs]
    other = None
    if validation is not None:
        with of_validation():
            other = recording_of(validation, described)
        if any(_is_same(other, one) for one in recordings):
            raise refuse(
                UsageError,
                "the validation run is the recording itself: it checks nothing",
                fix="give another run of the same machine, or none",
            )
    try:
        answer, traces = _core.diagnose(
            recordings,
            known,
            other,
            options=constants.with_effects([one.definition for one in own]),
            seed=seed,
            threads=threads,
            progress=progress,
        )
    except (DataError, NotIdentifiableError) as error:
        named = _in_file(error, recordings, other)
        if named is None:
            raise
        raise named from error
    data = completed(json.loads(answer), recordings, other, known) | converted
    data |= {"machine": stated(known, recordings)}
    return Diagnosis.of(_with_formulas(data, traces, recordings, other), traces)


@contextmanager
def of_validation() -> Iterator[None]:
    """Raises what is raised while the validation run is read with that in front of its message."""
    try:
        yield
    except PmsmError as error:
        raise of_run(error, "validation run") from error


def _is_same(one: Recording, other: Recording) -> bool:
    """Whether two recordings hold the same samples."""
    names = {*one.names}
    return names == {*other.names} and all(
        np.array_equal(one.column(name), other.column(name)) for name in names
    )


def _with_formulas(
    data: dict[str, Any],
    traces: Mapping[str, Any],
    recordings: Sequence[Recording],
    validation: Recording | None,
) -> dict[str, Any]:
    """The answer with formulas for the torque that has no name, where that is asked of a single recording."""
    if len(recordings) != 1 or data.get("interrupted"):
        return data
    from .formulas import unknown_torque

    try:
        formulas = unknown_torque.found(data, traces, recordings[0], validation)
    except KeyboardInterrupt:
        return data | {"interrupted": True}
    return data if formulas is None else data | {"formulas": formulas}


def refused(error: NotIdentifiableError, recordings: Sequence[Recording] = (), *, seed: int = 1) -> Diagnosis:
    """The refusal of recordings as an answer: its verdict is `undetermined`, every effect stands under
    `cannot_see`, and `data_quality` holds the reason and its remedy.
    """
    data = json.loads(_core.refusal(error.problem, error.fix, seed=seed))
    data["data_quality"] = coded(data["data_quality"])
    return Diagnosis.of(completed(data, recordings) if recordings else data)


def unanswered(error: NothingToAsk, *, seed: int = 1) -> Diagnosis:
    """The answer on a recording whose columns answer no question: `undetermined`, with the reason."""
    data = json.loads(_core.refusal(error.problem, error.fix, seed=seed))
    data = with_read(data, [error.read])
    data["data_quality"] = coded(data["data_quality"])
    return Diagnosis.of(data)


def _in_file(
    error: DataError | NotIdentifiableError,
    recordings: Sequence[Recording],
    validation: Recording | None = None,
) -> DataError | NotIdentifiableError | None:
    """The core's refusal of one of several recordings, or of the validation run, with the name of its file.

    None where it is of none of them.
    """
    number, problem, fix = fact(error, "recording"), fact(error, "problem"), fact(error, "fix")
    run, place = None, "validation run"
    if isinstance(number, int):
        run, place = recordings[number - 1], f"recording {number}"
    elif number == "validation":
        run = validation
    file = None if run is None else file_of(run)
    if file is None or not isinstance(problem, str) or not isinstance(fix, str):
        return None
    row, column = fact(error, "row"), fact(error, "column")
    named = refuse(
        type(error),
        problem,
        file=f"{place}, {file}",
        row=row if isinstance(row, int) else None,
        place=f"row {row}" if isinstance(row, int) else None,
        column=column if isinstance(column, str) else None,
        fix=fix,
    )
    named.__dict__.update(recording=number, file=file)
    return named


def fit_bounds(
    fit: Mapping[str, tuple[float, float] | None] | Iterable[str] | None,
) -> dict[str, tuple[float, float] | None]:
    """Bounds by parameter name, checked; empty for None. Raises UsageError."""
    if fit is None:
        return {}
    if not isinstance(fit, Iterable):
        raise refuse(UsageError, f"fit is {fit!r}", fix=f"name some of {', '.join(PARAMETERS)}")
    given = dict(fit) if isinstance(fit, Mapping) else dict.fromkeys([fit] if isinstance(fit, str) else fit)
    if not given:
        raise refuse(UsageError, "no parameter to fit was named", fix=f"name some of {', '.join(PARAMETERS)}")
    checked: dict[str, tuple[float, float] | None] = {}
    for name, bounds in given.items():
        if name not in PARAMETERS:
            raise refuse(
                UsageError, f"there is no parameter '{name}'", fix=did_you_mean(str(name), PARAMETERS)
            )
        checked[name] = None if bounds is None else bounds_of(name, bounds)
    return checked
