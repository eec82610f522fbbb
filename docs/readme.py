"""Rewrites the printed output in README.md and the manual from what the installed package does.

    make readme

Each block between `<!-- output of NAME -->` and `<!-- end -->` of the pages is replaced. `--check` only
compares. It names each page that does not show what the package prints, and exits with 1. Last digits may
differ between processors, so the comparison leaves numbers out.
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
from pmsm_rs import load
from pmsm_rs.config.machine_file import read_machine
from pmsm_rs.support.demo import recording_files

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
PAGES = (README, ROOT / "docs" / "getting_started.md")
FINDING = ("Candidates", "Budget of the mismatch")
"""The sections of the demo's output that README.md shows below the headline."""


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


def sections(text: str, *headings: str) -> str:
    """The first paragraph of an answer, and the paragraphs below these headings."""
    first, *others = text.split("\n\n")
    shown = [part.rstrip() for heading in headings for part in others if part.startswith(heading)]
    assert len(shown) == len(headings), "the answer has each of these sections once"
    return "\n\n".join([first, *shown]) + "\n"


def outputs(text: str, folder: Path) -> dict[str, str]:
    """What each block of the pages must hold; `text` is that of README.md."""
    for source, name in zip(recording_files(), ("run.parquet", "other.parquet", "machine.toml"), strict=True):
        copyfile(source, folder / name)
    own = folder / "own"
    own.mkdir()
    log(own / "run.csv")
    demo = command(folder, "demo")
    return {
        "demo": demo,
        "finding": sections(demo, *FINDING),
        "inspect": command(own, "inspect", "run.csv", "--write", "machine.toml"),
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
    """The page with its blocks replaced."""

    def block(found: re.Match[str]) -> str:
        return f"{found[1]}\n```text\n{blocks[found[2]]}```\n<!-- end -->"

    pattern = r"(<!-- output of (\w+) -->)\n.*?<!-- end -->"
    return re.sub(pattern, block, text, flags=re.DOTALL)


def wording(text: str) -> str:
    """The text without the values of its numbers and without padding."""
    return re.sub(r" +", " ", re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "#", text))


def main() -> int:
    """Rewrites or checks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="change nothing; exit with 1 if it would")
    check = parser.parse_args().check
    os.environ["NO_COLOR"] = "1"
    texts = {page: page.read_text(encoding="utf-8") for page in PAGES}
    with tempfile.TemporaryDirectory() as folder:
        blocks = outputs(texts[README], Path(folder))
    filled = {page: fill(text, blocks) for page, text in texts.items()}
    if check:
        wrong = [page for page, text in texts.items() if wording(filled[page]) != wording(text)]
        for page in wrong:
            print(f"{page.relative_to(ROOT)} does not show what the package prints", file=sys.stderr)
        return int(bool(wrong))
    for page, text in filled.items():
        page.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
