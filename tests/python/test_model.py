"""The model in hand: it predicts, responds and simulates, and goes through JSON without the loss of a bit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from models import EFFECTS, MAP, model_of, simulated
from pmsm_rs.model import Model


@pytest.fixture(scope="module")
def run() -> pm.Simulation:
    return simulated(EFFECTS["friction"])


@pytest.fixture(scope="module")
def model(run: pm.Simulation) -> Model:
    return model_of(run)


def test_the_model_of_an_answer_predicts_what_the_answer_shows(tmp_path: Path) -> None:
    recorded, other = (
        simulated({"coulomb_friction": {"tau_c": 0.4}}),
        simulated({"coulomb_friction": {"tau_c": 0.4}}, seed=2, swap=True),
    )
    answer = pm.diagnose(recorded.recording, recorded.machine, validation=other.recording)
    assert answer.verdict == "named"
    assert answer.model["effects"] == list(answer.model.effects) == ["coulomb_friction"]
    file = tmp_path / "answer.json"
    file.write_text(answer.to_json(), encoding="utf-8")
    again = Model.read(file)
    trace = answer.traces["validation"]
    for held in (answer.model, again):
        seen = held.predict(other.recording, recorded.machine)
        for name in ("i_d", "i_q", "omega_e"):
            assert np.array_equal(seen[f"{name}_model"], trace[f"{name}_after"]), name
            assert np.array_equal(seen[f"{name}_measured"], trace[f"{name}_measured"]), name
    # The estimate of the friction and its error are those of the ranking.
    found = answer.model.parameters["coulomb_friction.tau_c"]
    told = answer.ranking[0].parameters["tau_c"]
    assert found.value == told.value
    assert found.stderr == pytest.approx(told.stderr, rel=1e-6)
    assert answer.model.correlation.shape == (len(answer.model.names),) * 2
    assert np.allclose(np.diag(answer.model.correlation), 1.0)


def test_one_step_ahead_the_noise_is_left_and_in_free_run_the_true_model_errs_by_little_more(
    run: pm.Simulation, model: Model
) -> None:
    free = model.predict(run.recording)
    step = model.predict(run.recording, one_step=True)
    assert set(free) == set(step)
    for seen in (free, step):
        for name, noise in (("i_d", 0.01), ("i_q", 0.01), ("omega_e", 0.05)):
            rms = np.sqrt(np.mean((seen[f"{name}_model"] - seen[f"{name}_measured"]) ** 2))
            assert rms < 3.0 * noise, (name, rms)
    assert not np.array_equal(free["i_q_model"], step["i_q_model"])


def test_each_effect_is_explained_by_what_the_model_says_without_it(run: pm.Simulation, model: Model) -> None:
    told = model.explain(run.recording)
    assert set(told) == set(model.effects)
    size = {effect: np.abs(x["omega_e"]).max() for effect, x in told.items()}
    assert size["coulomb_friction"] > 1.0
    assert size["dead_time"] == 0.0
    assert np.abs(told["dead_time"]["i_d"]).max() > 0.1


def test_the_response_settles_where_voltages_and_torques_balance(model: Model) -> None:
    t = np.arange(6000) * 1e-3
    out = model.respond(t, 0.0, 30.0, 0.5)
    base = model.specification["base"]
    omega, i_q = out["omega_m"][-1], out["i_q"][-1]
    friction = next(x for x in model.specification["effects"] if x["effect"] == "coulomb_friction")
    tau_c = friction["parameters"]["tau_c"]
    assert out["tau_e"][-1] == pytest.approx(0.5 + tau_c + base["b"] * omega, rel=1e-3)
    assert i_q > 0.0
    assert omega > 10.0


def test_a_model_simulates_as_it_stands_with_its_own_machine_and_a_map(run: pm.Simulation) -> None:
    again = pm.simulate(duration=0.1, reference={"omega_m": 40.0}, effects=model_of(run))
    assert again.truth.base == run.truth.base
    assert again.truth.effects.keys() == run.truth.effects.keys()
    assert again.truth.scales == run.truth.scales
    mapped = model_of(run, MAP).simulate(duration=0.1, reference={"omega_m": 40.0})
    assert not np.array_equal(mapped.recording.column("omega_e"), again.recording.column("omega_e"))


def test_json_keeps_every_bit(run: pm.Simulation) -> None:
    held = model_of(run, MAP)
    again = Model(json.loads(json.dumps(held.to_dict())))
    t, first = np.arange(500) * 2e-4, None
    for model in (held, again):
        out = model.respond(t, -1.0, 12.0, 0.1, omega_m=5.0)
        first = first or out
        assert all(np.array_equal(out[name], first[name]) for name in out)


def test_what_is_no_model_is_refused_with_what_to_do(tmp_path: Path, model: Model) -> None:
    with pytest.raises(pm.UsageError, match="no model"):
        Model({"verdict": "named"})
    file = tmp_path / "answer.json"
    for content, said in (("{", "no JSON"), ("[1]", "no model"), ('{"model": {}}', "no model")):
        file.write_text(content, encoding="utf-8")
        with pytest.raises(pm.UsageError, match=said) as error:
            Model.read(file)
        assert str(file) in str(error.value)
    bare = Model({"effects": [], "base": {}})
    with pytest.raises(pm.UsageError, match="nothing was fitted"):
        bare.respond([0.0, 1.0], 0.0, 0.0)
    broken = json.loads(json.dumps(model.to_dict()))
    broken["specification"]["effects"][0]["parameters"]["v_err"] = None
    with pytest.raises(pm.PmsmError):
        Model(broken).respond([0.0, 1.0], 0.0, 0.0)
    with pytest.raises(pm.UsageError, match="length"):
        model.respond([0.0, 1.0], [1.0, 2.0, 3.0], 0.0)
    with pytest.raises(pm.PmsmError, match="increase"):
        model.respond([0.0, 0.0], 0.0, 0.0)
    with pytest.raises(pm.UsageError, match="dead_tim"):
        model.without("dead_tim")
    with pytest.raises(pm.UsageError, match="Recording"):
        model.predict({"t": [0.0]})  # type: ignore[arg-type]


def test_parameters_stand_in_a_frame(model: Model) -> None:
    pytest.importorskip("pandas")
    frame = model.to_frame()
    assert list(frame.columns) == ["value", "stderr", "low", "high", "unit"]
    assert frame.loc["coulomb_friction.tau_c", "unit"] == "N m"
    assert model.machine.n_p == 4
