"""Mistakes of wiring, unit and scale that a recording is made with: what is told of them."""

from __future__ import annotations

import numpy as np
import pmsm_rs as pm
import pytest
from pmsm_rs import demo
from pmsm_rs.config import read_machine

pq = pytest.importorskip("pyarrow.parquet")


@pytest.fixture
def columns() -> dict[str, np.ndarray]:
    """The first half second of the demo recording, an inverter that loses voltage in its dead time."""
    table = pq.read_table(demo.recording_files()[0])
    return {name: table[name].to_numpy()[:5000].astype(float) for name in table.column_names}


def diagnosed(columns: dict[str, np.ndarray]) -> pm.Diagnosis:
    machine = read_machine(demo.recording_files()[2]).machine
    return pm.diagnose(pm.Recording(columns, load="unknown_constant"), machine)


@pytest.mark.parametrize(("one", "other"), [("i_b", "i_c"), ("i_a", "i_b"), ("i_c", "i_a")])
def test_interchanged_phases_are_refused_and_the_column_named(columns, one, other):
    columns[one], columns[other] = columns[other], columns[one]
    with pytest.raises(pm.DataError, match="interchange"):
        diagnosed(columns)


def told_mistakes(columns: dict[str, np.ndarray]) -> list[str]:
    answer = diagnosed(columns)
    told = [f["finding"] for f in answer.data_quality if "reads as if" in f["finding"]]
    assert not told or answer.verdict in {"unknown", "undetermined"}
    return told


def test_phases_in_another_place_of_the_turn_are_told(columns):
    columns["i_a"], columns["i_b"], columns["i_c"] = columns["i_b"], columns["i_c"], columns["i_a"]
    [told] = told_mistakes(columns)
    assert "currents of the phases b, c, a were in the columns of a, b, c" in told


@pytest.mark.parametrize(
    ("names", "said"),
    [(("i_a", "i_b", "i_c"), "all currents had the opposite sign"), (("i_b",), "i_b had the opposite sign")],
)
def test_signs_that_explain_what_no_physics_does_are_told(columns, names, said):
    for name in names:
        columns[name] = -columns[name]
    [told] = told_mistakes(columns)
    assert said in told


def test_an_angle_from_another_axis_is_told(columns):
    columns["theta_e"] = columns["theta_e"] - np.pi / 2
    [told] = told_mistakes(columns)
    assert "theta_e was 90° too small" in told


def test_a_recording_as_it_is_reads_as_no_mistake(columns):
    assert not told_mistakes(columns)


@pytest.mark.parametrize(
    ("scaled", "factor", "said"),
    [(("i_a", "i_b", "i_c"), 10.0, "currents"), (("v_d", "v_q"), 0.001, "voltages")],
)
def test_a_scale_that_the_nameplate_contradicts_is_told(columns, scaled, factor, said):
    for name in scaled:
        columns[name] = columns[name] * factor
    findings = [f for f in diagnosed(columns).data_quality if "nameplate" in f["finding"]]
    assert len(findings) == 1
    assert said in findings[0]["fix"]


def test_a_nameplate_as_it_is_allowed_to_be_is_no_finding(columns):
    assert not [f for f in diagnosed(columns).data_quality if "nameplate" in f["finding"]]
