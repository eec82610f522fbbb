"""Many recordings: each is diagnosed by itself, wherever an executor runs it, and none is lost.

A recording that cannot be diagnosed gives a Failure in its place. A worker that dies costs no recording: what
it had is tried again, alone, so that one that kills its worker twice is known by name and reported.
"""

from __future__ import annotations

import hashlib
import html
import os
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, overload

from . import _core
from ._core import Machine, PmsmError, UsageError
from .config import MachineFile, read_machine
from .errors import refuse
from .ledger import Ledger
from .loader import load
from .recording import DEFAULT_MAX_BYTES, Recording
from .results import Diagnosis
from .run import Progress, diagnose

Described = str | os.PathLike[str] | MachineFile | Machine
Run = str | os.PathLike[str] | Recording
Makes = Executor | Callable[[], Executor]

_MOST_LOSSES: Final = 2
_IN_FLIGHT: Final = 64
_GRACE: Final = 1.0
_LOST, _INTERRUPTED = "WorkerLost", "Interrupted"
# By run: set where the recordings in this process are to be given up.
_STOPS: dict[str, threading.Event] = {}


@dataclass(frozen=True)
class Failure:
    """Why a recording has no diagnosis: `kind` is the error's class, WorkerLost or Interrupted."""

    name: str
    kind: str
    message: str

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True)
class Fleet(Sequence["Diagnosis | Failure"]):
    """Diagnoses of many recordings in the order in which they were given, a Failure where there is none.

    `names` are those of the recordings, `resumed` says how many came from the ledger, and `interrupted`
    whether Ctrl-C cut the work short. Traces are not kept: diagnose a single recording again to draw it.
    """

    names: tuple[str, ...]
    results: tuple[Diagnosis | Failure, ...]
    resumed: int = 0
    interrupted: bool = False

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
        """Per recording its `name` with the whole `answer`, or with `failure`, its `kind` and `message`."""
        return [_entry(name, result) for name, result in zip(self.names, self.results, strict=True)]

    def __len__(self) -> int:
        return len(self.results)

    @overload
    def __getitem__(self, index: int) -> Diagnosis | Failure: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Diagnosis | Failure, ...]: ...
    def __getitem__(self, index: int | slice) -> Diagnosis | Failure | tuple[Diagnosis | Failure, ...]:
        return self.results[index]

    def __str__(self) -> str:
        from .summary import fleet

        return fleet(self)

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"


@dataclass(frozen=True)
class _Task:
    """One recording with all that its worker needs."""

    run: str
    name: str
    recording: Run
    validation: Run | None
    machine: MachineFile | Machine
    seed: int
    threads: int
    max_bytes: int

    def key(self) -> str:
        """The same for the same question: contents of the files, machine, seed and version."""
        digest = hashlib.sha256(repr((_core.__version__, self.seed, _plain(self.machine))).encode())
        for run in (self.recording, self.validation):
            digest.update(_contents(run))
        return digest.hexdigest()


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
    """Diagnoses every recording by itself and returns the answers in the order of the recordings.

    `recordings` are files or recordings in memory; `machine` is one machine (file) for all or one for each;
    `validations`, where given, has one for each or None. `executor` is any concurrent.futures.Executor, such
    as a ProcessPoolExecutor or dask's `client.get_executor()`, or a function that makes one, which is asked
    again after a pool broke; by default threads of this process, as many as there are processors. `threads`
    are those within one diagnosis.

    `ledger` names a file to which every finished recording is appended; run again with the same ledger, what
    it holds is not computed again, unless recording, machine, seed or version of the package changed.

    An error with one recording is a Failure in its place. On Ctrl-C what is finished is returned, marked
    `interrupted`. Raises UsageError where the arguments do not fit together or the ledger cannot be written,
    and MachineError for a bad machine file.
    """
    tasks = _tasks(recordings, machine, validations, seed, threads, max_bytes)
    keys = [task.key() for task in tasks]
    book = Ledger(ledger) if ledger is not None else None
    try:
        found = {key: result for key in keys if (result := _recorded(book, key)) is not None}
        resumed = sum(key in found for key in keys)
        todo = {key: task for key, task in zip(keys, tasks, strict=True) if key not in found}
        crew = _Crew(executor, todo)
        interrupted = False
        try:
            for key, result in crew.results():
                found[key] = result
                if book is not None:
                    book.add(key, _entry(todo[key].name, result))
                if progress is not None:
                    progress(f"{len(found)} of {len(set(keys))}", len(found) / len(set(keys)))
        except KeyboardInterrupt:
            interrupted = True
        finally:
            crew.end()
    finally:
        if book is not None:
            book.close()
    results = [found.get(key) or _interrupted(task) for key, task in zip(keys, tasks, strict=True)]
    named = [
        replace(result, name=task.name) if isinstance(result, Failure) else result
        for result, task in zip(results, tasks, strict=True)
    ]
    return Fleet(tuple(task.name for task in tasks), tuple(named), resumed, interrupted)


