"""The simpler methods: their columns are what the plant does, and they find what they have columns for."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba")
pytest.importorskip("pyarrow")
pytest.importorskip("scipy")

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from proof import baselines  # noqa: E402
from proof.case import base_of, make_case  # noqa: E402
from proof.library import library, respond, signals  # noqa: E402
from proof.machines import SERVO  # noqa: E402
from proof.manoeuvres import make  # noqa: E402
from proof.plan import KNOWN, name_of  # noqa: E402
from proof.plant import simulate  # noqa: E402
from proof.reference import WINDOW, fit_plain  # noqa: E402
from proof.rivals import judge_rivals, lines_of  # noqa: E402
from proof.score import judge_case  # noqa: E402

# small, so that the first order is enough
SMALL: dict[str, dict[str, float]] = {
    "coulomb_friction": {"tau_c": 0.05},
    "quadratic_drag": {"k": 1e-5},
    "dead_time": {"v_err": 0.2},
    "back_emf_harmonics": {"e5_rel": 0.01, "e7_rel": 0.004},
    "saturation_q": {"drop_at_rated": 0.03},
    "cross_saturation": {"psi_drop_at_rated": 0.01},
    "voltage_delay": {"extra_samples": 0.1},
    "phase_resistance_imbalance": {"r_excess_rel": 0.05},
    "inductance_harmonics": {"rel_6": 0.02, "rel_4": 0.01},
    "iron_loss": {"r_c": 3000.0},
    "current_offset": {"o_a": 0.03, "o_b": -0.01, "o_c": -0.02},
    "current_gain_imbalance": {"g_a": 0.01, "g_c": -0.01},
    "encoder_angle_offset": {"offset_el_rad": 0.01},
    "encoder_eccentricity": {"amplitude_el_rad": 0.01},
    "magnet_thermal_drift": {"psi_drop_final": 0.02, "tau": 1.0},
    "rs_thermal_drift": {"rise_at_rated": 0.2, "tau": 1.0},
    "load_torque_pulsation": {"tau_pul": 0.1},
}


@pytest.mark.parametrize("effect", SMALL)
def test_a_column_is_what_the_plant_does(effect: str) -> None:
    """Without noise an effect's columns, and the base beside them, explain nearly all that it changes."""
    manoeuvre = make(SERVO, "rich", "none", duration=0.8, seed=4)
    run = simulate(SERVO, {effect: SMALL[effect]}, manoeuvre, seed=8, noise=False)
    t_s, base = 1.0 / SERVO.f_sample, base_of(SERVO)
    fit = fit_plain(base, run.log, t_s, refit=False)
    scale = {"i_d": 0.02, "i_q": 0.02, "omega_e": 0.1}
    s = signals(run.log, t_s, base)
    own = baselines.Run(run.log, t_s, {"load": "none", "load_value": 0.0, "breaks": ()})
    held = baselines.prepared(own, fit, s, scale)
    basis = np.linalg.qr(held.x)[0]
    rest = held.y - basis @ (basis.T @ held.y)
    shares = []
    for pieces in library(s)[effect]:
        x = np.stack([baselines.stack(respond(s, p, WINDOW), scale) for p in pieces], 1)
        both = np.concatenate([held.x, x], 1)
        size = np.sqrt(np.mean(both**2, axis=0)) + 1e-12
        left = held.y - both @ (np.linalg.lstsq(both / size, held.y, rcond=1e-10)[0] / size)
        shares.append(float(np.sum(left**2) / np.sum(rest**2)))
    assert min(shares) < 0.1


def test_every_known_effect_but_the_shaft_has_columns() -> None:
    run = simulate(SERVO, {}, make(SERVO, "rich", "none", duration=0.1, seed=4), seed=8)
    named = library(signals(run.log, 1e-4, base_of(SERVO)))
    assert set(named) == set(KNOWN) - {"two_mass_shaft"}
    for variants in named.values():
        for piece in (p for pieces in variants for p in pieces):
            assert all(x is None or np.isfinite(x).all() for x in (piece.v, piece.i, piece.tau, piece.w))


def test_stepwise_regression_adds_what_lowers_bic_and_drops_the_rest() -> None:
    rng = np.random.default_rng(2)
    x = rng.standard_normal((500, 6))
    y = 2.0 * x[:, 0] + x[:, 1] - 1.5 * x[:, 3] + rng.standard_normal(500)
    every = np.concatenate([x, y[:, None]], 1)
    groups = {("one", 0): [1], ("two", 0): [2], ("both", 0): [3, 4], ("none", 0): [5]}
    chosen = baselines.stepwise(every.T @ every, [0], groups, 500)
    assert {name for name, _ in chosen} == {"one", "both"}


def test_the_sparse_regression_keeps_what_is_there() -> None:
    pytest.importorskip("pysindy", reason="pip install pmsm-rs[peers]")
    rng = np.random.default_rng(2)
    always, x = rng.standard_normal((500, 2)), rng.standard_normal((500, 5))
    y = 0.7 * x[:, 2] + always @ np.array([3.0, -2.0]) + 0.3 * rng.standard_normal(500)
    assert list(np.flatnonzero(baselines.sparse(x, y, always))) == [2]


def test_the_process_foresees_a_smooth_curve_and_is_none_where_there_is_none() -> None:
    rng = np.random.default_rng(2)
    t = rng.uniform(-1.0, 1.0, 400)
    x = np.stack([np.cos(k * t + k) for k in range(1, 12)], 1)
    always, trained = np.ones((400, 1)), np.arange(400) < 300
    y = np.tanh(3.0 * t) + 0.1 * rng.standard_normal(400)
    rest = y - x @ baselines.process(x, y, always, trained)
    assert np.std(rest) == pytest.approx(0.1, rel=0.15)
    noise = rng.standard_normal(400)
    assert np.std(x @ baselines.process(x, noise, always, trained)) < 0.2


def test_baselines_are_kept_judged_and_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(baselines, "FEATURES", 10)
    opened, sealed = tmp_path / "open" / name_of(0), tmp_path / "sealed" / name_of(0)
    lost = {"dead_time": {"v_err": 1.0}}
    how = {"truth_folder": sealed, "duration": 0.6}
    told = make_case(opened, SERVO, lost, "rich", "unknown_piecewise", 3, **how)
    told |= {"kind": "single", "severity": 9.0, "alone": {"dead_time": 9.0}, "family": "singles"}
    (sealed / "truth.json").write_text(json.dumps(told))
    baselines.run(0, tmp_path)
    kept = baselines.path(0, tmp_path).read_text()
    found = json.loads(kept)
    assert "dead_time" in found["stepwise"]["names"]
    plain = told["runs"]["validation"]
    left = found["stepwise"]["rms"]["i_q"] / plain["noise_rms"]["i_q"]
    assert left < 0.5 * plain["plain_refit"]["i_q"]
    rows = judge_rivals(name_of(0), tmp_path)
    assert (rows["stepwise"].found, rows["stepwise"].strong) == (1, 1)
    assert rows["stepwise"].remaining >= left
    assert rows["gaussian"].names == 0
    text = "\n".join(lines_of([judge_case(name_of(0), tmp_path)], [rows]))
    assert "| stepwise | 1 of 1 (100.0 %) | 1 of 1 (100.0 %) |" in text
    assert text.count("gaussian") == 3
    assert lines_of([], [{}]) == []
