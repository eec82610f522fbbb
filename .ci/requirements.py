"""Prints what the package needs, the extras for formats of files included, as a file of requirements.

python .ci/requirements.py > requirements.txt
"""

from __future__ import annotations

import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OURS = ("all", "formats")
"""Extras that people install; `formats` names the others."""


def requirements() -> list[str]:
    """Requirements of the package and of its extras, without itself."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    waiting, found = list(OURS), list(project["dependencies"])
    while waiting:
        for need in extras[waiting.pop()]:
            own = need.startswith("pmsm-rs[")
            waiting += need.removeprefix("pmsm-rs[").removesuffix("]").split(",") if own else []
            found += [] if own else [need]
    return list(dict.fromkeys(found))


if __name__ == "__main__":
    print("\n".join(requirements()))
