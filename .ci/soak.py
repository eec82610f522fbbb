"""Property tests with fresh seeds, round after round, until the time is up or a case fails.

    python .ci/soak.py --minutes 10 [--seed N] [--installed]

A failing case ends it with exit code 1. It prints what the test says of the case, and the command that draws
it again.
"""

from __future__ import annotations

import argparse
import os
import re
import secrets
import shlex
import subprocess
import sys
import time
from pathlib import Path
from subprocess import PIPE, STDOUT
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PYTEST = Path(sys.executable).with_name("pytest")
# A test that takes arguments is one inside `proptest!`; remarks and further attributes may stand between.
PROPERTY = re.compile(r"#\[test\]\s*(?:///[^\n]*\s*|#\[[^\]]*\]\s*)*fn (\w+)\(\s*[^\s)]")
SEED = "PROPTEST_RNG_SEED"


class Part(NamedTuple):
    """Property tests that one command runs."""

    name: str
    command: list[str]
    tests: list[str]


def rust_parts() -> list[Part]:
    """The library, and each file of tests/ that has property tests, built as `make test` builds them."""
    built = ["cargo", "test", "--locked", "-p", "pmsm-core"]
    homes = [([*built, "--lib"], sorted((ROOT / "crates/pmsm-core/src").rglob("*.rs")))]
    for path in sorted((ROOT / "tests").glob("*.rs")):
        command = [*built, "-p", "pmsm-py", "--release", "--test", path.stem]
        homes.append((command, [path, *sorted(path.with_suffix("").rglob("*.rs"))]))
    parts = []
    for command, paths in homes:
        names = {name for path in paths for name in PROPERTY.findall(path.read_text(encoding="utf-8"))}
        if not names:
            continue
        told = subprocess.run([*command, "--", "--list"], cwd=ROOT, check=False, stdout=PIPE, text=True)
        if told.returncode != 0:
            raise SystemExit(f"soak: {shlex.join(command)} did not build")
        listed = [line.removesuffix(": test") for line in told.stdout.splitlines() if line.endswith(": test")]
        tests = [test for test in listed if test.rpartition("::")[2] in names]
        if missing := names - {test.rpartition("::")[2] for test in tests}:
            raise SystemExit(f"soak: {shlex.join(command)} does not know {', '.join(sorted(missing))}")
        parts.append(Part(f"Rust, {command[-1].removeprefix('--')}", command, tests))
    return parts


def failed_in_rust(part: Part, seed: int) -> str | None:
    """What a failing case says of itself and the command that draws it again; None where none failed."""
    environment = os.environ | {SEED: str(seed)}
    command = [*part.command, "--", "--exact", *part.tests]
    ran = subprocess.run(
        command, cwd=ROOT, env=environment, stdout=PIPE, stderr=STDOUT, text=True, check=False
    )
    failed = re.findall(r"^test (\S+) \.\.\. FAILED$", ran.stdout, re.MULTILINE)
    passed = re.search(r"^test result: ok\. (\d+) passed", ran.stdout, re.MULTILINE)
    if ran.returncode == 0 and passed is not None and int(passed[1]) == len(part.tests):
        return None
    again = shlex.join([*part.command, "--", "--exact", *(failed or part.tests)])
    return f"{ran.stdout}\nDraw it again by\n  {SEED}={seed} {again}\n"


def failed_in_python(arguments: list[str], seed: int) -> str | None:
    """The same of the property tests in Python."""
    drawn = ["-m", "hypothesis", "--hypothesis-profile=soak", f"--hypothesis-seed={seed}"]
    command = [str(PYTEST), *arguments, *drawn]
    ran = subprocess.run(command, cwd=ROOT, stdout=PIPE, stderr=STDOUT, text=True, check=False)
    if ran.returncode == 0:
        return None
    failed = re.findall(r"^FAILED (\S+)", ran.stdout, re.MULTILINE)
    return f"{ran.stdout}\nDraw it again by\n  {shlex.join([*command, *failed])}\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="how long to draw (default 10)")
    parser.add_argument("--seed", type=int, help="seed of the first round, below 2^64 (default: fresh)")
    parser.add_argument("--installed", action="store_true", help="refuse to test but the wheel")
    given = parser.parse_args()
    arguments = ["--installed"] if given.installed else []
    parts = rust_parts()
    for part in parts:
        print(f"{part.name}: {len(part.tests)} property tests", flush=True)
    until = time.monotonic() + 60.0 * given.minutes
    rounds, seed = 0, given.seed
    while rounds == 0 or time.monotonic() < until:
        rounds, seed = rounds + 1, secrets.randbits(64) if seed is None or rounds else seed
        print(f"round {rounds}, seed {seed}", flush=True)
        failures = [failed_in_rust(part, seed) for part in parts]
        failures.append(failed_in_python(arguments, seed))
        if said := [failure for failure in failures if failure is not None]:
            print(*said, sep="\n")
            print(f"soak: round {rounds}, seed {seed}, failed; the case and how to draw it again are above")
            return 1
    print(f"soak: {rounds} rounds, no case failed")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
