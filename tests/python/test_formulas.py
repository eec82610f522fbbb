"""An unknown torque gets the formula that made it, and none where no simple one describes it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from pmsm_rs.formulas.search import search
from pmsm_rs.formulas.weak_form import Motion, windows

J = 0.004
Torque = Callable[[Any, Any, Any], Any]

# Torques that nobody wrote the terms for: other widths, exponents and mixtures than those of the grids.
FORMS: dict[str, tuple[Torque, str]] = {
    "root": (lambda w, th, te: 0.03 * np.sign(w) * np.abs(w) ** 0.52, "|ω|^"),
    "eddy-current brake": (lambda w, th, te: 0.02 * w / (1.0 + (w / 13.0) ** 2), "ω/(1 + (ω/"),
    "hump": (
        lambda w, th, te: 0.3 * np.sign(w) * np.exp(-(((np.abs(w) - 37.0) / 9.0) ** 2)),
        "− w_1)/w_0)²)",
    ),
    "falling": (lambda w, th, te: 0.2 * np.sign(w) * np.exp(-((w / 11.0) ** 2)), "exp(−(ω/"),
    "once a turn": (lambda w, th, te: 0.1 * np.sin(th + 0.4), "cos(θ)"),
    "tight spot": (
        lambda w, th, te: 0.1 * np.sign(w) * (0.8 + np.cos(th - 1.0)),
        "·sin(θ))·sgn(ω)",
    ),
    "cam": (
        lambda w, th, te: 0.2 * np.exp((np.cos(th - 2.2) - 1.0) / 0.4**2),
        "exp((cos(θ − theta_1) − 1)/w²)",
    ),
    "of the torque": (lambda w, th, te: 0.15 * np.abs(te) * np.sign(w), "|τ_e|·sgn(ω)"),
    "drag and wave": (lambda w, th, te: 4e-5 * w * np.abs(w) + 0.06 * np.cos(3 * th), "ω·|ω|"),
}


def moved(torque: Torque, seed: int, noise: float = 0.02) -> Motion:
    """A motor that reverses under this torque; its speed is measured with noise."""
    rng = np.random.default_rng(seed)
    h, n, fine = 2e-3, 3000, 10
    t = h * np.arange(n)
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    omega, theta = np.zeros(n), np.zeros(n)

    def aim(at: float) -> float:
        waves = zip((0.31, 0.83, 1.7), (45.0, 25.0, 12.0), phases, strict=True)
        return sum(size * np.sin(2.0 * np.pi * f * at + phase) for f, size, phase in waves)

    w, th, driven = aim(0.0), 0.0, np.zeros(n)
    for k in range(n):
        driven[k] = 0.25 * (aim(t[k] + 0.05) - w)
        omega[k], theta[k] = w, th
        for _ in range(fine):
            s = h / fine
            middle = w + 0.5 * s * (driven[k] - float(torque(w, th, driven[k]))) / J
            gain = s * (driven[k] - float(torque(middle, th + 0.5 * s * w, driven[k]))) / J
            w, th = w + gain, th + s * (w + 0.5 * gain)
    # What drives holds from row to row; the log has its mean about each row.
    tau_e = np.concatenate([driven[:1], 0.5 * (driven[1:] + driven[:-1])])
    return Motion(t, omega + noise * rng.standard_normal(n), theta, tau_e, tau_e, load_open=False)


@pytest.mark.parametrize("name", FORMS)
def test_the_form_that_made_the_torque_comes_first(name: str) -> None:
    torque, mark = FORMS[name]
    form, check = windows(moved(torque, 1)), windows(moved(torque, 2))
    assert form is not None
    told = search(form, check, j=J)
    assert told, name
    assert mark in told[0].text, [(f.text, f.evidence) for f in told]
    assert min(told[0].explains.values()) > 0.9
    assert len(told) <= 5
    assert told == sorted(told, key=lambda f: -f.evidence)
    assert not told[0].equivalent


def test_the_numbers_of_a_formula_are_those_that_made_it() -> None:
    form, check = windows(moved(FORMS["hump"][0], 3)), windows(moved(FORMS["hump"][0], 4))
    assert form is not None
    parameters = search(form, check, j=J)[0].parameters
    assert parameters["k"][0] == pytest.approx(0.3, rel=0.1)
    assert parameters["w_1"][0] == pytest.approx(37.0, rel=0.05)
    assert parameters["w_0"][0] == pytest.approx(9.0, rel=0.15)
    assert parameters["w_1"][1] == "rad/s"


def test_no_formula_is_told_for_noise_or_for_a_torque_without_a_law() -> None:
    for seed in range(3):
        form, check = (
            windows(moved(lambda w, th, te: 0.0, seed)),
            windows(moved(lambda w, th, te: 0.0, seed + 9)),
        )
        assert form is not None
        assert search(form, check, j=J) == []
    rng = np.random.default_rng(5)
    # A new torque every 0.1 s, whatever the motor does.
    torques = np.repeat(rng.uniform(-0.3, 0.3, 400), 1000)
    draws = iter(np.concatenate([torques, torques[::-1]]))
    form = windows(moved(lambda w, th, te: next(draws), 6))
    check = windows(moved(lambda w, th, te: next(draws), 7))
    assert form is not None
    assert search(form, check, j=J) == []


def test_a_run_that_is_too_short_or_full_of_gaps_has_no_windows() -> None:
    t = np.array([0.0, 1.0, 2.0])
    assert windows(Motion(t, t, t, t, t, load_open=True)) is None
    t = np.cumsum(np.where(np.arange(100) % 5 == 0, 10.0, 1.0))
    assert windows(Motion(t, t, t, t, t, load_open=True)) is None


def test_of_a_long_run_the_means_of_rows_are_used() -> None:
    t = np.arange(200_001) * 1e-4
    form = windows(Motion(t, np.sin(t), 1.0 - np.cos(t), t, t, load_open=False))
    assert form is not None
    assert len(form.motion.t) <= 60_000
    assert form.motion.load_open is False
    np.testing.assert_allclose(form.motion.omega_m, np.sin(form.motion.t), atol=1e-6)


def test_an_answer_without_a_name_holds_formulas() -> None:
    def recording(seed: int) -> pm.Recording:
        run = moved(FORMS["hump"][0], seed)
        return pm.Recording(t=run.t, tau_e=run.tau_e, omega_m=run.omega_m, theta_m=run.theta_m, load="none")

    machine = pm.Machine(n_p=2, j=1.1 * J, b=0.0)
    answer = pm.diagnose(recording(1), machine, validation=recording(2))
    assert answer.verdict == "unknown"
    assert answer.formulas
    assert "w_1" in answer.formulas[0]["formula"]
    assert answer.data["formulas"] == answer.formulas
    again = type(answer).from_json(answer.to_json())
    assert again.formulas == answer.formulas
    named = pm.diagnose(recording(1).__class__(t=moved(lambda w, th, te: 0.0, 1).t, **_rest()), machine)
    assert named.formulas is None


def _rest() -> dict[str, Any]:
    run = moved(lambda w, th, te: 0.0, 1)
    return {"tau_e": run.tau_e, "omega_m": run.omega_m, "theta_m": run.theta_m, "load": "none"}
