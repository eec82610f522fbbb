"""Many recordings: each is diagnosed by itself, wherever an executor runs it, and none is lost.

A recording that cannot be diagnosed, or that kills its workers, gives a Failure in its place.
"""

from __future__ import annotations

import html
import json
import os
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import Any, overload

from .. import _core
from .._core import Machine, UsageError
from ..answers import Diagnosis
from ..config.machine_file import MachineFile, read_machine
from ..errors import expect_whole, printable, refuse
from ..given import machine_of
from ..io.recording import DEFAULT_MAX_BYTES, Recording
from ..progress import Progress
from ..results.words import percent
from ..view.headline import headline, is_whole
from ..view.summary import WIDTH, hung
from .crew import INTERRUPTED, Crew, Makes, Run, Task, Told
from .ledger import Ledger

Described = str | os.PathLike[str] | MachineFile | Machine


@dataclass(frozen=True)
class Failure:
    """Why a recording has no diagnosis.

    Attributes
    ----------
    name : str
        Name of the recording.
    kind : str
        Class of the error, WorkerLost or Interrupted.
    message : str
        What it says.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> fleet = pm.diagnose_many(["there_is_none.csv"], pm.Machine(n_p=4))
    >>> fleet.failures[0].kind
    'UsageError'
    """

    name: str
    kind: str
    message: str

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True)
class Fleet(Sequence["Diagnosis | Failure"]):
    """Diagnoses of many recordings in the order in which they were given, a Failure where there is none.

    Traces are not kept: diagnose a single recording again to draw it.

    Attributes
    ----------
    names : tuple of str
        Names of the recordings.
    results : tuple of Diagnosis or Failure
        One for each recording.
    resumed : int
        How many came from the ledger.
    interrupted : bool
        Whether Ctrl-C cut the work short.
    damaged : tuple of int
        Numbers, from 1, of lines of the ledger that could not be used. Their recordings were computed again.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> fleet = pm.diagnose_many(["there_is_none.csv"], pm.Machine(n_p=4))
    >>> len(fleet), fleet.resumed
    (1, 0)
    """

    names: tuple[str, ...]
    results: tuple[Diagnosis | Failure, ...]
    resumed: int = 0
    interrupted: bool = False
    damaged: tuple[int, ...] = ()

    @property
    def failures(self) -> tuple[Failure, ...]:
        """The recordings without a diagnosis."""
        return tuple(result for result in self.results if isinstance(result, Failure))

    @property
    def answers(self) -> dict[str, Diagnosis]:
        """The diagnoses by the names of their recordings."""
        pairs = zip(self.names, self.results, strict=True)
        return {name: result for name, result in pairs if isinstance(result, Diagnosis)}

    def to_list(self) -> list[dict[str, Any]]:
        """Gives the answers as plain data.

        Returns
        -------
        list of dict
            Per recording its `name` with the whole `answer`, or with `failure`, its `kind` and `message`.
        """
        return [_entry(name, result) for name, result in zip(self.names, self.results, strict=True)]

    def __len__(self) -> int:
        return len(self.results)

    @overload
    def __getitem__(self, index: int) -> Diagnosis | Failure: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Diagnosis | Failure, ...]: ...
    def __getitem__(self, index: int | slice) -> Diagnosis | Failure | tuple[Diagnosis | Failure, ...]:
        return self.results[index]

    def __repr__(self) -> str:
        return f"<Fleet of {len(self)} recordings: {', '.join(self._counts())}>"

    def _counts(self) -> list[str]:
        """How many there are of each verdict."""
        return [f"{count} {verdict}" for verdict, count in Counter(map(_verdict, self)).most_common()]

    def __str__(self) -> str:
        """How many there are of each verdict, and a line for each recording."""
        lines = [", ".join(self._counts())]
        if self.interrupted:
            lines.append("Interrupted: run it again with the same ledger for the rest.")
        lines.append("")
        wide = min(max((len(printable(name)) for name in self.names), default=0), WIDTH // 2)
        for name, result in zip(self.names, self, strict=True):
            name = printable(name)
            shown = name if len(name) <= wide else f"…{name[1 - wide :]}"
            lines.append(hung(f"{shown:<{wide}}  ", _line(result)))
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"


def diagnose_many(
    recordings: Sequence[Run],
    machine: Described | Sequence[Described],
    *,
    validations: Sequence[Run | None] | None = None,
    executor: Makes | None = None,
    ledger: str | os.PathLike[str] | None = None,
    seed: int = 1,
    threads: int = 1,
    max_bytes: int = DEFAULT_MAX_BYTES,
    progress: Progress | None = None,
) -> Fleet:
    """Diagnoses every recording by itself.

    An error with one recording is a Failure in its place. On Ctrl-C what is finished is returned, marked
    `interrupted`.

    Parameters
    ----------
    recordings : sequence of path or Recording
        The runs.
    machine : Machine, MachineFile, path, or sequence of them
        One machine for all, or one for each.
    validations : sequence or None, default None
        A validation run, or None, for each.
    executor : Executor, callable or None, default None
        Any concurrent.futures.Executor, such as a ProcessPoolExecutor or dask's `client.get_executor()`, or a
        function that makes one. The function is asked again after a pool broke. None takes threads of this
        process, one per processor.
    ledger : path or None, default None
        A file to which every finished recording is appended. In a second run with the same ledger, what it
        holds is not computed again unless recording, machine, seed or version of the package changed.
    seed : int, default 1
        From 0 on. The same seed gives the same answers.
    threads : int, default 1
        Threads within one diagnosis.
    max_bytes : int, default 2 GiB
        Nothing larger is unpacked.
    progress : callable or None, default None
        Is called as progress(stage, fraction) after each recording.

    Returns
    -------
    Fleet
        The answers in the order of the recordings.

    Raises
    ------
    UsageError
        Where the arguments do not fit together or the ledger cannot be written.
    MachineError
        For a bad machine file.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> answers = pm.diagnose_many([run, other], machine)
    >>> [answer.verdict for answer in answers]
    ['named', 'named']
    """
    expect_whole(seed=seed, threads=threads)
    tasks = _tasks(recordings, machine, validations, seed, threads, max_bytes)
    keys = [task.key() for task in tasks]
    interrupted = False
    with nullcontext() if ledger is None else Ledger(ledger) as book:
        found = {key: result for key in keys if (result := _recorded(book, key)) is not None}
        resumed = sum(key in found for key in keys)
        todo = {key: task for key, task in zip(keys, tasks, strict=True) if key not in found}
        crew = Crew(executor, todo)
        try:
            for key, told in crew.results():
                found[key] = result = _result(todo[key].name, told)
                if book is not None:
                    book.add(key, _entry(todo[key].name, result))
                if progress is not None:
                    progress(f"{len(found)} of {len(set(keys))}", len(found) / len(set(keys)))
        except KeyboardInterrupt:
            interrupted = True
        finally:
            crew.end()
        damaged = () if book is None else tuple(book.damaged)
    results = [found.get(key) or _interrupted(task) for key, task in zip(keys, tasks, strict=True)]
    named = [
        replace(result, name=task.name) if isinstance(result, Failure) else result
        for result, task in zip(results, tasks, strict=True)
    ]
    return Fleet(tuple(task.name for task in tasks), tuple(named), resumed, interrupted, damaged)


def _tasks(
    recordings: Sequence[Run],
    machine: Described | Sequence[Described],
    validations: Sequence[Run | None] | None,
    seed: int,
    threads: int,
    max_bytes: int,
) -> list[Task]:
    if isinstance(recordings, str | os.PathLike | Recording):
        raise refuse(UsageError, "recordings is a single one", fix="give a list of recordings")
    runs = list(recordings)
    described: list[Described] = (
        [machine] * len(runs)
        if isinstance(machine, str | os.PathLike | MachineFile | Machine) or not isinstance(machine, Iterable)
        else list(machine)
    )
    others = [None] * len(runs) if validations is None else list(validations)
    if not len(runs) == len(described) == len(others):
        raise refuse(
            UsageError,
            f"there are {len(runs)} recordings, {len(described)} machines and {len(others)} validations",
            fix="give one of each, or one machine for all",
        )
    for run in [*runs, *(other for other in others if other is not None)]:
        if not isinstance(run, str | os.PathLike | Recording):
            raise refuse(
                UsageError,
                f"a {type(run).__name__} was given where a recording is expected",
                fix="give Recordings and names of files",
            )
    read: dict[str, MachineFile] = {}

    def one(what: Described) -> MachineFile | Machine:
        if isinstance(what, str | os.PathLike):
            return read.setdefault(str(what), read.get(str(what)) or read_machine(what))
        return machine_of(what)

    token = os.urandom(8).hex()
    return [
        Task(token, _name(run, k), run, other, one(what), seed, threads, max_bytes)
        for k, (run, what, other) in enumerate(zip(runs, described, others, strict=True))
    ]


def _name(run: Run, index: int) -> str:
    return f"recording {index}" if isinstance(run, Recording) else str(run)


def _result(name: str, told: Told) -> Diagnosis | Failure:
    what, first, second = told
    return Diagnosis.from_json(first) if what == "answer" else Failure(name, first, second)


def _interrupted(task: Task) -> Failure:
    return Failure(
        task.name, INTERRUPTED, f"{task.name}: interrupted before there was a result; run it again"
    )


def _verdict(result: Diagnosis | Failure) -> str:
    if isinstance(result, Failure):
        return "failed"
    part = " in what was asked" if result.verdict == "no_mismatch" and not is_whole(result) else ""
    verdict = "named in part" if result.verdict == "partial" else result.verdict.replace("_", " ")
    return verdict + part


def _line(result: Diagnosis | Failure) -> str:
    if isinstance(result, Failure):
        return f"failed: {result.kind}"
    named = result.verdict in {"named", "partial"} and result.ranking
    sure = f" ({percent(result.ranking[0].probability)})" if named else ""
    return f"{headline(result)}{sure}"


def _entry(name: str, result: Diagnosis | Failure) -> dict[str, Any]:
    if isinstance(result, Diagnosis):
        return {"name": name, "answer": result.data}
    return {"name": name, "failure": {"kind": result.kind, "message": result.message}}


def _recorded(book: Ledger | None, key: str) -> Diagnosis | Failure | None:
    """What the ledger knows; lost workers get another chance, refused data would be refused again."""
    entry = book.entries.get(key) if book is not None else None
    if entry is None:
        return None
    assert book is not None
    try:
        if "answer" in entry:
            return Diagnosis.from_json(json.dumps(entry["answer"]))
        name, kind, message = entry["name"], entry["failure"]["kind"], entry["failure"]["message"]
        if not all(isinstance(text, str) for text in (name, kind, message)):
            raise TypeError
    except (_core.PmsmError, LookupError, TypeError, ValueError, AttributeError, RecursionError):
        book.pass_over(key)
        return None
    lasting = isinstance(getattr(_core, kind, None), type)
    return Failure(name, kind, message) if lasting else None
