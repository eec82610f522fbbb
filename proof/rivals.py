"""The baselines' answers, judged like the tool's, and their lines of the table."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from .baselines import METHODS
from .families import families
from .score import Judged, judge, read
from .summary import Rate, Value

# what is compared; a baseline states no probability, so that every name counts as sure
COMPARED = (
    "parts of 2 times the noise and more, found",
    "names that are right",
    "cases with a wrong name of p > 0.5",
    "false alarms",
    "remaining over noise, median",
    "remaining over noise, 90 % below",
    "run time, median, s of processor",
)
NAMELESS = "gaussian"


def judge_rivals(case: str, out: Path) -> dict[str, Judged]:
    """method -> what became of a case; without an entry where the method did not run."""
    told = read(out / "baselines" / f"{case}.json")
    truth = json.loads((out / "sealed" / case / "truth.json").read_text(encoding="utf-8"))
    noise = truth["runs"]["validation"]["noise_rms"]
    found = {}
    for method in METHODS:
        if (said := told.get(method)) is None:
            continue
        answer = {
            "verdict": "named" if said["names"] else "no_mismatch",
            "ranking": [{"effect": name, "probability": 1.0} for name in said["names"]],
            "model": {"effects": said["names"]},
        }
        row = judge(case, truth, answer, {"cpu_seconds": said["seconds"]})
        if row.log == "full":
            row.remaining = max(v / noise[k] for k, v in said["rms"].items())
        found[method] = row
    return found


def compared(rows: Sequence[Judged], rivals: Sequence[dict[str, Judged]]) -> dict[str, dict[str, list[str]]]:
    """measure -> method -> its text per family, the families as in `families(rows)`."""
    groups = list(families(rows))
    by: dict[str, dict[str, dict[str, Rate | Value]]] = {"pmsm-rs": families(rows)}
    for method in METHODS:
        by[method] = families([r[method] for r in rivals if method in r])
    out: dict[str, dict[str, list[str]]] = {}
    for measure in COMPARED:
        nameless = not measure.startswith(("remaining", "run time"))
        out[measure] = {
            method: [str(of[g][measure]) if g in of else "–" for g in groups]
            for method, of in by.items()
            if not (nameless and method == NAMELESS)
        }
    return out


def lines_of(rows: Sequence[Judged], rivals: Sequence[dict[str, Judged]]) -> list[str]:
    """The table of baselines; empty where none ran."""
    if not any(rivals):
        return []
    groups = list(families(rows))
    lines = ["", "## Simpler methods on the same cases", ""]
    lines += ["| | method | " + " | ".join(groups) + " |", "|" + (2 + len(groups)) * "---|"]
    for measure, of in compared(rows, rivals).items():
        for n, (method, texts) in enumerate(of.items()):
            lines.append(f"| {'' if n else measure} | {method} | " + " | ".join(texts) + " |")
    return lines
