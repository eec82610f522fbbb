"""Truths and answers of the proof, as short as the scorer lets them be."""

from __future__ import annotations

import sys
from typing import Any

from conftest import ROOT

sys.path.insert(0, str(ROOT))

from proof.score import Judged, judge


def truth(kind: str, *effects: str, **more: Any) -> dict[str, Any]:
    """What a sealed truth says that matters to the judge."""
    return {
        "kind": kind,
        "effect": "+".join(effects) or "none",
        "components": [e for e in effects if not e.startswith("x_")],
        "accept": {e: ["mechanical"] for e in effects},
        "parameters": {"coulomb_friction": {"tau_c": 0.2, "w_smooth": 0.05}},
        "indistinguishable": [],
        "also_accept": [],
        "base_true": {},
        "severity": 4.0,
        "manoeuvre": "poor" if kind == "poor" else "rich",
        "load": "none",
        "machine": "servo",
        "source": "plant",
        **more,
    }


def answer(verdict: str, *ranking: tuple[str, float], **more: Any) -> dict[str, Any]:
    """An answer with this ranking; `near` are the equivalents of the first."""
    near = more.pop("near", [])
    return {
        "verdict": verdict,
        "located": [{"equation": "mechanical"}],
        "ranking": [
            {"effect": e, "probability": p, "equivalent_to": near, "parameters": {}} for e, p in ranking
        ],
        "model": {"effects": [e for e, _ in ranking[:1]]},
        **more,
    }


def judged(what: dict[str, Any], said: dict[str, Any]) -> Judged:
    return judge("v000", what, said, {})


COULOMB, DRAG = "coulomb_friction", "quadratic_drag"
