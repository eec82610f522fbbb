"""Fills docs/paper.md with the figures and numbers of one `pmsm-rs reproduce all`.

python docs/paper.py
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from shutil import copyfile

from pmsm_rs.paper import FIGURES
from pmsm_rs.paper.reproduce import reproduce
from pmsm_rs.paper.tables import CHOICES, summary

PAGE = Path(__file__).with_suffix(".md")


def main() -> None:
    """Rewrites the page and its pictures."""
    with tempfile.TemporaryDirectory() as folder:
        outcome, _ = reproduce("all", folder)
        PAGE.with_suffix("").mkdir(exist_ok=True)
        for name in FIGURES:
            copyfile(Path(folder) / f"{name}.png", PAGE.with_suffix("") / f"{name}.png")
    blocks = {
        "results": [
            "| quantity | paper | here |",
            "|---|---|---|",
            *(f"| {name} | {paper} | {here} |" for name, paper, here in summary(outcome)),
        ],
        "choices": [f"- {name}: {choice}." for name, choice in CHOICES],
    }

    def block(found: re.Match[str]) -> str:
        return "\n".join([found[1], *blocks[found[2]], "<!-- end -->"])

    text = PAGE.read_text(encoding="utf-8")
    text = re.sub(r"(<!-- output of (\w+) -->)\n.*?<!-- end -->", block, text, flags=re.DOTALL)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
