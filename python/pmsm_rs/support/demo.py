"""The recording that ships with the package, and what was put into it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..results.estimates import Estimate
from ..results.findings import DiagnosisValues
from ..results.words import estimate, lower_first, percent, title

_FOLDER = Path(__file__).parents[1] / "demo_data"


def recording_files() -> tuple[str, str, str]:
    """Recording, validation run and machine file."""
    return (
        str(_FOLDER / "recording.parquet"),
        str(_FOLDER / "validation.parquet"),
        str(_FOLDER / "machine.toml"),
    )


def sealed() -> dict[str, Any]:
    """What was put into the demo recording. Read after the diagnosis only, to compare."""
    content: dict[str, Any] = json.loads((_FOLDER / "sealed.json").read_text(encoding="utf-8"))
    return content


def compare(answer: DiagnosisValues) -> str:
    """Finding and truth side by side."""
    truth = sealed()
    effect: str = truth["effect"]
    parameters: dict[str, float] = truth["parameters"]
    lines = ["Compared with what was put in", f"  Put in: {lower_first(title(effect))}."]
    candidates = {answer.ranking[0].effect, *answer.ranking[0].equivalent_to} if answer.ranking else set()
    if answer.verdict == "named" and answer.effects == (effect,):
        lines.append("  The finding is right.")
    elif answer.verdict == "ambiguous" and effect in candidates:
        lines.append("  It is among the candidates.")
    else:
        lines.append("  The finding is wrong.")
    by_name = {candidate.effect: candidate for candidate in answer.ranking}
    if effect in by_name:
        lines += [
            line
            for name, value in parameters.items()
            for line in _compared(name, by_name[effect].parameters.get(name), value)
        ]
    lines += [
        line
        for name, value in truth["base_true"].items()
        for line in _compared(name, answer.base.get(name), value)
    ]
    return "\n".join(lines)


def _compared(name: str, entry: Estimate | None, truth: float) -> list[str]:
    if entry is None or entry.value is None:
        return []
    real = estimate(replace(entry, value=truth, stderr=None))
    off = f" ({percent(abs(entry.value / truth - 1.0))} off)" if truth else ""
    return [f"  {name}: found {estimate(entry)}, put in {real}{off}"]
