"""Several recordings of one machine, from the independent plant: neither shows alone what both do."""

from __future__ import annotations

import json
import pickle
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from pmsm_rs.config.machine_file import read_machine

pytest.importorskip("numba")
pq = pytest.importorskip("pyarrow.parquet")

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from proof.case import machine_file, nameplate_of, write_parquet  # noqa: E402
from proof.machines import SERVO  # noqa: E402
from proof.manoeuvres import Manoeuvre, make  # noqa: E402
from proof.plant import simulate  # noqa: E402

TAU_C = 0.3


def sweep(low: float, high: float, seed: int) -> Manoeuvre:
    """0.6 s between two shares of the rated speed, never through standstill; no load, the currents move."""
    rich = make(SERVO, "rich", "none", duration=0.6, seed=seed)
    phase = np.linspace(0.0, 2.0 * np.pi, len(rich.w_ref))
    w = SERVO.w_rated * (0.5 * (low + high) - 0.5 * (high - low) * np.cos(phase))
    return replace(rich, w_ref=w, w_start=float(w[0]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sweeps of a machine with Coulomb friction, one in each direction."""
    folder = tmp_path_factory.mktemp("together")
    effects = {"coulomb_friction": {"tau_c": TAU_C}}
    ahead, back = sweep(0.01, 0.5, 3), sweep(-0.7, -0.3, 4)
    (folder / "machine.toml").write_text(machine_file(nameplate_of(SERVO, 5), ahead))
    for name, manoeuvre, seed in (("ahead", ahead, 21), ("back", back, 22)):
        write_parquet(folder / f"{name}.parquet", simulate(SERVO, effects, manoeuvre, seed=seed))
    return folder


def recording(folder: Path, name: str) -> pm.Recording:
    return pm.load(folder / f"{name}.parquet", machine=folder / "machine.toml")


def machine(folder: Path) -> pm.Machine:
    return read_machine(folder / "machine.toml").machine


@pytest.fixture(scope="module")
def together(folder: Path) -> pm.Diagnosis:
    return pm.diagnose([recording(folder, name) for name in ("ahead", "back")], machine(folder))


@pytest.mark.parametrize("name", ["ahead", "back"])
def test_one_direction_alone_does_not_name_the_friction(folder: Path, name: str) -> None:
    alone = pm.diagnose(recording(folder, name), machine(folder))
    assert alone.verdict != "named"
    assert alone.recordings == ()


def test_two_directions_together_name_it(together: pm.Diagnosis) -> None:
    assert (together.verdict, together.effects) == ("named", ("coulomb_friction",))
    found = together.ranking[0].parameters["tau_c"]
    assert found.ci95 is not None
    assert found.ci95[0] < TAU_C < found.ci95[1]
    assert found.value == pytest.approx(TAU_C, rel=0.05)


def test_the_order_does_not_matter(folder: Path, together: pm.Diagnosis) -> None:
    swapped = pm.diagnose([recording(folder, name) for name in ("back", "ahead")], machine(folder))
    assert (swapped.verdict, swapped.effects) == (together.verdict, together.effects)
    for name, entry in together.base.items():
        assert swapped.base[name].value == pytest.approx(entry.value, rel=1e-3), name
    assert [r["samples"] for r in swapped.recordings] == [r["samples"] for r in together.recordings][::-1]


def test_each_recording_is_accounted_for(together: pm.Diagnosis) -> None:
    assert [Path(r["file"]).name for r in together.recordings] == ["ahead.parquet", "back.parquet"]
    for entry in together.recordings:
        assert entry["fit"]["after"].keys() == entry["noise_floor"].keys() == {"i_d", "i_q", "omega_e"}
    trace = together.traces["recording"]
    assert set(trace["recording"]) == {1.0, 2.0}
    assert np.all(np.diff(trace["t"]) > 0)
    whole = np.sqrt(np.mean((trace["i_q_measured"] - trace["i_q_after"]) ** 2))
    assert together.fit["recording"]["after"]["i_q"] == pytest.approx(whole, rel=1e-9)
    assert json.loads(together.to_json())["schema"] == "pmsm-rs.diagnosis/2"


def test_text_and_report_name_the_files(together: pm.Diagnosis) -> None:
    assert "back.parquet" in str(together)
    assert "Each recording" in str(together)
    assert "ahead.parquet" in str(together.report())


def test_loads_may_differ(folder: Path) -> None:
    swing = make(SERVO, "rich", "none", duration=0.6, seed=6)
    runs = []
    for number, load in enumerate((0.4, 1.5)):
        loaded = replace(swing, load="unknown_constant", tau_load=np.full_like(swing.tau_load, load))
        log = simulate(SERVO, {}, loaded, seed=31 + number)
        runs.append(pm.Recording({"t": log.t, **log.log}, load="unknown_constant"))
    answer = pm.diagnose(runs, machine(folder))
    assert answer.verdict == "no_mismatch"
    assert answer.base["tau_load_of_1"].value == pytest.approx(0.4, abs=0.02)
    assert answer.base["tau_load_of_2"].value == pytest.approx(1.5, abs=0.02)


def test_a_cold_and_a_hot_recording_tell_how_the_winding_warms(folder: Path) -> None:
    alpha, rich = 0.0039, make(SERVO, "rich", "none", duration=0.6, seed=6)
    runs = []
    for number, degrees in enumerate((20.0, 80.0)):
        warm = replace(SERVO, r_s=SERVO.r_s * (1.0 + alpha * (degrees - 20.0)))
        log = simulate(warm, {}, rich, seed=31 + number)
        columns = {"t": log.t, **log.log, "temperature": np.full_like(log.t, degrees)}
        runs.append(pm.Recording(columns, load="none"))
    answer = pm.diagnose(runs, machine(folder))
    assert (answer.verdict, answer.effects) == ("named", ("rs_thermal_drift",))
    assert answer.ranking[0].parameters["alpha"].value == pytest.approx(alpha, rel=0.03)
    assert answer.base["r_s"].value == pytest.approx(SERVO.r_s, rel=0.01)


def test_what_cannot_be_combined_is_refused_with_number_and_file(folder: Path, tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    rows = "\n".join(f"{k},{50 + k},0.5,{1 + 0.1 * k},{2 + k},{9 + k}" for k in range(20))
    points.write_text(f"t,omega_e,i_d,i_q,v_d,v_q\n{rows}\n")
    with pytest.raises(pm.DataError, match=r"recording 2, .*points\.csv, .*by themselves") as caught:
        pm.diagnose(
            [recording(folder, "ahead"), pm.load(points, machine=folder / "machine.toml")], machine(folder)
        )
    assert (caught.value.recording, Path(caught.value.file).name) == (2, "points.csv")  # type: ignore[attr-defined]


def test_a_recording_keeps_the_name_of_its_file(folder: Path) -> None:
    first = recording(folder, "ahead")
    assert pickle.loads(pickle.dumps(first)).file == first.file == str(folder / "ahead.parquet")


def test_a_validation_run_that_cannot_be_used_is_called_so(folder: Path) -> None:
    back = recording(folder, "back")
    columns = {name: back.column(name) for name in back.names}
    other = pm.Recording({**columns, "omega_e": -columns["omega_e"]}, load="none")
    with pytest.raises(pm.DataError, match=r"^validation run: .*the angle turns"):
        pm.diagnose(recording(folder, "ahead"), machine(folder), other)
