"""Hostile files and interrupts in figures: time, memory and exit code of the command line on each.

    python tests/hold.py [--only WORD] [--interrupts N]

Makes its own files. Each command runs in a process of its own with 3 GB of address space. Ends with code 1
where one was killed, ended with a code that is not documented, or printed a traceback or a control character.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "python"))

import hostile  # noqa: E402, it lies beside the tests

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


def start(arguments: list[str], folder: Path, given: int) -> tuple[subprocess.Popen[bytes], list[Path]]:
    """Starts a command, its output going to files."""
    logs = [folder / "out", folder / "err"]

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        # A shell starts background jobs with Ctrl-C ignored.
        signal.signal(signal.SIGINT, signal.default_int_handler)

    with logs[0].open("wb") as out, logs[1].open("wb") as err:
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        process = subprocess.Popen(
            [*COMMAND, *arguments], stdin=given, stdout=out, stderr=err, env=environment, preexec_fn=limited
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
            process.kill()
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


def hostile_runs(folder: Path) -> Iterator[tuple[str, int, Ran]]:
    """Name, bytes of the file and outcome of each kind."""
    machine, sound = folder / "machine.toml", folder / "sound.csv"
    machine.write_bytes(hostile.MACHINE)
    sound.write_bytes(hostile.sound())
    for name, (suffix, make) in hostile.RECORDINGS.items():
        path = hostile.write(folder, name, suffix, make())
        yield f"{suffix}: {name}", path.stat().st_size, run(["inspect", str(path)], folder)
        path.unlink()
    for name, content in hostile.MACHINES.items():
        path = hostile.write(folder, name, "toml", content())
        ran = run(["inspect", str(sound), "--machine", str(path)], folder)
        yield f"machine file: {name}", path.stat().st_size, ran
        path.unlink()
    for name, content in hostile.STREAMS.items():
        data = content()
        yield f"stream: {name}", len(data), run(["track", "-", "--machine", str(machine)], folder, data)


def used(process: int) -> float:
    """s of processor time that a process and those that it waited for have had so far."""
    numbers = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return sum(int(ticks) for ticks in numbers[11:15]) / os.sysconf("SC_CLK_TCK")


class Latency(NamedTuple):
    """s from a signal to the end of a command: of processor time, and by the clock."""

    processor: float
    clock: float


def interrupt(
    arguments: list[str], folder: Path, delay: float, number: signal.Signals
) -> tuple[Latency, Ran]:
    """How long a command goes on after a signal, and the outcome."""
    process, logs = start(arguments, folder, subprocess.DEVNULL)
    time.sleep(delay)
    sent, before = time.monotonic(), used(process.pid)
    # One that has ended is a zombie until it is waited for, and takes the signal.
    os.kill(process.pid, number)
    ran = finish(process, logs)
    return Latency(max(ran.seconds - before, 0.0), time.monotonic() - sent), ran


def percentile(values: list[float], share: float) -> float:
    """The smallest of the values that so large a share does not exceed."""
    return sorted(values)[max(math.ceil(share * len(values)), 1) - 1]


def interrupts(folder: Path, count: int, random: Random) -> Iterator[tuple[str, list[Latency], list[str]]]:
    """Per command and signal how long each went on, and what went wrong."""
    demo = ROOT / "python" / "pmsm_rs" / "demo_data"
    recording, machine = str(demo / "recording.parquet"), str(demo / "machine.toml")
    given = ["--machine", machine]
    drive = str(ROOT / "docs" / "examples" / "drive.toml")
    report, ledger, made = (str(folder / name) for name in ("report.html", "ledger", "made.parquet"))
    commands = {
        "inspect": ["inspect", recording],
        "demo": ["demo", "--report", report],
        "diagnose": ["diagnose", recording, *given, "--report", report],
        "identify": ["identify", recording, *given],
        "track": ["track", recording, *given],
        "fleet": ["fleet", recording, str(demo / "validation.parquet"), *given, "--ledger", ledger],
        "simulate": ["simulate", drive, "-o", made],
        "reproduce": ["reproduce", "fig5", "--out", str(folder / "paper")],
        "effects": ["effects"],
    }
    # Until the interpreter itself has started, the signal is its own.
    began = time.monotonic()
    subprocess.run([sys.executable, "-c", "import signal"], check=True)
    least = 2.0 * (time.monotonic() - began)
    for name, arguments in commands.items():
        began = time.monotonic()
        finish(*start(arguments, folder, subprocess.DEVNULL))
        whole = max(time.monotonic() - began, least)
        for number in (signal.SIGINT, signal.SIGTERM):
            Path(ledger).unlink(missing_ok=True)
            took: list[Latency] = []
            faults = []
            for _ in range(count):
                delay = random.uniform(least, whole)
                latency, ran = interrupt(arguments, folder, delay, number)
                if fault := ran.fault(CODES | {130}):
                    faults.append(f"{fault} after {delay:.3f} s: {ran.err.decode(errors='replace')[-400:]}")
                if ran.code == 130:
                    took.append(latency)
            yield f"{name}, {number.name}", took, faults


def told(took: list[float]) -> str:
    """Median, 95th percentile and the most, s."""
    figures = [statistics.median(took), percentile(took, 0.95), max(took)] if took else []
    return " ".join(f"{x:7.2f}" for x in figures) or " ".join([f"{'-':>7}"] * 3)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", default="", help="kinds that have this word in their name")
    parser.add_argument("--interrupts", type=int, default=10, help="signals of each kind to each command")
    given = parser.parse_args()
    failed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if given.only != "interrupts":
            print(f"{'code':>4} {'cpu s':>6} {'MB':>6} {'file kB':>8}  kind")
            for kind, size, ran in hostile_runs(folder):
                if given.only not in kind:
                    continue
                fault = ran.fault()
                failed += bool(fault)
                figures = f"{ran.code:>4} {ran.seconds:6.1f} {ran.resident >> 20:6} {size >> 10:8}"
                print(f"{figures}  {kind}{f'  FAILED: {fault}' if fault else ''}", flush=True)
        if given.only in ("", "interrupts"):
            print(
                f"{'cut':>4} {'median':>7} {'95 %':>7} {'most':>7} {'clock':>7}  s after a signal at random"
            )
            cut: list[float] = []
            for kind, took, faults in interrupts(folder, given.interrupts, Random(1)):
                failed += len(faults)
                cut += [latency.processor for latency in took]
                figures = told([latency.processor for latency in took])
                clock = f"{max(latency.clock for latency in took):7.2f}" if took else f"{'-':>7}"
                print(
                    f"{len(took):>4} {figures} {clock}  {kind}",
                    *(f"FAILED: {f}" for f in faults),
                    sep="\n     ",
                    flush=True,
                )
            print(f"{len(cut):>4} {told(cut)} {'':7}  all of them")
    print("hold: nothing failed" if not failed else f"hold: {failed} failed")
    return bool(failed)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