def _tasks(
    recordings: Sequence[Run],
    machine: Described | Sequence[Described],
    validations: Sequence[Run | None] | None,
    seed: int,
    threads: int,
    max_bytes: int,
) -> list[_Task]:
    if isinstance(recordings, str | os.PathLike | Recording):
        raise refuse(UsageError, "recordings is a single one", fix="give a list of recordings")
    runs = list(recordings)
    described: list[Described] = (
        [machine] * len(runs)
        if isinstance(machine, str | os.PathLike | MachineFile | Machine)
        else list(machine)
    )
    others = [None] * len(runs) if validations is None else list(validations)
    if not len(runs) == len(described) == len(others):
        raise refuse(
            UsageError,
            f"there are {len(runs)} recordings, {len(described)} machines and {len(others)} validations",
            fix="give one of each, or one machine for all",
        )
    read: dict[str, MachineFile] = {}

    def one(what: Described) -> MachineFile | Machine:
        if isinstance(what, str | os.PathLike):
            return read.setdefault(str(what), read.get(str(what)) or read_machine(what))
        return what

    token = os.urandom(8).hex()
    return [
        _Task(token, _name(run, k), run, other, one(what), seed, threads, max_bytes)
        for k, (run, what, other) in enumerate(zip(runs, described, others, strict=True))
    ]


def _name(run: Run, index: int) -> str:
    return f"recording {index}" if isinstance(run, Recording) else str(run)


def _plain(machine: MachineFile | Machine) -> object:
    if isinstance(machine, MachineFile):
        rules = sorted((name, repr(rule)) for name, rule in machine.columns.items())
        return _plain(machine.machine), machine.load, machine.load_value, rules
    return sorted(machine.__getnewargs_ex__()[1].items())


def _contents(run: Run | None) -> bytes:
    digest = hashlib.sha256()
    if isinstance(run, Recording):
        digest.update(repr((run.load, run.load_value)).encode())
        for name in run.names:
            digest.update(name.encode() + run.column(name).tobytes())
    elif run is not None:
        try:
            with Path(run).open("rb") as handle:
                digest = hashlib.file_digest(handle, "sha256")
        except OSError as error:
            # Whoever loads it will say so; here it only has to differ from every readable file.
            digest.update(f"{run}: {error}".encode())
    return digest.digest()


class _Stopped(Exception):
    """The run was interrupted while this recording was in work."""


def _work(task: _Task) -> tuple[str, str, str]:
    """In the worker: ("answer", JSON, "") or ("failure", kind, message). What escapes is not the
    recording's doing.
    """
    stop = _STOPS.get(task.run)

    def look(_stage: str, _fraction: float) -> None:
        if stop is not None and stop.is_set():
            raise _Stopped

    try:
        recording = _opened(task.recording, task)
        validation = None if task.validation is None else _opened(task.validation, task)
        machine = task.machine.machine if isinstance(task.machine, MachineFile) else task.machine
        answer = diagnose(recording, machine, validation, seed=task.seed, threads=task.threads, progress=look)
    except _Stopped:
        return "failure", _INTERRUPTED, ""
    except PmsmError as error:
        return "failure", type(error).__name__, str(error)
    except Exception as error:
        return "failure", type(error).__name__, f"{task.name}: {type(error).__name__}: {error}"
    return ("failure", _INTERRUPTED, "") if answer.interrupted else ("answer", answer.to_json(), "")


def _opened(run: Run, task: _Task) -> Recording:
    return run if isinstance(run, Recording) else load(run, task.machine, max_bytes=task.max_bytes)


def _result(name: str, told: tuple[str, str, str]) -> Diagnosis | Failure:
    what, first, second = told
    return Diagnosis.from_json(first) if what == "answer" else Failure(name, first, second)


def _interrupted(task: _Task) -> Failure:
    return Failure(
        task.name, _INTERRUPTED, f"{task.name}: interrupted before there was a result; run it again"
    )


def _entry(name: str, result: Diagnosis | Failure) -> dict[str, Any]:
    if isinstance(result, Diagnosis):
        return {"name": name, "answer": result.data}
    return {"name": name, "failure": {"kind": result.kind, "message": result.message}}


