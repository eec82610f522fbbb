"""Times the installed `pmsm-rs diagnose` on a folder of cases, one after the other.

    python benches/cases.py FOLDER [--threads 2]

Every case is a folder with `recording.parquet`, `machine.toml` and, where there is one, `validation.parquet`,
as `make proof` leaves them in `out/proof/open`. Times are by the clock, the start of the program included.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from pathlib import Path

TOOL = Path(sys.executable).with_name("pmsm-rs")


def seconds(case: Path, threads: int) -> float:
    """Time of one diagnosis.

    Raises CalledProcessError where the tool fails; that a recording shows too little (exit code 4) is an
    answer.
    """
    command = [
        str(TOOL),
        "diagnose",
        str(case / "recording.parquet"),
        "--machine",
        str(case / "machine.toml"),
    ]
    if (validation := case / "validation.parquet").exists():
        command += ["--validate", str(validation)]
    began = time.perf_counter()
    done = subprocess.run([*command, "--threads", str(threads), "--seed", "1"], stdout=subprocess.DEVNULL)
    if done.returncode not in (0, 4):
        raise subprocess.CalledProcessError(done.returncode, command)
    return time.perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--threads", type=int, default=2)
    asked = parser.parse_args()
    cases = sorted(path.parent for path in asked.folder.glob("*/recording.parquet"))
    if not cases:
        parser.error(f"{asked.folder} holds no folder with a recording.parquet")
    took = {case.name: seconds(case, asked.threads) for case in cases}
    print(f"{len(took)} cases, {asked.threads} threads: median {statistics.median(took.values()):.1f} s")
    for limit in (3.0, 5.0):
        print(f"  under {limit:.0f} s: {sum(s < limit for s in took.values())}")
    longest = sorted(took, key=lambda name: -took[name])[:10]
    print("  longest: " + ", ".join(f"{name} {took[name]:.1f} s" for name in longest))


if __name__ == "__main__":
    main()
