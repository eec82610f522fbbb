"""An answer with all its parts, written by hand, and what reads a page."""

from __future__ import annotations

import copy
import json
from html.parser import HTMLParser
from typing import Any

import numpy as np
from pmsm_rs import Diagnosis


def estimate(value: float, stderr: float | None, unit: str) -> dict[str, Any]:
    interval = None if stderr is None else [value - 1.96 * stderr, value + 1.96 * stderr]
    why = "the speed hardly changes" if stderr is None else None
    return {"value": value, "stderr": stderr, "ci95": interval, "unit": unit, "why_none": why}


ANSWER: dict[str, Any] = {
    "schema": "pmsm-rs.diagnosis/2",
    "verdict": "named",
    "data_quality": [
        {"finding": "Time jitters.", "consequence": "High orders blur.", "fix": "Use the drive's clock."}
    ],
    "located": [
        {
            "equation": "q",
            "share": 0.83,
            "sentence": "It sits in the q axis.",
            "where": [{"variable": "i_q", "low": 4.0, "high": 11.0, "unit": "A"}],
            "order_electrical": 6,
            "order_mechanical": None,
            "frequency_hz": None,
            "trend": None,
            "p_value": 1e-9,
        },
    ],
    "ranking": [
        {
            "effect": "dead_time",
            "probability": 0.97,
            "sentence": "The inverter loses v_err.",
            "equation": "v_x = v_x* − v_err·sign(i_x)",
            "parameters": {"v_err": estimate(1.06, 0.01, "V")},
            "equivalent_to": [],
            "gain_held_out": 0.41,
        },
        {
            "effect": "rs_thermal_drift",
            "probability": 0.02,
            "sentence": "The winding warms up.",
            "equation": "r_s(T)",
            "parameters": {},
            "equivalent_to": ["dead_time"],
            "gain_held_out": None,
        },
    ],
    "model": {
        "effects": ["dead_time"],
        "base": {"r_s": estimate(0.77, 0.01, "ohm"), "b": estimate(0.002, None, "N m s")},
    },
    "cannot_see": [{"effect": "saturation_q", "why": "i_q stays small.", "power": 0.12}],
    "next_experiment": "Record steps of i_q.",
    "noise_floor": {"i_d": 0.02, "i_q": 0.02},
    "fit": {
        "recording": {"before": {"i_d": 0.31, "i_q": 0.17}, "after": {"i_d": 0.02, "i_q": 0.02}},
        "validation": {"before": {"i_d": 0.33, "i_q": 0.18}, "after": {"i_d": 0.03, "i_q": 0.02}},
    },
    "recording_kind": "full",
    "interrupted": False,
    "version": "1.2.3",
    "seed": 1,
}


IDENTIFICATION: dict[str, Any] = {
    "parameters": {"r_s": estimate(0.77, 0.01, "ohm")},
    "cost": 0.1,
    "history": [1.0, 0.1],
    "method": "pso",
    "evaluations": 300,
    "converged": False,
    "interrupted": False,
    "rms": {"i_d": 0.02},
    "cannot_show": [{"parameters": ["j", "b"], "why": "the speed hardly changes"}],
    "seed": 1,
    "version": "1.2.3",
}


def traces(n: int = 30_000) -> dict[str, dict[str, np.ndarray]]:
    rng = np.random.default_rng(1)
    t = np.arange(n) * 1e-4
    theta = 200.0 * t
    out = {
        "t": t,
        "op_omega_e": 200.0 + 50.0 * np.sin(t),
        "op_i_q": 3.0 * np.sin(4.0 * t),
        "op_i_d": np.zeros(n),
    }
    out |= {"op_theta_e": theta, "op_theta_m": theta / 3.0}
    for name in ("i_d", "i_q"):
        noise = 0.02 * rng.standard_normal(n)
        out |= {
            f"{name}_measured": np.sin(3.0 * t) + 0.3 * np.cos(6.0 * theta) + noise,
            f"{name}_before": np.sin(3.0 * t),
            f"{name}_after": np.sin(3.0 * t) + 0.3 * np.cos(6.0 * theta),
        }
    return {"recording": out, "validation": out}


def diagnosis(**changes: Any) -> Diagnosis:
    return Diagnosis.from_json(json.dumps({**copy.deepcopy(ANSWER), **changes}), traces())


class Tags(HTMLParser):
    """Open tags that are never closed, and every address a page refers to."""

    VOID = frozenset({"meta", "br", "link", "img", "hr", "input"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.problems: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in {"src", "href", "xlink:href"}]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in {"src", "href", "xlink:href"}]

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.problems.append(tag)


REMAINING: dict[str, Any] = {
    "equation": "q",
    "beside": ["dead_time"],
    "times_noise": {"recording": 3.1, "validation": 14.8},
    "over": ["i_q"],
    "p_value": 1e-9,
    "sentence": "Beside dead_time the q-axis voltage equation has a residual of 3.1 times the noise in i_q.",
}
