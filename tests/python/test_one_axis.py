"""Waveforms in which v_d was not logged, simulated by formulas of their own."""

from __future__ import annotations

import numpy as np
import pmsm_rs as pm
import pytest
from pmsm_rs.view.headline import headline

R_S, L_Q, PSI_M, N_P = 0.5, 3e-4, 0.004, 7
J, TAU_C = 2e-5, 0.004
"""Inertia, kg·m², and Coulomb friction, N·m."""
PERIOD = 1e-3


def turning(seed: int = 3) -> dict[str, np.ndarray]:
    """Six seconds under a triangle of i_q, against Coulomb friction; currents, speed and v_q with noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(6000) * PERIOD
    i_q = 1.2 * (2.0 * np.abs(2.0 * ((t / 0.6) % 1.0) - 1.0) - 1.0)
    torque, omega, speed = 1.5 * N_P * PSI_M * i_q, np.empty_like(t), 0.0
    for k in range(t.size):
        omega[k] = speed
        for _ in range(20):
            speed += PERIOD / 20 / J * (torque[k] - TAU_C * np.tanh(speed / 0.2))
    v_q = R_S * i_q + L_Q * np.gradient(i_q, t) + N_P * omega * PSI_M
    return {
        "t": t,
        "i_d": np.zeros_like(t),
        "i_q": i_q + 0.005 * rng.standard_normal(t.size),
        "omega_m": omega + 0.05 * rng.standard_normal(t.size),
        "v_q": v_q + 0.01 * rng.standard_normal(t.size),
    }


def held(v_err: float, levels: np.ndarray, seed: int = 4) -> dict[str, np.ndarray]:
    """A held rotor under steps of i_q; each phase loses `v_err` (V) against its current."""
    rng = np.random.default_rng(seed)
    i_q = np.repeat(levels, 400)
    v_q = R_S * i_q + 4.0 / np.pi * v_err * np.sign(i_q)
    n = i_q.size
    return {
        "t": np.arange(n) * PERIOD,
        "i_d": np.zeros(n),
        "i_q": i_q + 0.005 * rng.standard_normal(n),
        "theta_m": 0.3 + 1e-4 * rng.standard_normal(n),
        "v_q": v_q + 0.01 * rng.standard_normal(n),
    }


def value(answer: pm.Diagnosis, name: str) -> float:
    found = answer.base[name].value
    assert found is not None
    return found


def test_the_q_equation_and_the_motion_of_one_waveform_are_both_asked() -> None:
    recording = pm.Recording(**turning())
    assert recording.kind == "mechanical"
    answer = pm.diagnose(recording, pm.Machine(n_p=N_P, psi_m=1.1 * PSI_M))
    assert value(answer, "psi_m") == pytest.approx(PSI_M, rel=0.01)
    assert value(answer, "r_s") == pytest.approx(R_S, rel=0.05)
    assert "coulomb_friction" in answer.effects
    [friction] = [c for c in answer.ranking if c.effect == "coulomb_friction"]
    assert friction.parameters["tau_c"].value == pytest.approx(TAU_C, rel=0.1)
    said = [f for f in answer.data_quality if "v_d is not logged" in f["finding"]]
    assert len(said) == 1
    assert "l_d and l_q cannot be seen" in said[0]["consequence"]
    assert "steady points with i_d = 0" in said[0]["finding"]
    assert "l_d" not in answer.base
    assert "l_q" not in answer.base
    assert not answer.recordings
    assert answer.read[0]["questions"]["electrical"]
    assert "Of the voltages only the q equation was asked" in headline(answer)


def test_friction_of_a_run_without_v_d_is_not_taken_for_something_in_the_voltages() -> None:
    answer = pm.diagnose(pm.Recording(**turning(seed=9)), pm.Machine(n_p=N_P))
    sure = {c.effect for c in answer.ranking if c.probability > 0.5}
    assert sure <= {"coulomb_friction", "stribeck_friction"}


@pytest.mark.parametrize("v_err", [0.0, 0.2])
def test_a_held_rotor_shows_resistance_and_dead_time(v_err: float) -> None:
    levels = np.array([0.5, 1.0, 2.0, 4.0, -0.5, -1.0, -2.0, -4.0, 3.0, -3.0])
    recording = pm.Recording(**held(v_err, levels), load="locked")
    answer = pm.diagnose(recording, pm.Machine(n_p=N_P))
    assert value(answer, "r_s") == pytest.approx(R_S, rel=0.02)
    assert set(answer.effects) == ({"dead_time"} if v_err else set())
    assert "psi_m" not in answer.base
    assert any("psi_m, l_d and l_q cannot be seen" in f["consequence"] for f in answer.data_quality)
    assert not answer.read[0]["questions"]["mechanical"]


def test_a_run_that_is_nowhere_steady_says_that_v_q_was_not_used() -> None:
    columns = {name: values[:3000] for name, values in turning().items()}
    columns["i_q"] = columns["i_q"] + 2.0 * np.sin(2.0 * np.pi * 55.0 * columns["t"])
    answer = pm.diagnose(pm.Recording(**columns), pm.Machine(n_p=N_P, psi_m=PSI_M))
    assert any("v_q is not used" in f["consequence"] for f in answer.data_quality)
    assert not answer.read[0]["questions"]["electrical"]
