"""What goes wrong around a command: signals, full disks, readers that go away, processes that are killed.

Each trial is at a random moment or place. What it yields is told by hold.py.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import NamedTuple

from running import CODES, Ran, children, finish, start, used

ROOT = Path(__file__).resolve().parents[1]
DEMO = ROOT / "python" / "pmsm_rs" / "demo_data"
SHARE = 4
"""Of the recordings of the demo the first part is taken: a diagnosis then takes seconds."""
WHOLE = {
    **{".html": b"</html>", ".parquet": b"PAR1", ".json": b"}", ".svg": b"</svg>"},
    **dict.fromkeys((".csv", ".fmu", ".zip", ".png", ".md"), b""),
}
"""What files end in that are whole, by the end of their names; a draft has a longer name."""
ORPHANS = 5.0
"""s that a process may go on whose command was killed: it may be importing."""
RUNS = 6
"""Recordings of a fleet."""
FLEET = """
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
import pmsm_rs as pm

def make():
    return ProcessPoolExecutor(2, mp_context=get_context("spawn"))

if __name__ == "__main__":
    machine, ledger, *runs = sys.argv[1:]
    answers = pm.diagnose_many(runs, machine, executor=make, ledger=ledger)
    lost = [failure for failure in answers.failures if failure.kind == "WorkerLost"]
    print(len(answers.answers), len(answers.failures), len(lost))
