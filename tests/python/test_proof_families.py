"""Whole benches, foreign physics and limited logs: what is made holds what the manual says."""

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

from proof import generate, limits  # noqa: E402
from proof.case import refit  # noqa: E402
from proof.foreign import FORMS  # noqa: E402
from proof.machines import SERVO  # noqa: E402
from proof.manoeuvres import make  # noqa: E402
from proof.plan import Planned, name_of, together  # noqa: E402
from proof.plant import Run, simulate  # noqa: E402
from proof.strengths import RULES  # noqa: E402


@pytest.fixture(scope="module")
def sound() -> Run:
    return simulate(SERVO, {}, make(SERVO, "rich", "none", duration=0.4, seed=3), seed=8)


@pytest.mark.parametrize("kind", limits.KINDS)
def test_a_limited_log_keeps_rows_and_truth_together(kind: str, sound: Run) -> None:
    for seed in range(4):
        worse = limits.limit(sound, kind, SERVO, seed, 8)
        for column in (*worse.log.values(), *worse.truth.values()):
            assert column.shape == worse.t.shape
            assert np.isfinite(column).all()
        assert np.all(np.diff(worse.t) > 0.0)
        assert worse.log.keys() != sound.log.keys() or any(
            not np.array_equal(worse.log[k], sound.log[k]) for k in worse.log
        )


def settings(kind: str, **wanted: float) -> int:
    """A seed of the logger with such settings."""
    for seed in range(1000):
        drawn = limits.drawn(kind, seed)
        if all(drawn[k] == v for k, v in wanted.items()):
            return seed
    raise AssertionError(f"no {kind} with {wanted}")


def test_what_a_logger_does_is_what_its_settings_say(sound: Run) -> None:
    n = len(sound.t)
    thin = limits.limit(sound, "thinned", SERVO, settings("thinned", rows=5.0), 8)
    assert np.array_equal(thin.log["i_a"], sound.log["i_a"][::5])
    held = limits.limit(sound, "held", SERVO, settings("held", rows=4.0, speed_alone=1.0), 8)
    assert np.array_equal(held.log["omega_e"], np.repeat(sound.log["omega_e"][::4], 4)[:n])
    assert np.array_equal(held.log["i_a"], sound.log["i_a"])
    mean = limits.limit(sound, "averaged", SERVO, settings("averaged", rows=4.0), 8)
    assert mean.log["v_d"][7] == pytest.approx(sound.log["v_d"][28:32].mean())
    assert {"i_d", "i_q"} <= mean.log.keys()
    assert "i_a" not in mean.log
    counts = limits.limit(sound, "counts", SERVO, settings("counts", bits=8.0), 8)
    steps = counts.log["i_a"] / (2.0 * limits.FULL_SCALE * SERVO.i_rated / 256)
    assert np.allclose(steps, np.rint(steps))
    coarse = limits.limit(sound, "coarse_angle", SERVO, settings("coarse_angle", bits=9.0), 8)
    angle = np.unwrap(coarse.log["theta_e"]) / SERVO.n_p / (2.0 * np.pi / 512)
    assert np.allclose(angle - angle[0], np.rint(angle - angle[0]), atol=1e-6)
    assert len(np.unique(coarse.log["omega_e"])) < n / 4
    # the vector of the voltage stays where it is in space
    there = [(log["v_d"] + 1j * log["v_q"]) * np.exp(1j * log["theta_e"]) for log in (coarse.log, sound.log)]
    assert np.allclose(*there, atol=0.01 * SERVO.v_dc)
    with pytest.raises(ValueError, match="no limit 'torn'"):
        limits.drawn("torn", 1)


def test_coloured_noise_has_the_stated_size_and_time(sound: Run) -> None:
    how = limits.drawn("coloured", 3)
    added = limits.limit(sound, "coloured", SERVO, 3, 8).log["i_a"] - sound.log["i_a"]
    assert np.std(added) == pytest.approx(how["times_noise"] * SERVO.noise_i, rel=0.3)
    neighbours = np.corrcoef(added[1:], added[:-1])[0, 1]
    assert neighbours == pytest.approx(np.exp(-1.0 / how["rows"]), abs=0.05)


def test_the_plain_fit_reads_a_thinned_log_with_its_steps_of_the_load() -> None:
    manoeuvre = make(SERVO, "rich", "unknown_piecewise", duration=0.4, seed=3)
    run = simulate(SERVO, {}, manoeuvre, seed=8)
    every = limits.limit(run, "thinned", SERVO, settings("thinned", rows=2.0), 8)
    levels = [len(refit(SERVO, manoeuvre, x).load_levels) for x in (run, every)]
    assert levels[0] == levels[1] > 1


def test_every_form_has_a_source_a_strength_and_variables() -> None:
    names = {"theta_m", "theta_e", "omega_e", "i_d", "i_q", "v_d", "v_q", "tau_e", "t"}
    for name, form in FORMS.items():
        assert name in RULES
        assert form.source
        assert form.over
        assert set(form.over) <= names


def test_curves_that_are_one_do_not_act_together() -> None:
    assert together(("stribeck_friction", "quadratic_drag", "dead_time"))
    assert not together(("stribeck_friction", "coulomb_friction"))
    assert not together(("two_mass_shaft", "x_backlash"))
    assert not together(("iron_loss", "inter_turn_short"))
    assert not together(("x_root_friction", "quadratic_drag"))


def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, planned: Planned) -> dict[str, object]:
    monkeypatch.setattr(generate, "DURATION", (0.4, 0.5))
    told = generate.generate(1, 5, planned, tmp_path)
    assert told == json.loads((tmp_path / "sealed" / name_of(1) / "truth.json").read_text())
    return told


def test_a_whole_bench_states_every_part_and_can_be_solved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("dead_time", "coulomb_friction", "encoder_angle_offset")
    told = made(tmp_path, monkeypatch, Planned("whole", names, "servo", "none", "full", "plant", "whole"))
    assert told["components"] == list(names)
    assert told["alone"].keys() == set(names)
    assert all(1.25 <= size <= 33.0 for size in told["alone"].values())
    for run in told["runs"].values():
        assert all(v < 1.3 for v in run["oracle"].values())
        assert max(run["plain_refit"].values()) > 1.25


def test_a_form_beside_a_known_effect_says_where_it_acts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("x_eddy_brake", "dead_time")
    told = made(tmp_path, monkeypatch, Planned("foreign", names, "servo", "none", "full", "plant", "foreign"))
    assert told["components"] == ["dead_time"]
    assert told["expected"] == "partial"
    assert told["foreign"]["x_eddy_brake"] == {
        "equations": ["mechanical"], "over": ["omega_e"], "shows": ["mechanical"]
    }  # fmt: skip
    assert told["alone"]["x_eddy_brake"] >= 4.5


def test_an_effect_shows_in_a_limited_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    planned = Planned("limited", ("dead_time",), "servo", "none", "counts", "plant", "limits")
    told = made(tmp_path, monkeypatch, planned)
    assert told["degraded"] == "counts"
    assert told["logger"].keys() == {"bits"}
    assert 2.5 <= told["alone"]["dead_time"] <= 33.0
