"""Makes the pictures of README.md and of "How the diagnosis works" from real output.

    make pictures

The example is a servo with three effects from the independent motor in `proof/`. Its answer fills the block
in docs/how_it_works.md. README.md shows its picture, too.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from matplotlib.figure import Figure
from pmsm_rs import Diagnosis, diagnose, effects, load, plot
from pmsm_rs.results import budget
from pmsm_rs.results.words import estimate, percent, title

DOCS: Final = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent))
sys.path.insert(0, str(DOCS))

from diagrams import pipeline, verdicts  # noqa: E402
from readme import fill  # noqa: E402

from proof.case import make_case  # noqa: E402
from proof.machines import SERVO  # noqa: E402

FOLDER: Final = DOCS / "how_it_works"
PAGE: Final = DOCS / "how_it_works.md"
PRESENT: Final = {
    "dead_time": {"v_err": 0.96},
    "coulomb_friction": {"tau_c": 0.06},
    "saturation_q": {"drop_at_rated": 0.08},
}
"""The effects of the example, in the parameters of the independent motor."""
SEED: Final = 6


def example() -> tuple[Diagnosis, dict[str, Any]]:
    """The diagnosis of the example, and the truth that the tool was not given."""
    with tempfile.TemporaryDirectory() as work:
        opened, sealed = Path(work, "open"), Path(work, "sealed")
        truth = make_case(
            opened, SERVO, PRESENT, "rich", "unknown_constant", SEED, truth_folder=sealed, duration=2.0
        )
        machine = str(opened / "machine.toml")
        run, other = (load(opened / name, machine) for name in ("recording.parquet", "validation.parquet"))
        return diagnose(run, machine, other), truth


def picture(answer: Diagnosis, path: Path) -> None:
    """Measured minus model of the torque current on the validation run, and the budget of each channel."""
    figure = Figure(figsize=(10, 3.4), layout="constrained", facecolor="white")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    plot.residual_over_time(answer, "i_q", ax=left)
    left.legend(frameon=False, fontsize="small", ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    budget.draw(budget.judged(answer.budget), right)
    figure.savefig(path, dpi=100, metadata={"Software": None})


def comparison(answer: Diagnosis, truth: dict[str, Any]) -> str:
    """The names found with their probabilities, and parameters beside the values that were put in."""
    lines = [f"Verdict: {answer.verdict}", ""]
    lines += [
        f"{percent(c.probability):>6}  {title(c.effect)}" for c in answer.ranking if c.probability > 0.01
    ]
    lines += ["", f"{'parameter':<24}{'found':<34}put in"]
    found = {name: entry for name, entry in answer.base.items() if name in truth["base_true"]}
    pairs = [(name, entry, truth["base_true"][name]) for name, entry in found.items()]
    for candidate in answer.ranking:
        known = truth["parameters"].get(candidate.effect, {})
        pairs += [
            (f"{candidate.effect}.{name}", entry, known[name])
            for name, entry in candidate.parameters.items()
            if known.get(name)
        ]
    for name, entry, true in pairs:
        value, spread, unit = estimate(entry)
        shown = f"{value} ± {spread} {unit}" if spread else f"{value} {unit}"
        real = estimate(replace(entry, value=true, stderr=None))
        lines.append(f"{name:<24}{shown:<34}{real[0]} {real[2]}")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Writes the three pictures and the block of the page."""
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / "pipeline.svg").write_text(pipeline(len(effects())).svg(), encoding="utf-8")
    (FOLDER / "verdicts.svg").write_text(verdicts().svg(), encoding="utf-8")
    answer, truth = example()
    picture(answer, FOLDER / "example.png")
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(fill(text, {"example": comparison(answer, truth)}), encoding="utf-8")


if __name__ == "__main__":
    main()