"""


class Latency(NamedTuple):
    """s from a signal to the end of a command: of processor time, and by the clock."""

    processor: float
    clock: float


class Trials(NamedTuple):
    """How often something was tried, what it came to in words, and what went wrong."""

    count: int
    told: str
    faults: list[str]


def shorter(source: Path, path: Path, share: int, part: int = 0) -> str:
    """Writes one of the equal parts of a recording; its name."""
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(source)
    rows = table.num_rows // share
    pyarrow.parquet.write_table(table.slice(part * rows, rows), path)
    return str(path)


def commands(folder: Path) -> dict[str, list[str]]:
    """A call of every command that computes, reads or writes; their outputs are in folder/made."""
    run = shorter(DEMO / "recording.parquet", folder / "run.parquet", SHARE)
    other = shorter(DEMO / "validation.parquet", folder / "other.parquet", SHARE)
    given = ["--machine", str(DEMO / "machine.toml")]
    answer, curves, limits = (str(folder / name) for name in ("a.json", "t.parquet", "limits.toml"))
    Path(limits).write_text("[limits]\ncurrent = 6.0\nspeed = 100.0\ntime = 1.0\n")
    (folder / "made").mkdir(exist_ok=True)
    made = {name: str(folder / "made" / name) for name in ("r.html", "o.json", "o.csv", "o.fmu", "b.zip")}
    pages = ["--report", made["r.html"], "--json", made["o.json"]]
    ran = finish(*start(["diagnose", run, *given, "--json", answer, "--trajectories", curves], folder))
    assert ran.code == 0, ran.err
    drive = str(ROOT / "docs" / "examples" / "drive.toml")
    return {
        "inspect": ["inspect", run, "--json", made["o.json"]],
        "demo": ["demo", *pages],
        "diagnose": ["diagnose", run, *given, *pages],
        "identify": ["identify", run, *given, "--json", made["o.json"]],
        "track": ["track", run, *given, "--json", made["o.json"]],
        "fleet": ["fleet", run, other, *given, "--ledger", str(folder / "made" / "ledger")],
        "simulate": ["simulate", drive, "-o", str(folder / "made" / "s.parquet")],
        "reproduce": ["reproduce", "fig5", "--out", str(folder / "made" / "paper")],
        "report": ["report", answer, "--trajectories", curves, "-o", made["r.html"]],
        "design": ["design", answer, "--limits", limits, "-o", made["o.csv"], "--tries", "8"],
        "export": ["export", answer, "--to", "fmu", "-o", made["o.fmu"]],
        "bundle": ["bundle", run, *given, "-o", made["b.zip"]],
        "effects": ["effects"],
        "explain": ["explain", "PR001"],
        "doctor": ["doctor"],
    }


def empty(folder: Path) -> None:
    """Removes what commands have made."""
    for path in sorted(folder.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()


def interrupts(folder: Path, count: int, random: Random) -> Iterator[tuple[str, list[Latency], list[str]]]:
    """Per command and signal how long each went on, and what went wrong."""
    for name, arguments in commands(folder).items():
        began = time.monotonic()
        finish(*start(arguments, folder))
        whole = time.monotonic() - began
        for number in (signal.SIGINT, signal.SIGTERM):
            took: list[Latency] = []
            faults = []
            for _ in range(count):
                empty(folder / "made")
                delay = random.uniform(0.0, whole)
                latency, ran = interrupt(arguments, folder, delay, number)
                if fault := ran.fault(CODES | {130}) or torn(folder / "made"):
                    faults.append(f"{fault} after {delay:.3f} s: {ran.err.decode(errors='replace')[-400:]}")
                if ran.code == 130:
                    took.append(latency)
            yield f"{name}, {number.name}", took, faults


def interrupt(
    arguments: list[str], folder: Path, delay: float, number: signal.Signals
) -> tuple[Latency, Ran]:
    """How long a command goes on after a signal, and the outcome.

    The signal waits until the command has the signals in hand: before, they are those of the interpreter.
    """
    process, logs = start(arguments, folder)
    time.sleep(delay)
    while not has_signals(process.pid):
        time.sleep(0.002)
    sent, before = time.monotonic(), used(process.pid)
    # One that has ended is a zombie until it is waited for, and takes the signal.
    os.kill(process.pid, number)
    ran = finish(process, logs)
    return Latency(max(ran.seconds - before, 0.0), time.monotonic() - sent), ran


def has_signals(process: int) -> bool:
    """Whether a process catches SIGTERM, which Python by itself does not, or has ended."""
    told = dict(line.split(":\t", 1) for line in Path(f"/proc/{process}/status").read_text().splitlines())
    caught = int(told.get("SigCgt", "0"), 16) | int(told.get("SigIgn", "0"), 16)
    return told["State"].startswith("Z") or bool(caught >> (signal.SIGTERM - 1) & 1)


def torn(made: Path) -> str:
    """What is wrong with the files that a command has left: halves, or drafts; empty where nothing is."""
    for path in made.rglob("*"):
        if path.is_file() and path.name != "ledger":
            if path.suffix not in WHOLE:
                return f"{path.name} was left"
            if not path.read_bytes().rstrip().endswith(WHOLE[path.suffix]):
                return f"half of {path.name} was written"
    return ""


def full_disks(folder: Path, count: int, random: Random) -> Trials:
    """Commands no file of which grows beyond so many bytes, standard output among them."""

    def on_full(name: str, arguments: list[str], _: int) -> tuple[str, Ran, frozenset[int]]:
        largest = int(2 ** random.uniform(0.0, 18.0))
        read, write = os.pipe()
        ran = finish(*start(arguments, folder, largest=largest, err=write))
        os.close(write)
        with open(read, "rb") as said:
            ran = ran._replace(err=said.read())
        # That of the command that tells whether the disk is full.
        return f"{largest} bytes", ran, CODES | {1} if name == "doctor" else CODES

    return tried(folder, count, on_full)


def broken_pipes(folder: Path, count: int, random: Random) -> Trials:
    """Commands whose standard output, error or both lose their reader at a random moment."""

    def on_broken(_: str, arguments: list[str], k: int) -> tuple[str, Ran, frozenset[int]]:
        read, write = os.pipe()
        streams = [{"out": write}, {"err": write}, {"out": write, "err": write}][k % 3]
        process, logs = start(arguments, folder, **streams)
        os.close(write)
        time.sleep(random.choice([0.0, random.uniform(0.0, 3.0)]))
        os.close(read)
        return " and ".join(streams), finish(process, logs), CODES

    return tried(folder, count, on_broken)


def tried(
    folder: Path, count: int, trial: Callable[[str, list[str], int], tuple[str, Ran, frozenset[int]]]
) -> Trials:
    """What comes of a trial of each command in turn, by place, outcome and codes that may be."""
    each = commands(folder)
    seen: Counter[int] = Counter()
    faults = []
    for k in range(count):
        name = [*each][k % len(each)]
        empty(folder / "made")
        place, ran, own = trial(name, each[name], k)
        seen[ran.code] += 1
        if fault := ran.fault(own) or torn(folder / "made"):
            faults.append(f"{name}, {place}: {fault}: {ran.err.decode(errors='replace')[-400:]}")
    return Trials(count, codes(seen), faults)


def codes(seen: Counter[int]) -> str:
    """How often each exit code was seen."""
    return ", ".join(f"exit code {code}: {times}" for code, times in sorted(seen.items()))


def killed_fleets(folder: Path, count: int, random: Random) -> Trials:
    """A fleet of recordings is killed again and again; another run goes on with its ledger to the end."""
    runs, machine = fleet(folder)
    ledger, answers = folder / "ledger", folder / "all.json"
    arguments = ["fleet", *runs, "--machine", machine, "--jobs", "2"]
    arguments += ["--ledger", str(ledger), "--json", str(answers)]
    began = time.monotonic()
    finish(*start(arguments, folder))
    whole = time.monotonic() - began
    expected = json.loads(answers.read_bytes())
    killed, ended, faults = 0, 0, ledger_faults(ledger, answers)
    ledger.unlink()
    while killed < count:
        process, logs = start(arguments, folder)
        time.sleep(random.uniform(0.0, whole))
        own = children(process.pid)
        os.kill(process.pid, signal.SIGKILL)
        if finish(process, logs).code == -signal.SIGKILL:
            killed += 1
            until = time.monotonic() + ORPHANS
            while any(map(command_of, own)) and time.monotonic() < until:
                time.sleep(0.01)
            faults += [f"process {child} runs on" for child in own if command_of(child)]
            if killed < count and random.random() < 0.7:
                continue
            ran = finish(*start(arguments, folder))
            faults += [fault] if (fault := ran.fault()) else []
        ended += 1
        faults += ledger_faults(ledger, answers, expected)
        ledger.unlink()
        answers.unlink()
    return Trials(killed, f"{ended} fleets of {RUNS} recordings came to their end", faults)


def killed_workers(folder: Path, count: int, random: Random) -> Trials:
    """Workers of fleets are killed while they compute; no recording may lose its answer or have two."""
    runs, machine = fleet(folder)
    ledger, script = folder / "ledger", folder / "fleet.py"
    script.write_text(FLEET)
    killed, fleets, faults, lost = 0, 0, [], 0
    while killed < count:
        ledger.unlink(missing_ok=True)
        process, logs = start([machine, str(ledger), *runs], folder, command=[sys.executable, str(script)])
        ended = None
        while killed < count and ended is None:
            time.sleep(random.uniform(0.5, 4.0))
            workers = [child for child in children(process.pid) if b"spawn_main" in command_of(child)]
            if workers:
                os.kill(random.choice(workers), signal.SIGKILL)
                killed += 1
            ended = os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        ran = finish(process, logs, 300.0)
        fleets += 1
        numbers = [int(word) for word in ran.out.split()] if ran.code == 0 else []
        if len(numbers) != 3 or sum(numbers[:2]) != RUNS or numbers[1] != numbers[2]:
            faults.append(f"exit code {ran.code}, {ran.out!r}: {ran.err.decode(errors='replace')[-400:]}")
        lost += sum(numbers[2:])
        faults += ledger_faults(ledger, folder)
    return Trials(killed, f"{fleets} fleets of {RUNS} recordings, {lost} told as lost", faults)


def fleet(folder: Path) -> tuple[list[str], str]:
    """Recordings of a fleet, and their machine file."""
    source = DEMO / "recording.parquet"
    runs = [shorter(source, folder / f"run{k}.parquet", 2 * RUNS, k) for k in range(RUNS)]
    return runs, str(DEMO / "machine.toml")


def command_of(process: int) -> bytes:
    """The command line of a process, empty where it has ended."""
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return b""


def ledger_faults(ledger: Path, answers: Path, expected: object = None) -> list[str]:
    """What is wrong with a ledger, recordings that are missing or stand twice, and with answers that are not
    those `expected`.
    """
    keys: Counter[str] = Counter()
    for line in ledger.read_bytes().splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            # A line that was being written as its process was killed.
            continue
        keys.update([entry["key"]] if "key" in entry else [])
    faults = [f"{times} entries of one recording" for times in keys.values() if times > 1]
    faults += [f"{len(keys)} recordings in the ledger"] if len(keys) != RUNS else []
    if expected is not None and json.loads(answers.read_bytes()) != expected:
        faults.append("the answers are not those of a fleet that nobody disturbed")
    return faults
