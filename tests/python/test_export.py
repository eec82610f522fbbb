"""Exports run in their own tools give what the package gives."""

from __future__ import annotations

import ctypes
import importlib.util
import json
import re
import shutil
import subprocess
import types
from pathlib import Path
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from models import EFFECTS, MAP, model_of, simulated
from pmsm_rs.cli import exporting
from pmsm_rs.export import KINDS, export
from pmsm_rs.export.fmi2 import FMI2
from pmsm_rs.export.fmi3 import FMI3
from pmsm_rs.export.program import evaluate
from pmsm_rs.model import Model

COMPILER = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
SHOWN = ("i_d", "i_q", "tau_e", "omega_m", "theta_m")
UNITS = ("fmu", "fmu3")


@pytest.fixture(scope="module", params=[*EFFECTS, "mapped"])
def case(request: pytest.FixtureRequest) -> tuple[Model, Any]:
    """A model, and a recording of the machine whose voltages drive it."""
    name = request.param
    run = simulated(EFFECTS["friction" if name == "mapped" else name])
    return model_of(run, MAP if name == "mapped" else None), run.recording


def drive(recording: Any) -> dict[str, Any]:
    n = 1500
    return {
        "t": recording.column("t")[:n],
        "v_d": recording.column("v_d")[:n],
        "v_q": recording.column("v_q")[:n],
        "tau_load": np.where(np.arange(n) < n // 2, 0.5, 1.0),
    }


def close(got: Any, expected: Any, tolerance: float) -> None:
    for name in SHOWN:
        largest = np.abs(expected[name]).max()
        assert np.abs(np.asarray(got[name]) - expected[name]).max() <= tolerance * largest, name


def module(path: Path) -> types.ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def test_the_python_module_responds_as_the_model(case: tuple[Model, Any], tmp_path: Path) -> None:
    model, recording = case
    assert export(model, "python", tmp_path / "motor.py") == []
    given = drive(recording)
    begin = {"i_d": 0.3, "i_q": 1.0, "omega_m": 2.0, "theta_m": 0.4}
    close(module(tmp_path / "motor.py").respond(**given, **begin), model.respond(**given, **begin), 1e-9)


class Unit:
    """A functional mock-up unit in FMPy, of either version, with variables by name."""

    def __init__(self, file: Path, folder: Path, token: str | None = None) -> None:
        import fmpy

        self.description = fmpy.read_model_description(str(file))
        self.newer = self.description.fmiVersion == "3.0"
        self.places = {x.name: x.valueReference for x in self.description.modelVariables}
        made = fmpy.fmi3.FMU3Slave if self.newer else fmpy.fmi2.FMU2Slave
        self.fmu = made(
            guid=token or (self.description.instantiationToken if self.newer else self.description.guid),
            unzipDirectory=fmpy.extract(str(file), unzipdir=str(folder)),
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="motor",
        )
        self.fmu.instantiate()

    def begin(self, t: float, load: float, **start: float) -> None:
        if not self.newer:
            self.fmu.setupExperiment(startTime=t)
        self.set(**{f"{name}_start": x for name, x in start.items()})
        self.fmu.enterInitializationMode(**({"startTime": t} if self.newer else {}))
        self.set(tau_load=load)
        self.fmu.exitInitializationMode()

    def set(self, **values: float) -> None:
        put = self.fmu.setFloat64 if self.newer else self.fmu.setReal
        put([self.places[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        read = self.fmu.getFloat64 if self.newer else self.fmu.getReal
        return list(read([self.places[name] for name in names]))

    def step(self, t: float, period: float, v_d: float, v_q: float, load: float) -> None:
        self.set(v_d=v_d, v_q=v_q, tau_load=load)
        done = self.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=period)
        if self.newer:
            assert done == (False, False, False, pytest.approx(t + period))

    def state(self) -> Any:
        return self.fmu.getFMUState() if self.newer else self.fmu.getFMUstate()

    def restore(self, state: Any) -> None:
        (self.fmu.setFMUState if self.newer else self.fmu.setFMUstate)(state)

    def drop(self, state: Any) -> None:
        (self.fmu.freeFMUState if self.newer else self.fmu.freeFMUstate)(state)

    def packed(self, state: Any) -> bytes:
        return bytes((self.fmu.serializeFMUState if self.newer else self.fmu.serializeFMUstate)(state))

    def unpacked(self, data: bytes) -> Any:
        return (self.fmu.deserializeFMUState if self.newer else self.fmu.deSerializeFMUstate)(data)

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
@pytest.mark.parametrize("kind", UNITS)
def test_the_unit_runs_in_fmpy_as_the_model(case: tuple[Model, Any], kind: str, tmp_path: Path) -> None:
    pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    model, recording = case
    file = tmp_path / "motor.fmu"
    assert export(model, kind, file) == []
    (tmp_path / "again").mkdir()
    assert export(model, kind, tmp_path / "again" / "motor.fmu") == []
    assert (tmp_path / "again" / "motor.fmu").read_bytes() == file.read_bytes()
    assert validate_fmu(str(file)) == []
    given = drive(recording)
    period = given["t"][1] - given["t"][0]
    begin = {"i_d": 0.3, "i_q": 1.0, "omega_m": 2.0, "theta_m": 0.4}
    unit = Unit(file, tmp_path / "unit")
    unit.begin(given["t"][0], given["tau_load"][0], **begin)
    rows = []
    for t, *inputs in zip(*(given[name] for name in ("t", "v_d", "v_q", "tau_load")), strict=True):
        rows.append(unit.get(*SHOWN))
        unit.step(t, period, *inputs)
    unit.close()
    got = dict(zip(SHOWN, np.array(rows).T, strict=True))
    # The unit's steps are of one length, those of the recording within rounding.
    given["t"] = given["t"][0] + period * np.arange(len(given["t"]))
    close(got, model.respond(**given, **begin), 1e-6)


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
@pytest.mark.parametrize("kind", UNITS)
def test_a_unit_goes_on_from_a_state_and_starts_anew(kind: str, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy")
    export(model_of(simulated(EFFECTS["harmonics"])), kind, tmp_path / "motor.fmu")
    unit = Unit(tmp_path / "motor.fmu", tmp_path / "unit")

    def run(first: int, last: int) -> list[list[float]]:
        rows = []
        for k in range(first, last):
            unit.step(1e-4 * k, 1e-4, 1.0, 5.0 + 0.1 * k, 0.2)
            rows.append(unit.get(*SHOWN))
        return rows

    unit.begin(0.0, 0.2, omega_m=3.0)
    assert unit.get("omega_m", "omega_m_start", "tau_load") == [3.0, 3.0, 0.2]
    before = run(0, 5)
    state = unit.state()
    after = run(5, 20)
    unit.restore(state)
    assert run(5, 20) == after
    copied = unit.unpacked(unit.packed(state))
    unit.restore(copied)
    assert run(5, 20) == after
    # The start is no longer to be set in the run.
    with pytest.raises(fmpy.fmi1.FMICallException):
        unit.set(omega_m_start=1.0)
    with pytest.raises(fmpy.fmi1.FMICallException):
        unit.set(i_d=1.0)
    for length in (0.0, -1e-4, float("nan"), float("inf")):
        with pytest.raises(fmpy.fmi1.FMICallException):
            unit.step(0.0, length, 0.0, 0.0, 0.0)
    unit.fmu.reset()
    assert unit.get("omega_m", "omega_m_start", "tau_load") == [0.0, 0.0, 0.0]
    unit.begin(0.0, 0.2, omega_m=3.0)
    assert run(0, 5) == before
    for each in (state, copied):
        unit.drop(each)
    unit.close()


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
@pytest.mark.parametrize("kind", UNITS)
def test_a_unit_has_the_functions_of_the_standard(kind: str, tmp_path: Path) -> None:
    assert COMPILER is not None
    fmpy = pytest.importorskip("fmpy")
    headers = Path(fmpy.__file__).parent / "c-code"
    export(model_of(simulated(EFFECTS["friction"])), kind, tmp_path / "motor.fmu")
    folder = Path(fmpy.extract(str(tmp_path / "motor.fmu"), unzipdir=str(tmp_path / "unit")))
    description = fmpy.read_model_description(str(tmp_path / "motor.fmu"))
    assert [x.sourceFiles for x in description.buildConfigurations[0].sourceFileSets] == [["motor.c"]]
    flags = ["-pedantic", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    source = folder / "sources" / "motor.c"
    subprocess.run([COMPILER, "-std=c99", *flags, source], check=True)
    # Behind the header of the standard, the compiler compares types and functions with those declared there.
    # C11 lets a type be defined again where it is the same, but no enumeration or structure. The header says
    # () in place of (void).
    header = f"fmi{description.fmiVersion[0]}Functions.h"
    text = source.read_text(encoding="utf-8")
    own = r"(?m)^typedef (?:(?:enum|struct) \{[^}]*\} fmi\w+|void \(\*fmi\w+\)\(void\));\n"
    text = re.sub(own, "", text)
    (tmp_path / "checked.c").write_text(f'#include "{header}"\n{text}', encoding="utf-8")
    subprocess.run([COMPILER, "-std=c11", *flags, "-I", headers, tmp_path / "checked.c"], check=True)
    asked = (headers / header).read_text(encoding="utf-8")
    if kind == "fmu":
        # FMI 2.0 asks for these of units for model exchange alone.
        asked = re.sub(r"(?ms)^Functions for FMI2 for Model.*?^Functions for FMI2 for Co", "", asked)
    names = re.findall(r"FullName\((fmi\w+)\)", asked)
    library = ctypes.CDLL(str(next((folder / "binaries").glob("*/motor.*"))))
    assert len(names) > 30
    assert [name for name in names if not hasattr(library, name)] == []


@pytest.mark.parametrize(
    ("machine", "system", "older", "newer"),
    [
        ("x86_64", "linux", "linux64", "x86_64-linux"),
        ("aarch64", "linux", "linux64", "aarch64-linux"),
        ("x86_64", "darwin", "darwin64", "x86_64-darwin"),
        ("arm64", "darwin", "darwin64", "aarch64-darwin"),
    ],
)
def test_each_version_has_its_names_of_platforms(
    machine: str, system: str, older: str, newer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platform.machine", lambda: machine)
    monkeypatch.setattr("platform.architecture", lambda: ("64bit", ""))
    assert (FMI2.platform(system), FMI3.platform(system)) == (older, newer)


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_a_unit_of_fmi_3_says_why_it_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmpy = pytest.importorskip("fmpy")
    export(model_of(simulated({})), "fmu3", tmp_path / "motor.fmu")
    with pytest.raises(Exception, match="Failed to instantiate"):
        Unit(tmp_path / "motor.fmu", tmp_path / "refused", token="{another}")
    assert "token" in capsys.readouterr().out
    unit = Unit(tmp_path / "motor.fmu", tmp_path / "unit")
    assert unit.fmu.getVersion() == "3.0"
    with pytest.raises(Exception, match="Failed to instantiate"):
        fmpy.fmi3.FMU3Slave.instantiate(unit.fmu, eventModeUsed=True)
    assert "event mode" in capsys.readouterr().out
    unit.fmu.instantiate()
    unit.begin(0.5, 0.0)
    assert unit.get("time") == [0.5]
    unit.step(0.5, 1e-4, 0.0, 5.0, 0.0)
    assert unit.get("time") == [pytest.approx(0.5001)]
    for read in (unit.fmu.getFloat32, unit.fmu.getInt32, unit.fmu.getBoolean, unit.fmu.getClock):
        assert read([]) == []
        with pytest.raises(fmpy.fmi1.FMICallException):
            read([0])
    assert "no such variables" in capsys.readouterr().out
    for refused in (unit.fmu.enterEventMode, unit.fmu.enterStepMode, unit.fmu.updateDiscreteStates):
        with pytest.raises(fmpy.fmi1.FMICallException):
            refused()
    assert "without events" in capsys.readouterr().out
    unit.close()


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
