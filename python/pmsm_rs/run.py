"""The two questions one can ask: which parameters, and what does the model leave out."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _core
from ._core import DataError, Machine, NotIdentifiableError, Recording, UsageError
from .answers import Diagnosis, Identification
from .config.effect_text import Effect, together
from .config.options import DiagnosisOptions
from .config.rules import Rule
from .errors import NothingToAsk, did_you_mean, expect, expect_whole, fact, refuse
from .given import machine_of, recording_of
from .io.conventions import scaled
from .io.corrections import corrected, of_load
from .io.reading import Account, told, warnings
from .messages import coded
from .progress import Progress
from .results.provenance import dated, stated
from .results.words import lower_first

if TYPE_CHECKING:
    from .config.machine_file import MachineFile
    from .given import Described, Run

METHODS = ("pso", "lm", "pso+lm")
PARAMETERS = ("r_s", "l_d", "l_q", "psi_m", "j", "b", "tau_load")


@dataclass(frozen=True)
class Swarm:
    """Settings of the particle swarm, eq. (5) of Liu, Liu & Cartes (2008), and of its variants.

    Parameters
    ----------
    particles : int, default 30
        Number of particles.
    iterations : int, default 100
        Number of generations.
    inertia : float, default 0.72
        Weight of a particle's own velocity, a pure number.
    cognitive : float, default 1.49
        Weight of the way back to its own best.
    social : float, default 1.49
        Weight of the way to the best it hears of.
    velocity_limit : float, default 0.2
        Largest move, as a share of each parameter's range.
    inertia_schedule : str, default "constant"
        How the inertia goes to `inertia_last`: "constant", "linear" over the iterations, "random" anywhere
        between, or "adaptive" by the share of particles that last got better.
    inertia_last : float or None, default None
        Its last value, with a schedule that is not constant.
    update : str, default "inertia"
        "inertia" (the paper), "constriction" (Clerc & Kennedy 2002) or "fully_informed" (Mendes, Kennedy &
        Neves 2004). The last two need cognitive + social > 4 and have no inertia.
    neighbourhood : str, default "all"
        To whom a particle listens: "all", "ring" or "von_neumann".

    Raises
    ------
    UsageError
        For a name that does not exist.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> pm.Swarm(particles=10, iterations=30, inertia=0.8, cognitive=2.0, social=2.0).particles
    10
    """

    particles: int = 30
    iterations: int = 100
    inertia: float = 0.72
    cognitive: float = 1.49
    social: float = 1.49
    velocity_limit: float = 0.2
    inertia_schedule: str = "constant"
    inertia_last: float | None = None
    update: str = "inertia"
    neighbourhood: str = "all"

    def __post_init__(self) -> None:
        """Checks the names; the core checks the numbers."""
        for field, known in _SWARM_NAMES.items():
            value = getattr(self, field)
            if value not in known:
                raise refuse(
                    UsageError, f"{field} '{value}' is not known", fix=did_you_mean(str(value), known)
                )
        if (self.inertia_schedule == "constant") != (self.inertia_last is None):
            raise refuse(
                UsageError,
                f"inertia_last is {self.inertia_last} with inertia_schedule '{self.inertia_schedule}'",
                fix="give it with a schedule that is not constant, and only then",
            )

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Gives all settings by name, as estimators of scikit-learn do.

        Parameters
        ----------
        deep : bool, default True
            Has no effect: no setting has settings of its own.

        Returns
        -------
        dict of str to object
            From which the same object can be made.
        """
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def settings(self) -> str:
        """As the core reads it: JSON text."""
        schedule: Any = self.inertia_schedule
        if self.inertia_last is not None:
            schedule = {schedule: {"last": self.inertia_last}}
        plain = ("particles", "iterations", "inertia", "cognitive", "social", "velocity_limit")
        return json.dumps(
            {name: getattr(self, name) for name in (*plain, "update", "neighbourhood")}
            | {"schedule": schedule}
        )

    @classmethod
    def parse(cls, text: str) -> Swarm:
        """Reads settings as on the command line.

        Parameters
        ----------
        text : str
            `name=value,name=value`.

        Returns
        -------
        Swarm
            With the default of what is not named.

        Raises
        ------
        UsageError
            Naming what is wrong.
        """
        kinds = {field.name: field.type for field in fields(cls)}
        given: dict[str, Any] = {}
        for part in filter(None, (part.strip() for part in text.split(","))):
            name, mark, value = (piece.strip() for piece in part.partition("="))
            if name not in kinds:
                raise refuse(UsageError, f"a swarm has no '{name}'", fix=did_you_mean(name, kinds))
            kind = str(kinds[name])
            try:
                given[name] = value if kind == "str" else (int(value) if kind == "int" else float(value))
            except ValueError:
                mark = ""
            if not mark:
                raise refuse(UsageError, f"'{part}' says no {kind} of the swarm", fix=f"write {name}=...")
        return cls(**given)


_SWARM_NAMES = {
    "inertia_schedule": ("constant", "linear", "random", "adaptive"),
    "update": ("inertia", "constriction", "fully_informed"),
    "neighbourhood": ("all", "ring", "von_neumann"),
}
ORDINARY = Swarm()


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
        From 0 on. The same seed gives the same answer.
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
        Without a recording, for what is none, and for an option out of range.
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
    other = None if validation is None else recording_of(validation, described)
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
        raise _in_file(error, recordings) from error
    data = _complete(json.loads(answer), recordings, other, known) | converted
    data |= {"machine": stated(known, recordings)}
    return Diagnosis.of(_with_formulas(data, traces, recordings, other), traces)


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


def expect_method(method: object) -> None:
    """Raises UsageError unless `method` is one of METHODS."""
    if method not in METHODS:
        raise refuse(UsageError, f"there is no method '{method}'", fix=did_you_mean(str(method), METHODS))


