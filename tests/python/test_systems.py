"""Own systems: a direct-current motor and an induction machine written as Python functions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from numpy.typing import NDArray

Array = NDArray[np.float64]

DC = {"r": 0.8, "l": 1.5e-3, "k": 0.05, "j": 4e-5}
DC_BOUNDS = {"r": (0.1, 5.0), "l": (1e-4, 1e-2), "k": (0.01, 0.2), "j": (1e-6, 1e-3)}


def dc_motor(t: float, x: Any, u: Any, p: Any) -> list[Any]:
    i, omega = x
    return [(u["v"] - p["r"] * i - p["k"] * omega) / p["l"], (p["k"] * i - 2e-5 * omega) / p["j"]]


def simulated(rhs: Any, p: dict[str, float], t: Array, inputs: Any, x0: list[float]) -> Array:
    """States of shape (samples, states) by an integrator of its own, inputs held."""
    from scipy.integrate import solve_ivp

    x, states = np.array(x0), []
    for k in range(len(t)):
        states.append(x)
        if k + 1 < len(t):
            u = {name: values[k] for name, values in inputs.items()}
            span = (t[k], t[k + 1])
            x = solve_ivp(lambda t, x, u=u: rhs(t, x, u, p), span, x, rtol=1e-9, atol=1e-9).y[:, -1]
    return np.array(states)


@pytest.fixture(scope="module")
def motor() -> tuple[Array, dict[str, Array], Array]:
    t = np.arange(300) * 1e-3
    inputs = {"v": np.where(t < 0.15, 12.0, -6.0)}
    states = simulated(dc_motor, DC, t, inputs, [0.0, 0.0])
    return t, inputs, states + np.random.default_rng(1).normal(0, [0.02, 0.2], states.shape)


@pytest.mark.parametrize(("method", "vectorised"), [("pso+lm", True), ("lm", False), ("pso", True)])
def test_dc_motor(motor: tuple[Array, dict[str, Array], Array], method: str, vectorised: bool) -> None:
    t, inputs, measured = motor
    fit = pm.identify_system(
        dc_motor,
        t,
        inputs,
        measured,
        parameters=DC_BOUNDS,
        x0=[0.0, 0.0],
        method=method,
        swarm=pm.Swarm(inertia=1.0, inertia_schedule="adaptive", inertia_last=0.0),
        start={"r": 1.0, "l": 1e-3, "k": 0.06, "j": 5e-5},
        vectorised=vectorised,
    )
    assert not fit.interrupted
    for name, truth in DC.items():
        entry = fit.parameters[name]
        assert entry.value == pytest.approx(truth, rel=0.02)
        if method != "pso":
            assert entry.stderr is not None
            assert abs(entry.value - truth) < 4 * entry.stderr
    assert set(fit.rms) == {"0", "1"}
    assert "r " in str(fit)
    assert '"parameters"' in fit.to_json()


def test_induction_machine() -> None:
    truth = {"r_s": 3.7, "r_r": 2.1, "l_sigma": 0.021, "l_m": 0.224, "j": 0.0155}

    def machine(t: float, x: Any, u: Any, p: Any) -> list[Any]:
        """Inverse-Γ circuit in stator coordinates, two pole pairs, direct on the mains."""
        s_a, s_b, r_a, r_b, omega_m = x
        i_a, i_b = (s_a - r_a) / p["l_sigma"], (s_b - r_b) / p["l_sigma"]
        tau_e = 3.0 * (r_a * i_b - r_b * i_a)
        return [
            u["a"] - p["r_s"] * i_a,
            u["b"] - p["r_s"] * i_b,
            p["r_r"] * (i_a - r_a / p["l_m"]) - 2.0 * omega_m * r_b,
            p["r_r"] * (i_b - r_b / p["l_m"]) + 2.0 * omega_m * r_a,
            (tau_e - 0.005 * omega_m) / p["j"],
        ]

    def shown(t: float, x: Any, u: Any, p: Any) -> list[Any]:
        return [(x[0] - x[2]) / p["l_sigma"], (x[1] - x[3]) / p["l_sigma"], x[4]]

    t = np.arange(500) * 4e-4
    mains = {"a": 326.6 * np.cos(100 * np.pi * t), "b": 326.6 * np.sin(100 * np.pi * t)}
    states = simulated(machine, truth, t, mains, [0.0] * 5)
    outputs = np.array(shown(0.0, states.T, None, truth))
    noise = np.random.default_rng(2).normal(0, 1, outputs.shape) * np.array([[0.1], [0.1], [0.3]])
    noisy = outputs + noise
    fit = pm.identify_system(
        machine,
        t,
        mains,
        {"i_a": noisy[0], "i_b": noisy[1], "omega_m": noisy[2]},
        parameters={name: (0.2 * x, 5 * x) for name, x in truth.items()},
        x0=[0.0] * 5,
        output=shown,
        substeps=2,
        swarm=pm.Swarm(20, 40),
    )
    assert fit.converged
    assert set(fit.rms) == {"i_a", "i_b", "omega_m"}
    for name, value in truth.items():
        entry = fit.parameters[name]
        assert entry.value == pytest.approx(value, rel=0.05)
        assert entry.stderr is not None
        assert abs(entry.value - value) < 4 * entry.stderr


def decay(**given: Any) -> pm.SystemFit:
    t = np.arange(50) * 0.05
    x = 1.5 * np.exp(-2.0 * t)
    x[::7] = np.nan
    settings: dict[str, Any] = {
        "rhs": lambda t, x, u, p: [-p["a"] * x[0]],
        "t": t,
        "inputs": None,
        "measured": x,
        "parameters": {"a": (0.1, 10.0), "x_0": (-5.0, 5.0)},
        "x0": ["x_0"],
    }
    return pm.identify_system(**{**settings, **given})


def test_missing_values_and_an_unknown_start() -> None:
    fit = decay()
    assert fit.parameters["a"].value == pytest.approx(2.0, rel=1e-3)
    assert fit.parameters["x_0"].value == pytest.approx(1.5, rel=1e-3)


@pytest.mark.parametrize(
    ("wrong", "kind", "words"),
    [
        ({"method": "guess"}, pm.UsageError, "no method 'guess'"),
        ({"x0": ["x_1"]}, pm.UsageError, "did you mean 'x_0'?"),
        ({"parameters": {"a": (1.0, 1.0), "x_0": (0, 1)}}, pm.UsageError, "bounds of a"),
        ({"measured": np.zeros(49)}, pm.DataError, "shape (49,)"),
        ({"measured": np.full(50, np.nan)}, pm.DataError, "no value"),
        ({"measured": np.zeros((50, 2))}, pm.UsageError, "say by output"),
        ({"t": np.zeros(50)}, pm.DataError, "times that increase"),
        ({"inputs": {"v": np.full(50, np.nan)}}, pm.DataError, "not finite"),
        ({"weights": [0.0]}, pm.UsageError, "weights do not fit"),
        ({"rhs": lambda t, x, u, p: [0.0, 0.0]}, pm.UsageError, "returned 2 values in place of 1"),
        ({"rhs": lambda t, x, u, p: [1.0 if x[0] > 0 else 2.0]}, pm.UsageError, "vectorised=False"),
        ({"rhs": lambda t, x, u, p: [p["b"]]}, KeyError, "b"),
        ({"rhs": lambda t, x, u, p: [np.nan]}, pm.UsageError, "cannot be simulated"),
        ({"start": {"a": 1.0}}, pm.UsageError, "every parameter"),
        ({"substeps": 0}, pm.UsageError, "substeps is 0"),
        ({"swarm": pm.Swarm(particles=0)}, pm.UsageError, "particles is 0"),
    ],
)
def test_what_is_wrong_is_named(wrong: dict[str, Any], kind: type[Exception], words: str) -> None:
    with pytest.raises(kind) as refused:
        decay(**wrong)
    assert words in str(refused.value)


def test_interrupt_returns_the_best_so_far() -> None:
    calls = 0

    def rhs(t: float, x: Any, u: Any, p: Any) -> list[Any]:
        nonlocal calls
        calls += 1
        if calls == 5000:
            raise KeyboardInterrupt
        return [-p["a"] * x[0]]

    fit = decay(rhs=rhs)
    assert fit.interrupted
    assert not fit.converged
    assert fit.parameters["a"].value is not None
    assert np.isfinite(fit.cost)
    assert "interrupted" in str(fit)
