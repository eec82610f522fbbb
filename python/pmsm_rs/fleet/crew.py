"""Hands recordings to workers: a worker that dies costs none of them.

What a dead worker had is tried again, alone, so that a recording that kills its worker every time is known by
name and reported.
"""

from __future__ import annotations

import hashlib
import os
import stat
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from .. import _core
from .._core import Machine, PmsmError, UsageError
from ..config.machine_file import MachineFile
from ..errors import NothingToAsk, refuse
from ..io.loader import load
from ..io.recording import Recording
from ..run import diagnose, unanswered

Run = str | os.PathLike[str] | Recording
Makes = Executor | Callable[[], Executor]
Told = tuple[str, str, str]
"""("answer", JSON, "") or ("failure", kind, message)."""

_MOST_LOSSES: Final = 2
_IN_FLIGHT: Final = 64
_GRACE: Final = 0.1
"""s that workers get to give up what they have in hand, before the answers so far are returned."""
LOST, INTERRUPTED = "WorkerLost", "Interrupted"
# By run: set where the recordings in this process are to be given up.
_STOPS: dict[str, threading.Event] = {}


@dataclass(frozen=True)
class Task:
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
        """The same for the same question: contents of the files and of those beside them, machine, seed and
        version.
        """
        digest = hashlib.sha256(repr((_core.__version__, self.seed, _plain(self.machine))).encode())
        beside = _beside(self.machine)
        if isinstance(self.machine, MachineFile) and self.machine.dbc is not None:
            digest.update(_contents(self.machine.dbc))
        for run in (self.recording, self.validation):
            digest.update(_contents(run))
            if run is not None and not isinstance(run, Recording):
                for name in beside:
                    digest.update(_contents(Path(run).parent / name))
        return digest.hexdigest()


def _plain(machine: MachineFile | Machine) -> object:
    if isinstance(machine, MachineFile):
        rules = sorted((name, repr(rule)) for name, rule in machine.columns.items())
        return _plain(machine.machine), machine.load, machine.load_value, rules, machine.converted
    return sorted(machine.__getnewargs_ex__()[1].items())


def _beside(machine: MachineFile | Machine) -> list[str]:
    """Names of the other files that columns are taken from, in the folder of each recording."""
    rules = machine.columns.values() if isinstance(machine, MachineFile) else ()
    return sorted({rule.file for rule in rules if rule is not None and rule.file is not None})


def _contents(run: Run | None) -> bytes:
    digest = hashlib.sha256()
    if isinstance(run, Recording):
        digest.update(repr((run.load, run.load_value)).encode())
        for name in run.names:
            digest.update(name.encode() + run.column(name).tobytes())
    elif run is not None:
        try:
            if not stat.S_ISREG(os.stat(run).st_mode):
                # Reading a pipe or a device may never end.
                raise OSError(0, "no file")
            with Path(run).open("rb") as handle:
                digest = hashlib.file_digest(handle, "sha256")
        except OSError as error:
            # Whoever loads it will say so; here it only has to differ from every readable file.
            digest.update(f"{run}: {error}".encode(errors="backslashreplace"))
    return digest.digest()


class _Stopped(Exception):
    """The run was interrupted while this recording was in work."""


def work(task: Task) -> Told:
    """In the worker. What escapes is not the recording's doing."""
    stop = _STOPS.get(task.run)

    def look(_stage: str, _fraction: float) -> None:
        if stop is not None and stop.is_set():
            raise _Stopped

    try:
        recording = _opened(task.recording, task)
        validation = None if task.validation is None else _opened(task.validation, task)
        answer = diagnose(
            recording, task.machine, validation, seed=task.seed, threads=task.threads, progress=look
        )
    except _Stopped:
        return "failure", INTERRUPTED, ""
    except NothingToAsk as error:
        if isinstance(task.recording, Recording) or not error.of(os.fspath(task.recording)):
            return "failure", "DataError", str(error)
        return "answer", unanswered(error, seed=task.seed).to_json(), ""
    except PmsmError as error:
        return "failure", type(error).__name__, str(error)
    except Exception as error:
        return "failure", type(error).__name__, f"{task.name}: {type(error).__name__}: {error}"
    return ("failure", INTERRUPTED, "") if answer.interrupted else ("answer", answer.to_json(), "")


def _opened(run: Run, task: Task) -> Recording:
    return run if isinstance(run, Recording) else load(run, task.machine, max_bytes=task.max_bytes)


class Crew:
    """Hands tasks to an executor, and replaces it where it breaks."""

    def __init__(self, executor: Makes | None, tasks: dict[str, Task]) -> None:
        self.make = executor if executor is not None and not isinstance(executor, Executor) else None
        self.executor = executor if isinstance(executor, Executor) else None
        self.own = executor is None or self.make is not None
        self.tasks = tasks
        self.waiting = deque(tasks)
        self.suspects: deque[str] = deque()
        self.losses: Counter[str] = Counter()
        self.flying: dict[Future[Told], str] = {}
        self.tokens = {task.run for task in tasks.values()}
        for token in self.tokens:
            _STOPS[token] = threading.Event()

    def results(self) -> Iterator[tuple[str, Told]]:
        """Key of every task and what became of it, as they are done."""
        while self.waiting or self.suspects or self.flying:
            self._submit()
            done, _ = wait(self.flying, return_when=FIRST_COMPLETED)
            for future in done:
                key = self.flying.pop(future)
                error = future.exception() if not future.cancelled() else None
                if error is None and not future.cancelled():
                    told = future.result()
                    if told[:2] == ("failure", INTERRUPTED):
                        # A signal that reached the worker alone is as good as its death.
                        yield from self._lost(key, InterruptedError("it was interrupted"))
                    else:
                        yield key, told
                else:
                    yield from self._lost(key, error)

    def end(self) -> None:
        """Gives up what is in work and lets go of the executor."""
        for token in self.tokens:
            _STOPS[token].set()
        for future in self.flying:
            future.cancel()
        if self.executor is not None and self.own:
            _end(self.executor, at_once=any(not future.done() for future in self.flying))
        wait(self.flying, timeout=_GRACE)
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
                future = self._get().submit(work, self.tasks[queue[0]])
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

    def _lost(self, key: str, error: BaseException | None) -> Iterator[tuple[str, Told]]:
        """A future that failed without an answer: its worker died, or its answer could not be carried."""
        self.losses[key] += 1
        alone = not self.flying
        if self.losses[key] > _MOST_LOSSES and alone:
            name = self.tasks[key].name
            why = " ".join(str(error).split()) or type(error).__name__
            text = (
                f"{name}: its worker was lost {self.losses[key]} times ({why}); look at memory and system log"
            )
            yield key, ("failure", LOST, text)
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


def _end(executor: Executor, *, at_once: bool) -> None:
    """Lets go of an executor. Processes that would finish their recordings first are ended `at_once`: unlike
    threads they cannot be told to give them up.
    """
    processes = dict(getattr(executor, "_processes", None) or {}) if at_once else {}
    executor.shutdown(wait=False, cancel_futures=True)
    for process in processes.values():
        process.terminate()


def _like(pool: dict[str, Any]) -> ProcessPoolExecutor:
    """A pool with the settings of another one; the class has no public way to copy itself."""
    return ProcessPoolExecutor(
        pool["_max_workers"],
        mp_context=pool["_mp_context"],
        initializer=pool["_initializer"],
        initargs=pool["_initargs"],
    )
