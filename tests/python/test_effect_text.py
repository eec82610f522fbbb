"""Effects as text: checked where they are given, and used like those of the catalogue."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from click.testing import CliRunner
from pmsm_rs.cli.commands import cli
from pmsm_rs.config.machine_file import read_machine
from pmsm_rs.model import Model

SPEEDS = {"t": [0.0, 0.1, 0.4, 0.7, 0.9], "value": [0.0, 60.0, -60.0, 80.0, 30.0]}
BRAKE = pm.effect(
    "my_brake",
    torque="k*w/(1+(w/w0)**2)",
    parameters={"k": ("N m s", 0, 1), "w0": ("rad/s", 1, 500)},
)
_THIRD = "2*pi/3"
_PHASE = "{0}/sqrt({0}**2+i_th**2)*{1}"


def _dead_time(function: str) -> str:
    angles = ("theta_e", f"theta_e-{_THIRD}", f"theta_e+{_THIRD}")
    each = zip(("i_a", "i_b", "i_c"), angles, strict=True)
    return "+".join(_PHASE.format(i, f"{function}({angle})") for i, angle in each)


# Per effect of the catalogue: values of a simulated machine, the same effect as text, and which of its
# parameters are those of the catalogue.
KNOWN: dict[str, tuple[dict[str, float], dict[str, Any], tuple[str, ...]]] = {
    "coulomb_friction": (
        {"tau_c": 0.4},
        {
            "torque": "tau_c*tanh(w/w_0)",
            "parameters": {"tau_c": ("N m", 0, 30), "w_0": ("rad/s", 0.02, 2)},
        },
        ("tau_c",),
    ),
    "quadratic_drag": (
        {"k": 2e-4},
        {"torque": "k*w*abs(w)", "parameters": {"k": ("N m s^2", 0, 1e-2)}},
        ("k",),
    ),
    "dead_time": (
        {"v_err": 3.0, "i_th": 0.4},
        {
            "voltage": (f"2/3*v_err*({_dead_time('cos')})", f"-2/3*v_err*({_dead_time('sin')})"),
            "parameters": {"v_err": ("V", 0, 50), "i_th": ("A", 0.05, 10)},
        },
        ("v_err",),
    ),
    "current_offset": (
        {"o_alpha": 0.3, "o_beta": -0.2},
        {
            "current": ("o_alpha", "sqrt(3)/2*o_beta-o_alpha/2", "-sqrt(3)/2*o_beta-o_alpha/2"),
            "parameters": {"o_alpha": ("A", -5, 5), "o_beta": ("A", -5, 5)},
        },
        (),
    ),
    "saturation_q": (
        {"k": 0.4, "s": 2.0},
        {
            "energy": "c/l_q*lambda_q**2*abs(lambda_q/unit)**s/(s+2)",
            "parameters": {
                "c": ("1", 0, 20, 0.3),
                "s": ("1", 0.5, 6),
                "unit": {"unit": "V s", "values": [0.5]},
            },
        },
        (),
    ),
}


def _run(effects: Any, seed: int = 1) -> Any:
    return pm.simulate(
        duration=1.0,
        seed=seed,
        drive={"f_sample": 5000.0},
        reference={"omega_m": SPEEDS, "i_d": {"t": [0.0, 0.3, 0.6], "value": [0.0, -10.0, 5.0]}},
        load={"tau": {"t": [0.0, 0.5], "value": [8.0, 20.0], "shape": "steps"}, "kind": "measured"},
        sensors={"noise_i": 0.02, "noise_omega_e": 0.1},
        effects=effects,
    )


def test_a_definition_says_what_it_is_and_is_frozen() -> None:
    assert BRAKE.strengths == ("k",)
    assert BRAKE.side == "torque"
    assert BRAKE.equation == "torque = k*w/(1+(w/w0)**2)"
    again = pm.Effect.of(json.loads(BRAKE.text))
    assert again == BRAKE
    assert hash(again) == hash(BRAKE)
    with pytest.raises(AttributeError):
        BRAKE.name = "other"  # type: ignore[misc]


@pytest.mark.parametrize(
    ("given", "position", "said", "fix"),
    [
        ({"torque": "k*omga_m"}, 3, "no quantity 'omga_m'", "omega_m"),
        ({"torque": "k*w*w"}, 1, "torque is in N m", "multiply it"),
        ({"torque": "k*w+k"}, 4, "the right side in N m s", "factor"),
        ({"torque": "k*w/w*w*" + "(" * 900}, None, "deep", "fewer"),
        ({"torque": "k*w" + "*1" * 2000}, 2001, "2000 characters", "split"),
        ({"torque": "k*ω"}, 3, "u{3c9}", "plain letters"),
        ({"torque": "k*w**2/w"}, 7, "divides by zero where w = 0", "divisor"),
        ({"torque": "k*w*1e400"}, 5, "no finite number", "12.5"),
        ({"torque": "k*i_q"}, 3, "'i_q' is not known where torque is computed", "use omega_m"),
        ({"torque": "k*w", "angle": "k"}, None, "2 sides", "one of"),
        ({"voltage": "k*w"}, None, "not given as text", "d, q"),
        ({}, None, "0 sides", "one of"),
    ],
)
def test_what_is_wrong_is_named_with_its_place_and_the_way_out(
    given: dict[str, Any], position: int | None, said: str, fix: str
) -> None:
    with pytest.raises(pm.UsageError) as caught:
        pm.effect("own", **given, parameters={"k": ("N m s", 0, 1)})
    assert said in str(caught.value)
    assert fix in str(caught.value.fix)
    if position is not None:
        assert caught.value.position == position  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"k": ("N m s", 0, float("nan"))},
        {"k": ("N m s", 0, float("inf"))},
        {"k": ("N m s", 1, 0)},
        {"k": ("N m s", 0.1, 1)},
        {"k": ("rpm", 0, 1)},
        {"k": ("N m s", "a", 1)},
        {"k": ("N m s", 0)},
        {"k": {"unit": "N m s", "lo": 0}},
        {"k": ("N m s", 0, 1), "unused": ("1", 0, 1)},
        {f"k{n}": ("N m s", 0, 1) for n in range(30)},
        7,
    ],
)
def test_parameters_that_make_no_sense_are_refused(parameters: Any) -> None:
    with pytest.raises(pm.UsageError):
        pm.effect("own", torque="k*w", parameters=parameters)


def test_names_of_the_catalogue_and_names_given_twice_are_refused() -> None:
    with pytest.raises(pm.UsageError, match="the catalogue has an effect of this name"):
        pm.effect("dead_time", torque="k*w", parameters={"k": ("N m s", 0, 1)})
    with pytest.raises(pm.UsageError, match="did you mean dead_time"):
        pm.effect("own", torque="k*w", parameters={"k": ("N m s", 0, 1)}, replaces=["dead_tim"])
    other = pm.effect("my_brake", torque="k*w", parameters={"k": ("N m s", 0, 1)})
    run = _run({})
    with pytest.raises(pm.UsageError, match="two effects have the name 'my_brake'"):
        pm.diagnose(run.recording, run.machine, effects=[BRAKE, other])


@pytest.mark.parametrize("name", list(KNOWN))
def test_an_effect_of_the_catalogue_given_as_text_gets_the_same_verdict_and_parameters(name: str) -> None:
    values, given, same = KNOWN[name]
    run, other = (_run({name: values}, seed) for seed in (1, 2))
    known = pm.diagnose(run.recording, run.machine, other.recording)
    own = pm.effect(f"my_{name}", **given, replaces=[name])
    text = pm.diagnose(run.recording, run.machine, other.recording, effects=[own])
    assert text.verdict == known.verdict
    expected = [f"my_{name}" if effect == name else effect for effect in known.effects]
    assert list(text.effects) == expected
    assert name in known.effects
    found, theirs = (
        next(
            choice["parameters"]
            for choice in answer.model.specification["effects"]
            if wanted in choice["effect"]
        )
        for answer, wanted in ((text, f"my_{name}"), (known, name))
    )
    for parameter in same:
        assert found[parameter] == pytest.approx(theirs[parameter], rel=1e-3)


def test_a_text_effect_is_found_simulated_written_and_exported(tmp_path: Path) -> None:
    values = {"k": 0.03, "w0": 25.0}
    run, other = (_run({BRAKE: values}, seed) for seed in (1, 2))
    assert run.truth.effects["my_brake"] == values
    answer = pm.diagnose(run.recording, run.machine, other.recording, effects=[BRAKE])
    assert answer.verdict == "named"
    assert list(answer.effects) == ["my_brake"]
    found = answer.model.parameters
    name = next(key for key in found if key.endswith("w0"))
    assert found[name].value == pytest.approx(values["w0"], rel=0.1)
    assert "my brake" in str(answer)
    answer.report(tmp_path / "report.html")
    # From JSON alone: the same predictions to the bit.
    file = tmp_path / "answer.json"
    file.write_text(answer.to_json())
    model = Model.read(file)
    before, after = (m.predict(other.recording) for m in (answer.model, model))
    assert all(np.array_equal(before[key], after[key]) for key in before)
    inputs = {"t": np.arange(400) * 1e-3, "v_d": 0.0, "v_q": 30.0, "tau_load": 0.5}
    responses = [m.respond(**inputs) for m in (answer.model, model)]  # type: ignore[arg-type]
    assert np.array_equal(responses[0]["omega_m"], responses[1]["omega_m"])
    assert model.simulate(duration=0.1, reference={"omega_m": 20.0}).truth.effects["my_brake"]


MACHINE = """
[machine]
n_p = 4
r_s = 0.17

