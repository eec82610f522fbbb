"""Hostile files, interrupts and faults in figures: time, memory and exit code of the command line on each.

    python tests/hold.py [--only WORD] [--interrupts N]

Makes its own files. Each command runs in a process of its own with 3 GB of address space. Ends with code 1
where one was killed, ended with a code that is not documented, took too long, or printed a traceback or a
control character; where a file was left half written, or a fleet lost a recording.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "python")]

import faults  # noqa: E402, they lie beside the tests
import hostile  # noqa: E402
from running import Ran, run  # noqa: E402

LONGEST = 20.0
"""s of processor time that a hostile file may take."""
MEDIAN, HIGHEST = 0.2, 0.5
"""s of processor time after a signal, in the median and at the 95th percentile of all."""
GROUPS = {
    "full disks": (faults.full_disks, 30),
    "broken pipes": (faults.broken_pipes, 30),
    "kills of a fleet": (faults.killed_fleets, 20),
    "kills of workers": (faults.killed_workers, 50),
}
"""Kinds of faults and how often each is tried."""


def hostile_runs(folder: Path, word: str) -> Iterator[tuple[str, int, Ran]]:
    """Name, bytes of the file and outcome of each kind that has `word` in its name."""
    machine, sound = folder / "machine.toml", folder / "sound.csv"
    machine.write_bytes(hostile.MACHINE)
    sound.write_bytes(hostile.sound())
    kinds = [
        *((f"{suffix}: {name}", suffix, make) for name, (suffix, make) in hostile.RECORDINGS.items()),
        *((f"machine file: {name}", "toml", make) for name, make in hostile.MACHINES.items()),
        *((f"stream: {name}", "", make) for name, make in hostile.STREAMS.items()),
    ]
    for kind, suffix, make in kinds:
        if word not in kind:
            continue
        content = make()
        path = hostile.write(folder, kind.partition(": ")[2], suffix or "stream", content)
        if suffix == "toml":
            ran = run(["inspect", str(sound), "--machine", str(path)], folder)
        elif suffix:
            ran = run(["inspect", str(path)], folder)
        else:
            ran = run(["track", "-", "--machine", str(machine)], folder, content)
        yield kind, len(content), ran
        path.unlink()


def percentile(values: list[float], share: float) -> float:
    """The smallest of the values that so large a share does not exceed."""
    return sorted(values)[max(math.ceil(share * len(values)), 1) - 1]


def told(took: list[float]) -> str:
    """Median, 95th percentile and the most, s."""
    figures = [statistics.median(took), percentile(took, 0.95), max(took)] if took else []
    return " ".join(f"{x:7.2f}" for x in figures) or " ".join([f"{'-':>7}"] * 3)


def hold_files(folder: Path, word: str) -> int:
    """Prints time and memory of each hostile file; how many failed."""
    print(f"{'code':>4} {'cpu s':>6} {'MB':>6} {'file kB':>8}  kind")
    failed = 0
    for kind, size, ran in hostile_runs(folder, word):
        fault = ran.fault() or (f"more than {LONGEST:g} s" if ran.seconds > LONGEST else "")
        failed += bool(fault)
        figures = f"{ran.code:>4} {ran.seconds:6.1f} {ran.resident >> 20:6} {size >> 10:8}"
        print(f"{figures}  {kind}{f'  FAILED: {fault}' if fault else ''}", flush=True)
    return failed


def hold_interrupts(folder: Path, count: int) -> int:
    """Prints how long each command goes on after a signal; how many failed."""
    print(f"{'cut':>4} {'median':>7} {'95 %':>7} {'most':>7} {'clock':>7}  s after a signal at random")
    cut: list[float] = []
    failed = 0
    for kind, took, wrong in faults.interrupts(folder, count, Random(1)):
        cut += [latency.processor for latency in took]
        clock = f"{max(latency.clock for latency in took):7.2f}" if took else f"{'-':>7}"
        figures = told([latency.processor for latency in took])
        failed += said(f"{len(took):>4} {figures} {clock}  {kind}", wrong)
    print(f"{len(cut):>4} {told(cut)} {'':7}  all of them")
    if cut and (statistics.median(cut) > MEDIAN or percentile(cut, 0.95) > HIGHEST):
        failed += said("", [f"more than {MEDIAN:g} s in the median or {HIGHEST:g} s at the 95th percentile"])
    return failed


def said(line: str, wrong: list[str]) -> int:
    """Prints a line and what went wrong; how much did."""
    print(line, *(f"FAILED: {fault}" for fault in wrong), sep="\n     ", flush=True)
    return len(wrong)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", default="", help="kinds that have this word in their name")
    parser.add_argument("--interrupts", type=int, default=10, help="signals of each kind to each command")
    given = parser.parse_args()
    groups = {name: group for name, group in GROUPS.items() if given.only in name}
    failed = 0
    with tempfile.TemporaryDirectory() as name:
        if not given.only or (given.only != "interrupts" and not groups):
            failed += hold_files(Path(name), given.only)
        if given.only in ("", "interrupts"):
            failed += hold_interrupts(Path(name), given.interrupts)
        for what, (trial, count) in groups.items():
            folder = Path(name) / what.replace(" ", "_")
            folder.mkdir()
            done = trial(folder, count, Random(1))
            failed += said(f"{done.count:>4} {what}: {done.told}", done.faults)
    print("hold: nothing failed" if not failed else f"hold: {failed} failed")
    return bool(failed)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
