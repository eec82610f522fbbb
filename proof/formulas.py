"""How often the true form of an unknown torque stands among the formulas of an answer.

    python -m proof.formulas FOLDER

FOLDER holds a set of the family `foreign` with its answers, as `python -m proof` makes it. Forms of the
motion alone count, and answers in which formulas were asked for. Each form is known by a mark in the text of
a formula. The terms of the package were not made for these forms.
"""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from pathlib import Path

# What a formula must contain to be of this form. A tight spot and a cam are also a wave or two of the turn.
MARKS = {
    "x_friction_hump": r"− w_1\d?\)/w_0\d?\)²\)",
    "x_eddy_brake": r"ω/\(1 \+ \(ω/",
    "x_root_friction": r"\|ω\|\^",
    "x_dahl_presliding": r"dx/dθ",
    "x_tight_spot": r"exp\(\(cos\(θ.*sgn\(ω\)",
    "x_cam_load": r"exp\(\(cos\(θ|cos\(θ\)",
    "x_angle_friction": r"cos\(θ\) \+ s\d?·sin\(θ\)\)·sgn\(ω\)",
}


def counted(folder: Path) -> Counter[str]:
    """Cases by what came of them: asked, offered, first, three, close.

    `three` is among the first three; `close` is right with nine tenths of the validation run explained.
    """
    out: Counter[str] = Counter()
    for file in sorted((folder / "answers").glob("v*.json")):
        if file.name.count(".") > 1:
            continue
        answer = json.loads(file.read_text(encoding="utf-8"))
        truth = json.loads((folder / "sealed" / file.stem / "truth.json").read_text(encoding="utf-8"))
        form = next(iter(truth.get("foreign", {})), None)
        formulas = answer.get("formulas")
        if form not in MARKS or formulas is None:
            continue
        right = [bool(re.search(MARKS[form], entry["formula"])) for entry in formulas]
        out["asked"] += 1
        out["offered"] += bool(formulas)
        out["first"] += bool(right) and right[0]
        out["three"] += any(right[:3])
        best = next((e for e, hit in zip(formulas, right, strict=True) if hit), None)
        out["close"] += best is not None and best["explains"].get("validation", 0.0) >= 0.9
        print(
            f"{file.stem} {form:18} {'1' if any(right[:1]) else '3' if any(right[:3]) else '-'} "
            f"{formulas[0]['formula'] if formulas else 'no formula'}"
        )
    return out


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    totals = counted(Path(sys.argv[1]))
    print(", ".join(f"{name} {count}" for name, count in totals.items()) or "no answer of this kind")