[effects.my_brake]
torque = "k*w/(1+(w/w0)**2)"
parameters = { k = ["N m s", 0, 1], w0 = ["rad/s", 1, 500] }
"""


def test_a_machine_file_and_a_configuration_hold_effects_as_text(tmp_path: Path) -> None:
    file = tmp_path / "machine.toml"
    file.write_text(MACHINE)
    assert read_machine(file).effects == (BRAKE,)
    shown = CliRunner().invoke(cli, ["effects", "--machine", str(file)])
    assert shown.exit_code == 0
    assert "my_brake" in shown.output
    one = CliRunner().invoke(cli, ["effects", "my_brake", "--machine", str(file)])
    assert one.exit_code == 0
    assert "k*w/(1+(w/w0)**2)" in one.output
    table = {
        "torque": "k*w/(1+(w/w0)**2)",
        "parameters": {"k": ["N m s", 0, 1], "w0": ["rad/s", 1, 500]},
        "value": {"k": 0.03, "w0": 25.0},
    }
    a = pm.simulate(duration=0.05, reference={"omega_m": 20.0}, effects={"my_brake": table})
    b = pm.simulate(duration=0.05, reference={"omega_m": 20.0}, effects={BRAKE: table["value"]})
    assert np.array_equal(a.recording.column("i_a"), b.recording.column("i_a"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[effects.own]\ntorque = "k*x"\nparameters = { k = ["N m s", 0, 1] }\n', "character 3"),
        ('[effects.own]\ntorqe = "k*w"\n', "no formula"),
        ('[effects.own]\ntorque = "k*w"\nother = 1\n', "unknown key"),
        ("effects = 3\n", "write each effect as a table"),
    ],
)
def test_a_machine_file_with_a_wrong_effect_is_refused(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "machine.toml"
    own, rest = (text, "") if text.startswith("effects") else ("", text)
    file.write_text(f"{own}[machine]\nn_p = 4\n{rest}")
    with pytest.raises(pm.MachineError, match=said):
        read_machine(file)