def swarm_settings(swarm: object) -> str:
    """The settings of a swarm as the core reads them. Raises UsageError for what is no Swarm."""
    expect(Swarm, swarm=swarm)
    assert isinstance(swarm, Swarm)
    return swarm.settings


def refused(error: NotIdentifiableError, recordings: Sequence[Recording] = (), *, seed: int = 1) -> Diagnosis:
    """The refusal of recordings as an answer: its verdict is `undetermined`, every effect stands under
    `cannot_see`, and `data_quality` holds the reason and its remedy.
    """
    data = json.loads(_core.refusal(error.problem, error.fix, seed=seed))
    data["data_quality"] = coded(data["data_quality"])
    return Diagnosis.of(_complete(data, recordings) if recordings else data)


def unanswered(error: NothingToAsk, *, seed: int = 1) -> Diagnosis:
    """The answer on a recording whose columns answer no question: `undetermined`, with the reason."""
    data = json.loads(_core.refusal(error.problem, error.fix, seed=seed))
    data = _with_read(data, [error.read])
    data["data_quality"] = coded(data["data_quality"])
    return Diagnosis.of(data)


def _in_file(
    error: DataError | NotIdentifiableError, recordings: Sequence[Recording]
) -> DataError | NotIdentifiableError:
    """The core's refusal of one of several recordings with the name of its file."""
    number, problem, fix = fact(error, "recording"), fact(error, "problem"), fact(error, "fix")
    file = _file(recordings[number - 1]) if isinstance(number, int) else None
    if file is None or not isinstance(problem, str) or not isinstance(fix, str):
        return error
    row, column = fact(error, "row"), fact(error, "column")
    named = refuse(
        type(error),
        problem,
        file=f"recording {number}, {file}",
        row=row if isinstance(row, int) else None,
        place=f"row {row}" if isinstance(row, int) else None,
        column=column if isinstance(column, str) else None,
        fix=fix,
    )
    named.__dict__.update(recording=number, file=file)
    return named


def _complete(
    data: dict[str, Any],
    recordings: Sequence[Recording],
    validation: Recording | None = None,
    machine: Machine | None = None,
) -> dict[str, Any]:
    """The core's answer with what only this side knows: the files, what was read of them, and what that says
    beside the nameplate.
    """
    for entry, recording in zip(data.get("recordings", ()), recordings, strict=False):
        entry["file"] = _file(recording)
    floors = [entry["noise_floor"] for entry in data.get("recordings", ())]
    floors = floors or [data.get("noise_floor", {})] * len(recordings)
    each = zip(recordings, floors, strict=True)
    complete = _with_read(data, [_read(recording, steady="v_q" in own) for recording, own in each])
    # Lines that undo a mistake are those of the first recording; only where all were read alike do they help.
    accounts = [_account(recording).columns for recording in recordings]
    if all(columns == accounts[0] for columns in accounts):
        load = _mean_load(recordings)
        complete["data_quality"] = [
            of_load(corrected(each, accounts[0]), load, accounts[0]) for each in complete["data_quality"]
        ]
        complete["data_quality"] += _of_convention(data, machine, accounts[0])
    if validation is not None:
        other = _read(validation)
        complete["validation"] = other
        complete["data_quality"] += [_of("Validation run", finding) for finding in warnings(other)]
    complete["data_quality"] = coded(complete["data_quality"])
    return complete


def _mean_load(recordings: Sequence[Recording]) -> float:
    """The mean of the logged load torque, N·m; zero where none was logged."""
    logged = [
        each.column("tau_m") for each in recordings if "tau_m" in each.names and each.load == "measured"
    ]
    return float(np.mean(np.concatenate(logged))) if logged else 0.0


def _of_convention(
    data: Mapping[str, Any], machine: Machine | None, columns: Mapping[str, Rule]
) -> list[dict[str, str]]:
    """The finding on a scale of another convention, where the values of the answer show one."""
    if machine is None:
        return []
    values = data.get("model", {}).get("base", {})
    base = {name: entry["value"] for name, entry in values.items() if entry["value"] is not None}
    plate = {name: value for name in base if (value := getattr(machine, name, None)) is not None}
    found = scaled(base, plate, columns, machine.v_dc)
    return [] if found is None else [found]


def _account(recording: Recording) -> Account:
    return getattr(recording, "account", None) or Account.of_arrays(recording.names)


def _read(recording: Recording, *, steady: bool = True) -> dict[str, Any]:
    account_of = told(
        _account(recording), recording.column("t"), recording.kind, recording.load, steady=steady
    )
    return dated(_file(recording)) | account_of


def _with_read(data: dict[str, Any], reads: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The answer with `read`, and with a finding for each column that was not used though it may be needed.

    `read` is an object for one recording and a list of them for several.
    """
    each = [warnings(read) for read in reads]
    findings = [
        finding if all(finding in other for other in each) else _of(f"Recording {count}", finding)
        for count, own in enumerate(each, 1)
        for finding in own
    ]
    once = [finding for k, finding in enumerate(findings) if finding not in findings[:k]]
    head = {"schema": data["schema"], "verdict": data["verdict"]}
    head["read"] = reads[0] if len(reads) == 1 else list(reads)
    head["data_quality"] = [*once, *data["data_quality"]]
    return head | {name: value for name, value in data.items() if name not in head}


def _of(run: str, finding: Mapping[str, str]) -> dict[str, str]:
    return {**finding, "finding": f"{run}: {lower_first(finding['finding'])}"}


def _file(recording: Recording) -> str | None:
    file = getattr(recording, "file", None)
    return file if isinstance(file, str) else None


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
