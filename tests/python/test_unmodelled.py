"""Physics outside the catalogue is described by a map, called unmodelled, that predicts another run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from concealed import diagnosed
from pmsm_rs import Diagnosis
from pmsm_rs.plot import unmodelled as draw
from pmsm_rs.results.unmodelled import Term, functions

pytest.importorskip("numba")


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    from proof.machines import SERVO

    rub = {"x_tight_spot": {"tau": 0.8, "width": 0.4}}
    return diagnosed(tmp_path_factory.mktemp("rubbing"), SERVO, rub, "rich", "none", 5)


def test_what_has_no_name_is_modelled_and_predicts_another_run(rubbing: Diagnosis) -> None:
    assert rubbing.verdict == "unknown"
    unmodelled = rubbing.unmodelled
    assert unmodelled is not None
    assert unmodelled.terms, unmodelled.sentence
    fit, noise = rubbing.fit["validation"], rubbing.noise_floor["omega_e"]
    excess = {when: (fit[when]["omega_e"] / noise) ** 2 - 1 for when in ("before", "after")}
    assert excess["after"] < 0.5 * excess["before"]
    assert unmodelled.gain_held_out is not None
    assert unmodelled.gain_held_out > 0.3


def test_a_rub_at_high_speed_is_not_taken_for_friction(tmp_path: Path) -> None:
    """Inertia hides where it rubs: friction takes away nine tenths of the mean square in the speed. A map
    of the torque predicts more than half of it."""
    from proof.machines import SPINDLE

    rub = {"x_tight_spot": {"tau": 0.0909, "width": 0.458, "place": 0.22}}
    answer = diagnosed(tmp_path, SPINDLE, rub, "fast", "none", 355535, duration=1.0)
    assert answer.verdict == "unknown"
    assert all(candidate.probability < 0.5 for candidate in answer.ranking)
    assert answer.unmodelled is not None
    assert answer.unmodelled.gain_held_out is not None
    assert answer.unmodelled.gain_held_out > 0.5


def test_a_hump_of_friction_at_one_speed_is_mapped_as_narrow_as_it_is(tmp_path: Path) -> None:
    from proof.machines import SERVO

    hump = {"x_friction_hump": {"tau": 0.4, "w_hump": 80.0, "width": 12.0}}
    answer = diagnosed(tmp_path, SERVO, hump, "rich", "measured", 5, duration=1.0)
    assert answer.verdict == "unknown"
    assert answer.unmodelled is not None
    assert "omega_e" in answer.unmodelled.sentence
    assert answer.unmodelled.gain_held_out is not None
    assert answer.unmodelled.gain_held_out > 0.9


def test_a_map_is_never_an_effect(rubbing: Diagnosis) -> None:
    known = {entry["id"] for entry in pm.effects()}
    assert set(rubbing.effects) <= known
    assert {candidate.effect for candidate in rubbing.ranking} <= known
    assert all(candidate.probability <= 0.5 for candidate in rubbing.ranking)


def test_a_term_can_be_used_elsewhere(rubbing: Diagnosis) -> None:
    assert rubbing.unmodelled is not None
    term = next(t for t in rubbing.unmodelled.terms if t.equation == "mechanical")
    trace = rubbing.traces["recording"]
    signals = {
        v["variable"]: trace[f"op_{v['variable']}"] for v in term.variables if f"op_{v['variable']}" in trace
    }
    if len(signals) == len(term.variables):
        values = term(**signals)
        assert values.shape == trace["t"].shape
        assert np.abs(values).max() == pytest.approx(term.peak, rel=0.05)
    with pytest.raises(pm.UsageError, match=str(term.variables[0]["variable"])):
        term()


def test_summary_report_and_card_call_it_unmodelled(rubbing: Diagnosis) -> None:
    assert rubbing.unmodelled is not None
    page = str(rubbing.report())
    for text in (str(rubbing), page, rubbing._repr_html_()):
        assert "without a name" in text
    assert "<h2>Unmodelled</h2>" in page
    assert "with the unmodelled map" in page
    again = Diagnosis.from_json(rubbing.to_json())
    assert again.unmodelled is not None
    assert again.unmodelled.sentence == rubbing.unmodelled.sentence


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_splines_sum_to_one_and_hold_their_ends(degree: int) -> None:
    spline = {"basis": "b_spline", "variable": "i_q", "unit": "A", "low": -4.0, "high": 6.0}
    values = functions({**spline, "degree": degree, "pieces": 4}, np.linspace(-8.0, 10.0, 61))
    assert values.shape == (4 + degree, 61)
    assert np.allclose(values.sum(axis=0), 1.0)
    assert values.min() >= 0.0
    assert np.array_equal(values[:, 0], values[:, 13])


def test_a_product_is_a_sum_over_all_pairs() -> None:
    wave = {"basis": "harmonic", "variable": "theta_e", "unit": "rad", "orders": [2.0, 4.0]}
    way = {"basis": "direction", "variable": "omega_e", "unit": "rad/s", "width": 1.0}
    entry = {
        "equation": "q",
        "sentence": "unmodelled q-axis voltage",
        "formula": "v_q = …",
        "variables": [wave, way],
        "coefficients": [1.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.5, -0.5],
        "unit": "V",
        "peak": 3.5,
    }
    term = Term.of(json.loads(json.dumps(entry)))
    theta, omega = np.array([0.3, 0.3]), np.array([90.0, -90.0])
    expected = [np.cos(0.6) + 0.5 * np.sin(1.2), 3.0 * np.cos(0.6) - 0.5 * np.sin(1.2)]
    assert np.allclose(term(theta_e=theta, omega_e=omega), expected)
    assert draw(term).get_ylabel().endswith("in V")
