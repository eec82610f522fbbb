"""Prints the section of CHANGELOG.md for a tag, and fails where the files do not name its version.

python .ci/changelog.py v0.1.0
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def problems(tag: str, root: Path) -> list[str]:
    """What keeps `tag` from being released."""
    version = tag.removeprefix("v")
    cargo = tomllib.loads((root / "Cargo.toml").read_text(encoding="utf-8"))
    named = cargo["workspace"]["package"]["version"]
    needed = cargo["workspace"]["dependencies"]["pmsm-core"]["version"]
    cited = re.search(r"^version: *\"?([^\"\s]+)", (root / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    out = []
    if not re.fullmatch(r"v\d+\.\d+\.\d+", tag):
        out.append(f"the tag {tag} is not of the form v1.2.3")
    if named != version or needed != version:
        out.append(f"Cargo.toml says {named}, for pmsm-core {needed}")
    if cited is not None and cited[1] != version:
        out.append(f"CITATION.cff says {cited[1]}")
    heading, text = section(version, root)
    if heading is None:
        out.append(f"CHANGELOG.md has no section ## {version}")
    elif "unreleased" in heading:
        out.append("CHANGELOG.md says unreleased; put the date there")
    elif not text:
        out.append(f"the section ## {version} of CHANGELOG.md is empty")
    return out


def section(version: str, root: Path) -> tuple[str | None, str]:
    """Heading and text of a version, None where there is none."""
    parts = re.split(r"^## (.*)$", (root / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.M)
    for heading, text in zip(parts[1::2], parts[2::2], strict=True):
        if heading.split()[:1] == [version]:
            return heading, text.strip()
    return None, ""


def main() -> int:
    """Prints the section, or what is wrong."""
    if len(sys.argv) != 2:
        print("usage: python .ci/changelog.py TAG", file=sys.stderr)
        return 2
    tag = sys.argv[1]
    wrong = problems(tag, ROOT)
    for line in wrong:
        print(f"{tag}: {line}", file=sys.stderr)
    if not wrong:
        print(section(tag.removeprefix("v"), ROOT)[1])
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
