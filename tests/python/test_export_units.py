"""Functional mock-up units run as the model, go on from a state, and have what the standard asks for."""

from __future__ import annotations

import ctypes
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import CASES, COMPILER, SHOWN, close, drive, model_and_recording
from models import EFFECTS, model_of, simulated
from pmsm_rs.export import export
from pmsm_rs.export.fmi2 import FMI2
from pmsm_rs.export.fmi3 import FMI3
from pmsm_rs.model import Model

UNITS = ("fmu", "fmu3")


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[Model, Any]:
    return model_and_recording(request.param)


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
