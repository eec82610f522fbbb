"""Models whose values are known: those of simulated machines, as an answer would hold them."""

from __future__ import annotations

from typing import Any

import pmsm_rs as pm
from pmsm_rs.model import Model

TEXT: list[pm.Effect] = [
    pm.effect(
        "my_brake",
        torque="k*w/(1+(w/w0)**2) + c*atan(w/w1)",
        parameters={
            "k": ("N m s", 0, 1),
            "c": ("N m", 0, 10),
            "w0": ("rad/s", 1, 500),
            "w1": ("rad/s", 0.1, 10),
        },
    ),
    pm.effect(
        "my_saturation",
        energy="g/l_q*abs(lambda_q/unit)**(s+2)*unit**2",
        parameters={"g": ("1", 0, 9), "s": ("1", 0.5, 6), "unit": ("V s", 0.1, 1)},
    ),
    pm.effect(
        "my_drop",
        voltage=("v_0*i_d/sqrt(i_d**2+i_q**2+i_0**2)", "v_0*i_q/sqrt(i_d**2+i_q**2+i_0**2)"),
        parameters={"v_0": ("V", 0, 9), "i_0": ("A", 0.1, 3)},
    ),
]
EFFECTS: dict[str, dict[Any, dict[str, float]]] = {
    "text": {
        TEXT[0]: {"k": 0.01, "c": 0.2, "w0": 30.0, "w1": 2.0},
        TEXT[1]: {"g": 0.2, "s": 1.5, "unit": 0.3},
        TEXT[2]: {"v_0": 1.5, "i_0": 0.5},
    },
    "friction": {"dead_time": {"v_err": 2.0}, "coulomb_friction": {"tau_c": 0.3}, "saturation_q": {}},
    "shaft": {"two_mass_shaft": {}, "iron_loss": {}, "cogging_torque": {}},
    "harmonics": {
        "back_emf_harmonics": {},
        "voltage_delay": {},
        "rs_thermal_drift": {},
        "quadratic_drag": {},
    },
}
MAP: list[dict[str, Any]] = [
    {
        "equations": ["mechanical"],
        "first": {"harmonics": {"angle": "theta_m", "order": 2, "count": 1}},
        "second": {
            "spline": {
                "variable": "omega_e",
                "low": -300.0,
                "high": 300.0,
                "degree": 3,
                "pieces": 3,
                "warp": 20.0,
            }
        },
        "coefficients": [0.1, 0.05, -0.02, 0.03, 0.04, 0.1, 0.02, 0.01, 0.0, 0.03, 0.02, -0.05],
    }
]


def simulated(effects: dict[Any, dict[str, float]], *, seed: int = 1, swap: bool = False) -> Any:
    """A short run of the paper's machine with these effects."""
    speeds = [0.0, 70.0, -50.0, 60.0] if swap else [0.0, 50.0, -60.0, 80.0]
    return pm.simulate(
        duration=0.8,
        seed=seed,
        drive={"f_sample": 5000.0},
        reference={
            "omega_m": {"t": [0.0, 0.1, 0.4, 0.6], "value": speeds},
            "i_d": {"t": [0.0, 0.2, 0.5], "value": [0.0, -3.0, 2.0], "shape": "steps"},
        },
        load={"tau": 0.5, "kind": "known_constant"},
        sensors={"noise_i": 0.01, "noise_omega_e": 0.05},
        effects=effects,
    )


def model_of(run: Any, map_parts: list[dict[str, Any]] | None = None) -> Model:
    """The true model of a simulated run, as an answer would hold it."""
    entries = [*pm.effects(), *(one.entry for one in TEXT)]
    names = {entry["id"]: [p["name"] for p in entry["parameters"]] for entry in entries}
    text = {one.name: {"definition": one.definition} for one in TEXT}
    own = {
        effect: {name: x for name, x in values.items() if name in names[effect]}
        for effect, values in run.truth.effects.items()
    }
    base = {
        name: {"value": x, "stderr": 0.01 * x, "ci95": [0.98 * x, 1.02 * x], "unit": "", "why_none": None}
        for name, x in run.truth.base.items()
    }
    return Model(
        {
            "effects": list(own),
            "base": base,
            "covariance": {"names": ["r_s", "l_d"], "matrix": [[4e-4, 1e-6], [1e-6, 1e-8]]},
            "specification": {
                "base": dict(run.truth.base),
                "effects": [
                    {"effect": name, "parameters": values, **text.get(name, {})}
                    for name, values in own.items()
                ],
                "map": map_parts or [],
                "scales": run.truth.scales,
            },
        }
    )