def _recorded(book: Ledger | None, key: str) -> Diagnosis | Failure | None:
    """What the ledger knows; lost workers get another chance, refused data would be refused again."""
    import json

    entry = book.entries.get(key) if book is not None else None
    if entry is None:
        return None
    if "answer" in entry:
        return Diagnosis.from_json(json.dumps(entry["answer"]))
    failure = entry["failure"]
    lasting = isinstance(getattr(_core, failure["kind"], None), type)
    return Failure(entry["name"], failure["kind"], failure["message"]) if lasting else None


class _Crew:
    """Hands tasks to an executor, and replaces it where it breaks."""

    def __init__(self, executor: Makes | None, tasks: dict[str, _Task]) -> None:
        self.make = executor if executor is not None and not isinstance(executor, Executor) else None
        self.executor = executor if isinstance(executor, Executor) else None
        self.own = executor is None or self.make is not None
        self.tasks = tasks
        self.waiting = deque(tasks)
        self.suspects: deque[str] = deque()
        self.losses: Counter[str] = Counter()
        self.flying: dict[Future[tuple[str, str, str]], str] = {}
        self.tokens = {task.run for task in tasks.values()}
        for token in self.tokens:
            _STOPS[token] = threading.Event()

    def results(self) -> Iterator[tuple[str, Diagnosis | Failure]]:
        """Key and result of every task, as they are done."""
        while self.waiting or self.suspects or self.flying:
            self._submit()
            done, _ = wait(self.flying, return_when=FIRST_COMPLETED)
            for future in done:
                key = self.flying.pop(future)
                error = future.exception() if not future.cancelled() else None
                if error is None and not future.cancelled():
                    result = _result(self.tasks[key].name, future.result())
                    if isinstance(result, Failure) and result.kind == _INTERRUPTED:
                        # A signal that reached the worker alone is as good as its death.
                        yield from self._lost(key, InterruptedError("it was interrupted"))
                    else:
                        yield key, result
                else:
                    yield from self._lost(key, error)

    def end(self) -> None:
        """Gives up what is in work and lets go of the executor."""
        for token in self.tokens:
            _STOPS[token].set()
        for future in self.flying:
            future.cancel()
        wait(self.flying, timeout=_GRACE)
        if self.executor is not None and self.own:
            self.executor.shutdown(wait=False, cancel_futures=True)
        for token in self.tokens:
            del _STOPS[token]

    def _submit(self) -> None:
        """Fills the executor; a suspect flies alone, so that it is known who broke it."""
        while self.waiting or self.suspects:
            alone = bool(self.suspects)
            if len(self.flying) >= (1 if alone or self._suspect_flies() else self._room()):
                return
            queue = self.suspects if alone else self.waiting
            try:
                future = self._get().submit(_work, self.tasks[queue[0]])
            except BrokenExecutor:
                self._replace()
                continue
            self.flying[future] = queue.popleft()

    def _suspect_flies(self) -> bool:
        return any(self.losses[key] for key in self.flying.values())

    def _room(self) -> int:
        workers = getattr(self._get(), "_max_workers", None)
        return 2 * workers if isinstance(workers, int) else _IN_FLIGHT

    def _get(self) -> Executor:
        if self.executor is None:
            self.executor = self.make() if self.make is not None else ThreadPoolExecutor(os.cpu_count() or 1)
        return self.executor

    def _lost(self, key: str, error: BaseException | None) -> Iterator[tuple[str, Failure]]:
        """A future that failed without an answer: its worker died, or its answer could not be carried."""
        self.losses[key] += 1
        alone = not self.flying
        if self.losses[key] > _MOST_LOSSES and alone:
            name = self.tasks[key].name
            why = " ".join(str(error).split()) or type(error).__name__
            text = (
                f"{name}: its worker was lost {self.losses[key]} times ({why}); look at memory and system log"
            )
            yield key, Failure(name, _LOST, text)
        else:
            self.suspects.append(key)
        if isinstance(error, BrokenExecutor) and alone:
            self._replace()

    def _replace(self) -> None:
        """Another executor for a broken one. Raises UsageError where there is no way to make it."""
        broken = self._get()
        broken.shutdown(wait=False)
        if not self.own:
            if not isinstance(broken, ProcessPoolExecutor):
                raise refuse(
                    UsageError,
                    f"the {type(broken).__name__} broke",
                    fix="give executor a function that makes one, so that it can be replaced",
                )
            self.make, self.own = partial(_like, vars(broken)), True
        self.executor = None


def _like(pool: dict[str, Any]) -> ProcessPoolExecutor:
    """A pool with the settings of another one; the class has no public way to copy itself."""
    return ProcessPoolExecutor(
        pool["_max_workers"],
        mp_context=pool["_mp_context"],
        initializer=pool["_initializer"],
        initargs=pool["_initargs"],
    )
