"""Makes logs with mistakes of wiring, sign, scale and time, and counts which the installed tool tells.

python -m proof.mistakes --out out/mistakes --machines 3 --seed 7          # from the root of the repository

Logs come from the plant of this folder: of healthy machines, with dead time, and of whole benches of three to
seven effects.  Every log has a machine of its own, and a load that the log or the machine file states.  Each
mistake is made in both runs of each log.  The logs as they are count as sound.  What is made and answered is
not repeated: an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

# before numpy: each worker is to use one processor
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np  # noqa: E402

from . import answers, generate, splits  # noqa: E402
from .__main__ import claim, seed_of  # noqa: E402
from .case import write_columns, write_text  # noqa: E402
from .heldout import columns  # noqa: E402
from .mistake_kinds import Mistake, made, mistakes  # noqa: E402
from .mistake_score import SOUND, Result, headline, markdown, outcome  # noqa: E402
from .plan import KNOWN, PARTS, Planned, chosen, dealt, name_of  # noqa: E402
from .pool import spread  # noqa: E402
from .table import commit  # noqa: E402

LOGS = ("healthy", "dead-time", "bench")
# loads that the log or the machine file states: against others no scale of the torque shows
LOADS = ("known_constant", "measured")
# every mistake by name; only the names hold for all machines
NAMES = tuple(mistakes(1, 1.0))


def planned(machines: int, seed: int, split: str) -> list[Planned]:
    """The logs of so many machines of each kind, in turn; more machines do not change the first ones."""
    rng = [np.random.default_rng([seed, 6, k]) for k in range(4)]
    decks = zip(rng[:3], (splits.machines(split), LOADS, KNOWN), strict=True)
    kinds, loads, effects = (dealt(r, names) for r, names in decks)
    out = []
    for _ in range(machines):
        bench = chosen(effects, int(rng[3].integers(*PARTS, endpoint=True)))
        for log, names in zip(LOGS, ((), ("dead_time",), bench), strict=True):
            # as a whole bench: the rotor turns, and the plant's own equations come back to the noise
            out.append(Planned("whole", names, next(kinds), next(loads), "full", "plant", log))
    return out


def make(number: int, seed: int, plan: Planned, split: str, out: Path) -> str:
    """Make a log where that has not been done; a line that says so."""
    if generate.is_made(number, out):
        return ""
    generate.generate(number, seed, plan, out, split, LOADS)
    return f"{name_of(number)} made ({plan.family})"


def truth_of(number: int, out: Path) -> dict[str, Any]:
    """What the sealed folder of a log tells."""
    path = out / "sealed" / name_of(number) / "truth.json"
    return json.loads(path.read_text(encoding="utf-8"))


def kinds_of(truth: dict[str, Any]) -> dict[str, Mistake]:
    """All mistakes of a machine."""
    return mistakes(truth["base_true"]["n_p"], truth["v_dc"])


def write_mistaken(opened: Path, mistake: Mistake, folder: Path) -> None:
    """Copy recording, validation run and machine file to a folder, with a mistake made."""
    for run in ("recording.parquet", "validation.parquet"):
        write_columns(folder / run, made(columns(opened / run), mistake))
    plate = (opened / "machine.toml").read_text(encoding="utf-8")
    poles = re.sub(r"(?m)^n_p = (\d+)", lambda m: f"n_p = {int(m[1]) * mistake.poles}", plate)
    write_text(folder / "machine.toml", poles)


def paths(number: int, name: str, out: Path) -> tuple[Path, Path]:
    """Answer and cost of a log with a mistake."""
    stem = out / "answers" / name_of(number)
    return stem / f"{name}.json", stem / f"{name}.cost.json"


def answer(number: int, name: str, out: Path, code: str) -> str:
    """Let the tool answer a log with the mistake of this name, where it has not; a line that says so."""
    path, cost_path = paths(number, name, out)
    if answers.is_answered_in(cost_path, code):
        return ""
    opened = out / "open" / name_of(number)
    with tempfile.TemporaryDirectory(prefix="pmsm-mistake-") as work:
        folder = opened
        if name != SOUND:
            folder = Path(work)
            write_mistaken(opened, kinds_of(truth_of(number, out))[name], folder)
        cost = answers.ask(folder, (path, Path(work, "trajectories.parquet"), cost_path), code)
    ended = "" if cost.exit == 0 else f", exit {cost.exit}"
    return f"{name_of(number)} {name} answered in {cost.seconds:.0f} s{ended}"


def result(number: int, name: str, log: str, out: Path) -> Result:
    """What became of one log with a mistake, or without one."""
    path, cost_path = paths(number, name, out)
    said = json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
    cost = json.loads(cost_path.read_text(encoding="utf-8"))
    truth = truth_of(number, out)
    mistake = None if name == SOUND else kinds_of(truth)[name]
    became = outcome(said, cost["said"], mistake, truth["components"])
    return Result(log, name_of(number), name, became, headline(said, cost["said"]), cost["cpu_seconds"])


def listed(names: Sequence[str]) -> Callable[[str], tuple[str, ...]]:
    """Reads names that are separated by commas."""

    def read(text: str) -> tuple[str, ...]:
        given = tuple(text.split(","))
        if unknown := [k for k in given if k not in names]:
            raise argparse.ArgumentTypeError(f"no {', '.join(unknown)}; there are {', '.join(names)}")
        return given

    return read


def arguments() -> argparse.Namespace:
    """What the command line asks."""
    ap = argparse.ArgumentParser(
        prog="python -m proof.mistakes",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    ap.add_argument("--out", type=Path, required=True, help="folder of logs, answers and results")
    ap.add_argument("--seed", type=seed_of, required=True, help="a number, or `commit`")
    ap.add_argument(
        "--machines", type=int, default=3, help="logs of each kind that get every mistake (default 3)"
    )
    ap.add_argument(
        "--sound", type=int, default=0, help="logs of each kind as they are (default and least: --machines)"
    )
    ap.add_argument("--logs", type=listed(LOGS), default=LOGS, help=f"of {','.join(LOGS)} (default: all)")
    ap.add_argument(
        "--mistakes", type=listed(NAMES), default=NAMES, help="names, see the table (default: all)"
    )
    ap.add_argument("--split", choices=splits.SPLITS, default="scoring", help="machines (default scoring)")
    ap.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    a = ap.parse_args()
    if a.machines < 1:
        ap.error("there is at least one machine")
    return a


def main() -> int:
    """Do what the arguments ask; 1 if a log could not be made, 130 if interrupted."""
    a = arguments()
    claim(a.out, {"holds": "mistakes", "seed": a.seed, "split": a.split})
    code = answers.code_of()
    logs = [
        (number, plan)
        for number, plan in enumerate(planned(max(a.machines, a.sound), a.seed, a.split))
        if plan.family in a.logs
    ]
    with_mistakes = len(LOGS) * a.machines
    try:
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        generate.warm_up()
        tasks = {name_of(n): (n, a.seed, plan, a.split, a.out) for n, plan in logs}
        failed = spread(make, tasks, a.jobs)
        asked = [
            (n, name, plan.family)
            for n, plan in logs
            if generate.is_made(n, a.out)
            for name in (SOUND, *(a.mistakes if n < with_mistakes else ()))
        ]
        failed += spread(answer, {f"{name_of(n)} {k}": (n, k, a.out, code) for n, k, _ in asked}, a.jobs)
    except KeyboardInterrupt:
        print("Interrupted; the same command goes on from here.", file=sys.stderr)
        return 130
    rows = [result(n, name, log, a.out) for n, name, log in asked if paths(n, name, a.out)[1].exists()]
    facts = {"seed": a.seed, "machines": a.split, "pmsm-rs": version("pmsm-rs")}
    facts |= {"commit": commit(), "installed code": code}
    # the words of a mistake are those of each machine, its name and its reason the same for all
    table = markdown(rows, a.logs, mistakes(1, 1.0), facts)
    write_text(a.out / "table.md", table)
    write_text(a.out / "results.json", json.dumps([asdict(r) for r in rows], indent=1) + "\n")
    print(table)
    for line in failed:
        print(line, file=sys.stderr)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
