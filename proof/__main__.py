"""Makes the cases of a set, lets the installed tool answer them, and scores the answers.

python -m proof --out out/proof --cases 300 --seed 7          # from the root of the repository

Each case is made, then answered, by one of --jobs processes.  What is made is not made again, and what this
very code has answered is not answered again: an interrupted run goes on where it stopped, and a changed
package answers the same cases anew.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

# before numpy: each worker is to use one processor
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"

from . import answers, generate  # noqa: E402
from .case import write_text  # noqa: E402
from .plan import FAMILIES, name_of, plan  # noqa: E402
from .pool import run  # noqa: E402
from .rivals import judge_rivals  # noqa: E402
from .score import judge_case  # noqa: E402
from .splits import SPLITS  # noqa: E402
from .table import write_results  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent


def claim(out: Path, wanted: dict[str, object]) -> None:
    """Mark the folder as holding this set.  Raises SystemExit if it holds another."""
    mark = out / "set.json"
    if mark.exists() and (found := json.loads(mark.read_text(encoding="utf-8"))) != wanted:
        raise SystemExit(
            f"{out} holds the set {found}, not {wanted}; name another folder by --out (make: OUT=)"
        )
    out.mkdir(parents=True, exist_ok=True)
    write_text(mark, json.dumps(wanted) + "\n")


def seed_of(text: str) -> int:
    """A number, or `commit`: the first seven hexadecimal digits of the commit that is checked out.

    A seed that follows from the code cannot have been looked at while the code was written.
    """
    if text != "commit":
        return int(text)
    if subprocess.run(["git", "diff", "--quiet", "HEAD"], cwd=ROOT, check=False).returncode != 0:
        raise argparse.ArgumentTypeError("there are changes that are not committed")
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, check=True, capture_output=True, text=True)
    return int(head.stdout[:7], 16)


def main() -> int:
    """Do what the arguments ask; 1 if a case could not be made, 130 if interrupted."""
    ap = argparse.ArgumentParser(
        prog="python -m proof", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    ap.add_argument(
        "--out", type=Path, required=True, help="folder of the set; open, sealed, answers and results"
    )
    ap.add_argument("--cases", type=int, default=600)
    ap.add_argument("--seed", type=seed_of, required=True, help="a number, or `commit`")
    ap.add_argument(
        "--families",
        type=lambda text: tuple(text.split(",")),
        default=tuple(FAMILIES),
        help=f"of {','.join(FAMILIES)} (default: all, in the shares of a set of 600)",
    )
    ap.add_argument("--split", choices=SPLITS, default="scoring", help="machines and forms (default scoring)")
    ap.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    ap.add_argument(
        "--baselines",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="let simpler methods answer the cases, too (default yes)",
    )
    ap.add_argument("--only", choices=("make", "score"), help="make the cases, or score what is answered")
    a = ap.parse_args()
    try:
        planned = plan(a.cases, a.seed, a.families, a.split)
    except ValueError as error:
        ap.error(str(error))
    claim(a.out, {"cases": a.cases, "seed": a.seed, "families": list(a.families), "split": a.split})
    code = "" if a.only == "make" else answers.code_of()
    rivals = a.baselines and a.only != "make"
    failed: list[str] = []
    began = time.monotonic()
    if a.only != "score":
        try:
            signal.signal(signal.SIGTERM, signal.default_int_handler)
            # compiles the plant once, so that the workers find it compiled
            generate.warm_up()
            failed = run(planned, a.seed, a.split, a.out, code, a.jobs, rivals)
        except KeyboardInterrupt:
            print("Interrupted; the same command goes on from here.", file=sys.stderr)
            return 130
    print(f"{(time.monotonic() - began) / 60.0:.1f} minutes")
    for line in failed:
        print(line, file=sys.stderr)
    if a.only != "make":
        rows = [judge_case(name_of(n), a.out) for n in range(a.cases) if generate.is_made(n, a.out)]
        others = [judge_rivals(r.case, a.out) for r in rows]
        print(write_results(rows, a.out, cases=a.cases, seed=a.seed, code=code, split=a.split, rivals=others))
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
