"""Rewrites the printed output and the picture in README.md from what the installed package does.

    make readme

Each block between `<!-- output of NAME -->` and `<!-- end -->` is replaced. `--check` only compares, and
exits with 1 if README.md does not say what the package prints; last digits may differ between processors, so
numbers are left out of that comparison.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from shutil import copyfile

import numpy as np
from matplotlib.figure import Figure
from pmsm_rs import Diagnosis, diagnose, load, plot
from pmsm_rs.config import read_machine
from pmsm_rs.demo import recording_files

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
PICTURE = ROOT / "docs" / "demo.png"


def printed(folder: Path, *arguments: str) -> str:
    """Standard output of a command in `folder`."""
    done = subprocess.run(arguments, cwd=folder, check=True, capture_output=True, text=True, encoding="utf-8")
    return done.stdout.rstrip() + "\n"


def command(folder: Path, *arguments: str) -> str:
    """Standard output of `pmsm-rs` with the given arguments."""
    return printed(folder, sys.executable, "-c", "from pmsm_rs.cli import main; main()", *arguments)


def python_example(text: str) -> str:
    """The Python example of the README."""
    found = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert found is not None, "README.md has an example in Python"
    return found.group(1)


def outputs(text: str, folder: Path) -> dict[str, str]:
    """What each block of the README must hold."""
    for source, name in zip(recording_files(), ("run.parquet", "other.parquet", "machine.toml"), strict=True):
        copyfile(source, folder / name)
    own = folder / "own"
    own.mkdir()
    log(own / "run.csv")
    return {
        "demo": command(folder, "demo"),
        "inspect": command(own, "inspect", "run.csv", "--write", "machine.toml"),
        "effects": command(folder, "effects"),
        "python": printed(folder, sys.executable, "-c", python_example(text)),
    }


def log(path: Path) -> None:
    """Writes the demo recording as a drive would log it, under names and units of its own."""
    machine = read_machine(recording_files()[2]).machine
    run = load(recording_files()[0])
    columns = {
        "time_s": run.column("t"),
        **{f"I{phase}": run.column(f"i_{phase}") for phase in "abc"},
        **{f"V{axis}_ref": run.column(f"v_{axis}") for axis in "dq"},
        "theta_el_rad": run.column("theta_e"),
        "speed_rpm": run.column("omega_e") / machine.n_p * 30.0 / np.pi,
        "status": np.ones(len(run)),
    }
    values = np.column_stack([*columns.values()])
    np.savetxt(path, values, fmt="%.8g", delimiter=",", header=",".join(columns), comments="")


def fill(text: str, blocks: dict[str, str]) -> str:
    """The README with its blocks replaced."""

    def block(found: re.Match[str]) -> str:
        return f"{found[1]}\n```text\n{blocks[found[2]]}```\n<!-- end -->"

    pattern = r"(<!-- output of (\w+) -->)\n.*?<!-- end -->"
    return re.sub(pattern, block, text, flags=re.DOTALL)


def wording(text: str) -> str:
    """The text without the values of its numbers and without padding."""
    return re.sub(r" +", " ", re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "#", text))


def demo_answer() -> Diagnosis:
    """The diagnosis that `pmsm-rs demo` makes."""
    recording, validation, machine = recording_files()
    return diagnose(load(recording, machine), read_machine(machine).machine, load(validation, machine))


def picture(path: Path) -> None:
    """Torque current where the plain model is worst, and its mismatch over the direct current."""
    answer = demo_answer()
    figure = Figure(figsize=(10, 3.2), layout="constrained", facecolor="white")
    left, right = figure.subplots(1, 2)
    plot.trajectory(answer, "i_q", ax=left)
    plot.residual_over(answer, "i_q", "op_i_q", ax=right)
    left.legend(frameon=False, fontsize="small")
    right.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=100, metadata={"Software": None})


def main() -> int:
    """Rewrites or checks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="change nothing; exit with 1 if it would")
    check = parser.parse_args().check
    os.environ["NO_COLOR"] = "1"
    text = README.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        filled = fill(text, outputs(text, Path(folder)))
    if check:
        return int(wording(filled) != wording(text))
    README.write_text(filled, encoding="utf-8")
    picture(PICTURE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
