"""Exports as programs and texts give in their own tools what the package gives."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from exported import CASES, COMPILER, SHOWN, close, drive, model_and_recording, module
from models import EFFECTS, model_of, simulated
from pmsm_rs.cli import exporting
from pmsm_rs.export import KINDS, export
from pmsm_rs.export.program import evaluate
from pmsm_rs.model import Model


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[Model, Any]:
    return model_and_recording(request.param)


def test_the_python_module_responds_as_the_model(case: tuple[Model, Any], tmp_path: Path) -> None:
    model, recording = case
    assert export(model, "python", tmp_path / "motor.py") == []
    given = drive(recording)
    begin = {"i_d": 0.3, "i_q": 1.0, "omega_m": 2.0, "theta_m": 0.4}
    close(module(tmp_path / "motor.py").respond(**given, **begin), model.respond(**given, **begin), 1e-9)


def test_motulator_runs_the_machine_as_the_model(tmp_path: Path) -> None:
    pytest.importorskip("motulator")
    run = simulated(
        {"saturation_q": {}, "coulomb_friction": {"tau_c": 0.3, "w_0": 2.0}, "quadratic_drag": {}}
    )
    model = model_of(run)
    assert export(model, "motulator", tmp_path / "motor.py") == []
    made = module(tmp_path / "motor.py")
    machine, mechanics = made.machine(), made.mechanics()
    given = drive(run.recording)
    expected = model.respond(**given)
    h = given["t"][1] - given["t"][0]
    state = np.array([machine.state.psi_s, 0.0, 0.0], dtype=complex)

    def slope(x: Any, v: complex, load: float) -> Any:
        machine.state.psi_s, mechanics.state.w_M = x[0], x[1].real
        machine.state.exp_j_theta_m = complex(1)
        machine.inp.u_ss, machine.inp.w_M = v, x[1].real
        mechanics.tau_L = lambda _t: load
        machine.set_outputs(0.0)
        mechanics.set_outputs(0.0)
        mechanics.inp.tau_M = machine.out.tau_M
        return np.array([machine.rhs()[0], mechanics.rhs()[0], x[1]])

    got: dict[str, list[float]] = {name: [] for name in SHOWN}
    steps = model.equations()["steps"]
    for v_d, v_q, load in zip(given["v_d"], given["v_q"], given["tau_load"], strict=True):
        machine.state.psi_s = state[0]
        current = machine.i_s
        for name, x in zip(
            SHOWN, (current.real, current.imag, machine.tau_M, state[1].real, state[2].real), strict=True
        ):
            got[name].append(float(x))
        for _ in range(steps):
            s, v = h / steps, complex(v_d, v_q)
            a = slope(state, v, load)
            b = slope(state + 0.5 * s * a, v, load)
            c = slope(state + 0.5 * s * b, v, load)
            d = slope(state + s * c, v, load)
            state = state + s / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    close(got, expected, 1e-6)


def test_mujoco_turns_the_rotor_as_the_equation_of_motion(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = model_of(simulated({}))
    said = export(model, "mujoco", tmp_path / "motor.xml")
    assert any("Voltages" in sentence for sentence in said)
    made = mujoco.MjModel.from_xml_path(str(tmp_path / "motor.xml"))
    data = mujoco.MjData(made)
    base, n_p = model.specification["base"], model.specification["scales"]["n_p"]
    i_q, k_t = 1.5, 1.5 * n_p * base["psi_m"]
    data.ctrl[0] = i_q
    for _ in range(2000):
        mujoco.mj_step(made, data)
    expected = k_t * i_q / base["b"] * (1.0 - np.exp(-base["b"] / base["j"] * data.time))
    assert data.qvel[0] == pytest.approx(expected, rel=1e-6)
    with_friction = model_of(simulated(EFFECTS["friction"]))
    said = export(with_friction, "mujoco", tmp_path / "motor.xml")
    assert "dead_time" in said[0]
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "motor.xml")).dof_frictionloss[0] == pytest.approx(0.3)


_PROGRAM = """
#include <stdio.h>
#include "motor.h"
int main(void)
{
    int k;
    for (k = -20; k <= 20; k++) {
        const float x = (float)k / 20.0f;
        const float low = MOTOR_FRICTION_LOW, high = MOTOR_FRICTION_HIGH;
        printf("%.9g %.9g %.9g %.9g %.9g %.9g\\n", (double)motor_friction(80.0f * x, 0.0f),
               (double)motor_lookup(motor_friction_table, 129, low, high, 80.0f * x),
               (double)motor_dead_time_voltage(3.0f * x),
               (double)motor_flux(motor_lambda_d_table, 2.0f * x, 3.0f),
               (double)motor_flux(motor_lambda_q_table, 2.0f * x, 3.0f),
               (double)motor_lookup(motor_mtpa_i_q_table, 33, 0.0f, MOTOR_MTPA_TORQUE_MAX, 2.0f + x));
    }
    return 0;
}
"""


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_the_c_header_compiles_without_a_warning_and_gives_the_numbers_of_the_model(tmp_path: Path) -> None:
    assert COMPILER is not None
    model = model_of(simulated(EFFECTS["friction"]))
    assert export(model, "c-header", tmp_path / "motor.h") == []
    (tmp_path / "main.c").write_text(_PROGRAM, encoding="utf-8")
    flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wdouble-promotion", "-O2"]
    made = tmp_path / "main"
    subprocess.run([COMPILER, *flags, "-o", made, tmp_path / "main.c", "-lm"], check=True)
    out = subprocess.run([made], check=True, capture_output=True, text=True).stdout
    got = np.array([[float(x) for x in line.split()] for line in out.splitlines()])
    x = np.arange(-20, 21) / 20.0
    told, base = model.equations(), model.specification["base"]
    lost = evaluate(told["torque"], {"omega_m": 80.0 * x, "theta_m": 0.0, "tau_e": 0.0, "t": 0.0})
    friction = base["b"] * 80.0 * x + lost["coulomb_friction"]
    assert np.allclose(got[:, 0], friction, rtol=1e-4, atol=1e-5)
    # Between its entries the table is linear, while the friction turns over near standstill.
    far = np.abs(80.0 * x) > 2.0
    assert np.allclose(got[far, 1], friction[far], rtol=1e-3)
    dead = next(e["parameters"] for e in model.specification["effects"] if e["effect"] == "dead_time")
    voltage = dead["v_err"] * 3.0 * x / np.hypot(3.0 * x, dead["i_th"])
    assert np.allclose(got[:, 2], voltage, rtol=1e-4, atol=1e-6)
    begin = {"i_d": 2.0 * x, "i_q": 3.0, "omega_m": 0.0, "theta_m": 0.0, "tau_load": 0.0, "t": 0.0}
    flux = evaluate(told["start"], begin)
    assert np.allclose(got[:, 3], flux["lambda_d"], rtol=2e-3)
    assert np.allclose(got[:, 4], flux["lambda_q"], rtol=2e-3)
    # The saturated machine without saliency of its own needs about the torque's own current.
    assert np.all(np.diff(got[:, 5]) > 0.0)


def test_the_modelica_text_defines_every_variable_once(case: tuple[Model, Any], tmp_path: Path) -> None:
    model, _ = case
    assert export(model, "modelica", tmp_path / "Motor.mo") == []
    text = (tmp_path / "Motor.mo").read_text(encoding="utf-8")
    assert text.startswith("model Motor\n")
    assert text.endswith("end Motor;\n")
    declared = re.findall(r"^  (?:output )?Real (\w+)", text, re.M)
    body = text.split("\nequation\n")[1]
    defined = re.findall(r"^  (?:der\()?(\w+)\)? = ", body, re.M)
    assert sorted(declared) == sorted(defined)
    begun = re.findall(r"^  (\w+) = ", text.split("initial equation")[1].split("\nequation\n")[0], re.M)
    assert begun == model.equations()["states"]
    for opening, closing in ("()", "[]"):
        assert text.count(opening) == text.count(closing)


def test_the_machine_file_is_read_back_and_leaves_open_what_is_not_known(tmp_path: Path) -> None:
    model = model_of(simulated(EFFECTS["friction"]))
    data = model.to_dict()
    data["base"]["j"] = {
        "value": None,
        "stderr": None,
        "ci95": None,
        "unit": "kg m^2",
        "why_none": "not seen",
    }
    assert export(Model(data), "machine", tmp_path / "m.toml") == []
    recording = simulated({}).recording
    names = ("t", "v_d", "v_q", "i_a", "i_b", "i_c", "theta_e", "omega_e")
    columns = {name: recording.column(name) for name in names}
    loaded = pm.load(columns, machine=tmp_path / "m.toml")
    assert len(loaded) == len(recording)
    text = (tmp_path / "m.toml").read_text(encoding="utf-8")
    assert f"r_s = {data['base']['r_s']['value']!r}" in text
    assert "\n# j: not seen\n" in text


def test_the_rust_program_holds_the_model_to_the_bit(case: tuple[Model, Any], tmp_path: Path) -> None:
    model, _ = case
    assert export(model, "rust", tmp_path / "main.rs") == []
    held = re.search(r'r##"(.*)"##', (tmp_path / "main.rs").read_text(encoding="utf-8"), re.S)
    assert held is not None
    assert json.loads(held[1]) == model.specification


def test_gym_electric_motor_gets_parameters_and_is_told_what_is_missing(tmp_path: Path) -> None:
    model = model_of(simulated(EFFECTS["friction"]))
    said = export(model, "gem", tmp_path / "motor.py")
    made = module(tmp_path / "motor.py")
    assert made.MOTOR["psi_p"] == model.specification["base"]["psi_m"]
    assert made.LOAD["a"] == pytest.approx(0.3)
    assert "dead_time" in said[0]
    assert "saturation_q" in said[0]


def test_what_cannot_be_exported_is_refused(tmp_path: Path) -> None:
    model = model_of(simulated({}))
    for to, options, said in (
        ("fmuu", {}, "fmu"),
        ("machine", {"temperature": 80.0}, "temperature"),
        ("python", {"temperature": float("nan")}, "degC"),
    ):
        with pytest.raises(pm.UsageError, match=said):
            export(model, to, tmp_path / "x", **options)
    with pytest.raises(pm.UsageError):
        export(model, "python", tmp_path / "nowhere" / "x.py")
    assert list(tmp_path.iterdir()) == []
    assert tuple(KINDS) == exporting._KINDS


def test_the_command_writes_the_model_of_an_answer(tmp_path: Path) -> None:
    from pmsm_rs.cli import main

    model = model_of(simulated(EFFECTS["friction"]))
    (tmp_path / "answer.json").write_text(json.dumps({"model": model.to_dict()}), encoding="utf-8")
    with pytest.raises(SystemExit) as end:
        main(["export", str(tmp_path / "answer.json"), "--to", "python", "-o", str(tmp_path / "motor.py")])
    assert end.value.code == 0
    assert "def derivative(" in (tmp_path / "motor.py").read_text(encoding="utf-8")
