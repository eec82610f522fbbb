"""Commands in processes of their own: started with 3 GB of address space, waited for, judged by their end."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import IO, NamedTuple

MEMORY = 3_000_000 << 10
LONGEST = 120.0
"""s after which a command is killed and has failed."""
CODES = frozenset({0, 2, 3, 4})
COMMAND = [sys.executable, "-c", "import sys; from pmsm_rs.cli import main; sys.exit(main())"]


class Ran(NamedTuple):
    """A command that has ended: exit code, s of processor time, bytes resident, and what it said."""

    code: int
    seconds: float
    resident: int
    out: bytes
    err: bytes

    def fault(self, codes: frozenset[int] = CODES) -> str:
        """What must not be, empty where all is well."""
        said = self.out + self.err
        if self.code not in codes:
            return f"exit code {self.code}"
        if b"Traceback" in said or b"Exception ignored" in said:
            return "traceback"
        return "control character" if b"\x1b" in said or b"\x07" in said else ""


def start(
    arguments: list[str],
    folder: Path,
    given: int = subprocess.DEVNULL,
    *,
    largest: int | None = None,
    out: int | None = None,
    err: int | None = None,
    command: list[str] = COMMAND,
) -> tuple[subprocess.Popen[bytes], list[Path]]:
    """Starts a command, its output going to files in `folder`, or to `out` and `err`.

    No file that it writes may grow beyond `largest` bytes.
    """
    logs = [folder / "out", folder / "err"]

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        if largest is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))
        # A shell starts background jobs with Ctrl-C ignored.
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def to(handle: IO[bytes], instead: int | None) -> int:
        return handle.fileno() if instead is None else instead

    with logs[0].open("wb") as first, logs[1].open("wb") as second:
        process = subprocess.Popen(
            [*command, *arguments],
            stdin=given,
            stdout=to(first, out),
            stderr=to(second, err),
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            preexec_fn=limited,
        )
    return process, logs


def finish(process: subprocess.Popen[bytes], logs: list[Path], longest: float = LONGEST) -> Ran:
    """Waits for a command and kills it where it takes too long."""
    until = time.monotonic() + longest
    while True:
        ended, status, used = os.wait4(process.pid, os.WNOHANG)
        if ended:
            break
        if time.monotonic() > until:
            os.kill(process.pid, signal.SIGKILL)
        time.sleep(0.002)
    process.returncode = os.waitstatus_to_exitcode(status)
    seconds, resident = used.ru_utime + used.ru_stime, used.ru_maxrss << 10
    return Ran(process.returncode, seconds, resident, logs[0].read_bytes(), logs[1].read_bytes())


def run(arguments: list[str], folder: Path, content: bytes = b"") -> Ran:
    """Runs a command with `content` on its standard input."""
    given = folder / "in"
    given.write_bytes(content)
    with given.open("rb") as handle:
        return finish(*start(arguments, folder, handle.fileno()))


def used(process: int) -> float:
    """s of processor time that a process and those that it waited for have had so far."""
    numbers = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return sum(int(ticks) for ticks in numbers[11:15]) / os.sysconf("SC_CLK_TCK")


def children(process: int) -> list[int]:
    """The processes that a process has started and that still run, and those that they have."""
    found = []
    for tasks in Path(f"/proc/{process}/task").glob("*/children"):
        try:
            found += [int(number) for number in tasks.read_text().split()]
        except (FileNotFoundError, ProcessLookupError):
            continue
    return found + [deeper for child in found for deeper in children(child)]
