"""Damaged files to every reader of recordings, of machine files and of streams, until the time is up.

    python fuzz/readers.py --minutes 10 [--only csv] [--seed N] [--keep FOLDER]

Hypothesis draws how a whole file is damaged. A reader may give a recording or refuse it in a sentence; an
error of another kind, too much processor time or too much memory for the size of the file is a fault. Each
reader runs in a process of its own, so that one which ends or stalls is seen as well. The file at fault is
kept, its name printed, and the exit code is 1.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import resource
import secrets
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "python"))

SECONDS = 5.0
"""Processor time for a file of these sizes, far more than any needs."""
RESIDENT = 600 << 20
"""Bytes that a reader may have taken in the end, with Python and all libraries."""
ROUND = 60.0
"""s that a process of its own draws for a reader."""
STALLED = 120.0
"""s beyond the round after which it is killed."""

Read = Callable[[Path], None]


def corpus() -> dict[str, bytes]:
    """Whole files by name, as the tests make them, and machine files and streams."""
    from conftest import MACHINE, csv_text, plausible
    from test_damage import whole_files
    from test_message_logs import bag, mcap_json, ulog

    table = plausible(60)
    with TemporaryDirectory() as folder:
        turning = {"theta_e": table["omega_e"] * table["t"], **table}
        paths = [write(Path(folder), turning) for write in (ulog, bag, mcap_json)]
        logs = {path.name: path.read_bytes() for path in paths}
    columns = '[columns]\ni_d = "i_d"\nv_dc = { value = 24.0 }\nt = { from = "t", unit = "s" }\n'
    rows = [dict(zip(table, map(float, row), strict=True)) for row in zip(*table.values(), strict=True)]
    return {
        **whole_files(),
        **logs,
        "machine.toml": (MACHINE + columns).encode(),
        "samples.stream": csv_text(table).encode(),
        "objects.stream": "\n".join(map(json.dumps, rows)).encode(),
    }


def reader(name: str) -> Read:
    """What reads a file of that name."""
    import pmsm_rs as pm
    from pmsm_rs.config.machine_file import read_machine
    from pmsm_rs.io.stream import batches

    if name.endswith(".toml"):
        return lambda path: void(read_machine(path))
    if name.endswith(".stream"):
        return lambda path: void(list(batches(io.BytesIO(path.read_bytes()), None)))
    return lambda path: void(str(pm.inspect(path)))


def void(_value: object) -> None:
    """Takes no notice of what a reader gives."""


def used() -> tuple[float, int]:
    """s of processor time and bytes resident at most, of this process and of its decoders."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in both), max(one.ru_maxrss for one in both) << 10


def draw(name: str, seed: int, seconds: float, folder: Path) -> int:
    """Damages a file and reads it until `seconds` are over; the number of files. Raises what a fault is."""
    import pmsm_rs as pm
    from hypothesis import HealthCheck, Phase, given, settings
    from hypothesis import seed as seeded
    from hypothesis import strategies as st
    from test_damage import damaged

    whole, read, path = corpus()[name], reader(name), folder / name
    until, count = time.monotonic() + seconds, 0

    @seeded(seed)
    @settings(
        max_examples=1_000_000,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(source=st.randoms(use_true_random=True))
    def once(source: Random) -> None:
        nonlocal count
        if time.monotonic() > until:
            raise TimeoutError
        count += 1
        path.write_bytes(damaged(whole, source))
        before, _ = used()
        try:
            read(path)
        except pm.PmsmError as error:
            said = str(error)
            assert len(said) < 5000, f"{len(said)} characters: {said[:300]}"
            assert said.isprintable(), f"no sentence: {said[:300]!r}"
        after, resident = used()
        assert after - before < SECONDS, f"{after - before:.1f} s of processor time"
        assert resident < RESIDENT, f"{resident >> 20} MB resident"

    with suppress(TimeoutError):
        once()
    return count


def supervised(name: str, seed: int, seconds: float, folder: Path) -> tuple[int, str]:
    """The number of files that a process of its own has read, and what went wrong, empty where nothing."""
    command = [sys.executable, __file__, "--draw", name, "--seed", str(seed), "--keep", str(folder)]
    command += ["--minutes", str(seconds / 60.0)]
    try:
        ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=seconds + STALLED)
    except subprocess.TimeoutExpired:
        return 0, "it stalled"
    if ran.returncode == 0:
        return int(ran.stdout.split()[-1]), ""
    return 0, f"exit code {ran.returncode}\n{ran.stderr[-3000:]}"


def main() -> int:
    """Draws for one reader after the other, round after round."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="how long to draw (default 10)")
    parser.add_argument("--only", default="", help="files that have this word in their name")
    parser.add_argument("--seed", type=int, help="seed of the first round (default: fresh)")
    parser.add_argument("--keep", type=Path, default=ROOT / "out" / "fuzz", help="where files at fault go")
    parser.add_argument("--draw", help=argparse.SUPPRESS)
    given = parser.parse_args()
    given.keep.mkdir(parents=True, exist_ok=True)
    if given.draw:
        print(draw(given.draw, given.seed, 60.0 * given.minutes, given.keep))
        return 0
    names = [name for name in corpus() if given.only in name]
    until, first = time.monotonic() + 60.0 * given.minutes, given.seed
    counts, faults = dict.fromkeys(names, 0), 0
    seed = secrets.randbits(32) if first is None else first
    each = min(ROUND, 60.0 * given.minutes / max(len(names), 1))
    while not faults and (time.monotonic() < until or not all(counts.values())):
        for name in names:
            folder = given.keep / f"{seed}-{os.getpid()}"
            folder.mkdir(exist_ok=True)
            count, fault = supervised(name, seed, each, folder)
            counts[name] += count
            if fault:
                faults += 1
                print(f"fuzz: {folder / name}, seed {seed}: {fault}", flush=True)
            else:
                (folder / name).unlink(missing_ok=True)
                print(f"{name}: {count} files, seed {seed}", flush=True)
            if not any(folder.iterdir()):
                folder.rmdir()
            if time.monotonic() > until and all(counts.values()):
                break
        seed += 1
    total = f"{sum(counts.values())} damaged files of {sum(map(bool, counts.values()))} kinds"
    print(f"fuzz: {total}, {faults} at fault" if faults else f"fuzz: {total}, none at fault")
    return bool(faults)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
