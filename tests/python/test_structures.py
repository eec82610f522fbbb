"""Structures in .mat files: captures of dSPACE ControlDesk, logs of Simulink, and others."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import MACHINE, Columns, Ran

scipy_io = pytest.importorskip("scipy.io")

LABELS = {
    "v_d": '"Model Root"/"Control"/"Vd_ref"/"Out1"',
    "v_q": '"Model Root"/"Control"/"Vq_ref"/"Out1"',
    "i_d": '"Model Root"/"Measurement"/"id"',
    "i_q": '"Model Root"/"Measurement"/"iq"',
    "theta_e": '"Model Root"/"Encoder"/"theta_e"/"Out1"',
    "omega_e": '"Model Root"/"Encoder"/"omega_e"',
}


def array_of_structures(*elements: dict[str, Any]) -> np.ndarray:
    out = np.empty((1, len(elements)), dtype=[(key, object) for key in elements[0]])
    for k, element in enumerate(elements):
        out[0, k] = tuple(element.values())
    return out


def capture(columns: Columns, *, slow: bool = False) -> dict[str, Any]:
    units = {"theta_e": "rad", "omega_e": "rad/s"}
    y = [
        {"Name": label, "Type": 2.0, "Data": columns[name], "Unit": units.get(name, ""), "XIndex": 1.0}
        for name, label in LABELS.items()
    ]
    x = [{"Name": "", "Type": 4.0, "Data": columns["t"], "Unit": "s"}]
    if slow:
        y.append(
            {
                "Name": '"Thermo"/"tau_load [N·m]"',
                "Type": 2.0,
                "Data": columns["t"][::40] * 3.0,
                "Unit": "N·m",
            }
            | {"XIndex": 2.0}
        )
        x.append({"Name": "", "Type": 4.0, "Data": columns["t"][::40], "Unit": "s"})
    return {"X": array_of_structures(*x), "Y": array_of_structures(*y), "Capture": {"Length": 0.4}}


@pytest.mark.parametrize("packed", [False, True])
def test_a_capture_of_controldesk(packed: bool, columns: Columns, tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    scipy_io.savemat(path, {"run_007": capture(columns)}, do_compression=packed)
    recording = pm.load(path)
    for name in columns:
        np.testing.assert_array_equal(recording.column(name), columns[name])
    assert recording.account.columns["v_d"].source == "Model Root/Control/Vd_ref"


def test_a_capture_by_the_path_of_its_time(columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    path = tmp_path / "run.mat"
    scipy_io.savemat(path, {"run": capture(columns)})
    machine_file.write_text(f'{MACHINE}\n[columns]\nt = "run.X.Data"\n')
    np.testing.assert_array_equal(pm.load(path, machine_file).column("t"), columns["t"])


def test_rasters_of_a_capture_are_brought_together(columns: Columns, tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    scipy_io.savemat(path, {"run": capture(columns, slow=True)})
    recording = pm.load(path)
    np.testing.assert_allclose(recording.column("tau_m")[:361], 3.0 * columns["t"][:361], atol=1e-12)
    assert any("sampled at 25 Hz" in remark.finding for remark in recording.account.remarks)


def test_a_simulink_structure_with_time(columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    signals = [
        {"values": columns[name][:, None], "dimensions": 1.0, "label": name, "blockName": "drive/Scope"}
        for name in LABELS
    ]
    path = tmp_path / "scope.mat"
    scipy_io.savemat(
        path, {"ScopeData": {"time": columns["t"][:, None], "signals": array_of_structures(*signals)}}
    )
    recording = pm.load(path)
    for name in columns:
        np.testing.assert_array_equal(recording.column(name), columns[name])


def test_fields_go_by_their_path(
    columns: Columns, tmp_path: Path, machine_file: Path, run: Callable[..., Ran]
) -> None:
    path = tmp_path / "run.mat"
    motor = {f"x{k}": columns[name] for k, name in enumerate(LABELS)}
    scipy_io.savemat(path, {"run": {"t": columns["t"], "motor": motor, "note": "first run"}})
    lines = "\n".join(f'{name} = "run.motor.x{k}"' for k, name in enumerate(LABELS))
    machine_file.write_text(f"{MACHINE}\n[columns]\n{lines}\n")
    recording = pm.load(path, machine_file)
    for name in columns:
        np.testing.assert_array_equal(recording.column(name), columns[name])
    assert "run.motor.x3" in run("inspect", path).out


def test_a_structure_that_is_damaged_is_refused(columns: Columns, tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    scipy_io.savemat(path, {"run": capture(columns)})
    whole = path.read_bytes()
    rng = np.random.default_rng(5)
    for _ in range(60):
        data = bytearray(whole)
        for at in rng.integers(128, 2000, size=4):
            data[at] = rng.integers(0, 256)
        path.write_bytes(data)
        with suppress(pm.DataError):
            pm.load(path)


def test_a_structure_is_not_unpacked_beyond_the_limit(columns: Columns, tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    zeros = {name: np.zeros(100_000) for name in LABELS}
    scipy_io.savemat(path, {"run": zeros}, do_compression=True)
    with pytest.raises(pm.DataError, match=r"holds a structure|no columns of numbers"):
        pm.load(path, max_bytes=2_000_000)
