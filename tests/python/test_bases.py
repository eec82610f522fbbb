"""Groups of a file that were sampled at other rates or times are brought together, and it is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nptdms
import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Columns
from test_containers import UNITS, check, write_mdf

BEGAN = np.datetime64("2024-03-01T10:00:00.000000")
ALL = {**UNITS, "n": "rpm", "v_dc": "V", "tau_m": "N·m", "temperature": "°C"}


def write_groups(path: Path, groups: dict[str, tuple[Columns, dict[str, Any]]]) -> None:
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject(group, name, values, {"unit_string": ALL.get(name, ""), **properties})
                for group, (columns, properties) in groups.items()
                for name, values in columns.items()
            ]
        )


def waveform(start: float, step: float = 1e-3, **more: Any) -> dict[str, Any]:
    began = BEGAN + np.timedelta64(round(start * 1e6), "us")
    return {"wf_increment": step, "wf_start_offset": 0.0, "wf_start_time": began, **more}


def parted(columns: Columns, *names: str) -> tuple[Columns, Columns]:
    rest = {name: values for name, values in columns.items() if name not in {"t", *names}}
    return rest, {name: columns[name] for name in names}


def findings(recording: pm.Recording) -> str:
    return " ".join(remark.finding for remark in recording.account.remarks)


def test_a_slow_speed_is_left_out_beside_an_angle(columns: Columns, tmp_path: Path) -> None:
    fast, slow = parted(columns, "omega_e")
    slow = {name: values[::40] for name, values in slow.items()}
    links = {"v_dc": np.linspace(540.0, 536.0, 4)}
    times = [columns["t"], columns["t"][::40], np.arange(4) * 0.1]
    write_mdf(tmp_path / "r.mf4", [fast, slow, links], times)
    recording = pm.load(tmp_path / "r.mf4")
    assert "omega_e" not in recording.names
    assert recording.kind == "full"
    assert "'omega_e' was left out: it is sampled at 25 Hz, the others at 1000 Hz" in findings(recording)
    assert "'v_dc' was sampled at 10 Hz, and interpolated to the 1000 Hz of the others." in findings(
        recording
    )
    np.testing.assert_allclose(recording.column("v_dc")[150], 538.0)
    assert recording.account.ignored == ("omega_e",)
    assert len(recording) == 400


def test_a_slow_speed_alone_is_interpolated(columns: Columns, tmp_path: Path) -> None:
    fast, slow = parted(columns, "omega_e")
    fast.pop("theta_e")
    write_mdf(
        tmp_path / "r.mf4", [fast, {"omega_e": slow["omega_e"][::10]}], [columns["t"], columns["t"][::10]]
    )
    recording = pm.load(tmp_path / "r.mf4")
    np.testing.assert_allclose(recording.column("omega_e")[:391], columns["omega_e"][:391], atol=0.02)
    assert "'omega_e' was sampled at 100 Hz, and interpolated to the 1000 Hz" in findings(recording)


def test_a_slow_angle_is_left_out_beside_a_speed_in_the_rotor_frame(columns: Columns, tmp_path: Path) -> None:
    fast, slow = parted(columns, "theta_e")
    write_mdf(
        tmp_path / "r.mf4", [fast, {"theta_e": slow["theta_e"][::10]}], [columns["t"], columns["t"][::10]]
    )
    recording = pm.load(tmp_path / "r.mf4")
    assert "theta_e" not in recording.names
    assert "'theta_e' was left out" in findings(recording)


def test_a_current_that_is_too_slow_is_refused(columns: Columns, tmp_path: Path) -> None:
    fast, slow = parted(columns, "i_d", "i_q")
    slow = {name: values[::10] for name, values in slow.items()}
    write_mdf(tmp_path / "r.mf4", [fast, slow], [columns["t"], columns["t"][::10]])
    with pytest.raises(pm.DataError, match="100 Hz, too slow to go with their 1000 Hz") as refused:
        pm.load(tmp_path / "r.mf4")
    assert refused.value.column in {"i_d", "i_q"}
    assert "= false in [columns]" in str(refused.value)


def test_mdf_groups_on_one_time_base_need_no_word(columns: Columns, tmp_path: Path) -> None:
    fast, other = parted(columns, "i_d", "i_q")
    write_mdf(tmp_path / "r.mf4", [fast, other], columns["t"])
    recording = pm.load(tmp_path / "r.mf4")
    check(recording, columns)
    assert recording.account.remarks == ()


def test_mdf_groups_that_start_apart_are_lined_up(columns: Columns, tmp_path: Path) -> None:
    fast, other = parted(columns, "i_d", "i_q")
    later = {name: values[7:] for name, values in other.items()}
    write_mdf(tmp_path / "r.mf4", [fast, later], [columns["t"], columns["t"][7:]])
    check(pm.load(tmp_path / "r.mf4"), {name: values[7:] for name, values in columns.items()})


def test_tdms_groups_that_start_apart_are_lined_up(columns: Columns, tmp_path: Path) -> None:
    drive, daq = parted(columns, "i_d", "i_q")
    late = {name: values[10:] for name, values in daq.items()}
    early = {name: values[:-10] for name, values in drive.items()}
    groups = {"daq": (late, waveform(0.01)), "drive": (early, waveform(0.0))}
    write_groups(tmp_path / "r.tdms", groups)
    recording = pm.load(tmp_path / "r.tdms")
    check(recording, {name: values[10:-10] for name, values in columns.items()})
    assert "'i_d' and 'i_q' start 0.01 s later than the others" in findings(recording)
    assert "sample by sample" in findings(recording)
    assert recording.account.remarks[0].consequence.startswith("10 of 390 rows were cut")


def test_a_row_that_is_refused_counts_from_the_start_of_its_group(columns: Columns, tmp_path: Path) -> None:
    drive, daq = parted(columns, "i_d", "i_q")
    drive["v_d"] = drive["v_d"].copy()
    drive["v_d"][200] = np.nan
    late = {name: values[10:] for name, values in daq.items()}
    write_groups(tmp_path / "r.tdms", {"daq": (late, waveform(0.01)), "drive": (drive, waveform(0.0))})
    with pytest.raises(pm.DataError) as refused:
        pm.load(tmp_path / "r.tdms")
    assert (refused.value.column, refused.value.row) == ("v_d", 200)


def test_half_a_sample_apart_is_interpolated(columns: Columns, tmp_path: Path) -> None:
    drive, daq = parted(columns, "theta_e")
    between = np.unwrap(daq["theta_e"])
    half = np.remainder(0.5 * (between[1:] + between[:-1]), 2.0 * np.pi)
    groups = {"drive": (drive, waveform(0.0)), "daq": ({"theta_e": half}, waveform(0.0005))}
    write_groups(tmp_path / "r.tdms", groups)
    recording = pm.load(tmp_path / "r.tdms")
    turned = np.remainder(recording.column("theta_e") - columns["theta_e"][1:-1] + np.pi, 2.0 * np.pi) - np.pi
    np.testing.assert_allclose(turned, 0.0, atol=1e-4)
    assert "by interpolation" in findings(recording)


def test_groups_of_other_times_are_refused_with_their_spans(columns: Columns, tmp_path: Path) -> None:
    drive, daq = parted(columns, "i_d", "i_q")
    write_groups(tmp_path / "r.tdms", {"drive": (drive, waveform(0.0)), "daq": (daq, waveform(60.0))})
    with pytest.raises(
        pm.DataError, match=r"not recorded at the same time: .*'i_d' and 'i_q' from 60 s to 60.399 s"
    ):
        pm.load(tmp_path / "r.tdms")


def test_tdms_groups_with_times_of_their_own(columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    fast, _ = parted(columns)
    slow = {"t": np.arange(5) * 0.1, "temperature": np.full(5, 40.0)}
    write_groups(tmp_path / "r.tdms", {"fast": ({"t": columns["t"], **fast}, {}), "slow": (slow, {})})
    recording = pm.load(tmp_path / "r.tdms")
    check(recording, {**columns, "temperature": np.full(400, 40.0)})
    machine_file.write_text('[machine]\nn_p = 3\n[columns]\nt = "fast/t"\ntemperature = false\n')
    check(pm.load(tmp_path / "r.tdms", machine_file), columns)


def test_a_group_without_a_start_time_is_not_guessed(columns: Columns, tmp_path: Path) -> None:
    drive, daq = parted(columns, "i_d", "i_q")
    bare = {"wf_increment": 1e-3, "wf_start_offset": 0.0}
    write_groups(tmp_path / "r.tdms", {"drive": (drive, waveform(0.0)), "daq": (daq, bare)})
    with pytest.raises(pm.DataError, match="there is no time column"):
        pm.load(tmp_path / "r.tdms")


def test_what_was_done_stands_in_the_answer(columns: Columns, tmp_path: Path) -> None:
    fast, slow = parted(columns, "omega_e")
    write_mdf(
        tmp_path / "r.mf4", [fast, {"omega_e": slow["omega_e"][::40]}], [columns["t"], columns["t"][::40]]
    )
    recording = pm.load(tmp_path / "r.mf4")
    machine = pm.Machine(r_s=0.9, l_d=0.0096, l_q=0.0213, psi_m=0.193, n_p=3, j=0.0126, b=0.0017)
    answer = pm.diagnose(recording, machine)
    assert any("'omega_e' was left out" in entry["finding"] for entry in answer.data_quality)
    [read] = answer.read
    assert [entry["finding"] for entry in read["done"]] == [r.finding for r in recording.account.remarks]
