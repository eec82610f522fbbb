"""Checks the licences of all that the wheel contains and needs, without the network: crates by `cargo tree`,
Python packages by what is installed.

python .ci/licences.py
"""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PYTHON = frozenset({"0BSD", "CC0-1.0", "MIT-CMU", "PSF-2.0"})
"""Licences of Python packages beside those that deny.toml allows; all are as free."""
SPDX = {
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD-3-Clause",
    "MIT License": "MIT",
    "Python Software Foundation License": "PSF-2.0",
}
"""Names in the classifiers of packages that tell no SPDX expression."""


def is_allowed(expression: str, allowed: frozenset[str]) -> bool:
    """Whether an SPDX expression leaves a way with allowed licences only: OR within AND."""
    parts = expression.replace("/", " OR ").replace("(", "").replace(")", "").split(" AND ")
    return all(any(name.strip() in allowed for name in part.split(" OR ")) for part in parts)


def crates() -> Iterator[tuple[str, str]]:
    """Name and licence of each crate in the compiled core."""
    command = ["cargo", "tree", "--locked", "--package", "pmsm-py", "--edges", "normal,build"]
    command += ["--prefix", "none", "--no-dedupe", "--format", "{p}|{l}"]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    for line in sorted(set(ran.stdout.splitlines())):
        package, _, licence = line.partition("|")
        yield " ".join(package.split()[:2]), licence


def packages() -> Iterator[tuple[str, str]]:
    """Name and licence of each Python package that is needed without extras."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    waiting = [Requirement(text) for text in project["dependencies"]]
    seen: set[str] = set()
    while waiting:
        name = canonicalize_name(waiting.pop().name)
        if name in seen:
            continue
        seen.add(name)
        found = importlib.metadata.distribution(name)
        needs = [Requirement(text) for text in found.requires or ()]
        waiting += [need for need in needs if need.marker is None or need.marker.evaluate({"extra": ""})]
        yield f"{name} {found.version}", _licence(found.metadata)


def _licence(metadata: importlib.metadata.PackageMetadata) -> str:
    if expression := metadata.get("License-Expression"):
        return expression
    marks = [x.rpartition(" :: ")[2] for x in metadata.get_all("Classifier") or () if x.startswith("License")]
    return " AND ".join(SPDX.get(mark, mark) for mark in marks) or metadata.get("License") or "none told"


def main() -> int:
    rules = tomllib.loads((ROOT / "deny.toml").read_text(encoding="utf-8"))
    allowed = frozenset(rules["licenses"]["allow"])
    told = [(*entry, allowed) for entry in crates()]
    told += [(*entry, allowed | PYTHON) for entry in packages()]
    refused = [(name, licence) for name, licence, those in told if not is_allowed(licence, those)]
    for name, licence in refused:
        print(f"{name}: the licence {licence} is not among those that deny.toml allows", file=sys.stderr)
    print(f"{len(told) - len(refused)} of {len(told)} crates and packages have a licence that is allowed")
    return bool(refused)


if __name__ == "__main__":
    sys.exit(main())
