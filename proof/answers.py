"""Runs the installed tool on a case's open folder, and keeps what it answered and what it cost."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path

from .case import write_text
from .plan import name_of

# generous: it stops what hangs, and must not stop what a busy machine makes slow
TIMEOUT = 1200.0
# characters kept of the last line of standard error: its code stands at the end, behind the path of a file
LINE = 1000
TOOL = Path(sys.executable).parent / "pmsm-rs"


@dataclass(frozen=True)
class Cost:
    """How a run of the tool ended: exit code (None where it was stopped after TIMEOUT), wall and processor
    seconds on one thread, peak memory in MB, the last line of standard error, the code that answered."""

    exit: int | None
    seconds: float
    cpu_seconds: float
    memory_mb: float
    said: str
    code: str


def code_of(package: str = "pmsm_rs") -> str:
    """Fingerprint of the installed package: 12 hexadecimal digits over its source and compiled files.

    Raises FileNotFoundError where the tool is not installed beside this interpreter.
    """
    if not TOOL.exists():
        raise FileNotFoundError(f"{TOOL} is missing: install the package into this environment")
    found = metadata.files(metadata.distribution(package.replace("_", "-")).metadata["Name"]) or []
    digest = hashlib.sha256()
    for file in sorted(found, key=str):
        if file.suffix in {".py", ".so", ".pyd", ".html", ".json"} and ".dist-info" not in str(file):
            digest.update(str(file).encode())
            digest.update(Path(str(file.locate())).read_bytes())
    return digest.hexdigest()[:12]


def paths(number: int, out: Path) -> tuple[Path, Path, Path]:
    """Answer, trajectories and cost of a case."""
    stem = out / "answers" / name_of(number)
    return stem.with_suffix(".json"), stem.with_suffix(".parquet"), stem.with_suffix(".cost.json")


def is_answered(number: int, out: Path, code: str) -> bool:
    """Whether this very code has answered the case (or failed to)."""
    return is_answered_in(paths(number, out)[2], code)


def is_answered_in(cost: Path, code: str) -> bool:
    """Whether this very code has answered what has this cost: it is written last."""
    return cost.exists() and json.loads(cost.read_text(encoding="utf-8"))["code"] == code


def answer(number: int, out: Path, code: str) -> Cost:
    """Let the tool diagnose a case on one thread; it is given the three files of the open folder alone."""
    return ask(out / "open" / name_of(number), paths(number, out), code)


def ask(folder: Path, results: tuple[Path, Path, Path], code: str) -> Cost:
    """Let the tool diagnose what lies in a folder: recording, validation run and machine file.

    results: where answer, trajectories and cost go.  Whatever it wrote is in place when the cost is: a run
    that is cut short leaves no cost and is done again.
    """
    opened = folder.resolve()
    results[0].parent.mkdir(parents=True, exist_ok=True)
    for old in results:
        old.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory(prefix="pmsm-proof-") as work, tempfile.TemporaryFile() as errors:
        command = [
            str(TOOL), "diagnose", str(opened / "recording.parquet"), "--threads", "1", "--seed", "1",
            "--machine", str(opened / "machine.toml"), "--validate", str(opened / "validation.parquet"),
            "--json", f"{work}/answer.json", "--trajectories", f"{work}/answer.parquet",
        ]  # fmt: skip
        began = time.monotonic()
        # out of reach of a terminal's Ctrl-C: on that it would write the best so far, which is no answer
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=errors, cwd=work, start_new_session=True
        )
        code_of_exit, usage, memory = wait(process, began + TIMEOUT)
        seconds = time.monotonic() - began
        for name, path in zip(("answer.json", "answer.parquet"), results, strict=False):
            if (written := Path(work, name)).exists():
                moved = path.with_name(f".{path.name}")
                moved.write_bytes(written.read_bytes())
                moved.replace(path)
        errors.seek(0)
        said = errors.read().decode(errors="replace").strip().splitlines()
    cost = Cost(
        exit=code_of_exit,
        seconds=round(seconds, 2),
        cpu_seconds=round(usage.ru_utime + usage.ru_stime, 2),
        memory_mb=round(memory, 1),
        said=said[-1][:LINE] if said else "",
        code=code,
    )
    write_text(results[2], json.dumps(asdict(cost), indent=1) + "\n")
    return cost


def peak(process: int) -> float:
    """Peak resident memory (MB) of a running process so far; zero where the system does not tell.

    The usage that `wait4` gives counts the parent's memory in, as the process began as a copy of it.
    """
    try:
        status = Path(f"/proc/{process}/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return 0.0
    told = [line.split() for line in status.splitlines() if line.startswith("VmHWM:")]
    return float(told[0][1]) / 1024.0 if told else 0.0


def wait(process: subprocess.Popen[bytes], until: float) -> tuple[int | None, os.struct_rusage, float]:
    """Wait for a process and tell its exit code, what it used, and its peak memory in MB, looked at every
    20 ms; None and a stopped process after `until`.

    An interrupt stops the process, too.
    """
    stopped, memory = False, 0.0
    while True:
        try:
            memory = max(memory, peak(process.pid))
            done, status, usage = os.wait4(process.pid, os.WNOHANG)
            if not done:
                if not stopped and time.monotonic() > until:
                    process.kill()
                    stopped = True
                time.sleep(0.02)
                continue
        except KeyboardInterrupt:
            process.kill()
            raise
        process.returncode = os.waitstatus_to_exitcode(status)
        scale = 1024.0**2 if sys.platform == "darwin" else 1024.0
        return (None if stopped else process.returncode), usage, memory or usage.ru_maxrss / scale
