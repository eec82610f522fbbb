"""A designed manoeuvre keeps the limits, tells the rivals apart as it says, and is a file."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Ran
from models import model_of, simulated
from pmsm_rs.experiments import limits
from pmsm_rs.experiments.bench import MARGIN
from pmsm_rs.experiments.references import GENES, Scales, build, families
from pmsm_rs.formulas.reading import torque
from pmsm_rs.formulas.terms import terms
from pmsm_rs.formulas.weak_form import Motion

LIMITS = {"current": 10.0, "speed": 80.0, "time": 0.4}
SHOWN = {"i_max": 5.0, "omega_m_max": 60.0, "v_dc": 300.0, "f_sample": 5000.0, "locked": False}


def answer_of(
    effects: dict[str, dict[str, float]],
    rivals: dict[str, dict[str, float]] | None = None,
    **own: Any,
) -> pm.Diagnosis:
    """An answer that holds the true model, and equivalents of its first effect."""
    run = simulated(effects)
    model = model_of(run)
    told = {**effects, **(rivals or {})}
    first = next(iter(effects), None)
    ranking = [
        {
            "effect": name,
            "probability": 0.5 if rivals else 0.99,
            "sentence": "",
            "equation": "",
            "parameters": {
                key: {"value": x, "stderr": None, "ci95": None, "unit": "", "why_none": ""}
                for key, x in values.items()
            },
            "equivalent_to": list(rivals or {}) if name == first else [],
            "gain_held_out": None,
        }
        for name, values in told.items()
    ]
    return pm.Diagnosis.of(
        {
            "verdict": "ambiguous" if rivals else "named",
            "data_quality": [],
            "located": [],
            "ranking": ranking,
            "model": model.to_dict(),
            "cannot_see": [],
            "next_experiment": None,
            "noise_floor": {"i_d": 0.01, "i_q": 0.01, "omega_e": 0.05},
            "fit": {},
            "recording_kind": "full",
            "machine": {"load": "none", "f_sample": 5000.0, "v_dc": 300.0},
            "options": {"decisive": 2.3},
            "seed": 1,
            "version": pm.__version__,
        }
        | own
    )


@pytest.fixture(scope="module")
def frictions() -> pm.Diagnosis:
    return answer_of({"coulomb_friction": {"tau_c": 0.3}}, {"asymmetric_friction": {"tau_a": 0.3}})


@pytest.fixture(scope="module")
def design(frictions: pm.Diagnosis) -> pm.Design:
    return pm.design(frictions, LIMITS, tries=6, threads=1)


def test_rivals_are_told_apart_with_numbers_for_each(design: pm.Design) -> None:
    assert design.task == "tell apart"
    assert design.settles
    assert design.rivals == ("coulomb_friction", "asymmetric_friction")
    assert {(x.truth, x.rival) for x in design.outcomes} == {design.rivals, design.rivals[::-1]}
    assert design.nats == min(x.nats for x in design.outcomes)
    text = str(design)
    assert "moves no motor" in text.splitlines()[0]
    assert all(str(x) in text for x in design.outcomes)


def test_it_starts_and_ends_at_rest_within_the_limits(design: pm.Design) -> None:
    references = design.references
    assert references["t"][-1] == LIMITS["time"]
    for name in set(references) - {"t"}:
        assert references[name][0] == 0.0
        assert abs(references[name][-1]) < 1e-9
    assert max(design.reached.values()) <= MARGIN


def test_the_expected_outcome_is_what_a_simulated_bench_shows(
    design: pm.Design, frictions: pm.Diagnosis
) -> None:
    first = design.outcomes[0]
    assert first.truth == "coulomb_friction"
    made = pm.simulate(**design.tables, effects=frictions.model, drive={"f_sample": 5000.0})
    omega = made.truth.traces["omega_m"]
    assert np.abs(omega).max() <= LIMITS["speed"]
    currents = np.hypot(made.truth.traces["i_d"], made.truth.traces["i_q"])
    assert currents.max() <= LIMITS["current"]
    # Not refitted, the rival fails at least as much as it is said to fail refitted; the truth does not.
    data = frictions.model.to_dict()
    rival = [{"effect": "asymmetric_friction", "parameters": {"tau_a": 0.3, "b_a": 0.0}}]
    wrong = pm.Model(
        data
        | {
            "effects": ["asymmetric_friction"],
            "specification": {**data["specification"], "effects": rival},
        }
    )

    def times(model: pm.Model) -> float:
        told = model.predict(made.recording)
        return float(np.sqrt(np.mean((told["omega_e_measured"] - told["omega_e_model"]) ** 2))) / 0.05

    assert times(frictions.model) < 1.0
    assert times(wrong) > 0.9 * first.times_noise["omega_e"]


def test_the_same_seed_gives_the_same_design_for_any_number_of_threads(frictions: pm.Diagnosis) -> None:
    one, two = (pm.design(frictions, LIMITS, tries=4, seed=3, threads=n) for n in (1, 2))
    assert one.to_json() == two.to_json()
    assert all(np.array_equal(one.references[k], two.references[k]) for k in one.references)
    other = pm.design(frictions, LIMITS, tries=4, seed=4, threads=1)
    assert other.words != one.words


def test_a_motor_that_may_turn_one_way_and_a_little_does_no_more(frictions: pm.Diagnosis) -> None:
    narrow = {**LIMITS, "speed": [0.0, 50.0], "position": [-1.0, 6.0], "acceleration": 900.0}
    design = pm.design(frictions, narrow, tries=8, threads=1)
    made = pm.simulate(**design.tables, effects=frictions.model, drive={"f_sample": 5000.0})
    omega, theta = made.truth.traces["omega_m"], made.truth.traces["theta_m"]
    assert -0.01 * 50.0 <= omega.min() <= omega.max() <= 50.0
    assert np.ptp(theta) <= 7.0
    assert set(design.reached) == {"current", "voltage", "speed", "acceleration", "position"}


def test_a_recording_holds_the_parameters_of_the_rivals(frictions: pm.Diagnosis) -> None:
    run = simulated({"coulomb_friction": {"tau_c": 0.3}})
    held = pm.design(frictions, LIMITS, recording=run.recording, machine=run.machine, tries=4, threads=1)
    alone = pm.design(frictions, LIMITS, tries=4, threads=1)
    assert held.nats > 0.9 * alone.nats
    with pytest.raises(pm.UsageError, match="without its machine"):
        pm.design(frictions, LIMITS, recording=run.recording)


def test_electrical_rivals_are_told_apart_in_the_currents() -> None:
    answer = answer_of({"dead_time": {"v_err": 2.0}}, {"phase_resistance_imbalance": {"r_excess_rel": 0.1}})
    design = pm.design(answer, LIMITS, tries=3, threads=1)
    assert {"i_d", "i_q"} <= set(design.outcomes[0].times_noise)


def test_without_rivals_the_least_certain_parameter_is_pinned_down() -> None:
    design = pm.design(answer_of({"coulomb_friction": {"tau_c": 0.3}}), LIMITS, tries=4, threads=1)
    assert design.task == "pin down"
    assert not design.settles
    assert "psi_m" in {x.name for x in design.certainties}
    assert all(0.0 < x.stderr_after <= x.stderr_before for x in design.certainties)
    assert design.nats > 1.0


def formula(text: str, **values: float) -> dict[str, Any]:
    parameters = {name: {"value": x, "unit": ""} for name, x in values.items()}
    return {
        "formula": text,
        "parameters": parameters,
        "explains": {},
        "evidence": 1.0,
        "equivalent": True,
    }


def test_formulas_of_an_unknown_torque_are_told_apart() -> None:
    told = [formula("k·sgn(ω)", k=0.4), formula("k·tanh(ω/w_0)", k=0.45, w_0=12.0)]
    design = pm.design(answer_of({}, verdict="unknown", formulas=told), LIMITS, tries=4, threads=1)
    assert design.rivals == ("τ = k·sgn(ω)", "τ = k·tanh(ω/w_0)")
    assert design.settles
    assert max(design.reached.values()) <= MARGIN


def test_the_torque_of_a_formula_is_that_of_its_terms() -> None:
    t = np.linspace(0.0, 1.0, 200)
    moved = Motion(t, 30.0 * np.sin(9.0 * t), 3.0 * t, np.cos(t), np.cos(t), False)
    for term in terms(moved):
        names = [name for name, _ in term.strengths]
        shape = tuple(s.grid[0] for s in term.shapes)
        text = term.text.format(**{name: name for name in [*names, *(s.name for s in term.shapes)]})
        values = {name: 0.5 + k for k, name in enumerate(names)}
        found = torque(
            formula(text, **values, **dict(zip((s.name for s in term.shapes), shape, strict=True)))
        )
        columns = term.columns(moved, shape)
        expected = sum((0.5 + k) * column for k, column in enumerate(columns))
        slow = np.abs(moved.omega_m) < 1.0
        assert np.allclose(found.at(moved)[~slow], np.asarray(expected)[~slow])
    both = torque(formula("k1·sgn(ω) + k2·ω·|ω|", k1=0.5, k2=2.0))
    assert both.at(moved)[100] == pytest.approx(
        np.sign(moved.omega_m[100]) * 0.5 + 2.0 * moved.omega_m[100] * abs(moved.omega_m[100])
    )
    with pytest.raises(pm.DataError, match="is not known"):
        torque(formula("k·magic", k=1.0))


def test_a_held_rotor_is_asked_for_currents_alone() -> None:
    answer = answer_of(
        {"saturation_q": {"k": 0.3}}, {"dead_time": {"v_err": 2.0}}, machine={"load": "locked"}
    )
    design = pm.design(answer, {"current": 8.0, "time": 0.3}, tries=2, threads=1)
    assert "omega_m_ref" not in design.references
    assert "rotor held" in design.words


def test_all_families_stay_within_the_limits_they_are_given() -> None:
    wanted = limits.read({**LIMITS, "position": 4.0, "acceleration": 2000.0}, SHOWN)
    rng = np.random.default_rng(1)
    for kind in (*families(Scales(150.0, True, False)), "held"):
        for _ in range(20):
            made = build(kind, rng.random(GENES), wanted, Scales(150.0, True, False))
            assert np.hypot(made.i_d, made.i_q).max() <= 10.0
            if made.omega_m is None:
                continue
            assert np.abs(made.omega_m).max() <= 80.0
            step = float(made.t[1])
            assert np.abs(np.diff(made.omega_m)).max() / step <= 2000.0
            turned = np.cumsum(made.omega_m) * step
            assert np.abs(turned).max() <= 4.0


def test_a_limit_that_nothing_keeps_is_named(frictions: pm.Diagnosis) -> None:
    with pytest.raises(pm.NotIdentifiableError, match=r"the limit of voltage: .* raise limits.voltage"):
        pm.design(frictions, {**LIMITS, "voltage": 0.5}, tries=2, threads=1)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"speed": 80.0, "time": 1.0}, "limits.current: is missing"),
        ({"current": 5.0, "time": 1.0}, "limits.speed: is missing"),
        ({"current": 5.0, "speed": [10.0, 50.0], "time": 1.0}, "starts at rest"),
        ({"current": 5.0, "speed": 5.0, "time": 1e4}, "limits.time"),
        ({"current": 5.0, "sped": 5.0, "time": 1.0}, "did you mean 'speed'"),
        ({"limit": {"current": 5.0}}, "did you mean 'limits'"),
        (5.0, "limits are expected"),
    ],
)
def test_wrong_limits_are_said(given: Any, told: str, frictions: pm.Diagnosis) -> None:
    with pytest.raises(pm.UsageError, match=told.replace("[", r"\[")):
        pm.design(frictions, given)


def test_operating_points_are_refused() -> None:
    answer = answer_of({"coulomb_friction": {"tau_c": 0.3}}, recording_kind="operating_points")
    with pytest.raises(pm.UsageError, match="operating points"):
        pm.design(answer, LIMITS)


def test_the_files_hold_references_with_units_and_what_is_expected(design: pm.Design, tmp_path: Path) -> None:
    table, beside = design.write(tmp_path / "next.csv")
    rows = list(csv.reader(table.read_text().splitlines()))
    assert rows[0] == [
        f"{name} ({unit})"
        for name, unit in (("t", "s"), ("omega_m_ref", "rad/s"), ("i_d_ref", "A"), ("i_q_ref", "A"))
        if name in design.references
    ]
    assert len(rows) == 1 + len(design.references["t"])
    assert json.loads(beside.read_text()) == design.to_dict()


def test_the_command_writes_both_files_and_overwrites_nothing(
    run: Callable[..., Ran], tmp_path: Path, frictions: pm.Diagnosis
) -> None:
    answer, told = tmp_path / "answer.json", tmp_path / "limits.toml"
    answer.write_text(frictions.to_json())
    told.write_text("[limits]\ncurrent = 10.0\nspeed = [-80.0, 80.0]\ntime = 0.4\n")
    ran = run("design", answer, "--limits", told, "-o", tmp_path / "next.csv", "--tries", 3, "--threads", 1)
    assert ran.code == 0, ran.err
    assert "moves no motor" in ran.out.splitlines()[0]
    assert (tmp_path / "next.csv").exists()
    assert (tmp_path / "next.json").exists()
    ran = run("design", answer, "--limits", told, "-o", tmp_path / "answer.csv", "--tries", 3)
    assert (ran.code, ran.out) == (2, "")
    assert "written over" in ran.err
    ran = run("design", told, "--limits", told, "-o", tmp_path / "next.csv")
    assert ran.code == 2
    assert "no JSON answer" in ran.err
