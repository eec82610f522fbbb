"""What is written where a recording cannot be diagnosed at all."""

from __future__ import annotations

from . import _core
from .results import json_text
from .run import effects


def answer(error: _core.NotIdentifiableError, seed: int) -> str:
    """The refusal as an answer of schema pmsm-rs.diagnosis/1 whose verdict is `undetermined`: nothing is
    located, ranked or seen, and `data_quality` holds the reason and its remedy.
    """
    finding = {
        "finding": error.problem,
        "consequence": "nothing can be said of the motor from this recording",
        "fix": error.fix,
    }
    unseen = [{"effect": effect["id"], "why": error.problem, "power": 0.0} for effect in effects()]
    nothing: dict[str, dict[str, float]] = {"before": {}, "after": {}}
    return json_text(
        {
            "schema": "pmsm-rs.diagnosis/1",
            "verdict": "undetermined",
            "data_quality": [finding],
            "located": [],
            "ranking": [],
            "model": {"effects": [], "base": {}},
            "path": [],
            "cannot_see": unseen,
            "next_experiment": None,
            "noise_floor": {},
            "fit": {"recording": nothing, "validation": nothing},
            "seed": seed,
            "version": _core.__version__,
        }
    )
