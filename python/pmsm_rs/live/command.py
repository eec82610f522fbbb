"""The command `track`: windows to standard output as they are complete."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from .. import _core, atomic
from ..config.machine_file import MachineFile, read_machine
from ..errors import refuse
from ..io.stream import Reader, batches
from ..view.summary import hung
from .tracker import Tracker, track
from .window import WindowEstimate


@dataclass(frozen=True)
class Request:
    """What the command line asks for; with a `json_file` of "-" the JSON goes to standard output, and with
    `silent` no text does.
    """

    recording: str
    machine_file: str
    fit: list[str]
    window: float
    method: str
    seed: int
    threads: int | None
    json_file: str | None
    silent: bool = False
    allow_outside: bool = False


def follow(request: Request) -> int:
    """Tracks, prints, and returns the number of windows that were identified.

    From a file the windows are printed for people; from standard input they are one JSON object per line.
    Raises what `track` raises, UsageError where standard output is wanted twice, and DataError for a line
    that cannot be read; what was complete before is written by then.
    """
    live = request.recording in ("-", "/dev/stdin")
    if live and request.json_file == "-":
        raise refuse(
            _core.UsageError,
            "windows of a stream go to standard output already, one JSON object per line",
            fix="leave --json out, or name a file",
        )
    machine = read_machine(request.machine_file, allow_outside=request.allow_outside)
    windows = _from_stream(request, machine) if live else _from_file(request, machine)
    begin, last = time.perf_counter(), None
    found = [0, 0]
    span = 0.0
    # Every window goes to a spool on disk, so that memory does not grow with the stream.
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="backslashreplace") as spool:
        try:
            for window in windows:
                found[window.status == "skipped"] += 1
                span += window.t_end - window.t_start
                text = window.to_json()
                if request.json_file:
                    spool.write(text + "\n")
                if live:
                    print(text, flush=True)
                    continue
                if request.silent:
                    continue
                print(window, flush=True)
                looks = window.drift.looks_like
                # What lasts is said once; a load that moves again moves to somewhere else.
                if looks and (looks != last or "load" in looks):
                    print(hung("             ", window.drift.sentence), flush=True)
                last = looks
        finally:
            if request.json_file:
                _write(request.json_file, spool, request)
    if not live and not request.silent:
        took = time.perf_counter() - begin
        skipped = f", {found[1]} skipped" if found[1] else ""
        print(
            f"{found[0]} windows{skipped}: {span:.4g} s in {took:.2f} s, "
            f"{span / took:.3g} times as fast as they were recorded"
        )
    return found[0]


def _from_file(request: Request, machine: MachineFile) -> Iterator[WindowEstimate]:
    return track(
        request.recording,
        machine,
        fit=request.fit,
        window=request.window,
        method=request.method,
        seed=request.seed,
        threads=request.threads,
    )


def _from_stream(request: Request, machine: MachineFile) -> Iterator[WindowEstimate]:
    tracker = Tracker(
        machine.machine,
        fit=request.fit,
        window=request.window,
        method=request.method,
        seed=request.seed,
        threads=request.threads,
        load=machine.load,
        load_value=machine.load_value,
    )
    reader: Reader = sys.stdin.buffer  # type: ignore[assignment]
    try:
        for columns in batches(reader, machine.columns):
            yield from tracker.update(columns)
    except _core.DataError:
        # What was complete, and the window that the bad line cuts short, is still worth having.
        yield from tracker.finish()
        raise
    yield from tracker.finish()


def _write(path: str, spool: IO[str], request: Request) -> None:
    head = {
        "schema": "pmsm-rs.track/1",
        "fit": request.fit,
        "window": request.window,
        "method": request.method,
        "seed": request.seed,
        "version": _core.__version__,
    }
    spool.seek(0)

    def pieces() -> Iterator[str]:
        yield json.dumps(head, ensure_ascii=False)[:-1] + ', "windows": ['
        for number, line in enumerate(spool):
            yield (",\n" if number else "\n") + line.rstrip("\n")
        yield "\n]}\n"

    def fill(draft: Path) -> None:
        with draft.open("w", encoding="utf-8", errors="backslashreplace") as out:
            out.writelines(pieces())

    if path == "-":
        # UTF-8, as in a file, whatever the encoding of the terminal.
        sys.stdout.buffer.writelines(piece.encode() for piece in pieces())
        sys.stdout.buffer.flush()
    else:
        atomic.write(path, fill)
